//! FC 11.

use crate::fragment::{Step, step};
use crate::reception::Job;

/// Plays pairs of what the CP shows and what a call does.
fn play(shown: &[(u16, Step)]) -> Job {
    let mut job = Job::default();
    for (rx, expected) in shown {
        let (next, did) = step(job, *rx, false);
        assert_eq!(did, *expected, "{rx:04X}h");
        job = match did {
            Step::Finish | Step::Failed | Step::Lost(_) => Job::default(),
            _ => next,
        };
    }
    job
}

const fn take(to: u16, len: u16, count: u16) -> Step {
    Step::Take { to, len, count }
}

/// [S0 L1099]: blocks of ASCII-fragmented, one after the other; the last one is marked.
#[test]
fn the_blocks_of_a_telegram_of_unknown_length() {
    let first = [(0x200C, take(0, 12, 0x200C)), (0x200C, Step::Wait), (0, Step::Next), (0, Step::Wait)];
    let second = [(0x200C, take(12, 12, 0x200C)), (0, Step::Next)];
    let job = play(&[&first[..], &second, &[(6, take(24, 6, 6))]].concat());
    assert_eq!((job.geem, job.letzter_block, job.empf_laeuft), (30, true, true));
    assert_eq!(step(job, 6, true).1, Step::Wait, "the CP has not looked yet");
    assert_eq!(step(job, 0, true).1, Step::Finish, "the end of the handshake is not kept back");
    // 24 bytes: the end comes without further bytes.
    let job = play(&[&first[..], &second, &[(0x2000, take(24, 0, 0x2000))]].concat());
    assert_eq!((job.geem, job.letzter_block), (24, true));
    assert_eq!(step(job, 0, true).1, Step::Finish);
    // Up to 12 bytes: one block.
    assert_eq!(play(&[(5, take(0, 5, 5)), (5, Step::Wait), (0, Step::Finish)]), Job::default());
}

/// The rest is lost: no telegram, and the next one starts at the first byte.
#[test]
fn a_telegram_whose_rest_is_lost() {
    let begun = [(0x200C, take(0, 12, 0x200C)), (0, Step::Next)];
    let lost = [(0x27FF, Step::Lost(0x2000)), (0, Step::Wait)];
    let next = [(0x200C, take(0, 12, 0x200C)), (0, Step::Next), (1, take(12, 1, 1)), (0, Step::Finish)];
    assert_eq!(play(&[&begun[..], &lost, &next].concat()), Job::default());
    // Words that belong to an ended job.
    play(&[(0x27FF, Step::Skip(0x2000)), (0, Step::Wait), (0x2000, Step::Skip(0x2000)), (0, Step::Wait)]);
}

/// With another protocol the length is known: counts 30, 18, 6.
#[test]
fn a_whole_telegram_comes_in_blocks() {
    let job = play(&[(30, take(0, 12, 30)), (18, take(12, 12, 18)), (18, Step::Wait), (6, take(24, 6, 6))]);
    assert_eq!((job.geem, job.letzter_block), (30, true));
    assert_eq!(step(job, 0, false).1, Step::Finish);
}

/// [S0 L1099]: the program must reset EMFR, otherwise no further telegram is accepted.
#[test]
fn emfr_keeps_the_next_telegram_back() {
    for rx in [30, 5, 0x200C] {
        assert_eq!(step(Job::default(), rx, true).1, Step::Wait, "{rx:04X}h");
    }
}

#[test]
fn a_count_that_does_not_follow_fails_the_job() {
    let (first, _) = step(Job::default(), 30, false);
    assert_eq!(step(first, 30, false).1, Step::Wait, "the CP has not looked yet");
    for rx in [0, 6, 17, 19, 31, 1024, 0x2000, 0x200C, 0x27FF] {
        assert_eq!(step(first, rx, false).1, Step::Failed, "{rx}");
    }
    let (part, _) = step(Job::default(), 0x200C, false);
    for rx in [5, 0x2000, 0x2005, 0x27FF] {
        assert_eq!(step(part, rx, false).1, Step::Failed, "{rx:04X}h before the echo was taken back");
    }
    for nonsense in [0x200D, 0x8001, 0xFFFF, 1025, 0x4005] {
        assert_eq!(step(first, nonsense, false), (first, Step::Wait), "{nonsense:04X}h is absent");
        assert_eq!(step(Job::default(), nonsense, false).1, Step::Wait);
    }
    let strange = Job { anz_int: 7, empf_laeuft: true, ..Job::default() };
    assert_eq!(step(strange, 12, false).1, Step::Failed, "counters that are not ours");
}
