//! The configuration of a bus. The runtime writes it as JSON, the process of the bus reads it: one definition for both.

pub use crate::dp::{DpConfig, DpSlave};
use crate::gpio::config::GpioConfig;
pub use crate::nanos;
pub use ob1_protocols::modbus::exception::{exception_remedy, exception_text};
pub use ob1_protocols::{Instant, LineSettings, Parity, Span, StopBits};
use serde::{Deserialize, Serialize};

/// A bus: the lines of one process, and their bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BusConfig {
    /// Name of the bus in the station file.
    pub name: String,
    /// Input bytes of all couplers.
    pub input_bytes: usize,
    /// Output bytes of all couplers.
    pub output_bytes: usize,
    /// If the scan gives no sign of life for this long, the outputs go off.
    #[serde(with = "nanos")]
    pub scan_timeout: Span,
    /// The lines that the process of the bus drives.
    pub lines: Vec<LineConfig>,
}

impl BusConfig {
    /// The names of all couplers and slaves, in the order of [`crate::Image::status`].
    pub fn stations(&self) -> impl Iterator<Item = &str> {
        self.lines.iter().flat_map(LineConfig::stations)
    }

    /// The name of a line for listeners: that of the bus if there is only one line, otherwise with the name of its
    /// first station.
    pub fn line_name(&self, line: usize) -> String {
        let first = self.lines.get(line).filter(|_| self.lines.len() > 1).and_then(|line| line.stations().next());
        first.map_or_else(|| format!("{}.bus", self.name), |first| format!("{}.{first}.bus", self.name))
    }
}

/// One line or connection, with one or more couplers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineConfig {
    /// The line, in the notation of `ob1-line`.
    pub line: String,
    /// The serial settings; `None`: Modbus TCP.
    pub serial: Option<Serial>,
    /// Longest wait for an answer.
    #[serde(with = "nanos")]
    pub timeout: Span,
    /// The Modbus couplers on this line.
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

    /// The names of its stations.
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
    /// Bits per second on the line.
    pub baud: u32,
    /// Parity bit of each character.
    #[serde(with = "ParityWord")]
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
}

impl Serial {
    /// The settings of the line.
    pub fn settings(&self) -> LineSettings {
        LineSettings {
            baud: self.baud,
            parity: self.parity,
            stop_bits: if self.stop_bits == 2 { StopBits::Two } else { StopBits::One },
            half_duplex: true,
            ..LineSettings::default()
        }
    }
}

/// The words of a parity bit.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Parity", rename_all = "lowercase")]
enum ParityWord {
    None,
    Odd,
    Even,
}

/// A coupler: its address, its times, its ranges.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplerConfig {
    /// Name of the coupler in the station file, and in messages.
    pub name: String,
    /// Its address on the line, or on its connection.
    pub unit: u8,
    /// Time from one reading of its inputs to the next.
    #[serde(with = "nanos")]
    pub period: Span,
    /// Outputs that do not change are written again after this time.
    #[serde(with = "nanos")]
    pub refresh: Span,
    /// A coupler that has not answered for this long is lost.
    #[serde(with = "nanos")]
    pub lost_after: Span,
    /// Written on each connect, before anything else.
    pub setup: Vec<Setup>,
    /// How it shows that its watchdog runs with the set time. `None`: it does not show it.
    #[serde(default)]
    pub proof: Option<Proof>,
    /// The sources of its inputs.
    pub inputs: Vec<Range>,
    /// The destinations of its outputs.
    pub outputs: Vec<Range>,
}

/// Holding registers that show that a watchdog runs. To set a watchdog it must be stopped, and meanwhile it protects
/// nothing: so it is set only if it does not run already.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Proof {
    /// Number of the first of them, from 0.
    pub first: u16,
    /// How many registers are read, from `first` on.
    pub count: u16,
    /// The required values of some of them: the number counted from the first one, and the value.
    pub expected: Vec<(u16, u16)>,
    /// Number of set-up writes that are then skipped.
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

    /// The word for the table in a station file and in messages.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, table)| *table == self).map_or("", |(name, _)| name)
    }

    /// Whether it has bits, not words.
    pub const fn has_bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }

    /// Whether it can be written.
    pub const fn can_be_written(self) -> bool {
        matches!(self, Self::Coil | Self::Holding)
    }
}

/// The byte order of registers in the process image. A register is transferred high byte first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// As on an S7: the first register's high byte first (`AB CD`).
    #[default]
    Big,
    /// The bytes of each register swapped (`BA DC`).
    Little,
    /// The registers of each pair swapped, for double words (`CD AB`).
    Words,
    /// Both: bytes and registers swapped (`DC BA`).
    Reversed,
}

impl Order {
    /// By the word of a station file.
    pub const ALL: [(&'static str, Self); 4] =
        [("big", Self::Big), ("little", Self::Little), ("words", Self::Words), ("reversed", Self::Reversed)];
}

/// Consecutive registers or bits, and their bytes in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// The table that the elements belong to.
    pub table: Table,
    /// First of them, from 0.
    pub first: u16,
    /// How many registers or bits.
    pub count: u16,
    /// Byte order in the image; bits ignore it.
    #[serde(default)]
    pub order: Order,
    /// First byte in the inputs, or outputs, of the bus.
    pub at: usize,
}

impl Range {
    /// The end, after the last of them; at most 65536.
    pub const fn end(&self) -> u32 {
        self.first as u32 + self.count as u32
    }

    /// Bytes of the image. Bit n of a range is bit n modulo 8 of byte n / 8.
    pub const fn bytes(&self) -> usize {
        let count = self.count as usize;
        if self.table.has_bits() { count.div_ceil(8) } else { 2 * count }
    }
}

/// A register or coil that is written when a coupler is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// The table: [`Table::Holding`] or [`Table::Coil`].
    pub table: Table,
    /// Number of the register or coil, from 0.
    pub at: u16,
    /// The value; for a coil 0 or 1.
    pub value: u16,
}
