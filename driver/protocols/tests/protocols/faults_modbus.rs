//! A Modbus master and a slave on a bad line, see [`pair`].

use ob1_fakes::sim_line::{End, SimConfig};
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_protocols::modbus::pdu::{Function, Request};
use ob1_protocols::modbus::{Failure, Master, Mode, Slave, frame, master, slave};
use ob1_protocols::{Event, Input, Instant, LineInput, MS, Machine, Order, SendError, Sink, Span, Wire};

use crate::pair;
use crate::pair::{Duet, Judge, Stage, Sum};

const ADDRESS: u8 = 5;

/// A telegram in the characters that passes the check and `is_it`: in RTU at their end, in ASCII anywhere, because its
/// end is a character. Written from the definition of CRC and LRC, not with the codec under test.
fn heard(rtu: bool, raw: &[Option<u8>], is_it: impl Fn(&[u8]) -> bool) -> Option<Vec<u8>> {
    let good = |from: usize| {
        let rest = &raw[from..];
        let telegram = if rtu { rtu_telegram(rest)? } else { ascii_telegram(rest)? };
        is_it(&telegram).then_some(telegram)
    };
    (0..raw.len()).rev().find_map(good)
}

fn rtu_telegram(raw: &[Option<u8>]) -> Option<Vec<u8>> {
    let mut bytes: Vec<u8> = raw.iter().copied().collect::<Option<_>>()?;
    let crc = bytes.iter().fold(0xFFFF_u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xA001 } else { c >> 1 })
    });
    bytes.truncate(bytes.len().checked_sub(2)?);
    (crc == 0).then_some(bytes)
}

fn ascii_telegram(raw: &[Option<u8>]) -> Option<Vec<u8>> {
    let end = raw.iter().position(|c| *c == Some(b'\n'))?;
    let text: Vec<u8> = raw[..end].iter().copied().collect::<Option<_>>()?;
    let digits = text.strip_prefix(b":")?.strip_suffix(b"\r")?;
    let pairs = digits.chunks(2).map(|pair| std::str::from_utf8(pair).ok());
    let bytes: Vec<u8> = pairs.map(|pair| u8::from_str_radix(pair?, 16).ok()).collect::<Option<_>>()?;
    let (lrc, telegram) = bytes.split_last()?;
    (telegram.iter().fold(*lrc, |sum, byte| sum.wrapping_add(*byte)) == 0).then(|| telegram.to_vec())
}

fn hex(digits: Option<&[u8]>) -> Option<u8> {
    u8::from_str_radix(std::str::from_utf8(digits?).ok()?, 16).ok()
}

/// Either partner. The slave reports the requests it answers to the harness as delivered telegrams.
enum Partner {
    Master(Box<Master>),
    Slave { slave: Box<Slave>, rtu: bool, raw: Vec<Option<u8>> },
}

/// The slave's sink: a request counts as delivered when it is answered.
struct Shown<'a> {
    out: &'a mut dyn Sink,
    rtu: bool,
    raw: &'a mut Vec<Option<u8>>,
}

impl Wire for Shown<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        // An answer contains the function code of its request; the end of a telegram may have a correct check by
        // chance.
        let code = if self.rtu { bytes.get(1).copied() } else { hex(bytes.get(3..5)) };
        let code = code.expect("an answer has a function code") & 0x7F;
        let for_me = |telegram: &[u8]| telegram.starts_with(&[ADDRESS, code]);
        let request = heard(self.rtu, self.raw, for_me).expect("answered what the check would have refused");
        self.raw.clear();
        self.out.deliver(&request);
        self.out.transmit(bytes);
    }
}

impl Sink for Shown<'_> {
    fn room(&self) -> usize {
        self.out.room()
    }

    fn deliver(&mut self, _: &[u8]) {
        unreachable!("a slave delivers nothing");
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.out.sent(outcome);
    }

    fn report(&mut self, event: Event) {
        self.out.report(event);
    }
}

impl Machine for Partner {
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match self {
            Self::Master(master) => master.step(now, input, out),
            Self::Slave { slave, rtu, raw } => {
                match input {
                    Input::Line(LineInput::Rx(bytes)) => raw.extend(bytes.iter().map(|b| Some(*b))),
                    Input::Line(LineInput::Fault(_)) => raw.push(None),
                    _ => {}
                }
                slave.step(now, input, &mut Shown { out, rtu: *rtu, raw })
            }
        }
    }

    fn busy(&self) -> bool {
        match self {
            Self::Master(master) => master.busy(),
            Self::Slave { .. } => false,
        }
    }
}

/// Characters received since the partner last sent.
struct Heard<const RTU: bool> {
    raw: Vec<Option<u8>>,
}

impl<const RTU: bool> Judge for Heard<RTU> {
    fn character(&mut self, _now: Instant, character: Option<u8>) {
        self.raw.push(character);
    }

    fn transmitted(&mut self, _now: Instant, _bytes: &[u8]) {
        self.raw.clear();
    }

    fn accepts(&mut self, _now: Instant, telegram: &[u8]) -> bool {
        Failure::ALL.iter().any(|failure| failure.telegram() == telegram)
            || heard(RTU, &self.raw, |heard| heard == telegram).is_some()
    }
}

struct Pair<const RTU: bool>;

impl<const RTU: bool> Duet for Pair<RTU> {
    const TEST: &'static str = if RTU { "faults_modbus::rtu" } else { "faults_modbus::ascii" };
    type Machine = Partner;
    type Judge = Heard<RTU>;
    const ACKNOWLEDGED: bool = true;
    const GRACE: Span = Span::ZERO;

    fn stage(rng: &mut SplitMix64) -> Stage<Partner, Heard<RTU>> {
        let baud = [9600, 19_200, 38_400][rng.below(3) as usize];
        let mut sim = SimConfig::new(baud, 22);
        let mode = if RTU { Mode::Rtu } else { Mode::Ascii };
        let mut frame = frame::Config::new(mode, baud, sim.char_time);
        if rng.below(3) == 0 {
            sim.coalesce = 4 * MS;
            frame = frame.with_bursts(sim.coalesce);
        }
        let master = Master::new(master::Config::cp240(frame.clone(), baud, [0, 100][rng.below(2) as usize]));
        let slave = Slave::new(slave::Config { confirmed: false, ..slave::Config::long(frame, ADDRESS) });
        let slave = Partner::Slave { slave: Box::new(slave), rtu: RTU, raw: Vec::new() };
        let partners = [Partner::Master(Box::new(master)), slave].map(|machine| (machine, Heard { raw: Vec::new() }));
        // A slave needs no receive buffer; the tables test a master without one.
        Stage { sim, partners, pause: 10 * MS, slow_one_in: 0 }
    }

    fn telegram(rng: &mut SplitMix64, end: End) -> Option<Vec<u8>> {
        (end == End::A).then(|| request(rng))
    }

    fn worst() -> FaultRates {
        FaultRates {
            flip: 2000,
            lose: 1500,
            double: 1500,
            delay: 1000,
            parity: 1000,
            framing: 1000,
            break_: 500,
            delay_max: 60 * MS,
        }
    }

    fn verdict(sum: &Sum) {
        assert!(sum.failed > 0, "the faults do not hurt");
        // A CRC misses one in 65536 damaged telegrams, an LRC one in 256 and all with two errors that cancel out.
        assert!(sum.damaged * if RTU { 2000 } else { 200 } < sum.done, "{sum:?}: more than the check lets through");
    }
}

/// Any request that the slave can carry out.
fn request(rng: &mut SplitMix64) -> Vec<u8> {
    let code = [1_u8, 2, 3, 4, 5, 6, 15, 16][rng.below(8) as usize];
    let function = Function::of(code).expect("one of the eight");
    let bits = matches!(code, 1 | 2 | 15);
    let most = if bits { 300 } else { 40 };
    let count = 1 + rng.below(most) as u16;
    let first = rng.below(u64::from(if bits { 8192 - count } else { 512 - count })) as u16;
    let mut telegram = vec![ADDRESS, code];
    telegram.extend(first.to_be_bytes());
    let value = match code {
        5 => [0, 0xFF00][rng.below(2) as usize],
        6 => rng.next_u64() as u16,
        _ => count,
    };
    telegram.extend(value.to_be_bytes());
    if matches!(function, Function::WriteBits | Function::WriteWords) {
        let bytes = if bits { count.div_ceil(8) } else { 2 * count };
        telegram.push(bytes as u8);
        telegram.extend((0..bytes).map(|_| rng.next_u64() as u8));
    }
    assert!(Request::parse(&telegram).is_ok(), "{telegram:02X?}");
    telegram
}

#[test]
fn rtu() {
    pair::check::<Pair<true>>();
}

#[test]
fn ascii() {
    pair::check::<Pair<false>>();
}

#[test]
fn a_clean_line_loses_nothing() {
    pair::check_clean::<Pair<true>>();
    pair::check_clean::<Pair<false>>();
}

/// An order of the CPU to a slave is not a telegram: it is stored at once.
#[test]
fn a_slave_has_no_orders_under_way() {
    let frame = frame::Config::new(Mode::Rtu, 9600, MS);
    let mut slave = Slave::new(slave::Config::long(frame, ADDRESS));
    assert!(slave.set_input(&[1]) && !slave.busy());
    let abort = Input::Order(Order::Abort);
    struct Nobody;
    impl Wire for Nobody {
        fn transmit(&mut self, _: &[u8]) {
            panic!("nothing to send");
        }
    }

    impl Sink for Nobody {
        fn room(&self) -> usize {
            0
        }
        fn deliver(&mut self, _: &[u8]) {
            panic!("nothing to deliver");
        }
        fn sent(&mut self, _: Result<(), SendError>) {
            panic!("nothing to end");
        }
        fn report(&mut self, _: Event) {}
    }
    assert_eq!(slave.step(Instant::START, abort, &mut Nobody), None);
}
