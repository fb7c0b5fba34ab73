//! Neither end allocates after its construction: the scan and the driver's loop rely on this.

// A counting allocator needs unsafe code.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use ob1_backplane::{Channel, Counter, CpSide, CpuSide, CpuState, DriverState, Event, EventKind, IoImage, Segment};

thread_local! {
    /// Allocations of this thread only, without those of the test harness.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is left to the system's allocator; counting touches no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // An ending thread has no counter any more, and needs none.
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are passed on unchanged.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on unchanged.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// One pass of everything a scan and a driver's loop do.
fn pass(number: u64, cpu: &mut CpuSide, cp: &mut CpSide, image: &mut IoImage) {
    let mut registers = [number as u8; 60];
    cpu.write_outputs(&registers);
    cpu.write_params(&[number as u8; 16], &[b' '; 4096]).unwrap();
    cpu.write_channel(Channel::Send, &[number as u8; 64]);
    cpu.write_box(63, &[number as u8; 512]);
    let mut content = [0; 512];
    let _ = cp.read_box(63, &mut content);
    assert_eq!(content, [number as u8; 512]);
    cp.write_box(0, &content);
    let _ = cpu.read_box(0, &mut content);
    cpu.set_cpu_state(CpuState::Run);
    let _ = cp.read_outputs(&mut registers);
    assert_eq!(registers, [number as u8; 60]);
    assert_eq!(cp.read_params().unwrap().json.len(), 4096);
    let mut block = [0; 64];
    let _ = cp.read_channel(Channel::Send, &mut block);
    assert_eq!(block, [number as u8; 64]);
    assert!(cp.emit_event(Event::new(number, EventKind::Message, 1, &[1])));
    cp.write_inputs(&registers);
    cp.write_diagnosis(1, &[2; 240]).unwrap();
    cp.write_channel(Channel::Receive, &block);
    cp.set_state(DriverState::Ready);
    cp.count(Counter::BytesTx, 1);
    cpu.set_time(number * 1_000_000);
    cp.enter(number as u16, true);
    assert_eq!(cpu.monitor().buffer().next().map(|entry| entry.time_ms), Some(number));
    cp.beat();
    assert!(cp.prepare_sleep(cp.changes()));
    assert_eq!(cpu.read_diagnosis().unwrap().data().len(), 240);
    let _ = cpu.read_channel(Channel::Receive, &mut block);
    assert!(cpu.poll_event().unwrap().is_some());
    let _ = cpu.read_inputs(&mut registers);
    let _ = (cpu.monitor().counters(), cpu.monitor().driver_state(), cpu.take_doorbell());
    cpu.beat();
    cp.awake();
    image.read_inputs(3, &mut registers);
    image.write_outputs(5, &[number as u8; 30]);
    image.scan_done(number);
}

#[test]
fn both_ends_and_the_image_allocate_nothing_at_work() {
    let segment = Segment::create_shared_with_boxes().unwrap();
    let mut cpu = CpuSide::create(&segment, 60).unwrap();
    let mut cp = CpSide::attach(&segment).unwrap();
    let mut image = IoImage::create_shared().unwrap();
    let made = ALLOCATIONS.get();
    assert!(made > 0, "the allocator counts");
    for number in 1..=100 {
        pass(number, &mut cpu, &mut cp, &mut image);
    }
    cpu.monitor().driver_gone();
    cpu.restore();
    assert_eq!(ALLOCATIONS.get(), made);
}
