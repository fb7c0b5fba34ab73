//! The messages between a CP and the hub of a simulated line, each one message of a
//! [`Channel`](ob1_socket::seqpacket::Channel).
//!
//! | first byte | from | then |
//! |---|---|---|
//! | `S` | CP | the character frame: baud (4 bytes, little-endian), data bits, parity (0 none, 1 odd, 2 even), stop bits in halves |
//! | `W` | CP | characters to send |
//! | `T` | CP | take back characters that have not begun |
//! | `M` | CP | RTS, DTR |
//! | `R` | hub | received characters, faults marked as by `PARMRK` |
//! | `D` | hub | everything of this many `W` (4 bytes, little-endian, modulo 2^32) has been sent |
//! | `M` | hub | CTS, DSR, RI, DCD |

use crate::line::ModemLines;
use crate::supported_frames::{LineSettings, Parity, StopBits};

/// A message to the hub.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ToHub<'a> {
    Settings(LineSettings),
    Write(&'a [u8]),
    TakeBack,
    Modem { rts: bool, dtr: bool },
}

/// A message from the hub.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FromHub<'a> {
    Received(&'a [u8]),
    Done(u32),
    Modem(ModemLines),
}

impl<'a> ToHub<'a> {
    /// `None`: not one of our messages.
    pub(crate) fn read(message: &'a [u8]) -> Option<Self> {
        let (kind, rest) = message.split_first()?;
        Some(match (*kind, rest) {
            (b'S', &[a, b, c, d, data_bits, parity, stop]) => Self::Settings(LineSettings {
                baud: u32::from_le_bytes([a, b, c, d]),
                data_bits,
                parity: match parity {
                    0 => Parity::None,
                    1 => Parity::Odd,
                    2 => Parity::Even,
                    _ => return None,
                },
                stop_bits: match stop {
                    2 => StopBits::One,
                    3 => StopBits::OneAndHalf,
                    4 => StopBits::Two,
                    _ => return None,
                },
                ..LineSettings::default()
            })
            .checked()?,
            (b'W', bytes) if !bytes.is_empty() => Self::Write(bytes),
            (b'T', []) => Self::TakeBack,
            (b'M', &[rts, dtr]) => Self::Modem { rts: rts != 0, dtr: dtr != 0 },
            _ => return None,
        })
    }

    fn checked(self) -> Option<Self> {
        match self {
            Self::Settings(s) if s.baud == 0 || !(5..=8).contains(&s.data_bits) => None,
            other => Some(other),
        }
    }

    pub(crate) fn write(self, into: &mut Vec<u8>) {
        into.clear();
        match self {
            Self::Settings(s) => {
                into.push(b'S');
                into.extend(s.baud.to_le_bytes());
                let parity = match s.parity {
                    Parity::None => 0,
                    Parity::Odd => 1,
                    Parity::Even => 2,
                };
                let stop = match s.stop_bits {
                    StopBits::One => 2,
                    StopBits::OneAndHalf => 3,
                    StopBits::Two => 4,
                };
                into.extend([s.data_bits, parity, stop]);
            }
            Self::Write(bytes) => {
                into.push(b'W');
                into.extend(bytes);
            }
            Self::TakeBack => into.push(b'T'),
            Self::Modem { rts, dtr } => into.extend([b'M', u8::from(rts), u8::from(dtr)]),
        }
    }
}

impl<'a> FromHub<'a> {
    /// `None`: not one of our messages.
    pub(crate) fn read(message: &'a [u8]) -> Option<Self> {
        let (kind, rest) = message.split_first()?;
        Some(match (*kind, rest) {
            (b'R', bytes) => Self::Received(bytes),
            (b'D', &[a, b, c, d]) => Self::Done(u32::from_le_bytes([a, b, c, d])),
            (b'M', &[cts, dsr, ri, cd]) => {
                Self::Modem(ModemLines { cts: cts != 0, dsr: dsr != 0, ri: ri != 0, cd: cd != 0 })
            }
            _ => return None,
        })
    }

    pub(crate) fn write(self, into: &mut Vec<u8>) {
        into.clear();
        match self {
            Self::Received(bytes) => {
                into.push(b'R');
                into.extend(bytes);
            }
            Self::Done(writes) => {
                into.push(b'D');
                into.extend(writes.to_le_bytes());
            }
            Self::Modem(m) => into.extend([b'M', m.cts.into(), m.dsr.into(), m.ri.into(), m.cd.into()]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn messages_go_both_ways() {
        let mut message = Vec::new();
        let settings = LineSettings {
            baud: 115_200,
            parity: Parity::Odd,
            stop_bits: StopBits::OneAndHalf,
            ..LineSettings::default()
        };
        for to in
            [ToHub::Settings(settings), ToHub::Write(b"x"), ToHub::TakeBack, ToHub::Modem { rts: true, dtr: false }]
        {
            to.write(&mut message);
            assert_eq!(ToHub::read(&message), Some(to));
        }
        let modem = ModemLines { dsr: true, ..ModemLines::default() };
        for from in [FromHub::Received(&[0xFF, 0xFF]), FromHub::Done(0x0102_0304), FromHub::Modem(modem)] {
            from.write(&mut message);
            assert_eq!(FromHub::read(&message), Some(from));
        }
        for wrong in [
            &b""[..],
            b"X",
            b"S\0\0\0\0\x08\0\x02",
            b"S\x01\0\0\0\x09\0\x02",
            b"S\x01\0\0\0\x08\x03\x02",
            b"W",
            b"M\x01",
        ] {
            assert_eq!(ToHub::read(wrong), None, "{wrong:?}");
        }
    }

    proptest! {
        #[test]
        fn noise_is_no_panic(noise in proptest::collection::vec(any::<u8>(), 0..40)) {
            let _ = ToHub::read(&noise);
            let _ = FromHub::read(&noise);
        }
    }
}
