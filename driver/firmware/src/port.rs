//! A CP of any type, as its owner sees it: its inputs and outputs.

use std::fmt::Debug;

use ob1_params::{Cp341 as Keys, Interface, LineSettings, ParamError};
use ob1_protocols::{Event, Instant, LineFault, LineInput, Phase, SendError, Span, What, Wire, rk512};
pub use ob1_words::Counter;
use ob1_words::channels::{Channel, ChannelBlock};

use crate::choose_reason::{Reason, Waiting};
use crate::diagnosis::{DiagnosticBytes, DiagnosticRecord};
use crate::leds::Leds;

/// A whole CP: handshakes, protocol, buffers, LEDs and diagnosis.
pub trait Cp: Debug {
    /// Takes one input at time `now` and returns when [`CpInput::Tick`] is due. An input that this type does not have
    /// changes nothing.
    fn step(&mut self, now: Instant, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Instant>;

    /// Whether its parameters are valid, and the CPU has acknowledged its start-up where it has one.
    fn is_working(&self) -> bool;

    /// Enables or disables diagnostic interrupts; off unless enabled. CP 240: errors that light ER are also reported as
    /// [`CpEvent::Diagnosis`]; its parameter bytes have no place for this switch (ours: a key of the station file). CP
    /// 040, CP 340 and CP 341: a wire break and wrong parameters are reported.
    fn enable_diagnostics(&mut self, enabled: bool);

    /// Which interface the module has, before its parameters; RS 232 unless set. A CP 240 alone has one that no
    /// parameter names.
    fn set_interface(&mut self, interface: Interface) {
        let _ = interface;
    }

    /// What must change before the CP does anything more, if there is something.
    fn waits_for(&self) -> Option<Reason> {
        None
    }

    /// What was received and waits for the CPU.
    fn waiting(&self) -> Waiting {
        Waiting::default()
    }
}

/// Everything that can happen to a CP.
#[derive(Debug, Clone, Copy)]
pub enum CpInput<'a> {
    /// Time has passed; nothing else.
    Tick,
    /// The CPU's current output registers: 16 bytes of a CP 240, 8 to 60 of a CP 040.
    Outputs(&'a [u8]),
    /// Something happened on the line.
    Line(LineInput<'a>),
    /// The line has not been there since the start. What is sent is lost, but it is no wire break: [`LineFault::Gone`]
    /// follows if it does not come.
    NoLine,
    /// The CPU went to RUN or start-up (true) or to STOP (false).
    CpuRun(bool),
    /// Parameters: the CP restarts with them. Sixteen zeros stand for "none", see [`crate::Cp240`].
    Parameters(&'a [u8; 16]),
    /// CP 340 and CP 341: their parameters, or the error in them, as sent at each start-up of the CPU.
    Keys(Result<&'a Keys, &'a ParamError>),
    /// CP 340 and CP 341: the CPU's block of a channel.
    Channel(Channel, &'a ChannelBlock),
}

/// Where a CP puts its results, besides output to the line. All methods are called inside [`Cp::step`].
pub trait CpPort: Wire {
    /// Publishes the input registers, all bytes at once. Called only when they have changed.
    fn inputs(&mut self, registers: &[u8]);

    /// CP 341: publishes a block of a channel for the CPU. Called only when it has changed.
    fn channel(&mut self, channel: Channel, block: &ChannelBlock) {
        let _ = (channel, block);
    }

    /// Sets baud rate, character frame and flow control; called once for each valid parameter record, and for an M-Bus
    /// telegram that names another baud rate than the one before.
    fn line_settings(&mut self, settings: &LineSettings);

    /// How late the line may hand over received characters, because they come in bursts. RTU separates telegrams by
    /// their silences. 0: each character is handed over at its time.
    fn lateness(&self) -> Span {
        Span::ZERO
    }

    /// CP 040 and CP 341: the current diagnostic data (record 1; its first four bytes are record 0).
    fn record(&mut self, record: &[u8]) {
        let _ = record;
    }

    /// The LEDs have changed.
    fn leds(&mut self, leds: Leds);

    /// Adds to a counter.
    fn count(&mut self, counter: Counter, n: u64);

    /// Something worth a diagnostic entry or a line of the trace.
    fn event(&mut self, now: Instant, event: CpEvent<'_>);
}

/// What several CPs do alike.
impl dyn CpPort + '_ {
    /// Puts characters on the line.
    pub(crate) fn put_out(&mut self, bytes: &[u8]) {
        self.count(Counter::BytesTx, bytes.len() as u64);
        self.transmit(bytes);
    }

    /// Counts what has come from the line.
    pub(crate) fn count_line(&mut self, line: LineInput<'_>, was_gone: bool) {
        match line {
            LineInput::Rx(bytes) => self.count(Counter::BytesRx, bytes.len() as u64),
            LineInput::Fault(LineFault::Gone) => self.count(Counter::LineFaults, u64::from(!was_gone)),
            LineInput::Fault(LineFault::Back) => self.count(Counter::LineRestarts, 1),
            _ => {}
        }
    }

    /// An occurrence in a protocol of a CP 240 or CP 040.
    pub(crate) fn occurred(&mut self, now: Instant, event: Event) {
        if let Some(counter) = counted(event.what) {
            self.count(counter, 1);
        }
        self.event(now, CpEvent::Protocol(event));
    }

    /// A telegram has come; `is_stored`: the buffer had room for it.
    pub(crate) fn received(&mut self, now: Instant, telegram: &[u8], is_stored: bool) {
        if is_stored {
            self.count(Counter::TelegramsReceived, 1);
            self.event(now, CpEvent::Received(telegram));
        } else {
            // A protocol that does not ask for room first.
            self.occurred(now, Event { phase: Phase::Receive, what: What::NoBuffer });
        }
    }

    /// An order of a CP 240 or CP 040 has ended; returns the outcome for the CPU. `broke_off`: it was aborted because
    /// the line is gone.
    pub(crate) fn order_ended(
        &mut self,
        now: Instant,
        outcome: Result<(), SendError>,
        broke_off: bool,
    ) -> Result<(), SendError> {
        let outcome = if broke_off && outcome == Err(SendError::Aborted) { Err(SendError::Frame) } else { outcome };
        self.ended(now, outcome.map_err(SendError::code));
        outcome
    }

    /// An order has ended, or failed with this code of the indicator word.
    pub(crate) fn ended(&mut self, now: Instant, outcome: Result<(), u8>) {
        match outcome {
            Ok(()) => {
                self.count(Counter::TelegramsSent, 1);
                self.event(now, CpEvent::Sent);
            }
            Err(code) => {
                self.count(Counter::SendErrors, 1);
                self.event(now, CpEvent::SendFailed(code));
            }
        }
    }

    /// Shows the LEDs if they have changed.
    pub(crate) fn show(&mut self, leds: Leds, shown: &mut Leds) {
        if std::mem::replace(shown, leds) != leds {
            self.leds(leds);
        }
    }
}

/// The counter of an occurrence in a protocol of a CP 240 or CP 040.
pub(crate) const fn counted(what: What) -> Option<Counter> {
    match what {
        What::NoBuffer | What::TooLong => Some(Counter::RejectedFull),
        What::CharacterDelay
        | What::Restarted
        | What::BadDle(_)
        | What::BadCheck { .. }
        | What::Modbus(_)
        | What::Line(LineFault::Parity | LineFault::Framing | LineFault::Overrun | LineFault::Break) => {
            Some(Counter::ReceiveErrors)
        }
        _ => None,
    }
}

/// Why a CP shows a start-up identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartReason {
    /// It has been given parameters: power-up, or STOP -> RUN of the CPU.
    Parameters,
    /// The CPU requested it.
    ResetRequest,
}

/// An event reported by a CP.
#[derive(Debug, Clone, Copy)]
pub enum CpEvent<'a> {
    /// The CP shows start-up identifier number `number` and waits for the CPU.
    Startup {
        /// Number of the start-up identifier, 1 to 255.
        number: u8,
        /// What has caused the start-up.
        reason: StartReason,
    },
    /// The CPU has acknowledged; the CP works.
    Working,
    /// It cannot start: this error is in its parameters.
    NoParameters(&'a ParamError),
    /// The CPU has handed over this telegram.
    Order(&'a [u8]),
    /// The CPU gave up before a telegram was complete, or it is too long (17h).
    OrderDiscarded {
        /// 17h, or `None` if the CPU gave up.
        code: Option<u8>,
    },
    /// The running order ended successfully.
    Sent,
    /// The running order ended with this code of the indicator word.
    SendFailed(u8),
    /// CP 341: the job of P_SND_RK ended with this STATUS.
    JobFailed(u16),
    /// CP 341: an entry of its diagnostic buffer.
    Entry(u16),
    /// CP 341: an entry too: the state with this number has gone.
    EntryGone(u16),
    /// This telegram was received.
    Received(&'a [u8]),
    /// Modbus slave "long": the master has changed this many bytes, which go to the CPU together.
    Changed(usize),
    /// A telegram of this length was handed over to the CPU.
    Delivered(usize),
    /// An occurrence in the protocol.
    Protocol(Event),
    /// An occurrence in RK 512.
    Rk512(rk512::Event),
    /// RK 512: this order of the partner goes to the CPU, with the data of a SEND.
    Asked(&'a rk512::Request, &'a [u8]),
    /// RK 512: the order of the partner has ended.
    Answered(Result<(), rk512::AnswerError>),
    /// Diagnostics are enabled, and ER has come on (or another kind of error has joined) or has gone out: a diagnostic
    /// interrupt for the CPU.
    Diagnosis {
        /// The error comes; otherwise all errors have gone.
        incoming: bool,
        /// Bytes of the module's diagnosis.
        data: DiagnosticBytes,
    },
    /// CP 040: the same, with its diagnostic record (record set 01h).
    Record {
        /// The error comes; otherwise it has gone.
        incoming: bool,
        /// The record as SFC 59 reads it.
        record: DiagnosticRecord,
    },
}
