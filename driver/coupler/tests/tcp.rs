//! A coupler on a connection, in virtual time: its requests, their times, and the effect of its answers.

mod device;

use ob1_coupler::config::{Instant, Span};
use std::collections::VecDeque;

use device::Device;
use ob1_coupler::{
    BusConfig, CouplerConfig, Image, Input, LineConfig, LineFault, LineInput, LineMaster, MasterInput, Order, Profile,
    Range, Setup, State, Table,
};
use ob1_protocols::modbus::tcp;

const MS: Span = Span::MILLISECOND;
const LATENCY: Span = Span::from_micros(500);

fn range(table: Table, first: u16, count: u16, at: usize) -> Range {
    Range { table, first, count, order: Order::Big, at }
}

fn coupler(unit: u8, inputs: Vec<Range>, outputs: Vec<Range>) -> CouplerConfig {
    CouplerConfig {
        name: format!("rio{unit}"),
        unit,
        period: 10 * MS,
        refresh: 200 * MS,
        lost_after: 300 * MS,
        setup: Vec::new(),
        proof: None,
        inputs,
        outputs,
    }
}

/// A connection with couplers.
struct Net {
    now: Instant,
    config: BusConfig,
    master: LineMaster,
    image: Image,
    devices: Vec<Device>,
    receiver: tcp::Receiver,
    /// Bytes in transit to the master.
    back: VecDeque<(Instant, Vec<u8>)>,
    /// Unusual durations of the next answers.
    delays: VecDeque<Span>,
    open: bool,
    /// The connection is being made until then.
    opens_at: Option<Instant>,
    reconnects: u32,
    deadline: Instant,
    states: Vec<(usize, State)>,
}

impl Net {
    fn new(couplers: Vec<CouplerConfig>) -> Self {
        let bytes = |ranges: &[Range]| ranges.iter().map(|range| range.at + range.bytes()).max().unwrap_or(0);
        let config = BusConfig {
            name: "plant".into(),
            input_bytes: couplers.iter().map(|coupler| bytes(&coupler.inputs)).max().unwrap_or(0),
            output_bytes: couplers.iter().map(|coupler| bytes(&coupler.outputs)).max().unwrap_or(0),
            scan_timeout: 1000 * MS,
            lines: vec![LineConfig {
                line: "tcp:x:502".into(),
                serial: None,
                timeout: 50 * MS,
                couplers,
                dp: None,
                gpio: None,
            }],
        };
        // The process reads what the runtime writes.
        let text = serde_json::to_string(&config).expect("JSON");
        assert_eq!(serde_json::from_str::<BusConfig>(&text).expect("JSON"), config);
        let line = &config.lines[0];
        let mut image = Image::new(&config);
        image.driven = true;
        Self {
            now: Instant::START,
            master: LineMaster::new(line, 0, config.input_bytes, Instant::START),
            image,
            devices: line.couplers.iter().map(|coupler| Device::new(coupler.unit)).collect(),
            receiver: tcp::Receiver::new(),
            back: VecDeque::new(),
            delays: VecDeque::new(),
            open: false,
            opens_at: Some(Instant::START),
            reconnects: 0,
            deadline: Instant::START,
            states: Vec::new(),
            config,
        }
    }

    fn step(&mut self, input: MasterInput<'_>) {
        let before: Vec<State> = self.image.status.iter().map(|status| status.state).collect();
        let mut out = Vec::new();
        self.deadline = self.master.step(self.now, input, &mut self.image, &mut out);
        for (n, (was, status)) in before.into_iter().zip(&self.image.status).enumerate() {
            if was != status.state {
                self.states.push((n, status.state));
            }
        }
        for byte in out {
            if self.receiver.byte(byte).expect("a frame") {
                let (transaction, telegram) = self.receiver.telegram().expect("whole");
                let device = self.devices.iter_mut().find(|device| device.unit == telegram[0]).expect("it is there");
                if let Some(answer) = device.answer(self.now, telegram) {
                    let mut frame = [0; tcp::FRAME_BYTES];
                    let len = tcp::encode(transaction, &answer, &mut frame).expect("it fits");
                    let latency = self.delays.pop_front().unwrap_or(LATENCY);
                    self.back.push_back((self.now + latency, frame[..len].to_vec()));
                }
            }
        }
        if self.master.wants_reconnect() {
            self.reconnects += 1;
            self.cut(20 * MS);
        }
    }

    /// The connection is lost; another one is made after a time.
    fn cut(&mut self, time: Span) {
        self.open = false;
        self.back.clear();
        self.receiver = tcp::Receiver::new();
        self.opens_at = Some(self.now + time);
        self.step(Input::Line(LineInput::Fault(LineFault::Gone)));
    }

    fn run(&mut self, time: Span) {
        let until = self.now + time;
        loop {
            let answer = self.back.front().map_or(Instant::NEVER, |(at, _)| *at);
            let next = answer.min(self.deadline).min(self.opens_at.unwrap_or(Instant::NEVER));
            if next > until {
                self.now = until;
                return;
            }
            self.now = self.now.max(next);
            if self.opens_at.is_some_and(|at| at <= self.now) {
                (self.open, self.opens_at) = (true, None);
                self.step(Input::Line(LineInput::Fault(LineFault::Back)));
            } else if answer <= self.now {
                let (_, bytes) = self.back.pop_front().expect("looked at");
                // In two pieces, as a stream may.
                let (one, two) = bytes.split_at(bytes.len() / 2);
                self.step(Input::Line(LineInput::Rx(one)));
                self.step(Input::Line(LineInput::Rx(two)));
            } else {
                self.step(Input::Tick);
            }
        }
    }

    /// The CPU has written outputs.
    fn write(&mut self, at: usize, bytes: &[u8]) {
        self.image.outputs[at..at + bytes.len()].copy_from_slice(bytes);
        self.step(Input::Tick);
    }

    /// Function codes of the requests to a device since the last call.
    fn functions(&mut self, device: usize) -> Vec<u8> {
        self.devices[device].log.drain(..).map(|(_, request)| request[1]).collect()
    }
}

#[test]
fn inputs_come_with_the_period_and_outputs_when_they_change() {
    use Table::{Coil, Discrete, Holding, Input};
    let inputs = vec![range(Holding, 0, 2, 0), range(Input, 100, 1, 4), range(Discrete, 0, 12, 6)];
    let outputs = vec![range(Coil, 16, 3, 0), range(Holding, 200, 2, 1)];
    let mut net = Net::new(vec![coupler(1, inputs, outputs)]);
    let device = &mut net.devices[0];
    device.holding.extend([(0, 0x1122), (1, 0x3344)]);
    device.input.insert(100, 0x5566);
    device.discrete.extend([0, 9, 11]);
    net.run(9 * MS);
    assert_eq!(net.image.inputs, [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x01, 0x0A]);
    assert_eq!(net.states, [(0, State::Running)]);
    // Both outputs once, the holding registers together with those that are read; the rest by table.
    assert_eq!(net.functions(0), [0x0F, 0x02, 0x17, 0x04], "coils, bits, both, words");
    net.run(90 * MS);
    let functions = net.functions(0);
    assert_eq!(functions.iter().filter(|code| **code == 0x03).count(), 9, "once a period: {functions:?}");
    assert!(functions.iter().all(|code| matches!(code, 2..=4)), "no output has changed: {functions:?}");

    net.write(0, &[0b101, 0xAA, 0xBB, 0xCC, 0xDD]);
    net.run(3 * MS);
    assert_eq!(net.functions(0)[..2], [0x0F, 0x10], "at once, not with the next period");
    let device = &net.devices[0];
    assert_eq!(device.coils.iter().copied().collect::<Vec<_>>(), [16, 18]);
    assert_eq!((device.holding[&200], device.holding[&201]), (0xAABB, 0xCCDD));
    net.run(250 * MS);
    let again = net.functions(0).into_iter().filter(|code| matches!(code, 0x0F | 0x10 | 0x17)).count();
    assert_eq!(again, 2, "refreshed once");

    // STOP: off, whatever the image says.
    net.image.driven = false;
    net.step(ob1_coupler::Input::Tick);
    net.run(3 * MS);
    assert!(net.master.has_told_outputs(&net.image));
    let device = &net.devices[0];
    assert!(device.coils.is_empty() && device.holding[&200] == 0 && device.holding[&201] == 0);
}

#[test]
fn what_a_coupler_refuses_is_told_and_the_rest_goes_on() {
    use Table::{Holding, Input};
    let inputs = vec![range(Input, 0, 1, 0), range(Input, 10, 1, 2)];
    let outputs = vec![range(Holding, 0, 1, 0), range(Holding, 10, 1, 2)];
    let mut net = Net::new(vec![coupler(1, inputs, outputs)]);
    net.devices[0].input.extend([(0, 1), (10, 2)]);
    net.devices[0].refused = vec![10];
    net.image.outputs = vec![0, 5, 0, 6];
    net.run(100 * MS);
    let status = net.image.status[0];
    assert_eq!((status.state, status.bad), (State::Running, 0b1010), "second input, second output");
    let refusal = status.refusal.expect("told");
    assert_eq!((refusal.exception, refusal.first), (2, 10));
    assert_eq!(net.image.inputs, [0, 1, 0, 0]);
    assert_eq!(net.devices[0].holding[&0], 5);
    let writes = net.functions(0).iter().filter(|code| **code == 6).count();
    assert_eq!(writes, 2, "a refused write is not repeated at once");
    net.devices[0].refused.clear();
    net.run(1100 * MS);
    let status = net.image.status[0];
    assert_eq!((status.bad, status.refusal), (0, None));
    assert_eq!((&net.image.inputs[..], net.devices[0].holding[&10]), (&[0, 1, 0, 2][..], 6));
    assert_eq!(net.states, [(0, State::Running)]);
}

/// Each exception of a coupler, or of the gateway in front of it, and its message to the user.
#[test]
fn every_exception_is_told_in_words_with_what_helps() {
    for (exception, state, words, helps) in [
        (1, State::Running, "illegal function", "take another table"),
        (2, State::Running, "illegal address", "counted from 0"),
        (3, State::Running, "illegal value", "see its manual"),
        (4, State::Running, "device failure", "look at the device"),
        (5, State::Running, "acknowledge", "a longer `period`"),
        (6, State::Running, "busy", "a longer `period`"),
        (8, State::Running, "memory parity error", "damaged"),
        (10, State::Lost, "gateway path unavailable", "`unit`"),
        (11, State::Lost, "gateway target does not respond", "power and cable"),
        (99, State::Running, "unknown", "manual"),
    ] {
        let inputs = vec![range(Table::Input, 7, 1, 0)];
        let mut net = Net::new(vec![coupler(1, inputs, Vec::new())]);
        net.run(100 * MS);
        assert_eq!((net.image.status[0].state, net.image.status[0].refusal), (State::Running, None));
        (net.devices[0].exception, net.devices[0].refused) = (exception, vec![7]);
        net.run(1000 * MS);
        let status = net.image.status[0];
        assert_eq!(status.state, state, "exception {exception}");
        let told = status.refusal.map(|refusal| refusal.to_string()).unwrap_or_default();
        let begin = format!("refuses function 04h at input:7: exception {exception:02X}h, {words}; ");
        assert!(told.starts_with(&begin) && told.contains(helps), "{told}");
        net.devices[0].refused.clear();
        net.run(2000 * MS);
        assert_eq!((net.image.status[0].state, net.image.status[0].refusal), (State::Running, None), "{exception}");
    }
}

/// A coupler whose inputs and outputs are holding registers: function 17h can exchange both at once.
fn words_both_ways() -> Net {
    let inputs = vec![range(Table::Holding, 0, 2, 0)];
    let outputs = vec![range(Table::Holding, 2, 2, 0)];
    let mut net = Net::new(vec![coupler(1, inputs, outputs)]);
    net.image.outputs = vec![1, 2, 3, 4];
    net
}

#[test]
fn function_17h_is_left_out_where_it_is_not_known() {
    let mut net = words_both_ways();
    net.devices[0].knows_both = false;
    net.run(9 * MS);
    assert_eq!(net.functions(0), [0x17, 0x10, 0x03]);
    assert_eq!(net.devices[0].holding[&2], 0x0102);
    assert_eq!((net.image.status[0].bad, net.image.status[0].state), (0, State::Running));
    net.run(300 * MS);
    assert!(!net.functions(0).contains(&0x17), "not on this connection");
}

/// Simple couplers do not refuse a function that they do not know: they do not answer it.
#[test]
fn function_17h_is_left_out_where_it_is_never_answered() {
    let mut net = words_both_ways();
    net.devices[0].ignores_both = true;
    net.run(100 * MS);
    let mut functions = net.functions(0);
    assert_eq!(functions[..3], [0x17, 0x10, 0x03]);
    assert_eq!((net.image.status[0].state, net.devices[0].holding[&2]), (State::Running, 0x0102));
    for _ in 0..5 {
        net.cut(20 * MS);
        net.run(200 * MS);
        functions.extend(net.functions(0));
    }
    assert_eq!(functions.iter().filter(|code| **code == 0x17).count(), 1, "{functions:?}");
    assert_eq!((net.states.clone(), net.reconnects), (vec![(0, State::Running)], 0));
}

/// Several of them on one line, and a short `lost_after`: to find it out takes longer, and none of them is lost for it.
/// One that is away at that time is asked again, and one that knows the function uses it.
#[test]
fn to_find_out_about_function_17h_loses_no_coupler() {
    let both_ways = |unit: u8| {
        let at = 4 * usize::from(unit - 1);
        let (inputs, outputs) = (range(Table::Holding, 0, 2, at), range(Table::Holding, 2, 2, at));
        CouplerConfig { lost_after: 150 * MS, ..coupler(unit, vec![inputs], vec![outputs]) }
    };
    let mut net = Net::new((1..=6).map(both_ways).collect());
    net.image.outputs = vec![1; 24];
    for device in 0..5 {
        net.devices[device].ignores_both = true;
    }
    net.devices[4].ignores_both = false;
    net.devices[4].silent = true;
    net.run(1500 * MS);
    net.devices[4].silent = false;
    net.run(1500 * MS);
    for device in [0, 1, 2, 3, 5] {
        let losses = net.image.status[device].losses;
        assert_eq!((net.image.status[device].state, losses), (State::Running, 0), "{device}");
    }
    assert_eq!(net.image.status[4].state, State::Running);
    let asked = [0, 1, 2, 3].map(|device| net.functions(device).iter().filter(|code| **code == 0x17).count());
    assert_eq!(asked, [1; 4]);
    for device in [4, 5] {
        let functions = net.functions(device);
        let after_a_read = functions.iter().skip_while(|code| **code != 3).any(|code| *code == 0x17);
        assert!(after_a_read, "{functions:?}");
    }
}

#[test]
fn a_coupler_that_closes_the_connection_at_function_17h_is_exchanged_with() {
    let mut net = words_both_ways();
    net.devices[0].ignores_both = true;
    for _ in 0..6 {
        net.run(25 * MS);
        let functions = net.functions(0);
        if functions.last() == Some(&0x17) {
            net.cut(5 * MS);
        }
    }
    assert_eq!((net.image.status[0].state, net.devices[0].holding[&2]), (State::Running, 0x0102));
    assert_eq!(net.states, [(0, State::Running)]);
}

/// Exception 06h: the request comes too early, and is to be repeated.
#[test]
fn a_coupler_that_is_busy_for_a_moment_is_asked_again() {
    let inputs = vec![range(Table::Input, 7, 1, 0)];
    let outputs = vec![range(Table::Holding, 9, 1, 0)];
    let mut net = Net::new(vec![coupler(1, inputs, outputs)]);
    net.devices[0].input.insert(7, 0x0102);
    net.run(100 * MS);
    (net.devices[0].exception, net.devices[0].refused) = (6, vec![7, 9]);
    net.write(0, &[0, 5]);
    net.run(50 * MS);
    let status = net.image.status[0];
    assert_eq!((status.state, status.bad, status.refusal), (State::Running, 0, None));
    assert!((4..=8).contains(&status.exceptions), "{status:?}");
    assert_eq!(net.image.inputs, [1, 2], "they keep their values");
    net.devices[0].refused.clear();
    net.run(20 * MS);
    assert_eq!(net.devices[0].holding.get(&9), Some(&5), "much earlier than a refused output");
}

#[test]
fn a_silent_coupler_is_lost_after_its_time_and_is_set_up_when_it_returns() {
    let mut config = coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Holding, 0, 1, 0)]);
    config.setup = Profile::Wago750.reset().into_iter().chain(Profile::Wago750.watchdog(500 * MS)).collect();
    let mut net = Net::new(vec![config, coupler(2, vec![range(Table::Input, 0, 1, 2)], Vec::new())]);
    net.image.outputs = vec![0, 7];
    net.run(100 * MS);
    let registers: Vec<u16> =
        net.devices[0].log.iter().take(3).map(|(_, r)| u16::from_be_bytes([r[2], r[3]])).collect();
    assert_eq!(registers, [0x1008, 0x1000, 0x100A], "before anything else");
    net.devices[0].log.clear();

    net.devices[0].silent = true;
    let fell = net.now;
    net.devices[1].input.insert(0, 9);
    net.run(280 * MS);
    assert_eq!(net.image.status[0].state, State::Running, "not yet");
    net.run(30 * MS);
    assert_eq!(net.image.status[0].state, State::Lost);
    assert_eq!(net.image.inputs[3], 9, "the other one goes on");
    net.run(5000 * MS);
    let asked = net.devices[0].log.iter().filter(|(at, _)| *at > fell + 1000 * MS).count();
    assert!((3..=6).contains(&asked), "with pauses: {asked}");
    net.devices[0].silent = false;
    net.devices[0].log.clear();
    net.devices[0].holding.clear();
    net.run(1100 * MS);
    assert_eq!(net.image.status[0].state, State::Running);
    assert_eq!(net.devices[0].holding[&0x1000], 5, "set up again");
    assert_eq!(net.devices[0].holding[&0], 7, "and has its outputs again");
    let of_first: Vec<State> = net.states.iter().filter(|(n, _)| *n == 0).map(|(_, state)| *state).collect();
    assert_eq!(of_first, [State::Running, State::Lost, State::Running], "no flicker");
    assert_eq!(net.image.status[0].losses, 1);
}

#[test]
fn a_connection_that_is_cut_shortly_loses_nothing_but_is_set_up_again() {
    let mut config = coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Coil, 0, 1, 0)]);
    config.setup = vec![Setup { table: Table::Coil, at: 4144, value: 1 }];
    let mut net = Net::new(vec![config]);
    net.image.outputs = vec![1];
    net.run(50 * MS);
    for _ in 0..5 {
        net.devices[0].coils.clear();
        net.cut(100 * MS);
        net.run(150 * MS);
        assert_eq!(net.devices[0].coils.iter().copied().collect::<Vec<_>>(), [0, 4144]);
    }
    assert_eq!(net.states, [(0, State::Running)]);
}

#[test]
fn a_connection_on_which_nobody_answers_is_opened_anew() {
    let mut net = Net::new(vec![coupler(1, vec![range(Table::Input, 0, 1, 0)], Vec::new())]);
    net.run(50 * MS);
    net.devices[0].silent = true;
    net.run(1000 * MS);
    assert!((2..=6).contains(&net.reconnects), "{}", net.reconnects);
    net.devices[0].silent = false;
    net.run(300 * MS);
    assert_eq!(net.image.status[0].state, State::Running);
}

#[test]
fn a_coupler_that_refuses_its_setup_is_not_driven() {
    let mut config = coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Holding, 0, 1, 0)]);
    config.setup = Profile::BeckhoffBk.watchdog(100 * MS);
    let mut net = Net::new(vec![config]);
    net.devices[0].refused = vec![0x1120];
    net.image.outputs = vec![0, 7];
    net.run(3000 * MS);
    assert_eq!(net.states, [(0, State::Refused)], "it answers: it is not lost");
    assert_eq!(net.devices[0].holding.get(&0), None, "no output without its watchdog");
    let refusal = net.image.status[0].refusal.expect("told");
    assert_eq!((refusal.function, refusal.exception, refusal.first), (6, 2, 0x1120));
    net.devices[0].refused.clear();
    net.run(1100 * MS);
    assert_eq!((net.image.status[0].state, net.image.status[0].refusal), (State::Running, None));
    assert_eq!(net.devices[0].holding[&0], 7);
}

/// The network was down for longer than the watchdog's time, but not long enough to lose the coupler.
#[test]
fn a_coupler_whose_watchdog_has_expired_is_set_up_again() {
    let mut config = coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Holding, 0, 1, 0)]);
    config.setup = Profile::Wago750.reset().into_iter().chain(Profile::Wago750.watchdog(100 * MS)).collect();
    let mut net = Net::new(vec![config]);
    net.image.outputs = vec![0, 7];
    net.run(100 * MS);
    for _ in 0..3 {
        net.devices[0].expired = true;
        net.devices[0].holding.clear();
        net.run(300 * MS);
        assert!(!net.devices[0].expired);
        assert_eq!((net.devices[0].holding[&0x1000], net.devices[0].holding[&0]), (1, 7));
    }
    assert_eq!((net.states.clone(), net.image.status[0].bad), (vec![(0, State::Running)], 0));
    // If it answers like this to everything, its inputs count as refused, and it is not asked endlessly.
    net.devices[0].refused = vec![0x1008];
    net.devices[0].expired = true;
    net.devices[0].log.clear();
    net.run(3000 * MS);
    let status = &net.image.status[0];
    assert!(status.state == State::Refused || status.bad != 0, "{status:?}");
    assert!(net.devices[0].log.len() < 700, "{}", net.devices[0].log.len());
}

/// To set it, it must be stopped, and a process that dies at that moment would leave the outputs on.
#[test]
fn a_watchdog_that_runs_is_not_stopped() {
    let mut config = coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Holding, 0, 1, 0)]);
    config.setup = Profile::Wago750.reset().into_iter().chain(Profile::Wago750.watchdog(300 * MS)).collect();
    config.proof = Profile::Wago750.proof(300 * MS, config.setup.len());
    config.setup.push(Setup { table: Table::Holding, at: 77, value: 5 });
    let stops = |net: &mut Net| {
        let log = net.devices[0].log.drain(..);
        log.filter(|(_, request)| (request[1], request[2..4] == [0x10, 0x08]) == (6, true)).count()
    };
    let mut net = Net::new(vec![config]);
    net.run(100 * MS);
    assert_eq!(stops(&mut net), 1, "it did not run");
    for (time, running, expected) in [(3, 1, 0), (3, 2, 1), (3, 0, 1), (4, 1, 1)] {
        net.devices[0].holding.clear();
        net.devices[0].holding.extend([(0x1000, time), (0x1006, running)]);
        net.cut(20 * MS);
        net.run(100 * MS);
        assert_eq!(stops(&mut net), expected, "time {time}, running {running}");
        assert_eq!(net.devices[0].holding.get(&77), Some(&5), "what the station file says is written all the same");
    }
    // One that does not have these registers.
    net.devices[0].refused = vec![0x1000];
    net.cut(20 * MS);
    net.run(100 * MS);
    assert_eq!(stops(&mut net), 1);
    assert_eq!(net.states[0], (0, State::Running));
}

/// It may have lost power, and with it the setting of its watchdog.
#[test]
fn a_coupler_that_missed_two_requests_is_set_up_again() {
    let mut config = coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Holding, 0, 1, 0)]);
    config.setup = Profile::Wago750.watchdog(100 * MS);
    let mut net = Net::new(vec![config]);
    net.image.outputs = vec![0, 7];
    net.run(100 * MS);
    net.devices[0].silent = true;
    net.run(120 * MS);
    net.devices[0].silent = false;
    net.devices[0].holding.clear();
    net.run(100 * MS);
    assert_eq!(net.states, [(0, State::Running)], "it was not lost");
    assert_eq!((net.devices[0].holding.get(&0x1000), net.devices[0].holding.get(&0)), (Some(&1), Some(&7)));
}

#[test]
fn outputs_that_never_stand_still_leave_the_inputs_their_turn() {
    let mut net = Net::new(vec![coupler(1, vec![range(Table::Input, 0, 1, 0)], vec![range(Table::Holding, 0, 1, 0)])]);
    for n in 0..2000_u16 {
        net.write(0, &n.to_be_bytes());
        net.devices[0].input.insert(0, n);
        net.run(MS / 4);
    }
    let seen = u16::from_be_bytes([net.image.inputs[0], net.image.inputs[1]]);
    assert!(seen > 1900, "{seen}");
    assert!(net.image.status[0].exchanges >= 45, "{:?}", net.image.status[0]);
}

#[test]
fn noise_in_place_of_answers_is_never_taken_for_one() {
    // Every tenth answer has one changed byte, by a fixed sequence.
    let mut net = Net::new(vec![coupler(1, vec![range(Table::Input, 0, 4, 0)], Vec::new())]);
    net.devices[0].input.extend((0..4).map(|n| (n, 0x4242)));
    let mut noise = 0x1234_5678_u32;
    for _ in 0..20_000 {
        net.run(MS / 2);
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if noise >> 29 == 0
            && let Some((_, bytes)) = net.back.front_mut()
        {
            // Header, unit, function and length; the data after them are not damaged.
            let at = (noise >> 8) as usize % 9;
            bytes[at] ^= (noise >> 16) as u8 | 1;
        }
        assert!(net.image.inputs.iter().all(|byte| matches!(byte, 0 | 0x42)), "{:?}", net.image.inputs);
    }
    net.run(2000 * MS);
    assert_eq!((net.image.status[0].state, net.image.inputs[0]), (State::Running, 0x42));
    assert!(net.reconnects > 10 && net.image.status[0].failures > 100, "{} {:?}", net.reconnects, net.image.status[0]);
    assert_eq!(net.config.stations().count(), 1);
}

#[test]
fn an_answer_that_comes_too_late_is_not_taken_for_that_of_the_next_request() {
    let mut net = Net::new(vec![coupler(1, vec![range(Table::Input, 0, 1, 0)], Vec::new())]);
    net.run(15 * MS);
    assert_eq!(net.image.status[0].state, State::Running);
    net.devices[0].input.insert(0, 1);
    // The next is read at 20 ms, given up at 70 ms, and comes at 72 ms; the request made then is answered at 80 ms.
    net.delays.extend([52 * MS, 10 * MS]);
    net.run(6 * MS);
    net.devices[0].input.insert(0, 2);
    net.run(54 * MS);
    assert_eq!((net.image.inputs[1], net.image.status[0].failures), (0, 1), "the late one is nobody's");
    net.run(10 * MS);
    assert_eq!(net.image.inputs[1], 2);
}
