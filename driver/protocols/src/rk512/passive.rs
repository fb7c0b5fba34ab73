//! The passive role: receive the partner's orders, pass them to the CPU, send the reactions.

use super::codec::{self, Area, PIECE};
use super::event::{AnswerError, Event, Refusal, code};
use super::{Answer, Carries, Command, Owner, Request, Rk512};
use crate::machine::{Instant, SendError};

/// An order of the partner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Partner {
    request: Request,
    /// Bytes of data received or sent so far.
    at: usize,
    /// Bytes of them in the last telegram.
    piece: usize,
    /// SEND: bytes in the first telegram.
    first: usize,
    /// Its last telegram was a follow-on telegram.
    follow: bool,
    /// The CPU was asked.
    asked: bool,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The CPU has it and must answer before `until`.
    Asked { until: Instant },
    /// The reaction to its last telegram is being sent.
    Replying,
    /// Its next telegram must come before `until`.
    Next { until: Instant },
}

impl Partner {
    pub(super) fn is_asked(&self) -> bool {
        matches!(self.stage, Stage::Asked { .. })
    }

    /// The CPU was asked and has not been told the end yet.
    pub(super) fn owes_an_end(&self) -> bool {
        self.asked
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        match self.stage {
            Stage::Asked { until } | Stage::Next { until } => Some(until),
            Stage::Replying => None,
        }
    }

    fn is_complete(&self) -> bool {
        self.at == self.request.bytes()
    }
}

/// A reaction that is still to be sent, or on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reply {
    follow: bool,
    code: u8,
    /// Its data in the partner's buffer.
    from: usize,
    len: usize,
}

impl<const N: usize> Rk512<N> {
    // ---- telegrams of the partner ----

    /// The first telegram of an order.
    pub(super) fn partner_order(&mut self, now: Instant, request: Request, data: &[u8], out: &mut dyn Owner) {
        if self.reply_has_left() {
            // It would not begin another before it has our reaction.
            self.reply_arrived(now, out);
        }
        if let Some(partner) = &self.partner {
            let last = &self.partner_data[..partner.piece.min(partner.at)];
            let same = !partner.follow
                && partner.request == request
                && (request.command == Command::Fetch || partner.at == partner.piece && data == last);
            // Our reaction is still to come, and it will answer this telegram too.
            if same && !matches!(partner.stage, Stage::Next { .. }) {
                return out.report(Event::Repeated);
            }
            // A new order before our reaction, or instead of a follow-on telegram. (060Eh)
            return self.refuse(false, Refusal::Sequence, out);
        }
        if let Err(refusal) = self.check(&request, data) {
            return self.refuse(false, refusal, out);
        }
        self.forget_reply();
        let stage = Stage::Replying;
        let mut partner = Partner { request, at: 0, piece: 0, first: 0, follow: false, asked: false, stage };
        match request.command {
            Command::Send => {
                self.partner_data[..data.len()].copy_from_slice(data);
                (partner.at, partner.piece, partner.first) = (data.len(), data.len(), data.len());
                self.partner = Some(partner);
                self.go_on_taking(now, out);
            }
            Command::Fetch => {
                self.partner = Some(partner);
                self.ask(now, out);
            }
        }
    }

    /// Checks a first telegram: its letters, its place, its length, its flag, its data, in this order.
    fn check(&self, request: &Request, data: &[u8]) -> Result<(), Refusal> {
        let bytes = request.bytes();
        if matches!(request.area, Area::Db | Area::Dx) && request.db == 0 {
            return Err(Refusal::DbNumber);
        }
        if bytes == 0 {
            return Err(Refusal::Length);
        }
        if bytes > self.config.data_max || bytes > N {
            return Err(Refusal::TooLong);
        }
        request.coordination.flag(self.config.flag_byte_max).map_err(|_| Refusal::Flag)?;
        if request.coordination.cpu().is_some_and(|cpu| cpu > self.config.cpu_max) {
            return Err(Refusal::Cpu);
        }
        if !self.serves {
            return Err(Refusal::Mode);
        }
        match request.command {
            // 060Bh: the data do not match the header.
            Command::Send if !codec::is_whole(data.len(), bytes, None) => Err(Refusal::SendLength),
            Command::Fetch if !data.is_empty() => Err(Refusal::FetchData),
            _ => Ok(()),
        }
    }

    /// A follow-on telegram. [S0 "Structure of additional messages"]
    pub(super) fn partner_follow(
        &mut self,
        now: Instant,
        command: Command,
        area: Area,
        data: &[u8],
        out: &mut dyn Owner,
    ) {
        let Some(partner) = self.partner else { return self.refuse(true, Refusal::Sequence, out) };
        // The same as the last one?
        let same = partner.follow
            && (command, area) == (partner.request.command, partner.request.area)
            && (command == Command::Fetch || data == &self.partner_data[partner.at - partner.piece..partner.at]);
        match partner.stage {
            // The CPU has not answered, or our reaction has not been sent: it can only be a repetition.
            Stage::Asked { .. } if same => return out.report(Event::Repeated),
            Stage::Replying if same && !self.reply_has_left() => return out.report(Event::Repeated),
            // It may be a repetition, or the next one with the same data.
            Stage::Replying if same && command == Command::Send => return self.refuse(true, Refusal::Sequence, out),
            // The partner continues, so it has our reaction.
            Stage::Replying if self.reply_has_left() => self.reply_arrived(now, out),
            _ => {}
        }
        let Some(partner) = &mut self.partner else { return self.refuse(true, Refusal::Sequence, out) };
        if !matches!(partner.stage, Stage::Next { .. }) {
            return self.refuse(true, Refusal::Sequence, out);
        }
        if command != partner.request.command {
            return self.refuse(true, Refusal::FollowCommand, out);
        }
        if area != partner.request.area {
            return self.refuse(true, Refusal::FollowArea, out);
        }
        partner.follow = true;
        match command {
            Command::Send => {
                let bytes = partner.request.bytes();
                let is_whole = codec::is_whole(data.len(), bytes - partner.at, Some(partner.first));
                match self.partner_data[..bytes].get_mut(partner.at..partner.at + data.len()) {
                    Some(place) if is_whole => place.copy_from_slice(data),
                    // 0611h: the data do not match the length announced.
                    _ => return self.refuse(true, Refusal::FollowLength, out),
                }
                partner.at += data.len();
                partner.piece = data.len();
                self.go_on_taking(now, out);
            }
            Command::Fetch if !data.is_empty() => self.refuse(true, Refusal::FetchData, out),
            Command::Fetch => self.reply_data(),
        }
    }

    /// A part of a SEND has been received.
    fn go_on_taking(&mut self, now: Instant, out: &mut dyn Owner) {
        let Some(partner) = &mut self.partner else { return };
        if partner.is_complete() {
            return self.ask(now, out);
        }
        partner.stage = Stage::Replying;
        self.reply = Some(Reply { follow: partner.follow, code: code::OK, from: 0, len: 0 });
    }

    // ---- the CPU ----

    fn ask(&mut self, now: Instant, out: &mut dyn Owner) {
        let until = now + self.config.answer_wait;
        let Some(partner) = &mut self.partner else { return };
        partner.stage = Stage::Asked { until };
        partner.asked = true;
        out.asked(&partner.request, &self.partner_data[..partner.at]);
    }

    /// The CPU has moved some of the data.
    pub(super) fn working(&mut self, now: Instant) {
        if let Some(Partner { stage: Stage::Asked { until }, .. }) = &mut self.partner {
            *until = now + self.config.answer_wait;
        }
    }

    /// The CPU answers. [CP 341 manual 09/2008, p. 52 to 57]: "after data is in the CPU".
    pub(super) fn answer(&mut self, answer: Answer<'_>, out: &mut dyn Owner) {
        let Some(partner) = self.partner.as_mut().filter(|partner| partner.is_asked()) else { return };
        let bytes = partner.request.bytes();
        let number = match (answer, partner.request.command) {
            (Answer::Taken, Command::Send) => code::OK,
            (Answer::Data(data), Command::Fetch) if data.len() == bytes => {
                self.partner_data[..bytes].copy_from_slice(data);
                return self.reply_data();
            }
            (Answer::Refused(number), _) if number != code::OK => number,
            // An answer that does not match the order.
            _ => code::NO_ACCESS,
        };
        partner.stage = Stage::Replying;
        self.reply = Some(Reply { follow: partner.follow, code: number, from: 0, len: 0 });
        if number != code::OK {
            out.report(Event::RefusedByCpu(number));
        }
    }

    /// The CPU does not answer: STOP, or too late.
    pub(super) fn refuse_asked(&mut self, out: &mut dyn Owner) {
        let follow = self.partner.as_ref().is_some_and(|partner| partner.follow);
        self.refuse(follow, Refusal::Mode, out);
    }

    // ---- reactions ----

    /// The next part of the data of a FETCH.
    fn reply_data(&mut self) {
        let Some(partner) = &mut self.partner else { return };
        let (from, len) = (partner.at, (partner.request.bytes() - partner.at).min(PIECE));
        partner.at += len;
        partner.piece = len;
        partner.stage = Stage::Replying;
        self.reply = Some(Reply { follow: partner.follow, code: code::OK, from, len });
    }

    /// Refuses a telegram; an order that was open is dropped.
    pub(super) fn refuse(&mut self, follow: bool, refusal: Refusal, out: &mut dyn Owner) {
        out.report(Event::Refused(refusal));
        self.drop_partner(AnswerError::Withdrawn(refusal), out);
        self.forget_reply();
        self.reply = Some(Reply { follow, code: refusal.code(), from: 0, len: 0 });
    }

    fn drop_partner(&mut self, why: AnswerError, out: &mut dyn Owner) {
        if self.partner.take().is_some_and(|partner| partner.asked) {
            out.answered(Err(why));
        }
    }

    /// Composes the reaction; `None`: there is none to send.
    pub(super) fn compose_reply(&self, telegram: &mut [u8]) -> Option<usize> {
        let reply = self.reply?;
        let head = codec::reaction(reply.follow, reply.code);
        telegram[..head.len()].copy_from_slice(&head);
        let end = head.len() + reply.len;
        telegram[head.len()..end].copy_from_slice(&self.partner_data[reply.from..reply.from + reply.len]);
        Some(end)
    }

    /// Our reaction has been sent completely and is not acknowledged: the partner may have it.
    fn reply_has_left(&self) -> bool {
        self.carries == Carries::Reaction && self.line.block_is_out()
    }

    /// The telegram received shows that the partner has our reaction.
    fn reply_arrived(&mut self, now: Instant, out: &mut dyn Owner) {
        let reply = self.reply;
        self.forget_reply();
        if let Some(reply) = reply {
            self.after_reply(now, reply, out);
        }
    }

    /// The procedure below has finished the reaction.
    pub(super) fn reply_sent(&mut self, now: Instant, outcome: Result<(), SendError>, out: &mut dyn Owner) {
        let Some(reply) = self.reply.take() else { return };
        match outcome {
            Ok(()) => self.after_reply(now, reply, out),
            Err(error) => {
                out.report(Event::ReactionNotSent(error));
                self.drop_partner(AnswerError::Line(error), out);
            }
        }
    }

    fn after_reply(&mut self, now: Instant, reply: Reply, out: &mut dyn Owner) {
        let Some(partner) = &mut self.partner else { return };
        if reply.code == code::OK && !partner.is_complete() {
            partner.stage = Stage::Next { until: now + self.config.follow_wait };
            return;
        }
        if self.partner.take().is_some_and(|partner| partner.asked) {
            out.answered(Ok(()));
        }
    }

    pub(super) fn partner_times(&mut self, now: Instant, out: &mut dyn Owner) {
        match self.partner.as_ref().map(|partner| partner.stage) {
            Some(Stage::Asked { until }) if now >= until => self.refuse_asked(out),
            Some(Stage::Next { until }) if now >= until => {
                out.report(Event::Abandoned);
                self.drop_partner(AnswerError::Abandoned, out);
            }
            _ => {}
        }
    }
}
