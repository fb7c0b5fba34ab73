//! The lines of a GPIO chip, by the character device of the kernel.

use gpiocdev::Request;
use gpiocdev::line::{Bias as LineBias, Drive as LineDrive, Value, Values};
use ob1_coupler::gpio::{Bias, Drive, GpioConfig, GpioMaster, Pins};
use ob1_coupler::{Image, LineConfig};
use ob1_line::Instant;
use tracing::{info, warn};

/// The consumer name of the lines as shown by `gpioinfo`.
const CONSUMER: &str = "ob1";

/// A chip and its master.
pub(crate) struct Gpio {
    name: String,
    pub(crate) master: GpioMaster,
    pub(crate) deadline: Instant,
}

impl Gpio {
    pub(crate) fn new(config: &LineConfig, first: usize) -> Option<Self> {
        let gpio = config.gpio.as_ref()?;
        Some(Self { name: gpio.name.clone(), master: GpioMaster::new(gpio, first), deadline: Instant::START })
    }

    pub(crate) fn step(&mut self, now: Instant, image: &mut Image) {
        self.deadline = self.master.step(now, image, &mut |config| {
            let chip = Chip::open(config).map_err(|error| format!("{}: {error}", config.chip))?;
            info!(chip = config.chip, "the chip is open");
            Ok(Box::new(chip))
        });
        if let Some(why) = self.master.take_why() {
            warn!(coupler = self.name, "{why}");
        }
    }
}

struct Chip {
    request: Request,
    inputs: Vec<u32>,
    outputs: Vec<u32>,
}

impl Chip {
    fn open(config: &GpioConfig) -> gpiocdev::Result<Self> {
        let mut builder = Request::builder();
        builder.on_chip(&config.chip).with_consumer(CONSUMER);
        for line in &config.inputs {
            builder.with_line(line.line).as_input();
            match line.bias {
                Bias::AsIs => {}
                Bias::PullUp => drop(builder.with_bias(LineBias::PullUp)),
                Bias::PullDown => drop(builder.with_bias(LineBias::PullDown)),
                Bias::Disabled => drop(builder.with_bias(LineBias::Disabled)),
            }
            if !line.debounce.is_zero() {
                builder.with_debounce_period(line.debounce.into());
            }
            if line.active_low {
                builder.as_active_low();
            }
        }
        for line in &config.outputs {
            builder.with_line(line.line).as_output(Value::Inactive).with_drive(match line.drive {
                Drive::PushPull => LineDrive::PushPull,
                Drive::OpenDrain => LineDrive::OpenDrain,
                Drive::OpenSource => LineDrive::OpenSource,
            });
            if line.active_low {
                builder.as_active_low();
            }
        }
        let numbers = |lines: &[ob1_coupler::gpio::GpioLine]| lines.iter().map(|line| line.line).collect();
        Ok(Self { request: builder.request()?, inputs: numbers(&config.inputs), outputs: numbers(&config.outputs) })
    }
}

impl Pins for Chip {
    fn read(&mut self, inputs: &mut [bool]) -> Result<(), String> {
        if self.inputs.is_empty() {
            return Ok(());
        }
        let mut values = Values::from_offsets(&self.inputs);
        self.request.values(&mut values).map_err(|error| error.to_string())?;
        for (place, line) in inputs.iter_mut().zip(&self.inputs) {
            *place = values.get(*line) == Some(Value::Active);
        }
        Ok(())
    }

    fn write(&mut self, outputs: &[bool]) -> Result<(), String> {
        let mut values = Values::default();
        for (line, on) in self.outputs.iter().zip(outputs) {
            values.set(*line, Value::from(*on));
        }
        self.request.set_values(&values).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chip_that_is_not_there_is_an_error_in_words() {
        let config = GpioConfig { chip: "/dev/gpiochip-of-nobody".into(), ..GpioConfig::default() };
        assert!(Chip::open(&config).is_err());
    }
}
