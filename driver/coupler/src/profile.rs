//! The watchdog settings of couplers of known makes: Modbus has no common watchdog.

use crate::config::{Proof, Setup, Span, Table};

/// 100 ms: the unit of WAGO's watchdog.
const WAGO_UNIT: Span = Span::from_millis(100);
/// 1 ms: the unit of Beckhoff's watchdog.
const BECKHOFF_UNIT: Span = Span::MILLISECOND;

/// A make of coupler whose watchdog is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// WAGO 750-3xx, 750-8xx (not PFC 200, whose registers differ).
    Wago750,
    /// Beckhoff BK7300, BK9000, BK9050, BK9100.
    BeckhoffBk,
    /// Moxa ioLogik E1200: its watchdog is set on its own web page; over Modbus it can only be reset.
    MoxaIoLogik,
}

impl Profile {
    /// By the word of a station file.
    pub const ALL: [(&'static str, Self); 3] =
        [("wago-750", Self::Wago750), ("beckhoff-bk", Self::BeckhoffBk), ("moxa-iologik", Self::MoxaIoLogik)];

    /// The watchdog times that can be set; `None`: none over Modbus.
    pub const fn times(self) -> Option<std::ops::RangeInclusive<Span>> {
        match self {
            Self::Wago750 => Some(WAGO_UNIT..=WAGO_UNIT.times(0xFFFF)),
            Self::BeckhoffBk => Some(BECKHOFF_UNIT..=BECKHOFF_UNIT.times(0xFFFF)),
            Self::MoxaIoLogik => None,
        }
    }

    /// The writes that reset a coupler whose watchdog has expired. Harmless if it has not.
    pub fn reset(self) -> Vec<Setup> {
        match self {
            // 1008h: "simply stop", which clears a fault and lets the other registers be written.
            Self::Wago750 => vec![word(0x1008, 0x55AA)],
            // 1121h: the two words one after the other.
            Self::BeckhoffBk => vec![word(0x1121, 0xBECF), word(0x1121, 0xAFFE)],
            // The alarm flag.
            Self::MoxaIoLogik => vec![Setup { table: Table::Coil, at: 4144, value: 1 }],
        }
    }

    /// The writes that set the watchdog, after [`Self::reset`], because a running one cannot be changed. Times are
    /// rounded up to the coupler's unit.
    pub fn watchdog(self, time: Span) -> Vec<Setup> {
        match self {
            // 1000h the time, 100Ah the alternative watchdog: every telegram triggers it, and it starts with the next.
            Self::Wago750 => vec![word(0x1000, units(time, WAGO_UNIT)), word(0x100A, 1)],
            // 1120h the time, 1122h the trigger: 0, writing telegrams.
            Self::BeckhoffBk => vec![word(0x1120, units(time, BECKHOFF_UNIT)), word(0x1122, 0)],
            Self::MoxaIoLogik => Vec::new(),
        }
    }

    /// The proof that a watchdog with this time runs; `skips` of the set-up writes are those that set it.
    pub fn proof(self, time: Span, skips: usize) -> Option<Proof> {
        match self {
            // 1000h the time, 1006h its state: 1, it runs.
            Self::Wago750 => {
                Some(Proof { first: 0x1000, count: 7, expected: vec![(0, units(time, WAGO_UNIT)), (6, 1)], skips })
            }
            Self::BeckhoffBk | Self::MoxaIoLogik => None,
        }
    }
}

fn units(time: Span, unit: Span) -> u16 {
    time.div_ceil(unit).clamp(1, 0xFFFF) as u16
}

const fn word(at: u16, value: u16) -> Setup {
    Setup { table: Table::Holding, at, value }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(profile: Profile, time: Span) -> Vec<(u16, u16)> {
        profile.reset().into_iter().chain(profile.watchdog(time)).map(|setup| (setup.at, setup.value)).collect()
    }

    #[test]
    fn a_watchdog_is_stopped_before_it_is_set() {
        assert_eq!(told(Profile::Wago750, Span::from_nanos(250_000_000)), [(0x1008, 0x55AA), (0x1000, 3), (0x100A, 1)]);
        let beckhoff = [(0x1121, 0xBECF), (0x1121, 0xAFFE), (0x1120, 250), (0x1122, 0)];
        assert_eq!(told(Profile::BeckhoffBk, Span::from_nanos(250_000_000)), beckhoff);
        assert_eq!(told(Profile::MoxaIoLogik, Span::from_nanos(250_000_000)), [(4144, 1)]);
    }
}
