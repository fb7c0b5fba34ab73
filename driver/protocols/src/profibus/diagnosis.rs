//! The diagnosis of a DP slave: six bytes that every diagnosis has, then blocks about the device, its modules and its
//! channels.

use core::fmt;

/// Bytes that every diagnosis has.
pub const STANDARD_BYTES: usize = 6;
/// Maximum number of characters of [`Diagnosis::short`].
pub const SHORT: usize = 12;
/// Maximum number of bytes of a diagnosis.
pub const DIAGNOSIS_BYTES: usize = super::DATA_BYTES;

/// The bits of the first two bytes: byte, mask, words.
const FLAGS: [(usize, u8, &str); 15] = [
    (0, 0x01, "does not exist"),
    (0, 0x02, "not ready"),
    (0, 0x04, "configuration fault"),
    (0, 0x08, "device diagnosis"),
    (0, 0x10, "function not supported"),
    (0, 0x20, "invalid answer"),
    (0, 0x40, "parameter fault"),
    (0, 0x80, "belongs to another master"),
    (1, 0x01, "wants parameters"),
    (1, 0x02, "static diagnosis"),
    (1, 0x08, "watchdog on"),
    (1, 0x10, "freeze"),
    (1, 0x20, "sync"),
    (1, 0x80, "deactivated"),
    (2, 0x80, "more than fits"),
];

/// Faults of a channel: error type, words.
const CHANNEL_ERRORS: [(u8, &str); 9] = [
    (1, "short circuit"),
    (2, "undervoltage"),
    (3, "overvoltage"),
    (4, "overload"),
    (5, "overheated"),
    (6, "wire break"),
    (7, "above limit"),
    (8, "below limit"),
    (9, "error"),
];

/// A diagnosis as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Diagnosis<'a>(&'a [u8]);

/// A part of the extended diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block<'a> {
    /// About the device as a whole; its GSD file tells the meaning of the bits.
    Device(&'a [u8]),
    /// Bit n of byte m: slot 8 m + n + 1 has a diagnosis.
    Modules(&'a [u8]),
    /// A channel of a module.
    Channel {
        /// Slot of the module, from 1.
        slot: u8,
        /// Channel of the module, from 0.
        channel: u8,
        /// 1 an input, 2 an output, 3 both.
        direction: u8,
        /// Error type: 1 short circuit, 6 wire break, and so on.
        error: u8,
    },
    /// Any other block: a revision, or the rest after an impossible length.
    Other(&'a [u8]),
}

impl<'a> Diagnosis<'a> {
    /// A diagnosis of received bytes; `None` if they are too few.
    pub const fn new(bytes: &'a [u8]) -> Option<Self> {
        if bytes.len() < STANDARD_BYTES { None } else { Some(Self(bytes)) }
    }

    fn bit(self, byte: usize, mask: u8) -> bool {
        self.0.get(byte).is_some_and(|byte| byte & mask != 0)
    }

    /// The slave is not ready for data.
    pub fn not_ready(self) -> bool {
        self.bit(0, 0x02)
    }

    /// The slave does not accept its configuration.
    pub fn configuration_fault(self) -> bool {
        self.bit(0, 0x04)
    }

    /// The slave reports faults of its own.
    pub fn has_faults(self) -> bool {
        self.bit(0, 0x08)
    }

    /// The slave does not accept its parameters.
    pub fn parameter_fault(self) -> bool {
        self.bit(0, 0x40)
    }

    /// The master that controls the slave.
    pub fn master(self) -> Option<u8> {
        self.0.get(3).copied().filter(|master| *master != 0xFF)
    }

    /// The slave's ident number.
    pub fn ident(self) -> u16 {
        match *self.0 {
            [_, _, _, _, high, low, ..] => u16::from_be_bytes([high, low]),
            _ => 0,
        }
    }

    /// The blocks after the standard bytes.
    pub fn blocks(self) -> impl Iterator<Item = Block<'a>> {
        let mut rest = self.0.get(STANDARD_BYTES..).unwrap_or_default();
        core::iter::from_fn(move || {
            let (&head, _) = rest.split_first()?;
            let len = match head >> 6 {
                0 | 1 => usize::from(head & 0x3F),
                2 => 3,
                _ => 1,
            };
            let Some((block, behind)) = rest.split_at_checked(len).filter(|(block, _)| !block.is_empty()) else {
                return Some(Block::Other(core::mem::take(&mut rest)));
            };
            rest = behind;
            Some(match (head >> 6, block) {
                (0, [_, data @ ..]) => Block::Device(data),
                (1, [_, data @ ..]) => Block::Modules(data),
                (2, &[_, channel, kind]) => Block::Channel {
                    slot: (head & 0x3F) + 1,
                    channel: channel & 0x3F,
                    direction: channel >> 6,
                    error: kind & 0x1F,
                },
                _ => Block::Other(block),
            })
        })
    }

    /// The slots that have a diagnosis, from 1.
    pub fn slots(self) -> impl Iterator<Item = u8> {
        self.blocks().flat_map(|block| {
            let bits = match block {
                Block::Modules(bits) => bits,
                _ => &[],
            };
            let on = |(n, byte): (u8, &u8)| {
                let byte = *byte;
                (0..8)
                    .filter(move |bit| byte >> bit & 1 == 1)
                    .map(move |bit| n.saturating_mul(8).saturating_add(bit + 1))
            };
            (0_u8..).zip(bits).flat_map(on)
        })
    }

    /// Why the slave does not exchange data; `None` if the diagnosis does not tell. `ours` is our address, `ident` the
    /// expected ident number.
    pub fn refusal(self, ours: u8, ident: u16) -> Option<Refused> {
        if self.ident() != ident {
            return Some(Refused::Ident(self.ident()));
        }
        match self.master() {
            Some(master) if master != ours => return Some(Refused::Master(master)),
            _ => {}
        }
        if self.parameter_fault() {
            Some(Refused::Parameters)
        } else if self.configuration_fault() {
            Some(Refused::Configuration)
        } else {
            None
        }
    }

    /// Its most important content in at most [`SHORT`] characters, for a line of the diagnostic buffer.
    pub fn short(self, out: &mut dyn fmt::Write) -> fmt::Result {
        let channel = self.blocks().find_map(|block| match block {
            Block::Channel { slot, channel, error, .. } => Some((slot, channel, error)),
            _ => None,
        });
        if let Some((slot, channel, error)) = channel {
            return write!(out, "s{slot} c{channel} e{error}");
        }
        if let Some(slot) = self.slots().next() {
            return write!(out, "slot {slot}");
        }
        out.write_str(if self.has_faults() { "device" } else { "" })
    }
}

/// Why a slave does not exchange data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The slave is another device.
    Ident(u16),
    /// Another master controls the slave.
    Master(u8),
    /// The slave does not accept its parameters.
    Parameters,
    /// The slave does not accept its configuration.
    Configuration,
}

impl Refused {
    /// What is wrong, and what helps.
    pub const fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Ident(_) => (
                "it is another device than its GSD file says",
                "take the GSD file of the device that is there, or check its address switches",
            ),
            Self::Master(_) => {
                ("another master has it", "remove it from the configuration of that master, or switch that master off")
            }
            Self::Parameters => (
                "it refuses its parameters",
                "compare `params` with its manual, and the revision of its GSD file with that of the device",
            ),
            Self::Configuration => (
                "its modules are not those of the station file",
                "compare `slots` with the plugged modules, in their order",
            ),
        }
    }
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ident(ident) => write!(f, "ident {ident:04X}h"),
            Self::Master(master) => write!(f, "has master {master}"),
            Self::Parameters => f.write_str("parameter fault"),
            Self::Configuration => f.write_str("config. fault"),
        }
    }
}

/// The whole diagnosis as text.
impl fmt::Display for Diagnosis<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ident {:04X}h", self.ident())?;
        if let Some(master) = self.master() {
            write!(f, ", master {master}")?;
        }
        for (byte, mask, words) in FLAGS {
            if self.bit(byte, mask) {
                write!(f, ", {words}")?;
            }
        }
        for block in self.blocks() {
            match block {
                Block::Device(data) => write!(f, ", device {data:02X?}")?,
                Block::Modules(_) => {
                    for slot in self.slots() {
                        write!(f, ", slot {slot}")?;
                    }
                }
                Block::Channel { slot, channel, direction, error } => {
                    let direction = match direction {
                        1 => " input",
                        2 => " output",
                        _ => "",
                    };
                    write!(f, ", slot {slot} channel {channel}{direction}: {}", channel_error(error))?;
                }
                Block::Other(data) => write!(f, ", unknown {data:02X?}")?,
            }
        }
        Ok(())
    }
}

/// What an error type of a channel means.
pub fn channel_error(error: u8) -> &'static str {
    let known = CHANNEL_ERRORS.iter().find(|(number, _)| *number == error);
    known.map_or(if error >= 16 { "error of the device" } else { "reserved error" }, |(_, words)| words)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::{String, ToString};
    use std::vec::Vec;

    #[test]
    fn what_a_slave_says_in_words() {
        for (bytes, words, short) in [
            (&[0, 0x0C, 0, 2, 0x80, 0x1D][..], "ident 801Dh, master 2, watchdog on", ""),
            (&[0x02, 0x05, 0, 0xFF, 0x80, 0x1D], "ident 801Dh, not ready, wants parameters", ""),
            (
                &[0x08, 0x0C, 0, 2, 0x80, 0x1D, 0x43, 0b1000, 0b1, 0x83, 0x42, 0x26],
                "ident 801Dh, master 2, device diagnosis, watchdog on, slot 4, slot 9, slot 4 channel 2 input: wire break",
                "s4 c2 e6",
            ),
            (
                &[0x08, 0x0C, 0, 2, 0, 1, 0x02, 0xAB],
                "ident 0001h, master 2, device diagnosis, watchdog on, device [AB]",
                "device",
            ),
            (&[0x08, 0x04, 0, 2, 0, 1, 0x42, 0x02], "ident 0001h, master 2, device diagnosis, slot 2", "slot 2"),
        ] {
            let diagnosis = Diagnosis::new(bytes).expect("long enough");
            assert_eq!(diagnosis.to_string(), words);
            let mut text = String::new();
            diagnosis.short(&mut text).expect("a string takes it");
            assert_eq!(text, short);
            assert!(text.len() <= SHORT);
        }
        assert_eq!(Diagnosis::new(&[0; 5]), None);
    }

    #[test]
    fn a_length_that_cannot_be_ends_the_blocks() {
        for (blocks, count) in
            [(&[0x00, 1, 2][..], 1), (&[0x40], 1), (&[0x3F, 0], 1), (&[0x80, 1], 1), (&[0xC1, 0x02, 7], 2)]
        {
            let mut bytes = Vec::from([8, 12, 0, 2, 0, 1]);
            bytes.extend(blocks);
            let diagnosis = Diagnosis::new(&bytes).expect("long enough");
            assert_eq!(diagnosis.blocks().count(), count, "{blocks:X?}");
            let _ = diagnosis.to_string();
        }
    }

    #[test]
    fn why_a_slave_refuses() {
        let of =
            |bytes: [u8; 6]| Diagnosis::new(&bytes).expect("six bytes").refusal(2, 0x801D).map(|why| why.to_string());
        assert_eq!(of([0, 0x0C, 0, 2, 0x80, 0x1D]), None);
        assert_eq!(of([0x42, 0x05, 0, 0xFF, 0x80, 0x1D]).as_deref(), Some("parameter fault"));
        assert_eq!(of([0x06, 0x05, 0, 0xFF, 0x80, 0x1D]).as_deref(), Some("config. fault"));
        assert_eq!(of([0x42, 0x05, 0, 0xFF, 0x80, 0x6A]).as_deref(), Some("ident 806Ah"));
        assert_eq!(of([0, 0x0C, 0, 3, 0x80, 0x1D]).as_deref(), Some("has master 3"));
    }
}
