//! Loadable driver of the CP 341: Modbus ASCII master with 32-bit registers. [S4 "1.3 Summary of the Modbus Protocol"]
//!
//! ```text
//! P_SND_RK   source area   ->  Order::Job   ->  : request LRC CR LF  ->  slave
//! P_RCV_RK   destination   <-  deliver      <-  : reply   LRC CR LF  <-
//!            taken         ->  Order::Taken
//! P_SND_RK   DONE / ERROR  <-  ended
//! ```
//!
//! A job ends when its reply has been checked: a writing one at once, a reading one when the CPU has taken the data [S4
//! L1648], a broadcast after the turnaround delay [S4 "Turnaround Delay"]. Every error is an event number that goes to
//! [`Owner::event`] (the diagnostic buffer, [S4 L1687]); the one that ends the job goes to [`Owner::ended`] too and is
//! P_SND_RK's STATUS. 0834h does not end a job.
//!
//! * [`job`]: the source area to a request, with all its checks; never panics, needs no time.
//! * [`reply`]: a reply to the destination area; never panics, needs no time.
//! * [`Parameters`]: the parameters of the assignment tool; the driver checks them at its start.
//! * [`Driver`]: the machine.
//! * [`number`]: the event numbers.
//!
//! It differs from [`modbus::Master`](crate::modbus::Master), the CP 240's, in everything visible to the program and on
//! the line: layouts, numbers, times, signals. Both share the Modbus part: LRC and digits.

mod config;
pub mod job;
pub mod number;
mod receive;
pub mod reply;

pub use config::{BAUD_RATES, Parameters, Parity, Signals, Wiring};

use crate::machine::{Instant, LineFault, LineInput, ModemLines, Wire};
use crate::modbus::ascii;
use crate::signals::{self, Clear};
use config::Config;
use job::Job;
use receive::{Heard, Receiver};

/// Longest telegram without LRC, bytes: address, function code and 252 bytes of data. [S4 "Message Structure"]
pub const TELEGRAM_BYTES: usize = 254;

/// Characters of the longest frame.
pub const FRAME_CHARACTERS: usize = 2 * (TELEGRAM_BYTES + 1) + 3;

/// Maximum bytes of a destination area: 2008 bits are 251 bytes, in whole words.
pub const DESTINATION_BYTES: usize = 252;

/// What happened: a character, a signal, a time or an order.
pub type Input<'a> = crate::machine::Input<'a, Order<'a>>;

/// An order of the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order<'a> {
    /// A job of P_SND_RK: `R_TYP` and the source area, LEN bytes of it. It ends with [`Owner::ended`], exactly once.
    /// While one runs, another is answered at once with [`number::BUSY`]; the first continues.
    Job {
        /// Parameter `R_TYP` of the call: `X` is required.
        r_typ: u8,
        /// Source area: slave address, function code, words.
        source: &'a [u8],
    },
    /// P_RCV_RK has taken the delivered data (`true`), or cannot take them (`false`, after the reason was entered in
    /// the diagnostic buffer).
    Taken(bool),
    /// Drop the running job: it ends with [`number::ABORTED`].
    Abort,
}

/// Where the driver puts its results, besides output to the line. Called only inside [`Driver::step`].
pub trait Owner: Wire {
    /// The destination area of a reading job, for P_RCV_RK; never empty. The job continues until [`Order::Taken`].
    fn deliver(&mut self, destination: &[u8]);

    /// The job has ended; the error is P_SND_RK's STATUS.
    fn ended(&mut self, outcome: Result<(), u16>);

    /// An entry for the diagnostic buffer. A job's error comes here first, then to [`Owner::ended`].
    fn event(&mut self, number: u16);
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Before the first step.
    Start,
    Idle,
    /// Characters of an earlier job must be sent first.
    Queue,
    /// RTS is ON; the data output waiting time runs.
    OutputWait,
    /// The request is being sent.
    Output,
    /// The reply must begin before `until`.
    Reply {
        until: Instant,
    },
    /// The slaves are carrying out a broadcast.
    Turnaround {
        until: Instant,
    },
    /// The CPU is taking the data.
    Transfer {
        until: Instant,
    },
}

/// The loadable driver as a machine.
#[derive(Clone, Debug)]
pub struct Driver {
    parameters: Parameters,
    /// `None`: not ready to run.
    config: Option<Config>,
    state: State,
    job: Option<Job>,
    receiver: Receiver,
    /// Characters are being sent.
    leaving: bool,
    signals: signals::Signals,
    /// The line is gone.
    gone: bool,
}

impl Driver {
    /// A driver before its first step.
    pub const fn new(parameters: Parameters) -> Self {
        Self {
            parameters,
            config: None,
            state: State::Start,
            job: None,
            receiver: Receiver::new(),
            leaving: false,
            signals: signals::Signals::new(None),
            gone: false,
        }
    }

    /// Whether the parameters are valid; known after the first step.
    pub const fn is_ready(&self) -> bool {
        self.config.is_some()
    }

    /// Whether it uses the RS 232C secondary signals by itself.
    pub fn uses_signals(&self) -> bool {
        self.signals.are_used()
    }

    /// Whether a job is running.
    pub const fn busy(&self) -> bool {
        !matches!(self.state, State::Start | State::Idle)
    }

    /// Takes one input at time `now`; returns the next deadline. The laws are those of [`crate::Machine`].
    pub fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Owner) -> Option<Instant> {
        if self.state == State::Start {
            self.start(out);
        }
        let Some(config) = self.config else {
            // "The driver is not ready to run."
            if matches!(input, Input::Order(Order::Job { .. })) {
                self.fail(number::NOT_READY, out);
            }
            return None;
        };
        match input {
            Input::Tick => {}
            Input::Line(LineInput::Rx(bytes)) => self.received(now, bytes, &config, out),
            Input::Line(LineInput::TxDone) => self.tx_done(now, &config, out),
            Input::Line(LineInput::Fault(fault)) => self.line_fault(now, fault, &config, out),
            Input::Line(LineInput::Modem(lines)) => self.modem(lines, out),
            Input::Order(order) => self.order(now, order, &config, out),
        }
        if input == Input::Tick {
            self.tick(now, &config, out);
        }
        self.deadline(&config)
    }

    fn start(&mut self, out: &mut dyn Owner) {
        self.state = State::Idle;
        self.config = self.parameters.check(|number| out.event(number));
        self.signals = signals::Signals::new(self.config.and_then(|config| config.signals));
        self.signals.start(out);
    }

    // ---- orders ----

    fn order(&mut self, now: Instant, order: Order<'_>, config: &Config, out: &mut dyn Owner) {
        match order {
            Order::Job { .. } if self.busy() => {
                out.event(number::BUSY);
                out.ended(Err(number::BUSY));
            }
            Order::Job { r_typ, source } => match Job::of(r_typ, source, config.long_registers) {
                Ok(job) => {
                    self.job = Some(job);
                    if self.leaving { self.state = State::Queue } else { self.begin(now, config, out) }
                }
                Err(number) => self.fail(number, out),
            },
            Order::Taken(taken) => match self.state {
                State::Transfer { .. } if taken => self.end(Ok(()), out),
                State::Transfer { .. } => self.fail(number::TRANSFER_FAILED, out),
                _ => out.event(number::UNEXPECTED_TAKEN),
            },
            Order::Abort if self.busy() => self.fail(number::ABORTED, out),
            Order::Abort => {}
        }
    }

    fn begin(&mut self, now: Instant, config: &Config, out: &mut dyn Owner) {
        if self.gone && config.wiring.breaks && !config.wiring.half_duplex {
            return self.fail(number::BREAK, out);
        }
        let clear = self.signals.request(now, out);
        self.cleared(clear, out);
    }

    fn cleared(&mut self, clear: Clear, out: &mut dyn Owner) {
        match clear {
            Clear::Go => self.send(out),
            Clear::Wait => self.state = State::OutputWait,
            Clear::Off => self.fail(number::SIGNALS, out),
        }
    }

    fn send(&mut self, out: &mut dyn Owner) {
        let mut frame = [0; FRAME_CHARACTERS];
        let request = self.job.as_ref().map_or(&[][..], Job::request);
        // A request always fits the frame: its job limits it.
        let len = ascii::encode(request, &mut frame).unwrap_or(0);
        self.state = State::Output;
        self.leaving = true;
        out.transmit(frame.get(..len).unwrap_or(&[]));
    }

    // ---- the line ----

    fn tx_done(&mut self, now: Instant, config: &Config, out: &mut dyn Owner) {
        self.leaving = false;
        match self.state {
            State::Queue => return self.begin(now, config, out),
            State::Output => {}
            _ => return,
        }
        self.signals.sent(now);
        if self.job.as_ref().is_some_and(Job::is_broadcast) {
            self.state = State::Turnaround { until: now + config.turnaround };
        } else {
            self.receiver.clear();
            self.state = State::Reply { until: now + config.response };
        }
        self.tick(now, config, out);
    }

    fn received(&mut self, now: Instant, bytes: &[u8], config: &Config, out: &mut dyn Owner) {
        // "Reception during transmission is ignored." [S4 L727]
        for byte in bytes {
            if !matches!(self.state, State::Reply { .. }) || !self.signals.can_receive() {
                return;
            }
            match self.receiver.character(now, *byte, config.normal) {
                Heard::Nothing => {}
                // "This does not in itself fail the send job. The error only appears in the CP diagnostic buffer."
                // [S4 L1757]
                Heard::Restart => out.event(number::RESTART),
                Heard::End(Ok(())) => self.replied(now, config, out),
                Heard::End(Err(number)) => self.fail(number, out),
            }
        }
    }

    fn replied(&mut self, now: Instant, config: &Config, out: &mut dyn Owner) {
        let Some(job) = &self.job else { return };
        match reply::evaluate(job, self.receiver.telegram()) {
            // "... completed after the reply message is received without error and complete transfer of the received
            // data to the CPU." [S4 L1648]
            Ok(destination) if !destination.bytes().is_empty() => {
                self.state = State::Transfer { until: now + config.transfer };
                out.deliver(destination.bytes());
            }
            Ok(_) => self.end(Ok(()), out),
            Err(number) => self.fail(number, out),
        }
    }

    fn line_fault(&mut self, now: Instant, fault: LineFault, config: &Config, out: &mut dyn Owner) {
        let is_break = match fault {
            LineFault::Back => {
                self.gone = false;
                return;
            }
            // "BREAK: Receiving line to partner device is interrupted." [S4 L1750]
            LineFault::Gone => {
                self.gone = true;
                if !config.wiring.breaks {
                    return;
                }
                true
            }
            // "Line status BREAK cannot be recognized": a character without its stop bit.
            // [S4 "Presetting of the Receiving Line"]
            LineFault::Break => config.wiring.breaks,
            LineFault::Parity | LineFault::Framing | LineFault::Overrun => false,
        };
        let number = if is_break { number::BREAK } else { number::TRANSMISSION };
        match self.state {
            // "If BREAK is recognized on the receiving line by the CP during output of a message, the triggered
            // P_SND_RK job is completed with error." [S4 L727] In two-wire operation the CP does not receive while
            // sending.
            State::Output if is_break && !config.wiring.half_duplex => self.fail(number, out),
            State::Output => {}
            State::Reply { .. } if is_break && (config.normal || self.receiver.is_open()) => self.fail(number, out),
            State::Reply { .. } if !is_break => self.receiver.unreadable(now, config.normal),
            // "... before and after receive messages from the slave result in an appropriate error message." [S4 L538]
            _ if config.normal => out.event(number),
            _ => {}
        }
    }

    // ---- secondary signals ----

    fn modem(&mut self, lines: ModemLines, out: &mut dyn Owner) {
        let change = self.signals.inputs(lines);
        match self.state {
            // "... or if CTS changes to OFF during transmission, the send request is aborted." [S4 L814]
            State::Output if change.cts_off => self.fail(number::SIGNALS, out),
            // "A send request or data receipt is aborted with an error message if DSR changes from ON to OFF."
            // [S4 L817]
            State::OutputWait | State::Output | State::Reply { .. } if change.dsr_fell => {
                self.fail(number::SIGNALS, out);
            }
            _ => {}
        }
    }

    // ---- time ----

    fn tick(&mut self, now: Instant, config: &Config, out: &mut dyn Owner) {
        self.signals.tick(now, out);
        match self.state {
            State::OutputWait => {
                let clear = self.signals.clear(now);
                self.cleared(clear, out);
            }
            // "If the slave doesn't send a start character during the reply monitoring time the send job is finished
            // with error." [S4 L536]
            State::Reply { until } if !self.receiver.is_open() && now >= until => self.fail(number::NO_REPLY, out),
            State::Reply { .. } if self.receiver.is_open() && now >= self.receiver.last() + config.character_delay => {
                self.fail(self.receiver.silence(), out);
            }
            State::Turnaround { until } if now >= until => self.end(Ok(()), out),
            State::Transfer { until } if now >= until => self.fail(number::TRANSFER_TIMEOUT, out),
            _ => {}
        }
    }

    fn deadline(&self, config: &Config) -> Option<Instant> {
        let own = match self.state {
            State::Start | State::Idle | State::Queue | State::OutputWait | State::Output => None,
            State::Reply { .. } if self.receiver.is_open() => Some(self.receiver.last() + config.character_delay),
            State::Reply { until } | State::Turnaround { until } | State::Transfer { until } => Some(until),
        };
        own.into_iter().chain(self.signals.deadline()).min()
    }

    // ---- the end ----

    fn fail(&mut self, number: u16, out: &mut dyn Owner) {
        out.event(number);
        self.end(Err(number), out);
    }

    fn end(&mut self, outcome: Result<(), u16>, out: &mut dyn Owner) {
        if self.state == State::Output {
            out.take_back();
        }
        self.signals.drop_request(out);
        self.state = State::Idle;
        self.job = None;
        out.ended(outcome);
    }
}
