//! A bus of meters as the device on a station's line: [`crate::meters`] with the time they take, and a short circuit.

use ob1_cpu::Nanos;

use super::MS;
use super::device::Device;
use crate::meters::Bus;

/// A meter thinks so long before it answers: 11 to 330 bit times and 50 ms are permitted; this is enough for 11 bits at
/// 300 baud.
const THINKS: Nanos = 40 * MS;

/// The meters on their bus.
#[derive(Debug)]
pub struct Meters {
    /// The meters.
    pub bus: Bus,
    /// While it is true the bus is short-circuited: nothing gets through, and the converter reports a break at each
    /// frame.
    pub shorted: bool,
    answer: Option<(Nanos, Vec<u8>)>,
}

impl Meters {
    /// These, on a sound bus.
    #[must_use]
    pub fn new(bus: Bus) -> Self {
        Self { bus, shorted: false, answer: None }
    }
}

impl Device for Meters {
    fn hear(&mut self, now: Nanos, bytes: &[u8], out: &mut Vec<u8>) -> Option<Nanos> {
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
