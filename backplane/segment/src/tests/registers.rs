//! The registers: exchange, torn reads, writers that die or never end.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use super::{ROUNDS, at, both_ends};
use crate::Freshness::{Fresh, Stale};

#[test]
fn registers_cross_in_both_directions_at_every_size() {
    for io_bytes in 8..=64 {
        let (_segment, mut cpu, mut cp) = both_ends(io_bytes);
        let outputs: Vec<u8> = (1..=io_bytes as u8).collect();
        let inputs: Vec<u8> = outputs.iter().map(|byte| byte ^ 0x80).collect();
        let mut seen = [0xee; 70];
        assert!(cpu.write_outputs(&outputs));
        assert_eq!(cp.read_outputs(&mut seen), Fresh);
        assert_eq!(seen[..io_bytes], outputs);
        assert_eq!(seen[io_bytes..], [0xee; 70][io_bytes..], "bytes beyond the registers stay alone");
        assert!(cp.write_inputs(&inputs));
        let mut exact = vec![0; io_bytes];
        assert_eq!(cpu.read_inputs(&mut exact), Fresh);
        assert_eq!(exact, inputs);
        let mut short = [0; 5];
        assert_eq!(cpu.read_inputs(&mut short), Fresh);
        assert_eq!(short, inputs[..5]);
        let mut long = [0xee; 70];
        assert_eq!(cpu.read_inputs(&mut long), Fresh);
        assert_eq!(long[..io_bytes], inputs);
        assert_eq!(long[io_bytes..], [0xee; 70][io_bytes..]);
    }
}

#[test]
fn a_short_write_leaves_the_rest_and_a_long_one_is_cut() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    let mut seen = [0; 16];
    assert!(cpu.write_outputs(&[7; 16]));
    assert!(cpu.write_outputs(&[1, 2]));
    assert_eq!(cp.read_outputs(&mut seen), Fresh);
    assert_eq!(seen, [1, 2, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7]);
    assert!(cpu.write_outputs(&[9; 100]));
    assert_eq!(cp.read_outputs(&mut seen), Fresh);
    assert_eq!(seen, [9; 16]);
    assert!(!cpu.write_outputs(&[]));
}

#[test]
fn an_unchanged_write_touches_nothing() {
    for io_bytes in [16, 60] {
        let (segment, mut cpu, mut cp) = both_ends(io_bytes);
        let sequences = || (segment.peek(at("outputs.sequence")), segment.peek(at("inputs.sequence")));
        let before = sequences();
        assert!(!cpu.write_outputs(&[0; 16]), "a new segment holds zeros");
        assert!(!cp.write_inputs(&[0; 16]));
        assert_eq!(sequences(), before);
        assert!(cpu.write_outputs(&[1; 16]));
        assert!(cp.outputs_changed());
        assert_eq!(cp.read_outputs(&mut [0; 16]), Fresh);
        assert!(!cpu.write_outputs(&[1; 16]));
        assert!(!cp.outputs_changed());
    }
}

#[test]
fn the_number_of_register_bytes_is_checked() {
    for io_bytes in [0, 7, 65, usize::MAX] {
        let refused = crate::CpuSide::create(&crate::Segment::heap(), io_bytes).err();
        assert!(matches!(refused, Some(crate::SegmentError::IoBytes(found)) if found == io_bytes));
    }
}

#[test]
fn a_writer_killed_half_way_costs_at_most_its_last_write() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    let mut seen = [0; 16];
    assert!(cp.write_inputs(&[5; 16]));
    assert_eq!(cpu.read_inputs(&mut seen), Fresh);
    // The driver dies after its first word.
    let sequence = segment.peek(at("inputs.sequence")).unwrap();
    segment.poke(at("inputs.sequence"), sequence + 1);
    segment.poke(at("inputs.data"), u64::MAX);
    drop(cp);
    for _ in 0..3 {
        seen = [0; 16];
        assert_eq!(cpu.read_inputs(&mut seen), Stale);
        assert_eq!(seen, [5; 16], "the reader's own last copy");
    }
    // The next driver never makes the partly written content visible.
    let mut cp = crate::CpSide::attach(&segment).unwrap();
    assert_eq!(segment.peek(at("inputs.sequence")).unwrap() % 2, 0);
    assert_eq!(cpu.read_inputs(&mut seen), Fresh);
    assert_eq!(seen, [0; 16]);
    assert!(cp.write_inputs(&[6; 16]));
    assert_eq!(cpu.read_inputs(&mut seen), Fresh);
    assert_eq!(seen, [6; 16]);
}

#[test]
fn a_sequence_left_odd_stays_odd_until_the_next_content_is_whole() {
    let cell = crate::seqlock::SeqCell::<2>::default();
    let sequence = || cell.sequence.load(crate::sync::Ordering::Relaxed);
    cell.sequence.store(7, crate::sync::Ordering::Relaxed);
    let mut during = Vec::new();
    cell.write((0..2).inspect(|_| during.push(sequence())));
    assert_eq!(during, [9, 9]);
    assert_eq!(sequence(), 10);
    // The end of the number range is only theoretical, but does not cause a panic.
    cell.sequence.store(u64::MAX, crate::sync::Ordering::Relaxed);
    cell.write(0..2);
    assert_eq!(sequence(), 2);
}

#[test]
fn a_reader_comes_back_from_a_writer_that_never_ends() {
    let (segment, mut cpu, mut cp) = both_ends(64);
    let mut seen = [0; 64];
    assert!(cp.write_inputs(&[3; 64]));
    assert_eq!(cpu.read_inputs(&mut seen), Fresh);
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut odd = 1_u64;
            while !ended.load(Ordering::Relaxed) {
                segment.poke(at("inputs.sequence"), odd);
                segment.poke(at("inputs.data"), odd);
                odd = odd.wrapping_add(2);
                thread::yield_now();
            }
        });
        let first_odd = || segment.peek(at("inputs.sequence")).unwrap() % 2 == 1;
        while !first_odd() {
            thread::yield_now();
        }
        for _ in 0..ROUNDS / 20 {
            let freshness = cpu.read_inputs(&mut seen);
            if freshness != Stale || seen != [3; 64] {
                ended.store(true, Ordering::Relaxed);
            }
            assert_eq!(freshness, Stale);
            assert_eq!(seen, [3; 64]);
        }
        ended.store(true, Ordering::Relaxed);
    });
}

/// Registers that show whether they are consistent: every word is derived from the first.
fn fill(number: u64, registers: &mut [u8]) {
    for (index, chunk) in registers.chunks_mut(8).enumerate() {
        let word = number.wrapping_mul(2 * index as u64 + 1).to_le_bytes();
        chunk.copy_from_slice(&word[..chunk.len()]);
    }
}

fn number_of(registers: &[u8]) -> u64 {
    let number = u64::from_le_bytes(registers[..8].try_into().unwrap());
    let mut expected = [0; 64];
    fill(number, &mut expected[..registers.len()]);
    assert_eq!(registers, &expected[..registers.len()], "a torn read");
    number
}

#[test]
fn no_read_is_ever_torn() {
    for io_bytes in [16, 60, 64] {
        let (_segment, mut cpu, mut cp) = both_ends(io_bytes);
        let (ended, has_read) = (AtomicBool::new(false), AtomicBool::new(false));
        thread::scope(|scope| {
            let reader = scope.spawn(|| {
                let (mut last, mut registers) = (0, [0; 64]);
                while !ended.load(Ordering::Acquire) {
                    let freshness = cp.read_outputs(&mut registers[..io_bytes]);
                    let number = number_of(&registers[..io_bytes]);
                    assert!(number >= last, "{number} after {last}");
                    assert!(freshness == Fresh || number == last, "a stale read shows the last copy");
                    last = number;
                    if freshness == Fresh {
                        has_read.store(true, Ordering::Release);
                    }
                    cp.write_inputs(&registers[..io_bytes]);
                }
            });
            let (mut registers, mut echoed) = ([0; 64], 0);
            // On a busy machine the reader may wait for its processor: then longer, but not without limit.
            let goes_on = |number| number <= ROUNDS || (!has_read.load(Ordering::Acquire) && number <= 10_000 * ROUNDS);
            for number in (1..).take_while(|&number| goes_on(number)) {
                fill(number, &mut registers[..io_bytes]);
                cpu.write_outputs(&registers[..io_bytes]);
                let _ = cpu.read_inputs(&mut registers[..io_bytes]);
                let echo = number_of(&registers[..io_bytes]);
                assert!((echoed..=number).contains(&echo), "{echo} after {echoed}");
                echoed = echo;
            }
            ended.store(true, Ordering::Release);
            reader.join().unwrap();
            assert!(has_read.load(Ordering::Acquire), "not one fresh read beside a writer");
        });
    }
}
