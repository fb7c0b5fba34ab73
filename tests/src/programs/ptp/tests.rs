//! Each rule of the judge is broken on purpose and seen; beside it stands the sequence that the manual allows.

use ob1_time::{Instant, Span};

use super::numbers::{self, Number};
use super::post::{Inbox, Outbox};
use super::receiver::{self, ReceiveCall, Receiver};
use super::rule::Rule;
use super::sender::{self, End, Portions, SendCall, Sender};
use super::{judge::PtpJudge, judge::Setup, modbus, numbers::Protocol};
use crate::programs::judge::Verdict;

const SEND: sender::Manual = sender::Manual {
    block: "FB 8",
    busy: 0,
    portions: Portions::Of32,
    reset: Some(0x1E0D),
    blocks: true,
    answers: (4, Span::ZERO),
    number: numbers::send_3964,
    bound: Span::from_secs(2),
};

const COM: sender::Manual = sender::Manual {
    block: "FB 60",
    busy: 0x8181,
    portions: Portions::Io(16),
    reset: None,
    blocks: false,
    number: numbers::send_040,
    ..SEND
};

const TAKE: receiver::Manual = receiver::Manual {
    block: "FB 7",
    busy: 0,
    portion: 32,
    aborted: Some(0x1E0D),
    blocks: true,
    answers: (4, Span::ZERO),
    number: numbers::receive_plain,
};

fn at(calls: u64) -> Instant {
    Instant::START + Span::from_millis(10 * calls)
}

/// Letters are calls of a sending block: q REQ, r R, D DONE, E ERROR with 0703h, L with 070Ah, P with 1E41h, A with
/// 1E0Dh, X with 1234h, S STATUS without ERROR, 8 STATUS 8181h; `.` nothing. Calls are separated by blanks.
fn sends(manual: sender::Manual, calls: &str) -> Verdict {
    let (mut sender, mut verdict) = (Sender::new(manual), Verdict::default());
    send_calls(&mut sender, calls, &mut verdict);
    verdict
}

fn send_calls(sender: &mut Sender, calls: &str, verdict: &mut Verdict) {
    for (number, text) in (0..).zip(calls.split(' ')) {
        let has = |letter| text.contains(letter);
        let errors = [('E', 0x0703), ('L', 0x070A), ('P', 0x1E41), ('A', 0x1E0D), ('X', 0x1234)];
        let status = errors.into_iter().chain([('S', 0x0703), ('8', 0x8181)]).find(|(letter, _)| has(*letter));
        let call = SendCall {
            at: at(number),
            req: has('q'),
            reset: has('r'),
            len: if has('l') { 100 } else { 10 },
            done: has('D'),
            error: has('N') || errors.into_iter().any(|(letter, _)| has(letter)),
            status: status.map_or(0, |(_, status)| status),
            legal: true,
        };
        sender.call(&call, verdict);
    }
}

fn receives(calls: &str) -> Verdict {
    let (mut receiver, mut verdict) = (Receiver::new(TAKE), Verdict::default());
    for (number, text) in (0..).zip(calls.split(' ')) {
        let has = |letter| text.contains(letter);
        let status = [('E', 0x0806), ('A', 0x1E0D), ('X', 0x1234), ('S', 0x0806)];
        let call = ReceiveCall {
            at: at(number),
            enable: has('e'),
            reset: has('r'),
            ndr: has('D'),
            error: ['E', 'A', 'X', 'N'].into_iter().any(has),
            status: status.into_iter().find(|(letter, _)| has(*letter)).map_or(0, |(_, status)| status),
            len: if has('0') { 0 } else { 100 },
        };
        receiver.call(&call, &mut verdict);
    }
    verdict
}

#[track_caller]
fn holds(verdict: &Verdict) {
    assert!(verdict.findings.is_empty(), "{:?}", verdict.findings);
}

#[track_caller]
fn breaks(verdict: &Verdict, rule: Rule) {
    assert!(verdict.has(rule.name()), "{rule:?} was not seen, but {:?}", verdict.findings);
}

#[test]
fn what_the_manual_allows_a_sending_block() {
    holds(&sends(SEND, ". q q qD . . q . D"));
    // REQ may go at once; another edge while the job runs does nothing.
    holds(&sends(SEND, "q . q . D . . ."));
    // R in a job and without one; edges while R is on do nothing, and none is remembered.
    holds(&sends(SEND, "q . rA r r . q . D"));
    holds(&sends(SEND, ". r rD r rq r q q q"));
    // FB 60 shows that the job runs, and answers R with DONE.
    holds(&sends(COM, "q8 8 8 D . q8 8 rD . rD ."));
    // An edge in the call that ends a job may start none: then DONE is that of the reset, the next one of the request.
    holds(&sends(COM, "q8 8 8 Dq r8 rq8 rD 8 8 D ."));
    // The same, and the edge of the next request is in the call of the reset.
    holds(&sends(COM, "q8 8 8 Dq 8 rq8 r8 rD 8 8 D ."));
    breaks(&sends(COM, "q8 8 8 Dq 8 rq8 r8 rD 8 8 D D"), Rule::EndOfAJob);
    // An edge while R is on may be that of a job which waits for the reset.
    holds(&sends(COM, "q8 8 r8 rq8 rD 8 8 D ."));
    holds(&sends(COM, "q8 8 r8 rq8 rD . . q8 8 8 D"));
    breaks(&sends(COM, "q8 8 r8 rq8 rD 8 8 D D"), Rule::EndOfAJob);
}

/// At a CP 040 that has just started an error may end a job alone, or with the reset that waited beside it. What STATUS
/// shows in the next call tells which.
#[test]
fn one_error_for_a_job_and_a_reset() {
    let starts = |calls: &str| {
        let (mut sender, mut verdict) = (Sender::new(COM), Verdict::default());
        sender.disturbed(at(1000));
        send_calls(&mut sender, calls, &mut verdict);
        verdict
    };
    // DONE of the reset is not that of a job.
    for right in ["rq8 r8 rL r8 rqD rq8 q8 q8 qD", "r8 rqL rq8 rD", "r8 r8 rL . q8 8 8 D", "rq8 r8 rL . q8 8 8 D"] {
        holds(&starts(right));
    }
    for wrong in ["rq8 r8 rL . D", "rq8 r8 rL r8 D D", "r8 r8 rL r8 D"] {
        breaks(&starts(wrong), Rule::EndOfAJob);
    }
    // What waits in the instance data goes on after a start-up of the CPU.
    let restarts = |calls: &str| {
        let (mut sender, mut verdict) = (Sender::new(COM), Verdict::default());
        send_calls(&mut sender, "r8 rq8", &mut verdict);
        sender.restarted(at(1000));
        send_calls(&mut sender, calls, &mut verdict);
        verdict
    };
    holds(&restarts("8 L 8 D ."));
    breaks(&restarts("8 L . D"), Rule::EndOfAJob);
    // The next call begins a job, so its STATUS tells nothing: DONE is that of the job, or first that of the reset.
    for calls in ["rq8 r8 rL q8 8 8 D .", "rq8 r8 rL q8 8 8 D 8 D ."] {
        holds(&starts(calls));
    }
    breaks(&starts("rq8 r8 rL q8 8 8 D D D"), Rule::EndOfAJob);
}

#[test]
fn the_outputs_of_a_sending_block() {
    breaks(&sends(SEND, "q . . DE"), Rule::EndIsOne);
    breaks(&sends(SEND, "q . S D"), Rule::StatusWithError);
    breaks(&sends(SEND, "q . . N"), Rule::StatusWithError);
    breaks(&sends(COM, "q8 8 8N8"), Rule::StatusWithError);
    breaks(&sends(SEND, "q . . X"), Rule::KnownStatus);
    breaks(&sends(SEND, ". . D"), Rule::EndOfAJob);
    breaks(&sends(SEND, "q . D D"), Rule::EndOfAJob);
    breaks(&sends(SEND, "q . . D E"), Rule::EndOfAJob);
    breaks(&sends(SEND, "q D"), Rule::Portions);
    breaks(&sends(SEND, "ql . . . D"), Rule::Portions);
    holds(&sends(SEND, "ql . . . . D"));
    breaks(&sends(SEND, "q . . E"), Rule::ErrorHasCause);
    breaks(&sends(SEND, "qP . ."), Rule::ErrorHasCause);
}

#[test]
fn r_at_a_sending_block() {
    breaks(&sends(SEND, "q . r r r r r r"), Rule::ResetIsAnswered);
    breaks(&sends(SEND, "q . rE"), Rule::ResetIsAnswered);
    breaks(&sends(SEND, ". r r r r r r"), Rule::ResetIsAnswered);
    breaks(&sends(SEND, ". rD rq r r rD"), Rule::ResetBlocks);
    breaks(&sends(COM, "q8 8 r r r r r"), Rule::ResetIsAnswered);
}

#[test]
fn a_job_without_an_end() {
    let calls = ["q"].into_iter().chain(["."; 400]).collect::<Vec<_>>().join(" ");
    breaks(&sends(SEND, &calls), Rule::JobEnds);
    let calls = ["q"].into_iter().chain(["."; 150]).collect::<Vec<_>>().join(" ");
    holds(&sends(SEND, &calls));
}

#[test]
fn a_cause_is_an_excuse_and_delays_the_bound() {
    let (mut sender, mut verdict) = (Sender::new(SEND), Verdict::default());
    let call = |n: u64| SendCall {
        at: at(n),
        req: n == 1,
        reset: false,
        len: 10,
        done: false,
        error: false,
        status: 0,
        legal: true,
    };
    (0..200).for_each(|n| _ = sender.call(&call(n), &mut verdict));
    sender.disturbed(at(250));
    (200..430).for_each(|n| _ = sender.call(&call(n), &mut verdict));
    holds(&verdict);
    let end = sender.call(&SendCall { error: true, status: 0x0703, ..call(430) }, &mut verdict).ended;
    assert_eq!(end, Some(End::Error(0x0703)));
    holds(&verdict);
    // A start-up ends what runs; whether REQ has risen since then cannot be known.
    sender.restarted(at(440));
    let turn = sender.call(&SendCall { req: true, ..call(450) }, &mut verdict);
    assert!(turn.began && sender.is_busy());
}

#[test]
fn what_the_manual_allows_a_receiving_block() {
    holds(&receives("e e e e eD e e e e eD"));
    holds(&receives("e e r0 r0D r . e e e e eD"));
    holds(&receives("e e rA r . e"));
    holds(&receives("e e . A . e"));
}

/// The error of a fault comes with its telegram, behind those before it: however late, but once.
#[test]
fn a_fault_of_the_line_is_reported_once() {
    let (mut receiver, mut verdict) = (Receiver::new(TAKE), Verdict::default());
    let fails = |number, status| ReceiveCall {
        at: at(number),
        enable: true,
        reset: false,
        ndr: false,
        error: true,
        status,
        len: 0,
    };
    receiver.fault();
    receiver.call(&fails(900, 0x080C), &mut verdict);
    holds(&verdict);
    receiver.fault();
    receiver.call(&fails(901, 0x0806), &mut verdict);
    breaks(&verdict, Rule::ErrorHasCause);
    let mut verdict = Verdict::default();
    receiver.call(&fails(902, 0x080D), &mut verdict);
    holds(&verdict);
    receiver.call(&fails(903, 0x080D), &mut verdict);
    breaks(&verdict, Rule::ErrorHasCause);
}

/// What the partner has given up is reported four seconds later: it has a cause if the fault had one.
#[test]
fn a_block_that_was_given_up_is_reported_late() {
    for (given_up, excused) in [(900, true), (1100, false)] {
        let (mut receiver, mut verdict) = (Receiver::new(TAKE), Verdict::default());
        receiver.disturbed(at(1000));
        receiver.given_up(at(given_up), at(1500));
        let call = |at, error| ReceiveCall {
            at,
            enable: true,
            reset: false,
            ndr: false,
            error,
            status: if error { 0x080C } else { 0 },
            len: 0,
        };
        receiver.call(&call(at(1400), true), &mut verdict);
        assert_eq!(verdict.has(Rule::ErrorHasCause.name()), !excused);
        receiver.call(&call(at(1500), true), &mut verdict);
        breaks(&verdict, Rule::ErrorHasCause);
    }
}

#[test]
fn the_outputs_of_a_receiving_block() {
    breaks(&receives("e e e e eDE"), Rule::EndIsOne);
    breaks(&receives("e e eS"), Rule::StatusWithError);
    breaks(&receives("e eN"), Rule::StatusWithError);
    breaks(&receives("e eX"), Rule::KnownStatus);
    breaks(&receives("e e e D"), Rule::EnableBlocks);
    breaks(&receives("e e e r0D er er erD"), Rule::ResetBlocks);
    breaks(&receives("e eD"), Rule::Portions);
    breaks(&receives("e e eE"), Rule::ErrorHasCause);
    breaks(&receives("e r r r r r r"), Rule::ResetIsAnswered);
    breaks(&receives("e rE"), Rule::ResetIsAnswered);
}

fn outbox(run: impl FnOnce(&mut Outbox, &mut Verdict)) -> Verdict {
    let (mut outbox, mut verdict) = (Outbox::default(), Verdict::default());
    run(&mut outbox, &mut verdict);
    outbox.settle(at(1000), false, &mut verdict);
    verdict
}

/// STX lost on a line with faults, and nobody acknowledges: DONE is right, and the partner has got nothing.
#[test]
fn a_line_that_loses_characters() {
    for loses in [true, false] {
        let (mut outbox, mut verdict) = (Outbox::default(), Verdict::default());
        let job = outbox.began(at(1), "FB 65", Some(b"ab".to_vec()));
        outbox.ended(at(3), job, End::Done, None, &mut verdict);
        outbox.settle(at(1000), loses, &mut verdict);
        assert_eq!(verdict.has(Rule::DoneArrived.name()), !loses);
    }
}

#[test]
fn what_is_true_of_jobs() {
    let telegram = || Some(b"ab".to_vec());
    holds(&outbox(|outbox, verdict| {
        let job = outbox.began(at(1), "FB 8", telegram());
        outbox.arrived(at(2), b"ab", true, false, verdict);
        outbox.ended(at(3), job, End::Done, None, verdict);
    }));
    // Silence ends it at the partner after DONE.
    holds(&outbox(|outbox, verdict| {
        let job = outbox.began(at(1), "FB 8", telegram());
        outbox.ended(at(3), job, End::Done, None, verdict);
        outbox.arrived(at(3), b"ab", true, false, verdict);
    }));
    // The answer was lost: the block comes again.
    holds(&outbox(|outbox, verdict| {
        let job = outbox.began(at(1), "FB 8", telegram());
        outbox.arrived(at(2), b"ab", false, false, verdict);
        outbox.arrived(at(3), b"ab", true, false, verdict);
        outbox.ended(at(4), job, End::Done, None, verdict);
    }));
    let false_done = outbox(|outbox, verdict| {
        let job = outbox.began(at(1), "FB 8", telegram());
        outbox.ended(at(3), job, End::Done, None, verdict);
    });
    breaks(&false_done, Rule::DoneArrived);
    let too_early = outbox(|outbox, verdict| {
        let job = outbox.began(at(1), "FB 8", telegram());
        outbox.ended(at(3), job, End::Done, None, verdict);
        outbox.arrived(at(5), b"ab", true, false, verdict);
    });
    breaks(&too_early, Rule::DoneArrived);
    // Two instances, one request on the line, DONE at both.
    let both = outbox(|outbox, verdict| {
        let (one, two) = (outbox.began(at(1), "FB 8", telegram()), outbox.began(at(1), "FB 8", Some(b"cd".to_vec())));
        outbox.arrived(at(2), b"ab", true, false, verdict);
        outbox.ended(at(3), one, End::Done, None, verdict);
        outbox.ended(at(3), two, End::Done, None, verdict);
    });
    breaks(&both, Rule::DoneArrived);
    // Two instances send the same bytes: the first DONE is that of either, and each needs its own arrival.
    for times in [1, 2] {
        let verdict = outbox(|outbox, verdict| {
            let jobs = [outbox.began(at(1), "FB 60", telegram()), outbox.began(at(1), "FB 60", telegram())];
            for (job, n) in jobs.into_iter().zip(0..) {
                if n < times {
                    outbox.arrived(at(2 + 2 * n), b"ab", true, false, verdict);
                }
                outbox.ended(at(3 + 2 * n), job, End::Done, None, verdict);
            }
        });
        assert_eq!(verdict.has(Rule::DoneArrived.name()), times == 1);
    }
    for twice in [&b"ab"[..], b"xy"] {
        let verdict = outbox(|outbox, verdict| {
            outbox.began(at(1), "FB 8", telegram());
            outbox.arrived(at(2), b"ab", true, false, verdict);
            outbox.arrived(at(3), twice, true, false, verdict);
        });
        breaks(&verdict, Rule::SentOnce);
    }
    for number in [Number::Refused, Number::Rejected] {
        let verdict = outbox(|outbox, verdict| {
            let job = outbox.began(at(1), "FB 8", telegram());
            outbox.arrived(at(2), b"ab", true, false, verdict);
            outbox.ended(at(3), job, End::Error(0x050E), Some(number), verdict);
        });
        breaks(&verdict, Rule::RefusedIsNotSent);
    }
    // The same bytes of a job that was broken off: they were on the line already.
    for other in [telegram(), Some(b"cd".to_vec())] {
        let verdict = outbox(|outbox, verdict| {
            let job = outbox.began(at(1), "FB 8", other.clone());
            outbox.ended(at(2), job, End::Error(0x0501), Some(Number::Open), verdict);
            let job = outbox.began(at(2), "FB 8", telegram());
            outbox.arrived(at(3), b"ab", true, false, verdict);
            outbox.ended(at(4), job, End::Error(0x0522), Some(Number::Refused), verdict);
        });
        assert_eq!(verdict.has(Rule::RefusedIsNotSent.name()), other != telegram());
    }
    // The same bytes of a job that still runs.
    for other in [telegram(), Some(b"cd".to_vec())] {
        let verdict = outbox(|outbox, verdict| {
            let runs = outbox.began(at(1), "FB 8", other.clone());
            let refused = outbox.began(at(2), "FB 8", telegram());
            outbox.arrived(at(3), b"ab", true, false, verdict);
            outbox.ended(at(4), refused, End::Error(0x0522), Some(Number::Refused), verdict);
            outbox.ended(at(5), runs, End::Done, None, verdict);
        });
        for rule in [Rule::RefusedIsNotSent, Rule::DoneArrived] {
            assert_eq!(verdict.has(rule.name()), other != telegram(), "{}", rule.name());
        }
    }
    let later = outbox(|outbox, verdict| {
        let job = outbox.began(at(1), "FB 8", telegram());
        outbox.ended(at(3), job, End::Error(0x050E), Some(Number::Refused), verdict);
        outbox.arrived(at(4), b"ab", true, false, verdict);
    });
    breaks(&later, Rule::RefusedIsNotSent);
}

fn inbox(run: impl FnOnce(&mut Inbox, &mut Verdict)) -> Verdict {
    let (mut inbox, mut verdict) = (Inbox::new(1024), Verdict::default());
    run(&mut inbox, &mut verdict);
    inbox.finish("FB 7", at(1000), Span::from_secs(1), &mut verdict);
    verdict
}

#[test]
fn what_is_true_of_receptions() {
    holds(&inbox(|inbox, verdict| {
        inbox.said(at(1), b"ab", true, false);
        inbox.said(at(2), b"cd", true, false);
        inbox.taken(at(3), "FB 7", b"ab", false, verdict);
        inbox.taken(at(4), "FB 7", b"cd", false, verdict);
    }));
    let changed = inbox(|inbox, verdict| {
        inbox.said(at(1), b"ab", false, false);
        inbox.taken(at(3), "FB 7", b"a", false, verdict);
    });
    breaks(&changed, Rule::NdrWhole);
    // A kill or a reset has cut off its beginning; its end comes whole.
    for (broken, taken, holds) in [(true, &b"b"[..], true), (true, b"a", false), (false, b"b", false)] {
        let verdict = inbox(|inbox, verdict| {
            inbox.said(at(1), b"ab", false, broken);
            inbox.taken(at(3), "FB 7", taken, false, verdict);
        });
        assert_eq!(verdict.has(Rule::NdrWhole.name()), !holds, "{broken} {taken:?}");
    }
    let twice = inbox(|inbox, verdict| {
        inbox.said(at(1), b"ab", true, false);
        inbox.taken(at(3), "FB 7", b"ab", false, verdict);
        inbox.taken(at(4), "FB 7", b"ab", false, verdict);
    });
    breaks(&twice, Rule::TakenOnce);
    let order = inbox(|inbox, verdict| {
        inbox.said(at(1), b"ab", true, false);
        inbox.said(at(2), b"cd", true, false);
        inbox.taken(at(3), "FB 7", b"cd", false, verdict);
        inbox.taken(at(4), "FB 7", b"ab", false, verdict);
    });
    breaks(&order, Rule::InOrder);
    breaks(&inbox(|inbox, _| inbox.said(at(1), b"ab", true, false)), Rule::Delivered);
    // The buffer has room for the second, or it has not.
    for (len, fits) in [(512, true), (513, false)] {
        let verdict = inbox(|inbox, verdict| {
            inbox.said(at(1), &vec![7; len], true, false);
            inbox.said(at(2), &[8; 512], true, false);
            inbox.taken(at(3), "FB 7", &vec![7; len], false, verdict);
        });
        assert_eq!(verdict.has(Rule::Delivered.name()), fits, "{len}");
    }
    // The one before it took until then, or not so long; or one behind it has overtaken it.
    let second = |taken: u64, first: &'static [u8]| {
        inbox(|inbox, verdict| {
            inbox.said(at(1), b"ab", first == b"cd", false);
            inbox.said(at(2), b"cd", first == b"ab", false);
            inbox.taken(at(taken), "FB 7", first, false, verdict);
        })
    };
    holds(&second(950, b"ab"));
    breaks(&second(850, b"ab"), Rule::Delivered);
    breaks(&second(950, b"cd"), Rule::Delivered);
}

#[test]
fn the_telegram_of_a_source_area() {
    let request = |source: &[u8]| modbus::request(source).map(|expected| (expected.bytes, expected.reads));
    assert_eq!(request(&[5, 3, 0, 0x40, 0, 2, 9, 9]), Some((vec![5, 3, 0, 0x40, 0, 2], true)));
    assert_eq!(request(&[5, 16, 0, 1, 0, 1, 7, 8, 9]), Some((vec![5, 16, 0, 1, 0, 1, 2, 7, 8], false)));
    assert_eq!(request(&[0, 6, 0, 1, 7, 8]), Some((vec![0, 6, 0, 1, 7, 8], false)));
    for refused in [&[0, 3, 0, 1, 0, 1][..], &[5, 3, 0, 1, 0, 0], &[5, 5, 0, 1, 0, 1], &[5, 9, 0, 0, 0, 1], &[5, 6, 0]]
    {
        assert_eq!(request(refused), None, "{refused:?}");
    }
}

/// A setup without blocks can be judged: the rules with a partner are proved in `tests/tests/simulation`.
#[test]
fn a_rule_has_a_name_and_a_place() {
    let names: std::collections::BTreeSet<_> = Rule::ALL.iter().map(|rule| rule.name()).collect();
    assert_eq!(names.len(), Rule::ALL.len());
    assert!(Rule::ALL.iter().all(|rule| rule.place().contains('[')));
    let _ = |setup: Setup| PtpJudge::new(setup);
    assert_ne!(Protocol::Ascii, Protocol::StxEtx);
}
