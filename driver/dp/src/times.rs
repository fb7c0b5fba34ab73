//! Bits to nanoseconds, and the clock of the stack.

use ob1_coupler::config::{Instant, Span};
use profirust::{Baudrate, time};

/// The stack counts microseconds.
pub(crate) const MICRO: Span = Span::MICROSECOND;

/// The stack's value for a baud rate; `None`: PROFIBUS or serial lines do not have it.
pub const fn baud_rate(baud: u32) -> Option<Baudrate> {
    Some(match baud {
        9600 => Baudrate::B9600,
        19_200 => Baudrate::B19200,
        31_250 => Baudrate::B31250,
        45_450 => Baudrate::B45450,
        93_750 => Baudrate::B93750,
        187_500 => Baudrate::B187500,
        500_000 => Baudrate::B500000,
        1_500_000 => Baudrate::B1500000,
        _ => return None,
    })
}

/// The time of `bits` bits at a baud rate, rounded up.
pub(crate) const fn bits(bits: u32, baud: u32) -> Span {
    let baud = if baud == 0 { 1 } else { baud as u64 };
    Span::from_nanos((bits as u64 * Span::SECOND.nanos()).div_ceil(baud))
}

/// The stack's clock. Its count is a little early, never late: a pause that it waits for has really passed.
pub(crate) fn instant(now: Instant) -> time::Instant {
    time::Instant::from_micros(now.since_start().micros() as i64)
}
