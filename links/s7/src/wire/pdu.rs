//! The header of every S7 telegram.

use crate::codes::Code;

/// The first byte of each telegram.
const PROTOCOL: u8 = 0x32;
/// Length of the header of a job, and of the services of a programming device.
pub const JOB_HEAD: usize = 10;
/// Length of the header of an answer.
pub const ANSWER_HEAD: usize = 12;
/// Longest telegram before anything is agreed.
pub const MAX_TELEGRAM: usize = 240;

/// Functions of jobs: the first byte of their parameters.
#[expect(missing_docs, reason = "the names say it")]
pub mod function {
    pub const READ: u8 = 0x04;
    pub const WRITE: u8 = 0x05;
    pub const REQUEST_DOWNLOAD: u8 = 0x1A;
    pub const DOWNLOAD: u8 = 0x1B;
    pub const DOWNLOAD_ENDED: u8 = 0x1C;
    pub const START_UPLOAD: u8 = 0x1D;
    pub const UPLOAD: u8 = 0x1E;
    pub const END_UPLOAD: u8 = 0x1F;
    pub const CONTROL: u8 = 0x28;
    pub const STOP: u8 = 0x29;
    pub const SETUP: u8 = 0xF0;
}

/// The kinds of telegram ("ROSCTR").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A job (01h): its partner must answer.
    Job,
    /// An answer without parameters: the job was refused as a whole.
    Ack,
    /// An answer to a job, with parameters (03h).
    Answer,
    /// A service of a programming device, its answer, or a message.
    UserData,
}

impl Kind {
    const fn byte(self) -> u8 {
        match self {
            Self::Job => 1,
            Self::Ack => 2,
            Self::Answer => 3,
            Self::UserData => 7,
        }
    }

    const fn head(self) -> usize {
        match self {
            Self::Job | Self::UserData => JOB_HEAD,
            Self::Ack | Self::Answer => ANSWER_HEAD,
        }
    }
}

/// A telegram, taken apart but not understood yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pdu<'b> {
    /// Job, answer, or service.
    pub kind: Kind,
    /// The number that an answer copies from its job.
    pub reference: u16,
    /// In an answer: the outcome of the job.
    pub error: Code,
    /// The parameters: function, and what belongs to it.
    pub parameters: &'b [u8],
    /// The data behind the parameters; empty for some telegrams.
    pub data: &'b [u8],
}

impl Pdu<'_> {
    /// `None` if this is not an S7 telegram, or is cut off.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<Pdu<'_>> {
        let head = bytes.first_chunk::<JOB_HEAD>()?;
        let kind = match (head[0], head[1]) {
            (PROTOCOL, 1) => Kind::Job,
            (PROTOCOL, 2) => Kind::Ack,
            (PROTOCOL, 3) => Kind::Answer,
            (PROTOCOL, 7) => Kind::UserData,
            _ => return None,
        };
        let word = |at: usize| u16::from_be_bytes([head[at], head[at + 1]]);
        let error = match bytes.get(JOB_HEAD..kind.head())? {
            [class, code] => u16::from_be_bytes([*class, *code]),
            _ => 0,
        };
        let (parameters, rest) = bytes.get(kind.head()..)?.split_at_checked(usize::from(word(6)))?;
        let data = rest.get(..usize::from(word(8)))?;
        Some(Pdu { kind, reference: word(4), error: Code(error), parameters, data })
    }
}

/// The bytes of a telegram.
#[must_use]
pub fn write(kind: Kind, reference: u16, error: Code, parameters: &[u8], data: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(ANSWER_HEAD + parameters.len() + data.len());
    out.extend_from_slice(&[PROTOCOL, kind.byte(), 0, 0]);
    for word in [reference, parameters.len() as u16, data.len() as u16] {
        out.extend_from_slice(&word.to_be_bytes());
    }
    if kind.head() == ANSWER_HEAD {
        out.extend_from_slice(&error.0.to_be_bytes());
    }
    out.extend_from_slice(parameters);
    out.extend_from_slice(data);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways() {
        for (kind, error) in [(Kind::Job, 0), (Kind::Ack, 0x8500), (Kind::Answer, 0xD241), (Kind::UserData, 0)] {
            let pdu = Pdu { kind, reference: 0x1234, error: Code(error), parameters: &[1, 2], data: &[3] };
            let bytes = write(kind, pdu.reference, pdu.error, pdu.parameters, pdu.data);
            assert_eq!(Pdu::read(&bytes), Some(pdu));
            assert_eq!((1..bytes.len()).find(|len| Pdu::read(&bytes[..*len]).is_some()), None);
        }
        assert_eq!(Pdu::read(&[0x72, 1, 0, 0, 0, 0, 0, 0, 0, 0]), None);
        assert_eq!(Pdu::read(&[0x32, 8, 0, 0, 0, 0, 0, 0, 0, 0]), None);
    }
}
