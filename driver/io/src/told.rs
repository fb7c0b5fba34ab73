//! What becomes of the couplers, in words, for the log: once for each change.

use ob1_coupler::config::exception_text;
use ob1_coupler::{BusConfig, Image, Refusal, State, Status};
use tracing::{info, warn};

pub(crate) struct Told {
    names: Vec<String>,
    known: Vec<Status>,
}

impl Told {
    pub(crate) fn new(config: &BusConfig) -> Self {
        let names: Vec<String> = config.couplers().map(|coupler| coupler.name.clone()).collect();
        let known = vec![Status::default(); names.len()];
        Self { names, known }
    }

    pub(crate) fn look(&mut self, image: &Image) {
        for ((name, known), status) in self.names.iter().zip(&mut self.known).zip(&image.status) {
            if known.state != status.state {
                match status.state {
                    State::Starting => {}
                    State::Running => info!(coupler = name, "exchange"),
                    State::Lost => warn!(coupler = name, failures = status.failures, "does not answer: lost"),
                    State::Refused => warn!(coupler = name, "refuses what it is written on connect: not driven"),
                }
            }
            match status.refusal {
                Some(refusal) if known.refusal != status.refusal => warn!(coupler = name, "{}", in_words(&refusal)),
                None if known.refusal.is_some() => info!(coupler = name, "refuses nothing any more"),
                _ => {}
            }
            *known = *status;
        }
    }
}

fn in_words(refusal: &Refusal) -> String {
    let Refusal { function, exception, table, first } = *refusal;
    let text = exception_text(exception);
    format!("refuses function {function:02X}h at {}:{first}: exception {exception:02X}h, {text}", table.name())
}
