//! When a driver is killed, and which: drawn from the seed.

use super::Load;

/// Moments of driver kills and whom they meet, from a seed: half to one and a half of the mean apart.
#[derive(Debug)]
pub(in super::super) struct Kills {
    random: Random,
    mean_ns: u64,
    next_ns: u64,
}

impl Kills {
    /// None without kills.
    pub(in super::super) fn new(load: &Load, seed: u64) -> Option<Self> {
        let mean_ns = 60_000_000_000u64.checked_div(load.kills)?;
        let mut kills = Self { random: Random::new(!seed), mean_ns, next_ns: 0 };
        kills.plan();
        Some(kills)
    }

    fn plan(&mut self) {
        self.next_ns += self.mean_ns / 2 + self.random.below(self.mean_ns);
    }

    /// Which of so many drivers is due.
    pub(in super::super) fn due(&mut self, now_ns: u64, drivers: usize) -> Option<usize> {
        if now_ns < self.next_ns || drivers == 0 {
            return None;
        }
        while self.next_ns <= now_ns {
            self.plan();
        }
        Some(self.random.below(drivers as u64) as usize)
    }
}

/// SplitMix64.
#[derive(Debug)]
pub(super) struct Random(u64);

impl Random {
    pub(super) const fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(super) const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Less than `end`, which is not 0.
    pub(super) const fn below(&mut self, end: u64) -> u64 {
        ((self.next() as u128 * end as u128) >> 64) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kills_come_by_the_seed() {
        let load: Load = "driver-kill=60/min".parse().expect("right");
        let moments = |seed| {
            let mut kills = Kills::new(&load, seed).expect("kills");
            (0..600_000u64).filter_map(|ms| Some((ms, kills.due(ms * 1_000_000, 2)?))).collect::<Vec<_>>()
        };
        let kills = moments(1);
        assert_eq!(kills, moments(1));
        assert_ne!(kills, moments(2));
        assert!((540..=660).contains(&kills.len()) && kills.iter().any(|k| k.1 == 1), "{}", kills.len());
        assert!(Kills::new(&Load::default(), 1).is_none());
    }
}
