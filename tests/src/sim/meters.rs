//! A bus of meters as the device on a station's line: [`crate::meters`] with the time they take, and a short circuit.

use super::device::Device;
use crate::meters::Bus;
use ob1_time::{Instant, Span};

/// Delay before a meter answers: 11 to 330 bit times plus 50 ms are permitted; this is longer than 11 bits at 300 baud.
const THINKS: Span = Span::from_millis(40);

/// The meters on their bus.
#[derive(Debug)]
pub struct Meters {
    /// The meters.
    pub bus: Bus,
    /// While true the bus is short-circuited: nothing is transmitted, and the converter reports a break for each frame.
    pub shorted: bool,
    answer: Option<(Instant, Vec<u8>)>,
}

impl Meters {
    /// These meters on a bus without fault.
    #[must_use]
    pub fn new(bus: Bus) -> Self {
        Self { bus, shorted: false, answer: None }
    }
}

impl Device for Meters {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        let answer = if bytes.is_empty() { Vec::new() } else { self.bus.hear(bytes) };
        if !answer.is_empty() {
            self.answer = Some((now + THINKS, answer));
        }
        if let Some((_, answer)) = self.answer.take_if(|(at, _)| *at <= now) {
            out.extend(answer);
        }
        self.answer.as_ref().map(|(at, _)| *at)
    }

    fn is_shorted(&self) -> bool {
        self.shorted
    }
}
