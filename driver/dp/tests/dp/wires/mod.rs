//! A line with a master and slaves in virtual time.

#![allow(dead_code, reason = "each test uses its own part of it")]

use ob1_coupler::dp::{DpConfig, DpSlave};
use ob1_coupler::{BusConfig, Image, Input, LineConfig, LineFault, LineInput, MasterInput, State};
use ob1_dp::Master;
use ob1_fakes::dp_slave::{Slave, SlaveConfig};
use ob1_line::sim::{BusConfig as WiresConfig, FaultRates, Frame, Participant, SimBus, SplitMix64};
use ob1_line::{Instant, LineSettings, Parity, Span};

pub(crate) const MS: Span = Span::MILLISECOND;
/// The ident number of all slaves of the tests.
const IDENT: u16 = 0x801D;

pub(crate) struct OnLine {
    pub(crate) slave: Slave,
    who: Participant,
    deadline: Instant,
    /// It has no power.
    pub(crate) off: bool,
}

pub(crate) struct Wires {
    pub(crate) now: Instant,
    bus: SimBus,
    me: Participant,
    pub(crate) master: Master,
    deadline: Instant,
    pub(crate) image: Image,
    pub(crate) slaves: Vec<OnLine>,
    /// The master is gone.
    pub(crate) killed: bool,
    /// The slaves that the master lost, with times.
    pub(crate) losses: Vec<(Instant, usize)>,
    /// Exchanges that the master accepted.
    pub(crate) accepted: u64,
    /// Rate of damaged telegrams per million, and their number so far.
    pub(crate) damage: Option<(SplitMix64, u64)>,
    pub(crate) damaged: u64,
}

/// A bus of `slaves` slaves with `bytes` bytes each way.
pub(crate) fn config(baud: u32, slaves: usize, bytes: usize) -> BusConfig {
    let slave = |n: usize| DpSlave {
        name: format!("s{n}"),
        station: 3 + n as u8,
        ident: IDENT,
        config: vec![0x30 | (bytes as u8 - 1)],
        parameters: vec![n as u8],
        answer_bits: 60,
        lost_after: 1000 * MS,
        inputs: (n * bytes, bytes),
        outputs: (n * bytes, bytes),
        diagnosis: (slaves * bytes + n * 33, 32),
        texts: Default::default(),
        fields: Vec::new(),
    };
    let dp = DpConfig {
        baud,
        address: 2,
        hsa: 126,
        slot_bits: 300,
        retries: 3,
        watchdog: 200 * MS,
        slaves: (0..slaves).map(slave).collect(),
    };
    let line = LineConfig {
        line: "sim:/x".into(),
        serial: None,
        timeout: 200 * MS,
        couplers: Vec::new(),
        dp: Some(dp),
        gpio: None,
    };
    BusConfig {
        name: "dp".into(),
        input_bytes: slaves * (bytes + 33),
        output_bytes: slaves * bytes,
        scan_timeout: 1000 * MS,
        lines: vec![line],
    }
}

/// The slave that such a configuration describes.
pub(crate) fn slave_of(dp: &DpConfig, n: usize) -> SlaveConfig {
    let slave = &dp.slaves[n];
    SlaveConfig {
        baud: dp.baud,
        address: slave.station,
        ident: slave.ident,
        config: slave.config.clone(),
        parameters: Some(slave.parameters.clone()),
        inputs: slave.inputs.1,
        outputs: slave.outputs.1,
        delay_bits: 0,
    }
}

impl Wires {
    pub(crate) fn new(config: &BusConfig, faults: FaultRates, seed: u64) -> Self {
        let dp = config.lines[0].dp.as_ref().expect("a DP line");
        let settings = LineSettings { baud: dp.baud, parity: Parity::Even, ..LineSettings::default() };
        let mut bus = SimBus::new(WiresConfig { faults, ..WiresConfig::new(true) }, seed);
        let me = bus.join(Frame::of(&settings));
        let slaves = (0..dp.slaves.len()).map(|n| OnLine {
            slave: Slave::new(slave_of(dp, n)),
            who: bus.join(Frame::of(&settings)),
            deadline: Instant::NEVER,
            off: false,
        });
        let slaves = slaves.collect();
        let mut image = Image::new(config);
        image.driven = true;
        let master = Master::new(dp, 0, Instant::START).expect("bus parameters that hold");
        let mut wires = Self {
            now: Instant::START,
            bus,
            me,
            master,
            deadline: Instant::START,
            image,
            slaves,
            killed: false,
            losses: Vec::new(),
            accepted: 0,
            damage: None,
            damaged: 0,
        };
        wires.ask(Input::Line(LineInput::Fault(LineFault::Back)));
        wires
    }

    /// Replaces the killed master by another one, like a restarted process.
    pub(crate) fn restart_master(&mut self, config: &BusConfig) {
        let dp = config.lines[0].dp.as_ref().expect("a DP line");
        self.master = Master::new(dp, 0, self.now).expect("bus parameters that hold");
        let outputs = std::mem::take(&mut self.image.outputs);
        self.image = Image { outputs, driven: true, ..Image::new(config) };
        self.killed = false;
        self.ask(Input::Line(LineInput::Fault(LineFault::Back)));
    }

    pub(crate) fn ask(&mut self, input: MasterInput<'_>) {
        if self.killed {
            self.deadline = Instant::NEVER;
            return;
        }
        let before: Vec<(State, u64)> =
            self.image.status.iter().map(|status| (status.state, status.exchanges)).collect();
        let mut out = Vec::new();
        self.deadline = self.master.step(self.now, input, &mut self.image, &mut out);
        for (n, (state, exchanges)) in before.into_iter().enumerate() {
            let status = self.image.status[n];
            if state == State::Running && status.state != State::Running {
                self.losses.push((self.now, n));
            }
            self.accepted += status.exchanges - exchanges;
        }
        self.send(self.me, out);
    }

    /// Puts a telegram on the line; some are damaged on it.
    fn send(&mut self, who: Participant, mut telegram: Vec<u8>) {
        if let Some((rng, rate)) = self.damage.as_mut().filter(|_| !telegram.is_empty())
            && rng.below(1_000_000) < *rate
        {
            self.damaged += 1;
            let at = rng.below(telegram.len() as u64) as usize;
            // One character cannot be cut.
            match rng.below(if telegram.len() > 1 { 3 } else { 1 }) {
                0 => {
                    // Parity does not detect it.
                    let first = rng.below(8);
                    telegram[at] ^= 1 << first | 1 << ((first + 1 + rng.below(7)) % 8);
                }
                1 => drop(telegram.remove(at)),
                _ => telegram.truncate(at.max(1)),
            }
        }
        self.bus.write(who, self.now, &telegram);
    }

    fn tell(&mut self, n: usize, input: MasterInput<'_>) {
        let on = &mut self.slaves[n];
        if on.off {
            on.deadline = Instant::NEVER;
            return;
        }
        let mut out = Vec::new();
        on.deadline = on.slave.step(self.now, input, &mut out);
        let who = on.who;
        self.send(who, out);
    }

    /// Lets this much time pass; `each` is called after each event.
    pub(crate) fn run_with(&mut self, time: Span, mut each: impl FnMut(&mut Self)) {
        let until = self.now + time;
        let mut buffer = [0; 256];
        loop {
            let slaves = self.slaves.iter().map(|on| on.deadline);
            let next = slaves.chain(self.bus.next_event()).fold(self.deadline, Instant::min);
            if next > until {
                self.now = until;
                return;
            }
            self.now = self.now.max(next);
            while let Some((who, event)) = self.bus.pop(self.now, &mut buffer) {
                let Some(input) = event.input(&buffer) else { continue };
                if who == self.me {
                    self.ask(Input::Line(input));
                } else if let Some(n) = self.slaves.iter().position(|on| on.who == who) {
                    self.tell(n, Input::Line(input));
                }
            }
            if self.now >= self.deadline {
                self.ask(Input::Tick);
            }
            for n in 0..self.slaves.len() {
                if self.now >= self.slaves[n].deadline {
                    self.tell(n, Input::Tick);
                }
            }
            each(self);
        }
    }

    pub(crate) fn run(&mut self, time: Span) {
        self.run_with(time, |_| {});
    }

    pub(crate) fn violations(&self) -> Vec<String> {
        let all = self.slaves.iter().flat_map(|on| on.slave.violations().iter().cloned());
        all.chain((self.bus.collisions() > 0).then(|| format!("{} collisions", self.bus.collisions()))).collect()
    }

    pub(crate) fn states(&self) -> Vec<State> {
        self.image.status.iter().map(|status| status.state).collect()
    }

    /// Runs until all exchange data.
    pub(crate) fn start(&mut self) {
        for _ in 0..100 {
            self.run(20 * MS);
            if self.states().iter().all(|state| *state == State::Running) {
                return;
            }
        }
        panic!("not all slaves exchange data: {:?}, {:?}", self.states(), self.violations());
    }
}
