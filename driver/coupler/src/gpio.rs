//! Lines of a GPIO chip as a small bus: its configuration, and its master as a machine. The chip itself is passed in
//! ([`Pins`]).

use serde::{Deserialize, Serialize};

use crate::config::{Instant, Span, nanos};
use crate::image::{Image, State};

/// A chip that could not be used is tried again after this time.
const AGAIN: Span = Span::SECOND;

/// The lines of one chip.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GpioConfig {
    /// Its name.
    pub name: String,
    /// The device: `/dev/gpiochip0`.
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
    /// Bit of it.
    pub bit: u8,
    /// Low is 1.
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
    /// Nothing.
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
    /// In both directions.
    #[default]
    PushPull,
    /// Only low.
    OpenDrain,
    /// Only high.
    OpenSource,
}

impl Drive {
    /// By the word in a station file.
    pub const ALL: [(&'static str, Self); 3] =
        [("push-pull", Self::PushPull), ("open-drain", Self::OpenDrain), ("open-source", Self::OpenSource)];
}

/// The lines of an open chip. All are read, or driven, at the same time; true is active.
pub trait Pins {
    /// Reads the inputs, in the order of the configuration.
    ///
    /// # Errors
    /// The system's error: the chip is gone.
    fn read(&mut self, inputs: &mut [bool]) -> Result<(), String>;
    /// Drives the outputs.
    ///
    /// # Errors
    /// As [`Self::read`].
    fn write(&mut self, outputs: &[bool]) -> Result<(), String>;
}

/// Opens a chip, with its outputs off.
pub type OpenPins<'a> = &'a mut dyn FnMut(&GpioConfig) -> Result<Box<dyn Pins>, String>;

/// Reads and drives the lines of a chip.
pub struct GpioMaster {
    config: GpioConfig,
    /// Its place in the image's list.
    index: usize,
    pins: Option<Box<dyn Pins>>,
    due: Instant,
    levels: Vec<bool>,
    driven: Vec<bool>,
    why: Option<String>,
}

impl GpioMaster {
    /// The master of a chip with place `index` in the image's list.
    #[must_use]
    pub fn new(config: &GpioConfig, index: usize) -> Self {
        Self {
            levels: vec![false; config.inputs.len()],
            driven: vec![false; config.outputs.len()],
            config: config.clone(),
            index,
            pins: None,
            due: Instant::START,
            why: None,
        }
    }

    /// Drives the outputs, and reads the inputs when due; returns when to call again at the latest.
    pub fn step(&mut self, now: Instant, image: &mut Image, open: OpenPins<'_>) -> Instant {
        if let Err(why) = self.work(now, image, open) {
            (self.pins, self.due) = (None, now + AGAIN);
            self.why = Some(why);
            image.tell(self.index, |status| {
                status.failures += 1;
                if status.state != State::Lost {
                    (status.state, status.losses) = (State::Lost, status.losses + 1);
                }
            });
        }
        self.due
    }

    fn work(&mut self, now: Instant, image: &mut Image, open: OpenPins<'_>) -> Result<(), String> {
        if self.pins.is_none() {
            if now < self.due {
                return Ok(());
            }
            let pins = open(&self.config)?;
            self.pins = Some(pins);
            // A chip is opened with its outputs off.
            self.driven.fill(false);
            self.due = now;
        }
        let Some(pins) = &mut self.pins else { return Ok(()) };
        let wanted =
            |line: &GpioLine| image.driven && image.outputs.get(line.at).is_some_and(|b| b >> line.bit & 1 == 1);
        if self.config.outputs.iter().map(wanted).ne(self.driven.iter().copied()) {
            let wanted: Vec<bool> = self.config.outputs.iter().map(wanted).collect();
            pins.write(&wanted)?;
            self.driven = wanted;
        }
        if now < self.due {
            return Ok(());
        }
        pins.read(&mut self.levels)?;
        for (line, level) in self.config.inputs.iter().zip(&self.levels) {
            if let Some(byte) = image.inputs.get_mut(line.at) {
                *byte = *byte & !(1 << line.bit) | u8::from(*level) << line.bit;
            }
        }
        self.due = now + self.config.period;
        image.tell(self.index, |status| {
            status.exchanges += 1;
            status.state = State::Running;
        });
        Ok(())
    }

    /// Whether no output is on, or none can be driven.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.pins.is_none() || self.driven.iter().all(|on| !on)
    }

    /// Why the chip cannot be used; returned once.
    pub fn take_why(&mut self) -> Option<String> {
        self.why.take()
    }
}
