//! Any input in any order: no panic, each order ends exactly once, nothing is delivered without room, and when the line
//! falls silent for good the machine becomes idle by itself.

use ob1_protocols::ascii::{self, Ascii, Criterion, Sending};
use ob1_protocols::esp2::{self, Esp2};
use ob1_protocols::mbus::{self, MBus};
use ob1_protocols::modbus::{Master, Mode, Slave, frame, master, slave};
use ob1_protocols::s3964::{self, Priority, S3964};
use ob1_protocols::signals::Times;
use ob1_protocols::stx_etx::{self, Flags, StxEtx};
use ob1_protocols::{
    Event, Input, Instant, LineFault, LineInput, MS, Machine, ModemLines, Order, SECOND, SendError, Sink, Span, Wire,
};
use proptest::prelude::*;

use crate::defaults;

#[derive(Clone, Debug)]
enum Step {
    Rx(Vec<u8>),
    TxDone,
    Fault(LineFault),
    /// CTS and DSR.
    Modem(bool, bool),
    Send(usize),
    Abort,
    Room(usize),
    Wait(Span),
}

fn step() -> impl Strategy<Value = Step> {
    let byte = prop_oneof![
        3 => prop::sample::select(vec![0x02_u8, 0x03, 0x10, 0x15, 0x11, 0x13, 0x16, 0x68, 0xE5]),
        1 => any::<u8>()
    ];
    let fault = prop::sample::select(vec![
        LineFault::Parity,
        LineFault::Framing,
        LineFault::Break,
        LineFault::Gone,
        LineFault::Back,
    ]);
    prop_oneof![
        6 => proptest::collection::vec(byte, 0..6).prop_map(Step::Rx),
        4 => Just(Step::TxDone),
        1 => fault.prop_map(Step::Fault),
        1 => any::<(bool, bool)>().prop_map(|(cts, dsr)| Step::Modem(cts, dsr)),
        2 => (0..1100_usize).prop_map(Step::Send),
        1 => Just(Step::Abort),
        1 => prop_oneof![Just(0), Just(5), Just(1024)].prop_map(Step::Room),
        4 => (0..700 * MS.nanos()).prop_map(|time| Step::Wait(Span::from_nanos(time))),
    ]
}

/// Input for EnOcean: whole and mutilated frames, telegrams of its length.
fn esp2_step() -> impl Strategy<Value = Step> {
    let frame =
        (any::<[u8; 10]>(), 0..20_usize, prop::sample::select(vec![0x0B_u8, 0x8B])).prop_map(|(data, cut, h)| {
            let mut telegram = [0; 11];
            telegram[1..].copy_from_slice(&data);
            (telegram[0], telegram[1]) = (h, if h == 0x8B { 0x98 } else { data[0] });
            let frame = esp2::frame::encode(&telegram);
            Step::Rx(frame[..frame.len().min(cut)].to_vec())
        });
    prop_oneof![2 => frame, 1 => prop::sample::select(vec![1, 10, 11, 12]).prop_map(Step::Send), 1 => Just(Step::Room(11))]
}

/// What ends a telegram of ASCII.
fn criterion() -> impl Strategy<Value = Criterion> {
    let sending = prop::sample::select(vec![Sending::Through, Sending::Whole, Sending::Appended]);
    let characters = (prop::sample::select(vec![[0x03, 0x10], [0x10, 0x10], [0x10, 0x03]]), 1..3_u8, sending)
        .prop_map(|(characters, count, sending)| Criterion::Characters { end: Flags::new(characters, count), sending });
    prop_oneof![
        Just(Criterion::Silence),
        Just(Criterion::Fragments),
        characters,
        (1..1025_usize).prop_map(Criterion::Length),
    ]
}

#[derive(Default)]
struct Books {
    room: usize,
    orders: usize,
    ended: usize,
    in_flight: bool,
    delivered: usize,
}

impl Wire for Books {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(!bytes.is_empty());
        self.in_flight = true;
    }
}

impl Sink for Books {
    fn room(&self) -> usize {
        self.room
    }

    fn deliver(&mut self, telegram: &[u8]) {
        assert!(!telegram.is_empty() && telegram.len() <= self.room);
        self.delivered += 1;
    }

    fn sent(&mut self, _: Result<(), SendError>) {
        self.ended += 1;
        assert!(self.ended <= self.orders);
    }

    fn report(&mut self, event: Event) {
        // All of them have a class, or none on purpose.
        assert!(event.number().is_none_or(|n| matches!(n >> 8, 7 | 8)));
    }
}

fn drive(machine: &mut dyn Machine, steps: &[Step]) {
    let mut books = Books { room: 1024, ..Books::default() };
    let mut now = Instant::START;
    let mut deadline = machine.step(now, Input::Tick, &mut books);
    for step in steps {
        let telegram;
        let input = match step {
            Step::Rx(bytes) => Input::Line(LineInput::Rx(bytes)),
            Step::TxDone => {
                books.in_flight = false;
                Input::Line(LineInput::TxDone)
            }
            Step::Fault(fault) => Input::Line(LineInput::Fault(*fault)),
            Step::Modem(cts, dsr) => {
                Input::Line(LineInput::Modem(ModemLines { cts: *cts, dsr: *dsr, ..ModemLines::default() }))
            }
            Step::Send(len) => {
                telegram = vec![0x10; *len];
                books.orders += 1;
                Input::Order(Order::Send(&telegram))
            }
            Step::Abort => Input::Order(Order::Abort),
            Step::Room(room) => {
                books.room = *room;
                Input::Tick
            }
            Step::Wait(time) => {
                deadline = wait(machine, &mut books, deadline, now, now + *time);
                now += *time;
                continue;
            }
        };
        deadline = machine.step(now, input, &mut books);
        assert_eq!(machine.busy(), books.orders > books.ended, "after {step:?}");
    }
    // Silence for good, and a CPU that takes its telegrams.
    books.room = 1024;
    if books.in_flight {
        books.in_flight = false;
        deadline = machine.step(now, Input::Line(LineInput::TxDone), &mut books);
    }
    let end = now + 600 * SECOND;
    let deadline = wait(machine, &mut books, deadline, now, end);
    assert_eq!(deadline, None, "the machine does not come to rest");
    assert_eq!(books.orders, books.ended, "an order never ends");
}

/// Lets time pass on a line that sends everything at once.
fn wait(
    machine: &mut dyn Machine,
    books: &mut Books,
    mut deadline: Option<Instant>,
    mut now: Instant,
    until: Instant,
) -> Option<Instant> {
    let mut ticks = 0;
    while let Some(at) = deadline.filter(|at| *at <= until) {
        now = now.max(at);
        deadline = machine.step(now, Input::Tick, books);
        assert!(deadline.is_none_or(|due| due > now), "a tick leaves a time behind it that is over");
        if std::mem::take(&mut books.in_flight) {
            deadline = machine.step(now, Input::Line(LineInput::TxDone), books);
        }
        ticks += 1;
        assert!(ticks < 100_000, "the machine does not get past {now}");
    }
    deadline
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn s3964(
        steps in proptest::collection::vec(step(), 0..200),
        bcc: bool,
        high: bool,
        cp341: bool,
        zna in 0..3_u64,
        qvz in 0..2_u64,
    ) {
        let base = if cp341 { defaults::cp341(bcc, MS) } else { defaults::cp240(bcc, MS) };
        let priority = if high { Priority::High } else { Priority::Low };
        drive(&mut S3964::<1024>::new(s3964::Config { priority, zna: zna * 20 * MS, qvz: qvz * base.qvz, ..base }), &steps);
    }

    #[test]
    fn ascii(
        steps in proptest::collection::vec(step(), 0..200),
        flow in 0..3_usize,
        criterion in criterion(),
        zna in 0..3_u64,
        pause in 0..3_u64,
        signals: bool,
    ) {
        let flow = [ascii::Flow::None, ascii::Flow::Hardware, ascii::Flow::XonXoff][flow];
        let signals = (signals && flow != ascii::Flow::Hardware).then_some(Times { rts_off: 30 * MS, output_wait: 50 * MS });
        let (zna, pause) = (zna * 20 * MS, pause * 20 * MS);
        let config = ascii::Config { criterion, flow, zna, pause, signals, ..defaults::ascii(MS) };
        drive(&mut Ascii::<1024>::new(&config), &steps);
    }

    #[test]
    fn esp2(steps in proptest::collection::vec(prop_oneof![step(), esp2_step()], 0..200)) {
        drive(&mut Esp2::new(esp2::Config::cp240()), &steps);
    }

    #[test]
    fn mbus(steps in proptest::collection::vec(step(), 0..200)) {
        drive(&mut MBus::new(mbus::Config::cp240()), &steps);
    }

    #[test]
    fn modbus_master(steps in proptest::collection::vec(step(), 0..200), rtu: bool, quiet: bool) {
        let mode = if rtu { Mode::Rtu } else { Mode::Ascii };
        let frame = frame::Config::new(mode, 9600, MS);
        let frame = if quiet { frame } else { frame.without_silence() };
        drive(&mut Master::new(master::Config::cp240(frame, 9600, 0)), &steps);
    }

    #[test]
    fn modbus_slave(steps in proptest::collection::vec(step(), 0..200), rtu: bool, long: bool, address in 0..20_u8) {
        let mode = if rtu { Mode::Rtu } else { Mode::Ascii };
        let frame = frame::Config::new(mode, 9600, MS);
        let config = if long { slave::Config::long(frame, address) } else { slave::Config::short(frame, address) };
        drive(&mut Slave::new(config), &steps);
    }

    #[test]
    fn stx_etx(
        steps in proptest::collection::vec(step(), 0..200),
        flow in 0..3_usize,
        start in 0..3_u8,
        end in 0..3_u8,
        same: bool,
        zna in 0..3_u64,
    ) {
        let flow = [ascii::Flow::None, ascii::Flow::Hardware, ascii::Flow::XonXoff][flow];
        let (start, end) = (Flags::new([0x02, 0x10], start), Flags::new(if same { [0x02, 0x10] } else { [0x03, 0x15] }, end));
        let config = stx_etx::Config { flow, start, end, zna: zna * 20 * MS, ..defaults::stx_etx(MS) };
        drive(&mut StxEtx::<1024>::new(&config), &steps);
    }
}
