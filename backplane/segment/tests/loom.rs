//! Every interleaving and every legal reordering of the exchanges between both ends, explored by loom.
//!
//! loom runs the loads of a thread in their order, so it cannot see a load that is delayed beyond a later store of its
//! own thread. The comments in the code explain why `taken` and `consumed` are released after the copy, and acquired
//! before the slot is written again.
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p ob1-backplane --test loom --release`, with a target directory of its own.
#![cfg(loom)]

use loom::sync::Notify;
use loom::thread;
use ob1_backplane::{CpSide, CpuSide, CpuState, Event, EventKind, Freshness, Segment};
use std::sync::Arc;

/// Number of preemptions explored; errors of sequence locks and doorbells occur with two.
const PREEMPTIONS: usize = 3;

fn explore(test: impl Fn(CpuSide, CpSide) + Send + Sync + 'static) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(PREEMPTIONS);
    model.check(move || {
        let segment = Segment::heap();
        let cpu = CpuSide::create(&segment, 16).expect("a legal number of register bytes");
        let cp = CpSide::attach(&segment).expect("a segment just made");
        test(cpu, cp);
    });
}

/// Registers whose halves must match.
fn registers(number: u8) -> [u8; 16] {
    let mut registers = [number; 16];
    registers[8..].fill(number ^ 0xff);
    registers
}

/// The number in consistent registers; 0 if they were never written.
fn number_of(seen: &[u8; 16]) -> u8 {
    let number = seen[0];
    assert!(*seen == registers(number) || *seen == [0; 16], "a torn read: {seen:?}");
    number
}

#[test]
fn no_read_of_the_registers_is_torn_or_goes_back() {
    explore(|mut cpu, mut cp| {
        let writer = thread::spawn(move || {
            cpu.write_outputs(&registers(1));
            cpu.write_outputs(&registers(2));
        });
        let (mut seen, mut last) = ([0; 16], 0);
        for _ in 0..2 {
            let freshness = cp.read_outputs(&mut seen);
            let number = number_of(&seen);
            assert!(number >= last, "{number} after {last}");
            assert!(freshness == Freshness::Fresh || number == last);
            last = number;
        }
        writer.join().unwrap();
        assert_eq!(cp.read_outputs(&mut seen), Freshness::Fresh);
        assert_eq!(number_of(&seen), 2);
    });
}

#[test]
fn an_answer_never_overtakes_its_question() {
    explore(|mut cpu, mut cp| {
        let driver = thread::spawn(move || {
            let mut seen = [0; 16];
            let _ = cp.read_outputs(&mut seen);
            if number_of(&seen) == 1 {
                cp.write_inputs(&registers(7));
            }
        });
        let mut seen = [0; 16];
        let _ = cpu.read_inputs(&mut seen);
        assert_eq!(number_of(&seen), 0, "the question is not asked yet");
        cpu.write_outputs(&registers(1));
        let _ = cpu.read_inputs(&mut seen);
        assert!(matches!(number_of(&seen), 0 | 7));
        driver.join().unwrap();
    });
}

#[test]
fn a_driver_never_sleeps_through_a_change() {
    explore(|mut cpu, mut cp| {
        // The pipe. If the driver sleeps without being woken, loom finds a deadlock.
        let bell = Arc::new(Notify::new());
        let rung = Arc::clone(&bell);
        let driver = thread::spawn(move || {
            let mut seen = [0; 16];
            loop {
                let mark = cp.changes();
                let _ = cp.read_outputs(&mut seen);
                if number_of(&seen) == 1 {
                    break;
                }
                if cp.prepare_sleep(mark) {
                    rung.wait();
                }
                cp.awake();
            }
        });
        cpu.write_outputs(&registers(1));
        if cpu.take_doorbell() {
            bell.notify();
        }
        driver.join().unwrap();
    });
}

#[test]
fn a_change_of_state_wakes_as_a_change_of_registers_does() {
    explore(|mut cpu, mut cp| {
        let bell = Arc::new(Notify::new());
        let rung = Arc::clone(&bell);
        let driver = thread::spawn(move || {
            loop {
                let mark = cp.changes();
                if cp.cpu_state() == Ok(CpuState::Run) {
                    break;
                }
                if cp.prepare_sleep(mark) {
                    rung.wait();
                }
                cp.awake();
            }
        });
        cpu.set_cpu_state(CpuState::Run);
        if cpu.take_doorbell() {
            bell.notify();
        }
        driver.join().unwrap();
    });
}

#[test]
fn events_arrive_whole_and_in_order() {
    explore(|mut cpu, mut cp| {
        let event = |number: u8| Event::new(u64::from(number), EventKind::Message, u32::from(number), &[number; 16]);
        let driver = thread::spawn(move || (1..=3).map(|number| u64::from(!cp.emit_event(event(number)))).sum::<u64>());
        let mut last = 0;
        for _ in 0..2 {
            if let Some(seen) = cpu.poll_event().expect("no contradiction") {
                last += 1;
                assert_eq!(seen, event(last), "nothing is lost while there is room");
            }
        }
        let lost = driver.join().unwrap();
        assert_eq!(cpu.monitor().events_lost(), lost);
        let mut rest = 0;
        while let Some(seen) = cpu.poll_event().expect("no contradiction") {
            rest += 1;
            assert!(seen.code > u32::from(last) && seen == event(seen.code as u8));
        }
        assert_eq!(u64::from(last) + rest + lost, 3);
    });
}

/// The ring has room for two entries: a reader gets neighbouring entries, or fewer while it is overtaken, and never an
/// entry in a wrong position.
#[test]
fn a_reader_of_the_diagnostic_buffer_is_overtaken_and_never_misled() {
    explore(|cpu, mut cp| {
        let monitor = cpu.monitor().clone();
        let writer = thread::spawn(move || {
            for number in 1..=5 {
                cp.enter(number, true);
            }
        });
        let seen: Vec<u16> = monitor.buffer().map(|entry| entry.number).collect();
        assert!(seen.windows(2).all(|pair| pair[0] == pair[1] + 1), "{seen:?}");
        writer.join().unwrap();
        assert_eq!(monitor.buffer().map(|entry| entry.number).collect::<Vec<_>>(), [5, 4]);
    });
}

/// With the two slots of this test the writer always uses one of them: each read is consistent, none is older than the
/// one before, the last is the newest.
#[test]
fn no_snapshot_of_a_window_is_torn_or_goes_back() {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(PREEMPTIONS);
    model.check(|| {
        let mut window = ob1_backplane::WindowWriter::heap();
        let reader = window.reader();
        let writer = thread::spawn(move || {
            for scan in 1..=3 {
                let head = ob1_backplane::WindowHead { generation: 1, scan, time: scan, state: 0 };
                window.put(head, |words| {
                    words.iter().for_each(|word| word.store(scan, loom::sync::atomic::Ordering::Relaxed));
                });
            }
        });
        let look = || {
            reader.read(|head, words| {
                (head.scan, head.time, [0, 1].map(|at| words[at].load(loom::sync::atomic::Ordering::Relaxed)))
            })
        };
        let mut last = 0;
        for _ in 0..2 {
            let Some((scan, time, words)) = look() else { continue };
            assert_eq!((time, words), (scan, [scan; 2]), "a torn snapshot");
            assert!(scan >= last, "{scan} after {last}");
            last = scan;
        }
        writer.join().unwrap();
        assert_eq!(look(), Some((3, 3, [3; 2])));
    });
}
