//! Throughput of user data over the simulated line, compared with the limit given by the baud rate and the protocol's
//! own characters and pauses: for the protocol machines with queued orders, and end to end through FC 0 and FC 1 with a
//! scan of 1 ms. In virtual time, except for the processor time of an order. Then Modbus RTU over a pty, compared with
//! other programs, if the interpreter of the partners' scripts is known.

mod modbus;
mod queue;
mod stations;

use crate::defaults;
use ob1_protocols::modbus::{Master, Mode, Slave, frame, master, slave};
use ob1_protocols::rk512::{Area, Command, Coordination, Request};
use ob1_protocols::{Ascii, MS, S3964, SECOND, StxEtx, ascii, rk512, s3964, stx_etx};
use ob1_time::Span;

use super::peer::Failure;
use super::{Figure, median};
pub(super) use queue::ORDERS;
use queue::{Bare, OfMachine, OfRk512, PAYLOAD, Side, char_time, drive, payload, run};

const BAUDS: [u32; 2] = [9600, 115_200];
/// Rounds for the processor time.
const ROUNDS: usize = 9;

/// A protocol and its machines.
struct Case {
    name: &'static str,
    sides: [Box<dyn Side>; 2],
    /// Characters of an order with [`PAYLOAD`] bytes, the sum of both directions.
    characters: usize,
    /// Pauses that the protocol or its parameters require.
    pause: Span,
}

/// Runs the measurement: throughput of the machines and end to end, processor time of an order, Modbus over a pty.
///
/// # Errors
/// If an order fails, the stations cannot be built, or a partner is not available.
pub fn measure() -> Result<Vec<Figure>, Failure> {
    let mut figures = Vec::new();
    for baud in BAUDS {
        for case in cases(baud) {
            let time = char_time(baud) * case.characters as u64 + case.pause;
            let most = PAYLOAD as f64 * SECOND.nanos() as f64 / time.nanos() as f64;
            let rate = run(case.sides, baud)?.rate;
            figures.push(throughput(format!("{}, {baud} baud", case.name), rate, most, true));
        }
        let most = PAYLOAD as f64 * SECOND.nanos() as f64 / (char_time(baud) * (PAYLOAD as u64 + 6)).nanos() as f64;
        figures.push(throughput(format!("FC 0 -> FC 1, 3964R, {baud} baud"), stations::end_to_end(baud)?, most, false));
    }
    figures.append(&mut costs()?);
    if std::env::var_os("OB1_PYTHON").is_some() {
        figures.append(&mut modbus::measure()?);
    }
    Ok(figures)
}

/// The processor time of an order, both sides, compared with that of the same number of characters on the simulated
/// line alone.
fn costs() -> Result<Vec<Figure>, Failure> {
    let baud = BAUDS[0];
    let mut times: Vec<(&str, Vec<f64>, Vec<f64>)> =
        cases(baud).iter().map(|case| (case.name, Vec::new(), Vec::new())).collect();
    for _ in 0..ROUNDS {
        for (case, (_, own, bare)) in cases(baud).into_iter().zip(&mut times) {
            let characters = vec![0x20; case.characters];
            own.push(run(case.sides, baud)?.cost);
            bare.push(run([Bare::side(characters), Bare::side(Vec::new())], baud)?.cost);
        }
    }
    let figure = |(name, mut own, mut bare): (&str, Vec<f64>, Vec<f64>)| Figure {
        what: format!("{name}: CPU of an order").into(),
        value: median(&mut own),
        unit: "ns",
        floor: Some(("as many characters, no protocol", median(&mut bare))),
        aim: ("", true),
    };
    Ok(times.into_iter().map(figure).collect())
}

/// Each protocol by its name, and its [`ORDERS`] on a good line.
pub(super) fn orders() -> impl Iterator<Item = (&'static str, impl FnOnce() -> Result<(), Failure>)> {
    cases(BAUDS[0]).into_iter().map(|case| (case.name, || drive(case.sides, BAUDS[0]).map(drop)))
}

fn cases(baud: u32) -> Vec<Case> {
    let char_time = char_time(baud);
    let of_3964 = |bcc, priority| s3964::Config { priority, ..defaults::cp240(bcc, char_time) };
    let pair_of_3964 = |bcc| {
        [
            OfMachine::side(<S3964>::new(of_3964(bcc, s3964::Priority::High)), payload()),
            OfMachine::side(<S3964>::new(of_3964(bcc, s3964::Priority::Low)), Vec::new()),
        ]
    };
    let framed = || {
        <StxEtx>::new(&stx_etx::Config {
            start: stx_etx::Flags::new([2, 0], 1),
            end: stx_etx::Flags::new([3, 0], 1),
            ..defaults::stx_etx(char_time)
        })
    };
    // Telegrams are separated by pauses: ZNA longer than the receiver's ZVZ.
    let ascii = || <Ascii>::new(&ascii::Config { zna: 20 * MS, zvz: Span::ZERO, ..defaults::ascii(char_time) });
    let of_rk512 = |order: Option<(Request, Vec<u8>)>| {
        let priority = if order.is_some() { s3964::Priority::High } else { s3964::Priority::Low };
        OfRk512::side(rk512::Config::cp240(of_3964(true, priority)), order)
    };
    let request =
        |command| Request { command, area: Area::Db, db: 10, start: 0, length: 125, coordination: Coordination::NONE };
    let of_modbus = |mode| {
        let frame = frame::Config::new(mode, baud, char_time);
        let registers = (PAYLOAD / 2) as u8;
        // Address, function code and number of bytes are before the data.
        let master = Master::new(master::Config { frame: frame.clone(), wait: SECOND });
        let slave = Slave::new(slave::Config { confirmed: false, ..slave::Config::long(frame, 5) });
        [OfMachine::with_overhead(master, vec![5, 3, 0, 0, 0, registers], 3), OfMachine::side(slave, Vec::new())]
    };
    let silence = frame::Config::new(Mode::Rtu, baud, char_time).silence;
    // 3964R adds 6 characters to a block: STX, DLE, DLE, ETX, BCC, DLE. RK 512 needs two telegrams and two reactions
    // for 250 bytes, the first telegram with a header of 10 bytes, the others with 4.
    let of_rk512_order = PAYLOAD + 10 + 3 * 4 + 4 * 6;
    let case = |name, sides, characters, pause| Case { name, sides, characters, pause };
    vec![
        case("3964R", pair_of_3964(true), PAYLOAD + 6, Span::ZERO),
        case("3964", pair_of_3964(false), PAYLOAD + 5, Span::ZERO),
        case(
            "STX/ETX",
            [OfMachine::side(framed(), payload()), OfMachine::side(framed(), Vec::new())],
            PAYLOAD + 2,
            Span::ZERO,
        ),
        case(
            "ASCII, ZNA 20 ms",
            [OfMachine::side(ascii(), payload()), OfMachine::side(ascii(), Vec::new())],
            PAYLOAD,
            20 * MS,
        ),
        case(
            "RK 512 SEND",
            [of_rk512(Some((request(Command::Send), payload()))), of_rk512(None)],
            of_rk512_order,
            Span::ZERO,
        ),
        case(
            "RK 512 FETCH",
            [of_rk512(Some((request(Command::Fetch), Vec::new()))), of_rk512(None)],
            of_rk512_order,
            Span::ZERO,
        ),
        case("Modbus RTU, 125 registers read", of_modbus(Mode::Rtu), 8 + PAYLOAD + 5, 2 * silence),
        case("Modbus ASCII, 125 registers read", of_modbus(Mode::Ascii), 17 + 2 * PAYLOAD + 11, Span::ZERO),
    ]
}

fn throughput(what: String, rate: f64, most: f64, judged: bool) -> Figure {
    Figure {
        what: what.into(),
        value: rate,
        unit: "B/s",
        floor: Some(("the protocol's own maximum", most)),
        aim: if judged { (">= 0.95 x", rate >= 0.95 * most) } else { ("", true) },
    }
}
