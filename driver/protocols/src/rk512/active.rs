//! The active role: send the telegrams of an own order one by one, wait for the reaction to each.

use super::codec::{self, Area, PIECE};
use super::event::{BadReaction, Event, OrderError, code};
use super::{Command, Owner, Request, Rk512};
use crate::machine::{Instant, SendError};

/// An own order that is running.
#[derive(Clone, Copy, Debug)]
pub(super) struct Own {
    request: Request,
    /// Bytes of data transferred: acknowledged by the partner, or received.
    at: usize,
    /// The current telegram is a follow-on telegram.
    follow: bool,
    stage: Stage,
    /// How often it has been sent because BWZ ran out.
    repetitions: u16,
    /// Reaction monitoring; begins with each acknowledgement of the current telegram.
    until: Option<Instant>,
}

/// Progress of the current telegram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// It waits for the line.
    ToSend,
    /// The procedure below has it.
    OnLine,
    /// The partner has it; `bwz`: STX of the reaction must come before.
    Awaiting { bwz: Option<Instant> },
}

/// An order has ended without its reaction, which may still come. A reaction does not tell which order it belongs to,
/// so the next order waits a while for it. The order after that waits too, because the reaction that ended the second
/// order may have been the late one to the first. (ours)
#[derive(Clone, Copy, Debug)]
pub(super) struct Late {
    /// No order begins before this time; `None`: the wait is over.
    until: Option<Instant>,
    /// The order after the one without reaction has ended, too.
    last: bool,
}

impl Own {
    pub(super) fn is_to_send(&self) -> bool {
        self.stage == Stage::ToSend
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        match self.stage {
            Stage::Awaiting { bwz } => bwz.into_iter().chain(self.until).min(),
            Stage::ToSend | Stage::OnLine => None,
        }
    }

    /// Bytes of data of the current telegram.
    fn piece(&self) -> usize {
        match self.request.command {
            Command::Send => (self.request.bytes() - self.at).min(PIECE),
            Command::Fetch => 0,
        }
    }
}

impl<const N: usize> Rk512<N> {
    /// An order of the CPU.
    pub(super) fn start(&mut self, request: Request, data: &[u8], out: &mut dyn Owner) {
        let bytes = request.bytes();
        let expected = if request.command == Command::Send { bytes } else { 0 };
        let refused = if self.own.is_some() {
            OrderError::Busy
        } else if bytes > self.config.data_max || bytes > N {
            OrderError::TooLong
        } else if bytes == 0 || data.len() != expected {
            OrderError::Invalid
        } else {
            self.own_data[..data.len()].copy_from_slice(data);
            let stage = Stage::ToSend;
            self.own = Some(Own { request, at: 0, follow: false, stage, repetitions: 0, until: None });
            return;
        };
        out.ended(Err(refused));
    }

    /// Composes the current telegram and marks it as being on the line. [S0 "Structure of the output message"], [S0
    /// "Structure of the input message"], [S0 "Structure of additional messages"]
    pub(super) fn compose_order(&mut self, telegram: &mut [u8]) -> usize {
        let Some(own) = &mut self.own else { return 0 };
        if self.late.is_some_and(|late| late.last) {
            self.late = None;
        }
        own.stage = Stage::OnLine;
        let head = if own.follow { codec::SHORT } else { codec::HEADER };
        if own.follow {
            telegram[..head].copy_from_slice(&own.request.follow_header());
        } else {
            telegram[..head].copy_from_slice(&own.request.header());
        }
        let piece = own.piece();
        telegram[head..head + piece].copy_from_slice(&self.own_data[own.at..own.at + piece]);
        head + piece
    }

    /// The procedure below has finished our telegram: the monitoring times begin. [S0 L1678], [S0 L1635]
    pub(super) fn order_sent(&mut self, now: Instant, outcome: Result<(), SendError>, out: &mut dyn Owner) {
        let Some(own) = &mut self.own else { return };
        match outcome {
            Ok(()) => {
                own.stage = Stage::Awaiting { bwz: None };
                own.until = Some(now + self.config.reaction);
            }
            Err(error) => self.end_own(now, Err(OrderError::Line(error)), out),
        }
    }

    /// BWZ runs while the line is free: it ends with STX of the reaction. An order of the partner, or an invalid
    /// telegram, restarts it.
    pub(super) fn watch_bwz(&mut self, now: Instant) {
        let free = self.line.is_free();
        let time = self.config.line.bwz;
        if let Some(Own { stage: Stage::Awaiting { bwz }, .. }) = &mut self.own {
            if !free || time.is_zero() {
                *bwz = None;
            } else {
                bwz.get_or_insert(now + time);
            }
        }
    }

    /// Whether the next order waits for the late reaction to a previous one.
    pub(super) fn waits_for_late(&self) -> bool {
        self.late.is_some_and(|late| late.until.is_some())
    }

    /// When that wait ends, if an order waits.
    pub(super) fn late_deadline(&self) -> Option<Instant> {
        self.own.as_ref().filter(|own| own.is_to_send()).and(self.late?.until)
    }

    pub(super) fn own_times(&mut self, now: Instant, out: &mut dyn Owner) {
        if let Some(late) = self.late.as_mut().filter(|late| late.until.is_some_and(|until| now >= until)) {
            late.until = None;
        }
        let Some(own) = &mut self.own else { return };
        let Stage::Awaiting { bwz } = own.stage else { return };
        if own.until.is_some_and(|until| now >= until) {
            // [S0 L1678]: "a maximum period of 5s during which a reaction must be received", each time the request has
            // been sent: else DBL could not do what [S0 L1635] says with the times of the parameter table. (decision
            // 20)
            self.end_own(now, Err(OrderError::NoReaction), out);
        } else if bwz.is_some_and(|bwz| now >= bwz) {
            // [S0 L1635]: beyond BWZ the telegram is sent again; DBL counts the attempts, as for a block. (decision
            // 20)
            own.repetitions += 1;
            if own.repetitions < self.config.line.block_attempts {
                own.stage = Stage::ToSend;
                out.report(Event::Repetition(own.repetitions));
            } else {
                self.end_own(now, Err(OrderError::BwzExceeded), out);
            }
        }
    }

    /// Whether a reaction that comes now belongs to our telegram.
    pub(super) fn awaits_reaction(&self) -> bool {
        match self.own.as_ref().map(|own| own.stage) {
            Some(Stage::Awaiting { .. }) => true,
            // Its acknowledgement was lost or damaged: the reaction shows that it has arrived.
            Some(Stage::OnLine) if self.line.block_is_out() => true,
            // It is to be sent once more, because BWZ ran out.
            Some(Stage::OnLine | Stage::ToSend) => self.own.as_ref().is_some_and(|own| own.until.is_some()),
            None => false,
        }
    }

    /// A reaction has come.
    pub(super) fn reaction(&mut self, now: Instant, follow: bool, number: u8, data: &[u8], out: &mut dyn Owner) {
        if !self.awaits_reaction() {
            // Without an order, or before our telegram can have arrived: it belongs to something earlier.
            // (docs/cp341-events.md)
            self.late = None;
            return out.report(Event::BadReaction(BadReaction::Sequence));
        }
        let Some(own) = &mut self.own else { return };
        if follow != own.follow {
            return self.bad_reaction(now, BadReaction::Sequence, out);
        }
        // Data come "only if byte 4 = 00h" [TIA help "Configuration for point-to-point links"]: this may be the
        // partner's own order, which a line fault turned into a reaction.
        let with_data = !data.is_empty();
        let bytes = own.request.bytes();
        let piece = match own.request.command {
            Command::Send if with_data => return self.bad_reaction(now, BadReaction::SendData, out),
            _ if number != 0 && with_data => return self.bad_reaction(now, BadReaction::Data, out),
            // [CP 341 manual 09/2008, p. 52 to 57]: the order ends, without data, without further telegrams.
            _ if number != 0 => {
                let is_block = matches!(own.request.area, Area::Db | Area::Dx);
                let error =
                    if number == code::RANGE && !is_block { OrderError::NoArea } else { OrderError::Rejected(number) };
                return self.end_own(now, Err(error), out);
            }
            Command::Send => own.piece(),
            // Less than 128 bytes is tolerated in a reaction [CP 341 manual 09/2008, p. 57]: the rest is fetched.
            Command::Fetch => match self.own_data[..bytes].get_mut(own.at..own.at + data.len()) {
                Some(place) if !data.is_empty() && data.len() <= PIECE => {
                    place.copy_from_slice(data);
                    data.len()
                }
                _ => return self.bad_reaction(now, BadReaction::Data, out),
            },
        };
        own.at += piece;
        if own.at == bytes {
            return self.end_own(now, Ok(()), out);
        }
        *own = Own { follow: true, stage: Stage::ToSend, repetitions: 0, until: None, ..*own };
        self.forget_own_telegram();
    }

    /// An invalid reaction ends the order it would belong to. (docs/cp341-events.md)
    pub(super) fn bad_reaction(&mut self, now: Instant, bad: BadReaction, out: &mut dyn Owner) {
        if self.awaits_reaction() {
            self.end_own(now, Err(OrderError::BadReaction(bad)), out);
        } else {
            self.late = None;
            out.report(Event::BadReaction(bad));
        }
    }

    fn end_own(&mut self, now: Instant, outcome: Result<(), OrderError>, out: &mut dyn Owner) {
        self.forget_own_telegram();
        let Some(own) = self.own.take() else { return };
        // An invalid reaction may not have been the one to this order.
        if matches!(outcome, Err(OrderError::NoReaction | OrderError::BwzExceeded | OrderError::BadReaction(_))) {
            self.expect_late(now, false);
        } else if self.late.is_some() {
            self.expect_late(now, true);
        }
        match outcome {
            Ok(()) if own.request.command == Command::Fetch => out.ended(Ok(&self.own_data[..own.request.bytes()])),
            Ok(()) => out.ended(Ok(&[])),
            Err(error) => {
                out.report(Event::Failed(error));
                out.ended(Err(error));
            }
        }
    }

    /// From now on a reaction may come that belongs to an order that has ended.
    pub(super) fn expect_late(&mut self, now: Instant, last: bool) {
        self.late = Some(Late { until: Some(now + self.config.late_wait), last });
    }

    /// Whether a reaction to an order of this machine may still come.
    pub fn is_owed_a_reaction(&self) -> bool {
        self.late.is_some() || self.own.as_ref().is_some_and(|own| own.stage != Stage::ToSend || own.until.is_some())
    }

    /// The machine before this one, in a process that has died or before a RESET, may be owed a reaction.
    pub fn succeeds(&mut self, now: Instant) {
        self.expect_late(now, false);
    }

    /// The telegram that the procedure below still wants to repeat has been answered.
    fn forget_own_telegram(&mut self) {
        if self.carries == super::Carries::Order {
            self.line.forget_order();
            self.carries = super::Carries::Nothing;
        }
    }
}
