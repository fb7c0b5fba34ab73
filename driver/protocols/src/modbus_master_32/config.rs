//! The parameters of the parameter assignment tool, and how the driver converts them at its start. [S4 "3.6.1 Modbus
//! ASCII Protocol"]

use super::number;
use crate::machine::{MS, SECOND, Span};
use crate::signals::Times;

/// Transmission rates of the driver, bit/s. [S4 "Overview of Transmission Parameters"]
pub const BAUD_RATES: [u32; 9] = [300, 600, 1200, 2400, 4800, 9600, 19_200, 38_400, 76_800];

/// How long the CPU may take to fetch a reply. The driver's manual names no time [S4 L1785]; this is the time of 0409h
/// (docs/cp341-events.md).
const TRANSFER: Span = Span::from_secs(10);

/// Maximum of the times in the parameters, ms. [S4 "3.6.3 RS232 Secondary Signals"]
const SIGNAL_MS_MAX: u32 = 655_350;

pub use ob1_serial::Parity;

/// "With even or odd parity 1 stop bit is pre-defined. None parity effects two stop bits." [S4 L500]
pub(super) const fn stop_bits_of(parity: Parity) -> u8 {
    match parity {
        Parity::Even | Parity::Odd => 1,
        Parity::None => 2,
    }
}

/// Properties of the receiving line. [S4 "3.6.2 RS422/485 (X27) Interface"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// Two-wire operation: the driver switches the line from sending to receiving; faults and BREAK before and after a
    /// reply are ignored.
    pub half_duplex: bool,
    /// Line status BREAK can be recognised. Not with the presetting R(A) 0V, R(B) 5V ("High").
    pub breaks: bool,
}

impl Wiring {
    /// RS 232C, TTY, and X27 four-wire with the presetting BREAK.
    pub const FOUR_WIRE: Self = Self { half_duplex: false, breaks: true };
    /// X27 two-wire with the recommended presetting "High".
    pub const TWO_WIRE: Self = Self { half_duplex: true, breaks: false };
}

/// Times of the automatic use of the RS 232C secondary signals. [S4 "3.6.3 RS232 Secondary Signals"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signals {
    /// From the last character to RTS OFF, ms, 0 to 655350.
    pub rts_off_ms: u32,
    /// From RTS ON to the first character, ms, 0 to 655350.
    pub output_wait_ms: u32,
}

impl Default for Signals {
    fn default() -> Self {
        Self { rts_off_ms: 1000, output_wait_ms: 1000 }
    }
}

/// The parameters as assigned: unchecked, because the driver itself checks them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Bits per second, one of [`BAUD_RATES`].
    pub baud: u32,
    /// Data bits of a character: 7.
    pub data_bits: u8,
    /// 1 or 2, as the parity demands.
    pub stop_bits: u8,
    /// Parity bit of a character.
    pub parity: Parity,
    /// Character delay time, 1 to 6500 ms.
    pub character_delay_ms: u32,
    /// Response time-out, 5 to 65500 ms.
    pub response_timeout_ms: u32,
    /// Turnaround delay, ms; 0: a broadcast ends with its last character.
    pub turnaround_ms: u32,
    /// 0 normal operation, 1 interference suppression; everything else is illegal.
    pub operating_mode: u8,
    /// "With 32-Bit Registers": registers have four bytes.
    pub long_registers: bool,
    /// Two or four wires, and what an open line reads as.
    pub wiring: Wiring,
    /// Automatic use of the RS 232C secondary signals; `None`: they are neither set nor checked.
    pub signals: Option<Signals>,
    /// How late the line may hand over characters (a UART with a FIFO, a USB adapter); not a parameter of the CP.
    pub late: Span,
}

impl Parameters {
    /// Normal operation: each fault ends the reply.
    pub const NORMAL: u8 = 0;
    /// Interference suppression: faults outside of a reply are ignored.
    pub const INTERFERENCE_SUPPRESSION: u8 = 1;
}

impl Default for Parameters {
    /// The manual's defaults; it gives none for the turnaround delay: 100 ms (ours).
    fn default() -> Self {
        Self {
            baud: 9600,
            data_bits: 7,
            stop_bits: 1,
            parity: Parity::Even,
            character_delay_ms: 1000,
            response_timeout_ms: 2000,
            turnaround_ms: 100,
            operating_mode: Self::NORMAL,
            long_registers: false,
            wiring: Wiring::FOUR_WIRE,
            signals: None,
            late: Span::ZERO,
        }
    }
}

/// The machine's configuration: times in nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Config {
    pub(super) character_delay: Span,
    pub(super) response: Span,
    pub(super) turnaround: Span,
    pub(super) transfer: Span,
    /// Faults before and after a reply count. [S4 "Normal Operation"]
    pub(super) normal: bool,
    pub(super) long_registers: bool,
    pub(super) wiring: Wiring,
    pub(super) signals: Option<Times>,
}

impl Parameters {
    /// The driver's check at its start: each finding goes to `event`; `None`: the driver is not ready to run.
    pub(super) fn check(&self, mut event: impl FnMut(u16)) -> Option<Config> {
        let mut ready = true;
        let mut refuse = |number| {
            event(number);
            ready = false;
        };
        // "With Modbus ASCII 7 data bits are mandatory." [S4 L496]
        if self.data_bits != 7 {
            refuse(number::DATA_BITS);
        }
        if self.operating_mode > Self::INTERFERENCE_SUPPRESSION {
            refuse(number::OPERATING_MODE);
        }
        // The driver's own list has no number for these; the CP has one (our choice). (docs/cp341-events.md)
        let signals_fit = self.signals.is_none_or(|s| s.rts_off_ms.max(s.output_wait_ms) <= SIGNAL_MS_MAX);
        if !BAUD_RATES.contains(&self.baud) || self.stop_bits != stop_bits_of(self.parity) || !signals_fit {
            refuse(number::PARAMETERS);
        }
        // "The driver is operating with a default value of 1000 milliseconds." [S4 L1777]
        let character_delay_ms = in_range(self.character_delay_ms, 1..=6500).unwrap_or_else(|| {
            event(number::CHARACTER_DELAY_RANGE);
            1000
        });
        // "The driver is operating with a default value of 2000 milliseconds." [S4 L1779]
        let response_ms = in_range(self.response_timeout_ms, 5..=65_500).unwrap_or_else(|| {
            event(number::RESPONSE_TIMEOUT_RANGE);
            2000
        });
        // Start, 7 data, 1 parity or 2 stop: ten bits either way.
        let char_time = 10 * SECOND / u64::from(self.baud.max(1));
        ready.then(|| Config {
            // The quiet time is measured; a character counts from its end. [S4 "Character Delay Time"]
            character_delay: u64::from(character_delay_ms) * MS + char_time + self.late,
            response: u64::from(response_ms) * MS + self.late,
            turnaround: u64::from(self.turnaround_ms) * MS,
            transfer: TRANSFER,
            // Two-wire operation ignores what normal operation reports. [S4 L554]
            normal: self.operating_mode == Self::NORMAL && !self.wiring.half_duplex,
            long_registers: self.long_registers,
            wiring: self.wiring,
            signals: self.signals.map(|s| Times {
                rts_off: u64::from(s.rts_off_ms) * MS,
                output_wait: u64::from(s.output_wait_ms) * MS,
            }),
        })
    }
}

fn in_range(value: u32, range: core::ops::RangeInclusive<u32>) -> Option<u32> {
    range.contains(&value).then_some(value)
}
