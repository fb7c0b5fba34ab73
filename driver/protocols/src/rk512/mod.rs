//! RK 512: orders with a header, each telegram a block of 3964(R), each answered by a reaction.
//!
//! ```text
//! active                                     passive
//! [00 00 A D db dw length flag  data]  ->
//!                                      <-    [00 00 00 code]             SEND [S0 "Structure of the output message"]
//! [FF 00 A D  data]                    ->
//!                                      <-    [FF 00 00 code]             more than 128 bytes
//!
//! [00 00 E D db dw length flag]        ->
//!                                      <-    [00 00 00 code  data]       FETCH [S0 "Structure of the input message"]
//! [FF 00 E D]                          ->
//!                                      <-    [FF 00 00 code  data]
//! ```
//!
//! One machine has both roles at once: an own order waits for its reaction while orders of the partner come in and are
//! answered ("quasi full duplex", one order each way) [CP 341 manual 09/2008, p. 52 to 57]. The active role is in
//! `active`, the passive one in `passive`; [`codec`] knows the telegrams, [`Config`] the differences between CPs.
//!
//! 3964(R) may deliver a block twice, when the acknowledgement of the first is lost. The rules here (ours, the texts
//! are silent): a reaction proves that the telegram it answers has arrived, once that has been sent completely; a
//! reaction that comes earlier belongs to an earlier telegram. A telegram that equals the last one, and comes before
//! our reaction can have arrived, is a repetition of it. If a follow-on telegram may be either a repetition or the next
//! one with the same data, the order is refused: an error, never wrong data. The reaction to an order that has been
//! given up may still come: the next order waits a while for it, and that reaction ends no order.

mod active;
pub mod codec;
mod config;
mod event;
mod passive;

pub use codec::{Area, Command, Coordination, Flag, Request};
pub use config::Config;
pub use event::{AnswerError, BadReaction, Event, OrderError, Refusal, code};

use crate::machine::{self, Instant, LineInput, Machine as _, SendError, TELEGRAM_MAX, Wire};
use crate::s3964::S3964;
use active::{Late, Own};
use passive::{Partner, Reply};

/// Longest telegram accepted from the line. A partner may send 138 bytes; a slightly longer telegram is refused with an
/// error number instead of NAK.
const LINE: usize = 256;

/// What happened: characters, a signal, a time or an order.
pub type Input<'a> = machine::Input<'a, Order<'a>>;

/// An order of the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order<'a> {
    /// Carry out this request, a SEND with these data. Its end is reported by [`Owner::ended`], exactly once per order.
    ///
    /// While an order is running a second one is answered at once with [`OrderError::Busy`]; the first continues.
    Start(Request, &'a [u8]),
    /// The answer to the order of the partner that [`Owner::asked`] brought. Without one it is dropped.
    Answer(Answer<'a>),
    /// The CPU is working on the order of the partner: its time to answer restarts.
    Working,
    /// From now on the CPU takes orders of the partner (true, as at the start) or does not (CPU in STOP).
    Serve(bool),
    /// Drop everything in both roles and go back to idle. Used for the RESET of the CPU and for new parameters.
    Abort,
}

/// The CPU's answer to an order of the partner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer<'a> {
    /// The data of the SEND have been taken.
    Taken,
    /// The data of the FETCH; as many as the request asks for.
    Data(&'a [u8]),
    /// Refused with this error number, not 0. (docs/cp341-events.md)
    Refused(u8),
}

/// Where the machine puts its results, besides output to the line. Called only inside [`Rk512::step`].
pub trait Owner: Wire {
    /// The own order has ended: the data of the FETCH (none for a SEND), or why it failed.
    fn ended(&mut self, outcome: Result<&[u8], OrderError>);

    /// The partner has sent an order, a SEND with its data. Answer with [`Order::Answer`]; until then no other order
    /// comes.
    fn asked(&mut self, request: &Request, data: &[u8]);

    /// The order of the partner has ended, exactly once for each [`Owner::asked`]: the answer has arrived, or why not.
    /// An answer given after this is dropped.
    fn answered(&mut self, outcome: Result<(), AnswerError>);

    /// Something worth the LED `ER`, a diagnostic entry or a line of the trace.
    fn report(&mut self, event: Event);
}

/// RK 512 on 3964 or 3964R, with room for orders of `N` bytes of data in each role.
#[derive(Clone, Debug)]
pub struct Rk512<const N: usize = TELEGRAM_MAX> {
    config: Config,
    line: S3964<LINE>,
    /// Whose telegram the procedure below is sending.
    carries: Carries,
    own: Option<Own>,
    /// The reaction to an earlier own order may still come.
    late: Option<Late>,
    own_data: [u8; N],
    partner: Option<Partner>,
    partner_data: [u8; N],
    /// The reaction to send, or being sent.
    reply: Option<Reply>,
    /// The CPU takes orders of the partner.
    serves: bool,
}

/// Whose telegram the procedure below is sending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Carries {
    Nothing,
    Order,
    Reaction,
}

impl<const N: usize> Rk512<N> {
    /// A machine before its first step.
    pub fn new(config: Config) -> Self {
        let line = S3964::new(config.line.clone());
        Self {
            config,
            line,
            carries: Carries::Nothing,
            own: None,
            late: None,
            own_data: [0; N],
            partner: None,
            partner_data: [0; N],
            reply: None,
            serves: true,
        }
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Whether an own order is running, that is, accepted and not yet answered by [`Owner::ended`].
    pub fn busy(&self) -> bool {
        self.own.is_some()
    }

    /// Whether an order of the partner waits for [`Order::Answer`].
    pub fn is_asking(&self) -> bool {
        self.partner.as_ref().is_some_and(Partner::is_asked)
    }

    /// Takes one input at time `now`; returns the next deadline. The laws are those of [`machine::Machine`].
    pub fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Owner) -> Option<Instant> {
        let line = match input {
            Input::Tick => machine::Input::Tick,
            Input::Line(LineInput::Rx(bytes)) => return self.characters(now, bytes, out),
            Input::Line(input) => machine::Input::Line(input),
            Input::Order(order) => {
                self.order(now, order, out);
                machine::Input::Line(LineInput::Rx(&[]))
            }
        };
        let due = self.drive(now, line, out);
        let mut due = self.deadline(due);
        // As in 3964(R): after a tick no expired time is left.
        while matches!(input, Input::Tick) && due.is_some_and(|due| due <= now) {
            let line = self.drive(now, machine::Input::Tick, out);
            due = self.deadline(line);
        }
        due
    }

    /// User data within a telegram can change only the deadline. Everything else goes down one character at a
    /// time: a telegram is handled before the procedure below begins something new.
    fn characters(&mut self, now: Instant, mut bytes: &[u8], out: &mut dyn Owner) -> Option<Instant> {
        loop {
            self.line.receive_plain(now, &mut bytes);
            let Some((byte, rest)) = bytes.split_first() else { return self.deadline(self.line.deadline()) };
            self.drive(now, machine::Input::Line(LineInput::Rx(core::slice::from_ref(byte))), out);
            bytes = rest;
        }
    }

    fn order(&mut self, now: Instant, order: Order<'_>, out: &mut dyn Owner) {
        match order {
            Order::Start(request, data) => self.start(request, data, out),
            Order::Answer(answer) => self.answer(answer, out),
            Order::Working => self.working(now),
            Order::Serve(serves) => {
                self.serves = serves;
                if !serves && self.is_asking() {
                    self.refuse_asked(out);
                }
            }
            Order::Abort => self.abort(now, out),
        }
    }

    fn abort(&mut self, now: Instant, out: &mut dyn Owner) {
        let is_owed = self.awaits_reaction();
        // The outcome it reports for its running order is not passed on: the order ends further down in any case.
        self.line.take(now, machine::Input::Order(machine::Order::Abort), &mut Tap::new(out));
        self.carries = Carries::Nothing;
        self.reply = None;
        if is_owed {
            self.expect_late(now, false);
        }
        if self.own.take().is_some() {
            out.ended(Err(OrderError::Aborted));
        }
        if self.partner.take().is_some_and(|partner| partner.owes_an_end()) {
            out.answered(Err(AnswerError::Aborted));
        }
    }

    /// Passes an input to the procedure below, then handles its results, our own times, and the next telegram to send.
    fn drive(&mut self, now: Instant, input: machine::Input<'_>, out: &mut dyn Owner) -> Option<Instant> {
        let mut tap = Tap::new(out);
        self.line.take(now, input, &mut tap);
        let Tap { delivered, sent, .. } = tap;
        if let Some(outcome) = sent {
            self.line_sent(now, outcome, out);
        }
        if let Some(len) = delivered {
            let mut telegram = [0; LINE];
            let telegram = &mut telegram[..len.min(LINE)];
            telegram.copy_from_slice(self.line.received(len));
            self.telegram(now, telegram, out);
        }
        self.own_times(now, out);
        self.partner_times(now, out);
        self.hand_down(now, out);
        let due = self.line.go(now, &mut Tap::new(out));
        self.watch_bwz(now);
        due
    }

    fn telegram(&mut self, now: Instant, telegram: &[u8], out: &mut dyn Owner) {
        match codec::parse(telegram) {
            Ok(codec::Telegram::Reaction { follow, code, data }) => self.reaction(now, follow, code, data, out),
            Ok(codec::Telegram::Order(request, data)) => self.partner_order(now, request, data, out),
            Ok(codec::Telegram::Follow { command, area, data }) => self.partner_follow(now, command, area, data, out),
            // A telegram that could be a reaction counts as one while one is due.
            Err(codec::Malformed::Short) if self.awaits_reaction() && telegram.len() < codec::SHORT => {
                self.bad_reaction(now, BadReaction::Structure, out);
            }
            Err(codec::Malformed::ReactionBytes) => self.bad_reaction(now, BadReaction::Structure, out),
            Err(malformed) => {
                let follow = telegram.first() == Some(&0xFF);
                self.refuse(follow, malformed.into(), out);
            }
        }
    }

    /// The procedure below has finished a telegram.
    fn line_sent(&mut self, now: Instant, outcome: Result<(), SendError>, out: &mut dyn Owner) {
        match core::mem::replace(&mut self.carries, Carries::Nothing) {
            Carries::Nothing => {}
            Carries::Order => self.order_sent(now, outcome, out),
            Carries::Reaction => self.reply_sent(now, outcome, out),
        }
    }

    /// Gives the next telegram to the procedure below: a reaction first, because the partner waits for it.
    fn hand_down(&mut self, now: Instant, out: &mut dyn Owner) {
        let is_order_due = self.own.as_ref().is_some_and(Own::is_to_send) && !self.waits_for_late();
        if (self.reply.is_none() && !is_order_due) || self.line.busy() {
            return;
        }
        let mut telegram = [0; LINE];
        let (carries, len) = match self.compose_reply(&mut telegram) {
            Some(len) => (Carries::Reaction, len),
            None => (Carries::Order, self.compose_order(&mut telegram)),
        };
        self.carries = carries;
        let mut tap = Tap::new(out);
        self.line.take(now, machine::Input::Order(machine::Order::Send(&telegram[..len])), &mut tap);
        if let Some(outcome) = tap.sent {
            // The procedure is configured for telegrams shorter than ours.
            self.line_sent(now, outcome, out);
        }
    }

    /// Withdraws the reaction. Only while the line is free.
    fn forget_reply(&mut self) {
        self.reply = None;
        if self.carries == Carries::Reaction {
            self.line.forget_order();
            self.carries = Carries::Nothing;
        }
    }

    fn deadline(&self, line: Option<Instant>) -> Option<Instant> {
        let own = self.own.as_ref().and_then(Own::deadline);
        let partner = self.partner.as_ref().and_then(Partner::deadline);
        machine::earliest([line, own, partner, self.late_deadline()])
    }
}

/// The procedure's view of the machine above it.
struct Tap<'a> {
    out: &'a mut dyn Owner,
    delivered: Option<usize>,
    sent: Option<Result<(), SendError>>,
}

impl<'a> Tap<'a> {
    fn new(out: &'a mut dyn Owner) -> Self {
        Self { out, delivered: None, sent: None }
    }
}

impl Wire for Tap<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.out.transmit(bytes);
    }

    fn take_back(&mut self) -> usize {
        self.out.take_back()
    }
}

impl machine::Sink for Tap<'_> {
    fn room(&self) -> usize {
        LINE
    }

    fn deliver(&mut self, telegram: &[u8]) {
        self.delivered = Some(telegram.len());
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.sent = Some(outcome);
    }

    fn report(&mut self, event: machine::Event) {
        self.out.report(Event::Line(event));
    }
}
