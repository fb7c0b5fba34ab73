//! The inputs and outputs of a bus as its process has them, and how its couplers stand.

use crate::config::{BusConfig, Table};

/// How a coupler stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// It has not been exchanged with yet.
    #[default]
    Starting = 0,
    /// Exchange works.
    Running = 1,
    /// It has not answered for too long.
    Lost = 2,
    /// It answers, and refuses what it is told on connect: its outputs are not driven.
    Refused = 3,
}

impl State {
    /// By its number.
    #[must_use]
    pub const fn of(number: u8) -> Option<Self> {
        Some(match number {
            0 => Self::Starting,
            1 => Self::Running,
            2 => Self::Lost,
            3 => Self::Refused,
            _ => return None,
        })
    }
}

/// What a coupler has refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Function code of the request.
    pub function: u8,
    /// Exception code of the answer.
    pub exception: u8,
    /// Where the elements stand.
    pub table: Table,
    /// First element.
    pub first: u16,
}

/// A coupler as others see it. Counters only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// How it stands.
    pub state: State,
    /// What it refuses at present; the newest, where there is more than one.
    pub refusal: Option<Refusal>,
    /// Ranges that are refused: bit n is range n, the inputs first, then the outputs.
    pub bad: u64,
    /// Rounds of exchange that were completed.
    pub exchanges: u64,
    /// Requests without an answer that can be used: none in time, wrong check sum, another's.
    pub failures: u64,
    /// Answers that were exceptions.
    pub exceptions: u64,
    /// Times it was lost.
    pub losses: u64,
    /// Duration of the last round, in nanoseconds.
    pub round: u64,
}

/// Ranges of a coupler that [`Status::bad`] has room for.
pub const RANGES_MAX: usize = 64;

/// Inputs, outputs, and the couplers.
#[derive(Clone, Debug, Default)]
pub struct Image {
    /// What the couplers sense. The bytes of one coupler change together.
    pub inputs: Vec<u8>,
    /// What they are to drive.
    pub outputs: Vec<u8>,
    /// False: the outputs are off, whatever [`Self::outputs`] says.
    pub driven: bool,
    /// In the order of the configuration.
    pub status: Vec<Status>,
    /// Counts changes of inputs and status that others should see.
    pub generation: u64,
}

impl Image {
    /// Of a bus before its first exchange.
    #[must_use]
    pub fn new(config: &BusConfig) -> Self {
        Self {
            inputs: vec![0; config.input_bytes],
            outputs: vec![0; config.output_bytes],
            driven: false,
            status: vec![Status::default(); config.couplers().count()],
            generation: 1,
        }
    }

    /// Changes the status of a coupler, and counts that.
    pub(crate) fn tell(&mut self, coupler: usize, change: impl FnOnce(&mut Status)) {
        if let Some(status) = self.status.get_mut(coupler) {
            change(status);
            self.generation = self.generation.wrapping_add(1);
        }
    }
}
