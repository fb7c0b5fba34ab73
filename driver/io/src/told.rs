//! What becomes of the couplers and slaves, in words, for the log: once for each change.

use std::collections::BTreeMap;

use ob1_coupler::config::exception_text;
use ob1_coupler::dp::{Block, Diagnosis, DpSlave, kept_diagnosis};
use ob1_coupler::{BusConfig, Image, Refusal, State, Status};
use tracing::{info, warn};

struct Known {
    name: String,
    status: Status,
    /// Of a DP slave.
    slave: Option<Slave>,
}

struct Slave {
    diagnosis: (usize, usize),
    texts: BTreeMap<u32, String>,
    faulty: bool,
}

pub(crate) struct Told(Vec<Known>);

impl Told {
    pub(crate) fn new(config: &BusConfig) -> Self {
        let slaves = config.lines.iter().flat_map(|line| {
            let of_dp = line.dp.iter().flat_map(|dp| &dp.slaves).map(|slave| Some(Slave::new(slave)));
            line.couplers.iter().map(|_| None).chain(of_dp)
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
                        warn!(coupler = name, "refuses what it is written on connect: not driven");
                    }
                    (State::Refused, Some(slave)) => {
                        warn!(coupler = name, "refuses what it is told, not driven: {}", slave.words(image));
                    }
                }
            }
            match status.refusal {
                Some(refusal) if known.status.refusal != status.refusal => {
                    warn!(coupler = name, "{}", in_words(&refusal));
                }
                None if known.status.refusal.is_some() => info!(coupler = name, "refuses nothing any more"),
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
    fn new(slave: &DpSlave) -> Self {
        Self { diagnosis: slave.diagnosis, texts: slave.texts.clone(), faulty: false }
    }

    fn bytes<'a>(&self, image: &'a Image) -> &'a [u8] {
        let (at, room) = self.diagnosis;
        image.inputs.get(at..at + DpSlave::diagnosis_area(room)).map(kept_diagnosis).unwrap_or_default()
    }

    /// Everything its diagnosis says, with the texts of its GSD file.
    fn words(&self, image: &Image) -> String {
        let Some(diagnosis) = Diagnosis::new(self.bytes(image)) else { return "it says nothing".into() };
        let mut text = diagnosis.to_string();
        for block in diagnosis.blocks() {
            if let Block::Device(data) = block {
                let bits = (0_u32..).zip(data.iter().flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1 == 1)));
                for (_, what) in bits.filter_map(|(n, on)| on.then(|| self.texts.get_key_value(&n)).flatten()) {
                    text.push_str(", ");
                    text.push_str(what);
                }
            }
        }
        text
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

fn in_words(refusal: &Refusal) -> String {
    let Refusal { function, exception, table, first } = *refusal;
    let text = exception_text(exception);
    format!("refuses function {function:02X}h at {}:{first}: exception {exception:02X}h, {text}", table.name())
}
