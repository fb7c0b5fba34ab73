//! What the bytes of a telegram mean: function codes, lengths, requests, answers, exceptions.
//! [S0 "Modbus - Function codes"]
//!
//! Registers have two bytes; where a slave also has registers of four bytes (codes 03h, 06h, 10h with the "32-bit
//! extensions" of [S4 "32-Bit Registers"]), the functions take the size as a parameter.

use core::ops::Range;

use ob1_words::codes;

/// Bytes of a register.
pub const REGISTER_BYTES: usize = 2;
/// Bytes of a register with 32-bit extensions.
pub const LONG_REGISTER_BYTES: usize = 4;
/// Maximum bytes of user data in a telegram. [S0 L2397], [S0 L2458]
pub const DATA_BYTES: usize = 250;
/// Address of all slaves. [S0 "Broadcast with slave address = 0"]
pub const BROADCAST: u8 = 0;
/// Set in the function code of an answer that announces an error. [S0 "Respond of the slave"]
pub const ERROR_BIT: u8 = 0x80;

/// 17h: write n words and read n words of the output area 4x in one telegram. Not one of the manual's eight: a master
/// of couplers may use it, a CP does not know it. ["MODBUS Application Protocol Specification V1.1b3", 6.17]
pub const READ_WRITE_WORDS: u8 = 0x17;
/// Maximum number of bits or words of one request by the specification, which couplers observe (a CP allows up to
/// [`DATA_BYTES`]).
pub const READ_BITS_MAX: u16 = 2000;
/// Maximum of bits that one request 0Fh writes (see [`READ_BITS_MAX`]).
pub const WRITE_BITS_MAX: u16 = 1968;
/// As [`READ_BITS_MAX`]: 03h, 04h, and what 17h reads.
pub const READ_WORDS_MAX: u16 = 125;

/// As [`READ_BITS_MAX`]: what 17h writes.
pub const READ_WRITE_WORDS_MAX: u16 = 121;

codes! {
    /// The function codes of the manual.
    Function {
        /// 01h: read n bits of the master output area 0x.
        ReadOutputBits = 0x01,
        /// 02h: read n bits of the master input area 1x.
        ReadInputBits = 0x02,
        /// 03h: read n words of the master output area 4x.
        ReadOutputWords = 0x03,
        /// 04h: read n words of the master input area 3x.
        ReadInputWords = 0x04,
        /// 05h: write 1 bit to the master output area 0x.
        WriteBit = 0x05,
        /// 06h: write 1 word to the master output area 4x.
        WriteWord = 0x06,
        /// 0Fh: write n bits to the master output area 0x.
        WriteBits = 0x0F,
        /// 10h: write n words to the master output area 4x.
        WriteWords = 0x10,
    }
}

impl Function {
    /// "Only write commands may be sent as broadcast." [S0 L2051]
    pub const fn writes(self) -> bool {
        matches!(self, Self::WriteBit | Self::WriteWord | Self::WriteBits | Self::WriteWords)
    }
}

/// Why a slave refuses; the codes of the Modbus specification (the manual calls the rest of such a telegram "not
/// relevant").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Exception {
    /// The function code is not one of the eight.
    Function = 1,
    /// Not all of the data is inside the area.
    Address = 2,
    /// A number of elements that is not permitted, or that does not match the bytes.
    Value = 3,
}

/// A request whose function code and length are valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// 01h, 02h: reads bits of an area.
    ReadBits {
        /// Of the input area (02h) or the output area (01h).
        input: bool,
        /// Number of the first bit, from 0.
        first: u16,
        /// Number of bits, 1 to 2000.
        count: u16,
    },
    /// 03h, 04h: reads words of an area.
    ReadWords {
        /// Of the input area (04h) or the output area (03h).
        input: bool,
        /// Number of the first word, from 0.
        first: u16,
        /// Number of words, 1 to 125.
        count: u16,
    },
    /// 05h: writes a bit of the output area.
    WriteBit {
        /// Number of the bit, from 0.
        at: u16,
        /// 0000h: false, FF00h: true.
        on: bool,
    },
    /// 0Fh: writes bits of the output area.
    WriteBits {
        /// Number of the first bit, from 0.
        first: u16,
        /// Number of bits, 1 to 2000.
        count: u16,
        /// Their bytes, lowest bit first.
        data: &'a [u8],
    },
    /// 06h and 10h: write words of the output area.
    WriteWords {
        /// Number of the first word, from 0.
        first: u16,
        /// Their bytes, high byte first.
        data: &'a [u8],
    },
}

fn word(telegram: &[u8], at: usize) -> Option<u16> {
    let bytes = telegram.get(at..at + 2)?;
    Some(u16::from_be_bytes([bytes[0], bytes[1]]))
}

impl<'a> Request<'a> {
    /// Parses a request telegram (address first, no check) in the order prescribed for a slave: function, then numbers.
    /// The area itself checks whether it is large enough.
    ///
    /// # Errors
    /// The exception to answer with.
    pub fn parse(telegram: &'a [u8]) -> Result<Self, Exception> {
        let function = telegram.get(1).copied().and_then(Function::of).ok_or(Exception::Function)?;
        let (Some(first), Some(value)) = (word(telegram, 2), word(telegram, 4)) else { return Err(Exception::Value) };
        let count = usize::from(value);
        let bare = telegram.len() == 6;
        // Number of bytes, then exactly that many bytes.
        let data = || match telegram.get(6..).and_then(<[u8]>::split_first) {
            Some((bytes, data)) if usize::from(*bytes) == data.len() => Ok(data),
            _ => Err(Exception::Value),
        };
        let request = match function {
            Function::ReadOutputBits | Function::ReadInputBits => {
                check(bare && (1..=8 * DATA_BYTES).contains(&count))?;
                Self::ReadBits { input: function == Function::ReadInputBits, first, count: value }
            }
            Function::ReadOutputWords | Function::ReadInputWords => {
                check(bare && (1..=DATA_BYTES / REGISTER_BYTES).contains(&count))?;
                Self::ReadWords { input: function == Function::ReadInputWords, first, count: value }
            }
            Function::WriteBit => {
                // "Status Bit" = 0000h: Bit = 0; FF00h: Bit = 1. [S0 L2415-L2417]
                check(bare && (value == 0x0000 || value == 0xFF00))?;
                Self::WriteBit { at: first, on: value != 0 }
            }
            Function::WriteWord => {
                check(bare)?;
                Self::WriteWords { first, data: telegram.get(4..6).unwrap_or(&[]) }
            }
            Function::WriteBits => {
                let data = data()?;
                check((1..=8 * DATA_BYTES).contains(&count) && data.len() == count.div_ceil(8))?;
                Self::WriteBits { first, count: value, data }
            }
            Function::WriteWords => {
                let data = data()?;
                check((1..=DATA_BYTES / REGISTER_BYTES).contains(&count) && data.len() == REGISTER_BYTES * count)?;
                Self::WriteWords { first, data }
            }
        };
        Ok(request)
    }
}

impl Request<'_> {
    /// The bytes of the output area that it writes.
    pub fn written(&self) -> Range<usize> {
        match *self {
            Self::ReadBits { .. } | Self::ReadWords { .. } => 0..0,
            Self::WriteBit { at, .. } => usize::from(at) / 8..usize::from(at) / 8 + 1,
            Self::WriteBits { first, count, .. } => {
                usize::from(first) / 8..(usize::from(first) + usize::from(count)).div_ceil(8)
            }
            Self::WriteWords { first, data } => {
                let from = REGISTER_BYTES * usize::from(first);
                from..from + data.len()
            }
        }
    }
}

const fn check(good: bool) -> Result<(), Exception> {
    if good { Ok(()) } else { Err(Exception::Value) }
}

/// Direction of a telegram, which determines its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Master to slave: a request.
    Request,
    /// Slave to master: an answer, or an exception.
    Answer,
}

/// Length of a telegram according to its first bytes; `None` if more of them are needed, or if there is no such
/// function code.
pub fn length(direction: Direction, telegram: &[u8], register_bytes: usize) -> Option<usize> {
    let code = *telegram.get(1)?;
    if direction == Direction::Answer && code & ERROR_BIT != 0 {
        return Some(3);
    }
    let write_word = 4 + register_bytes;
    Some(match (direction, Function::of(code)?) {
        (_, Function::WriteWord) => write_word,
        (Direction::Request, Function::WriteBits | Function::WriteWords) => 7 + usize::from(*telegram.get(6)?),
        (Direction::Answer, function) if !function.writes() => 3 + usize::from(*telegram.get(2)?),
        _ => 6,
    })
}

/// How an answer matches its request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Match {
    /// It is the answer, good or with an error announced.
    Answer,
    /// It is the answer to another request: to another slave, function or elements.
    Foreign,
    /// Shorter than its own function code and number of bytes say.
    Short,
    /// Longer than its own function code and number of bytes say.
    Long,
}

/// Compares an answer (with a correct check) with its request. A function code other than the eight cannot be checked
/// further.
pub fn matches(request: &[u8], answer: &[u8], register_bytes: usize) -> Match {
    let (Some(asked), Some(code)) = (request.get(1), answer.get(1)) else { return Match::Short };
    if request.first() != answer.first() || code & !ERROR_BIT != *asked {
        return Match::Foreign;
    }
    if code & ERROR_BIT == 0 && Function::of(*code).is_none() {
        return Match::Answer;
    }
    match length(Direction::Answer, answer, register_bytes) {
        Some(length) if answer.len() > length => return Match::Long,
        Some(length) if answer.len() == length => {}
        _ => return Match::Short,
    }
    let expected = match Function::of(*code) {
        // An announced error, or a function that cannot be checked further.
        None => true,
        // Address and value or number are returned. [S0 "Modbus - Function codes"]
        Some(Function::WriteWord) => request.get(2..4 + register_bytes) == answer.get(2..4 + register_bytes),
        Some(function) if function.writes() => request.get(2..6) == answer.get(2..6),
        Some(function) => {
            let count = word(request, 4).map_or(0, usize::from);
            let bits = matches!(function, Function::ReadOutputBits | Function::ReadInputBits);
            let bytes = if bits { count.div_ceil(8) } else { register_bytes * count };
            answer.len() == 3 + bytes
        }
    };
    if expected { Match::Answer } else { Match::Foreign }
}
