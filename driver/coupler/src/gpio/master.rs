//! The master of a GPIO chip as a machine. The chip itself is passed in ([`Pins`]).

use ob1_protocols::{Instant, Span};

use super::config::{GpioConfig, GpioLine};
use crate::image::{Image, State};

/// A chip that could not be used is tried again after this time.
const AGAIN: Span = Span::SECOND;

/// The lines of an open chip. All are read, or driven, at the same time; true is active.
pub trait Pins {
    /// Reads the inputs, in the order of the configuration.
    ///
    /// # Errors
    /// The system's error: the chip is gone.
    fn read(&mut self, inputs: &mut [bool]) -> Result<(), String>;
    /// Drives all outputs, in the order of the configuration.
    ///
    /// # Errors
    /// The system's error: the chip is gone, as with [`Self::read`].
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
    pub fn is_off(&self) -> bool {
        self.pins.is_none() || self.driven.iter().all(|on| !on)
    }

    /// Why the chip cannot be used; returned once.
    pub fn take_why(&mut self) -> Option<String> {
        self.why.take()
    }
}
