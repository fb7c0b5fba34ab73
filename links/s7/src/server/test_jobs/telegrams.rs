//! Answers and results as telegrams, and the job that a request names.

use super::setup::parts;
use crate::codes::Code;
use crate::wire::{Group, Telegram, UserData};

/// Bytes of the parameters of a message.
pub(super) const MESSAGE: usize = 4;

/// Lengths and parameters in front of what a message or a list tells.
pub(super) fn message(class: u8, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0, MESSAGE as u8];
    bytes.extend_from_slice(&(data.len() as u16).to_be_bytes());
    bytes.extend_from_slice(&[0x01, 0x00, 0x00, class]);
    bytes.extend_from_slice(data);
    bytes
}

/// The result of a job.
pub(super) fn result(function: u8, job: u8, class: u8, code: Code, data: &[u8]) -> Vec<u8> {
    let bytes = if data.is_empty() { Vec::new() } else { message(class, data) };
    let push = UserData::job(Group::Test, function, &bytes);
    UserData { telegram: Telegram::Message, sequence: job, error: code, ..push }.write(0)
}

pub(super) fn answer(reference: u16, function: u8, sequence: u8, code: Code, data: &[u8]) -> Vec<u8> {
    let telegram =
        UserData { telegram: Telegram::Answer, sequence, error: code, ..UserData::job(Group::Test, function, data) };
    telegram.write(reference)
}

/// Function and number of the job a service is about; in front of them `0F` has a word.
pub(super) fn named(service: &UserData<'_>) -> Result<(u8, u8), Code> {
    let (_, data) = parts(service.data)?;
    match data {
        [function, number] | [_, _, function, number] => match *number {
            0 => Err(Code::TEST_NUMBER),
            number => Ok((*function, number)),
        },
        _ => Err(Code::TEST_DATA),
    }
}
