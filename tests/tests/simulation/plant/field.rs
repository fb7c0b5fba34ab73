//! The connection between a master and its devices: wires with faults, or a TCP connection that is closed and opened.

use std::collections::VecDeque;

use ob1_coupler::{Input, LineFault, LineInput, MasterInput};
use ob1_line::sim::{BusConfig as WiresConfig, FaultRates, Frame, Participant, SimBus, SplitMix64};
use ob1_line::{LineSettings, Parity};
use ob1_tests::coupler::{Stream, framed};
use ob1_tests::sim::MS;
use ob1_time::{Instant, Span};

use super::device::Device;

/// Passes an input to a master; returns its output, and whether the connection must be opened again.
pub(crate) trait Ask: FnMut(MasterInput<'_>) -> (Vec<u8>, bool) {}
impl<T: FnMut(MasterInput<'_>) -> (Vec<u8>, bool)> Ask for T {}

pub(crate) enum Field {
    Wires(Box<Wires>),
    Net(Box<Net>),
}

pub(crate) struct Wires {
    bus: SimBus,
    me: Participant,
    devices: Vec<(Participant, Device)>,
    quiet: Span,
}

pub(crate) struct Net {
    device: Device,
    rng: SplitMix64,
    open: bool,
    /// Time at which it is opened; whether this was requested.
    opens: Instant,
    there: VecDeque<(Instant, Vec<u8>)>,
    back: VecDeque<(Instant, Vec<u8>)>,
    stream: Stream,
}

impl Field {
    pub(crate) fn wires(baud: u32, faults: FaultRates, seed: u64, devices: Vec<Device>) -> Self {
        let settings = LineSettings { baud, parity: Parity::Even, ..LineSettings::default() };
        let mut bus = SimBus::new(WiresConfig { faults, ..WiresConfig::new(true) }, seed);
        let me = bus.join(Frame::of(&settings));
        let devices = devices.into_iter().map(|device| (bus.join(Frame::of(&settings)), device)).collect();
        Self::Wires(Box::new(Wires {
            bus,
            me,
            devices,
            quiet: (settings.time_of(7) / 2).max(Span::from_nanos(1_750_000)),
        }))
    }

    pub(crate) fn net(seed: u64, device: Device) -> Self {
        Self::Net(Box::new(Net {
            device,
            rng: SplitMix64::new(seed),
            open: false,
            opens: Instant::NEVER,
            there: VecDeque::new(),
            back: VecDeque::new(),
            stream: Stream::default(),
        }))
    }

    pub(crate) fn devices(&mut self) -> Vec<&mut Device> {
        match self {
            Self::Wires(wires) => wires.devices.iter_mut().map(|(_, device)| device).collect(),
            Self::Net(net) => vec![&mut net.device],
        }
    }

    /// Time of the next event.
    pub(crate) fn next(&self) -> Instant {
        match self {
            Self::Wires(wires) => {
                let devices = wires.devices.iter().map(|(_, device)| device.deadline);
                devices.chain(wires.bus.next_event()).fold(Instant::NEVER, Instant::min)
            }
            Self::Net(net) => {
                let fronts = [net.there.front(), net.back.front()];
                fronts.into_iter().flatten().map(|(at, _)| *at).fold(net.opens, Instant::min)
            }
        }
    }

    /// The process has started and opens its line.
    pub(crate) fn begin(&mut self, now: Instant, ask: &mut impl Ask) {
        match self {
            Self::Wires(_) => self.tell(now, Input::Line(LineInput::Fault(LineFault::Back)), ask),
            Self::Net(net) => net.opens = now + MS,
        }
    }

    /// The process has ended, and its data in transit are lost.
    pub(crate) fn end(&mut self, now: Instant) {
        match self {
            Self::Wires(wires) => drop(wires.bus.take_back(wires.me, now)),
            Self::Net(net) => net.close(Instant::NEVER),
        }
    }

    /// Passes an input to the master.
    pub(crate) fn tell(&mut self, now: Instant, input: MasterInput<'_>, ask: &mut impl Ask) {
        let (said, reconnect) = ask(input);
        match self {
            Self::Wires(wires) => wires.bus.write(wires.me, now, &said),
            Self::Net(net) => {
                if net.open && !said.is_empty() {
                    let at = now + Span::from_micros(100) + net.rng.span_below(Span::from_micros(400));
                    net.there.push_back((at.max(net.there.back().map_or(Instant::START, |(at, _)| *at)), said));
                }
                if reconnect {
                    net.close(now + 20 * MS);
                    ask(Input::Line(LineInput::Fault(LineFault::Gone)));
                }
            }
        }
    }

    /// Handles everything that is due.
    pub(crate) fn advance(&mut self, now: Instant, ask: &mut impl Ask) {
        self.devices().into_iter().for_each(|device| device.look(now));
        match self {
            Self::Wires(_) => self.advance_wires(now, ask),
            Self::Net(_) => self.advance_net(now, ask),
        }
    }

    fn advance_wires(&mut self, now: Instant, ask: &mut impl Ask) {
        let mut buffer = [0; 256];
        loop {
            let Self::Wires(wires) = self else { return };
            let Some((who, event)) = wires.bus.pop(now, &mut buffer) else { break };
            let Some(input) = event.input(&buffer) else { continue };
            if who == wires.me {
                self.tell(now, Input::Line(input), ask);
            } else {
                wires.tell(now, who, Input::Line(input));
            }
        }
        let Self::Wires(wires) = self else { return };
        let due = wires.devices.iter().filter(|(_, device)| now >= device.deadline).map(|(who, _)| *who);
        for who in due.collect::<Vec<_>>() {
            wires.tell(now, who, Input::Tick);
        }
    }

    fn advance_net(&mut self, now: Instant, ask: &mut impl Ask) {
        let Self::Net(net) = self else { return };
        if now >= net.opens {
            if net.device.is_reached(now) {
                (net.open, net.opens, net.stream) = (true, Instant::NEVER, Stream::default());
                return self.tell(now, Input::Line(LineInput::Fault(LineFault::Back)), ask);
            }
            net.opens = now + 50 * MS;
        }
        while net.there.front().is_some_and(|(at, _)| now >= *at) {
            let (_, bytes) = net.there.pop_front().expect("looked at");
            net.hear(now, &bytes);
        }
        // A device that has lost its power has also lost the connection.
        if net.open && !net.device.has_power(now) {
            net.close(now + 50 * MS);
            return self.tell(now, Input::Line(LineInput::Fault(LineFault::Gone)), ask);
        }
        loop {
            let Self::Net(net) = self else { return };
            if net.back.front().is_none_or(|(at, _)| now < *at) {
                return;
            }
            let Some((_, bytes)) = net.back.pop_front() else { return };
            self.tell(now, Input::Line(LineInput::Rx(&bytes)), ask);
        }
    }
}

impl Wires {
    fn tell(&mut self, now: Instant, who: Participant, input: MasterInput<'_>) {
        if let Some((_, device)) = self.devices.iter_mut().find(|(other, _)| *other == who) {
            let said = device.on_wires(now, input, self.quiet);
            self.bus.write(who, now, &said);
        }
    }
}

impl Net {
    fn close(&mut self, opens: Instant) {
        (self.open, self.opens) = (false, opens);
        (self.there, self.back) = (VecDeque::new(), VecDeque::new());
    }

    /// The device receives bytes and answers, sometimes late.
    fn hear(&mut self, now: Instant, bytes: &[u8]) {
        if !self.device.is_reached(now) {
            return;
        }
        let Self { device, stream, back, rng, .. } = self;
        let fine = stream.take(bytes, |transaction, telegram| {
            let answer = device.asked(now, telegram);
            let late =
                if rng.below(200) == 0 { rng.span_below(80 * MS) } else { rng.span_below(Span::from_micros(400)) };
            let at = (now + Span::from_micros(100) + late).max(back.back().map_or(Instant::START, |(at, _)| *at));
            back.push_back((at, framed(transaction, &answer)));
        });
        assert!(fine, "the master speaks Modbus");
    }
}
