//! FC 11.

use super::fake_cp::FakeCp;
use crate::fragment::{Job, Step};

/// Calls FC 11 until a block comes; the program takes it at once.
fn block(cp: &mut FakeCp, job: &mut Job) -> Option<Vec<u8>> {
    for _ in 0..6 {
        let (next, step) = job.step(cp.words().rx, false);
        *job = next;
        let bytes = match step {
            Step::Take { len, count } => {
                cp.write(0, &count.to_be_bytes());
                Some(cp.input[4..4 + usize::from(len)].to_vec())
            }
            Step::Finish => {
                cp.write(0, &[0, 0]);
                *job = Job::default();
                None
            }
            Step::Failed => panic!("{job:?}"),
            Step::Wait => None,
        };
        if bytes.is_some() {
            return bytes;
        }
        cp.look();
    }
    None
}

/// [S0 "ASCII_FRAGMENT"]: in the protocol ASCII-fragmented each block is a telegram of its own.
#[test]
fn each_block_comes_at_once() {
    let (mut cp, mut job) = (FakeCp::working(), Job::default());
    for part in [b"a long teleg".as_slice(), b"ram, in bloc", b"ks"] {
        cp.receive(part);
        assert_eq!(block(&mut cp, &mut job).as_deref(), Some(part));
        assert!(job.letzter_block && job.empf_laeuft);
        assert_eq!(block(&mut cp, &mut job), None, "nothing more for now");
        assert_eq!(job, Job::default());
    }
    assert_eq!(cp.log, [12, 12, 2]);
}

/// With another protocol it cuts whole telegrams: counts 30, 18, 6.
#[test]
fn a_whole_telegram_comes_in_blocks() {
    let (mut cp, mut job) = (FakeCp::working(), Job::default());
    let telegram: Vec<u8> = (0..30).collect();
    cp.receive(&telegram);
    let mut got = Vec::new();
    for (geem, count) in [(12, 30), (24, 18), (30, 6)] {
        got.extend(block(&mut cp, &mut job).expect("a block"));
        assert_eq!((job.geem, job.anz_int, job.letzter_block), (geem, count, count == 6));
    }
    assert_eq!(got, telegram);
    assert_eq!(block(&mut cp, &mut job), None);
    assert_eq!((cp.log, job), (vec![30, 18, 6], Job::default()));
}

/// [S0 "ASCII_FRAGMENT"]: the program has to set EMFR back, otherwise nothing further is taken over.
#[test]
fn emfr_keeps_the_next_block_back() {
    let (first, step) = Job::default().step(30, false);
    assert_eq!(step, Step::Take { len: 12, count: 30 });
    assert_eq!(Job::default().step(30, true).1, Step::Wait);
    assert_eq!(first.step(18, true), (first, Step::Wait));
    assert_eq!(first.step(18, false).1, Step::Take { len: 12, count: 18 });
    // The end of the handshake is not kept back: the program's buffer is not touched by it.
    let (last, _) = Job::default().step(5, false);
    assert_eq!(last.step(0, true).1, Step::Finish);
}

#[test]
fn a_count_that_does_not_follow_fails_the_job() {
    let (first, _) = Job::default().step(30, false);
    assert_eq!(first.step(30, false).1, Step::Wait, "the CP has not looked yet");
    for rx in [0, 6, 17, 19, 31, 1024] {
        assert_eq!(first.step(rx, false).1, Step::Failed, "{rx}");
    }
    for nonsense in [0x2005, 0x8001, 0xFFFF, 1025] {
        assert_eq!(first.step(nonsense, false), (first, Step::Wait), "{nonsense:04X}h is absent");
        assert_eq!(Job::default().step(nonsense, false).1, Step::Wait);
    }
    let strange = Job { anz_int: 7, empf_laeuft: true, ..Job::default() };
    assert_eq!(strange.step(12, false).1, Step::Failed, "counters that are not ours");
}
