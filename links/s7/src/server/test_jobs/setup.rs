//! What sets a test job up: lengths, parameters, data.

use ob1_model::Point;

use super::force::is_force;
use crate::codes::Code;
use crate::wire::sub;

/// Bytes in front of parameters and data: their lengths.
pub(super) const LENGTHS: usize = 4;
/// Bytes of the parameters that all jobs have.
const WORDS: usize = 20;

/// How a job that forces begins, and that it stays.
const FORCE_AT_ONCE: u16 = 0x0100;
const ALWAYS: u16 = 0x0002;

/// When a job that is set up begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Begin {
    AtOnce,
    WhenEnabled,
    /// Values are modified at each trigger until the job is deleted.
    Permanent,
}

/// What a job waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trigger {
    Point(Point),
    /// A pass through a block; with a call environment.
    Code {
        called: bool,
    },
    /// The CPU holds before a statement.
    Statement,
}

/// The request that sets a job up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup<'s> {
    pub(super) begin: Begin,
    /// It is gone after one result.
    pub(super) once: bool,
    /// Bytes of a result.
    pub(super) result: usize,
    pub(super) trigger: Trigger,
    /// The parameters behind the common ones.
    pub(super) more: &'s [u8],
    pub(super) data: &'s [u8],
}

/// Parameters and data, by the lengths in front of them.
pub(super) fn parts(bytes: &[u8]) -> Result<(&[u8], &[u8]), Code> {
    let (&[a, b, c, d], rest) = bytes.split_first_chunk::<LENGTHS>().ok_or(Code::TEST_PROTOCOL)?;
    let (parameters, data) = (usize::from(u16::from_be_bytes([a, b])), usize::from(u16::from_be_bytes([c, d])));
    if parameters + data != rest.len() {
        return Err(Code::TEST_LENGTH);
    }
    rest.split_at_checked(parameters).ok_or(Code::TEST_LENGTH)
}

impl<'s> Setup<'s> {
    pub(super) fn read(function: u8, bytes: &'s [u8]) -> Result<Self, Code> {
        let (parameters, data) = parts(bytes)?;
        let (words, more) = parameters.split_at_checked(WORDS).ok_or(Code::TEST_SYNTAX)?;
        let mut words = words.as_chunks::<2>().0.iter().map(|word| u16::from_be_bytes(*word));
        let mut next = || words.next().unwrap_or(0);
        let is = |is_so: bool, code| if is_so { Ok(()) } else { Err(code) };
        is(next() == 0, Code::TEST_VARIANT)?;
        let force = is_force(function);
        let begin = match next() {
            0 => Begin::AtOnce,
            FORCE_AT_ONCE if force => Begin::AtOnce,
            1 if !force => Begin::WhenEnabled,
            2 if function == sub::TEST_MODIFY => Begin::Permanent,
            _ => return Err(Code::TEST_STATE),
        };
        let once = match next() {
            0 => false,
            ALWAYS if force => false,
            1 if begin != Begin::Permanent => true,
            _ => return Err(Code::TEST_END),
        };
        let result = usize::from(next());
        // One result at a time, at each trigger, for this connection.
        for code in
            [Code::TEST_BUFFERS, Code::TEST_DISCONNECT, Code::TEST_RATE, Code::TEST_TIMES, Code::TEST_TRIGGER_NUMBER]
        {
            is(next() == 1, code)?;
        }
        let variables = matches!(function, sub::TEST_STATUS | sub::TEST_MODIFY);
        let block = matches!(function, sub::TEST_BLOCK | sub::TEST_OLD_BLOCK);
        let trigger = match next() {
            0x0000 if variables => Trigger::Point(Point::Now),
            0x0200 if variables => Trigger::Point(Point::Start),
            0x0300 if variables => Trigger::Point(Point::End),
            0x0400 if variables => Trigger::Point(Point::Stop),
            0x0000 if force => Trigger::Point(Point::Now),
            0x0500 | 0x0C00 if function == sub::TEST_BREAKPOINT => Trigger::Statement,
            0x0600 if block => Trigger::Code { called: false },
            0x0601 if block => Trigger::Code { called: true },
            _ => return Err(Code::TEST_TRIGGER),
        };
        Ok(Self { begin, once, result, trigger, more, data })
    }

    /// The request that would force this: its lengths, parameters and data.
    pub(super) fn of_force(data: &[u8]) -> Vec<u8> {
        let count = data.first_chunk().copied().map_or(0, u16::from_be_bytes);
        let result = (2 + count).next_multiple_of(2);
        let words = [WORDS as u16, data.len() as u16, 0, FORCE_AT_ONCE, ALWAYS, result, 1, 1, 1, 1, 1, 0];
        words.iter().flat_map(|word| word.to_be_bytes()).chain(data.iter().copied()).collect()
    }
}

impl Trigger {
    /// The second word in front of a result.
    pub(super) const fn class(self) -> u8 {
        match self {
            Trigger::Point(Point::Start | Point::End | Point::Stop) => 2,
            Trigger::Point(Point::Now) | Trigger::Code { .. } | Trigger::Statement => 1,
        }
    }
}
