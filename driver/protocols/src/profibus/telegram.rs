//! Telegrams of the data link layer, to bytes and back.

use super::{DATA_BYTES, TELEGRAM_BYTES};

/// Start delimiter of a telegram without data.
const SD1: u8 = 0x10;
/// Start delimiter of a telegram with data of any length.
const SD2: u8 = 0x68;
/// Start delimiter of a telegram with 8 bytes of data.
const SD3: u8 = 0xA2;
/// Start delimiter of a token.
const SD4: u8 = 0xDC;
/// Short confirmation: the whole telegram.
const SC: u8 = 0xE5;
/// End delimiter of every telegram but the short ones.
const ED: u8 = 0x16;
/// Bit of an address that says that a service access point follows.
const EXTENSION: u8 = 0x80;
/// DA, SA and FC, which the length counts besides the data.
const HEAD: usize = 3;

/// A telegram of the data link layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Telegram<'a> {
    /// The token: `da` may send next.
    Token {
        /// To whom the token goes.
        da: u8,
        /// Who gives the token.
        sa: u8,
    },
    /// Short confirmation: done, no data.
    Confirmation,
    /// A request or an answer.
    Data(Frame<'a>),
}

/// A request or an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// DA: address of the receiver.
    pub da: u8,
    /// SA: address of the sender.
    pub sa: u8,
    /// Service access point there; none: the default one.
    pub dsap: Option<u8>,
    /// Service access point here.
    pub ssap: Option<u8>,
    /// FC, the function code: see [`super::function`].
    pub fc: u8,
    /// Data without the service access points.
    pub data: &'a [u8],
}

/// What received bytes begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parsed<'a> {
    /// A telegram, and its number of bytes.
    Telegram(Telegram<'a>, usize),
    /// The beginning of one.
    More,
    /// No telegram, or a damaged one.
    Wrong,
}

/// Reads the telegram at the beginning of `bytes`. All the standard's means to detect damage are checked: delimiters at
/// both ends, both lengths, the check sum. Parity is checked by the receiver.
pub fn parse(bytes: &[u8]) -> Parsed<'_> {
    let (first, len) = match *bytes {
        [] => return Parsed::More,
        [SC, ..] => return Parsed::Telegram(Telegram::Confirmation, 1),
        [SD4, da, sa, ..] => return Parsed::Telegram(Telegram::Token { da, sa }, 3),
        [SD4, ..] => return Parsed::More,
        [SD1, ..] => (1, HEAD),
        [SD3, ..] => (1, HEAD + 8),
        [SD2, le, again, start, ..] => {
            let len = usize::from(le);
            if le != again || start != SD2 || !(HEAD + 1..=HEAD + DATA_BYTES + 2).contains(&len) {
                return Parsed::Wrong;
            }
            (4, len)
        }
        [SD2, le, again, ..] if le != again => return Parsed::Wrong,
        [SD2, ..] => return Parsed::More,
        _ => return Parsed::Wrong,
    };
    let Some((body, rest)) = bytes.get(first..).and_then(|bytes| bytes.split_at_checked(len)) else {
        return Parsed::More;
    };
    let (&[da, sa, fc, ref data @ ..], &[sum, end, ..]) = (body, rest) else { return Parsed::More };
    if sum != checksum(body) || end != ED {
        return Parsed::Wrong;
    }
    let (dsap, data) = extension(da, data);
    let (ssap, data) = extension(sa, data);
    let (Some(dsap), Some(ssap)) = (dsap, ssap) else { return Parsed::Wrong };
    let frame = Frame { da: da & !EXTENSION, sa: sa & !EXTENSION, dsap, ssap, fc, data };
    Parsed::Telegram(Telegram::Data(frame), first + len + 2)
}

/// The service access point that an address announces; the outer `None`: it is missing.
fn extension(address: u8, data: &[u8]) -> (Option<Option<u8>>, &[u8]) {
    match (address & EXTENSION != 0, data) {
        (false, _) => (Some(None), data),
        (true, [sap, rest @ ..]) => (Some(Some(*sap)), rest),
        (true, []) => (None, data),
    }
}

fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Writes a telegram; returns its length, `None` if the data is too long.
pub fn encode(telegram: &Telegram<'_>, out: &mut [u8; TELEGRAM_BYTES]) -> Option<usize> {
    let frame = match *telegram {
        Telegram::Confirmation => {
            out[0] = SC;
            return Some(1);
        }
        Telegram::Token { da, sa } => {
            out[..3].copy_from_slice(&[SD4, da, sa]);
            return Some(3);
        }
        Telegram::Data(frame) => frame,
    };
    let saps = [frame.dsap, frame.ssap];
    let len = HEAD + saps.iter().flatten().count() + frame.data.len();
    if frame.data.len() > DATA_BYTES {
        return None;
    }
    let first = match len {
        HEAD => {
            out[0] = SD1;
            1
        }
        11 => {
            out[0] = SD3;
            1
        }
        _ => {
            out[..4].copy_from_slice(&[SD2, len as u8, len as u8, SD2]);
            4
        }
    };
    let mark = |sap: Option<u8>| if sap.is_some() { EXTENSION } else { 0 };
    out[first..first + HEAD].copy_from_slice(&[frame.da | mark(frame.dsap), frame.sa | mark(frame.ssap), frame.fc]);
    let mut at = first + HEAD;
    for sap in saps.into_iter().flatten() {
        out[at] = sap;
        at += 1;
    }
    out[at..at + frame.data.len()].copy_from_slice(frame.data);
    at += frame.data.len();
    out[at] = checksum(&out[first..at]);
    out[at + 1] = ED;
    Some(at + 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profibus::{function, sap};

    fn frame(data: &[u8], saps: bool) -> Frame<'_> {
        let (dsap, ssap) = if saps { (Some(sap::DIAGNOSIS), Some(sap::MASTER)) } else { (None, None) };
        Frame { da: 8, sa: 2, dsap, ssap, fc: function::REQUEST | function::SRD, data }
    }

    #[test]
    fn telegrams_of_every_length_go_both_ways() {
        let data = [0x5A; DATA_BYTES];
        for len in 0..=DATA_BYTES {
            for saps in [false, true] {
                let telegram = Telegram::Data(frame(&data[..len], saps));
                let mut bytes = [0; TELEGRAM_BYTES];
                let size = encode(&telegram, &mut bytes).expect("it fits");
                assert_eq!(parse(&bytes[..size]), Parsed::Telegram(telegram, size), "{len} {saps}");
                for cut in 0..size {
                    assert_eq!(parse(&bytes[..cut]), Parsed::More, "{len} {saps}: {cut}");
                }
            }
        }
        assert_eq!(encode(&Telegram::Data(frame(&[0; DATA_BYTES + 1], false)), &mut [0; TELEGRAM_BYTES]), None);
    }

    #[test]
    fn known_telegrams() {
        // A request for a diagnosis, as every analyser shows it.
        let bytes = [0x68, 5, 5, 0x68, 0x88, 0x82, 0x6D, 0x3C, 0x3E, 0xF1, 0x16];
        let fc = function::REQUEST | function::COUNT | function::SRD_HIGH;
        let telegram = Telegram::Data(Frame { fc, ..frame(&[], true) });
        assert_eq!(parse(&bytes), Parsed::Telegram(telegram, bytes.len()));
        assert_eq!(parse(&[0xDC, 2, 2, 9]), Parsed::Telegram(Telegram::Token { da: 2, sa: 2 }, 3));
        assert_eq!(parse(&[0xE5]), Parsed::Telegram(Telegram::Confirmation, 1));
        assert_eq!(parse(&[0x10, 3, 2, 0x49, 0x4E, 0x16]).is_telegram(), Some(6));
        assert_eq!(parse(&[]), Parsed::More);
    }

    /// With the parity of the characters the code has a Hamming distance of 4: three wrong bits never leave a valid
    /// telegram of the same length, unless parity detects them.
    #[test]
    fn up_to_three_wrong_bits_are_found() {
        let mut bytes = [0; TELEGRAM_BYTES];
        let telegram = Telegram::Data(frame(&[1, 2, 3, 4, 5, 6, 7, 8], false));
        let size = encode(&telegram, &mut bytes).expect("it fits");
        let bits = size * 8;
        // Only pairs within a character escape the parity bit; it detects a third wrong bit anywhere.
        for (a, b) in (0..bits).flat_map(|a| (a + 1..bits).map(move |b| (a, b))).filter(|(a, b)| a / 8 == b / 8) {
            let mut damaged = bytes;
            damaged[a / 8] ^= 1 << (a % 8);
            damaged[b / 8] ^= 1 << (b % 8);
            let accepted = parse(&damaged[..size]).is_telegram();
            assert!(accepted.is_none(), "bits {a} and {b}");
        }
        for bit in 0..bits {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(parse(&damaged[..size]).is_telegram().is_none(), "bit {bit}");
        }
    }

    #[test]
    fn noise_is_no_telegram() {
        let wrong: [&[u8]; 7] = [
            &[0],
            &[0x68, 5, 6],
            &[0x68, 5, 5, 0x69],
            &[0x68, 2, 2, 0x68],
            &[0x68, 250, 250, 0x68],
            // A service access point is announced but missing.
            &[0x10, 0x83, 2, 0x49, 0xCE, 0x16],
            &[0x10, 3, 2, 0x49, 0x4E, 0x17],
        ];
        for bytes in wrong {
            assert_eq!(parse(bytes), Parsed::Wrong, "{bytes:X?}");
        }
    }

    impl Parsed<'_> {
        fn is_telegram(self) -> Option<usize> {
            match self {
                Parsed::Telegram(_, len) => Some(len),
                Parsed::More | Parsed::Wrong => None,
            }
        }
    }
}
