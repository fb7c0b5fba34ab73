//! Couplers on two wires, in virtual time, with characters lost, doubled and changed, and couplers switched off, by
//! seeds. The couplers are slaves of `ob1-protocols`.

use ob1_coupler::config::{Parity, Span};
use ob1_coupler::{
    BusConfig, CouplerConfig, Image, LineConfig, LineMaster, MasterInput, Order, Range, Serial, State, Table,
};
use ob1_fakes::sink::MachineLog;
use ob1_line::LineSettings;
use ob1_line::sim::{BusConfig as WiresConfig, FaultRates, Frame, Participant, SimBus, SplitMix64};
use ob1_protocols::modbus::{Mode, Slave, frame, slave};
use ob1_protocols::{Input, Instant, LineFault, LineInput, Machine as _};

const MS: Span = Span::MILLISECOND;
const COUPLERS: usize = 4;
/// Bytes of each, each way.
const BYTES: usize = 8;

struct Coupler {
    slave: Slave,
    who: Participant,
    deadline: Option<Instant>,
    off: bool,
}

struct Wires {
    now: Instant,
    bus: SimBus,
    master: LineMaster,
    me: Participant,
    deadline: Instant,
    image: Image,
    couplers: Vec<Coupler>,
    lost: Vec<u32>,
}

fn config() -> BusConfig {
    let range = |table, n: usize| Range { table, first: 0, count: 4, order: Order::Big, at: BYTES * n };
    let couplers = (0..COUPLERS).map(|n| CouplerConfig {
        name: format!("c{n}"),
        unit: n as u8 + 1,
        period: 50 * MS,
        refresh: 500 * MS,
        lost_after: 1000 * MS,
        setup: Vec::new(),
        proof: None,
        inputs: vec![range(Table::Input, n)],
        outputs: vec![range(Table::Holding, n)],
    });
    let serial = Some(Serial { baud: 115_200, parity: Parity::Even, stop_bits: 1 });
    let line = LineConfig {
        line: "sim:/x".into(),
        serial,
        timeout: 60 * MS,
        couplers: couplers.collect(),
        dp: None,
        gpio: None,
    };
    let bytes = BYTES * COUPLERS;
    BusConfig { name: "b".into(), input_bytes: bytes, output_bytes: bytes, scan_timeout: 1000 * MS, lines: vec![line] }
}

impl Wires {
    fn new(faults: FaultRates, seed: u64) -> Self {
        let config = config();
        let settings = LineSettings { baud: 115_200, parity: Parity::Even, ..LineSettings::default() };
        let mut bus = SimBus::new(WiresConfig { faults, ..WiresConfig::new(true) }, seed);
        let me = bus.join(Frame::of(&settings));
        let frame = frame::Config::new(Mode::Rtu, settings.baud, settings.time_of(1)).with_bursts(faults.delay_max);
        let coupler = |n| Coupler {
            slave: Slave::new(slave::Config { frame: frame.clone(), address: n, area_bytes: 16, confirmed: false }),
            who: bus.join(Frame::of(&settings)),
            deadline: None,
            off: false,
        };
        let couplers = (1..=COUPLERS as u8).map(coupler).collect();
        let mut image = Image::new(&config);
        image.driven = true;
        let master = LineMaster::new(&config.lines[0], 0, config.input_bytes, Instant::START);
        let lost = vec![0; COUPLERS];
        let mut wires = Self { now: Instant::START, bus, master, me, deadline: Instant::START, image, couplers, lost };
        wires.ask(Input::Line(LineInput::Fault(LineFault::Back)));
        wires
    }

    fn ask(&mut self, input: MasterInput<'_>) {
        let mut out = Vec::new();
        let before: Vec<State> = self.image.status.iter().map(|status| status.state).collect();
        self.deadline = self.master.step(self.now, input, &mut self.image, &mut out);
        for (n, was) in before.into_iter().enumerate() {
            self.lost[n] += u32::from(was != State::Lost && self.image.status[n].state == State::Lost);
        }
        self.bus.write(self.me, self.now, &out);
    }

    /// A coupler gets its power back: its state is lost.
    fn switch(&mut self, n: usize, off: bool) {
        let coupler = &mut self.couplers[n];
        if coupler.off && !off {
            coupler.slave = Slave::new(coupler.slave.config().clone());
            coupler.deadline = None;
        }
        coupler.off = off;
    }

    fn tell(&mut self, n: usize, input: Input<'_>) {
        let coupler = &mut self.couplers[n];
        if coupler.off {
            return;
        }
        let mut mouth = MachineLog::with_room(0);
        coupler.deadline = coupler.slave.step(self.now, input, &mut mouth);
        self.bus.write(coupler.who, self.now, &mouth.sent.concat());
    }

    fn run(&mut self, time: Span) {
        let until = self.now + time;
        let mut buffer = [0; 256];
        loop {
            let slaves = self.couplers.iter().filter(|c| !c.off).filter_map(|c| c.deadline);
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
                } else if let Some(n) = self.couplers.iter().position(|coupler| coupler.who == who) {
                    self.tell(n, Input::Line(input));
                }
            }
            if self.deadline <= self.now {
                self.ask(Input::Tick);
            }
            for n in 0..COUPLERS {
                if self.couplers[n].deadline.is_some_and(|at| at <= self.now) {
                    self.tell(n, Input::Tick);
                }
            }
        }
    }

    /// The same word in all registers of each coupler: every reading must have equal words too.
    fn sense(&mut self, round: u16) {
        for (n, coupler) in self.couplers.iter_mut().enumerate() {
            let word = (round ^ (n as u16) << 12).to_be_bytes();
            assert!(coupler.slave.set_input(&word.repeat(BYTES / 2)));
        }
    }

    fn drive(&mut self, round: u16) {
        for n in 0..COUPLERS {
            let word = (round.wrapping_mul(3) ^ (n as u16) << 12).to_be_bytes();
            self.image.outputs[BYTES * n..BYTES * (n + 1)].copy_from_slice(&word.repeat(BYTES / 2));
        }
        self.ask(Input::Tick);
    }

    /// Nothing is half read or half written, and there are no invented values.
    fn check(&self, round: u16, seed: u64) {
        for (n, coupler) in self.couplers.iter().enumerate() {
            let whole = |bytes: &[u8], most: u16, what: &str| {
                let word = u16::from_be_bytes([bytes[0], bytes[1]]);
                assert!(bytes.chunks(2).all(|pair| pair == &bytes[..2]), "seed {seed}: {what} {n} torn: {bytes:02X?}");
                let value = word ^ (n as u16) << 12;
                assert!(word == 0 || value <= most, "seed {seed}: {what} {n} made up: {bytes:02X?}");
            };
            whole(&self.image.inputs[BYTES * n..BYTES * (n + 1)], round, "input");
            whole(&coupler.slave.areas().output()[..BYTES], round * 3, "output");
        }
    }
}

#[test]
fn four_couplers_share_two_wires() {
    let mut wires = Wires::new(FaultRates::NONE, 1);
    for round in 1..40 {
        wires.sense(round);
        wires.drive(round);
        wires.run(100 * MS);
        wires.check(round, 1);
        for n in 0..COUPLERS {
            let word = (round ^ (n as u16) << 12).to_be_bytes();
            assert_eq!(wires.image.inputs[BYTES * n..BYTES * n + 2], word, "round {round}, coupler {n}");
        }
    }
    assert!(wires.image.status.iter().all(|status| status.state == State::Running && status.failures == 0));
    assert!(wires.image.status.iter().all(|status| status.exchanges >= 78), "{:?}", wires.image.status);
    assert_eq!(wires.bus.collisions(), 0);
}

#[test]
fn a_hundred_lines_on_which_much_goes_wrong() {
    let faults = FaultRates {
        flip: 3000,
        lose: 1500,
        double: 1500,
        delay: 500,
        parity: 1500,
        framing: 1000,
        break_: 200,
        delay_max: 5 * MS,
    };
    for seed in 0..100 {
        let mut random = SplitMix64::new(seed);
        let mut wires = Wires::new(faults, seed);
        let mut switched = [0; COUPLERS];
        for round in 1..60 {
            wires.sense(round);
            wires.drive(round);
            if random.below(8) == 0 {
                let n = random.below(COUPLERS as u64) as usize;
                let off = !wires.couplers[n].off;
                wires.switch(n, off);
                switched[n] += u32::from(wires.couplers[n].off);
            }
            wires.run(50 * MS + random.span_below(150 * MS));
            wires.check(round, seed);
        }
        (0..COUPLERS).for_each(|n| wires.switch(n, false));
        wires.run(4000 * MS);
        wires.sense(100);
        wires.drive(100);
        wires.run(2000 * MS);
        wires.check(100, seed);
        for (n, status) in wires.image.status.iter().enumerate() {
            assert_eq!(status.state, State::Running, "seed {seed}, coupler {n}: {status:?}");
            assert!(u64::from(wires.lost[n]) == status.losses, "seed {seed}, coupler {n}: {status:?}");
            assert!(wires.lost[n] <= switched[n] + 1, "seed {seed}, coupler {n}: lost more often than it was off");
            let word = (100 ^ (n as u16) << 12_u16).to_be_bytes();
            assert_eq!(wires.image.inputs[BYTES * n..BYTES * n + 2], word, "seed {seed}, coupler {n}");
        }
        let failures: u64 = wires.image.status.iter().map(|status| status.failures).sum();
        assert!(failures > 20, "seed {seed}: nothing went wrong");
    }
}
