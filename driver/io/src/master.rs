//! The master of a line with any protocol.

use ob1_coupler::{Image, LineConfig, LineMaster, MasterInput};
use ob1_line::Instant;

/// The master of a line.
pub enum Master {
    /// Master of Modbus couplers.
    Modbus(Box<LineMaster>),
    /// Master of DP slaves.
    Dp(Box<ob1_dp::Master>),
}

impl Master {
    /// The master of a line whose couplers or slaves begin at `first` in the image's list.
    ///
    /// # Errors
    /// Impossible bus parameters, in words.
    pub fn new(config: &LineConfig, first: usize, input_bytes: usize, now: Instant) -> Result<Self, String> {
        Ok(match &config.dp {
            Some(dp) => Self::Dp(Box::new(ob1_dp::Master::new(dp, first, now).map_err(|why| why.0)?)),
            None => Self::Modbus(Box::new(LineMaster::new(config, first, input_bytes, now))),
        })
    }

    /// Takes an event; returns when to call again at the latest.
    pub fn step(&mut self, now: Instant, input: MasterInput<'_>, image: &mut Image, out: &mut Vec<u8>) -> Instant {
        match self {
            Self::Modbus(master) => master.step(now, input, image, out),
            Self::Dp(master) => master.step(now, input, image, out),
        }
    }

    /// Whether the connection must be reopened. Reported once.
    pub fn wants_reconnect(&mut self) -> bool {
        match self {
            Self::Modbus(master) => master.wants_reconnect(),
            Self::Dp(_) => false,
        }
    }

    /// Whether every reachable station has the current outputs.
    pub fn has_told_outputs(&self, image: &Image) -> bool {
        match self {
            Self::Modbus(master) => master.has_told_outputs(image),
            Self::Dp(master) => master.has_told_outputs(image),
        }
    }
}
