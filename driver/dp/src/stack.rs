//! The data link layer of a master with its line and its clock: the common part of a master and a scan.

use ob1_coupler::config::{Instant, Span};
use ob1_coupler::dp::DpConfig;
use ob1_coupler::{Input, LineFault, LineInput, MasterInput};
use ob1_protocols::profibus::{CHARACTER_BITS, SYNC_BITS};
use profirust::fdl::{FdlActiveStation, FdlApplication, ParametersBuilder};
use profirust::time::Duration;

use crate::times::{MICRO, baud_rate, bits, instant};
use crate::wires::Wires;

/// It needs a few polls until it has sent something or waits.
const LOOKS: u32 = 4;

/// Why the master cannot be created.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoMaster(pub String);

pub(crate) struct Stack {
    baud: u32,
    /// Pauses after the last bit on the line after which it has something to do: the line is free, it may send, an
    /// answer is overdue, the token is lost.
    pauses: [Span; 4],
    pub(crate) wires: Wires,
    fdl: FdlActiveStation,
    pub(crate) is_up: bool,
    /// The last bit on the line.
    active: Instant,
}

impl Stack {
    pub(crate) fn new(config: &DpConfig, now: Instant) -> Result<Self, NoMaster> {
        let slot = u32::from(config.slot_bits);
        let lost_token = slot * (6 + 2 * u32::from(config.address));
        let pauses = [0, SYNC_BITS, slot, lost_token].map(|count| bits(count, config.baud));
        let wires = Wires::new(bits(slot, config.baud));
        Ok(Self { baud: config.baud, pauses, wires, fdl: station(config)?, is_up: false, active: now })
    }

    /// Takes an event and polls the stack; returns when to call again at the latest. `after` is called after each of
    /// its steps.
    pub(crate) fn step<A: FdlApplication>(
        &mut self,
        now: Instant,
        input: MasterInput<'_>,
        out: &mut Vec<u8>,
        app: &mut A,
        mut after: impl FnMut(&mut A, &mut Wires),
    ) -> Instant {
        match input {
            Input::Line(LineInput::Rx(bytes)) => {
                self.wires.hear(now, bytes);
                self.active = now;
            }
            Input::Line(LineInput::TxDone) if self.is_up => {
                // Polled again while it still sends, so that it counts its pauses from the real end.
                self.fdl.poll(instant(now), &mut self.wires, app);
                self.wires.is_out(now);
                self.active = now;
            }
            Input::Line(LineInput::Fault(LineFault::Back)) => {
                self.wires.reset();
                self.fdl.set_offline();
                self.fdl.set_online();
                (self.is_up, self.active) = (true, now);
            }
            Input::Line(LineInput::Fault(LineFault::Gone)) => {
                self.is_up = false;
                self.wires.reset();
            }
            Input::Line(LineInput::Fault(_)) => {
                self.wires.fault(now);
                self.active = now;
            }
            Input::Tick | Input::Line(LineInput::TxDone | LineInput::Modem(_)) => {}
            Input::Order(never) => match never {},
        }
        for _ in 0..if self.is_up { LOOKS } else { 0 } {
            self.fdl.poll(instant(now), &mut self.wires, app);
            after(app, &mut self.wires);
            if self.wires.is_sending() {
                break;
            }
        }
        let telegram = self.wires.take();
        if !telegram.is_empty() {
            self.active = now + bits(CHARACTER_BITS * telegram.len() as u32, self.baud);
            out.extend(telegram);
        }
        if self.is_up { self.deadline(now) } else { Instant::NEVER }
    }

    /// Between events the stack acts only at a few times after the last bit.
    fn deadline(&self, now: Instant) -> Instant {
        let times = self.pauses.map(|pause| {
            // It counts whole microseconds, and waits longer than its pauses.
            self.active.saturating_add(pause).next_tick(MICRO)
        });
        times.into_iter().find(|at| *at > now).unwrap_or(Instant::NEVER)
    }
}

fn station(config: &DpConfig) -> Result<FdlActiveStation, NoMaster> {
    let baud = baud_rate(config.baud).ok_or_else(|| NoMaster(format!("PROFIBUS has no {} bit/s", config.baud)))?;
    let watchdog = config.watchdog.millis();
    // The stack panics if these do not hold; the station file has been checked for the same conditions.
    let holds = config.address < config.hsa
        && config.hsa <= 126
        && (1..=15).contains(&config.retries)
        && (10..=650_000).contains(&watchdog)
        && config.slot_bits >= least_slot_bits(config.baud);
    if !holds {
        return Err(NoMaster("the bus parameters contradict each other".into()));
    }
    let mut parameters = ParametersBuilder::new(config.address, baud);
    parameters
        .slot_bits(config.slot_bits)
        .highest_station_address(config.hsa)
        .max_retry_limit(config.retries)
        .watchdog_timeout(Duration::from_millis(watchdog));
    Ok(FdlActiveStation::new(parameters.build()))
}

/// The shortest slot time of the standard for a baud rate, in bits.
pub const fn least_slot_bits(baud: u32) -> u16 {
    match baud {
        0..=187_500 => 100,
        187_501..=500_000 => 200,
        _ => 300,
    }
}
