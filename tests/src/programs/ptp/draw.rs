//! What a seed draws: program, station, partner, and what happens from outside.

use std::fmt::Write as _;

use ob1_cpu::{Cell, Width};
use ob1_firmware::LineFault;
use ob1_line::sim::FaultRates;
use ob1_model::Area;
use ob1_time::{Instant, Span};

use crate::compare::random::Random;
use crate::programs::run::{Case, Deed};
use crate::programs::shape::{self, Home, Rhythm, Shape};

use super::judge::{Receives, Sends, Setup};
use super::line::{self, Line, TARGET};
use super::numbers::{self, Protocol};
use super::partner::{Moods, Ptp};
use super::pieces::{self, DESTINATION, HAND, LENGTH, RECEIVES, Receiving, SOURCE, Sending, Starts};
use super::{blocks, receiver, sender};

/// The CPs of this judge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cp {
    /// CP 341.
    Cp341,
    /// CP 340.
    Cp340,
    /// SLIO CP 040.
    Cp040,
}

impl Cp {
    fn name(self) -> &'static str {
        match self {
            Self::Cp341 => "cp341",
            Self::Cp340 => "cp340",
            Self::Cp040 => "cp040",
        }
    }

    /// Longest LEN: 4096 at a CP 341, 1024 at the others.
    fn most(self) -> i32 {
        if self == Self::Cp341 { 4096 } else { 1024 }
    }
}

/// What disturbs a program.
#[derive(Clone, Copy, Debug, Default)]
struct Trouble {
    moods: bool,
    rates: bool,
    faults: bool,
    kills: bool,
    stops: bool,
    resets: bool,
    closes: bool,
}

impl Trouble {
    fn draw(random: &mut Random) -> Self {
        if random.below(5) < 2 {
            // The manual's conditions: only the program itself is drawn.
            return Self { resets: random.once_in(4), ..Self::default() };
        }
        let mut one = || random.once_in(3);
        Self { moods: one(), rates: one(), faults: one(), kills: one(), stops: one(), resets: one(), closes: one() }
    }

    /// A timer of ten seconds may have to expire. [TIA help "PtP data link CP 341"]
    fn is_slow(self) -> bool {
        self.kills || self.stops || self.closes
    }
}

/// The last length of a piece's data: a program has data blocks of this size.
const ROOM: u16 = 1200;

/// The number of a block's STATUS, sending and receiving.
type Number = fn(u16) -> Option<numbers::Number>;

fn numbers_of(cp: Cp, protocol: Protocol) -> (Number, Number) {
    match (cp, protocol) {
        (Cp::Cp040, _) => (numbers::send_040, numbers::receive_040),
        (_, Protocol::Modbus) => (numbers::send_modbus, numbers::receive_modbus),
        (_, Protocol::Rk512) => (numbers::send_rk512, numbers::receive_rk512),
        (_, Protocol::Procedure) => (numbers::send_3964, numbers::receive_plain),
        _ => (numbers::send_ascii, numbers::receive_plain),
    }
}

fn ms(ms: u64) -> Span {
    Span::from_millis(ms)
}

fn at(millis: u64) -> Instant {
    Instant::START + ms(millis)
}

fn write(byte: u32, bit: u32, on: bool) -> Deed {
    Deed::Write(Cell::Area(Area::Memory, 8 * byte + bit), Width::Bit, u32::from(on))
}

/// The case of a seed, and what the judge has to know of it.
#[must_use]
pub fn case(cp: Cp, seed: u64) -> (Case<Ptp>, Setup) {
    let mut random = Random::new(seed ^ 0x7031_7400 ^ cp as u64);
    let random = &mut random;
    let trouble = Trouble::draw(random);
    let calm = if trouble.moods || trouble.rates || trouble.faults || trouble.kills || trouble.stops || trouble.closes {
        1500 + random.below(3000) as u64
    } else {
        800
    };
    let moods = if trouble.moods { line::moods(random, at(calm)) } else { Moods::GOOD };
    let line = line::draw(cp, random, moods);
    let cycle = [2, 5, 5, 10, 10, 20][random.below(6)];
    let two = random.once_in(10);
    let fetch = line.protocol == Protocol::Rk512 && random.once_in(3);
    let most = if random.once_in(20) {
        if cp == Cp::Cp341 { u64::from(ROOM) - 40 } else { 1000 }
    } else {
        [40, 40, 200][random.below(3)]
    };
    let io = [8, 16, 16, 60][random.below(4)];

    let mut shape = Shape::default();
    let drawn = program(cp, random, &line, &mut shape, (two, fetch, io, cycle));
    let slowest_call = drawn.interval.max(cycle);
    // The calls that a telegram of this length needs, and its characters both ways.
    let transfer =
        ms(slowest_call * (12 + most / if cp == Cp::Cp040 { io - 1 } else { 32 })) + line.each * (2 * most + 40);
    let bound = line.slowest + 2 * transfer + if trouble.is_slow() { ms(11_000) } else { ms(300) };

    let length = length(cp, random, &line, most);
    let mut start = format!("L {length};\nT MW {LENGTH};\nT MW {};\nSET;\n= M {RECEIVES}.0;\n", LENGTH + 2);
    start += &sources(cp, random, &line, two, fetch, most);
    let station = station(cp, &line, cycle, io);

    let busy_for = 2000 + random.below(2500) as u64;
    let end = calm.max(busy_for) + bound.millis() + 1500;
    let (plan, is_wrong) = plan(cp, random, trouble, &line, calm, end - bound.millis() - 500, most, two, &drawn);
    let (text, sites) = finish(shape, &start, is_wrong);
    let last = plan.last().map_or(Instant::START, |(at, _)| *at);
    let mut setup = setup(cp, &line, &drawn, bound, at(calm), fetch, io, trouble);
    setup.last = last;
    let rates = setup.rates;
    let case = Case {
        text,
        sites,
        station,
        partner: line.partner,
        plan,
        rates,
        calm: at(calm),
        duration: ms(end),
        seed: random.bits(),
    };
    (case, setup)
}

/// The places of the blocks in the program that was drawn.
struct Drawn {
    sends: Vec<(usize, usize)>,
    receives: Vec<usize>,
    is_com: bool,
    /// Longest time between two calls.
    interval: u64,
    /// `DBB_NO` of the destination.
    starts: Vec<Starts>,
}

fn home(random: &mut Random) -> Home {
    if random.once_in(12) { Home::Ob35 } else { shape::home(random) }
}

fn program(
    cp: Cp,
    random: &mut Random,
    line: &Line,
    shape: &mut Shape,
    (two, fetch, io, cycle): (bool, bool, u64, u64),
) -> Drawn {
    let mut drawn = Drawn { sends: Vec::new(), receives: Vec::new(), is_com: false, interval: 0, starts: Vec::new() };
    let (send, receive) = pieces::blocks_of(cp);
    let mut fixed = match (cp, line.protocol) {
        (Cp::Cp341, protocol) => {
            let sf = if fetch { "'F'" } else { "'S'" };
            let typ = if protocol == Protocol::Rk512 { "'D'" } else { "'X'" };
            let mut fixed = vec![("SF", sf.to_owned()), ("R_CPU_NO", "1".into()), ("R_TYP", typ.into())];
            fixed.extend([("R_NO", "31".into()), ("R_OFFSET", "0".into())]);
            fixed.extend([("R_CF_BYT", "255".into()), ("R_CF_BIT", "0".into())]);
            fixed
        }
        _ => Vec::new(),
    };
    let mut of_receiver = Vec::new();
    fixed.push(("LADDR", "272".into()));
    of_receiver.push(("LADDR", "272".into()));
    if cp == Cp::Cp040 {
        let size = ("IO_SIZE", format!("W#16#{io:X}"));
        fixed.extend([size.clone(), ("CONTROL", "MB 238".into())]);
        of_receiver.extend([size, ("CONTROL", "MB 238".into())]);
    }
    let is_modbus = line.protocol == Protocol::Modbus;
    let dbb = if is_modbus { 0 } else { [0, 10, 0, 32][random.below(4)] };
    let sending = |random: &mut Random, number: u32| Sending {
        number,
        starts: pieces::starts(random),
        store: shape::store(random),
        is_inner: random.once_in(4),
        dbb,
        mark: 0,
        marks: vec![dbb],
        slots: 1,
        fixed: fixed.clone(),
    };
    let receiving = Receiving {
        store: shape::store(random),
        is_inner: random.once_in(4),
        to: (DESTINATION, [0, 20][random.below(2)]),
        fixed: of_receiver,
    };
    let mut first = sending(random, 0);
    if is_modbus {
        first.slots = 8;
        first.marks = (0..8).flat_map(|slot| [32 * slot + 8, 32 * slot + 10]).collect();
    }
    let rhythm = |random: &mut Random, home: Home, drawn: &mut Drawn| {
        let rhythm = if home == Home::Ob35 { Rhythm::Always } else { shape::rhythm(random) };
        let interval = match (home, &rhythm) {
            (Home::Ob35, _) => 100,
            (_, Rhythm::Nth(n)) => u64::from(*n) * cycle,
            _ => cycle,
        };
        drawn.interval = drawn.interval.max(interval);
        rhythm
    };
    drawn.starts.push(first.starts);
    if cp == Cp::Cp040 && random.once_in(3) {
        let mut com = Sending { fixed: fixed.clone(), ..first };
        com.fixed.retain(|(name, _)| *name != "LADDR");
        com.fixed.extend([("ADDR_IN", "272".to_owned()), ("ADDR_OUT", "272".to_owned())]);
        let made = pieces::both(shape, &com, &receiving);
        drawn.sends.push((made.site, 0));
        drawn.receives.push(made.site);
        drawn.is_com = true;
        let home = home(random);
        let rhythm = rhythm(random, home, &mut drawn);
        shape.put(made.piece, home, &rhythm);
        return drawn;
    }
    let second = two.then(|| {
        let mut second = sending(random, 1);
        (second.slots, second.marks) = (first.slots, first.marks.clone());
        drawn.starts.push(second.starts);
        second
    });
    let mut made = Vec::new();
    let sent = pieces::sends(shape, send, &blocks::SENDING, &first);
    drawn.sends.push((sent.site, 0));
    made.push(sent);
    if let Some(second) = second {
        let sent = pieces::sends(shape, send, &blocks::SENDING, &second);
        drawn.sends.push((sent.site, 0));
        made.push(sent);
    }
    let received = pieces::receives(shape, receive, &blocks::RECEIVING, &receiving);
    drawn.receives.push(received.site);
    // FC 21 before FC 23 as in the example, or the other way round. [S4 L1975-L1978]
    let place = if random.once_in(2) { made.len() } else { 0 };
    made.insert(place, received);
    for made in made {
        let home = home(random);
        let rhythm = rhythm(random, home, &mut drawn);
        shape.put(made.piece, home, &rhythm);
    }
    drawn
}

fn length(cp: Cp, random: &mut Random, line: &Line, most: u64) -> u64 {
    match line.protocol {
        // The slave refuses a request that is too long.
        Protocol::Modbus if cp == Cp::Cp040 => {
            if random.once_in(6) {
                5 + random.below(8) as u64
            } else {
                6
            }
        }
        Protocol::Modbus => 12 + 2 * random.below(10) as u64,
        _ => 2 + random.below(most as usize - 1) as u64,
    }
}

/// The statements of OB 100 that fill the source data blocks.
fn sources(cp: Cp, random: &mut Random, line: &Line, two: bool, fetch: bool, most: u64) -> String {
    let mut text = String::new();
    let blocks = if two { 2 } else { 1 };
    for db in SOURCE..SOURCE + blocks {
        if line.protocol == Protocol::Modbus {
            text += &requests(cp, random, db);
        } else if !fetch {
            let binary = matches!(line.protocol, Protocol::Procedure | Protocol::Rk512);
            text += &pieces::fill(db, most as u32 + 40, binary);
        }
    }
    text
}

/// Eight source areas of a Modbus master. [S4 L1600-L1638]
fn requests(cp: Cp, random: &mut Random, db: u16) -> String {
    let mut text = String::new();
    for slot in 0..8 {
        let register = 16 * random.below(200);
        let words: [usize; 4] = match random.below(if cp == Cp::Cp040 { 8 } else { 14 }) {
            0..4 => [0x0503, register, 1 + random.below(40), 0],
            4 => [0x0504, register, 1 + random.below(120), 0],
            5 => [0x0505, register, [0, 0xFF00][random.below(2)], 0],
            6 => [0x0506, register, 0x1234 + slot, 0],
            7 => [0x0508, 0, 0x4321 + slot, 0],
            8..11 => [0x0510, register, 1 + random.below(4), 0x5678],
            // Broadcasts.
            11 => [0x0006, register, 0x1111 + slot, 0],
            12 => [0x0010, register, 2, 0x2222],
            // Not allowed: the driver refuses it.
            _ => [[0x0003, 0x0509, 0x0505][random.below(3)], 0, 1, 0],
        };
        for (at, word) in words.into_iter().enumerate() {
            let _ = write!(text, "L W#16#{word:X};\nT DB{db}.DBW {};\n", 32 * slot + 2 * at);
        }
    }
    text
}

fn station(cp: Cp, line: &Line, cycle: u64, io: u64) -> String {
    let name = cp.name();
    let bytes = if cp == Cp::Cp040 { format!("bytes = {io}\n") } else { String::new() };
    let params = &line.params;
    format!(
        "[station]\nname = \"drawn\"\n\n[cpu]\nmin_cycle = \"{cycle}ms\"\nwatchdog = \"500ms\"\nmemory_bytes = 1024\nengine = \"reference\"\n\n[program]\nsources \
         = [\"program.awl\"]\nmnemonics = \"de\"\n\n[[plugin]]\npath = \"ob1_{name}\"\n\n[[module]]\ntype = \
         \"{name}\"\nname = \"cp\"\naddress = 272\n{bytes}line = \"pty:line\"\nparams = {{ {params} }}\n"
    )
}

fn finish(mut shape: Shape, start: &str, is_wrong: bool) -> (String, Vec<crate::programs::text::Site>) {
    for db in [SOURCE, SOURCE + 1, DESTINATION, u16::from(TARGET)] {
        shape.program.data_block(db, ROOM + 60);
    }
    // Only a job with a wrong LEN is a programming error: any other is a mistake of the generator.
    if is_wrong {
        shape.program.block("ORGANIZATION_BLOCK", "OB 121", "", "");
    }
    shape.finish(start)
}

#[expect(clippy::too_many_arguments, reason = "all that a plan is drawn from")]
fn plan(
    cp: Cp,
    random: &mut Random,
    trouble: Trouble,
    line: &Line,
    calm: u64,
    last: u64,
    most: u64,
    two: bool,
    drawn: &Drawn,
) -> (Vec<(Instant, Deed)>, bool) {
    let mut plan = Vec::new();
    let mut is_wrong = false;
    let moment = |random: &mut Random, until: u64| 300 + random.below(until.saturating_sub(300).max(1) as usize) as u64;
    let hands = if two { 2 } else { 1 };
    for hand in 0..hands {
        let starts = drawn.starts.get(hand as usize).copied().unwrap_or(Starts::Example);
        if matches!(starts, Starts::Example | Starts::Follows) {
            for _ in 0..3 + random.below(12) {
                let when = moment(random, last);
                plan.push((at(when), write(HAND + hand, 0, true)));
                if starts == Starts::Follows {
                    plan.push((at(when + 1 + random.below(300) as u64), write(HAND + hand, 0, false)));
                }
            }
        }
        if trouble.resets {
            for _ in 0..1 + random.below(4) {
                let when = moment(random, last);
                let byte = if drawn.is_com { RECEIVES } else { HAND + hand };
                let bit = 1;
                plan.push((at(when), write(byte, bit, true)));
                plan.push((at(when + 25 + random.below(300) as u64), write(byte, bit, false)));
            }
        }
        // LEN changes, perhaps in the middle of a job: it counts for the next. [S4 L1598]
        for _ in 0..random.below(5) {
            let when = moment(random, last);
            let length = length(cp, random, line, most);
            let wrong = random.once_in(12);
            is_wrong |= wrong;
            let length = if wrong { [0, 5000, 0xFFFF][random.below(3)] } else { length };
            let cell = Cell::Area(Area::Memory, 8 * (LENGTH + 2 * hand));
            plan.push((at(when), Deed::Write(cell, Width::Word, length as u32)));
            if wrong {
                let next = Deed::Write(cell, Width::Word, length_or(line, most));
                plan.push((at(when + 50 + random.below(300) as u64), next));
            }
        }
    }
    if trouble.resets && random.once_in(2) {
        let when = moment(random, last);
        plan.push((at(when), write(RECEIVES, 1, true)));
        plan.push((at(when + 25 + random.below(200) as u64), write(RECEIVES, 1, false)));
    }
    if trouble.closes {
        for _ in 0..1 + random.below(3) {
            let when = moment(random, calm);
            plan.push((at(when), write(RECEIVES, 0, false)));
            plan.push((at((when + 20 + random.below(1500) as u64).min(calm)), write(RECEIVES, 0, true)));
        }
    }
    if trouble.stops {
        let when = moment(random, calm);
        plan.push((at(when), Deed::Stop));
        plan.push((at((when + 30 + random.below(600) as u64).min(calm)), Deed::Run));
    }
    if trouble.kills {
        for _ in 0..1 + random.below(2) {
            plan.push((at(moment(random, calm)), Deed::Kill));
        }
    }
    if trouble.faults {
        for _ in 0..1 + random.below(4) {
            let fault = [LineFault::Parity, LineFault::Framing, LineFault::Break, LineFault::Overrun][random.below(4)];
            plan.push((at(moment(random, calm)), Deed::Line(fault)));
        }
    }
    if random.below(3) > 0 {
        for number in 1..2 + random.below(12) as u32 {
            let len = 2 + random.below(most as usize - 1) as u32;
            plan.push((at(moment(random, last)), Deed::Partner(number << 16 | len)));
        }
    }
    if line.partner.can_stop {
        for _ in 0..random.below(6) {
            plan.push((at(moment(random, last)), Deed::Partner(super::partner::characters::SAY_XOFF)));
        }
    }
    plan.sort_by_key(|(at, _)| *at);
    // The partner's telegrams have their numbers in the order in which they come.
    let mut numbers = 1..;
    for (_, deed) in &mut plan {
        if let Deed::Partner(what) = deed
            && *what >> 16 > 0
        {
            *what = numbers.next().unwrap_or(1) << 16 | *what & 0xFFFF;
        }
    }
    (plan, is_wrong)
}

fn length_or(line: &Line, most: u64) -> u32 {
    match line.protocol {
        Protocol::Modbus if line.params.contains("rtu") => 6,
        Protocol::Modbus => 12,
        _ => most.min(10) as u32,
    }
}

#[expect(clippy::too_many_arguments, reason = "all that a judge has to know")]
fn setup(
    cp: Cp,
    line: &Line,
    drawn: &Drawn,
    bound: Span,
    calm: Instant,
    fetch: bool,
    io: u64,
    trouble: Trouble,
) -> Setup {
    let (send, receive) = numbers_of(cp, line.protocol);
    let is_040 = cp == Cp::Cp040;
    let (sending, receiving) = match drawn.is_com {
        true => (blocks::COM_SENDING, blocks::COM_RECEIVING),
        false => (blocks::SENDING, blocks::RECEIVING),
    };
    let (of_send, of_receive) = pieces::blocks_of(cp);
    let (of_send, of_receive) = if drawn.is_com { ("FB 65", "FB 65") } else { (of_send.id, of_receive.id) };
    let portions = if is_040 { sender::Portions::Io(io as u32) } else { sender::Portions::Of32 };
    let busy = if is_040 { 0x8181 } else { 0 };
    let aborted = (!is_040).then_some(0x1E0D);
    let answers = if is_040 { (12, ms(600)) } else { (4, Span::ZERO) };
    let blocks = !is_040;
    let send = sender::Manual { block: of_send, busy, portions, reset: aborted, blocks, answers, number: send, bound };
    let portion = if is_040 { io as u32 } else { 32 };
    let receive = receiver::Manual { block: of_receive, busy, portion, aborted, blocks, answers, number: receive };
    // Two bits inverted in one column of a block are not seen by 3964R: only faults that can be seen. [S0 L1650]
    let rate = 300;
    let rates = if trouble.rates {
        FaultRates { parity: rate, framing: rate, lose: rate, ..FaultRates::NONE }
    } else {
        FaultRates::NONE
    };
    let disturbed = trouble.moods || trouble.rates || line.echoes;
    let patience = bound;
    let settle = if disturbed { bound } else { Span::ZERO };
    Setup {
        sends: drawn
            .sends
            .iter()
            .map(|(site, _)| Sends {
                site: *site,
                manual: send,
                names: sending,
                most: cp.most(),
                mark: if line.protocol == Protocol::Modbus { usize::MAX } else { 0 },
            })
            .collect(),
        receives: drawn
            .receives
            .iter()
            .map(|site| Receives { site: *site, manual: receive, names: receiving })
            .collect(),
        protocol: line.protocol,
        tail: line.tail.clone(),
        fetch,
        r_no: 31,
        rates,
        calm: if disturbed { calm + settle.min(ms(4000)) } else { Instant::START + ms(400) },
        patience,
        // As long as the longest telegram. [TIA help "Configuration for point-to-point links"]
        buffer: cp.most() as usize,
        is_040,
        clears: cp != Cp::Cp341,
        is_short: line.echoes,
        last: Instant::START,
    }
}
