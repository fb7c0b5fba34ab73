//! The simulated line between two drivers, with a tap on each direction.

use std::collections::HashSet;

use ob1_cp::{CpType, LinePort, Refused};
use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_firmware::{CpEvent, LineInput, LineSettings};
use ob1_time::{Instant, Span};

use super::Scenario;
use super::tap::{self, Tap};

/// Maximum characters taken from the line at once.
const BURST: usize = 64;

/// A line and the records of its taps.
#[derive(Debug)]
pub struct Cable {
    /// Name of the line in the station files.
    pub name: String,
    line: SimLine,
    coalesce: Span,
    sent: [Tap; 2],
    arrived: [Tap; 2],
    /// Telegrams sent on the line.
    telegrams: HashSet<Vec<u8>>,
    /// Telegrams received with a correct check character that were not sent. A station may forward such a telegram:
    /// then it is in both sets.
    damaged: HashSet<Vec<u8>>,
    /// Number of these that arrived at each end; counted again if the acknowledgement was lost.
    undetectable: [u64; 2],
    /// The configuration of the driver at this end enables diagnostics.
    diagnostics: [bool; 2],
    /// Type of the CP at each end.
    cp_types: [CpType; 2],
    /// CP 341: the entries in its diagnostic buffer, oldest first.
    entries: [Vec<u16>; 2],
    /// The characters being sent at this end are from a dead driver: their end must not be reported to the next one.
    orphaned: [bool; 2],
}

impl Cable {
    /// A line without settings: the first parameters determine them.
    #[must_use]
    pub fn new(name: &str, seed: u64, scenario: &Scenario, faults_until: Instant) -> Self {
        let Scenario { faults, coalesce, .. } = *scenario;
        let config = SimConfig { faults, faults_until, coalesce, ..SimConfig::new(9600, 20) };
        Self {
            name: name.to_owned(),
            line: SimLine::new(config, seed),
            coalesce,
            sent: Default::default(),
            arrived: Default::default(),
            telegrams: HashSet::new(),
            damaged: HashSet::new(),
            undetectable: [0; 2],
            diagnostics: [false; 2],
            cp_types: [CpType::CP240, CpType::CP240],
            entries: Default::default(),
            orphaned: [false; 2],
        }
    }

    /// Time of the next event on the line.
    #[must_use]
    pub fn next_event(&self) -> Option<Instant> {
        self.line.next_event()
    }

    /// Number of telegrams that arrived at this end changed but with a correct check character, changed here or before
    /// a station forwarded them.
    #[must_use]
    pub fn undetectable(&self, end: End) -> u64 {
        self.undetectable[end as usize]
    }

    /// The entries of the CP 341 at `end` in its diagnostic buffer.
    #[must_use]
    pub fn entries(&self, end: End) -> &[u16] {
        &self.entries[end as usize]
    }

    /// The driver at `end` is dead. The characters it has written are still sent, as from a buffer of the kernel.
    pub fn orphan(&mut self, end: End, now: Instant) {
        self.orphaned[end as usize] = self.line.is_sending(end, now);
    }

    /// Returns the next event up to `now`; the inner `None` is an event without a receiver.
    pub fn pop<'a>(&mut self, now: Instant, buffer: &'a mut [u8; BURST]) -> Option<(End, Option<LineInput<'a>>)> {
        let (end, event) = self.line.pop(now, buffer)?;
        let input = match event {
            SimEvent::Rx(count) => {
                // From this instant the machine regards its answer as sent, before this is reported to it.
                if !self.line.is_sending(end, now) {
                    self.arrived[end as usize].answers(false);
                }
                for byte in &buffer[..count] {
                    if let Some(payload) = self.arrived[end as usize].push(now, *byte) {
                        if !self.telegrams.contains(payload) {
                            self.damaged.insert(payload.to_vec());
                        }
                        self.undetectable[end as usize] += u64::from(self.damaged.contains(payload));
                    }
                }
                LineInput::Rx(&buffer[..count])
            }
            SimEvent::Fault(fault) => {
                self.arrived[end as usize].spoil(now);
                LineInput::Fault(fault)
            }
            SimEvent::TxDone => {
                self.arrived[end as usize].answers(false);
                if std::mem::take(&mut self.orphaned[end as usize]) {
                    return Some((end, None));
                }
                LineInput::TxDone
            }
            SimEvent::Cts(_) => return Some((end, None)),
        };
        Some((end, Some(input)))
    }

    /// One end of it for a driver.
    pub fn end(&mut self, end: End) -> CableEnd<'_> {
        CableEnd { cable: self, end }
    }
}

/// A buffer for [`Cable::pop`].
#[must_use]
pub fn buffer() -> [u8; BURST] {
    [0; BURST]
}

/// One end of a cable.
#[derive(Debug)]
pub struct CableEnd<'a> {
    cable: &'a mut Cable,
    end: End,
}

impl LinePort for CableEnd<'_> {
    fn configure(&mut self, _now: Instant, json: &[u8]) -> Result<(), Refused> {
        let keys: serde_json::Value = serde_json::from_slice(json).map_err(|error| Refused(error.to_string()))?;
        self.cable.diagnostics[self.end as usize] = keys["diagnostics"] == true;
        let none = serde_json::Map::new();
        let params = keys["params"].as_object().unwrap_or(&none);
        let name = keys["module"].as_str().unwrap_or_default();
        self.cable.cp_types[self.end as usize] =
            CpType::of(name, params).ok_or_else(|| Refused(format!("module \"{name}\"")))?;
        Ok(())
    }

    fn cp_type(&self) -> CpType {
        self.cable.cp_types[self.end as usize].clone()
    }

    fn diagnostics(&self) -> bool {
        self.cable.diagnostics[self.end as usize]
    }

    fn apply(&mut self, _now: Instant, settings: &LineSettings) {
        self.cable.line.set_char_time(settings.char_time());
    }

    fn transmit(&mut self, now: Instant, bytes: &[u8]) {
        let sent = &mut self.cable.sent[self.end as usize];
        let block = if bytes == [tap::STX] { &[][..] } else { bytes };
        if block.is_empty() {
            sent.request(now);
        }
        for byte in block {
            if let Some(payload) = sent.push(now, *byte)
                && !self.cable.telegrams.contains(payload)
            {
                self.cable.telegrams.insert(payload.to_vec());
            }
        }
        let arrived = &mut self.cable.arrived[self.end as usize];
        arrived.answers(true);
        match bytes {
            [tap::NAK] => arrived.refuses(),
            [tap::DLE] => arrived.accepts(),
            _ => {}
        }
        self.cable.orphaned[self.end as usize] = false;
        self.cable.line.write(self.end, now, bytes);
    }

    fn lateness(&self) -> Span {
        self.cable.coalesce
    }

    fn trace(&mut self, _now: Instant, event: &CpEvent<'_>) {
        if let CpEvent::Entry(number) = event {
            self.cable.entries[self.end as usize].push(*number);
        }
    }

    fn take_back(&mut self, now: Instant) -> usize {
        self.cable.line.take_back(self.end, now)
    }
}
