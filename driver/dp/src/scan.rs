//! The stations on a line: a master that asks every address for its diagnosis, and nothing else. Slaves are not
//! affected: their data exchange with another master continues.

use ob1_coupler::MasterInput;
use ob1_coupler::config::Instant;
use ob1_coupler::dp::DpConfig;
use profirust::dp::scan::{DpScanEvent, DpScanner};

use crate::stack::{NoMaster, Stack};

/// A slave that answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// Address of the slave on the line.
    pub station: u8,
    /// Ident number that it reports in its diagnosis.
    pub ident: u16,
    /// Address of the master that has parametrised it; `None`: it has none.
    pub master: Option<u8>,
}

/// A scan of a line.
pub struct Scan {
    stack: Stack,
    scanner: DpScanner,
    found: Vec<Found>,
}

impl Scan {
    /// A scan with the parameters of a bus; its slaves do not matter.
    ///
    /// # Errors
    /// Bus parameters that the stack does not accept, in words.
    pub fn new(config: &DpConfig, now: Instant) -> Result<Self, NoMaster> {
        Ok(Self { stack: Stack::new(config, now)?, scanner: DpScanner::new(), found: Vec::new() })
    }

    /// Takes an event; `out` gets the bytes to send. Returns when to call again at the latest.
    pub fn step(&mut self, now: Instant, input: MasterInput<'_>, out: &mut Vec<u8>) -> Instant {
        let Self { stack, scanner, found } = self;
        stack.step(now, input, out, scanner, |scanner, _| {
            let described = match scanner.take_last_event() {
                Some(DpScanEvent::PeripheralFound(slave) | DpScanEvent::PeripheralRequery(slave)) => slave,
                Some(DpScanEvent::PeripheralLost(station)) => {
                    found.retain(|known| known.station != station);
                    return;
                }
                None => return,
            };
            let slave = Found { station: described.address, ident: described.ident, master: described.master_address };
            found.retain(|known| known.station != slave.station);
            found.push(slave);
            found.sort_by_key(|known| known.station);
        })
    }

    /// The slaves that have answered so far, by address.
    pub fn found(&self) -> &[Found] {
        &self.found
    }

    /// Telegrams sent: a round of the line needs one for each address, and one for each token.
    pub const fn sent(&self) -> u64 {
        self.stack.wires.sent()
    }
}
