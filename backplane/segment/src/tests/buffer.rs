//! The diagnostic buffer: newest first, no partly written entries, kept after a killed driver, noise is not an entry.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{ROUNDS, at, both_ends};
use crate::layout::BUFFER_ENTRIES;
use crate::{BufferEntry, CpSide, Monitor};

fn numbers(monitor: &Monitor) -> Vec<u16> {
    monitor.buffer().map(|entry| entry.number).collect()
}

#[test]
fn the_newest_come_first_with_the_time_of_the_cpu() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    assert_eq!(numbers(cpu.monitor()), []);
    cpu.set_time(1_999_999);
    cp.enter(0x0703, true);
    cpu.set_time(86_400_000_000_000);
    cp.enter(0xFFFF, false);
    let entries: Vec<_> = cpu.monitor().buffer().collect();
    let entry = |number, incoming, time_ms| BufferEntry { number, incoming, time_ms };
    assert_eq!(entries, [entry(0xFFFF, false, 86_400_000), entry(0x0703, true, 1)]);
}

#[test]
fn the_oldest_makes_room() {
    let (_segment, cpu, mut cp) = both_ends(16);
    for number in 0..200 {
        cp.enter(number, true);
        let expected: Vec<u16> = (0..=number).rev().take(BUFFER_ENTRIES).collect();
        assert_eq!(numbers(cpu.monitor()), expected);
    }
}

#[test]
fn a_driver_killed_in_the_middle_of_an_entry_leaves_the_others_whole() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    for number in 0..100 {
        cp.enter(number, true);
    }
    let before = numbers(cpu.monitor());
    let written = segment.peek(at("buffer.written")).unwrap();
    cp.enter(0x0BAD, true);
    // The entry is in its slot, but the number of entries does not include it yet.
    segment.poke(at("buffer.written"), written);
    drop(cp);
    cpu.monitor().driver_gone();
    cpu.restore();
    assert_eq!(numbers(cpu.monitor()), before);
    let mut cp = CpSide::attach(&segment).unwrap();
    assert_eq!(numbers(cpu.monitor()), before, "the buffer is the module's");
    cp.enter(100, true);
    assert_eq!(numbers(cpu.monitor()), (37..=100).rev().collect::<Vec<_>>());
}

#[test]
fn words_nobody_wrote_are_no_entries() {
    let (segment, cpu, mut cp) = both_ends(16);
    cp.enter(7, true);
    segment.poke(at("buffer.written"), u64::MAX);
    assert_eq!(numbers(cpu.monitor()), [7]);
    drop(cp);
    let mut cp = CpSide::attach(&segment).unwrap();
    cp.enter(8, true);
    // The number of entries is 0 again: nothing is shown until there are new ones.
    assert_eq!(numbers(cpu.monitor()), []);
    cp.enter(9, true);
    assert_eq!(numbers(cpu.monitor()), [9]);
}

/// One thread writes entries all the time, another reads: the numbers read decrease by one from entry to entry.
#[test]
fn a_reader_never_sees_an_entry_out_of_its_place() {
    let (_segment, cpu, mut cp) = both_ends(16);
    let over = Arc::new(AtomicBool::new(false));
    let writer = {
        let over = Arc::clone(&over);
        std::thread::spawn(move || {
            // The low bits of the number are sufficient to identify neighbours.
            for number in (0..=u16::MAX).cycle() {
                cp.enter(number, true);
                if over.load(Ordering::Relaxed) {
                    return;
                }
            }
        })
    };
    let mut news = 0;
    while news < ROUNDS / 10 {
        let seen = numbers(cpu.monitor());
        assert!(seen.windows(2).all(|pair| pair[0] == pair[1].wrapping_add(1)), "{seen:?}");
        news += u64::from(!seen.is_empty());
    }
    over.store(true, Ordering::Relaxed);
    writer.join().unwrap();
}
