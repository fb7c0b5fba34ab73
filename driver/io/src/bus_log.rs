//! State changes of the couplers and slaves, in words for the log, each once. One that changes without end is told now
//! and then, by its state at that time.

use std::time::{Duration, Instant};

use ob1_coupler::dp::{Diagnosis, DpSlave, diagnosis_words, kept_diagnosis, refusal_words};
use ob1_coupler::{BusConfig, Image, State, Status};
use ob1_process::log::{ALL, Limit};
use tracing::{info, warn};

/// Changes of a coupler that are told at once, and the time after which one more is.
const AT_ONCE: u32 = 10;
const ONE_MORE: Duration = Duration::from_secs(10);

struct Known {
    name: String,
    /// As it was told.
    status: Status,
    /// As it was seen last, and how often that has changed since it was told.
    seen: Status,
    changes: u64,
    limit: Limit,
    /// The data of a DP slave.
    slave: Option<Slave>,
}

struct Slave {
    config: DpSlave,
    /// The address of its master.
    master: u8,
    faulty: bool,
}

pub(crate) struct Told(Vec<Known>);

impl Told {
    pub(crate) fn new(config: &BusConfig) -> Self {
        let slaves = config.lines.iter().flat_map(|line| {
            let of_dp = line.dp.iter().flat_map(|dp| dp.slaves.iter().map(|slave| Some(Slave::new(slave, dp.address))));
            line.couplers.iter().map(|_| None).chain(of_dp).chain(line.gpio.iter().map(|_| None))
        });
        let known = |(name, slave): (&str, _)| Known {
            name: name.to_owned(),
            status: Status::default(),
            seen: Status::default(),
            changes: 0,
            limit: Limit::new(AT_ONCE, ONE_MORE),
            slave,
        };
        Self(config.stations().zip(slaves).map(known).collect())
    }

    pub(crate) fn look(&mut self, image: &Image, now: Instant) {
        for (known, status) in self.0.iter_mut().zip(&image.status) {
            let Some(left_out) = known.due(status, now) else { continue };
            let name = known.name.as_str();
            if left_out > 0 {
                warn!(target: ALL, coupler = name, "has changed its state {left_out} times since the last line");
            }
            if known.status.state != status.state {
                match (status.state, &known.slave) {
                    (State::Starting, _) => {}
                    (State::Running, _) => info!(target: ALL, coupler = name, "exchange"),
                    (State::Lost, _) => {
                        warn!(target: ALL, coupler = name, failures = status.failures, "does not answer: lost");
                    }
                    (State::Refused, None) => {
                        warn!(target: ALL, coupler = name, "refuses a set-up request: its outputs are not driven");
                    }
                    (State::Refused, Some(slave)) => {
                        warn!(
                            target: ALL,
                            coupler = name,
                            "refuses to exchange data, its outputs are not driven: {}",
                            slave.refusal(image)
                        );
                    }
                }
            }
            match status.refusal {
                Some(refusal) if known.status.refusal != status.refusal => {
                    warn!(target: ALL, coupler = name, "{refusal}");
                }
                None if known.status.refusal.is_some() => {
                    info!(target: ALL, coupler = name, "accepts all requests again");
                }
                _ => {}
            }
            if let Some(slave) = known.slave.as_mut().filter(|_| known.status.diagnosis != status.diagnosis) {
                slave.look(name, image);
            }
            known.status = *status;
        }
    }
}

impl Known {
    /// Whether its state is to be told now, and how many changes before it were not.
    fn due(&mut self, status: &Status, now: Instant) -> Option<u64> {
        let differ = |a: &Status, b: &Status| (a.state, a.refusal, a.diagnosis) != (b.state, b.refusal, b.diagnosis);
        if differ(&self.seen, status) {
            self.seen = *status;
            self.changes += 1;
        }
        (differ(&self.status, status) && self.limit.take(now))
            .then(|| std::mem::take(&mut self.changes).saturating_sub(1))
    }
}

impl Slave {
    fn new(slave: &DpSlave, master: u8) -> Self {
        Self { config: slave.clone(), master, faulty: false }
    }

    fn bytes<'a>(&self, image: &'a Image) -> &'a [u8] {
        let (at, room) = self.config.diagnosis;
        image.inputs.get(at..at + DpSlave::diagnosis_area(room)).map(kept_diagnosis).unwrap_or_default()
    }

    /// Its whole diagnosis, with the texts of its GSD file.
    fn words(&self, image: &Image) -> String {
        diagnosis_words(self.bytes(image), &self.config)
    }

    /// Why it refuses, and the remedy.
    fn refusal(&self, image: &Image) -> String {
        refusal_words(self.bytes(image), &self.config, self.master)
    }

    fn look(&mut self, name: &str, image: &Image) {
        let faulty = Diagnosis::new(self.bytes(image)).is_some_and(Diagnosis::has_faults);
        let was = std::mem::replace(&mut self.faulty, faulty);
        if faulty {
            warn!(target: ALL, slave = name, "reports: {}", self.words(image));
        } else if was {
            info!(target: ALL, slave = name, "reports no fault any more");
        }
    }
}

#[cfg(test)]
mod tests {
    use ob1_coupler::{Refusal, Table};

    use super::*;

    /// A coupler answers each request with another exception; a burst at the start of a bus is told whole, and what it
    /// is at the end is told too.
    #[test]
    fn a_coupler_that_changes_without_end_is_told_now_and_then() {
        let begin = Instant::now();
        let status = Status::default();
        let (limit, name) = (Limit::new(AT_ONCE, ONE_MORE), String::new());
        let mut known = Known { name, status, seen: status, changes: 0, limit, slave: None };
        let refuses = |exception: u8| Status {
            refusal: Some(Refusal { function: 3, exception, table: Table::Input, first: 0 }),
            ..status
        };
        let (mut lines, mut changes) = (0, 0);
        for ms in 0..60_000 {
            let now = refuses((ms % 7) as u8);
            if let Some(left_out) = known.due(&now, begin + Duration::from_millis(ms)) {
                (lines, changes) = (lines + 1, changes + 1 + left_out);
                known.status = now;
            }
        }
        assert!((10..=16).contains(&lines), "{lines}");
        assert!((50_000..=60_000).contains(&changes), "{changes}");
        let last = refuses(99);
        let late = begin + Duration::from_secs(61);
        assert!((0..20).any(|s| known.due(&last, late + Duration::from_secs(s)).is_some()), "its state at the end");
    }
}
