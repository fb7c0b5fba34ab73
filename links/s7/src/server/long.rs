//! Answers that are longer than a PDU: they go out in parts, each when the partner asks for it.

use crate::codes::{Code, ItemCode};
use crate::wire::{Group, Telegram, USERDATA_HEAD, UserData};

/// Maximum of unfinished long answers per connection.
const ANSWERS: usize = 4;
/// Maximum bytes of an answer: a list of 16,384 blocks.
pub(super) const MOST: usize = 64 * 1024;
/// Bytes of an entry in a list of blocks.
pub(super) const ENTRY: usize = 4;

#[derive(Debug)]
struct Answer {
    group: Group,
    sub: u8,
    sequence: u8,
    bytes: Vec<u8>,
    sent: usize,
}

/// Long answers.
#[derive(Debug, Default)]
pub(super) struct LongAnswers {
    answers: Vec<Answer>,
    next: u8,
}

impl LongAnswers {
    /// The first part of an answer; the only one, if it fits.
    pub(super) fn first(&mut self, reference: u16, group: Group, sub: u8, bytes: Vec<u8>, pdu: usize) -> Vec<u8> {
        if bytes.len() > pdu - USERDATA_HEAD {
            // The partner has forgotten the oldest one.
            if self.answers.len() >= ANSWERS {
                self.answers.remove(0);
            }
            self.next = self.next % 0xFF + 1;
            self.answers.push(Answer { group, sub, sequence: self.next, bytes, sent: 0 });
            return self.next(reference, group, sub, self.next, pdu);
        }
        let service = UserData { telegram: Telegram::Answer, ..UserData::job(group, sub, &bytes) };
        service.write(reference)
    }

    /// The next part.
    pub(super) fn next(&mut self, reference: u16, group: Group, sub: u8, sequence: u8, pdu: usize) -> Vec<u8> {
        let of = |answer: &Answer| (answer.group, answer.sub, answer.sequence) == (group, sub, sequence);
        let Some(index) = self.answers.iter().position(of) else {
            return refused(reference, group, sub, Code::NOT_NOW);
        };
        let answer = &mut self.answers[index];
        // No entry of a list of blocks is cut: clients evaluate each part by itself.
        let most = (pdu - USERDATA_HEAD) / ENTRY * ENTRY;
        let rest = answer.bytes.get(answer.sent..).unwrap_or_default();
        let part = rest.get(..most).unwrap_or(rest);
        answer.sent += part.len();
        let more = answer.sent < answer.bytes.len();
        let job = UserData::job(group, sub, part);
        let telegram = UserData { telegram: Telegram::Answer, sequence, unit: sequence, more, ..job }.write(reference);
        if !more {
            self.answers.remove(index);
        }
        telegram
    }
}

/// A service is refused.
pub(super) fn refused(reference: u16, group: Group, sub: u8, why: Code) -> Vec<u8> {
    let job = UserData::job(group, sub, &[]);
    UserData { telegram: Telegram::Answer, error: why, code: ItemCode::NO_OBJECT, ..job }.write(reference)
}

/// A service without data is done.
pub(super) fn done(reference: u16, group: Group, sub: u8, sequence: u8) -> Vec<u8> {
    let job = UserData::job(group, sub, &[]);
    UserData { telegram: Telegram::Answer, sequence, ..job }.write(reference)
}
