//! The telegrams of the sending blocks of two CPUs: USEND and BSEND. BSEND splits its data into parts, each with an
//! answer.

use super::{Kind, OCTET, write};
use crate::codes::Code;
use crate::wire::{Group, JOB_HEAD, Telegram, UserData};

/// The item that carries R_ID: an address of six bytes with this syntax.
const R_ID: [u8; 4] = [0x12, 6, 0x13, 0];
const HEAD: [u8; 3] = [0, 1, 0x12];
/// Parameters of a part of BSEND: length, long form, a job of the group, BSEND, sequence.
const BSEND: [u8; 5] = [8, 0x12, 0x46, 1, 0];
/// Header, parameters, data header and R_ID of a part.
const PART: usize = JOB_HEAD + 12 + 4 + 8;
/// Header, parameters, return code and count, and the header of an item of USEND.
const USEND: usize = JOB_HEAD + 10 + 4 + 4;

/// Bytes of data in a part of BSEND; the first one has two fewer.
#[must_use]
pub const fn part_bytes(pdu: u16) -> usize {
    (pdu as usize).saturating_sub(PART)
}

/// Maximum data of a USEND.
#[must_use]
pub const fn usend_bytes(pdu: u16) -> usize {
    (pdu as usize).saturating_sub(USEND)
}

/// Whether these are the parameters of an answer to a part of BSEND.
#[must_use]
pub(crate) fn is_answer(parameters: &[u8]) -> bool {
    UserData::read(parameters, &[]).is_some_and(|s| s.telegram == Telegram::Answer && s.group == Group::Pbc)
}

/// Whether these are the parameters of a part of BSEND, or of a USEND.
#[must_use]
pub(crate) fn is_for_blocks(parameters: &[u8]) -> bool {
    parameters.starts_with(&[HEAD[0], HEAD[1]]) && parameters.get(2..6) == Some(&R_ID)
        || parameters.starts_with(&HEAD) && parameters.get(3..7) == Some(&[BSEND[0], BSEND[1], BSEND[2], BSEND[3]])
}

/// Parameters and data of a part. `unit` counts the parts from 1; 0 means the only part. `total` is in the first.
#[must_use]
pub fn part(r_id: u32, unit: u8, more: bool, total: Option<u16>, bytes: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let parameters = [&HEAD[..], &BSEND, &[unit, u8::from(more), 0, 0]].concat();
    let total = total.map(u16::to_be_bytes);
    let total = total.as_ref().map_or(&[][..], |total| total);
    let length = (R_ID.len() + 4 + total.len() + bytes.len()) as u16;
    let data = [&[0xFF, OCTET][..], &length.to_be_bytes(), &R_ID, &r_id.to_be_bytes(), total, bytes].concat();
    (parameters, data)
}

/// A received part of BSEND, or a received USEND.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent<'b> {
    /// A part of a BSEND.
    Part {
        /// R_ID: which BRCV the part is for.
        r_id: u32,
        /// The sender's count, which some begin with 1 in each BSEND; 0: the only part.
        unit: u8,
        /// Whether another part follows.
        more: bool,
        /// The bytes after R_ID; the first part begins with the total length.
        bytes: &'b [u8],
    },
    /// The only telegram of a USEND.
    Usend {
        /// R_ID: which URCV it is for.
        r_id: u32,
        /// All areas, one after the other, each with its header.
        items: &'b [u8],
    },
}

/// `None`: neither, or cut off.
#[must_use]
pub fn read<'b>(parameters: &[u8], data: &'b [u8]) -> Option<Sent<'b>> {
    if let Some([a, b, c, d]) = parameters.strip_prefix(&HEAD[..2]).and_then(|rest| rest.strip_prefix(&R_ID)) {
        let &[_, _, _, _, ref items @ ..] = data else { return None };
        return Some(Sent::Usend { r_id: u32::from_be_bytes([*a, *b, *c, *d]), items });
    }
    let &[unit, more, ..] = parameters.strip_prefix(&HEAD)?.strip_prefix(&BSEND[..4])?.get(1..)? else { return None };
    let (&[_, _, high, low], rest) = data.split_first_chunk::<4>()?;
    let bytes = rest.get(..usize::from(u16::from_be_bytes([high, low])))?.strip_prefix(&R_ID)?;
    let (r_id, bytes) = bytes.split_first_chunk::<4>()?;
    Some(Sent::Part { r_id: u32::from_be_bytes(*r_id), unit, more: more != 0, bytes })
}

/// The answer to a part.
#[must_use]
pub fn part_answer(reference: u16, unit: u8, error: Code) -> Vec<u8> {
    let [high, low] = error.0.to_be_bytes();
    let parameters = [&HEAD[..], &[8, 0x12, 0x86, 1, 0, unit, 0, high, low]].concat();
    write(Kind::UserData, reference, Code::DONE, &parameters, &[0x0A, 0, 0, 0])
}

/// Parameters and data of a USEND with one area of bytes.
#[must_use]
pub fn usend(r_id: u32, areas: &[&[u8]]) -> (Vec<u8>, Vec<u8>) {
    let parameters = [&HEAD[..2], &R_ID, &r_id.to_be_bytes()].concat();
    let mut data = vec![0xFF, 0, 0, areas.len() as u8];
    for area in areas {
        if !data.len().is_multiple_of(2) {
            data.push(0);
        }
        data.extend_from_slice(&[0, OCTET]);
        data.extend_from_slice(&(area.len() as u16).to_be_bytes());
        data.extend_from_slice(area);
    }
    (parameters, data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Pdu;

    /// The telegram of snap7's partner for 10 bytes with R_ID 11223344h, and the first of three parts of 600.
    #[test]
    fn parts_are_those_of_a_known_partner() {
        let bytes: Vec<u8> = (0..10).collect();
        let (parameters, data) = part(0x1122_3344, 0, false, Some(10), &bytes);
        assert_eq!(parameters, [0, 1, 0x12, 8, 0x12, 0x46, 1, 0, 0, 0, 0, 0]);
        assert_eq!(data[..14], [0xFF, 9, 0, 0x14, 0x12, 6, 0x13, 0, 0x11, 0x22, 0x33, 0x44, 0, 10]);
        let (parameters, data) = part(0x1122_3344, 1, true, Some(600), &[7; 204]);
        assert_eq!(parameters[8..10], [1, 1]);
        assert_eq!((JOB_HEAD + parameters.len() + data.len(), part_bytes(240) - 2), (240, 204));
        assert_eq!(&data[2..4], [0, 0xD6]);
    }

    #[test]
    fn both_ways_and_nothing_cut_off() {
        let (parameters, data) = part(9, 3, true, None, &[1, 2, 3]);
        assert!(is_for_blocks(&parameters) && !is_answer(&parameters));
        assert_eq!(read(&parameters, &data), Some(Sent::Part { r_id: 9, unit: 3, more: true, bytes: &[1, 2, 3] }));
        assert_eq!((0..data.len()).find(|len| read(&parameters, &data[..*len]).is_some()), None);
        let (parameters, data) = usend(0x0102_0304, &[&[1, 2, 3], &[4]]);
        assert!(is_for_blocks(&parameters) && !is_answer(&parameters));
        let items = &[0, 9, 0, 3, 1, 2, 3, 0, 0, 9, 0, 1, 4][..];
        assert_eq!(read(&parameters, &data), Some(Sent::Usend { r_id: 0x0102_0304, items }));
        let answer = part_answer(5, 3, Code::NO_SERVICE);
        let pdu = Pdu::read(&answer).expect("a telegram");
        let service = UserData::read(pdu.parameters, pdu.data).expect("a service");
        assert!(is_answer(pdu.parameters) && !is_for_blocks(pdu.parameters));
        assert_eq!((pdu.reference, service.error, service.unit), (5, Code::NO_SERVICE, 3));
    }
}
