//! A bus of meters as the device on a station's line: [`crate::meters`] with the time they take, and a short circuit.

use super::device::Device;
use crate::meters::Bus;
use ob1_time::{Instant, Span};

/// A meter thinks so long before it answers: 11 to 330 bit times and 50 ms are permitted; this is enough for 11 bits at
/// 300 baud.
const THINKS: Span = Span::from_millis(40);

/// The meters on their bus.
#[derive(Debug)]
pub struct Meters {
    /// The meters.
    pub bus: Bus,
    /// While it is true the bus is short-circuited: nothing gets through, and the converter reports a break at each
    /// frame.
    pub shorted: bool,
    answer: Option<(Instant, Vec<u8>)>,
}

impl Meters {
    /// These, on a sound bus.
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
