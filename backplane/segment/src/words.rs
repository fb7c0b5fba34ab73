//! State words of the segment: what they mean, and that anything else is a fault.

pub use ob1_words::{Leds, Reason, Why};

use crate::fault::Fault;

/// State of the driver process, as it says itself; `Absent` is set by the runtime when it has seen the driver's end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriverState {
    /// No driver is attached.
    #[default]
    Absent,
    /// Attached, not ready yet.
    Starting,
    /// No parameters have arrived yet.
    NoParameters,
    /// The parameters are refused; the code is the driver's reason.
    ParameterError(u32),
    /// The parameters are accepted and the line is open.
    Ready,
    /// The line cannot be opened or is gone; the code is the operating system's error number.
    LineError(u32),
}

impl DriverState {
    pub(crate) fn to_word(self) -> u64 {
        let (state, code) = match self {
            Self::Absent => (0, 0),
            Self::Starting => (1, 0),
            Self::NoParameters => (2, 0),
            Self::ParameterError(code) => (3, code),
            Self::Ready => (4, 0),
            Self::LineError(code) => (5, code),
        };
        u64::from(code) << 32 | state
    }

    pub(crate) fn from_word(word: u64) -> Result<Self, Fault> {
        let code = (word >> 32) as u32;
        match word & 0xffff_ffff {
            0 => Ok(Self::Absent),
            1 => Ok(Self::Starting),
            2 => Ok(Self::NoParameters),
            3 => Ok(Self::ParameterError(code)),
            4 => Ok(Self::Ready),
            5 => Ok(Self::LineError(code)),
            _ => Err(Fault::DriverState(word)),
        }
    }
}

/// Operating state of the CPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CpuState {
    /// STOP: the outputs are 0.
    #[default]
    Stop,
    /// The start-up OB runs.
    Startup,
    /// The program runs: scan after scan.
    Run,
}

impl CpuState {
    pub(crate) fn to_word(self) -> u64 {
        match self {
            Self::Stop => 0,
            Self::Startup => 1,
            Self::Run => 2,
        }
    }

    pub(crate) fn from_word(word: u64) -> Result<Self, Fault> {
        match word {
            0 => Ok(Self::Stop),
            1 => Ok(Self::Startup),
            2 => Ok(Self::Run),
            _ => Err(Fault::CpuState(word)),
        }
    }
}

/// The word of the LEDs.
pub(crate) fn leds_to_word(leds: Leds) -> u64 {
    bits([leds.power, leds.transmit, leds.receive, leds.error])
}

/// Unknown bits mean nothing and are dropped.
pub(crate) fn leds_from_word(word: u64) -> Leds {
    let [power, transmit, receive, error] = flags(word);
    Leds { power, transmit, receive, error }
}

/// The word of a reason: why (bits 0 to 7), number (8 to 23), count (24 to 35), the CPU's time in seconds (36 to 63).
pub(crate) fn reason_to_word(reason: Reason, seconds: u64) -> u64 {
    let count = reason.count.min(Reason::COUNT_MAX);
    u64::from(reason.why as u8) | u64::from(reason.number) << 8 | u64::from(count) << 24 | seconds << 36
}

/// A reason without meaning is none: a driver may know more of them than this reader.
pub(crate) fn reason_from_word(word: u64) -> Option<(Reason, u64)> {
    let why = Why::of(word as u8)?;
    let reason = Reason { why, number: (word >> 8) as u16, count: (word >> 24) as u32 & Reason::COUNT_MAX };
    Some((reason, word >> 36))
}

/// Modem lines the CPU drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModemOutputs {
    /// The CPU drives RTS (otherwise it is the driver's own affair).
    pub drive_rts: bool,
    /// RTS, request to send; without `drive_rts` it means nothing.
    pub rts: bool,
    /// The CPU drives DTR (otherwise it is the driver's own affair).
    pub drive_dtr: bool,
    /// DTR, data terminal ready; without `drive_dtr` it means nothing.
    pub dtr: bool,
}

impl ModemOutputs {
    pub(crate) fn to_word(self) -> u64 {
        bits([self.drive_rts, self.rts, self.drive_dtr, self.dtr])
    }

    pub(crate) fn from_word(word: u64) -> Self {
        let [drive_rts, rts, drive_dtr, dtr] = flags(word);
        Self { drive_rts, rts, drive_dtr, dtr }
    }
}

/// State of the modem lines at the CP, in the bit order of the status byte of FC 8 V24_STAT (CTS is bit 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModemInputs {
    /// CTS, clear to send: the partner accepts characters.
    pub cts: bool,
    /// DSR, data set ready: the partner is switched on.
    pub dsr: bool,
    /// RI, ring indicator: a call comes in.
    pub ri: bool,
    /// DCD, data carrier detect: the modem hears the other one.
    pub cd: bool,
    /// The CP's own data terminal ready.
    pub dtr: bool,
    /// The CP's own request to send.
    pub rts: bool,
}

impl ModemInputs {
    pub(crate) fn to_word(self) -> u64 {
        bits([self.cts, self.dsr, self.ri, self.cd, self.dtr, self.rts])
    }

    pub(crate) fn from_word(word: u64) -> Self {
        let [cts, dsr, ri, cd, dtr, rts] = flags(word);
        Self { cts, dsr, ri, cd, dtr, rts }
    }
}

/// The flags as bits, the first one in bit 0.
fn bits<const N: usize>(flags: [bool; N]) -> u64 {
    flags.iter().rev().fold(0, |word, flag| word << 1 | u64::from(*flag))
}

fn flags<const N: usize>(word: u64) -> [bool; N] {
    std::array::from_fn(|bit| word >> bit & 1 == 1)
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn states_survive_the_word() {
        use DriverState::*;
        for state in [Absent, Starting, NoParameters, ParameterError(7), Ready, LineError(u32::MAX)] {
            assert_eq!(DriverState::from_word(state.to_word()), Ok(state));
        }
        for state in [CpuState::Stop, CpuState::Startup, CpuState::Run] {
            assert_eq!(CpuState::from_word(state.to_word()), Ok(state));
        }
    }

    #[test]
    fn a_word_without_meaning_is_a_fault() {
        assert_eq!(DriverState::from_word(6), Err(Fault::DriverState(6)));
        assert_eq!(DriverState::from_word(u64::MAX), Err(Fault::DriverState(u64::MAX)));
        assert_eq!(CpuState::from_word(3), Err(Fault::CpuState(3)));
        assert_eq!(CpuState::from_word(1 << 32), Err(Fault::CpuState(1 << 32)));
    }

    #[test]
    fn a_reason_has_its_bits() {
        let reason = Reason { why: Why::OrderFailed, number: 0x0708, count: 5 };
        assert_eq!(reason_to_word(reason, 3), 3 << 36 | 5 << 24 | 0x0708 << 8 | 5);
        assert_eq!(reason_from_word(reason_to_word(reason, 3)), Some((reason, 3)));
        let many = Reason { count: u32::MAX, ..reason };
        assert_eq!(reason_from_word(reason_to_word(many, 0)), Some((Reason { count: Reason::COUNT_MAX, ..many }, 0)));
        for word in [0, 10, 255, u64::MAX, 10 << 8] {
            assert_eq!(reason_from_word(word), None, "{word:#x}");
        }
    }

    #[test]
    fn lamps_and_lines_have_their_bits() {
        assert_eq!(leds_to_word(Leds { power: true, ..Leds::default() }), 1);
        assert_eq!(leds_to_word(Leds { error: true, ..Leds::default() }), 8);
        assert_eq!(ModemInputs { cts: true, rts: true, ..ModemInputs::default() }.to_word(), 0b10_0001);
        assert_eq!(ModemInputs { cd: true, ..ModemInputs::default() }.to_word(), 8);
        assert_eq!(ModemOutputs { drive_rts: true, dtr: true, ..ModemOutputs::default() }.to_word(), 9);
        for word in 0..64 {
            assert_eq!(ModemInputs::from_word(word).to_word(), word);
            assert_eq!(ModemOutputs::from_word(word).to_word(), word & 15);
            assert_eq!(leds_to_word(leds_from_word(word)), word & 15);
        }
    }
}
