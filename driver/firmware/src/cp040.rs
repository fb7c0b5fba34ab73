//! The SLIO CP 040: the byte protocol towards the host, buffers, protocol machines, LEDs, diagnostics.
//! `docs/cp040-registers.md`

mod diagnosis;
mod exchange;
mod outlet;
mod receive;
mod send;
#[cfg(test)]
mod tests;

use ob1_params::{Cp040 as Parameters, Duplex};
use ob1_protocols::modbus::area::{BLOCK_BYTES, BLOCKS_TOGETHER};
use ob1_protocols::{Input, Instant, LineFault, LineInput, ModemLines, Order, SendError, Span};

pub use ob1_words::cp040::IO_BYTES;

use crate::choose_reason::{Reason, Waiting, Why};
use crate::leds::{LedDriver, Leds};
use crate::port::{Counter, Cp, CpEvent, CpInput, CpPort};
use crate::protocol::{Protocol, Setup};
use diagnosis::Diagnosis;
use exchange::{Exchange, Step};
use ob1_words::cp040::Area;
use outlet::Outlet;

/// IF flashes: on for this time, then off for this time. "2 Hz" [S3 L293]
const FLASH: Span = Span::from_millis(250);

/// How far the start-up has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No parameters have come yet.
    Off,
    /// They are not valid.
    NoParameters,
    Working,
}

/// A CP 040.
///
/// The owner obeys the same laws as for a [`Cp240`](crate::Cp240): time never goes backwards; it ticks when the
/// returned time has come; it passes the current outputs before the first parameters. Sixteen zeros as parameters are
/// ASCII with its defaults.
#[derive(Debug)]
pub struct Cp040 {
    phase: Phase,
    cpu_stopped: bool,
    exchange: Exchange,
    shown: Area,
    parameters: Option<Parameters>,
    setup: Option<Setup>,
    protocol: Protocol,
    protocol_due: Option<Instant>,
    /// Characters are being transmitted.
    transmitting: bool,
    line_gone: bool,
    /// It has not been there since the start, which is no wire break.
    line_awaited: bool,
    /// The order was aborted because the line is gone.
    line_broke_off: bool,
    leds: LedDriver,
    leds_shown: Leds,
    diagnosis: Diagnosis,
}

impl Cp for Cp040 {
    fn step(&mut self, now: Instant, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Instant> {
        match input {
            CpInput::Tick => {
                if self.protocol_due.is_some_and(|due| now >= due) {
                    self.drive(now, Input::Tick, port);
                }
            }
            CpInput::Outputs(outputs) => {
                self.exchange.set_outputs(outputs);
                self.look(now, port);
            }
            CpInput::Line(line) => self.line(now, line, port),
            CpInput::NoLine => {
                port.count(Counter::LineFaults, 1);
                (self.line_gone, self.line_awaited) = (true, true);
            }
            CpInput::CpuRun(run) => {
                self.cpu_stopped = !run;
                if run {
                    self.leds.stop_run();
                }
            }
            CpInput::Parameters(bytes) => self.parametrise(now, bytes, port),
            CpInput::Keys(_) | CpInput::Channel(..) => {}
        }
        self.publish(port);
        port.show(self.leds_at(now), &mut self.leds_shown);
        if let Some(incoming) = self.diagnosis.change(now) {
            port.record(self.diagnosis.record());
            if self.diagnosis.enabled {
                port.event(now, CpEvent::Record { incoming, record: *self.diagnosis.record() });
            }
        }
        let flash = self.is_flashing(now).then_some(now.next_tick(FLASH));
        self.protocol_due.into_iter().chain(self.leds.deadline()).chain(flash).min()
    }

    fn is_working(&self) -> bool {
        self.phase == Phase::Working
    }

    fn enable_diagnostics(&mut self, enabled: bool) {
        self.diagnosis.enabled = enabled;
    }

    fn waits_for(&self) -> Option<Reason> {
        if self.diagnosis.wire_break {
            return Some(Reason::state(Why::Interrupted, 0));
        }
        // Its interfaces have no modem lines.
        self.protocol.stopped(ModemLines::default())
    }

    fn waiting(&self) -> Waiting {
        let receive = &self.exchange.receive;
        let (telegrams, progress) = (receive.telegrams(), receive.nibble().into());
        Waiting { telegrams, progress, block: 0, cpu_runs: !self.cpu_stopped && self.phase == Phase::Working }
    }
}

impl Cp040 {
    /// A module without parameters that occupies `io_bytes` bytes each way, 8 to 60.
    pub fn new(io_bytes: usize) -> Self {
        Self {
            phase: Phase::Off,
            cpu_stopped: false,
            exchange: Exchange::new(io_bytes),
            shown: [0; 60],
            parameters: None,
            setup: None,
            protocol: Protocol::None,
            protocol_due: None,
            transmitting: false,
            line_gone: false,
            line_awaited: false,
            line_broke_off: false,
            leds: LedDriver::new(),
            leds_shown: Leds::NONE,
            diagnosis: Diagnosis::new(),
        }
    }

    /// Telegrams in the receive buffer.
    pub fn received_waiting(&self) -> usize {
        self.exchange.receive.telegrams()
    }

    fn is_flashing(&mut self, now: Instant) -> bool {
        self.leds.at(now).error || self.phase == Phase::NoParameters
    }

    /// PW is RUN; ER is IF, or MF while there are no valid parameters: both flash at 2 Hz. [S3 L293]
    fn leds_at(&mut self, now: Instant) -> Leds {
        let on = self.is_flashing(now) && (now.since_start() / FLASH).is_multiple_of(2);
        Leds { error: on, power: self.phase == Phase::Working, ..self.leds.at(now) }
    }

    // ---- parameters ----

    fn parametrise(&mut self, now: Instant, bytes: &[u8; 16], port: &mut dyn CpPort) {
        if !matches!(self.protocol, Protocol::None) {
            port.take_back();
        }
        (self.protocol, self.protocol_due, self.transmitting) = (Protocol::None, None, false);
        self.clear(port);
        let decoded = Parameters::of_bytes(bytes);
        self.diagnosis.parameters = decoded.is_err();
        self.diagnosis.wire_break = false;
        let parameters = match decoded {
            Ok(parameters) => parameters,
            Err(error) => {
                port.event(now, CpEvent::NoParameters(&error));
                (self.phase, self.setup, self.parameters) = (Phase::NoParameters, None, None);
                return;
            }
        };
        let setup = Setup::of_040(&parameters, self.exchange.io_bytes(), port.lateness());
        self.leds.parameters(now, setup.is_modbus(), true);
        self.protocol = setup.build();
        self.setup = Some(setup);
        port.line_settings(&parameters.line_settings());
        self.parameters = Some(parameters);
        self.phase = Phase::Working;
        self.clear(port);
        self.diagnosis.wire_break = self.line_gone && !self.line_awaited && self.detects_break();
        port.record(self.diagnosis.record());
        port.rts(true);
        port.dtr(true);
        port.event(now, CpEvent::Working);
        self.drive(now, Input::Tick, port);
        self.look(now, port);
    }

    fn detects_break(&self) -> bool {
        self.parameters.as_ref().is_some_and(Parameters::detects_break)
    }

    /// Empties both directions: a running order is aborted, received telegrams are dropped; both are counted.
    fn clear(&mut self, port: &mut dyn CpPort) {
        let telegrams_max = self.parameters.as_ref().map_or(1, Parameters::receive_buffers);
        let (aborted, dropped) = self.exchange.clear(telegrams_max);
        if aborted {
            port.count(Counter::OrdersAborted, 1);
        }
        if dropped > 0 {
            port.count(Counter::ReceiveAborted, dropped as u64);
        }
    }

    // ---- the host ----

    fn look(&mut self, now: Instant, port: &mut dyn CpPort) {
        // The outputs of a stopped CPU are not a command; its start brings new parameters.
        if self.phase != Phase::Working || self.cpu_stopped {
            return;
        }
        let io_bytes = self.exchange.io_bytes();
        if let Some(slave) = self.protocol.slave()
            && !slave.config().confirmed
        {
            // "Slave short": what the master reads is the output area itself.
            let stored = slave.set_input(&self.exchange.outputs()[..io_bytes]);
            debug_assert!(stored, "the area is as large as the process image");
            return;
        }
        match self.exchange.look() {
            Step::Reset => self.reset(now, port),
            Step::Both(sending, receiving) => {
                self.received(now, receiving, port);
                self.commanded(now, sending, port);
            }
        }
    }

    /// "Execute a reset on the CP": buffers and protocol start again.
    fn reset(&mut self, now: Instant, port: &mut dyn CpPort) {
        port.take_back();
        self.clear(port);
        self.transmitting = false;
        if let Some(setup) = &self.setup {
            self.protocol = setup.build();
        }
        port.event(now, CpEvent::Working);
        self.drive(now, Input::Tick, port);
    }

    fn commanded(&mut self, now: Instant, step: send::Step, port: &mut dyn CpPort) {
        match step {
            send::Step::Wait | send::Step::Stored => {}
            send::Step::Discarded | send::Step::BadOrder => port.event(now, CpEvent::OrderDiscarded { code: None }),
            send::Step::BadLength => port.event(now, CpEvent::OrderDiscarded { code: Some(SendError::TooLong.code()) }),
            send::Step::Complete => {
                port.count(Counter::OrdersAccepted, 1);
                port.event(now, CpEvent::Order(self.exchange.send.telegram()));
                if let Some(slave) = self.protocol.slave() {
                    let stored = slave.set_input(self.exchange.send.telegram());
                    self.ended(now, if stored { Ok(()) } else { Err(SendError::TooLong) }, port);
                } else if self.line_gone && !self.protocol.is_acknowledged() {
                    self.ended(now, Err(SendError::Frame), port);
                } else {
                    self.step_protocol(now, None, port);
                }
            }
        }
    }

    fn received(&mut self, now: Instant, step: receive::Step, port: &mut dyn CpPort) {
        if let receive::Step::Delivered(bytes) = step {
            if let Some(bytes) = bytes {
                port.count(Counter::TelegramsDelivered, 1);
                port.event(now, CpEvent::Delivered(bytes));
            }
            if let Some(slave) = self.protocol.slave() {
                slave.change_taken(true);
            }
            // The buffer has become free: a protocol may have made its partner wait for that.
            self.drive(now, Input::Tick, port);
        }
    }

    fn publish(&mut self, port: &mut dyn CpPort) {
        let io_bytes = self.exchange.io_bytes();
        let inputs = match self.phase {
            Phase::Off | Phase::NoParameters => [0; 60],
            Phase::Working => self.image().unwrap_or_else(|| self.exchange.inputs()),
        };
        if inputs != self.shown {
            self.shown = inputs;
            port.inputs(&inputs[..io_bytes]);
        }
    }

    /// "Slave short": the input area is what the master has written.
    fn image(&self) -> Option<Area> {
        let Protocol::ModbusSlave(slave) = &self.protocol else { return None };
        let mut image = [0; 60];
        for (to, from) in image.iter_mut().zip(slave.areas().output()) {
            *to = *from;
        }
        (!slave.config().confirmed).then_some(image)
    }

    // ---- the line and the protocol ----

    fn line(&mut self, now: Instant, line: LineInput<'_>, port: &mut dyn CpPort) {
        // Two wires: "data is exchanged ... but only in one direction at a time". What arrives while we send is our own
        // echo. [S3 L347]
        let is_half = self.parameters.as_ref().is_some_and(|p| p.duplex == Duplex::Half);
        let (mut input, was_gone) = (line, self.line_gone);
        match line {
            LineInput::Rx(_) if is_half && self.transmitting => return,
            LineInput::Rx(_) => {
                self.diagnosis.wire_break &= self.line_gone;
                self.leds.received(now);
            }
            LineInput::TxDone => {
                self.transmitting = false;
                self.leds.transmit(false);
            }
            LineInput::Fault(LineFault::Gone) => {
                (self.line_gone, self.line_awaited) = (true, false);
                self.diagnosis.wire_break = self.detects_break();
                self.leds.line(now, true);
            }
            LineInput::Fault(LineFault::Back) => {
                (self.line_gone, self.line_awaited) = (false, false);
                self.diagnosis.wire_break = false;
                self.leds.line(now, false);
            }
            LineInput::Fault(_) if is_half && self.transmitting => return,
            LineInput::Fault(LineFault::Break) => {
                if self.detects_break() {
                    self.diagnosis.wire_break = true;
                } else {
                    // Nobody evaluates BREAK, so it counts as a character without a stop bit.
                    input = LineInput::Fault(LineFault::Framing);
                }
                self.leds.error(now);
            }
            LineInput::Fault(_) => self.leds.error(now),
            LineInput::Modem(_) => {}
        }
        port.count_line(line, was_gone);
        if self.phase != Phase::Working {
            return;
        }
        self.drive(now, Input::Line(input), port);
        if self.line_gone && self.exchange.send.is_transmitting() && !self.protocol.is_acknowledged() {
            self.line_broke_off = true;
            self.drive(now, Protocol::ABORT, port);
            self.line_broke_off = false;
        }
    }

    fn drive(&mut self, now: Instant, input: Input<'_>, port: &mut dyn CpPort) {
        self.step_protocol(now, Some(input), port);
    }

    /// A step of the protocol; without an input it gets the complete telegram.
    fn step_protocol(&mut self, now: Instant, input: Option<Input<'_>>, port: &mut dyn CpPort) {
        let mut out = Outlet {
            now,
            receive: &mut self.exchange.receive,
            leds: &mut self.leds,
            port,
            tells_errors: self.protocol.is_heard_once(),
            transmitting: &mut self.transmitting,
            outcome: None,
        };
        let input = input.unwrap_or(Input::Order(Order::Send(self.exchange.send.telegram())));
        self.protocol_due = self.protocol.step(now, input, &mut out);
        if let Some(outcome) = out.outcome {
            self.ended(now, outcome, port);
        }
        self.offer_change(now, port);
        if !self.cpu_stopped {
            // An acknowledgement was evaluated when it came, unless the CPU was in STOP then: it counts now.
            let step = self.exchange.look_receive();
            self.received(now, step, port);
        }
    }

    /// Modbus slave "long": what the master has changed goes to the CPU with its place, the offset word. [S3 L11]
    fn offer_change(&mut self, now: Instant, port: &mut dyn CpPort) {
        let Some(slave) = self.protocol.slave().filter(|slave| slave.config().confirmed) else { return };
        let Some(change) = slave.take_change() else { return };
        let mut blocks = [0; BLOCK_BYTES * BLOCKS_TOGETHER];
        let Some(blocks) = blocks.get_mut(..change.bytes) else { return };
        let Some(area) = slave.areas().output().get(change.first..change.first + change.bytes) else { return };
        blocks.copy_from_slice(area);
        if self.exchange.receive.push(Some(change.first as u16), blocks) {
            port.count(Counter::TelegramsReceived, 1);
            port.event(now, CpEvent::Changed(change.bytes));
        }
    }

    fn ended(&mut self, now: Instant, outcome: Result<(), SendError>, port: &mut dyn CpPort) {
        let outcome = port.order_ended(now, outcome, self.line_broke_off);
        self.exchange.send.ended(outcome);
        // The end is shown before a waiting command is evaluated.
        self.publish(port);
        if !self.cpu_stopped {
            let step = self.exchange.look_send();
            self.commanded(now, step, port);
        }
    }
}
