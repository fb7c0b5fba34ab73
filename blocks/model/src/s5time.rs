//! S5TIME: a three-digit BCD value and a time base, and the five kinds of S5 timers.

use crate::bcd::{from_bcd, to_bcd};

named! {
    /// The five S5 timers, by their German mnemonics.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[repr(u8)]
    pub enum TimerKind {
        /// `SP` in the international set: pulse.
        Pulse = "SI",
        /// `SE` in the international set: extended pulse.
        ExtendedPulse = "SV",
        /// `SD` in the international set: on-delay.
        OnDelay = "SE",
        /// Retentive on-delay.
        RetentiveOnDelay = "SS",
        /// `SF` in the international set: off-delay.
        OffDelay = "SA",
    }
}

impl TimerKind {
    /// The kind of a repr value, as it comes over the plugin interface.
    pub fn from_repr(value: u8) -> Option<Self> {
        Self::ALL.get(usize::from(value)).copied()
    }
}

/// An S5TIME word: bits 12-13 the base (10 ms, 100 ms, 1 s, 10 s), bits 0-11 three BCD digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct S5Time(pub u16);

const BASE_MS: [u32; 4] = [10, 100, 1_000, 10_000];

impl S5Time {
    /// The longest time, 2 h 46 min 30 s.
    pub const MAX_MS: u32 = 9_990_000;

    /// The S5TIME nearest below `ms` with the finest base that holds it, as STEP 7 rounds `S5T#` constants.
    /// `None` above 2h46m30s.
    pub fn from_ms(ms: u32) -> Option<Self> {
        // The coarsest base would take up to ten seconds more, rounded down.
        if ms > Self::MAX_MS {
            return None;
        }
        let (code, base) = (0u16..).zip(BASE_MS).find(|(_, base)| ms / base <= 999)?;
        Some(Self(code << 12 | to_bcd(ms / base) as u16))
    }

    /// The time in milliseconds; `None` when a digit is no BCD digit.
    pub fn to_ms(self) -> Option<u32> {
        Some(self.digits()? * self.base_ms())
    }

    /// The time base in milliseconds.
    pub const fn base_ms(self) -> u32 {
        BASE_MS[(self.0 >> 12 & 3) as usize]
    }

    /// The three BCD digits as a number; `None` when a digit is no BCD digit.
    pub const fn digits(self) -> Option<u32> {
        from_bcd(self.0 as u32 & 0x0FFF)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_of_the_reference() {
        for (ms, word) in [(0, 0x0000), (10, 0x0001), (100, 0x0010), (9_990, 0x0999), (10_000, 0x1100), (2_000, 0x0200)]
        {
            assert_eq!(S5Time::from_ms(ms), Some(S5Time(word)), "{ms} ms");
        }
        assert_eq!(S5Time::from_ms(S5Time::MAX_MS), Some(S5Time(0x3999)));
        assert_eq!([1, 9_999, 10_000].map(|above| S5Time::from_ms(S5Time::MAX_MS + above)), [None; 3]);
    }

    #[test]
    fn words_go_back_to_times() {
        assert_eq!(S5Time(0x2127).to_ms(), Some(127_000));
        assert_eq!(S5Time(0x00A0).to_ms(), None);
    }
}
