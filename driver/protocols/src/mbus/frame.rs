//! The four frames of the M-Bus, as bytes. Total functions, without time.
//!
//! [S0 "Overview of M-Bus telegrams"]; EN 1434-3 calls them FT1.2 frames.
//!
//! ```text
//! single character  E5
//! short             10 C A CS 16
//! control           68 03 03 68 C A CI CS 16
//! long              68 L  L  68 C A CI user data CS 16      L = 3 + bytes of user data
//! ```

/// The acknowledgement: a frame of one character.
pub const SINGLE: u8 = 0xE5;
/// First character of a short frame.
pub const START_SHORT: u8 = 0x10;
/// First and fourth character of a control or long frame.
pub const START_LONG: u8 = 0x68;
/// Last character of every frame except the single character.
pub const STOP: u8 = 0x16;

/// Longest user data of a long frame, bytes. [S0 "Overview of M-Bus telegrams"]
pub const USER_MAX: usize = 252;
/// Longest frame, bytes: L field 255, six characters around it.
pub const FRAME_MAX: usize = 261;
/// Bytes of C, A and CI field.
const FIELDS: usize = 3;

/// The bit of the C field that distinguishes a master from a slave. [S0 "C field"]
pub const FROM_MASTER: u8 = 0x40;

/// A frame. C, A and CI field are passed on unchanged: the program decides the function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame<'a> {
    /// The single character E5h.
    Single,
    /// Four-byte frame without CI field and data.
    Short {
        /// C field: function and direction.
        c: u8,
        /// A field: address of the slave.
        a: u8,
    },
    /// Control frame (no user data) or long frame.
    Long {
        /// C field: function and direction.
        c: u8,
        /// A field: address of the slave.
        a: u8,
        /// CI field: the kind of user data.
        ci: u8,
        /// User data, at most [`USER_MAX`] bytes.
        data: &'a [u8],
    },
}

/// Why characters are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FrameError {
    /// The first character does not begin a frame.
    Start(u8),
    /// The two L fields differ, or are below 3.
    Length(u8, u8),
    /// The fourth character is not 68h.
    SecondStart(u8),
    /// The check sum differs.
    Check {
        /// Computed from what came in.
        computed: u8,
        /// The check sum that came in.
        received: u8,
    },
    /// The last character is not 16h.
    Stop(u8),
}

/// Result of reading the characters so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress<'a> {
    /// The beginning of a frame.
    More,
    /// A frame, and the number of its characters.
    Whole(Frame<'a>, usize),
    /// Not a frame, whatever follows.
    Wrong(FrameError),
}

impl<'a> Frame<'a> {
    /// Writes the frame; returns its length. User data beyond [`USER_MAX`] are cut.
    pub fn encode(&self, out: &mut [u8; FRAME_MAX]) -> usize {
        match *self {
            Self::Single => {
                out[0] = SINGLE;
                1
            }
            Self::Short { c, a } => {
                out[..5].copy_from_slice(&[START_SHORT, c, a, c.wrapping_add(a), STOP]);
                5
            }
            Self::Long { c, a, ci, data } => {
                let data = &data[..data.len().min(USER_MAX)];
                let l = (FIELDS + data.len()) as u8;
                out[..7].copy_from_slice(&[START_LONG, l, l, START_LONG, c, a, ci]);
                let end = 7 + data.len();
                out[7..end].copy_from_slice(data);
                out[end] = check_sum(&out[4..end]);
                out[end + 1] = STOP;
                end + 2
            }
        }
    }

    /// Reads the characters received so far, at most [`FRAME_MAX`].
    pub fn decode(bytes: &'a [u8]) -> Progress<'a> {
        match bytes {
            [] => Progress::More,
            [SINGLE, ..] => Progress::Whole(Self::Single, 1),
            [START_SHORT, rest @ ..] => decode_short(rest),
            [START_LONG, rest @ ..] => decode_long(rest),
            [other, ..] => Progress::Wrong(FrameError::Start(*other)),
        }
    }

    /// Whether a master has sent it: our own output, handed back by a level converter that echoes.
    pub fn is_from_master(&self) -> bool {
        match *self {
            Self::Single => false,
            Self::Short { c, .. } | Self::Long { c, .. } => c & FROM_MASTER != 0,
        }
    }
}

/// The sum of C, A, CI field and user data, modulo 256. [S0 "Check sum"]
pub fn check_sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Reads the characters after 10h.
fn decode_short(rest: &[u8]) -> Progress<'_> {
    let [c, a, received, stop, ..] = *rest else { return Progress::More };
    match ends(&[c, a], received, stop) {
        Ok(()) => Progress::Whole(Frame::Short { c, a }, 5),
        Err(error) => Progress::Wrong(error),
    }
}

/// Reads the characters after 68h. A fault is reported as soon as it is visible, without waiting for the rest.
fn decode_long(rest: &[u8]) -> Progress<'_> {
    let [first, second, ..] = *rest else { return Progress::More };
    let length = usize::from(first);
    if first != second || length < FIELDS {
        return Progress::Wrong(FrameError::Length(first, second));
    }
    let Some(&start) = rest.get(2) else { return Progress::More };
    if start != START_LONG {
        return Progress::Wrong(FrameError::SecondStart(start));
    }
    let body = &rest[3..];
    let (Some(&received), Some(&stop)) = (body.get(length), body.get(length + 1)) else { return Progress::More };
    let body = &body[..length];
    match ends(body, received, stop) {
        Ok(()) => {
            Progress::Whole(Frame::Long { c: body[0], a: body[1], ci: body[2], data: &body[FIELDS..] }, length + 6)
        }
        Err(error) => Progress::Wrong(error),
    }
}

fn ends(body: &[u8], received: u8, stop: u8) -> Result<(), FrameError> {
    let computed = check_sum(body);
    if computed != received {
        return Err(FrameError::Check { computed, received });
    }
    if stop == STOP { Ok(()) } else { Err(FrameError::Stop(stop)) }
}
