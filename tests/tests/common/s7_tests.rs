//! Test functions of S7 communication over a raw connection.

use std::io::Write as _;

use ob1_tests::s7_raw::Raw;

/// As they go over the wire.
pub(crate) fn words(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_be_bytes()).collect()
}

/// Lengths, parameters, data.
pub(crate) fn request(begin: u16, end: u16, result: usize, trigger: u16, more: &[u16], data: &[u8]) -> Vec<u8> {
    let head = [0, begin, end, result as u16, 1, 1, 1, 1, 1, trigger];
    let lengths = [20 + 2 * more.len() as u16, data.len() as u16];
    [words(&lengths), words(&head), words(more), data.to_vec()].concat()
}

/// Sends a test function.
pub(crate) fn send(raw: &mut Raw, function: u8, data: &[u8]) {
    let mut telegram = vec![0x32, 7, 0, 0];
    telegram.extend(words(&[9, 12, 4 + data.len() as u16]));
    telegram.extend([0, 1, 0x12, 8, 0x12, 0x41, function, 0, 0, 0, 0, 0, 0xFF, 9]);
    telegram.extend(words(&[data.len() as u16]));
    telegram.extend_from_slice(data);
    let mut frame = vec![3, 0];
    frame.extend(words(&[7 + telegram.len() as u16]));
    frame.extend([2, 0xF0, 0x80]);
    frame.extend(telegram);
    raw.0.write_all(&frame).expect("it reads");
}

/// Group and service, number of the job, code, data of what comes next.
pub(crate) fn next(raw: &mut Raw) -> (u8, u8, u8, u16, Vec<u8>) {
    let frame = raw.frame().expect("an answer");
    let frame = &frame[7..];
    (frame[15], frame[16], frame[17], u16::from_be_bytes([frame[20], frame[21]]), frame[26..].to_vec())
}

/// Sets a job up, which must succeed; gives its number.
pub(crate) fn set_up(raw: &mut Raw, function: u8, data: &[u8]) -> u8 {
    send(raw, function, data);
    let (kind, service, number, code, _) = next(raw);
    assert_eq!((kind, service, code), (0x81, function, 0));
    number
}

/// Enables a job: one answer, then one result.
pub(crate) fn enable(raw: &mut Raw, function: u8, number: u8) -> Vec<u8> {
    send(raw, 0x0E, &request(0, 1, 0, 0, &[], &[function, number]));
    let (kind, service, own, code, _) = next(raw);
    assert_eq!((kind, service, code), (0x81, 0x0E, 0));
    assert_ne!(own, number);
    let (kind, service, of, code, data) = next(raw);
    assert_eq!((kind, service, of, code), (0x01, function, number, 0));
    data
}
