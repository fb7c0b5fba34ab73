//! The telegrams of RK 512: headers of orders, follow-on headers, reactions. Total functions over slices, without time.
//!
//! Bytes are counted from 1, as the Siemens texts do. [S0 "Structure of the output message"] counts them from 0.

use ob1_words::codes;

/// Bytes of an order's header.
pub const HEADER: usize = 10;
/// Bytes of the header of a follow-on telegram, and of a reaction.
pub const SHORT: usize = 4;
/// Bytes of user data in one telegram. The tables print positions up to 127, the text says "when the data exceeds
/// 128Byte". [S0 "Structure of additional messages"], [CP 341 manual 09/2008, p. 57]
pub const PIECE: usize = 128;

/// Whether a telegram of a SEND has the right number of data bytes, `len`, when `rest` bytes are still to come.
/// `first`: data of the order's first telegram, `None` if this is the first.
///
/// Up to 128 bytes are one telegram [S0 L1713], more are split by 128. A shorter telegram has lost its end, and the
/// partner would take the acknowledgement of its last telegram for "all is stored". The only other split that is
/// accepted follows from a literal reading of the tables, where a telegram has 128 bytes including its header.
/// (decision 20)
pub const fn is_whole(len: usize, rest: usize, first: Option<usize>) -> bool {
    if len == (if rest < PIECE { rest } else { PIECE }) {
        return len > 0;
    }
    match first {
        None => rest > PIECE && len == PIECE - HEADER,
        Some(first) => first == PIECE - HEADER && len == PIECE - SHORT && rest > len,
    }
}

/// First byte of an order or reaction.
const FIRST: u8 = 0x00;
/// First byte of a follow-on telegram and of the reaction to one.
const FOLLOW: u8 = 0xFF;
/// Ninth byte, and low nibble of the tenth, without coordination flag.
const NONE: u8 = 0xFF;

/// The command of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Command {
    /// "Output": data go to the partner. [S0 "Structure of the output message"]
    Send,
    /// "Input": data come from the partner. [S0 "Structure of the input message"]
    Fetch,
}

codes! {
    /// The area of the data in the serving station, by its letter in the fourth byte: D X E A M Z T.
    /// [CP 341 manual 09/2008, p. 51]
    Area {
        /// Data block DB; counts in words.
        Db = b'D',
        /// Extended data block DX; counts in words.
        Dx = b'X',
        /// Inputs E; count in bytes.
        Inputs = b'E',
        /// Outputs A; count in bytes.
        Outputs = b'A',
        /// Bit memory M; counts in bytes.
        Memory = b'M',
        /// Counters Z; two bytes each.
        Counters = b'Z',
        /// Timers T; two bytes each.
        Timers = b'T',
    }
}

impl Area {
    /// Its letter.
    pub const fn letter(self) -> u8 {
        self as u8
    }

    /// Bytes of one unit of the length: words for D, X, Z, T, bytes for M, E, A. [CP 341 manual 09/2008, p. 51]
    pub const fn unit(self) -> usize {
        match self {
            Self::Inputs | Self::Outputs | Self::Memory => 1,
            _ => 2,
        }
    }
}

/// A coordination flag: a bit of the serving station's bit memory. [S0 "Coordination flags"]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Flag {
    /// Byte of the bit memory, 0 to 254; a station may allow fewer.
    pub byte: u8,
    /// Bit of it, 0 to 7.
    pub bit: u8,
}

/// Bytes 9 and 10 of a header as sent: flag byte, CPU number and flag bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Coordination(pub [u8; 2]);

impl Coordination {
    /// Neither flag nor CPU number: FF FF.
    pub const NONE: Self = Self([NONE, NONE]);

    /// Flag and CPU number (1 to 4) as [CP 341 manual 09/2008, p. 51] encodes them: without a number the high nibble is
    /// 0 with a flag and F without one.
    pub const fn new(flag: Option<Flag>, cpu: Option<u8>) -> Self {
        match (flag, cpu) {
            (None, None) => Self::NONE,
            (Some(flag), None) => Self([flag.byte, flag.bit & 0x0F]),
            (Some(flag), Some(cpu)) => Self([flag.byte, cpu << 4 | flag.bit & 0x0F]),
            (None, Some(cpu)) => Self([NONE, cpu << 4 | 0x0F]),
        }
    }

    /// The flag, if there is one.
    ///
    /// # Errors
    /// A bit number above 7, a bit without a byte or a byte without a bit; a byte above `byte_max`.
    pub const fn flag(self, byte_max: u8) -> Result<Option<Flag>, BadFlag> {
        let [byte, nibbles] = self.0;
        match nibbles & 0x0F {
            0x0F if byte == NONE => Ok(None),
            bit if bit <= 7 && byte != NONE && byte <= byte_max => Ok(Some(Flag { byte, bit })),
            _ => Err(BadFlag),
        }
    }

    /// The CPU number, if there is one, whatever its value.
    pub const fn cpu(self) -> Option<u8> {
        match self.0[1] >> 4 {
            0 | 0x0F => None,
            number => Some(number),
        }
    }
}

/// An impossible coordination flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadFlag;

/// An order as in its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Request {
    /// SEND (data to the partner) or FETCH (data from it).
    pub command: Command,
    /// The area: with SEND [`Area::Db`] or [`Area::Dx`].
    pub area: Area,
    /// Number of the DB or DX; 0 for the other areas.
    pub db: u8,
    /// First word of a DB or DX, first byte of M, E, A, number of the first counter or timer.
    pub start: u8,
    /// Length of the whole order, follow-on telegrams included, in units of the area.
    pub length: u16,
    /// Coordination flag and CPU number.
    pub coordination: Coordination,
}

impl Request {
    /// Length of the whole order in bytes.
    pub const fn bytes(&self) -> usize {
        self.length as usize * self.area.unit()
    }

    /// Third and fourth byte. SEND to a DX is `O D`, SEND to a DB `A D`: the header's description is the only text that
    /// makes a DX distinguishable. [CP 341 manual 09/2008, p. 51]
    pub const fn letters(&self) -> [u8; 2] {
        match (self.command, self.area) {
            (Command::Send, Area::Dx) => *b"OD",
            (Command::Send, area) => [b'A', area.letter()],
            (Command::Fetch, area) => [b'E', area.letter()],
        }
    }

    /// The header of the first telegram.
    pub const fn header(&self) -> [u8; HEADER] {
        let [command, area] = self.letters();
        let [high, low] = self.length.to_be_bytes();
        let [flag, bit] = self.coordination.0;
        [FIRST, 0, command, area, self.db, self.start, high, low, flag, bit]
    }

    /// The header of a follow-on telegram. [S0 "Structure of additional messages"]
    pub const fn follow_header(&self) -> [u8; SHORT] {
        let [command, area] = self.letters();
        [FOLLOW, 0, command, area]
    }

    /// Reads a header; bytes after it are ignored.
    ///
    /// # Errors
    /// [`Malformed`]: its first fault.
    pub fn of_header(header: &[u8; HEADER]) -> Result<Self, Malformed> {
        let [first, second, command, area, db, start, high, low, flag, bit] = *header;
        if first != FIRST || second != 0 {
            return Err(Malformed::FirstBytes);
        }
        let (command, area) = letters(command, area)?;
        let length = u16::from_be_bytes([high, low]);
        Ok(Self { command, area, db, start, length, coordination: Coordination([flag, bit]) })
    }
}

/// The meaning of the third and fourth byte. `A X` counts as a DX, because some partners send it. (ours)
fn letters(command: u8, area: u8) -> Result<(Command, Area), Malformed> {
    match (command, area) {
        (b'A', b'D') => Ok((Command::Send, Area::Db)),
        (b'A', b'X') | (b'O', b'D') => Ok((Command::Send, Area::Dx)),
        (b'E', letter) => Area::of(letter).map(|area| (Command::Fetch, area)).ok_or(Malformed::AreaLetter),
        (b'A' | b'O', _) => Err(Malformed::AreaLetter),
        _ => Err(Malformed::CommandLetter),
    }
}

/// Why a telegram is not valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Malformed {
    /// Fewer than 4 bytes, or fewer than 10 for the first telegram of an order.
    Short,
    /// The first byte is neither 00h nor FFh, or the second not 00h.
    FirstBytes,
    /// The same, in a reaction.
    ReactionBytes,
    /// The third byte is neither A, O nor E (nor the 00h of a reaction).
    CommandLetter,
    /// The fourth byte is not an area, or not one that the command may name.
    AreaLetter,
}

/// A telegram whose header is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Telegram<'a> {
    /// The first telegram of an order, with its part of the data.
    Order(Request, &'a [u8]),
    /// A follow-on telegram of an order.
    Follow {
        /// SEND or FETCH, as in its first telegram.
        command: Command,
        /// Area, as in its first telegram.
        area: Area,
        /// Its part of the data.
        data: &'a [u8],
    },
    /// A reaction: the answer to a telegram of an order.
    Reaction {
        /// To a follow-on telegram.
        follow: bool,
        /// 00h: all is well; otherwise the error number. (docs/cp341-events.md)
        code: u8,
        /// Data of a FETCH.
        data: &'a [u8],
    },
}

/// Parses a telegram. The third byte distinguishes reactions (00h) from orders. [CP 341 manual 09/2008, p. 52 to 57]
///
/// # Errors
/// What is [`Malformed`]: too short for a header, or a byte that no header has.
pub fn parse(telegram: &[u8]) -> Result<Telegram<'_>, Malformed> {
    let Some((&[first, second, third, fourth], rest)) = telegram.split_first_chunk::<SHORT>() else {
        return Err(Malformed::Short);
    };
    let good = matches!(first, FIRST | FOLLOW) && second == 0;
    if third == 0 {
        return if good {
            Ok(Telegram::Reaction { follow: first == FOLLOW, code: fourth, data: rest })
        } else {
            Err(Malformed::ReactionBytes)
        };
    }
    if !good {
        return Err(Malformed::FirstBytes);
    }
    if first == FOLLOW {
        let (command, area) = letters(third, fourth)?;
        return Ok(Telegram::Follow { command, area, data: rest });
    }
    // Wrong letters are reported before missing bytes after them.
    letters(third, fourth)?;
    let Some((header, data)) = telegram.split_first_chunk::<HEADER>() else { return Err(Malformed::Short) };
    Request::of_header(header).map(|request| Telegram::Order(request, data))
}

/// A reaction without data. [S0 "Structure of the output message"]
pub const fn reaction(follow: bool, code: u8) -> [u8; SHORT] {
    [if follow { FOLLOW } else { FIRST }, 0, 0, code]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_go_there_and_back() {
        for command in [Command::Send, Command::Fetch] {
            for area in Area::ALL {
                let coordination = Coordination::new(Some(Flag { byte: 6, bit: 4 }), Some(2));
                let request = Request { command, area, db: 5, start: 1, length: 0x1234, coordination };
                let header = request.header();
                let sendable = command == Command::Fetch || matches!(area, Area::Db | Area::Dx);
                assert_eq!(
                    Request::of_header(&header),
                    if sendable { Ok(request) } else { Err(Malformed::AreaLetter) }
                );
                assert_eq!(request.follow_header()[2..], header[2..4]);
            }
        }
        assert_eq!(&Request::of_header(b"\0\0AX\x05\x01\0\x08\xFF\xFF").unwrap().header()[2..4], b"OD");
    }

    #[test]
    fn the_tenth_byte_is_encoded_as_the_table_says() {
        let flag = Flag { byte: 6, bit: 4 };
        for (given, bytes, back) in [
            ((None, None), [0xFF, 0xFF], None),
            ((Some(flag), None), [6, 0x04], None),
            ((Some(flag), Some(3)), [6, 0x34], Some(3)),
            ((None, Some(3)), [0xFF, 0x3F], Some(3)),
        ] {
            let coordination = Coordination::new(given.0, given.1);
            assert_eq!((coordination.0, coordination.flag(254), coordination.cpu()), (bytes, Ok(given.0), back));
        }
        for bad in [[6, 8], [6, 0xFF], [0xFF, 4], [200, 0]] {
            assert_eq!(Coordination(bad).flag(199), Err(BadFlag), "{bad:02X?}");
        }
    }

    #[test]
    fn what_has_lost_its_end_is_not_whole() {
        for (len, rest, first, whole) in [
            (4, 4, None, true),
            (2, 8, None, false),
            (0, 8, None, false),
            (0, 0, None, false),
            (10, 8, None, false),
            (128, 128, None, true),
            (127, 128, None, false),
            (118, 128, None, false),
            (129, 130, None, false),
            (128, 130, None, true),
            (2, 130, None, false),
            (1, 2, Some(128), false),
            (128, 300, Some(128), true),
            (124, 300, Some(128), false),
            // The tables read literally.
            (118, 130, None, true),
            (124, 200, Some(118), true),
            (118, 120, Some(118), false),
            (120, 120, Some(118), true),
        ] {
            assert_eq!(is_whole(len, rest, first), whole, "{len} of {rest} after {first:?}");
        }
    }

    #[test]
    fn every_telegram_is_one_thing() {
        for (bytes, sorted) in [
            (&b"\0\0A"[..], Err(Malformed::Short)),
            (b"\0\0AD\x05\x01\0\x01\xFF", Err(Malformed::Short)),
            (b"\x01\0AD", Err(Malformed::FirstBytes)),
            (b"\0\x01AD", Err(Malformed::FirstBytes)),
            (b"\x01\0\0\0", Err(Malformed::ReactionBytes)),
            (b"\0\0BD", Err(Malformed::CommandLetter)),
            (b"\0\0AM", Err(Malformed::AreaLetter)),
            (b"\0\0OE", Err(Malformed::AreaLetter)),
            (b"\0\0EQ", Err(Malformed::AreaLetter)),
            (b"\xFF\0AD\x07", Ok(Telegram::Follow { command: Command::Send, area: Area::Db, data: &[7] })),
            (b"\xFF\0EM", Ok(Telegram::Follow { command: Command::Fetch, area: Area::Memory, data: &[] })),
            (b"\0\0\0\x32", Ok(Telegram::Reaction { follow: false, code: 0x32, data: &[] })),
            (b"\xFF\0\0\0\x01\x02", Ok(Telegram::Reaction { follow: true, code: 0, data: &[1, 2] })),
        ] {
            assert_eq!(parse(bytes), sorted, "{bytes:02X?}");
        }
    }
}
