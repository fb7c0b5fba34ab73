//! Both directions of a line, character by character, into units.

use super::meaning::{Meaning, Modbus, Names};
use super::{Dialect, Way};
use crate::esp2::WAKE;
use crate::esp2::frame::{self as esp2, FRAME_BYTES};
use crate::machine::{Instant, LineFault, Span};
use crate::mbus::frame::{Frame, FrameError, Progress};
use crate::modbus::pdu::{self, Direction};
use crate::modbus::{ascii, rtu, tcp};
use crate::profibus::telegram::{Parsed, parse};
use crate::s3964::codec::{self, DLE, Decoder, NAK, STX};
use crate::stx_etx;

/// Longest telegram on the wire: 1024 bytes, every one a doubled DLE, and its frame.
const RAW: usize = 2 * 1024 + 16;

/// A telegram or a control character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit<'a> {
    /// When its first character was seen.
    pub begin: Instant,
    /// When its last one was.
    pub end: Instant,
    /// The direction it went, seen from the CP.
    pub way: Way,
    /// Its characters as they were on the line.
    pub raw: &'a [u8],
    /// What its characters mean, as far as they say it.
    pub meaning: Meaning<'a>,
}

/// A little more than the longest QVZ: after it no partner waits for an answer. [S0 "Timeout times"]
const NO_ANSWER: Span = Span::from_secs(6);

type Out<'a> = dyn FnMut(Unit<'_>) + 'a;

/// The unfinished unit of one direction.
#[derive(Debug)]
struct Side {
    raw: [u8; RAW],
    len: usize,
    payload: [u8; RAW],
    payload_len: usize,
    begin: Instant,
    last: Instant,
    link: Link,
    /// Since when `link` has its value.
    since: Instant,
    /// A character of the block could not be read; with start characters: the kept characters began with them.
    damaged: bool,
    flags: Option<stx_etx::Decoder>,
    frames: esp2::Decoder,
}

/// The state of a partner of 3964(R).
#[derive(Clone, Copy, Debug, PartialEq)]
enum Link {
    Idle,
    /// It has sent STX.
    Called,
    /// The other has answered DLE: a block follows.
    Block(Decoder),
    /// It has sent its block.
    Sent,
}

impl Side {
    const fn new() -> Self {
        Self {
            raw: [0; RAW],
            len: 0,
            payload: [0; RAW],
            payload_len: 0,
            begin: Instant::START,
            last: Instant::START,
            link: Link::Idle,
            since: Instant::START,
            damaged: false,
            flags: None,
            frames: esp2::Decoder::new(),
        }
    }

    /// Keeps a character; false if there is no room.
    fn keep(&mut self, now: Instant, byte: u8) -> bool {
        if self.len == 0 {
            self.begin = now;
        }
        self.last = now;
        let Some(place) = self.raw.get_mut(self.len) else { return false };
        *place = byte;
        self.len += 1;
        true
    }

    fn keep_payload(&mut self, byte: u8) {
        // Never longer than the characters on the line.
        if let Some(place) = self.payload.get_mut(self.payload_len) {
            *place = byte;
            self.payload_len += 1;
        }
    }

    fn clear(&mut self) {
        (self.len, self.payload_len, self.damaged) = (0, 0, false);
    }

    fn turn(&mut self, now: Instant, link: Link) {
        (self.link, self.since) = (link, now);
    }

    fn raw(&self) -> &[u8] {
        &self.raw[..self.len]
    }

    /// Outputs everything that is kept.
    fn put(&mut self, way: Way, meaning: impl FnOnce(&[u8], &[u8], &mut dyn FnMut(Meaning<'_>)), out: &mut Out<'_>) {
        let (raw, payload) = (&self.raw[..self.len], &self.payload[..self.payload_len]);
        let (begin, end) = (self.begin, self.last);
        meaning(raw, payload, &mut |meaning| out(Unit { begin, end, way, raw, meaning }));
        self.clear();
    }
}

/// Reads both directions of one line.
#[derive(Debug)]
pub struct Reader {
    dialect: Dialect,
    sides: [Side; 2],
    /// Loadable driver of a CP 341: registers in its last telegram, and whether they have 32 bits.
    asked: (u16, bool),
}

impl Reader {
    /// A reader of a quiet line.
    pub fn new(dialect: Dialect) -> Self {
        Self { dialect, sides: [Side::new(), Side::new()], asked: (0, false) }
    }

    /// The protocol it expects.
    pub const fn dialect(&self) -> &Dialect {
        &self.dialect
    }

    /// When the oldest unfinished telegram began.
    pub fn open_since(&self) -> Option<Instant> {
        self.sides.iter().filter(|side| side.len > 0).map(|side| side.begin).min()
    }

    /// Takes characters that were seen at `now`.
    pub fn characters(&mut self, now: Instant, way: Way, bytes: &[u8], out: &mut Out<'_>) {
        self.silence(now, out);
        // An answer ends what it answers.
        let other = way.other();
        if !bytes.is_empty()
            && !matches!(self.dialect, Dialect::S3964 { .. } | Dialect::Ascii { .. } | Dialect::EnOcean { .. })
        {
            self.close(other, out);
        }
        for &byte in bytes {
            match self.dialect {
                Dialect::Ascii { .. } => self.keep(now, way, byte, out),
                Dialect::StxEtx { start, end, .. } => {
                    self.keep(now, way, byte, out);
                    self.stx_etx(way, byte, start, end, out);
                }
                Dialect::S3964 { bcc, rk512, .. } => self.s3964(now, way, byte, bcc, rk512, out),
                Dialect::ModbusRtu { master, .. } => {
                    self.keep(now, way, byte, out);
                    self.modbus_rtu(way, master, out);
                }
                Dialect::ModbusAscii { master, loadable, .. } => {
                    if byte == ascii::START {
                        self.close(way, out);
                    }
                    self.keep(now, way, byte, out);
                    if byte == ascii::LF {
                        self.modbus_ascii(way, master, loadable, out);
                    }
                }
                Dialect::EnOcean { .. } => {
                    self.keep(now, way, byte, out);
                    self.enocean(way, byte, out);
                }
                Dialect::MBus { .. } => {
                    self.keep(now, way, byte, out);
                    self.mbus(way, out);
                }
                Dialect::ModbusTcp { .. } => {
                    self.keep(now, way, byte, out);
                    self.modbus_tcp(way, out);
                }
                Dialect::Profibus { .. } => {
                    self.keep(now, way, byte, out);
                    self.profibus(way, out);
                }
            }
        }
    }

    /// A character came in that the line could not read.
    pub fn fault(&mut self, now: Instant, fault: LineFault, out: &mut Out<'_>) {
        self.silence(now, out);
        let side = &mut self.sides[Way::In as usize];
        let mut complete = false;
        if let Link::Block(decoder) = &mut side.link {
            // The block continues, but it is already invalid.
            side.damaged = true;
            complete = decoder.unreadable();
        } else {
            self.close(Way::In, out);
        }
        out(Unit { begin: now, end: now, way: Way::In, raw: &[], meaning: Meaning::Fault(fault) });
        if complete {
            let side = &mut self.sides[Way::In as usize];
            side.turn(now, Link::Sent);
            side.put(Way::In, |_, _, put| put(Meaning::Broken("block with an unreadable check character")), out);
        }
    }

    /// Everything handed to the line has left.
    pub fn done(&mut self, now: Instant, out: &mut Out<'_>) {
        self.silence(now, out);
        if matches!(self.dialect, Dialect::Ascii { .. }) {
            self.close(Way::Out, out);
        }
    }

    /// Time has passed: outputs what a pause has ended.
    pub fn silence(&mut self, now: Instant, out: &mut Out<'_>) {
        for way in [Way::Out, Way::In] {
            let side = &mut self.sides[way as usize];
            let quiet = now.since(if side.len > 0 { side.last } else { side.since });
            let patience =
                if side.link == Link::Called || side.link == Link::Sent { NO_ANSWER } else { self.dialect.pause() };
            if quiet > patience {
                self.close(way, out);
                self.sides[way as usize].link = Link::Idle;
            }
        }
    }

    /// Outputs unfinished units, as at the end of a recording.
    pub fn finish(&mut self, out: &mut Out<'_>) {
        self.close(Way::Out, out);
        self.close(Way::In, out);
    }

    /// Outputs the unfinished unit of one direction.
    fn close(&mut self, way: Way, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        side.flags = None;
        side.frames.reset();
        if side.len == 0 {
            return;
        }
        match self.dialect {
            Dialect::Ascii { .. } => side.put(way, |raw, _, put| put(Meaning::Telegram(raw)), out),
            Dialect::StxEtx { .. } => {
                let why = if side.damaged { "telegram without its end" } else { "outside a telegram" };
                side.put(way, |_, _, put| put(Meaning::Broken(why)), out);
            }
            Dialect::S3964 { .. } => {
                let block = matches!(side.link, Link::Block(_));
                side.link = Link::Idle;
                let why = if block { "block broken off" } else { "characters without a meaning here" };
                side.put(way, |_, _, put| put(Meaning::Broken(why)), out);
            }
            Dialect::ModbusRtu { .. } => {
                let why = if side.len < 4 { "frame too short" } else { "frame with a wrong CRC, or not all of it" };
                side.put(way, |_, _, put| put(Meaning::Broken(why)), out);
            }
            Dialect::ModbusAscii { .. } => {
                side.put(way, |_, _, put| put(Meaning::Broken("frame without its end")), out);
            }
            Dialect::EnOcean { .. } => {
                let damaged = side.damaged;
                side.put(way, |raw, _, put| put(outside_a_frame(raw, damaged)), out);
            }
            Dialect::ModbusTcp { .. } => {
                side.put(way, |_, _, put| put(Meaning::Broken("frame of Modbus TCP without its end")), out);
            }
            Dialect::Profibus { .. } => {
                side.put(way, |_, _, put| put(Meaning::Broken("characters that are no telegram")), out);
            }
            Dialect::MBus { .. } => {
                let why = match Frame::decode(&side.raw[..side.len]) {
                    Progress::Wrong(FrameError::Check { .. }) => "frame with a wrong check sum",
                    Progress::Wrong(_) => "no frame",
                    Progress::More | Progress::Whole(..) => "frame without its end",
                };
                side.put(way, |_, _, put| put(Meaning::Broken(why)), out);
            }
        }
    }

    fn keep(&mut self, now: Instant, way: Way, byte: u8, out: &mut Out<'_>) {
        if !self.sides[way as usize].keep(now, byte) {
            self.close(way, out);
            self.sides[way as usize].keep(now, byte);
        }
    }

    fn stx_etx(&mut self, way: Way, byte: u8, start: stx_etx::Flags, end: stx_etx::Flags, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        let mut decoder = side.flags.take().unwrap_or_else(|| stx_etx::Decoder::new(start, end));
        let mut complete = false;
        decoder.feed(byte, &mut |_, step| match step {
            stx_etx::Step::Data(byte) => side.keep_payload(byte),
            stx_etx::Step::Begin => (side.payload_len, side.damaged) = (0, true),
            stx_etx::Step::End => complete = true,
            stx_etx::Step::Noise(_) => {}
        });
        side.flags = Some(decoder);
        if complete {
            side.put(way, |_, payload, put| put(Meaning::Telegram(payload)), out);
        }
    }

    fn s3964(&mut self, now: Instant, way: Way, byte: u8, bcc: bool, rk512: bool, out: &mut Out<'_>) {
        let [first, second] = &mut self.sides;
        let (side, other) = if way == Way::Out { (first, second) } else { (second, first) };
        if let Link::Block(mut decoder) = side.link {
            if !side.keep(now, byte) {
                side.turn(now, Link::Idle);
                side.put(way, |_, _, put| put(Meaning::Broken("block without an end")), out);
                return;
            }
            let step = decoder.push(byte);
            side.link = Link::Block(decoder);
            match step {
                codec::Step::More => {}
                codec::Step::Data(byte) => side.keep_payload(byte),
                codec::Step::BadDle(_) => {
                    side.turn(now, Link::Idle);
                    side.put(way, |_, _, put| put(Meaning::Broken("DLE without DLE or ETX after it")), out);
                }
                codec::Step::End { check } => {
                    side.turn(now, Link::Sent);
                    let damaged = side.damaged;
                    let meaning = |_: &[u8], payload: &[u8], put: &mut dyn FnMut(Meaning<'_>)| {
                        put(if damaged {
                            Meaning::Broken("block with an unreadable character")
                        } else {
                            Meaning::Block { payload, check, rk512 }
                        });
                    };
                    side.put(way, meaning, out);
                }
            }
            return;
        }
        // A connection request, an answer, or a character without meaning here.
        let (idle, answered) = (Link::Idle, other.link);
        let (own, others, text) = match (byte, answered) {
            (STX, Link::Called) => (Link::Called, answered, "connection request, conflict: both want to send"),
            (STX, _) => (Link::Called, answered, "connection request"),
            (DLE, Link::Called) => (idle, Link::Block(Decoder::new(bcc)), "ready to receive"),
            (DLE, Link::Sent) => (idle, idle, "block received"),
            (NAK, Link::Called) => (side.link, idle, "connection refused"),
            (NAK, Link::Sent) => (side.link, idle, "block refused"),
            (NAK, Link::Block(_)) => (side.link, idle, "block broken off by the receiver"),
            // It ends what it has begun itself: QVZ is over, and nobody has answered. [S0 L1629]
            (NAK, Link::Idle) if side.link == Link::Called => (idle, idle, "connection given up"),
            (NAK, Link::Idle) if side.link == Link::Sent => (idle, idle, "block given up"),
            (NAK, Link::Idle) => (side.link, idle, "no connection"),
            _ => {
                // More of them may follow: they are output together.
                if !side.keep(now, byte) {
                    self.close(way, out);
                }
                return;
            }
        };
        self.close(way, out);
        if byte == NAK {
            // The unit it interrupts is output first.
            self.close(way.other(), out);
        }
        let name = match byte {
            STX => "STX",
            DLE => "DLE",
            _ => "NAK",
        };
        let [first, second] = &mut self.sides;
        let (side, other) = if way == Way::Out { (first, second) } else { (second, first) };
        side.turn(now, own);
        if other.link != others {
            other.turn(now, others);
        }
        side.keep(now, byte);
        side.put(way, |_, _, put| put(Meaning::Control(name, text)), out);
    }

    /// A frame ends where its length says so and its CRC is correct; anything else ends with a pause or an answer.
    fn modbus_rtu(&mut self, way: Way, master: bool, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        let Ok(telegram) = rtu::decode(side.raw()) else { return };
        let asked = if (way == Way::Out) == master { Direction::Request } else { Direction::Answer };
        let other = if asked == Direction::Request { Direction::Answer } else { Direction::Request };
        // A slave hears the answers of other slaves too.
        let fits = |direction| pdu::length(direction, telegram, pdu::REGISTER_BYTES) == Some(telegram.len());
        let Some(direction) = [asked, other].into_iter().find(|direction| fits(*direction)) else { return };
        let length = telegram.len();
        side.put(
            way,
            |raw, _, put| {
                let telegram = raw.get(..length).unwrap_or(raw);
                put(Meaning::Modbus(Modbus { telegram, direction, names: Names::Vipa }));
            },
            out,
        );
    }

    /// A frame tells its length; anything else ends with a pause, or when the other side speaks.
    /// Both directions at once, each by itself: there are no answers on this line.
    fn enocean(&mut self, way: Way, byte: u8, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        match side.frames.feed(byte) {
            esp2::Step::More | esp2::Step::Noise(_) => {}
            esp2::Step::Wrong { .. } => side.damaged = true,
            esp2::Step::Telegram(telegram) => {
                let before = side.len.saturating_sub(FRAME_BYTES);
                let (begin, end) = (side.begin, side.last);
                if let Some(raw) = side.raw.get(..before).filter(|raw| !raw.is_empty()) {
                    out(Unit { begin, end, way, raw, meaning: outside_a_frame(raw, side.damaged) });
                }
                let raw = side.raw.get(before..side.len).unwrap_or_default();
                out(Unit { begin, end, way, raw, meaning: Meaning::EnOcean(&telegram) });
                side.clear();
            }
        }
    }

    /// A frame ends where its length says so: there is no check.
    fn modbus_tcp(&mut self, way: Way, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        let &[_, _, 0, 0, high, low, ref telegram @ ..] = side.raw() else { return };
        if telegram.len() != usize::from(u16::from_be_bytes([high, low])) {
            return;
        }
        let direction = if way == Way::Out { Direction::Request } else { Direction::Answer };
        side.put(
            way,
            |raw, _, put| {
                let telegram = raw.get(tcp::HEAD_BYTES..).unwrap_or_default();
                put(Meaning::Modbus(Modbus { telegram, direction, names: Names::Vipa }));
            },
            out,
        );
    }

    fn profibus(&mut self, way: Way, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        match parse(side.raw()) {
            Parsed::More => {}
            Parsed::Wrong => self.close(way, out),
            Parsed::Telegram(..) => side.put(
                way,
                |raw, _, put| {
                    if let Parsed::Telegram(telegram, _) = parse(raw) {
                        put(Meaning::Profibus(telegram));
                    }
                },
                out,
            ),
        }
    }

    fn mbus(&mut self, way: Way, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        if !matches!(Frame::decode(&side.raw[..side.len]), Progress::Whole(..)) {
            return;
        }
        side.put(
            way,
            |raw, _, put| {
                if let Progress::Whole(frame, _) = Frame::decode(raw) {
                    put(Meaning::MBus(frame));
                }
            },
            out,
        );
    }

    fn modbus_ascii(&mut self, way: Way, master: bool, loadable: bool, out: &mut Out<'_>) {
        let side = &mut self.sides[way as usize];
        let direction = if (way == Way::Out) == master { Direction::Request } else { Direction::Answer };
        match ascii::decode(&side.raw[..side.len], &mut side.payload) {
            Ok(length) => {
                side.payload_len = length;
                let mut names = Names::Vipa;
                if loadable {
                    (names, self.asked) = Names::loadable(&side.payload[..length], direction, self.asked);
                }
                side.put(way, |_, telegram, put| put(Meaning::Modbus(Modbus { telegram, direction, names })), out);
            }
            Err(_) => side.put(way, |_, _, put| put(Meaning::Broken("frame with a wrong LRC, or none")), out),
        }
    }
}

/// Characters of EnOcean that are not a frame.
fn outside_a_frame(raw: &[u8], damaged: bool) -> Meaning<'static> {
    match raw {
        [WAKE] => Meaning::Control("WAKE", "the module is to wake up"),
        _ if damaged => Meaning::Broken("frame with a wrong check sum"),
        _ => Meaning::Broken("outside a frame"),
    }
}
