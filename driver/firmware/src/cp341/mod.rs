//! A whole CP 341, or a CP 340 (`model`), as one sans-IO machine: two channels towards the CPU, protocol, receive
//! buffer, LEDs, counters, diagnostic buffer.
//!
//! Like the CP 240 it depends only on its inputs and their times. The channels are described in
//! `docs/cp341-channels.md`.

mod channels;
mod diagnosis;
mod leds;
mod loadable;
mod model;
mod outlet;
mod patience;
mod protocol;
mod receive;
mod request;
mod send;
mod v24;

pub use ob1_words::channels::{Channel, ChannelBlock, Job};

use ob1_params::{Cp341 as Parameters, CpKind, ParamError, Protocol341};
use ob1_protocols::modbus_master_32;
use ob1_protocols::rk512::{self, AnswerError, Refusal};
use ob1_protocols::{Input, Instant, LineFault, LineInput};

use crate::choose_reason::{Reason, Waiting, Why};
use crate::leds::Leds;
use crate::port::{Counter, Cp, CpEvent, CpInput, CpPort};
use crate::protocol::signals_off;
use crate::ring::Capacity;
use diagnosis::{Diagnosis, Faults};
use model::Model;
use ob1_words::channels::Offered as Kind;
use outlet::{Collected, Outlet, Parts};
use patience::Patience;
use protocol::Protocol;
use receive::ReceiveChannel;
use send::SendChannel;
use v24::V24;

/// A CP 341, or a CP 340.
///
/// Laws for the owner: time never goes backwards; [`CpInput::Tick`] is due at the latest at the time that
/// [`Cp341::step`] returned.
#[derive(Debug)]
pub struct Cp341 {
    model: &'static Model,
    parameters: Option<Parameters>,
    parameters_wrong: bool,
    /// RK 512: the reaction to a job of the process before, or of before new parameters, may still come.
    reaction_owed: bool,
    protocol: Protocol,
    protocol_due: Option<Instant>,
    cpu_running: bool,
    send: SendChannel,
    /// The job that is with the protocol.
    sending: Option<send::Token>,
    /// The fault of the printout being output: its job ends with it.
    misprint: Option<u16>,
    receive: ReceiveChannel,
    patience: Patience,
    /// A telegram that the CPU has refused is not offered before this.
    again_at: Instant,
    parts: Parts,
    v24: V24,
    diagnosis: Diagnosis,
    leds_shown: Leds,
    shown: [ChannelBlock; 2],
}

impl Default for Cp341 {
    fn default() -> Self {
        Self::new()
    }
}

impl Cp for Cp341 {
    fn step(&mut self, now: Instant, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Instant> {
        match input {
            CpInput::Tick => {
                if self.protocol_due.is_some_and(|due| now >= due) {
                    self.drive(now, Input::Tick, port);
                }
            }
            CpInput::Channel(Channel::Send, block) => self.look_send(now, block, port),
            CpInput::Channel(Channel::Receive, block) => self.look_receive(now, block, port),
            CpInput::Outputs(outputs) => {
                // With fewer bytes than a CP 341 has, the segment belongs to another module.
                if let Some(outputs) = outputs.first_chunk() {
                    if self.v24.reset(outputs) {
                        self.reset_buffer(port);
                    }
                    self.v24.set(outputs, self.protocol.driven(), port);
                }
            }
            CpInput::Line(line) => self.line(now, line, port),
            CpInput::NoLine => {
                port.count(Counter::LineFaults, 1);
                self.parts.line_gone = true;
            }
            CpInput::CpuRun(run) => self.cpu(now, run, port),
            CpInput::Keys(parameters) => self.parametrise(now, parameters, port),
            // This CP takes its parameters as keys.
            CpInput::Parameters(_) => {}
        }
        self.diagnose(now, port);
        self.offer(now);
        self.watch_cpu(now, port);
        self.publish(port);
        let v24_due = self.v24.refresh(now, port);
        port.show(self.parts.leds.at(now, self.parts.interrupted), &mut self.leds_shown);
        let again = Some(self.again_at).filter(|at| now < *at);
        let own = [self.parts.leds.deadline(now), v24_due, self.patience.deadline(), again];
        self.protocol_due.into_iter().chain(own.into_iter().flatten()).min()
    }

    fn is_working(&self) -> bool {
        !matches!(self.protocol, Protocol::None)
    }

    fn enable_diagnostics(&mut self, enabled: bool) {
        self.diagnosis.enabled = enabled;
    }

    fn waits_for(&self) -> Option<Reason> {
        if self.parts.interrupted {
            return Some(Reason::state(Why::Interrupted, 0));
        }
        let lines = self.v24.lines().unwrap_or_default();
        if self.parts.leds.are_signals_missing() {
            return Some(signals_off(lines));
        }
        self.protocol.stopped(lines)
    }

    fn waiting(&self) -> Waiting {
        let offered = usize::from(self.receive.awaits_cpu() && !self.parts.on_offer);
        let jobs = offered + usize::from(self.parts.asked.open().is_some());
        let telegrams = self.parts.ring.telegrams() + jobs;
        Waiting { telegrams, progress: self.receive.moves(), block: 0, cpu_runs: self.cpu_running }
    }
}

impl Cp341 {
    /// A CP 341 without parameters.
    pub fn new() -> Self {
        Self::of(CpKind::Cp341, 1)
    }

    /// The CP of this type, without parameters. `generation` counts the processes that have run this module.
    pub fn of(kind: CpKind, generation: u64) -> Self {
        let model = Model::of(kind);
        Self {
            model,
            parameters: None,
            parameters_wrong: false,
            reaction_owed: generation > 1,
            protocol: Protocol::None,
            protocol_due: None,
            cpu_running: false,
            send: SendChannel::new(model),
            sending: None,
            misprint: None,
            receive: ReceiveChannel::new(),
            patience: Patience::default(),
            again_at: Instant::START,
            parts: Parts::new(kind),
            v24: V24::new(),
            diagnosis: Diagnosis::new(model),
            leds_shown: Leds::NONE,
            shown: [[0; 64]; 2],
        }
    }

    /// Which type it is.
    pub const fn kind(&self) -> CpKind {
        self.model.kind
    }

    /// Reports wire breaks and wrong parameters that have come or gone. [CP 341 manual 09/2008, p. 204]
    fn diagnose(&mut self, now: Instant, port: &mut dyn CpPort) {
        let found = Faults { wire_break: self.parts.interrupted, parameters: self.parameters_wrong };
        for number in self.diagnosis.find(found) {
            port.event(now, CpEvent::EntryGone(number));
        }
        if let Some(record) = self.diagnosis.record() {
            port.record(&record);
        }
        if let Some((incoming, data)) = self.diagnosis.interrupt() {
            port.event(now, CpEvent::Diagnosis { incoming, data });
        }
    }

    // ---- start-up ----

    fn parametrise(&mut self, now: Instant, parameters: Result<&Parameters, &ParamError>, port: &mut dyn CpPort) {
        self.parameters_wrong = parameters.is_err();
        match parameters {
            // They come with each STOP -> RUN; the same ones change nothing.
            // [TIA help "Configuration for point-to-point links"]
            Ok(new) if self.parameters.as_ref() == Some(new) => self.enter(now, 0x0004, port),
            Ok(new) => {
                self.drop_all(now, port);
                self.parts.leds.parameters(now, true);
                self.parameters = Some(new.clone());
                port.line_settings(&new.line_settings());
                self.parts.ring.clear(capacity(self.model, new));
                self.protocol = Protocol::of(new, port.lateness());
                if std::mem::take(&mut self.reaction_owed)
                    && let Protocol::Rk512(machine) = &mut self.protocol
                {
                    machine.succeeds(now);
                }
                self.parts.burst_gap = 4 * new.line_settings().char_time() + port.lateness();
                self.parts.heard_once = !self.protocol.is_acknowledged();
                // "When the module is switched on, all output signals are in OFF state"; a driver that uses them
                // switches them itself. [TIA help "PtP data link CP 341"], [S4 L590]
                self.v24.off(port);
                port.event(now, CpEvent::Working);
                self.enter(now, 0x0003, port);
                self.drive(now, Input::Tick, port);
                if let Some(lines) = self.v24.lines() {
                    self.drive(now, Input::Line(LineInput::Modem(lines)), port);
                }
                self.serve(now, port);
            }
            Err(error) => {
                self.drop_all(now, port);
                self.parts.leds.parameters(now, false);
                self.parameters = None;
                port.event(now, CpEvent::NoParameters(error));
                self.enter(now, 0x020F, port);
            }
        }
    }

    /// New parameters: "active requests are aborted, telegrams in the CP are lost". [CP 440 manual 03/2022]
    fn drop_all(&mut self, now: Instant, port: &mut dyn CpPort) {
        if self.is_working() {
            self.drive(now, Protocol::ABORT, port);
        }
        if let Protocol::Rk512(machine) = &self.protocol {
            self.reaction_owed = machine.is_owed_a_reaction();
        }
        self.protocol = Protocol::None;
        self.protocol_due = None;
        self.clear_buffer(Capacity::of_bytes(self.model.bytes, u8::MAX), port);
        self.parts.untold.clear();
        if self.receive.offered() == Some(Kind::Telegram) {
            self.withdraw(port);
        }
        if self.receive.offered().is_some() {
            self.receive.ended(Err(0x0501));
        }
    }

    /// P_RESET: all waiting telegrams are dropped; the one that P_RCV is taking is completed.
    fn reset_buffer(&mut self, port: &mut dyn CpPort) {
        let Some(parameters) = &self.parameters else { return };
        if !self.protocol.is_plain() {
            return;
        }
        let capacity = capacity(self.model, parameters);
        if std::mem::take(&mut self.parts.on_offer) {
            self.parts.ring.pop();
        }
        self.clear_buffer(capacity, port);
    }

    /// Drops the waiting telegrams.
    fn clear_buffer(&mut self, capacity: Capacity, port: &mut dyn CpPort) {
        let dropped = self.parts.ring.telegrams();
        if dropped > 0 {
            port.count(Counter::ReceiveAborted, dropped as u64);
        }
        self.parts.ring.clear(capacity);
    }

    fn cpu(&mut self, now: Instant, run: bool, port: &mut dyn CpPort) {
        if self.cpu_running == run {
            return;
        }
        self.cpu_running = run;
        if run && let Some(capacity) = self.parameters.as_ref().and_then(|p| cleared(self.model, p)) {
            self.clear_buffer(capacity, port);
        }
        self.diagnosis.cpu(run);
        self.enter(now, if run { 0x0008 } else { 0x0007 }, port);
        if !run {
            // "All send and receive jobs stop"; a job that the protocol already has continues to its end, but nobody
            // waits for it.
            self.send.off();
            if self.receive.offered() == Some(Kind::Telegram) {
                self.withdraw(port);
            }
            self.receive.off();
            self.parts.untold.clear();
            // Nobody would take the slave's reply.
            self.order_loadable(now, modbus_master_32::Order::Abort, port);
        }
        self.serve(now, port);
    }

    /// RK 512 answers jobs of the partner with 2Ah while the CPU is in STOP. (docs/cp341.md)
    fn serve(&mut self, now: Instant, port: &mut dyn CpPort) {
        let serves = self.cpu_running;
        self.order_rk512(now, rk512::Order::Serve(serves), port);
    }

    // ---- the line and the protocol ----

    fn line(&mut self, now: Instant, line: LineInput<'_>, port: &mut dyn CpPort) {
        port.count_line(line, self.parts.line_gone);
        match line {
            LineInput::Rx(_) => {
                self.parts.interrupted = false;
                self.parts.leds.received(now);
            }
            LineInput::TxDone => self.parts.leds.transmit(false),
            LineInput::Fault(LineFault::Gone) => self.parts.line_gone = true,
            LineInput::Fault(LineFault::Back) => (self.parts.line_gone, self.parts.interrupted) = (false, false),
            LineInput::Fault(_) => {}
            LineInput::Modem(lines) => {
                self.v24.input(lines);
                if lines.cts && lines.dsr {
                    self.parts.leds.signals_missing(false);
                }
            }
        }
        self.drive(now, Input::Line(line), port);
        // "BREAK: receiving line to partner device is interrupted" [S4 L1750]; a protocol that has noticed it has
        // already reported it.
        let is_gone = line == LineInput::Fault(LineFault::Gone);
        if is_gone && !std::mem::replace(&mut self.parts.interrupted, true) {
            self.enter(now, 0x080D, port);
        }
        self.break_off(now, port);
    }

    /// Without acknowledgements a job that is sent on a lost line must not count as done.
    fn break_off(&mut self, now: Instant, port: &mut dyn CpPort) {
        if self.parts.line_gone && !self.protocol.is_acknowledged() && self.protocol.busy() {
            self.parts.first_error.get_or_insert(0x0708);
            self.drive(now, Protocol::ABORT, port);
        }
    }

    fn drive(&mut self, now: Instant, input: Input<'_>, port: &mut dyn CpPort) {
        let mut out = self.parts.outlet(now, self.receive.is_taking(), port);
        self.protocol_due = self.protocol.step(now, input, &mut out);
        let collected = out.collected;
        self.after(now, collected, port);
    }

    /// An order for RK 512 that is not a telegram; with another protocol nothing happens.
    fn order_rk512(&mut self, now: Instant, order: rk512::Order<'_>, port: &mut dyn CpPort) {
        let Protocol::Rk512(machine) = &mut self.protocol else { return };
        let mut out: Outlet<'_> = self.parts.outlet(now, self.receive.is_taking(), port);
        self.protocol_due = machine.step(now, Input::Order(order), &mut out);
        let collected = out.collected;
        self.after(now, collected, port);
    }

    /// An order for the loadable driver; with another protocol nothing happens.
    fn order_loadable(&mut self, now: Instant, order: modbus_master_32::Order<'_>, port: &mut dyn CpPort) {
        let Protocol::Loadable(driver) = &mut self.protocol else { return };
        let mut out = self.parts.outlet(now, self.receive.is_taking(), port);
        self.protocol_due = driver.step(now, Input::Order(order), &mut out);
        let collected = out.collected;
        self.after(now, collected, port);
    }

    /// Carries out the results of a protocol step.
    fn after(&mut self, now: Instant, collected: Collected, port: &mut dyn CpPort) {
        self.v24.switched(collected.rts, collected.dtr);
        if let Some((outcome, waited)) = collected.answered {
            self.answered(now, outcome, waited, port);
        }
        let Some(outcome) = collected.ended else { return };
        let outcome = outcome.and_then(|len| self.misprint.take().map_or(Ok(len), Err));
        match outcome {
            Ok(_) => {
                port.count(Counter::TelegramsSent, 1);
                port.event(now, CpEvent::Sent);
            }
            Err(status) => {
                port.count(Counter::SendErrors, 1);
                port.event(now, CpEvent::JobFailed(status));
                if matches!(self.protocol, Protocol::Loadable(_)) && self.parts.ring.oldest().is_some() {
                    // Nobody has taken the reply.
                    self.parts.ring.pop();
                    self.parts.on_offer = false;
                    port.count(Counter::ReceiveAborted, 1);
                    self.receive.ended(Err(status));
                }
            }
        }
        if self.sending.take() == Some(self.send.token()) {
            self.send.ended(outcome.map(|len| self.parts.fetched(len)));
        }
        // A job may have come while a reset job ran to its end.
        self.begin(now, port);
    }

    /// RK 512: the job of the partner is over. `waited`: the block had not begun with it.
    fn answered(&mut self, now: Instant, outcome: Result<(), AnswerError>, waited: bool, port: &mut dyn CpPort) {
        match outcome {
            Ok(()) => {
                if self.receive.offered().is_some() {
                    port.count(Counter::TelegramsDelivered, 1);
                    self.receive.ended(Ok(()));
                } else {
                    port.count(Counter::ReceiveAborted, 1);
                }
            }
            Err(error) => {
                port.count(Counter::ReceiveAborted, 1);
                let offered = self.receive.offered().is_some();
                let status = match error {
                    AnswerError::Line(_) => 0x0612,
                    // "receive impossible: given up after 10 s" (docs/cp341-events.md); in STOP there was no waiting.
                    AnswerError::Withdrawn(Refusal::Mode) if self.cpu_running => {
                        self.enter(now, 0x0409, port);
                        0x0409
                    }
                    AnswerError::Withdrawn(refusal) => refusal.number(),
                    AnswerError::Abandoned => Refusal::Sequence.number(),
                    AnswerError::Aborted => 0x0501,
                };
                if waited && error == AnswerError::Aborted {
                    self.enter(now, status, port);
                }
                if offered {
                    // The block's own job ends with this STATUS, so it is not reported a second time.
                    self.parts.untold.forget(status);
                }
                self.receive.ended(Err(status));
            }
        }
        port.event(now, CpEvent::Answered(outcome));
    }

    /// Writes into the diagnostic buffer.
    fn enter(&mut self, now: Instant, number: u16, port: &mut dyn CpPort) {
        port.event(now, CpEvent::Entry(number));
    }
}

/// Capacity of the receive buffer: ASCII has parameters for it. [TIA help "Configuration for point-to-point links"]
const fn capacity(model: &Model, parameters: &Parameters) -> Capacity {
    match &parameters.protocol {
        Protocol341::Ascii(p) if p.overwrites => Capacity::of_bytes(model.bytes, 1).newest(),
        Protocol341::Ascii(p) => Capacity::of_bytes(model.bytes, p.receive_buffers),
        _ => Capacity::of_bytes(model.bytes, u8::MAX),
    }
}

/// The same, if a start-up of the CPU empties it: CP 340. [CP 340 manual 04/2011, p. 72]
const fn cleared(model: &Model, parameters: &Parameters) -> Option<Capacity> {
    match &parameters.protocol {
        Protocol341::Ascii(p) if p.clear_buffer => Some(capacity(model, parameters)),
        Protocol341::S3964(p) if p.clear_buffer => Some(capacity(model, parameters)),
        _ => None,
    }
}
