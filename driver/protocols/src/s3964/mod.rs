//! 3964 and 3964R: point-to-point, each block acknowledged, both partners may begin.
//!
//! ```text
//! sender     STX       data (DLE doubled) DLE ETX [BCC]
//! receiver       DLE                                    DLE
//! ```
//!
//! One machine has both roles, as on the module: an order waits while a telegram is received. The sending role is in
//! `send`, the receiving one in `receive`; [`codec`] knows the characters of a block, [`Config`] the differences
//! between CPs. "Done" means that the partner's DLE after the block has come. If that DLE is lost the partner repeats
//! the block, and it is delivered again: the procedure cannot distinguish it from a new one.

pub mod codec;
mod config;
mod receive;
mod send;

pub use config::{Config, Priority};

use crate::machine::{
    Event, Input, Instant, LineFault, LineInput, Machine, Order, Phase, SendError, Sink, Span, TELEGRAM_MAX, What,
};
use codec::NAK;
use receive::Block;
use send::Job;

/// How often the receive buffer is checked while a partner waits for it. [CP 440 manual 03/2022, p. 47]
const BUFFER_POLL: Span = Span::from_millis(50);

/// If a line never reports the end of its output, the output counts as ended this long after its computed duration.
const OUTPUT_GRACE: Span = Span::SECOND;

/// The 3964(R) procedure with a send and a receive buffer of `N` bytes each.
#[derive(Clone, Debug)]
pub struct S3964<const N: usize = TELEGRAM_MAX> {
    config: Config,
    state: State,
    output: Output,
    /// An order that has not begun, or that begins again after a telegram of the partner.
    waiting: Option<Job>,
    /// The telegram of the order.
    tx: [u8; N],
    rx: [u8; N],
    /// No order begins before this time: ZNA, or the quiet after a refusal.
    pause_until: Instant,
    /// A block was refused as often as permitted: if the partner repeats it once more, it does so before this time. (CP
    /// 341)
    given_up_until: Option<Instant>,
}

/// The state of the procedure, with the data of that state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Before the first step.
    Start,
    /// The line is free.
    Idle,
    /// A block was refused for the `refused`-th time; its repetition must begin before `until`. (CP 341)
    Repetition { until: Instant, refused: u16 },
    /// The partner has sent STX and waits for a receive buffer until `until`. (CP 341)
    Buffer { until: Instant, poll: Instant, refused: u16 },
    /// A character without meaning came in; NAK follows when the line has been silent until `until`. (CP 341)
    /// `disturbed`: it came while our block was being sent, which is then repeated.
    Silence { until: Instant, disturbed: Option<(Job, What)> },
    /// STX has been sent, DLE must come before `expiry` (QVZ).
    Connect { job: Job, expiry: Instant },
    /// The block is being sent.
    Output { job: Job },
    /// The block has been sent, DLE must come before `expiry` (QVZ).
    Acknowledge { job: Job, expiry: Instant },
    /// DLE has been sent, the next character must come before `expiry` (ZVZ).
    Receive { block: Block, expiry: Instant },
}

/// The output of this side on the line.
#[derive(Clone, Copy, Debug, Default)]
struct Output {
    /// Handed over and not yet reported as sent.
    in_flight: bool,
    /// When the last bit has been sent at the earliest.
    end: Instant,
    /// The last character handed over was a NAK to something without meaning.
    nak: bool,
}

impl Output {
    /// Everything has been sent, as reported or by its computed duration.
    fn is_out(&self, now: Instant) -> bool {
        !self.in_flight || now >= self.end
    }
}

impl<const N: usize> S3964<N> {
    /// A machine before its first step.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            state: State::Start,
            output: Output::default(),
            waiting: None,
            tx: [0; N],
            rx: [0; N],
            pause_until: Instant::START,
            given_up_until: None,
        }
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    fn transmit(&mut self, now: Instant, bytes: &[u8], out: &mut dyn Sink) {
        self.output.end = self.output.end.max(now) + self.config.char_time * bytes.len() as u64;
        self.output.in_flight = true;
        self.output.nak = false;
        out.transmit(bytes);
    }

    /// Interrupts our output: characters that have not begun are taken back.
    fn take_back(&mut self, now: Instant, out: &mut dyn Sink) {
        let saved = self.config.char_time * out.take_back() as u64;
        self.output.end = self.output.end.saturating_sub(saved).max(now);
    }

    /// No order begins until the line has been quiet.
    fn wait_for_quiet(&mut self, now: Instant) {
        self.pause_until = self.pause_until.max(self.output.end.max(now) + self.config.quiet);
    }

    /// Starts or restarts the wait for silence before NAK.
    fn silence(&mut self, now: Instant, disturbed: Option<(Job, What)>) {
        self.state = State::Silence { until: now + self.config.zvz(), disturbed };
    }

    /// When a timer that begins with the end of our output expires if that end is never reported.
    fn expiry_unreported(&self, time: Span) -> Instant {
        self.output.end + OUTPUT_GRACE + time
    }

    /// The running order, if there is one.
    fn running(&self) -> Option<&Job> {
        match &self.state {
            State::Connect { job, .. }
            | State::Output { job }
            | State::Acknowledge { job, .. }
            | State::Silence { disturbed: Some((job, _)), .. } => Some(job),
            _ => None,
        }
    }

    fn report(&self, phase: Phase, what: What, out: &mut dyn Sink) {
        out.report(Event { phase, what });
    }

    fn tick(&mut self, now: Instant, out: &mut dyn Sink) {
        match self.state {
            State::Start => {
                self.state = State::Idle;
                if self.config.nak_at_start {
                    self.transmit(now, &[NAK], out);
                }
            }
            State::Repetition { until, .. } if now >= until => {
                self.report(Phase::Idle, What::NoRepetition, out);
                self.state = State::Idle;
            }
            State::Buffer { until, poll, refused } => self.buffer_tick(now, until, poll, refused, out),
            State::Silence { until, disturbed } if now >= until => self.silent(now, disturbed, out),
            State::Connect { job, expiry } if now >= expiry => self.connect_failed(now, job, What::AckDelay, out),
            State::Output { job } if now >= self.expiry_unreported(Span::ZERO) => {
                self.output_done(now, job);
            }
            State::Acknowledge { job, expiry } if now >= expiry => self.block_failed(now, job, What::AckDelay, out),
            State::Receive { block, expiry } if now >= expiry => self.character_delay(now, block, out),
            _ => {}
        }
    }

    fn characters(&mut self, now: Instant, mut bytes: &[u8], out: &mut dyn Sink) {
        loop {
            self.receive_plain(now, &mut bytes);
            let Some((byte, rest)) = bytes.split_first() else { return };
            self.character(now, *byte, out);
            bytes = rest;
        }
    }

    fn character(&mut self, now: Instant, byte: u8, out: &mut dyn Sink) {
        match self.state {
            State::Start | State::Idle => self.idle_character(now, byte, 0, out),
            State::Repetition { refused, .. } => self.idle_character(now, byte, refused, out),
            State::Buffer { .. } => self.unexpected(now, What::Unexpected(byte), out),
            State::Silence { disturbed, .. } => self.silence(now, disturbed),
            State::Connect { job, .. } => self.connect_character(now, job, byte, out),
            State::Output { job } => self.output_character(now, job, byte, out),
            State::Acknowledge { job, .. } => self.acknowledge_character(now, job, byte, out),
            State::Receive { block, .. } => self.receive_character(now, block, byte, out),
        }
    }

    fn fault(&mut self, now: Instant, fault: LineFault, out: &mut dyn Sink) {
        let what = What::Line(fault);
        if matches!(fault, LineFault::Gone | LineFault::Back) {
            // An open circuit only causes silence: QVZ, ZVZ and the repetitions handle it.
            return self.report(self.phase(), what, out);
        }
        match self.state {
            State::Start | State::Idle | State::Repetition { .. } | State::Buffer { .. } => {
                self.unexpected(now, what, out);
            }
            State::Silence { disturbed, .. } => self.silence(now, disturbed),
            State::Connect { .. } | State::Output { .. } | State::Acknowledge { .. }
                if fault == LineFault::Break && self.config.break_ends_order =>
            {
                // [TIA help "Configuration for point-to-point links"]: BREAK: back to idle, 080Dh.
                self.report(self.phase(), what, out);
                self.take_back(now, out);
                self.end(now, Err(SendError::Frame), out);
            }
            State::Connect { job, .. } => self.connect_failed(now, job, what, out),
            State::Output { job } => self.output_disturbed(now, job, what, out),
            State::Acknowledge { job, .. } => self.block_failed(now, job, what, out),
            State::Receive { block, .. } => self.receive_unreadable(now, block, what, out),
        }
    }

    /// The last bit of everything handed over has been sent: the partner's times begin. [S0 "Timeout times"]
    fn tx_done(&mut self, now: Instant) {
        self.output = Output { in_flight: false, end: now, nak: false };
        match &mut self.state {
            State::Connect { expiry, .. } => *expiry = now + self.config.qvz,
            State::Output { job } => {
                let job = *job;
                self.output_done(now, job);
            }
            State::Receive { block, expiry } if !block.begun() => *expiry = now + self.config.zvz(),
            _ => {}
        }
    }

    fn order(&mut self, now: Instant, order: Order<'_>, out: &mut dyn Sink) {
        match order {
            Order::Abort => {
                let was_busy = self.busy();
                self.take_back(now, out);
                (self.state, self.waiting) = (State::Idle, None);
                (self.pause_until, self.given_up_until) = (now, None);
                if was_busy {
                    out.sent(Err(SendError::Aborted));
                }
            }
            Order::Send(_) if self.busy() => out.sent(Err(SendError::Busy)),
            Order::Send(telegram) => match self.tx.get_mut(..telegram.len()) {
                Some(buffer) if telegram.len() <= self.config.telegram_max => {
                    buffer.copy_from_slice(telegram);
                    self.waiting = Some(Job::new(telegram.len()));
                }
                _ => out.sent(Err(SendError::TooLong)),
            },
        }
    }

    fn phase(&self) -> Phase {
        match self.state {
            State::Start | State::Idle | State::Repetition { .. } | State::Silence { .. } => Phase::Idle,
            State::Connect { .. } => Phase::Connect,
            State::Output { .. } => Phase::Output,
            State::Acknowledge { .. } => Phase::Acknowledge,
            State::Buffer { .. } | State::Receive { .. } => Phase::Receive,
        }
    }

    pub(crate) fn deadline(&self) -> Option<Instant> {
        match self.state {
            State::Start => Some(Instant::START),
            State::Idle => self.waiting.as_ref().map(|_| self.pause_until),
            State::Repetition { until, .. } | State::Silence { until, .. } => Some(until),
            State::Buffer { until, poll, .. } => Some(until.min(poll)),
            State::Connect { expiry, .. } | State::Acknowledge { expiry, .. } | State::Receive { expiry, .. } => {
                Some(expiry)
            }
            State::Output { .. } => Some(self.expiry_unreported(Span::ZERO)),
        }
    }
}

/// The interface of this procedure for RK 512.
impl<const N: usize> S3964<N> {
    /// The first half of a step: takes the input, but begins nothing.
    pub(crate) fn take(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) {
        match input {
            Input::Tick => self.tick(now, out),
            Input::Line(LineInput::Rx(bytes)) => self.characters(now, bytes, out),
            Input::Line(LineInput::TxDone) => self.tx_done(now),
            Input::Line(LineInput::Fault(fault)) => self.fault(now, fault, out),
            Input::Line(LineInput::Modem(_)) => {} // The procedure needs no accompanying signals.
            Input::Order(order) => self.order(now, order, out),
        }
    }

    /// The second half: begins an order if possible. Returns the next deadline.
    pub(crate) fn go(&mut self, now: Instant, out: &mut dyn Sink) -> Option<Instant> {
        if self.is_free()
            && now >= self.pause_until
            && let Some(job) = self.waiting.take()
        {
            self.connect(now, job, out);
        }
        self.deadline()
    }

    /// The first `len` bytes of what was delivered last.
    pub(crate) fn received(&self, len: usize) -> &[u8] {
        &self.rx[..len.min(N)]
    }

    /// Whether the line is free: nothing is being sent, received or waited for.
    pub(crate) fn is_free(&self) -> bool {
        matches!(self.state, State::Idle)
    }

    /// Whether the partner may have the block of the order: it has been sent, and not refused.
    pub(crate) fn block_is_out(&self) -> bool {
        matches!(self.state, State::Acknowledge { .. })
            || self.running().or(self.waiting.as_ref()).is_some_and(Job::is_out)
    }

    /// Drops the order between two halves of a step, without a report: the telegram delivered in the first half has
    /// shown that the partner has it. The line is free then, so the order waits.
    pub(crate) fn forget_order(&mut self) {
        debug_assert!(self.running().is_none(), "the line is free");
        self.waiting = None;
    }
}

impl<const N: usize> Machine for S3964<N> {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        self.take(now, input, out);
        let mut due = self.go(now, out);
        // A time of 0 ms expires as soon as it begins: after a tick no expired time is left.
        while matches!(input, Input::Tick) && due.is_some_and(|due| due <= now) {
            self.take(now, Input::Tick, out);
            due = self.go(now, out);
        }
        due
    }

    fn busy(&self) -> bool {
        self.waiting.is_some() || self.running().is_some()
    }
}
