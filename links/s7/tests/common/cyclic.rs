//! Jobs of cyclic data, and what is told by them.

use super::{Desk, service};

pub(crate) const PERIODIC: u8 = 1;
pub(crate) const DELETE: u8 = 4;
pub(crate) const CHANGES: u8 = 5;
pub(crate) const REPLACE: u8 = 7;

/// The data of a job: number of items, time base, factor, items with fill bytes between them.
pub(crate) fn list(base: u8, factor: u8, items: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = (items.len() as u16).to_be_bytes().to_vec();
    bytes.extend_from_slice(&[base, factor]);
    for (index, item) in items.iter().enumerate() {
        bytes.extend_from_slice(item);
        if index + 1 < items.len() && item.len() % 2 == 1 {
            bytes.push(0xEE);
        }
    }
    bytes
}

/// A telegram of cyclic data in its parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Told {
    /// 8 answer, 0 message.
    pub(crate) kind: u8,
    pub(crate) sub: u8,
    pub(crate) number: u8,
    pub(crate) error: u16,
    pub(crate) data: Vec<u8>,
}

pub(crate) fn told(telegram: &[u8]) -> Told {
    let is_message = telegram[15] >> 4 == 0;
    assert_eq!(telegram[..4], [0x32, 7, 0, 0]);
    assert_eq!(telegram[10..15], [0, 1, 0x12, 8, 0x12]);
    assert_eq!((telegram[15] & 0x0F, &telegram[18..20]), (2, &[0, 0][..]));
    assert_eq!(telegram[4..6], if is_message { [0, 0] } else { [0, 5] });
    assert_eq!(usize::from(u16::from_be_bytes([telegram[24], telegram[25]])), telegram.len() - 26);
    assert_eq!(telegram[22..24], if telegram.len() > 26 { [0xFF, 9] } else { [0x0A, 0] });
    let error = u16::from_be_bytes([telegram[20], telegram[21]]);
    Told { kind: telegram[15] >> 4, sub: telegram[16], number: telegram[17], error, data: telegram[26..].to_vec() }
}

/// A service with a number of its own, and what is told by then.
pub(crate) fn ask(desk: &mut Desk, sub: u8, number: u8, data: &[u8]) -> Told {
    let mut bytes = service(2, sub, data);
    bytes[17] = number;
    desk.send(&bytes);
    let answers = desk.answers();
    assert_eq!(answers.len(), 1, "{answers:02X?}");
    let told = told(&answers[0]);
    assert_eq!((told.kind, told.sub), (8, sub));
    told
}

pub(crate) fn refused(desk: &mut Desk, sub: u8, number: u8, data: &[u8]) -> u16 {
    let told = ask(desk, sub, number, data);
    assert!(told.error != 0 && told.data.is_empty(), "{told:?}");
    told.error
}

/// What is told at this time: the service, the job, the data.
pub(crate) fn at(desk: &mut Desk, now: u64) -> Vec<(u8, u8, Vec<u8>)> {
    desk.connection.tick(now);
    desk.serve();
    let messages: Vec<_> = desk.answers().iter().map(|telegram| told(telegram)).collect();
    assert!(messages.iter().all(|told| (told.kind, told.error) == (0, 0)), "{messages:?}");
    messages.into_iter().map(|told| (told.sub, told.number, told.data)).collect()
}
