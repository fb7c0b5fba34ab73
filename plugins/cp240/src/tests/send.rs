//! FC 0.

use super::fake_cp::FakeCp;
use crate::registers::{AREA, FAILED, NO_PARAMETERS, STARTUP, SYSTEM, Words};
use crate::send::{Job, Refusal, Step, telegram_bytes};
use crate::tx::Left;

/// FC 0's call with FRG = 1, without parameters and data blocks.
struct Caller {
    job: Job,
    frg: bool,
}

impl Caller {
    fn new() -> Self {
        Self { job: Job::default(), frg: true }
    }

    fn call(&mut self, cp: &mut FakeCp, telegram: &[u8], option: u16) -> Step {
        let anz = telegram.len() as u16 | option;
        let (job, step) = match Left::of(cp.words()) {
            _ if self.job.senden_laeuft => self.job.go_on(cp.words()),
            Left::Nothing => Job::start(anz),
            Left::Wait => (self.job, Step::Wait),
            Left::Word(word) => (self.job, Step::Word(word)),
        };
        self.job = job;
        match step {
            Step::Wait => {}
            Step::Word(word) => cp.write(2, &word.to_be_bytes()),
            Step::Block { from, len, word } => {
                let mut bytes = [0; 14];
                bytes[..2].copy_from_slice(&word.to_be_bytes());
                bytes[2..2 + usize::from(len)].copy_from_slice(&telegram[usize::from(from)..][..usize::from(len)]);
                cp.write(2, &bytes);
            }
            Step::Done => (self.job, self.frg) = (Job::default(), false),
            Step::Failed(word) => {
                if let Some(word) = word {
                    cp.write(2, &word.to_be_bytes());
                }
                (self.job, self.frg) = (Job { fehler_kom: true, ..Job::default() }, false);
            }
        }
        step
    }
}

fn telegram(len: usize) -> Vec<u8> {
    (0..len).map(|i| i as u8 ^ 0x5A).collect()
}

#[test]
fn thirty_bytes_are_30_18_6_0() {
    let (mut cp, mut fc0, data) = (FakeCp::working(), Caller::new(), telegram(30));
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Block { from: 0, len: 12, word: 30 });
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Wait, "the CP has not looked yet");
    cp.look();
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Block { from: 12, len: 12, word: 18 });
    assert_eq!(fc0.job, Job { gese: 12, anz_int: 30, senden_laeuft: true, ..Job::default() });
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Wait, "the echo is still 30");
    cp.look();
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Block { from: 24, len: 6, word: 6 });
    assert!(fc0.job.letzter_block && !fc0.job.ende_kom);
    cp.look();
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Word(0));
    assert!(fc0.job.ende_kom);
    cp.look();
    assert_eq!(cp.transmitted, std::slice::from_ref(&data));
    assert_eq!((cp.words().tx_echo, fc0.call(&mut cp, &data, 0)), (6, Step::Wait), "the echo stays while it transmits");
    assert!(fc0.frg);
    cp.finish();
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Done);
    assert_eq!((fc0.frg, fc0.job), (false, Job::default()));
    assert_eq!(cp.log, [30, 18, 6, 0]);
}

#[test]
fn every_length_arrives_whole() {
    for len in 1..=1024 {
        let (mut cp, mut fc0, data) = (FakeCp::working(), Caller::new(), telegram(len));
        let mut calls = 0;
        while fc0.frg {
            fc0.call(&mut cp, &data, 0);
            cp.look();
            if fc0.job.ende_kom && cp.words().tx_echo != 0 {
                cp.finish();
            }
            calls += 1;
            assert!(calls < 200, "{len} bytes hang: {:?}", fc0.job);
        }
        assert_eq!((cp.transmitted, fc0.job.fehler_kom), (vec![data], false), "{len} bytes");
    }
}

#[test]
fn the_output_area_goes_with_every_count_but_0() {
    let (mut cp, mut fc0, data) = (FakeCp::working(), Caller::new(), telegram(14));
    assert_eq!(fc0.call(&mut cp, &data, AREA), Step::Block { from: 0, len: 12, word: 0x400E });
    cp.input[2..4].copy_from_slice(&14u16.to_be_bytes());
    assert_eq!(fc0.call(&mut cp, &data, AREA), Step::Block { from: 12, len: 2, word: 0x4002 });
    cp.input[2..4].copy_from_slice(&0x4002u16.to_be_bytes());
    assert_eq!(fc0.call(&mut cp, &data, AREA), Step::Word(0));
}

#[test]
fn a_failed_order_ends_with_fehler_kom() {
    let (mut cp, mut fc0, data) = (FakeCp::working(), Caller::new(), telegram(5));
    cp.fails_with = Some(0x0A);
    for expected in [Step::Block { from: 0, len: 5, word: 5 }, Step::Word(0)] {
        assert_eq!(fc0.call(&mut cp, &data, 0), expected);
        cp.look();
    }
    cp.finish();
    assert_eq!(cp.words().tx_echo, 0x200A);
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Word(FAILED));
    assert!(fc0.frg && fc0.job.fehler_kom);
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Word(FAILED), "until the CP has seen it");
    cp.look();
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Failed(Some(0)));
    assert_eq!((fc0.frg, fc0.job), (false, Job { fehler_kom: true, ..Job::default() }));
    assert_eq!(cp.log, [5, 0, FAILED]);

    // The next start clears FEHLER_KOM, and the telegram is sent.
    fc0.frg = true;
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Block { from: 0, len: 5, word: 5 });
    assert!(!fc0.job.fehler_kom);
}

#[test]
fn an_error_may_come_in_the_middle_of_the_blocks() {
    let (mut cp, mut fc0, data) = (FakeCp::working(), Caller::new(), telegram(40));
    fc0.call(&mut cp, &data, 0);
    cp.input[2..4].copy_from_slice(&0x2017u16.to_be_bytes());
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Word(FAILED));
    cp.input[2..4].fill(0);
    assert_eq!(fc0.call(&mut cp, &data, 0), Step::Failed(Some(0)));
}

#[test]
fn a_start_up_in_mid_job_fails_it_and_leaves_the_registers_to_fc_9() {
    for visible in [Words { rx: STARTUP, tx_echo: SYSTEM | 7 }, Words { rx: NO_PARAMETERS, tx_echo: SYSTEM | 3 }] {
        for gese in [0, 12, 24, 30] {
            let job = Job { gese, anz_int: 30, senden_laeuft: true, ende_kom: gese == 30, ..Job::default() };
            assert_eq!(job.go_on(visible).1, Step::Failed(None));
        }
        assert_eq!(Left::of(visible), Left::Wait, "and none starts");
    }
}

#[test]
fn an_echo_that_does_not_follow_fails_the_job() {
    let job = |gese| Job { gese, anz_int: 30, senden_laeuft: true, ..Job::default() };
    let go_on = |job: Job, tx_echo| job.go_on(Words { rx: 0, tx_echo }).1;
    // A CP that was reset in between has lost the first block.
    assert_eq!(go_on(job(12), 0), Step::Failed(Some(0)));
    assert_eq!(go_on(job(0), 29), Step::Failed(Some(0)));
    assert_eq!(go_on(job(24), 30), Step::Failed(Some(0)));
    let complete = Job { gese: 30, ende_kom: true, letzter_block: true, ..job(0) };
    assert_eq!(go_on(complete, 18), Step::Failed(Some(0)));
    // A word that is not a count is treated as absent.
    for nonsense in [0x8000, 0xFFFF, 0x1000, 0x0800, 1025] {
        assert_eq!(go_on(job(12), nonsense), Step::Wait, "{nonsense:04X}h");
        assert_eq!(go_on(complete, nonsense), Step::Wait, "{nonsense:04X}h");
    }
}

#[test]
fn counters_that_are_not_ours_fail_the_job() {
    for (gese, anz_int) in [(0, 0), (31, 30), (7, 30), (0, 1025), (0, 0x2005)] {
        let job = Job { gese, anz_int, senden_laeuft: true, ..Job::default() };
        assert_eq!(job.go_on(Words { rx: 0, tx_echo: 0 }).1, Step::Failed(Some(0)), "GESE {gese}, ANZ_INT {anz_int}");
    }
}

#[test]
fn a_start_takes_back_what_an_abandoned_job_left() {
    let left = |tx_echo| Left::of(Words { rx: 0, tx_echo });
    for tx_echo in [18, 0x1C3F, 0x0812] {
        assert_eq!(left(tx_echo), Left::Word(0), "{tx_echo:04X}h");
    }
    assert_eq!(left(0x2007), Left::Word(FAILED));
    assert_eq!(left(0xFFFF), Left::Wait);
    assert_eq!(left(0), Left::Nothing);

    // The program cleared the control bits after two blocks and asks for another telegram.
    let (mut cp, mut fc0, data) = (FakeCp::working(), Caller::new(), telegram(30));
    fc0.call(&mut cp, &data, 0);
    cp.look();
    fc0.call(&mut cp, &data, 0);
    cp.look();
    fc0.job = Job::default();
    assert_eq!(fc0.call(&mut cp, b"new", 0), Step::Word(0));
    cp.look();
    assert_eq!(fc0.call(&mut cp, b"new", 0), Step::Block { from: 0, len: 3, word: 3 });
    cp.look();
    fc0.call(&mut cp, b"new", 0);
    cp.look();
    assert_eq!(cp.transmitted, [b"new".to_vec()]);
}

#[test]
fn lengths_that_are_none() {
    assert_eq!(telegram_bytes(0), Err(Refusal::Empty));
    assert_eq!(telegram_bytes(AREA), Err(Refusal::Empty));
    assert_eq!(telegram_bytes(1024), Ok(1024));
    assert_eq!(telegram_bytes(AREA | 5), Ok(5));
    for anz in [1025, 0x2001, 0x8005, u16::MAX] {
        assert_eq!(telegram_bytes(anz), Err(Refusal::TooLong), "{anz:04X}h");
    }
}
