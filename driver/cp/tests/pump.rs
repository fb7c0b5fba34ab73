//! The pump over heap segments and the simulated line: two CPs, two CPUs, one thread, virtual time.

use std::cell::RefCell;
use std::rc::Rc;

use ob1_backplane::{Channel, Counter, CpSide, CpuSide, CpuState, DriverState, Segment, Why};
use ob1_cp::{CpPump, CpType, EventCode, HEARTBEAT, LinePort, Refused};
use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_firmware::{Instant, LineFault, LineInput, LineSettings, Span};
use ob1_params::CpKind;

const MS: Span = Span::MILLISECOND;

/// 3964R, 115200 8N1, default times.
const PARAMETERS: [u8; 16] = [0x0E, 0x04, 0x13, 0, 0, 10, 25, 100, 5, 6, 0, 0, 0, 0, 0, 0];

/// One end of the simulated line.
struct Port {
    line: Rc<RefCell<SimLine>>,
    end: End,
    applied: Vec<LineSettings>,
    refuse: bool,
    cp_type: CpType,
}

impl LinePort for Port {
    fn configure(&mut self, _now: Instant, json: &[u8]) -> Result<(), Refused> {
        if self.refuse { Err(Refused(String::from_utf8_lossy(json).into_owned())) } else { Ok(()) }
    }

    fn cp_type(&self) -> CpType {
        self.cp_type.clone()
    }

    fn apply(&mut self, _now: Instant, settings: &LineSettings) {
        self.applied.push(*settings);
    }

    fn transmit(&mut self, now: Instant, bytes: &[u8]) {
        self.line.borrow_mut().write(self.end, now, bytes);
    }

    fn take_back(&mut self, now: Instant) -> usize {
        self.line.borrow_mut().take_back(self.end, now)
    }
}

/// A CPU, the segment, and its driver.
struct Module {
    segment: Segment,
    cpu: CpuSide,
    pump: CpPump,
    port: Port,
    due: Instant,
}

impl Module {
    fn new(line: &Rc<RefCell<SimLine>>, end: End) -> Self {
        let segment = Segment::heap();
        let mut cpu = CpuSide::create(&segment, 16).unwrap();
        cpu.set_cpu_state(CpuState::Run);
        let pump = CpPump::new(CpSide::attach(&segment).unwrap());
        let port = Port { line: Rc::clone(line), end, applied: Vec::new(), refuse: false, cp_type: CpType::CP240 };
        Self { segment, cpu, pump, port, due: Instant::START }
    }

    fn poll(&mut self, now: Instant) {
        self.due = self.pump.poll(now, &mut self.port);
    }

    fn inputs(&mut self) -> [u8; 16] {
        let mut inputs = [0; 16];
        let _ = self.cpu.read_inputs(&mut inputs);
        inputs
    }

    fn words(&mut self) -> (u16, u16) {
        let inputs = self.inputs();
        (u16::from_be_bytes([inputs[0], inputs[1]]), u16::from_be_bytes([inputs[2], inputs[3]]))
    }

    fn put(&mut self, now: Instant, rx_echo: u16, tx: u16, block: &[u8]) {
        let mut outputs = [0; 16];
        outputs[..2].copy_from_slice(&rx_echo.to_be_bytes());
        outputs[2..4].copy_from_slice(&tx.to_be_bytes());
        outputs[4..4 + block.len()].copy_from_slice(block);
        self.cpu.write_outputs(&outputs);
        self.poll(now);
    }

    /// Parameters and the start-up of FC 9.
    fn start(&mut self, now: Instant) {
        self.cpu.write_params(&PARAMETERS, b"{}").unwrap();
        self.poll(now);
        self.synchronise(now);
    }

    fn synchronise(&mut self, now: Instant) {
        let (rx, number) = self.words();
        assert_eq!(rx, 0x8001);
        self.put(now, 0x8001, number, &[]);
        self.put(now, 0, 0, &[]);
        assert!(self.pump.is_working());
    }

    fn event_codes(&mut self) -> Vec<u32> {
        std::iter::from_fn(|| self.cpu.poll_event().unwrap()).map(|event| event.code).collect()
    }
}

fn line() -> Rc<RefCell<SimLine>> {
    Rc::new(RefCell::new(SimLine::new(SimConfig::new(115_200, 20), 1)))
}

/// Runs until `done`, at the latest until `end`; returns the time.
fn run(modules: &mut [Module; 2], mut now: Instant, end: Instant, done: impl Fn(&mut [Module; 2]) -> bool) -> Instant {
    let line = Rc::clone(&modules[0].port.line);
    while !done(modules) {
        let next = line.borrow().next_event();
        now = modules.iter().map(|m| m.due).chain(next).min().unwrap().max(now);
        assert!(now <= end, "nothing happened");
        let mut buffer = [0; 64];
        loop {
            let popped = line.borrow_mut().pop(now, &mut buffer);
            let Some((end, event)) = popped else { break };
            let input = match event {
                SimEvent::Rx(n) => LineInput::Rx(&buffer[..n]),
                SimEvent::TxDone => LineInput::TxDone,
                SimEvent::Fault(_) | SimEvent::Cts(_) => continue,
            };
            let module = &mut modules[end as usize];
            module.due = module.pump.line_event(now, input, &mut module.port);
        }
        for module in modules.iter_mut().filter(|m| m.due <= now) {
            module.poll(now);
        }
    }
    now
}

#[test]
fn a_telegram_from_one_cpu_to_the_other() {
    let line = line();
    let mut modules = [Module::new(&line, End::A), Module::new(&line, End::B)];
    modules.iter_mut().for_each(|m| m.start(Instant::START));
    assert_eq!(modules[0].port.applied[0].to_string(), "115200 8N1");

    let [a, b] = &mut modules;
    a.put(Instant::START, 0, 14, b"twelve bytes");
    a.put(Instant::START, 0, 2, b"+2");
    a.put(Instant::START, 0, 0, &[]);
    b.poll(Instant::START);
    let now = run(&mut modules, Instant::START, Instant::from_millis(100), |m| m[1].words().0 != 0);
    let [a, b] = &mut modules;
    assert_eq!(b.inputs(), *b"\x00\x0e\x00\x00twelve bytes");
    b.put(now, 14, 0, &[]);
    assert_eq!(b.inputs()[..6], *b"\x00\x02\x00\x00+2");
    b.put(now, 2, 0, &[]);
    b.put(now, 0, 0, &[]);
    assert_eq!(b.words(), (0, 0));
    assert_eq!(a.words().1, 2, "the DLE after the block is still on the line");
    run(&mut modules, now, now + 10 * MS, |m| m[0].words().1 == 0);

    let [a, b] = &modules;
    let (a, b) = (a.cpu.monitor().counters(), b.cpu.monitor().counters());
    assert_eq!((a.get(Counter::OrdersAccepted), a.get(Counter::TelegramsSent)), (1, 1));
    assert_eq!((b.get(Counter::TelegramsReceived), b.get(Counter::TelegramsDelivered)), (1, 1));
}

#[test]
fn the_heart_beats_and_the_pump_may_sleep() {
    let mut module = Module::new(&line(), End::A);
    assert!(!module.pump.prepare_sleep(), "nothing looked at yet");
    module.poll(Instant::START);
    let beats = module.cpu.monitor().cp_heartbeat();
    assert_eq!(module.due, Instant::START + HEARTBEAT);
    assert!(module.pump.prepare_sleep());
    module.cpu.write_outputs(&[1]);
    assert!(module.cpu.take_doorbell(), "the CPU side rings for it");
    module.pump.awake();
    assert!(module.pump.has_changes());
    assert!(!module.pump.prepare_sleep(), "not before it has looked");
    module.poll(Instant::from_millis(1));
    assert_eq!(module.cpu.monitor().cp_heartbeat(), beats);
    module.poll(Instant::START + HEARTBEAT);
    assert_eq!(module.cpu.monitor().cp_heartbeat(), beats + 1);
}

#[test]
fn the_state_tells_what_is_missing() {
    let mut module = Module::new(&line(), End::A);
    let state = |m: &Module| m.cpu.monitor().driver_state().unwrap();
    module.poll(Instant::START);
    assert_eq!(state(&module), DriverState::NoParameters);
    let mut wrong = PARAMETERS;
    // Stop bits 00b.
    wrong[2] = 0xCF;
    module.cpu.write_params(&wrong, b"{}").unwrap();
    module.poll(Instant::START);
    assert_eq!(state(&module), DriverState::ParameterError(2));
    assert_eq!(module.words(), (0x8003, 0x8002));
    module.port.refuse = true;
    module.cpu.write_params(&PARAMETERS, b"no line").unwrap();
    module.poll(Instant::START);
    assert_eq!(state(&module), DriverState::ParameterError(0x100));
    assert_eq!(module.cpu.read_diagnosis().unwrap().data(), b"no line");
    module.port.refuse = false;
    module.start(Instant::START);
    assert_eq!(state(&module), DriverState::Ready);

    module.pump.line_error(Instant::START, 2, "No such file or directory");
    module.pump.line_event(Instant::START, LineInput::Fault(LineFault::Gone), &mut module.port);
    assert_eq!(state(&module), DriverState::LineError(2));
    assert_eq!(module.cpu.read_diagnosis().unwrap().data(), b"No such file or directory");
    module.pump.line_event(Instant::START, LineInput::Fault(LineFault::Back), &mut module.port);
    assert_eq!(state(&module), DriverState::Ready);
    assert_eq!(module.cpu.read_diagnosis().unwrap().data(), b"");
    let codes = module.event_codes();
    for code in [EventCode::NoParameters, EventCode::Configuration, EventCode::Startup, EventCode::Working] {
        assert!(codes.contains(&(code as u32)), "{code:?} in {codes:?}");
    }
    assert!(codes.ends_with(&[EventCode::LineGone as u32, EventCode::LineUp as u32]));
}

#[test]
fn a_new_driver_shows_another_start_up_and_the_lost_order_is_counted() {
    let line = line();
    let mut module = Module::new(&line, End::A);
    module.start(Instant::START);
    module.put(Instant::START, 0, 1, b"x");
    module.put(Instant::START, 0, 0, &[]);
    // Killed with the order on the line; the acknowledgement of the first start-up appears in the registers again.
    let number = 0x8000 | 38;
    module.put(Instant::START, 0x8001, number, &[]);
    module.pump = CpPump::new(CpSide::attach(&module.segment).unwrap());
    module.poll(Instant::START);
    assert_eq!(module.words().0, 0x8001, "the record of the parameters is still there: it starts with it");
    assert_ne!(module.words().1, number);
    module.synchronise(Instant::START);
    let counters = module.cpu.monitor().counters();
    assert_eq!((counters.get(Counter::OrdersLost), counters.open_orders()), (1, 0));
    assert_eq!(counters.get(Counter::DriverStarts), 2);
}

#[test]
fn the_same_parameters_again_are_a_new_start_up() {
    let mut module = Module::new(&line(), End::A);
    module.start(Instant::START);
    let first = module.port.applied.len();
    module.cpu.set_cpu_state(CpuState::Stop);
    module.poll(Instant::START);
    module.cpu.set_cpu_state(CpuState::Run);
    module.poll(Instant::START);
    assert!(module.pump.is_working(), "STOP and RUN alone are no start");
    module.start(Instant::START);
    assert_eq!(module.port.applied.len(), first + 1);
}

#[test]
fn noise_in_the_segment_is_survived() {
    for seed in 0..200u64 {
        let mut module = Module::new(&line(), End::A);
        module.start(Instant::START);
        let mut state = seed;
        let mut noise = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state ^ state >> 29
        };
        module.segment.scribble(|_| noise());
        let mut now = Instant::START;
        for _ in 0..100 {
            module.poll(now);
            assert!(module.due > now, "seed {seed}: the pump never asks to be called at once for ever");
            now = module.due;
        }
        // The CPU side writes all its words again; then it works.
        module.cpu.restore();
        module.cpu.write_outputs(&[0; 16]);
        module.pump = CpPump::new(CpSide::attach(&module.segment).unwrap());
        module.start(now);
    }
}

#[test]
fn the_module_is_what_the_configuration_says() {
    let keys = serde_json::json!({"protocol": "3964r", "baud": 9600, "parity": "none", "priority": "low"});
    let cp341 = CpType::of("cp341", keys.as_object().unwrap()).unwrap();
    assert!(matches!(cp341.keys, Some(Ok(_))), "{cp341:?}");
    // Start-up coordination of P_RCV_RK: START with number 5, acknowledged with READY. (docs/cp341-channels.md)
    let mut start = [0; 64];
    (start[0], start[3]) = (1, 5);
    // First input register: start-up identifier of a CP 240, a CP 040's first answer, signals of a CP 341's interface,
    // none of them on.
    for (cp_type, register, acknowledged) in [
        (CpType::CP240, 0x80, [0, 0]),
        (CpType { kind: CpKind::Cp040, ..CpType::CP240 }, 0x88, [0, 0]),
        (cp341, 0, [1, 5]),
    ] {
        let name = cp_type.kind.name();
        let mut module = Module::new(&line(), End::A);
        module.port.cp_type = cp_type;
        module.cpu.write_channel(Channel::Receive, &start);
        let mut shown = [0; 64];
        // Parameters come with each STOP -> RUN: the second time it is the same module, with its state.
        for transfer in 1..=2 {
            // Zeros stand for defaults; those of a CP 341 are keys.
            module.cpu.write_params(&[0; 16], b"{}").unwrap();
            module.poll(Instant::from_nanos(transfer));
            let _ = module.cpu.read_channel(Channel::Receive, &mut shown);
            assert_eq!([shown[0], shown[3]], acknowledged, "{name}");
            assert_eq!(module.cpu.monitor().driver_state(), Ok(DriverState::Ready), "{name}");
            assert_eq!(module.inputs()[0], register, "{name}");
        }
        // 0004h: parameters it has already.
        let entries: Vec<_> = module.cpu.monitor().buffer().collect();
        assert_eq!(entries.iter().any(|entry| entry.number == 4), name == "cp341", "{name}: {entries:?}");
    }
}

/// In RUN the CP acknowledges a START that it has forgotten in STOP: one with the same bytes as before the STOP, or one
/// that was written before the driver saw the STOP. (docs/cp341-channels.md)
#[test]
fn a_start_shown_before_the_driver_saw_the_stop() {
    let keys = serde_json::json!({"protocol": "ascii", "baud": 9600});
    for (kind, channel) in
        [CpKind::Cp341, CpKind::Cp340].into_iter().flat_map(|kind| Channel::ALL.map(|channel| (kind, channel)))
    {
        let mut module = Module::new(&line(), End::A);
        module.port.cp_type = CpType::of(kind.name(), keys.as_object().unwrap()).unwrap();
        assert!(matches!(module.port.cp_type.keys, Some(Ok(_))), "{:?}", module.port.cp_type);
        module.cpu.write_params(&[0; 16], b"{}").unwrap();
        let mut ms = 0;
        let mut state_and_start = |module: &mut Module| {
            ms += 1;
            module.poll(Instant::from_millis(ms));
            let mut shown = [0; 64];
            let _ = module.cpu.read_channel(channel, &mut shown);
            [shown[0], shown[3]]
        };
        let start = |number| {
            let mut block = [0; 64];
            (block[0], block[3]) = (1, number);
            block
        };
        assert!(module.cpu.write_channel(channel, &start(1)));
        assert_eq!(state_and_start(&mut module), [1, 1], "{kind:?} {channel:?}");
        module.cpu.set_cpu_state(CpuState::Stop);
        assert_eq!(state_and_start(&mut module), [0, 0], "{kind:?} {channel:?}");
        module.cpu.set_cpu_state(CpuState::Run);
        assert!(!module.cpu.write_channel(channel, &start(1)), "the same bytes");
        assert_eq!(state_and_start(&mut module), [1, 1], "{kind:?} {channel:?}: the same number");

        module.cpu.set_cpu_state(CpuState::Stop);
        assert!(module.cpu.write_channel(channel, &start(2)));
        assert_eq!(state_and_start(&mut module), [0, 0], "{kind:?} {channel:?}");
        module.cpu.set_cpu_state(CpuState::Run);
        assert_eq!(state_and_start(&mut module), [1, 2], "{kind:?} {channel:?}: before the STOP was seen");
    }
}

#[test]
fn a_line_that_has_not_come_yet_is_no_event() {
    let mut module = Module::new(&line(), End::A);
    module.start(Instant::from_nanos(1));
    module.event_codes();
    let now = Instant::from_nanos(2);
    module.pump.no_line(now, &mut module.port);
    assert_eq!((module.event_codes(), module.cpu.monitor().leds().error), (vec![], false));
    module.pump.line_event(now, LineInput::Fault(LineFault::Gone), &mut module.port);
    assert_eq!((module.event_codes(), module.cpu.monitor().leds().error), (vec![EventCode::LineGone as u32], true));
}

#[test]
fn an_echo_is_an_event_with_its_text() {
    let mut module = Module::new(&line(), End::A);
    module.start(Instant::from_nanos(1));
    module.event_codes();
    module.pump.line_echo(Instant::from_nanos(2), Some("it echoes"));
    assert_eq!(module.event_codes(), [EventCode::LineEcho as u32]);
    assert_eq!(module.cpu.read_diagnosis().unwrap().data(), b"it echoes");
    let why = |module: &Module| module.cpu.monitor().reason().map(|(reason, _)| reason.why);
    assert_eq!(why(&module), Some(Why::Echoes));
    module.pump.line_echo(Instant::from_nanos(3), None);
    assert_eq!(why(&module), None);
}

/// An order that nobody answers, with a line of its own speed: what the driver shows of it.
#[test]
fn a_failed_order_is_the_reason_has_its_count_and_is_listed_once() {
    let line = line();
    let mut modules = [Module::new(&line, End::A), Module::new(&line, End::B)];
    let mut now = Instant::START;
    modules[0].cpu.set_time(5_000_000_000);
    let told = |m: &Module| m.cpu.monitor().reason().map(|(reason, at)| (reason.why, reason.number, reason.count, at));
    modules[0].cpu.write_params(&PARAMETERS, b"{}").unwrap();
    modules[0].poll(now);
    assert_eq!(told(&modules[0]), Some((Why::StartUp, 0x8001, 0, 5)));
    modules[0].synchronise(now);
    assert_eq!(told(&modules[0]), None);
    for count in 1..=2 {
        modules[0].put(now, 0, 1, b"x");
        modules[0].put(now, 0, 0, &[]);
        // The other end has no parameters: it answers nothing.
        now = run(&mut modules, now, now + 10_000 * MS, |m| m[0].words().1 == 0x2007);
        modules[0].put(now, 0, 0x2000, &[]);
        modules[0].put(now, 0, 0, &[]);
        assert_eq!(told(&modules[0]), Some((Why::OrderFailed, 7, count, 5)));
    }
    let monitor = modules[0].cpu.monitor();
    assert_eq!(monitor.ends().map(|ends| (ends.number, ends.count)).collect::<Vec<_>>(), [(7, 2)]);
    let listed: Vec<_> = monitor.buffer().map(|entry| entry.number).collect();
    assert_eq!(listed.iter().filter(|number| **number == 7).count(), 2, "{listed:x?}");
    assert!(listed.len() < 30, "not each of the 12 attempts twice: {listed:x?}");
    let codes = modules[0].event_codes();
    assert_eq!(codes.iter().filter(|code| **code == EventCode::SendFailed as u32).count(), 2, "{codes:x?}");
}
