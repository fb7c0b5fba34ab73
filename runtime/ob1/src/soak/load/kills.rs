//! When a driver is killed, and which: drawn from the seed.

use fastrand::Rng;

use super::Load;

/// Moments of driver kills and whom they meet, from a seed: half to one and a half of the mean apart.
#[derive(Debug)]
pub(in super::super) struct Kills {
    random: Rng,
    mean_ns: u64,
    next_ns: u64,
}

impl Kills {
    /// The plan of the kills; `None`: the load has none.
    pub(in super::super) fn new(load: &Load, seed: u64) -> Option<Self> {
        let mean_ns = 60_000_000_000u64.checked_div(load.kills)?;
        let mut kills = Self { random: Rng::with_seed(!seed), mean_ns, next_ns: 0 };
        kills.plan();
        Some(kills)
    }

    fn plan(&mut self) {
        self.next_ns += self.mean_ns / 2 + self.random.u64(..self.mean_ns);
    }

    /// Which of so many drivers is due.
    pub(in super::super) fn due(&mut self, now_ns: u64, drivers: usize) -> Option<usize> {
        if now_ns < self.next_ns || drivers == 0 {
            return None;
        }
        while self.next_ns <= now_ns {
            self.plan();
        }
        Some(self.random.u64(..drivers as u64) as usize)
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
