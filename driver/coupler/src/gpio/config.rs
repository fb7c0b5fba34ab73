//! The configuration of the lines of a GPIO chip.

use ob1_protocols::Span;
use serde::{Deserialize, Serialize};

use crate::nanos;

/// The lines of one chip.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GpioConfig {
    /// Name of the chip in the station file, and in messages.
    pub name: String,
    /// Path of the device, `/dev/gpiochip0`.
    pub chip: String,
    /// Time from one reading of its inputs to the next.
    #[serde(with = "nanos")]
    pub period: Span,
    /// The lines to read.
    pub inputs: Vec<GpioLine>,
    /// The lines to drive.
    pub outputs: Vec<GpioLine>,
}

/// A line, and its bit in the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GpioLine {
    /// Its number on the chip.
    pub line: u32,
    /// Byte in the inputs, or outputs, of the bus.
    pub at: usize,
    /// Bit of the byte, 0 to 7.
    pub bit: u8,
    /// True: a low level is 1.
    #[serde(default)]
    pub active_low: bool,
    /// Bias of an input.
    #[serde(default)]
    pub bias: Bias,
    /// An input counts as changed when it has been stable for this long; 0: at once.
    #[serde(default, with = "nanos")]
    pub debounce: Span,
    /// Drive of an output.
    #[serde(default)]
    pub drive: Drive,
}

/// The pull of an input that nothing drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bias {
    /// As set by the board.
    #[default]
    AsIs,
    /// A resistor to the supply.
    PullUp,
    /// A resistor to ground.
    PullDown,
    /// Neither resistor: the level of an open input is undefined.
    Disabled,
}

impl Bias {
    /// By the word in a station file.
    pub const ALL: [(&'static str, Self); 4] =
        [("as-is", Self::AsIs), ("pull-up", Self::PullUp), ("pull-down", Self::PullDown), ("disabled", Self::Disabled)];
}

/// How an output is driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Drive {
    /// The chip drives it high and low.
    #[default]
    PushPull,
    /// The chip drives it low; high is an external resistor's affair.
    OpenDrain,
    /// The chip drives it high; low is an external resistor's affair.
    OpenSource,
}

impl Drive {
    /// By the word in a station file.
    pub const ALL: [(&'static str, Self); 3] =
        [("push-pull", Self::PushPull), ("open-drain", Self::OpenDrain), ("open-source", Self::OpenSource)];
}
