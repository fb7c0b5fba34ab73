//! State changes of the couplers and slaves, in words for the log, each once.

use ob1_coupler::dp::{Diagnosis, DpSlave, diagnosis_words, kept_diagnosis, refusal_words};
use ob1_coupler::{BusConfig, Image, State, Status};
use tracing::{info, warn};

struct Known {
    name: String,
    status: Status,
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
        let known = |(name, slave): (&str, _)| Known { name: name.to_owned(), status: Status::default(), slave };
        Self(config.stations().zip(slaves).map(known).collect())
    }

    pub(crate) fn look(&mut self, image: &Image) {
        for (known, status) in self.0.iter_mut().zip(&image.status) {
            let name = known.name.as_str();
            if known.status.state != status.state {
                match (status.state, &known.slave) {
                    (State::Starting, _) => {}
                    (State::Running, _) => info!(coupler = name, "exchange"),
                    (State::Lost, _) => warn!(coupler = name, failures = status.failures, "does not answer: lost"),
                    (State::Refused, None) => {
                        warn!(coupler = name, "refuses a set-up request: its outputs are not driven");
                    }
                    (State::Refused, Some(slave)) => {
                        warn!(
                            coupler = name,
                            "refuses to exchange data, its outputs are not driven: {}",
                            slave.refusal(image)
                        );
                    }
                }
            }
            match status.refusal {
                Some(refusal) if known.status.refusal != status.refusal => {
                    warn!(coupler = name, "{refusal}");
                }
                None if known.status.refusal.is_some() => info!(coupler = name, "accepts all requests again"),
                _ => {}
            }
            if let Some(slave) = known.slave.as_mut().filter(|_| known.status.diagnosis != status.diagnosis) {
                slave.look(name, image);
            }
            known.status = *status;
        }
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
            warn!(slave = name, "reports: {}", self.words(image));
        } else if was {
            info!(slave = name, "reports no fault any more");
        }
    }
}
