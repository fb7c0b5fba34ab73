//! Where looks come from: the station's socket, and the taps of its CPs.

use std::collections::BTreeMap;

use super::data::Look;
use super::watch::Watched;
use crate::status;
use crate::trace::{Printer, Taps};
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::pass::PassWanted;
use ob1_station::access::protocol::{CellValue, Op, Response};

/// Entries of each diagnostic buffer that are shown.
const DIAGNOSTICS: u32 = 100;
/// How long a pass through a block is waited for.
const PASS_MS: u64 = 300;

/// A running station that is watched.
pub(super) struct Source {
    name: String,
    client: Client,
    taps: Option<Taps>,
    printer: Printer,
}

impl Source {
    pub(super) fn open(station: &str) -> Result<Self, AccessError> {
        Ok(Self {
            name: station.to_owned(),
            client: Client::to_station(station)?,
            taps: None,
            printer: Printer::new(false),
        })
    }

    /// One round of questions.
    pub(super) fn look(&mut self, watch: &[Watched]) -> Result<Look, AccessError> {
        let nothing = || AccessError::Refused("the answer does not contain what was asked for".into());
        let status = self.client.ask(Op::Status)?.status.ok_or_else(nothing)?;
        let timing = *self.client.ask(Op::Timing { histograms: true })?.timing.ok_or_else(nothing)?;
        let buses = self.client.ask(Op::Buses)?.buses.unwrap_or_default();
        let buffers = self.client.ask(Op::Diag { count: DIAGNOSTICS })?;
        let links = self.client.ask(Op::Links)?.links.unwrap_or_default();
        let mut values = Vec::with_capacity(watch.len());
        for watched in watch {
            values.push((watched.clone(), self.value(&watched.name)?));
        }
        let (diagnostics, cp_buffers) = (buffers.diagnostics.unwrap_or_default(), buffers.cps.unwrap_or_default());
        Ok(Look { status, timing, diagnostics, cp_buffers, buses, links, values })
    }

    /// One by one, so that a name that is wrong does not hide the others.
    fn value(&mut self, name: &str) -> Result<Result<CellValue, String>, AccessError> {
        match self.client.ask(Op::Get { items: vec![name.to_owned()] }) {
            Ok(Response { values, .. }) => {
                Ok(values.and_then(|mut all| all.pop()).ok_or_else(|| "no answer".to_owned()))
            }
            Err(AccessError::Refused(why)) => Ok(Err(why)),
            Err(error) => Err(error),
        }
    }

    /// Writes a cell; the answer is the station's refusal.
    pub(super) fn write(&mut self, cell: &str, value: &str) -> Result<(), AccessError> {
        let items = BTreeMap::from([(cell.to_owned(), value.into())]);
        self.client.ask(Op::Set { items }).map(drop)
    }

    /// One pass through a block as text, or why there is none.
    pub(super) fn program(&mut self, block: &str) -> Result<String, AccessError> {
        match status::ask(
            &mut self.client,
            PassWanted { block: block.to_owned(), wait_ms: PASS_MS, ..PassWanted::default() },
        ) {
            Ok(pass) if pass.outcome == "not called" => Ok(format!("{} is not called", pass.block)),
            Ok(pass) => Ok(status::text(&pass)),
            Err(AccessError::Refused(why)) => Ok(why),
            Err(error) => Err(error),
        }
    }

    /// What has gone over the lines since the last time. A driver that was killed takes its tap with it: the next one
    /// is connected to.
    pub(super) fn telegrams(&mut self) -> String {
        if self.taps.as_ref().is_none_or(Taps::has_lost_one) {
            self.taps = Taps::open(&self.name, None, false).ok();
        }
        if let Some(taps) = &mut self.taps {
            let printer = &mut self.printer;
            // What cannot be read is a tap that has ended: it is opened again.
            let _ = taps.take(&mut |news| {
                printer.hear(&news);
                Ok(())
            });
        }
        self.printer.text()
    }
}
