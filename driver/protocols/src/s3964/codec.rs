//! The block of 3964(R) on the wire: DLE doubling and block check character. Total functions, without time.

/// Start of text: asks for a connection.
pub const STX: u8 = 0x02;
/// End of text: with DLE before it, the end of a block.
pub const ETX: u8 = 0x03;
/// Data link escape: accepts a connection or a block; doubled where it is user data.
pub const DLE: u8 = 0x10;
/// Negative acknowledgement: refuses a connection or a block.
pub const NAK: u8 = 0x15;

/// Characters of the block with `payload`, from the first data character to the last check character: `data (DLE
/// doubled) DLE ETX [BCC]`. STX is not part of it.
pub fn block(payload: &[u8], bcc: bool) -> impl Iterator<Item = u8> + '_ {
    let data = payload.iter().flat_map(|&byte| core::iter::repeat_n(byte, if byte == DLE { 2 } else { 1 }));
    let check = bcc.then(|| check_of(payload));
    data.chain([DLE, ETX]).chain(check)
}

/// The block check character: XOR of everything after STX, including both DLEs of a doubled one (they cancel) and the
/// closing DLE ETX. It is never doubled itself. [S0 "Block check character (BCC-Byte)"]
pub fn check_of(payload: &[u8]) -> u8 {
    payload.iter().filter(|byte| **byte != DLE).fold(DLE ^ ETX, |check, byte| check ^ byte)
}

/// The effect of the next character on a block being received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// First half of something; more must come.
    More,
    /// A character of user data.
    Data(u8),
    /// DLE followed by a character that is neither DLE nor ETX.
    BadDle(u8),
    /// The block is complete, with its check characters in 3964R.
    End {
        /// Computed and received check character.
        check: Option<(u8, u8)>,
    },
}

/// Undoes the doubling and computes the check character by character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decoder {
    bcc: bool,
    check: u8,
    awaits: Awaits,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Awaits {
    Any,
    AfterDle,
    Check,
}

impl Decoder {
    /// A decoder at the first character after STX.
    pub fn new(bcc: bool) -> Self {
        Self { bcc, check: 0, awaits: Awaits::Any }
    }

    /// Takes the next character.
    pub fn push(&mut self, byte: u8) -> Step {
        let computed = self.check;
        self.check ^= byte;
        match self.awaits {
            Awaits::Any if byte == DLE => {
                self.awaits = Awaits::AfterDle;
                Step::More
            }
            Awaits::Any => Step::Data(byte),
            Awaits::AfterDle => {
                self.awaits = Awaits::Any;
                match byte {
                    DLE => Step::Data(DLE),
                    ETX if self.bcc => {
                        self.awaits = Awaits::Check;
                        Step::More
                    }
                    ETX => Step::End { check: None },
                    other => Step::BadDle(other),
                }
            }
            Awaits::Check => {
                *self = Self::new(self.bcc);
                Step::End { check: Some((computed, byte)) }
            }
        }
    }

    /// Takes the user data at the beginning of `characters` into `places`, up to a DLE or what the places hold; returns
    /// how many characters that are. All but a few characters of a block are such.
    pub fn plain(&mut self, characters: &[u8], places: &mut [u8]) -> usize {
        if self.awaits != Awaits::Any {
            return 0;
        }
        let data = characters.iter().take_while(|byte| **byte != DLE);
        let check = &mut self.check;
        let take = |(place, byte): (&mut u8, &u8)| {
            *place = *byte;
            *check ^= *byte;
        };
        places.iter_mut().zip(data).map(take).count()
    }

    /// A character could not be read. True if it was in the place of the check character, so that the block has ended.
    pub fn unreadable(&mut self) -> bool {
        let end = self.awaits == Awaits::Check;
        self.awaits = Awaits::Any;
        end
    }
}
