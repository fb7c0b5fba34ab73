//! The master of a line: the stack, its slaves, and their data for the process image and the program.

use ob1_coupler::config::{Instant, Span};
use ob1_coupler::dp::{DpConfig, DpSlave, Refused};
use ob1_coupler::{Image, Input, LineFault, LineInput, MasterInput, State};
use ob1_protocols::profibus::Diagnosis;
use ob1_protocols::profibus::diagnosis::{DIAGNOSIS_BYTES, STANDARD_BYTES};
use profirust::dp::{DpMaster, Peripheral, PeripheralEvent, PeripheralHandle, PeripheralOptions};

use crate::stack::Stack;
pub use crate::stack::{NoMaster, least_slot_bits};
use crate::wires::Wires;

/// Minimum time for a slave's first answer, before it counts as lost.
const START: Span = Span::from_secs(2);
/// Exchanges after a change of the outputs until the slave certainly has it: the first may already have been in
/// progress.
const SURE: u8 = 2;

/// The master's data of a slave.
struct Known {
    config: DpSlave,
    /// Its place in the image's list.
    index: usize,
    handle: PeripheralHandle,
    /// When it last answered.
    heard: Instant,
    diagnosis: Vec<u8>,
    /// It has got its parameters since the last data exchange.
    tried: bool,
    /// Exchanges since its outputs changed.
    told: u8,
    began: Instant,
}

/// The master of one line.
pub struct Master {
    address: u8,
    stack: Stack,
    dp: DpMaster<'static>,
    slaves: Vec<Known>,
}

impl Master {
    /// The master of a line whose slaves begin at `first` in [`Image::status`].
    ///
    /// # Errors
    /// Bus parameters that the stack does not accept, in words.
    pub fn new(config: &DpConfig, first: usize, now: Instant) -> Result<Self, NoMaster> {
        let stack = Stack::new(config, now)?;
        let mut dp = DpMaster::new(Vec::new());
        let slaves = config.slaves.iter().enumerate().map(|(n, slave)| Known {
            handle: dp.add(peripheral(slave)),
            config: slave.clone(),
            index: first + n,
            heard: now,
            diagnosis: Vec::new(),
            tried: false,
            told: 0,
            began: now,
        });
        let slaves = slaves.collect();
        // The stack has no other state with data exchange: in STOP the outputs are zeros.
        dp.enter_operate();
        Ok(Self { address: config.address, stack, dp, slaves })
    }

    /// Takes an event; `out` gets the bytes to send. Returns when to call again at the latest.
    pub fn step(&mut self, now: Instant, input: MasterInput<'_>, image: &mut Image, out: &mut Vec<u8>) -> Instant {
        let back = matches!(input, Input::Line(LineInput::Fault(LineFault::Back)));
        if back {
            for known in &mut self.slaves {
                self.dp.get_mut(known.handle).reset_address(known.config.station);
            }
        }
        if back || matches!(input, Input::Line(LineInput::Fault(LineFault::Gone))) {
            self.slaves.iter_mut().for_each(|known| lose(known, image));
        }
        self.put_outputs(image);
        let Self { address, stack, dp, slaves } = self;
        let stack = stack.step(now, input, out, dp, |dp, wires| {
            let events = dp.take_last_events();
            if let Some((station, bytes)) = wires.take_diagnosis() {
                diagnosed(now, slaves, station, bytes, image);
            }
            if let Some((handle, event)) = events.peripheral
                && let Some(known) = slaves.iter_mut().find(|known| known.handle == handle)
            {
                known.event(now, *address, event, dp.get_mut(handle), image);
            }
        });
        let waits = |known: &&Known| {
            let state = image.status.get(known.index).map(|status| status.state);
            matches!(state, Some(State::Starting | State::Refused))
        };
        let missed = self.slaves.iter().filter(waits).map(Known::missed_at).fold(Instant::NEVER, Instant::min);
        if now >= missed {
            self.miss(now, image);
            return stack;
        }
        stack.min(missed)
    }

    /// Whether every slave that exchanges data has the current outputs.
    pub fn has_told_outputs(&self, image: &Image) -> bool {
        let runs = |known: &&Known| image.status.get(known.index).is_some_and(|status| status.state == State::Running);
        !self.stack.is_up || self.slaves.iter().filter(runs).all(|known| known.told >= SURE)
    }

    /// The line, for counters.
    pub const fn wires(&self) -> &Wires {
        &self.stack.wires
    }

    fn put_outputs(&mut self, image: &Image) {
        for known in &mut self.slaves {
            let (at, len) = known.config.outputs;
            let wanted = image.outputs.get(at..at + len).filter(|_| image.driven);
            let place = self.dp.get_mut(known.handle).pi_q_mut();
            let changed = match wanted {
                Some(bytes) if bytes != place => {
                    place.copy_from_slice(bytes);
                    true
                }
                None if place.iter().any(|byte| *byte != 0) => {
                    place.fill(0);
                    true
                }
                _ => false,
            };
            if changed {
                known.told = 0;
            }
        }
    }

    /// Marks slaves that have been silent for too long as lost.
    fn miss(&mut self, now: Instant, image: &mut Image) {
        for known in &self.slaves {
            let state = image.status.get(known.index).map(|status| status.state);
            if matches!(state, Some(State::Starting | State::Refused)) && now >= known.missed_at() {
                image.tell(known.index, |status| status.state = State::Lost);
            }
        }
    }
}

fn diagnosed(now: Instant, slaves: &mut [Known], station: u8, bytes: Vec<u8>, image: &mut Image) {
    let Some(known) = slaves.iter_mut().find(|known| known.config.station == station) else { return };
    known.heard = now;
    if known.diagnosis != bytes {
        known.config.keep_diagnosis(&bytes, &mut image.inputs);
        known.diagnosis = bytes;
        image.tell(known.index, |status| status.diagnosis = status.diagnosis.wrapping_add(1));
    }
}

impl Known {
    fn event(
        &mut self,
        now: Instant,
        ours: u8,
        event: PeripheralEvent,
        peripheral: &mut Peripheral<'static>,
        image: &mut Image,
    ) {
        if event != PeripheralEvent::Offline {
            self.heard = now;
        }
        match event {
            PeripheralEvent::DataExchanged => {
                let (at, len) = self.config.inputs;
                if let Some(place) = image.inputs.get_mut(at..at + len) {
                    place.copy_from_slice(peripheral.pi_i());
                }
                self.tried = false;
                self.told = self.told.saturating_add(1);
                let round = now.since(std::mem::replace(&mut self.began, now));
                image.tell(self.index, |status| {
                    status.exchanges += 1;
                    (status.state, status.round) = (State::Running, round);
                });
            }
            PeripheralEvent::Offline => {
                // Its frame count bit is now unknown: it must not take the next telegram for a repetition.
                peripheral.reset_address(self.config.station);
                image.tell(self.index, |status| status.failures += 1);
            }
            PeripheralEvent::ConfigError | PeripheralEvent::ParameterError => refuse(self, image),
            PeripheralEvent::Configured => self.told = 0,
            PeripheralEvent::Online => {
                // Ident number and master of a slave are known before it has parameters; objections to its parameters
                // and configuration only after it has got them. (A slave that refuses its parameters ignores its
                // configuration: then the stack starts again silently.)
                let diagnosis = Diagnosis::new(&self.diagnosis);
                match diagnosis.and_then(|diagnosis| diagnosis.refusal(ours, self.config.ident)) {
                    Some(Refused::Ident(_) | Refused::Master(_)) => refuse(self, image),
                    Some(Refused::Parameters | Refused::Configuration) if self.tried => refuse(self, image),
                    _ => {}
                }
                self.tried = true;
            }
            PeripheralEvent::Diagnostics => {}
        }
        // A slave that has restarted counts as lost, although it was never silent.
        if !peripheral.is_running() {
            lose(self, image);
        }
    }
}

impl Known {
    fn missed_at(&self) -> Instant {
        self.heard.saturating_add(self.config.lost_after.max(START))
    }
}

/// A slave no longer exchanges data.
fn lose(known: &mut Known, image: &mut Image) {
    known.told = 0;
    if image.status.get(known.index).is_some_and(|status| status.state == State::Running) {
        image.tell(known.index, |status| {
            status.state = State::Lost;
            status.losses += 1;
        });
    }
}

/// The slave answers, but refuses.
fn refuse(known: &mut Known, image: &mut Image) {
    lose(known, image);
    if image.status.get(known.index).is_some_and(|status| status.state != State::Refused) {
        image.tell(known.index, |status| {
            status.state = State::Refused;
            status.exceptions += 1;
        });
    }
}

fn peripheral(slave: &DpSlave) -> Peripheral<'static> {
    // It lives as long as the process, because a line is never removed.
    let kept = |bytes: &[u8]| -> Option<&'static [u8]> { Some(Box::leak(bytes.to_vec().into_boxed_slice())) };
    let options = PeripheralOptions {
        ident_number: slave.ident,
        max_tsdr: slave.answer_bits,
        user_parameters: kept(&slave.parameters),
        config: kept(&slave.config),
        ..PeripheralOptions::default()
    };
    Peripheral::new(slave.station, options, vec![0; slave.inputs.1], vec![0; slave.outputs.1])
        .with_diag_buffer(vec![0; DIAGNOSIS_BYTES - STANDARD_BYTES])
}
