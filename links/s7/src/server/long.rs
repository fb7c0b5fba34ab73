//! Answers that are longer than a PDU: they go out in parts, each when the partner asks for it.

use crate::codes::{Code, ItemCode};
use crate::wire::{Group, Telegram, USERDATA_HEAD, UserData, sub};

/// Maximum of unfinished long answers per connection.
const ANSWERS: usize = 4;
/// Maximum bytes of an answer: a list of 16,384 blocks.
pub(super) const MOST: usize = 64 * 1024;
/// Bytes of an entry in a list of blocks.
pub(super) const ENTRY: usize = 4;
/// Bytes that a part of a list of blocks stays below what fits. [recorded: 208 of 214]
const SPARE: usize = 6;
/// Number of a service that is over with its answer. Jobs that stay have numbers of their own; clients keep the pair of
/// service and number.
pub(super) const SERVICE_NUMBER: u8 = 1;

#[derive(Debug)]
struct Answer {
    group: Group,
    sub: u8,
    sequence: u8,
    bytes: Vec<u8>,
    sent: usize,
}

/// Long answers whose rest has not been asked for yet.
#[derive(Debug, Default)]
pub(super) struct LongAnswers {
    answers: Vec<Answer>,
    next: u8,
}

impl LongAnswers {
    /// The first part of an answer; the only one, if it fits.
    pub(super) fn first(&mut self, reference: u16, group: Group, sub: u8, bytes: Vec<u8>, pdu: usize) -> Vec<u8> {
        if bytes.len() > most(group, sub, pdu) {
            // The partner has forgotten the oldest one.
            if self.answers.len() >= ANSWERS {
                self.answers.remove(0);
            }
            self.next = self.next % 0xFF + 1;
            self.answers.push(Answer { group, sub, sequence: self.next, bytes, sent: 0 });
            return self.next(reference, group, sub, self.next, pdu);
        }
        answer(reference, group, sub, &bytes)
    }

    /// The next part of the answer with this number.
    pub(super) fn next(&mut self, reference: u16, group: Group, sub: u8, sequence: u8, pdu: usize) -> Vec<u8> {
        let of = |answer: &Answer| (answer.group, answer.sub, answer.sequence) == (group, sub, sequence);
        let Some(index) = self.answers.iter().position(of) else {
            return refused(reference, group, sub, Code::NOT_NOW);
        };
        let answer = &mut self.answers[index];
        let most = most(group, sub, pdu);
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

/// Bytes of a part. No entry of a list of blocks is cut: clients evaluate each part by itself.
const fn most(group: Group, sub: u8, pdu: usize) -> usize {
    match (group, sub) {
        (Group::Blocks, sub::BLOCK_LIST) => (pdu - USERDATA_HEAD - SPARE) / ENTRY * ENTRY,
        _ => pdu - USERDATA_HEAD,
    }
}

/// The answer of a service that is over with it.
pub(super) fn answer(reference: u16, group: Group, sub: u8, data: &[u8]) -> Vec<u8> {
    let job = UserData::job(group, sub, data);
    UserData { telegram: Telegram::Answer, sequence: SERVICE_NUMBER, ..job }.write(reference)
}

/// A service is refused.
pub(super) fn refused(reference: u16, group: Group, sub: u8, why: Code) -> Vec<u8> {
    let job = UserData::job(group, sub, &[]);
    let (telegram, code) = (Telegram::Answer, ItemCode::NO_OBJECT);
    UserData { telegram, sequence: SERVICE_NUMBER, error: why, code, ..job }.write(reference)
}

/// A service without data is done.
pub(super) fn done(reference: u16, group: Group, sub: u8, sequence: u8) -> Vec<u8> {
    let job = UserData::job(group, sub, &[]);
    UserData { telegram: Telegram::Answer, sequence, ..job }.write(reference)
}
