//! The protocol on the line: the parameters of the CP and the partner that fits them.

use ob1_time::{Instant, Span};

use crate::compare::random::Random;

use super::draw::Cp;
use super::numbers::Protocol;
use super::partner::characters::{Characters, Frame};
use super::partner::procedure::{Plain, Procedure, Settings};
use super::partner::rk512::Rk512;
use super::partner::{Moods, Ptp, Speaks, slave};

/// A line that was drawn.
#[derive(Debug)]
pub struct Line {
    /// The protocol.
    pub protocol: Protocol,
    /// `params` of the module.
    pub params: String,
    /// The partner.
    pub partner: Ptp,
    /// Time of one character.
    pub each: Span,
    /// The longest time that the protocol may take for a telegram, without its characters.
    pub slowest: Span,
    /// What the CP puts behind each telegram.
    pub tail: Vec<u8>,
    /// The own characters come back on two wires.
    pub echoes: bool,
}

/// Data block of the CPU that SENDs of the partner name.
pub const TARGET: u8 = 44;

/// Draws the line of a CP; `moods` are those of the partner.
pub fn draw(cp: Cp, random: &mut Random, moods: Moods) -> Line {
    let protocol = match (cp, random.below(10)) {
        (Cp::Cp341, 0..3) => Protocol::Procedure,
        (Cp::Cp341, 3..5) => Protocol::Rk512,
        (Cp::Cp341, 5..7) => Protocol::Ascii,
        (Cp::Cp341, _) => Protocol::Modbus,
        (Cp::Cp340, 0..6) => Protocol::Procedure,
        (Cp::Cp340, _) => Protocol::Ascii,
        (Cp::Cp040, 0..3) => Protocol::Ascii,
        (Cp::Cp040, 3..5) => Protocol::StxEtx,
        (Cp::Cp040, 5..7) => Protocol::Procedure,
        (Cp::Cp040, _) => Protocol::Modbus,
    };
    let baud = [9600, 9600, 19200, if cp == Cp::Cp340 { 4800 } else { 38400 }][random.below(4)];
    // A character has at most 12 bits.
    let each = Span::from_nanos(11_500_000_000 / baud);
    match protocol {
        Protocol::Procedure | Protocol::Rk512 => procedure(cp, protocol, random, baud, each, moods),
        Protocol::Ascii | Protocol::StxEtx => characters(cp, protocol, random, baud, each, moods),
        Protocol::Modbus => modbus(cp, random, baud, each, moods),
    }
}

fn procedure(cp: Cp, protocol: Protocol, random: &mut Random, baud: u64, each: Span, moods: Moods) -> Line {
    let qvz = 100 + 20 * random.below(15) as u64;
    // Shorter than QVZ: else each new request would keep an old block open at the other end.
    let zvz = 60 + 20 * random.below((qvz as usize - 60) / 20) as u64;
    let attempts = 1 + random.below(3) as u64;
    let is_high = random.once_in(2);
    let priority = if is_high { "low" } else { "high" };
    let name = if protocol == Protocol::Rk512 { "3964r-rk512" } else { "3964r" };
    let params = match cp {
        Cp::Cp040 => format!(
            "protocol = \"3964r\", baud = {baud}, zvz_ms = {zvz}, qvz_ms = {qvz}, bwz_ms = 2000, stx_repetitions = \
             {attempts}, dbl = {attempts}, priority = \"{priority}\", duplex = \"full\""
        ),
        _ => {
            let reaction = if protocol == Protocol::Rk512 { ", reaction = \"baud\"" } else { "" };
            format!(
                "protocol = \"{name}\", baud = {baud}, zvz_ms = {zvz}, qvz_ms = {qvz}, connect_attempts = {attempts}, \
                 block_attempts = {attempts}, priority = \"{priority}\"{reaction}"
            )
        }
    };
    let ms = Span::from_millis;
    let settings = Settings { qvz: ms(qvz), zvz: ms(zvz), is_high, attempts: 2 + random.below(3) as u32 };
    let procedure = Procedure::new(settings, random.bits());
    let speaks = match protocol {
        Protocol::Rk512 => Speaks::Rk512(Rk512::new(procedure, TARGET)),
        _ => Speaks::Procedure(Plain(procedure)),
    };
    // Every attempt of every repetition, and the partner's own telegrams between them.
    let once = (attempts + 1) * (attempts + 1) * (qvz + zvz) + 500;
    let slowest = ms(2 * once) + if protocol == Protocol::Rk512 { ms(12_000) } else { Span::ZERO };
    let (partner, tail) = (Ptp::new(speaks, moods), Vec::new());
    Line { protocol, params, partner, each, slowest, tail, echoes: false }
}

fn characters(cp: Cp, protocol: Protocol, random: &mut Random, baud: u64, each: Span, moods: Moods) -> Line {
    let ms = Span::from_millis;
    let zvz = 20 + 10 * random.below(6) as u64;
    let mut frame = Frame {
        start: Vec::new(),
        end: Vec::new(),
        strips: false,
        gap: ms(zvz * 7 / 10),
        pause: ms(2 * zvz + 20),
        each,
        flow: false,
    };
    let mut tail = Vec::new();
    let mut slowest = ms(500);
    let flow = cp != Cp::Cp040 && random.once_in(3);
    let flow_key = match (cp, flow) {
        // Without this pause two telegrams are one for the partner.
        (Cp::Cp040, _) => format!(", zna_ms = {zvz}, duplex = \"full\""),
        (_, true) => String::from(", flow = \"xon-xoff\", flow_wait_ms = 2000"),
        (_, false) => String::new(),
    };
    frame.flow = flow;
    if flow {
        slowest += ms(2500);
    }
    let params = match (protocol, random.below(3)) {
        (Protocol::StxEtx, kind) => {
            frame.strips = true;
            frame.gap = ms(1000);
            let (starts, ends) = (1 + kind % 2, 1 + kind / 2);
            frame.start = [2, 4][..starts].to_vec();
            frame.end = [3, 5][..ends].to_vec();
            format!(
                "protocol = \"stx-etx\", baud = {baud}, tmo_ms = {}, start_flags = {starts}, start_flag_1 = 2, \
                 start_flag_2 = 4, end_flags = {ends}, end_flag_1 = 3, end_flag_2 = 5{flow_key}",
                zvz * 10
            )
        }
        (_, 0) if cp != Cp::Cp040 => {
            let two = random.once_in(2);
            frame.end = if two { vec![13, 10] } else { vec![13] };
            frame.gap = ms(1000);
            tail.clone_from(&frame.end);
            let flags =
                if two { "end_flags = 2, end_flag_1 = 13, end_flag_2 = 10" } else { "end_flags = 1, end_flag_1 = 13" };
            format!(
                "protocol = \"ascii\", baud = {baud}, end_criterion = \"end-characters\", {flags}, zvz_ms = {zvz}, sending \
                 = \"append-end\"{flow_key}"
            )
        }
        _ => format!("protocol = \"ascii\", baud = {baud}, zvz_ms = {zvz}{flow_key}"),
    };
    // Where silence ends a telegram, silence after XOFF would end one too.
    let can_stop = flow && !frame.end.is_empty();
    let speaks = Speaks::Characters(Characters::new(frame, random.bits()));
    let mut partner = Ptp::new(speaks, moods);
    partner.can_stop = can_stop;
    Line { protocol, params, partner, each, slowest, tail, echoes: false }
}

fn modbus(cp: Cp, random: &mut Random, baud: u64, each: Span, moods: Moods) -> Line {
    let timeout = 100 + 10 * random.below(30) as u64;
    let echoes = random.once_in(12);
    let two_wires = echoes || random.once_in(3);
    let frame = if cp == Cp::Cp040 { slave::Frame::Rtu } else { slave::Frame::Ascii };
    let params = if cp == Cp::Cp040 {
        let duplex = if two_wires { "half" } else { "full" };
        format!("protocol = \"modbus-master-rtu\", baud = {baud}, wait_ms = {timeout}, duplex = \"{duplex}\"")
    } else {
        let wiring = if two_wires { "two-wire\", preset = \"high" } else { "four-wire" };
        let mode = random.of(&["normal", "interference-suppression"]);
        format!(
            "protocol = \"modbus-ascii-master-32\", baud = {baud}, character_delay_ms = 100, response_timeout_ms = \
             {timeout}, turnaround_ms = 50, operating_mode = \"{mode}\", wiring = \"{wiring}\""
        )
    };
    let settings = slave::Settings { address: 5, frame, timeout: Span::from_millis(timeout), each };
    let speaks = Speaks::Modbus(slave::Slave::new(settings, random.bits()));
    let mut partner = Ptp::new(speaks, moods);
    if echoes {
        partner.echoes = Some(each);
        partner.is_absent = random.once_in(2);
    }
    let slowest = Span::from_millis(3 * timeout + 1500);
    Line { protocol: Protocol::Modbus, params, partner, each, slowest, tail: Vec::new(), echoes }
}

/// When moods end.
#[must_use]
pub fn moods(random: &mut Random, until: Instant) -> Moods {
    Moods { bad: 10 + random.below(50) as u64, until }
}
