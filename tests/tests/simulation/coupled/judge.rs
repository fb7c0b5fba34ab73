//! The rules that must hold with any faults. The ledgers of both programs are read after each cycle.
//!
//! - No telegram is received corrupted, twice, or out of order.
//! - After DONE of BSEND the partner's BRCV has the telegram; after DONE of PUT the telegram is in the partner's
//!   memory.
//! - What was given to the partner's program is never refused: after ERROR of BSEND its BRCV does not have the
//!   telegram, unless the connection is lost (1).
//! - GET returns what PUT has written.
//! - Every job ends: after ten seconds without an answer, or when the connection to a silent partner is closed.
//! - STATUS is one that docs/cp343.md defines for the fault.

use std::collections::BTreeMap;

use ob1_time::{Instant, Span};

use super::program::{Kind, STREAMS, bytes, receives, sends};
use super::station::Station;

/// Maximum time of a job on an S7 connection: ten seconds (docs/cp343.md), and additional time for earlier jobs in the
/// partner.
const JOB: Span = Span::from_secs(15);
/// Maximum time of a telegram: it is sent when the kernel has it; the connection to a silent partner is closed after a
/// minute.
const TELEGRAM: Span = Span::from_secs(75);

/// STATUS of URCV: older data were overwritten.
const OLDER: u16 = 9;

/// Permitted STATUS values with ERROR for each kind of stream: sending, receiving.
const fn permitted(kind: Kind) -> (&'static [u16], &'static [u16]) {
    match kind {
        // 1 the connection, 2 the partner has restarted in between, 3 it has no BRCV yet, 6 it was not ready.
        Kind::Block => (&[1, 2, 3, 6], &[1]),
        Kind::Message => (&[1], &[1, OLDER]),
        Kind::Variables => (&[1], &[1]),
        // 8304h: the connection is not established, 80C0h: the CP does not answer, or has restarted.
        Kind::Ag(_) => (&[0x8304, 0x80C0], &[0x80C0]),
    }
}

/// The last state of a ledger.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Seen {
    done: u32,
    failed: u32,
    good: u32,
    got: u32,
    not_got: u32,
    not_come: u32,
    /// Time of the end of the last job, or of the possible start of a job.
    ended: Instant,
}

/// The result.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Told {
    /// Complete telegrams received, by stream.
    pub(crate) telegrams: [u64; STREAMS.len()],
    /// Number of ERROR with this STATUS: by stream, sending or receiving.
    pub(crate) failed: BTreeMap<(&'static str, &'static str, u16), u64>,
    /// Those after every stream has received something, except because of older data (9).
    pub(crate) late: u64,
}

pub(crate) struct Judge {
    seed: u64,
    seen: [[Seen; STREAMS.len()]; 2],
    ran: [bool; 2],
    pub(crate) told: Told,
    /// Digest of all observations in their order.
    pub(crate) digest: u64,
}

impl Judge {
    pub(crate) fn new(seed: u64) -> Self {
        let told = Told::default();
        Self { seed, seen: Default::default(), ran: [false; 2], told, digest: 0xCBF2_9CE4_8422_2325 }
    }

    fn note(&mut self, values: &[u64]) {
        for value in values {
            self.digest = (self.digest ^ value).wrapping_mul(0x100_0000_01B3).rotate_left(23);
        }
    }

    fn fails(&mut self, at: &str, stream: usize, which: &'static str, allowed: &[u16], status: u16, count: u32) {
        assert!(allowed.contains(&status), "{at}: {which} has STATUS {status:04X}");
        let all_are_up = self.through().iter().flatten().all(|count| *count > 0);
        self.told.late += if all_are_up && status != OLDER { u64::from(count) } else { 0 };
        *self.told.failed.entry((STREAMS[stream].name, which, status)).or_default() += u64::from(count);
    }

    /// To be called after each cycle of station `me`.
    pub(crate) fn look(&mut self, now: Instant, me: usize, stations: &[Station; 2]) {
        let (own, partner) = (&stations[me], &stations[1 - me]);
        let runs = own.runs();
        let began = runs && !std::mem::replace(&mut self.ran[me], runs);
        for (stream, about) in STREAMS.iter().enumerate() {
            let at = format_args!("seed {}, {} us, station {me}, {}", self.seed, now.micros(), about.name).to_string();
            let (out, come) = permitted(about.kind);
            let (sender, receiver) = (sends(stream), receives(stream));
            let was = self.seen[me][stream];
            let cells = [8, 12, 24, 28, 32].map(|byte| own.cell(sender, byte));
            let [done, failed, got, wrong, not_got] = cells;
            let [good, torn, old, not_come] = [4, 8, 12, 16].map(|byte| own.cell(receiver, byte));
            assert_eq!((torn, old), (0, 0), "{at}: torn, out of turn");
            assert_eq!(wrong, 0, "{at}: GET does not bring what PUT has written");
            if done != was.done {
                self.is_done(&at, stream, own.cell(sender, 16), partner);
            }
            if failed != was.failed {
                let status = own.word(sender, 20);
                self.fails(&at, stream, "sending", out, status, failed - was.failed);
                let has = about.kind == Kind::Block && partner.cell(receiver, 0) == own.cell(sender, 0);
                assert!(status == 1 || !has, "{at}: STATUS {status:04X}, but the partner has it");
            }
            if not_got != was.not_got {
                self.fails(&at, stream, "GET", out, own.word(sender, 36), not_got - was.not_got);
            }
            if not_come != was.not_come {
                self.fails(&at, stream, "receiving", come, own.word(receiver, 20), not_come - was.not_come);
            }
            self.told.telegrams[stream] += u64::from(good - was.good + got - was.got);
            let mut new = Seen { done, failed, good, got, not_got, not_come, ended: was.ended };
            if began || !runs || (done, failed, got, not_got) != (was.done, was.failed, was.got, was.not_got) {
                new.ended = now;
            }
            let patience = if matches!(about.kind, Kind::Ag(_)) { TELEGRAM } else { JOB };
            assert!(now - new.ended < patience, "{at}: its job does not end");
            if new != was {
                let [done, failed, good, got] = [done, failed, good, got].map(u64::from);
                self.note(&[
                    now.nanos(),
                    me as u64,
                    stream as u64,
                    done,
                    failed,
                    good,
                    got,
                    not_got.into(),
                    not_come.into(),
                ]);
            }
            self.seen[me][stream] = new;
        }
    }

    /// Telegrams of ISO on TCP and TCP that AG_SEND has sent, and that the partner has not received although it has
    /// received later ones. Without faults there are none.
    pub(crate) fn left_out(&self, stations: &[Station; 2]) -> u64 {
        let reliable = STREAMS.iter().enumerate().filter(|(_, stream)| matches!(stream.kind, Kind::Ag(2 | 3)));
        let of = |(stream, _)| {
            let each = [0, 1].map(|me: usize| {
                let last = stations[1 - me].cell(receives(stream), 0);
                let good = stations[1 - me].cell(receives(stream), 4);
                u64::from((last - good).saturating_sub(stations[me].cell(sends(stream), 12)))
            });
            each.iter().sum::<u64>()
        };
        reliable.map(of).sum()
    }

    /// Checks DONE: if it means that the partner has the telegram, the partner must have it.
    fn is_done(&self, at: &str, stream: usize, number: u32, partner: &Station) {
        match STREAMS[stream].kind {
            Kind::Block => {
                let has = partner.cell(receives(stream), 0);
                assert_eq!(has, number, "{at}: DONE, but the partner has another one");
            }
            Kind::Variables => {
                for (word, value) in (0..bytes(stream, number) / 4).zip(number..) {
                    assert_eq!(partner.cell(99, 4 * word), value, "{at}: DONE, but the partner has other values");
                }
            }
            Kind::Message | Kind::Ag(_) => {}
        }
    }

    /// Number of telegrams received so far for each station's streams.
    pub(crate) fn through(&self) -> [[u32; STREAMS.len()]; 2] {
        self.seen.map(|seen| seen.map(|seen| seen.good + seen.got))
    }
}
