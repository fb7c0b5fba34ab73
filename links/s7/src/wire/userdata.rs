//! Services of a programming device: their parameters, and the four bytes in front of their data.

use std::fmt;

use super::data::OCTET;
use super::pdu::{JOB_HEAD, Kind, write};
use crate::codes::{Code, ItemCode};

/// Length of header, parameters and data header of a long answer.
pub const USERDATA_HEAD: usize = JOB_HEAD + 12 + 4;
/// First bytes of the parameters.
const HEAD: [u8; 3] = [0, 1, 0x12];
/// The parameters are short (first job) or long (answer, message, job for the next part).
const SHORT: u8 = 4;
const LONG: u8 = 8;
const METHOD_SHORT: u8 = 0x11;
const METHOD_LONG: u8 = 0x12;
/// Parameters of a change of the operating state, which is between the last two. [seen from a 315-2 and an IM151-8; the
/// first byte is how PLC4X knows it]
const MODE: [u8; 6] = [0x01, 0x00, 0x10, 0x10, 0x00, 0x00];

/// Services of each group.
#[expect(missing_docs, reason = "the names say it")]
pub mod sub {
    pub const TEST_OLD_BLOCK: u8 = 0x01;
    pub const TEST_STATUS: u8 = 0x02;
    pub const TEST_ISTACK: u8 = 0x03;
    pub const TEST_BSTACK: u8 = 0x04;
    pub const TEST_LSTACK: u8 = 0x05;
    pub const TEST_FORCE_300: u8 = 0x07;
    pub const TEST_MODIFY: u8 = 0x08;
    pub const TEST_FORCE: u8 = 0x09;
    pub const TEST_BREAKPOINT: u8 = 0x0A;
    pub const TEST_LEAVE_HOLD: u8 = 0x0B;
    pub const TEST_RESET: u8 = 0x0C;
    pub const TEST_DISABLE: u8 = 0x0D;
    pub const TEST_ENABLE: u8 = 0x0E;
    pub const TEST_DELETE: u8 = 0x0F;
    pub const TEST_LIST: u8 = 0x10;
    pub const TEST_READ: u8 = 0x11;
    pub const TEST_REPLACE: u8 = 0x12;
    pub const TEST_BLOCK: u8 = 0x13;
    pub const TEST_BLINK: u8 = 0x16;
    pub const CYCLIC: u8 = 0x01;
    pub const CYCLIC_DELETE: u8 = 0x04;
    pub const CYCLIC_CHANGE: u8 = 0x05;
    pub const CYCLIC_REPLACE: u8 = 0x07;
    pub const BLOCK_COUNTS: u8 = 0x01;
    pub const BLOCK_LIST: u8 = 0x02;
    pub const BLOCK_INFO: u8 = 0x03;
    pub const SZL: u8 = 0x01;
    pub const MESSAGES: u8 = 0x02;
    pub const DIAGNOSIS: u8 = 0x03;
    pub const ALARM_8: u8 = 0x05;
    pub const NOTIFY: u8 = 0x06;
    pub const ALARM_LOCK: u8 = 0x07;
    pub const ALARM_UNLOCK: u8 = 0x08;
    pub const ALARM_ACKNOWLEDGE: u8 = 0x0B;
    pub const ALARM_ACKNOWLEDGED: u8 = 0x0C;
    pub const ALARM_LOCKED: u8 = 0x0D;
    pub const ALARM_UNLOCKED: u8 = 0x0E;
    pub const ALARM_SQ: u8 = 0x11;
    pub const ALARM_S: u8 = 0x12;
    pub const ALARM_QUERY: u8 = 0x13;
    pub const NOTIFY_8: u8 = 0x16;
    pub const PASSWORD: u8 = 0x01;
    pub const NO_PASSWORD: u8 = 0x02;
    pub const CLOCK: u8 = 0x01;
    pub const SET_CLOCK: u8 = 0x02;
    pub const FOLLOWING_CLOCK: u8 = 0x03;
    pub const SET_FOLLOWING_CLOCK: u8 = 0x04;
}

/// Groups of services, by the low bits of a byte of the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Changes of the operating state; messages only.
    Mode,
    /// Test and commissioning: block status, variable tables, breakpoints.
    Test,
    /// Cyclic data, sent until the job is deleted.
    Cyclic,
    /// Lists of blocks, and information about one.
    Blocks,
    /// Status lists and messages.
    Cpu,
    /// Passwords: given, or not valid any more.
    Security,
    /// Data of BSEND (programmable block functions).
    Pbc,
    /// The clock: read and set.
    Clock,
    /// An unknown group, with its number.
    Other(u8),
}

impl Group {
    const fn of(nibble: u8) -> Self {
        match nibble {
            0 => Self::Mode,
            1 => Self::Test,
            2 => Self::Cyclic,
            3 => Self::Blocks,
            4 => Self::Cpu,
            5 => Self::Security,
            6 => Self::Pbc,
            7 => Self::Clock,
            other => Self::Other(other),
        }
    }

    const fn nibble(self) -> u8 {
        match self {
            Self::Mode => 0,
            Self::Test => 1,
            Self::Cyclic => 2,
            Self::Blocks => 3,
            Self::Cpu => 4,
            Self::Security => 5,
            Self::Pbc => 6,
            Self::Clock => 7,
            Self::Other(other) => other & 0x0F,
        }
    }
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mode => "operating state",
            Self::Test => "test",
            Self::Cyclic => "cyclic data",
            Self::Blocks => "blocks",
            Self::Cpu => "CPU",
            Self::Security => "password",
            Self::Pbc => "BSEND",
            Self::Clock => "clock",
            Self::Other(number) => return write!(f, "group {number}"),
        })
    }
}

/// The kinds of telegrams of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Telegram {
    /// An unsolicited telegram, which nobody answers.
    Message,
    /// A job: the partner must answer.
    Job,
    /// An answer to a job.
    Answer,
}

impl Telegram {
    const fn of(nibble: u8) -> Option<Self> {
        Some(match nibble {
            0 => Self::Message,
            4 => Self::Job,
            8 => Self::Answer,
            _ => return None,
        })
    }

    const fn nibble(self) -> u8 {
        match self {
            Self::Message => 0,
            Self::Job => 4,
            Self::Answer => 8,
        }
    }
}

impl fmt::Display for Telegram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Message => "message",
            Self::Job => "job",
            Self::Answer => "answer",
        })
    }
}

/// A service: its parameters, and its data without the four bytes in front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UserData<'b> {
    /// Job, answer or message.
    pub telegram: Telegram,
    /// The group of the service.
    pub group: Group,
    /// The service in its group: [`sub`].
    pub sub: u8,
    /// Number of a long answer, or of a job of its own.
    pub sequence: u8,
    /// Number that all parts of a long answer share.
    pub unit: u8,
    /// A further part follows; in a job: the next part of an answer is requested.
    pub more: bool,
    /// The error code of an answer.
    pub error: Code,
    /// The code of the data.
    pub code: ItemCode,
    /// The data, without the four bytes in front.
    pub data: &'b [u8],
}

impl<'b> UserData<'b> {
    /// A job of this group, in one part.
    #[must_use]
    pub const fn job(group: Group, sub: u8, data: &'b [u8]) -> Self {
        let code = if data.is_empty() { ItemCode::NO_OBJECT } else { ItemCode::DONE };
        Self { telegram: Telegram::Job, group, sub, sequence: 0, unit: 0, more: false, error: Code::DONE, code, data }
    }

    /// `None`: not a service, or cut off.
    #[must_use]
    pub fn read(parameters: &[u8], data: &'b [u8]) -> Option<Self> {
        let (&[a, b, c, length, _method, group, sub, sequence], rest) = parameters.split_first_chunk::<8>()?;
        if [a, b, c] != HEAD || usize::from(length) != parameters.len() - HEAD.len() - 1 {
            return None;
        }
        let (unit, last, error) = match (length, rest) {
            (SHORT, _) => (0, 0, 0),
            (_, &[unit, last, high, low, ..]) => (unit, last, u16::from_be_bytes([high, low])),
            _ => return None,
        };
        let (code, data) = match data.split_first_chunk::<4>() {
            Some((&[code, _, high, low], rest)) => {
                let len = usize::from(u16::from_be_bytes([high, low]));
                // PLC4X announces 12 bytes in its first job, and sends 4.
                let len = if length == SHORT { len.min(rest.len()) } else { len };
                (ItemCode(code), rest.get(..len)?)
            }
            None if data.is_empty() => (ItemCode::NO_OBJECT, data),
            None => return None,
        };
        // The short form is a job, and one client omits its mark; or a message of the group CPU, which we do not get.
        let telegram = if length == SHORT { Telegram::Job } else { Telegram::of(group >> 4)? };
        // In a job the long form itself means that the next part is requested.
        let more = if telegram == Telegram::Job { length == LONG } else { last != 0 };
        Some(Self {
            telegram,
            group: Group::of(group & 0x0F),
            sub,
            sequence,
            unit,
            more,
            error: Code(error),
            code,
            data,
        })
    }

    /// The message that the operating state has changed. It has no data part at all.
    #[must_use]
    pub fn mode(mode: u8) -> Vec<u8> {
        write(Kind::UserData, 0, Code::DONE, &[&MODE[..], &[mode, 0]].concat(), &[])
    }

    /// The whole telegram, with its header.
    #[must_use]
    pub fn write(&self, reference: u16) -> Vec<u8> {
        let group = self.telegram.nibble() << 4 | self.group.nibble();
        // A message of the group CPU is short, too: otherwise its data would not be where clients look for it.
        let short = match self.telegram {
            Telegram::Job => !self.more,
            Telegram::Message => self.group == Group::Cpu,
            Telegram::Answer => false,
        };
        let [high, low] = self.error.0.to_be_bytes();
        let mut parameters = HEAD.to_vec();
        parameters.extend_from_slice(&[
            if short { SHORT } else { LONG },
            if short { METHOD_SHORT } else { METHOD_LONG },
            group,
            self.sub,
            self.sequence,
        ]);
        if !short {
            let more = u8::from(self.more && self.telegram != Telegram::Job);
            parameters.extend_from_slice(&[self.unit, more, high, low]);
        }
        let transport = if self.data.is_empty() { 0 } else { OCTET };
        let mut data = vec![self.code.0, transport];
        data.extend_from_slice(&(self.data.len() as u16).to_be_bytes());
        data.extend_from_slice(self.data);
        write(Kind::UserData, reference, Code::DONE, &parameters, &data)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Pdu;
    use super::*;

    #[test]
    fn both_ways() {
        let job = UserData::job(Group::Cpu, sub::SZL, &[0, 0x11, 0, 0]);
        let next = UserData { more: true, sequence: 5, ..UserData::job(Group::Cpu, sub::SZL, &[]) };
        let answer = UserData { telegram: Telegram::Answer, unit: 3, more: true, ..job };
        let refused = UserData { error: Code::NO_LIST, code: ItemCode::NO_OBJECT, data: &[], more: false, ..answer };
        let message = UserData { telegram: Telegram::Message, group: Group::Cyclic, ..job };
        for service in [job, next, answer, refused, message] {
            let bytes = service.write(7);
            let pdu = Pdu::read(&bytes).expect("whole");
            assert_eq!(UserData::read(pdu.parameters, pdu.data), Some(service));
        }
    }

    #[test]
    fn messages_of_the_cpu_are_short() {
        let message = UserData { telegram: Telegram::Message, ..UserData::job(Group::Cpu, sub::DIAGNOSIS, &[0x43, 4]) };
        let sent = [0x32, 7, 0, 0, 0, 0, 0, 8, 0, 6, 0, 1, 0x12, 4, 0x11, 0x04, 3, 0, 0xFF, 9, 0, 2, 0x43, 4];
        assert_eq!(message.write(0), sent);
        assert_eq!(UserData::mode(2), [0x32, 7, 0, 0, 0, 0, 0, 8, 0, 0, 1, 0, 0x10, 0x10, 0, 0, 2, 0]);
    }

    #[test]
    fn a_job_is_what_clients_send() {
        let bytes = UserData::job(Group::Cpu, sub::SZL, &[0, 0x11, 0, 0]).write(0x0500);
        let sent = [0x32, 7, 0, 0, 5, 0, 0, 8, 0, 8, 0, 1, 0x12, 4, 0x11, 0x44, 1, 0, 0xFF, 9, 0, 4, 0, 0x11, 0, 0];
        assert_eq!(bytes, sent);
        let unmarked = UserData::read(&[0, 1, 0x12, 4, 0x11, 0x04, 1, 1], &[0xFF, 9, 0, 4, 4, 0x24, 0, 0]);
        assert_eq!(unmarked.map(|service| (service.telegram, service.group)), Some((Telegram::Job, Group::Cpu)));
        let long = UserData::read(&[0, 1, 0x12, 4, 0x11, 0x44, 1, 0], &[0xFF, 9, 0, 12, 0, 0x11, 0, 0]);
        assert_eq!(long.map(|service| service.data), Some(&[0, 0x11, 0, 0][..]));
        let cut = UserData::read(&[0, 1, 0x12, 8, 0x12, 0x84, 1, 0, 0, 0, 0, 0], &[0xFF, 9, 0, 12, 0, 0x11, 0, 0]);
        assert_eq!(cut, None);
        assert_eq!(UserData::read(&[0, 1, 0x12, 8, 0x12, 0x44, 1, 0], &[]), None);
        assert_eq!(UserData::read(&[0, 1, 0x12, 4, 0x11, 0x44, 1, 0], &[1, 2]), None);
    }
}
