//! A seed gives a program around the handling blocks of the CP 240, its station, its partner and what happens to them.

use ob1_cpu::{Cell, Width};
use ob1_firmware::LineFault;
use ob1_line::sim::FaultRates;
use ob1_model::Area;
use ob1_time::{Instant, Span};

use crate::compare::random::Random;
use crate::programs::partner::{Manners, Pace};
use crate::programs::run::{Case, Deed};
use crate::programs::shape::{self, Home, Piece, Rhythm, Shape};
use crate::programs::text::{Operand, Site, Type};
use crate::sim::{MS, SECOND};

use super::blocks;
use super::partner::Partner240;

/// What the CP speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// ASCII
    Ascii,
    /// ASCII-fragmented
    Fragmented,
    /// STX/ETX
    StxEtx,
    /// 3964
    P3964,
    /// 3964R
    P3964R,
    /// 3964R with RK 512
    Rk512,
}

impl Protocol {
    /// The partner acknowledges telegrams.
    #[must_use]
    pub fn acknowledges(self) -> bool {
        matches!(self, Self::P3964 | Self::P3964R | Self::Rk512)
    }

    fn key(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Fragmented => "ascii-fragmented",
            Self::StxEtx => "stx-etx",
            Self::P3964 => "3964",
            Self::P3964R => "3964r",
            Self::Rk512 => "3964r-rk512",
        }
    }
}

/// Times of the line and of the procedure, as parametrised.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// A character.
    pub char: Span,
    /// ZNA
    pub zna: Span,
    /// ZVZ or TMO
    pub zvz: Span,
    /// QVZ
    pub qvz: Span,
    /// BWZ
    pub bwz: Span,
    /// STX repetitions
    pub stx: u32,
    /// DBL
    pub dbl: u32,
    /// Cycle of OB 1.
    pub cycle: Span,
}

/// What a place in the program is for the judge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// FC 0 of a sender.
    Send(usize),
    /// The program has given a sender an order: the number of the telegram, and ANZ.
    Feed(usize),
    /// FC 1 or FC 11.
    Receive,
    /// The program has taken a telegram and resets EMFR.
    Consume,
    /// FC 8
    Modem,
    /// FC 9
    Synchron,
    /// FC 3
    SendRk(usize),
    /// FC 2
    Fetch(usize),
    /// FC 4
    Serve,
}

/// A job that the program gives again and again.
#[derive(Clone, Debug)]
pub struct Sender {
    /// Data blocks with their lengths; the program may change between them. Length 0: it does not exist.
    pub blocks: Vec<(u16, u32)>,
    /// First byte.
    pub abd: u32,
    /// Double word of bit memory with the number of the next telegram.
    pub next: u32,
}

/// Where the program receives.
#[derive(Clone, Debug, Default)]
pub struct Receiver {
    /// Data block and its length; 0: it does not exist.
    pub block: (u16, u32),
    /// First byte.
    pub abd: u32,
    /// Calls in the program.
    pub calls: usize,
}

/// What the judge knows of a case: what the program's author would know.
#[derive(Clone, Debug)]
pub struct Facts {
    /// Protocol
    pub protocol: Protocol,
    /// Times
    pub times: Times,
    /// Role of each place.
    pub roles: Vec<Role>,
    /// Jobs with FC 0, FC 3 or FC 2.
    pub senders: Vec<Sender>,
    /// FC 1 or FC 11.
    pub receiver: Receiver,
    /// The control bits lie as FC 9 wants them [S0 L975].
    pub wired: bool,
    /// Communication only while ANL is 0 [S0 L1064].
    pub waits_for_anl: bool,
    /// The line has faults before this time.
    pub calm: Instant,
    /// Telegrams have no control characters (XON, STX ...).
    pub plain: bool,
    /// The partner is an echo and nothing else.
    pub echo: bool,
    /// RK 512: data block of the partner's orders.
    pub served: Vec<(u16, u32)>,
}

/// A case with what the judge knows of it.
#[derive(Debug)]
pub struct Case240 {
    /// The case.
    pub case: Case<Partner240>,
    /// See there.
    pub facts: Facts,
}

/// The first address of the module.
pub(super) const ADR: &str = "256";
/// ANL, NULL and RESET of FC 9.
pub(super) const ANL: &str = "M 3.0";
const RESET: (u32, u32) = (3, 2);

pub(super) struct Draft<'r> {
    pub(super) random: &'r mut Random,
    pub(super) shape: Shape,
    pub(super) roles: Vec<Role>,
    pub(super) senders: Vec<Sender>,
    pub(super) receiver: Receiver,
    pub(super) protocol: Protocol,
    pub(super) wired: bool,
    pub(super) guarded: bool,
    pub(super) plain: bool,
    pub(super) plan: Vec<(Instant, Deed)>,
    pub(super) duration: Span,
    pub(super) ob35: bool,
    /// What OB 100 does besides.
    pub(super) start: String,
}

impl Draft<'_> {
    /// Registers a place with its role; returns its text.
    pub(super) fn site(&mut self, site: Site, role: Role) -> String {
        self.roles.push(role);
        self.shape.program.site(site)
    }

    /// A time within the run.
    pub(super) fn moment(&mut self) -> Instant {
        Instant::START + 100 * MS + self.duration / 1000 * (self.random.below(800) as u64)
    }

    pub(super) fn deed(&mut self, at: Instant, deed: Deed) {
        self.plan.push((at, deed));
    }

    /// A bit of bit memory that somebody switches on and off at times; on at the start if `on`.
    pub(super) fn switched(&mut self, on: bool, times: usize) -> String {
        let mut piece = Piece::default();
        let operand = self.shape.operand(shape::Store::Memory, Type::Bool, "", &mut piece);
        let Operand::Memory(byte, bit) = operand else { return String::new() };
        let cell = Cell::Area(Area::Memory, 8 * byte + bit);
        if on {
            self.start += &format!("SET;\nS M {byte}.{bit};\n");
        }
        let mut moments: Vec<Instant> = (0..times).map(|_| self.moment()).collect();
        moments.sort_unstable();
        for (index, at) in moments.into_iter().enumerate() {
            let value = u32::from(on) ^ 1 ^ (index as u32 & 1);
            self.deed(at, Deed::Write(cell, Width::Bit, value));
        }
        operand.text(Type::Bool)
    }

    /// Where and when a piece runs.
    pub(super) fn put(&mut self, piece: Piece) {
        let home = if self.ob35 && self.random.once_in(6) { Home::Ob35 } else { shape::home(self.random) };
        let rhythm = match self.random.below(20) {
            0 => {
                let times = 1 + self.random.below(4);
                let bit = self.switched(true, times);
                Rhythm::While(format!("U {bit};\n"))
            }
            _ => shape::rhythm(self.random),
        };
        self.put_at(piece, home, &rhythm);
    }

    pub(super) fn put_at(&mut self, mut piece: Piece, home: Home, rhythm: &Rhythm) {
        if self.guarded {
            piece.text = self.shape.program.only_if(&format!("UN {ANL};\n"), &piece.text);
        }
        self.shape.put(piece, home, rhythm);
    }

    fn synchron(&mut self, steuerb: &[Operand; 2]) {
        let mut operands = vec![
            Operand::fixed(ADR),
            Operand::fixed("T 2"),
            Operand::Memory(3, 0),
            Operand::Memory(3, 1),
            Operand::Memory(RESET.0, RESET.1),
        ];
        operands.extend(steuerb.iter().cloned());
        let text = self.site(Site::call(&blocks::SYNCHRON, operands), Role::Synchron);
        self.shape.head = text;
        // "as long as no start-up no SEND/RECEIVE processing" [S0 L842]; or each piece looks for itself, as in OB 35.
        if !self.guarded && !self.ob35 && self.random.once_in(2) {
            self.shape.head += &format!("U {ANL};\nBEB;\n");
        } else {
            self.guarded = true;
        }
    }

    fn modem(&mut self) {
        let mut piece = Piece::default();
        let store = shape::store(self.random);
        let (bits, _) = self.shape.bits(store, &["rts", "dtr", "mrts", "mdtr", "start", "laeu"], &mut piece);
        let bytes: Vec<Operand> =
            ["status", "delta"].iter().map(|name| self.shape.operand(store, Type::Byte, name, &mut piece)).collect();
        let ret = self.shape.operand(store, Type::Word, "ret", &mut piece);
        let operands = vec![
            Operand::fixed(ADR),
            bits[0].clone(),
            bits[1].clone(),
            bits[2].clone(),
            bits[3].clone(),
            bytes[0].clone(),
            bytes[1].clone(),
            bits[4].clone(),
            bits[5].clone(),
            ret,
        ];
        let start = bits[4].text(Type::Bool);
        let text = self.site(Site::call(&blocks::MODEM, operands), Role::Modem);
        let asks = if self.random.once_in(2) { 0 } else { 1 + self.random.below(6) };
        let ask = (asks > 0).then(|| {
            let bit = self.switched(false, asks);
            format!("U {bit};\nS {start};\nR {bit};\n")
        });
        // "must not be called as long as a transmit command is running" [S0 L1035]: some programs obey.
        let text = match self.random.below(4) {
            0 if self.protocol != Protocol::Rk512 => {
                let frg = format!("UN {};\n", self.frg());
                self.shape.program.only_if(&frg, &text)
            }
            1 if ask.is_some() => self.shape.program.only_if(&format!("U {start};\n"), &text),
            _ => text,
        };
        piece.text = ask.unwrap_or_default() + &text;
        self.put(piece);
    }

    /// FRG of the first sender, as far as it lies in global memory.
    fn frg(&self) -> String {
        orders_frg(&self.shape.program.sites, &self.roles)
    }
}

fn orders_frg(sites: &[Site], roles: &[Role]) -> String {
    let frg = blocks::index(&blocks::SEND, "FRG");
    let of = sites.iter().zip(roles).find(|(_, role)| matches!(role, Role::Send(_)));
    match of.and_then(|(site, _)| site.operands[frg].clone()) {
        Some(operand @ (Operand::Memory(..) | Operand::Data(..))) => operand.text(Type::Bool),
        // It lies in an instance: the program does not know.
        _ => "M 9.7".to_owned(),
    }
}

/// Draws a case.
pub fn case(random: &mut Random, seed: u64) -> Case240 {
    use Protocol::{Ascii, Fragmented, P3964, P3964R, Rk512, StxEtx};
    let protocol =
        [P3964R, P3964R, P3964R, Rk512, Rk512, Rk512, Rk512, Ascii, Ascii, StxEtx, P3964, Fragmented][random.below(12)];
    let baud = [9600, 19200, 38400, 115_200, 115_200][random.below(5)];
    let ticks = |n: usize| 20 * MS * n as u64;
    let times = Times {
        char: SECOND * 11 / baud,
        zna: ticks([0, 0, 0, 1, 5][random.below(5)]),
        zvz: ticks(1 + random.below(5)),
        qvz: ticks(2 + random.below(5)),
        bwz: ticks(5 + random.below(15)),
        stx: random.below(4) as u32,
        dbl: 1 + random.below(3) as u32,
        cycle: MS * [1, 2, 2, 4, 5, 5, 10, 10][random.below(8)],
    };
    let flow = matches!(protocol, Ascii | StxEtx) && random.once_in(3);
    let rates = match protocol {
        _ if random.below(10) < 6 => FaultRates::NONE,
        P3964R | Rk512 => FaultRates { flip: 0, ..FaultRates::all([500, 2_000, 8_000][random.below(3)]) },
        // Without a check character the receiver sees only what the character itself shows.
        _ => FaultRates { parity: 3_000, framing: 1_000, break_: 500, ..FaultRates::NONE },
    };
    // Short, because many programs find more than long ones; a few longer than a block waits for one that is gone.
    let short = 2 * SECOND + SECOND / 2 * random.below(4) as u64;
    let duration = if seed % 10 == 9 { 6 * SECOND } else { short };
    let calm = if rates == FaultRates::NONE { Instant::START } else { Instant::START + duration / 3 };
    let ob35 = random.once_in(4);
    let mut draft = Draft {
        shape: Shape::default(),
        roles: Vec::new(),
        senders: Vec::new(),
        receiver: Receiver::default(),
        protocol,
        wired: !random.once_in(4),
        guarded: random.once_in(2),
        plain: !protocol.acknowledges(),
        plan: Vec::new(),
        duration,
        ob35,
        start: String::new(),
        random,
    };
    let steuerb = [Operand::Memory(2, 0), Operand::Memory(1, 0)];
    draft.synchron(&steuerb);
    let mut served = Vec::new();
    let mut order = if protocol == Rk512 { vec![0, 1, 2] } else { vec![3, 4] };
    if draft.random.once_in(2) {
        order.push(5);
    }
    if protocol == Rk512 && draft.random.once_in(4) {
        order.remove(draft.random.below(3));
    }
    if protocol != Rk512 && draft.random.once_in(12) {
        order.push(6);
    }
    for at in (1..order.len()).rev() {
        order.swap(at, draft.random.below(at + 1));
    }
    let store = if draft.wired { shape::Store::Memory } else { shape::store(draft.random) };
    // Pieces of the program first whose operands others name.
    for what in order {
        match what {
            0 => super::orders::send_rk(&mut draft, store),
            1 => super::orders::fetch(&mut draft, store),
            2 => served = super::serve::serve(&mut draft),
            3 => {
                let manual = draft.wired;
                super::orders::send(&mut draft, store, manual);
            }
            4 => super::orders::receive(&mut draft, store),
            5 => draft.modem(),
            _ => super::orders::send(&mut draft, shape::Store::Data, false),
        }
    }
    let guarded = draft.guarded || draft.shape.head.contains("BEB");
    let partner = partner(&mut draft, times, flow);
    events(&mut draft, protocol);
    let Draft { shape, roles, start, senders, receiver, wired, plain, mut plan, random, .. } = draft;
    plan.sort_by_key(|(at, _)| *at);
    let (text, sites) = shape.finish(&format!("{start}SET;\nS {ANL};\n"));
    let mut params = format!("protocol = \"{}\", baud = {baud}, zna_ms = {}", protocol.key(), times.zna.millis());
    let zvz = times.zvz.millis();
    params += &match protocol {
        Ascii | Fragmented => format!(", zvz_ms = {zvz}, receive_buffers = 250"),
        StxEtx => format!(", tmo_ms = {zvz}"),
        _ => format!(
            ", zvz_ms = {zvz}, qvz_ms = {}, bwz_ms = {}, stx_repetitions = {}, dbl = {}, priority = \"{}\"",
            times.qvz.millis(),
            times.bwz.millis(),
            times.stx,
            times.dbl,
            if partner.is_high() { "low" } else { "high" }
        ),
    };
    if flow {
        params += ", flow = \"xon-xoff\"";
    }
    let station = format!(
        "[station]\nname = \"programs\"\n[cpu]\nmin_cycle = \"{}ms\"\nwatchdog = \"500ms\"\nmemory_bytes = 1024\n\
         engine = \"reference\"\n[[cpu.cyclic]]\nob = 35\nperiod = \"{}ms\"\n\
         [program]\nsources = [\"program.awl\"]\nmnemonics = \"de\"\n[[plugin]]\npath = \"ob1_cp240\"\n\
         [[module]]\ntype = \"cp240\"\nname = \"cp\"\naddress = {ADR}\nline = \"pty:partner\"\nparams = {{ {params} }}\n",
        times.cycle.millis(),
        5 + random.below(20),
    );
    let echo = partner.is_echo();
    let facts =
        Facts { protocol, times, roles, senders, receiver, wired, waits_for_anl: guarded, calm, plain, echo, served };
    let case = Case { text, sites, station, partner, plan, rates, calm, duration, seed };
    Case240 { case, facts }
}

fn partner(draft: &mut Draft<'_>, times: Times, flow: bool) -> Partner240 {
    // A STX that is repeated must not be taken for the rest of a telegram.
    let pace = Pace { char: times.char, qvz: times.qvz, zvz: times.qvz * 6 / 10 };
    let random = Random::new(draft.random.bits());
    let manners = Manners::draw(draft.random);
    let high = draft.random.once_in(2);
    // A telegram of its own would hold its XOFF up.
    let sends = if flow { 0 } else { [0, 3, 10, 25][draft.random.below(4)] };
    let partner = match draft.protocol {
        Protocol::Rk512 => Partner240::rk512(high, manners, pace, times.bwz, random),
        protocol if protocol.acknowledges() => {
            Partner240::procedure(protocol == Protocol::P3964R, high, manners, pace, random)
        }
        protocol => {
            let stops = flow.then(|| (10 + draft.random.below(60), MS * (5 + draft.random.below(200) as u64)));
            let echo = draft.random.once_in(10);
            Partner240::stream(protocol == Protocol::StxEtx, times, stops, echo)
        }
    };
    for _ in 0..sends {
        let at = draft.moment();
        let what = draft.random.bits() as u32;
        draft.deed(at, Deed::Partner(what));
    }
    partner
}

/// RESET, STOP and RUN, kills, faults of the line as a whole.
fn events(draft: &mut Draft<'_>, _protocol: Protocol) {
    if draft.random.once_in(3) {
        for _ in 0..1 + draft.random.below(3) {
            let at = draft.moment();
            let cell = Cell::Area(Area::Memory, 8 * RESET.0 + RESET.1);
            draft.deed(at, Deed::Write(cell, Width::Bit, 1));
        }
    }
    if draft.random.once_in(6) {
        let at = draft.moment();
        draft.deed(at, Deed::Stop);
        let pause = MS * (5 + draft.random.below(300) as u64);
        draft.deed(at + pause, Deed::Run);
    }
    if draft.random.once_in(6) {
        for _ in 0..1 + draft.random.below(2) {
            let at = draft.moment();
            draft.deed(at, Deed::Kill);
        }
    }
    if draft.random.once_in(12) {
        let at = draft.moment();
        let pause = MS * (20 + draft.random.below(300) as u64);
        draft.deed(at, Deed::Line(LineFault::Gone));
        draft.deed(at + pause, Deed::Line(LineFault::Back));
    }
}
