//! The module: start-up, the two handshakes, the protocol, and the bookkeeping between them.

/// The outlet of a CP for one step. Not a method, because the protocol and the telegram to send are borrowed at the
/// same time.
macro_rules! outlet {
    ($cp:ident, $now:ident, $port:ident) => {
        $crate::cp240::outlet::Outlet {
            now: $now,
            ring: &mut $cp.receive.ring,
            is_fragmented: $cp.setup.as_ref().is_some_and($crate::protocol::Setup::is_fragmented),
            rk512: &mut $cp.rk512,
            leds: &mut $cp.leds,
            modem: &mut $cp.modem,
            diagnosis: &mut $cp.diagnosis,
            settings: &mut $cp.settings,
            port: $port,
            outcome: None,
        }
    };
}

mod modem;
mod outlet;
pub(crate) mod receive;
mod rk512;
mod rk512_side;
mod send;

use ob1_params::{Cp240 as Parameters, Interface, LineSettings};
use ob1_protocols::rk512::Order as Rk512Order;
use ob1_protocols::{Event, Input, Instant, LineFault, LineInput, Order, Rk512, SendError, What};

use crate::choose_reason::{Reason, Waiting, Why};
use crate::diagnosis::{Diagnosis, Kind};
use crate::leds::{LedDriver, Leds};
use crate::modbus;
use crate::port::{Counter, Cp, CpEvent, CpInput, CpPort, StartReason};
use crate::protocol::{Protocol, Setup};
use crate::ring::Capacity;
use modem::Modem;
use ob1_words::cp240::{NO_PARAMETERS, RESET, Registers, STARTUP, SYSTEM, block, compose, rx_word, tx_word};
use receive::ReceiveSide;
use rk512_side::Rk512Side;
use send::SendSide;

/// Protocol codes (parameter byte 1) of the Modbus modes. [S0 "Modbus - Parameterization"]
const MODBUS_CODES: [u8; 6] = [0x0A, 0x0B, 0x0C, 0x0D, 0x1C, 0x1D];

/// How far the start-up has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No parameters have come yet: all registers read 0.
    Off,
    /// No valid parameters; the byte that is wrong.
    NoParameters(u8),
    /// The start-up identifier is shown.
    Identify,
    /// It was acknowledged; the CPU must now clear the acknowledgement.
    Clearing,
    /// Start-up is over: orders and telegrams are passed on.
    Working,
}

/// A CP 240.
///
/// Laws for the owner:
/// * time never goes backwards; [`CpInput::Tick`] is due at the latest at the time that [`Cp240::step`] returned;
/// * the current output registers are passed in before the first [`CpInput::Parameters`]: their content is from before
///   the start and must not be taken for an answer;
/// * sixteen zeros as parameters stand for "none": the module then works with its defaults [S0 L2118].
#[derive(Debug)]
pub struct Cp240 {
    phase: Phase,
    /// Number of the start-up, 1 to 255.
    number: u8,
    /// The CPU is in STOP.
    cpu_stopped: bool,
    /// The registers contain a reset request that has been answered.
    reset_seen: bool,
    outputs: Registers,
    shown: Registers,

    /// Which interface it has.
    interface: Interface,
    /// Its parameters, if they are valid.
    parameters: Option<Parameters>,
    setup: Option<Setup>,
    /// How the line is set.
    settings: Option<LineSettings>,
    /// Capacity of the receive buffer.
    capacity: Capacity,
    protocol: Protocol,
    protocol_due: Option<Instant>,
    send: SendSide,
    receive: ReceiveSide,
    /// RK 512, used instead of `protocol`.
    rk512_machine: Option<Box<Rk512>>,
    /// Its receive side, used instead of `receive`.
    rk512: Rk512Side,
    /// RK 512: an order of the CPU waits until the previous one has ended.
    order_waits: bool,
    /// RK 512: the reaction to an order of the machine before may still come.
    reaction_owed: bool,

    line_gone: bool,
    /// The order was aborted because the line is gone.
    line_broke_off: bool,
    modem: Modem,
    leds: LedDriver,
    leds_shown: Leds,
    diagnosis: Diagnosis,
}

impl Cp for Cp240 {
    fn step(&mut self, now: Instant, input: CpInput<'_>, port: &mut dyn CpPort) -> Option<Instant> {
        match input {
            CpInput::Tick => {
                if self.protocol_due.is_some_and(|due| now >= due) {
                    self.drive(now, Input::Tick, port);
                }
            }
            CpInput::Outputs(outputs) => {
                for (to, from) in self.outputs.iter_mut().zip(outputs) {
                    *to = *from;
                }
                self.look(now, port);
            }
            CpInput::Line(line) => self.line(now, line, port),
            CpInput::NoLine => {
                port.count(Counter::LineFaults, 1);
                self.line_gone = true;
            }
            CpInput::CpuRun(true) => {
                if core::mem::take(&mut self.cpu_stopped) {
                    self.leds.stop_run();
                }
                self.order_rk512(now, Rk512Order::Serve(true), port);
            }
            CpInput::CpuRun(false) => {
                self.cpu_stopped = true;
                self.order_rk512(now, Rk512Order::Serve(false), port);
                // The rest of a telegram will never come, whatever the registers show.
                if self.send.discard() {
                    port.event(now, CpEvent::OrderDiscarded { code: None });
                }
            }
            CpInput::Parameters(bytes) => self.parametrise(now, bytes, port),
            CpInput::Keys(_) | CpInput::Channel(..) => {}
        }
        self.publish(port);
        let leds = self.leds.at(now);
        port.show(leds, &mut self.leds_shown);
        if self.phase != Phase::Off
            && let Some((incoming, data)) = self.diagnosis.tell(leds.error)
            && self.parameters.as_ref().is_none_or(|parameters| parameters.protocol.has_diagnostics())
        {
            port.event(now, CpEvent::Diagnosis { incoming, data });
        }
        self.protocol_due.into_iter().chain(self.leds.deadline()).min()
    }

    fn is_working(&self) -> bool {
        self.phase == Phase::Working
    }

    fn enable_diagnostics(&mut self, enabled: bool) {
        self.diagnosis.enabled = enabled;
    }

    fn set_interface(&mut self, interface: Interface) {
        self.interface = interface;
        self.modem.set_interface(interface);
    }

    fn waits_for(&self) -> Option<Reason> {
        match self.phase {
            Phase::Off | Phase::NoParameters(_) => None,
            // A CPU in STOP calls no FC 9.
            Phase::Identify | Phase::Clearing => (!self.cpu_stopped).then_some(Reason::state(Why::StartUp, STARTUP)),
            Phase::Working => self.protocol.stopped(self.modem.lines().unwrap_or_default()),
        }
    }

    fn waiting(&self) -> Waiting {
        let cpu_runs = !self.cpu_stopped && self.phase == Phase::Working;
        if self.rk512_machine.is_some() {
            let (telegrams, progress) = self.rk512.waiting();
            return Waiting { telegrams, progress, block: 4, cpu_runs };
        }
        let (telegrams, progress) = (self.receive.ring.telegrams(), self.receive.word().into());
        let is_fragmented = self.setup.as_ref().is_some_and(Setup::is_fragmented);
        Waiting { telegrams, progress, block: if is_fragmented { 11 } else { 1 }, cpu_runs }
    }
}

impl Cp240 {
    /// A module without parameters.
    ///
    /// `generation` counts the processes that have run this module. Successive processes start with numbers far apart,
    /// because a new process does not know how many resets its predecessor has seen.
    pub const fn new(generation: u64) -> Self {
        Self {
            phase: Phase::Off,
            number: (generation.wrapping_mul(37) % 255) as u8,
            cpu_stopped: false,
            reset_seen: false,
            outputs: [0; 16],
            shown: [0; 16],
            interface: Interface::Rs232,
            parameters: None,
            setup: None,
            settings: None,
            capacity: Capacity::buffers(1),
            protocol: Protocol::None,
            protocol_due: None,
            send: SendSide::new(),
            receive: ReceiveSide::new(),
            rk512_machine: None,
            rk512: Rk512Side::new(),
            order_waits: false,
            reaction_owed: generation > 1,
            line_gone: false,
            line_broke_off: false,
            modem: Modem::new(),
            leds: LedDriver::switched_on(),
            leds_shown: Leds::NONE,
            diagnosis: Diagnosis::NONE,
        }
    }

    /// Telegrams in the receive buffer.
    pub fn received_waiting(&self) -> usize {
        self.receive.ring.telegrams()
    }

    // ---- start-up ----

    fn parametrise(&mut self, now: Instant, bytes: &[u8; 16], port: &mut dyn CpPort) {
        self.drop_all(port);
        self.leds.power();
        let decoded = Parameters::of_bytes(bytes);
        let is_modbus = MODBUS_CODES.contains(&bytes[1]);
        self.leds.parameters(now, is_modbus, decoded.is_ok());
        let parameters = match decoded {
            Ok(parameters) => Parameters { interface: self.interface, ..parameters },
            Err(error) => {
                port.event(now, CpEvent::NoParameters(&error));
                (self.parameters, self.setup) = (None, None);
                self.phase = Phase::NoParameters(error.byte.map_or(0, |byte| byte as u8));
                return;
            }
        };
        let setup = Setup::of(&parameters, port.lateness());
        self.leds.show_overflow_alone(setup.is_enocean());
        self.setup = Some(setup);
        self.capacity = capacity(&parameters);
        let settings = parameters.line_settings();
        self.settings = Some(settings);
        port.line_settings(&settings);
        let has_identifier = parameters.protocol.has_identifier();
        self.parameters = Some(parameters);
        if has_identifier {
            self.identify(now, StartReason::Parameters, port);
        } else {
            // "With valid parameters ... the Modbus module is ready for communication." [S0 "Commissioning"]
            self.work(now, port);
            self.send.begin(tx_word(&self.outputs));
            self.look_registers(now, port);
        }
    }

    /// Drops everything in both directions, and the protocol with it.
    fn drop_all(&mut self, port: &mut dyn CpPort) {
        let rk512 = self.drop_rk512(port);
        if rk512.is_some() || !matches!(self.protocol, Protocol::None) {
            port.take_back();
        }
        self.protocol = Protocol::None;
        self.protocol_due = None;
        if self.send.clear() && rk512.is_none() {
            port.count(Counter::OrdersAborted, 1);
        }
        let dropped = self.receive.clear(self.capacity);
        if dropped > 0 {
            port.count(Counter::ReceiveAborted, dropped as u64);
        }
    }

    /// Shows the start-up identifier with the next number.
    fn identify(&mut self, now: Instant, reason: StartReason, port: &mut dyn CpPort) {
        self.drop_all(port);
        self.number = next_number(self.number);
        // An old number in the registers would be taken for the acknowledgement.
        if tx_word(&self.outputs) == SYSTEM | u16::from(self.number) {
            self.number = next_number(self.number);
        }
        self.phase = Phase::Identify;
        port.event(now, CpEvent::Startup { number: self.number, reason });
    }

    fn work(&mut self, now: Instant, port: &mut dyn CpPort) {
        let Some(setup) = &self.setup else { return };
        self.receive.clear(self.capacity);
        (self.protocol, self.rk512_machine) = (setup.build(), setup.rk512());
        if core::mem::take(&mut self.reaction_owed)
            && let Some(machine) = &mut self.rk512_machine
        {
            machine.succeeds(now);
        }
        let long = self.protocol.slave().is_some_and(|slave| slave.config().confirmed);
        self.send.set_area(long);
        self.receive.set_area(long);
        self.send.set_framed(self.rk512_machine.is_some());
        self.phase = Phase::Working;
        self.modem.reset();
        port.rts(true);
        port.dtr(true);
        port.event(now, CpEvent::Working);
        self.drive(now, Input::Tick, port);
        self.order_rk512(now, Rk512Order::Serve(!self.cpu_stopped), port);
        if let Some(lines) = self.modem.lines() {
            self.drive(now, Input::Line(LineInput::Modem(lines)), port);
        }
    }

    // ---- the CPU's registers ----

    fn look(&mut self, now: Instant, port: &mut dyn CpPort) {
        let (rx, tx) = (rx_word(&self.outputs), tx_word(&self.outputs));
        let reset = rx == RESET;
        let asked = reset
            && !self.reset_seen
            && self.parameters.as_ref().is_some_and(|parameters| parameters.protocol.has_identifier());
        self.reset_seen = reset;
        match self.phase {
            Phase::Off | Phase::NoParameters(_) => {}
            Phase::Identify | Phase::Clearing | Phase::Working if asked => {
                self.identify(now, StartReason::ResetRequest, port);
            }
            Phase::Identify => {
                if rx == STARTUP && tx == SYSTEM | u16::from(self.number) {
                    self.phase = Phase::Clearing;
                }
            }
            Phase::Clearing => {
                // The CPU writes 0 to both. The first count of a telegram may already have overwritten it, because the
                // CPU does not wait until the CP has seen the zeros.
                if (rx | tx) & SYSTEM == 0 {
                    self.work(now, port);
                    self.look_registers(now, port);
                }
            }
            Phase::Working => self.look_registers(now, port),
        }
    }

    fn look_registers(&mut self, now: Instant, port: &mut dyn CpPort) {
        if let Some(slave) = self.protocol.slave()
            && modbus::take_image(slave, &self.outputs)
        {
            return;
        }
        self.look_send(now, port);
        if self.rk512_machine.is_some() {
            return self.look_rk512(now, port);
        }
        self.look_receive(now, port);
    }

    fn look_send(&mut self, now: Instant, port: &mut dyn CpPort) {
        match self.send.look(tx_word(&self.outputs), block(&self.outputs)) {
            send::Step::Wait | send::Step::Stored => {}
            send::Step::Discarded => port.event(now, CpEvent::OrderDiscarded { code: None }),
            send::Step::Refused(code) => port.event(now, CpEvent::OrderDiscarded { code: Some(code) }),
            send::Step::Line(command) => {
                let rts_is_free = !self.protocol.drives_rts();
                let (switched, answer) = self.modem.command(command, rts_is_free);
                if let Some(on) = switched.rts {
                    port.rts(on);
                }
                if let Some(on) = switched.dtr {
                    port.dtr(on);
                }
                self.send.answer(answer);
            }
            send::Step::Complete if self.rk512_machine.is_some() => self.handed(now, port),
            send::Step::Complete => {
                port.count(Counter::OrdersAccepted, 1);
                port.event(now, CpEvent::Order(self.send.telegram()));
                if let Some(slave) = self.protocol.slave() {
                    let output = self.send.for_output_area();
                    let data = self.send.telegram();
                    let stored = if output { slave.set_output(data) } else { slave.set_input(data) };
                    self.ended(now, if stored { Ok(()) } else { Err(SendError::TooLong) }, port);
                } else if self.line_gone && !self.protocol.is_acknowledged() {
                    self.ended(now, Err(SendError::Frame), port);
                } else {
                    self.step_protocol(now, None, port);
                }
            }
        }
    }

    fn look_receive(&mut self, now: Instant, port: &mut dyn CpPort) {
        match self.receive.look(rx_word(&self.outputs)) {
            receive::Step::Wait | receive::Step::Offered => {}
            receive::Step::PartTaken => self.drive(now, Input::Tick, port),
            receive::Step::Delivered(length) => {
                port.count(Counter::TelegramsDelivered, 1);
                port.event(now, CpEvent::Delivered(length));
                self.change_taken(true);
                // The buffer has become free: a protocol may have made its partner wait for that.
                self.drive(now, Input::Tick, port);
            }
            receive::Step::Refused => {
                port.count(Counter::ReceiveAborted, 1);
                self.change_taken(false);
                self.drive(now, Input::Tick, port);
            }
        }
    }

    fn change_taken(&mut self, stored: bool) {
        if let Some(slave) = self.protocol.slave() {
            slave.change_taken(stored);
        }
    }

    /// Publishes the input registers if they have changed.
    fn publish(&mut self, port: &mut dyn CpPort) {
        let registers = match self.phase {
            Phase::Off | Phase::Clearing => compose(0, 0, &[]),
            Phase::NoParameters(byte) => compose(NO_PARAMETERS, SYSTEM | u16::from(byte), &[]),
            Phase::Identify => compose(STARTUP, SYSTEM | u16::from(self.number), &[]),
            Phase::Working if self.rk512_machine.is_some() => {
                compose(self.rk512.rx(), self.send.echo(), self.rk512.block())
            }
            Phase::Working => match self.protocol.image() {
                Some(image) => image,
                None => compose(self.receive.word(), self.send.echo(), self.receive.block()),
            },
        };
        if registers != self.shown {
            self.shown = registers;
            port.inputs(&registers);
        }
    }

    // ---- the line and the protocol ----

    fn line(&mut self, now: Instant, line: LineInput<'_>, port: &mut dyn CpPort) {
        port.count_line(line, self.line_gone);
        match line {
            LineInput::Rx(_) => self.leds.received(now),
            LineInput::TxDone => self.leds.transmit(false),
            LineInput::Fault(LineFault::Gone) => {
                self.line_gone = true;
                self.leds.line(now, true);
                self.diagnosis.error(Kind::OpenCircuit, 0);
            }
            LineInput::Fault(LineFault::Back) => {
                self.line_gone = false;
                self.leds.line(now, false);
            }
            LineInput::Fault(fault) => {
                self.leds.error(now);
                let event = Event { phase: ob1_protocols::Phase::Idle, what: What::Line(fault) };
                self.diagnosis.error(Kind::Line, event.number().unwrap_or(0));
            }
            LineInput::Modem(lines) => self.modem.input(lines),
        }
        // Until the CPU has acknowledged the start-up, received data is discarded.
        if self.phase != Phase::Working {
            return;
        }
        self.drive(now, Input::Line(line), port);
        let is_acknowledged = self.rk512_machine.is_some() || self.protocol.is_acknowledged();
        if self.line_gone && self.send.is_transmitting() && !is_acknowledged {
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
        let mut out = outlet!(self, now, port);
        let input = input.unwrap_or(Input::Order(Order::Send(self.send.telegram())));
        self.protocol_due = match &mut self.rk512_machine {
            // Its orders come through `handed`.
            Some(machine) => machine.step(now, input.with_orders(Rk512Order::Abort), &mut out),
            None => self.protocol.step(now, input, &mut out),
        };
        if let Some(outcome) = out.outcome {
            self.ended(now, outcome, port);
        }
        if let Some(slave) = self.protocol.slave()
            && let Some(bytes) = modbus::offer_change(slave, &mut self.receive)
        {
            port.count(Counter::TelegramsReceived, 1);
            port.event(now, CpEvent::Changed(bytes));
        }
        if self.rk512_machine.is_some() {
            return self.after_rk512(now, port);
        }
        // A telegram may have come: offer it if nothing else is shown.
        if !self.receive.is_offering() {
            self.receive.look(rx_word(&self.outputs));
        }
    }

    fn ended(&mut self, now: Instant, outcome: Result<(), SendError>, port: &mut dyn CpPort) {
        let outcome = port.order_ended(now, outcome, self.line_broke_off);
        self.send.ended(outcome.map_err(SendError::code));
        // The end is shown before a waiting count is evaluated.
        self.publish(port);
        self.look_send(now, port);
    }
}

/// Capacity of the receive buffer with these parameters.
fn capacity(parameters: &Parameters) -> Capacity {
    match parameters.protocol {
        // "send and receive data have each a reserved 2048Byte buffer" [S0 L4133]
        ob1_params::Protocol::MBus => Capacity::large(u8::MAX),
        // "... which may handle up to 150 telegrams" [S1 L941]
        ob1_params::Protocol::EnOcean => Capacity::large(150),
        _ => Capacity::buffers(parameters.receive_buffers()),
    }
}

/// 1 to 255, then 1 again.
const fn next_number(number: u8) -> u8 {
    if number == u8::MAX { 1 } else { number + 1 }
}
