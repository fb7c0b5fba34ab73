//! FC 1.

use super::fake_cp::FakeCp;
use crate::receive::Step;
use crate::reception::Job;
use crate::registers::OUTSIDE;

/// FC 1's call, with its data block and EMFR.
#[derive(Default)]
struct Caller {
    job: Job,
    db: Vec<u8>,
    emfr: bool,
    anz: u16,
}

impl Caller {
    fn call(&mut self, cp: &mut FakeCp) -> Step {
        let rx = cp.words().rx;
        let (job, step) = match self.job.empf_laeuft {
            true => self.job.go_on(rx, self.emfr),
            false if self.emfr => (self.job, Step::Wait),
            false => self.job.start(rx),
        };
        self.job = job;
        match step {
            Step::Wait => {}
            Step::Take { to, len, count } => {
                self.db.truncate(usize::from(to));
                self.db.extend_from_slice(&cp.input[4..4 + usize::from(len)]);
                cp.write(0, &count.to_be_bytes());
                if job.letzter_block {
                    (self.anz, self.emfr) = (job.anz_int, true);
                }
            }
            Step::Refuse => cp.write(0, &OUTSIDE.to_be_bytes()),
            Step::Finish => {
                cp.write(0, &[0, 0]);
                self.job = Job { fehler_empf: job.fehler_empf, ..Job::default() };
            }
            Step::Failed => {
                cp.write(0, &[0, 0]);
                self.job = Job { fehler_empf: true, ..Job::default() };
            }
        }
        step
    }
}

fn telegram(len: usize) -> Vec<u8> {
    (0..len).map(|i| i as u8 ^ 0xA5).collect()
}

#[test]
fn eighteen_bytes_are_18_6_0() {
    let (mut cp, mut fc1, data) = (FakeCp::working(), Caller::default(), telegram(18));
    assert_eq!(fc1.call(&mut cp), Step::Wait);
    cp.receive(&data);
    assert_eq!(fc1.call(&mut cp), Step::Take { to: 0, len: 12, count: 18 });
    assert_eq!(fc1.job, Job { geem: 12, anz_int: 18, empf_laeuft: true, ..Job::default() });
    assert_eq!(cp.output[..2], [0, 18]);
    assert_eq!(fc1.call(&mut cp), Step::Wait, "the CP has not looked yet");
    cp.look();
    assert_eq!(fc1.call(&mut cp), Step::Take { to: 12, len: 6, count: 6 });
    assert_eq!((fc1.emfr, fc1.anz, &fc1.db), (true, 18, &data));
    assert!(fc1.job.letzter_block && fc1.job.empf_laeuft);
    assert_eq!(fc1.call(&mut cp), Step::Wait, "6 is still offered");
    cp.look();
    assert_eq!(cp.words().rx, 0);
    assert_eq!(fc1.call(&mut cp), Step::Finish, "also before the program has reset EMFR");
    assert_eq!((fc1.job, &cp.output[..2]), (Job::default(), &[0, 0][..]));
    assert_eq!(cp.log, [18, 6]);
}

#[test]
fn every_length_arrives_whole() {
    for len in 1..=1024 {
        let (mut cp, mut fc1, data) = (FakeCp::working(), Caller::default(), telegram(len));
        cp.receive(&data);
        let mut calls = 0;
        while !fc1.emfr {
            fc1.call(&mut cp);
            cp.look();
            calls += 1;
            assert!(calls < 100, "{len} bytes hang: {:?}", fc1.job);
        }
        assert_eq!((usize::from(fc1.anz), &fc1.db), (len, &data));
        assert_eq!(fc1.call(&mut cp), Step::Finish);
    }
}

#[test]
fn the_next_telegram_waits_for_emfr() {
    let (mut cp, mut fc1) = (FakeCp::working(), Caller::default());
    cp.receive(b"one");
    fc1.call(&mut cp);
    cp.look();
    fc1.call(&mut cp);
    cp.receive(b"two");
    for _ in 0..3 {
        assert_eq!(fc1.call(&mut cp), Step::Wait);
        cp.look();
    }
    assert_eq!(fc1.db, b"one");
    fc1.emfr = false;
    assert_eq!(fc1.call(&mut cp), Step::Take { to: 0, len: 3, count: 3 });
    assert_eq!((fc1.db.as_slice(), fc1.emfr), (&b"two"[..], true));
}

#[test]
fn emfr_set_in_mid_job_keeps_the_block_back() {
    let job = Job { geem: 12, anz_int: 18, empf_laeuft: true, ..Job::default() };
    assert_eq!(job.go_on(6, true), (job, Step::Wait));
    assert_eq!(job.go_on(6, false).1, Step::Take { to: 12, len: 6, count: 6 });
}

#[test]
fn a_count_that_does_not_follow_fails_the_job() {
    let job = Job { geem: 12, anz_int: 40, empf_laeuft: true, ..Job::default() };
    for rx in [0, 29, 16, 41] {
        assert_eq!(job.go_on(rx, false).1, Step::Failed, "{rx} instead of 28");
    }
    assert_eq!(job.go_on(40, false).1, Step::Wait, "the count before");
    for nonsense in [0x8001, 0x2000, 1025, 0xFFFF] {
        assert_eq!(job.go_on(nonsense, false).1, Step::Wait, "{nonsense:04X}h is treated as absent");
        assert_eq!(Job::default().start(nonsense).1, Step::Wait);
    }
}

#[test]
fn a_telegram_that_is_stored_is_not_lost_by_what_follows() {
    let job = Job { geem: 18, anz_int: 18, empf_laeuft: true, letzter_block: true, ..Job::default() };
    assert_eq!(job.go_on(6, false).1, Step::Wait);
    for rx in [0, 18, 40] {
        assert_eq!(job.go_on(rx, false).1, Step::Finish);
    }
}

#[test]
fn counters_that_are_not_ours_fail_the_job() {
    for (geem, anz_int, letzter_block) in
        [(0, 0, false), (31, 30, false), (30, 30, false), (12, 30, true), (0, 1025, false)]
    {
        let job = Job { geem, anz_int, letzter_block, empf_laeuft: true, ..Job::default() };
        assert_eq!(job.go_on(6, false).1, Step::Failed, "{job:?}");
    }
}

/// A changed area of the Modbus slave "long": the bit is in every count and every echo.
#[test]
fn the_counts_of_a_changed_area() {
    let (job, step) = Job::default().start(0x4012);
    assert_eq!(step, Step::Take { to: 0, len: 12, count: 0x4012 });
    assert_eq!(job, Job { geem: 12, anz_int: 0x4012, empf_laeuft: true, ..Job::default() });
    assert_eq!(job.go_on(0x4012, false).1, Step::Wait, "the CP has not looked yet");
    assert_eq!(job.go_on(6, false).1, Step::Failed, "another kind of telegram");
    let (job, step) = job.go_on(0x4006, false);
    assert_eq!(step, Step::Take { to: 12, len: 6, count: 0x4006 });
    assert_eq!(job.go_on(0x4006, false).1, Step::Wait);
    assert_eq!(job.go_on(0, false).1, Step::Finish);
}

/// A refusal stays until the CP has seen it; the job ends with an error.
#[test]
fn a_refused_area_ends_with_an_error() {
    let job = Job { geem: 18, anz_int: 0x4012, empf_laeuft: true, letzter_block: true, fehler_empf: true };
    assert_eq!(job.go_on(0x4012, false).1, Step::Wait);
    assert_eq!(job.go_on(0, false).1, Step::Finish);
}
