//! What a bus is made of. The runtime writes it as JSON, the process of the bus reads it: one definition for both.

pub use crate::dp::{DpConfig, DpSlave};
use crate::gpio::GpioConfig;
pub use ob1_protocols::modbus::pdu::{exception_remedy, exception_text};
pub use ob1_protocols::{Instant, Span};
use serde::{Deserialize, Serialize};

/// A bus: the lines of one process, and the bytes they carry.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BusConfig {
    /// Its name.
    pub name: String,
    /// Input bytes of all couplers.
    pub input_bytes: usize,
    /// Output bytes of all couplers.
    pub output_bytes: usize,
    /// A scan that gives no sign of life for so long drives nothing any more: the outputs go off.
    #[serde(with = "nanos")]
    pub scan_timeout: Span,
    /// Its lines.
    pub lines: Vec<LineConfig>,
}

impl BusConfig {
    /// The names of all couplers and slaves, in the order in which [`crate::Image::status`] has them.
    pub fn stations(&self) -> impl Iterator<Item = &str> {
        self.lines.iter().flat_map(LineConfig::stations)
    }

    /// What a line is called where others listen to it: the only one as the bus, of more each by who is on it first.
    #[must_use]
    pub fn line_name(&self, line: usize) -> String {
        let first = self.lines.get(line).filter(|_| self.lines.len() > 1).and_then(|line| line.stations().next());
        first.map_or_else(|| format!("{}.bus", self.name), |first| format!("{}.{first}.bus", self.name))
    }
}

/// One line or connection, with one or more couplers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineConfig {
    /// Where it leads to, as `ob1-line` reads it.
    pub line: String,
    /// How characters travel; none: Modbus TCP.
    pub serial: Option<Serial>,
    /// Longest wait for an answer.
    #[serde(with = "nanos")]
    pub timeout: Span,
    /// Who is on it.
    pub couplers: Vec<CouplerConfig>,
    /// PROFIBUS DP instead of Modbus.
    #[serde(default)]
    pub dp: Option<DpConfig>,
    /// The lines of a GPIO chip instead of Modbus.
    #[serde(default)]
    pub gpio: Option<GpioConfig>,
}

impl LineConfig {
    /// The type of its bus, as in a station file.
    #[must_use]
    pub const fn protocol(&self) -> &'static str {
        if self.gpio.is_some() {
            return "gpio";
        }
        match (&self.dp, &self.serial) {
            (Some(_), _) => "dp",
            (None, Some(_)) => "modbus-rtu",
            (None, None) => "modbus-tcp",
        }
    }

    /// The names of those who are on it.
    pub fn stations(&self) -> impl Iterator<Item = &str> {
        let slaves = self.dp.iter().flat_map(|dp| &dp.slaves).map(|slave| slave.name.as_str());
        let gpio = self.gpio.iter().map(|gpio| gpio.name.as_str());
        self.couplers.iter().map(|coupler| coupler.name.as_str()).chain(slaves).chain(gpio)
    }
}

/// The characters of Modbus RTU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Serial {
    /// Bits per second.
    pub baud: u32,
    /// Parity bit.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
}

/// Parity bit of a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Parity {
    /// None.
    None,
    /// Even: the default of the specification.
    #[default]
    Even,
    /// Odd.
    Odd,
}

/// A coupler.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplerConfig {
    /// Its name.
    pub name: String,
    /// Its address on the line, or behind its connection.
    pub unit: u8,
    /// Time from one reading of its inputs to the next.
    #[serde(with = "nanos")]
    pub period: Span,
    /// Outputs that do not change are written again after this time.
    #[serde(with = "nanos")]
    pub refresh: Span,
    /// A coupler that has not answered for so long is lost.
    #[serde(with = "nanos")]
    pub lost_after: Span,
    /// What it is written on each connect, before anything else.
    pub setup: Vec<Setup>,
    /// How it says that its watchdog runs as it is set there. `None`: it does not.
    #[serde(default)]
    pub proof: Option<Proof>,
    /// What its inputs come from.
    pub inputs: Vec<Range>,
    /// Where its outputs go to.
    pub outputs: Vec<Range>,
}

/// Holding registers that say that a watchdog runs. To set one it must be stopped, and what happens meanwhile it does
/// not see: so it is set only where it does not run already.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Proof {
    /// First of them.
    pub first: u16,
    /// How many.
    pub count: u16,
    /// What some of them must be: the number from the first one on, and the value.
    pub expected: Vec<(u16, u16)>,
    /// So many of what is written on connect are then left out.
    pub skips: usize,
}

/// The four tables of Modbus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Table {
    /// Bits that can be written (0x).
    Coil,
    /// Bits that can only be read (1x).
    Discrete,
    /// Words that can be written (4x).
    Holding,
    /// Words that can only be read (3x).
    Input,
}

impl Table {
    /// By the word of a station file.
    pub const ALL: [(&'static str, Self); 4] =
        [("coil", Self::Coil), ("discrete", Self::Discrete), ("holding", Self::Holding), ("input", Self::Input)];

    /// Its word.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, table)| *table == self).map_or("", |(name, _)| name)
    }

    /// Whether it has bits, not words.
    #[must_use]
    pub const fn has_bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }

    /// Whether it can be written.
    #[must_use]
    pub const fn can_be_written(self) -> bool {
        matches!(self, Self::Coil | Self::Holding)
    }
}

/// How the bytes of registers lie in the process image. A register travels high byte first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// As on an S7: the first register's high byte first (`AB CD`).
    #[default]
    Big,
    /// The bytes of each register exchanged (`BA DC`).
    Little,
    /// The registers of each pair exchanged, for double words (`CD AB`).
    Words,
    /// Both (`DC BA`).
    Reversed,
}

impl Order {
    /// By the word of a station file.
    pub const ALL: [(&'static str, Self); 4] =
        [("big", Self::Big), ("little", Self::Little), ("words", Self::Words), ("reversed", Self::Reversed)];
}

/// Registers or bits in a row, and the bytes of the image that they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// Where they stand.
    pub table: Table,
    /// First of them, from 0.
    pub first: u16,
    /// How many.
    pub count: u16,
    /// Registers only.
    #[serde(default)]
    pub order: Order,
    /// First byte in the inputs, or outputs, of the bus.
    pub at: usize,
}

impl Range {
    /// Behind the last of them; at most 65536.
    #[must_use]
    pub const fn end(&self) -> u32 {
        self.first as u32 + self.count as u32
    }

    /// Bytes of the image. Bit n of a row is bit n modulo 8 of byte n / 8.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        let count = self.count as usize;
        if self.table.has_bits() { count.div_ceil(8) } else { 2 * count }
    }
}

/// A register or coil that is written when a coupler is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// [`Table::Holding`] or [`Table::Coil`].
    pub table: Table,
    /// Which.
    pub at: u16,
    /// What; a coil: 0 or 1.
    pub value: u16,
}

/// A span in a text: nanoseconds. For `#[serde(with)]`.
pub mod nanos {
    use serde::{Deserialize as _, Deserializer, Serializer};

    use super::Span;

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    /// Writes it.
    ///
    /// # Errors
    /// What the text says.
    pub fn serialize<S: Serializer>(span: &Span, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_u64(span.nanos())
    }

    /// Reads it.
    ///
    /// # Errors
    /// It is no number.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Span, D::Error> {
        u64::deserialize(from).map(Span::from_nanos)
    }
}
