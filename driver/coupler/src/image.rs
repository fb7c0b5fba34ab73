//! The inputs and outputs of a bus in its process, and the state of its couplers.

use crate::config::{BusConfig, Span, Table, exception_remedy, exception_text};

/// The state of a coupler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// There was no exchange yet.
    #[default]
    Starting = 0,
    /// The exchange of inputs and outputs works.
    Running = 1,
    /// It has not answered for too long.
    Lost = 2,
    /// It answers, but refuses its set-up: its outputs are not driven.
    Refused = 3,
}

impl State {
    /// In a word or two.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "exchange",
            Self::Lost => "lost",
            Self::Refused => "refuses",
        }
    }

    /// The state of this number; `None` if there is no such state.
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

/// A refusal of a coupler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Function code of the request.
    pub function: u8,
    /// Exception code of the answer.
    pub exception: u8,
    /// Table of the elements.
    pub table: Table,
    /// Number of the first element asked for, from 0.
    pub first: u16,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { function, exception, table, first } = self;
        let (text, helps, table) = (exception_text(*exception), exception_remedy(*exception), table.name());
        write!(f, "refuses function {function:02X}h at {table}:{first}: exception {exception:02X}h, {text}; {helps}")
    }
}

/// The public status of a coupler. Counters only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// Whether and how it takes part in the exchange.
    pub state: State,
    /// Its present refusal; the newest, if there is more than one. For a lost coupler: the exception with which its
    /// gateway reports it as unreachable.
    pub refusal: Option<Refusal>,
    /// Refused ranges: bit n is range n, the inputs first, then the outputs.
    pub bad: u64,
    /// Completed rounds of exchange.
    pub exchanges: u64,
    /// Requests without a usable answer: none in time, wrong check sum, answer of another.
    pub failures: u64,
    /// Answers that were exceptions.
    pub exceptions: u64,
    /// Times it was lost.
    pub losses: u64,
    /// Duration of the last round.
    pub round: Span,
    /// Number of changed diagnoses of a DP slave, whose diagnosis follows its inputs.
    pub diagnosis: u64,
}

impl Status {
    /// The words in the image of the bus: state, exception, function, table and first element of the refusal (0: none)
    /// from the lowest byte on; then the other fields in turn, the duration in nanoseconds.
    pub fn to_words(self) -> [u64; 8] {
        let refusal = self.refusal.map_or(0, |refusal| {
            let table = Table::ALL.iter().position(|(_, table)| *table == refusal.table).unwrap_or(0) as u64 + 1;
            u64::from(refusal.exception) << 8
                | u64::from(refusal.function) << 16
                | table << 24
                | u64::from(refusal.first) << 32
        });
        let state = refusal | u64::from(self.state as u8);
        [
            state,
            self.bad,
            self.exchanges,
            self.failures,
            self.exceptions,
            self.losses,
            self.round.nanos(),
            self.diagnosis,
        ]
    }

    /// From the image of a bus; `None` if the words have no meaning.
    pub fn from_words(words: &[u64; 8]) -> Option<Self> {
        let &[first, bad, exchanges, failures, exceptions, losses, round, diagnosis] = words;
        let [state, exception, function, table, at @ ..] = first.to_le_bytes();
        let refusal = match table {
            0 => None,
            _ => Some(Refusal {
                function,
                exception,
                table: Table::ALL.get(usize::from(table) - 1)?.1,
                first: u16::from_le_bytes([at[0], at[1]]),
            }),
        };
        let round = Span::from_nanos(round);
        Some(Self { state: State::of(state)?, refusal, bad, exchanges, failures, exceptions, losses, round, diagnosis })
    }
}

/// Ranges of a coupler that [`Status::bad`] has room for.
pub const RANGES_MAX: usize = 64;

/// Inputs, outputs, and the couplers.
#[derive(Clone, Debug, Default)]
pub struct Image {
    /// The inputs of the couplers. The bytes of one coupler change together.
    pub inputs: Vec<u8>,
    /// The outputs for the couplers, as the scan wants them.
    pub outputs: Vec<u8>,
    /// False: the outputs are off, whatever [`Self::outputs`] says.
    pub driven: bool,
    /// In the order of the configuration.
    pub status: Vec<Status>,
    /// Counts changes of inputs and status that others should see.
    pub generation: u64,
}

impl Image {
    /// The image of a bus before its first exchange.
    pub fn new(config: &BusConfig) -> Self {
        Self {
            inputs: vec![0; config.input_bytes],
            outputs: vec![0; config.output_bytes],
            driven: false,
            status: vec![Status::default(); config.stations().count()],
            generation: 1,
        }
    }

    /// Changes the status of a coupler, and counts the change.
    pub fn tell(&mut self, coupler: usize, change: impl FnOnce(&mut Status)) {
        if let Some(status) = self.status.get_mut(coupler) {
            change(status);
            self.generation = self.generation.wrapping_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_goes_through_its_words() {
        for state in [State::Starting, State::Running, State::Lost, State::Refused] {
            for (_, table) in Table::ALL {
                let refusal = Some(Refusal { function: 0x17, exception: 0xFE, table, first: 0xABCD });
                let status = Status {
                    state,
                    refusal,
                    bad: u64::MAX,
                    exchanges: 1,
                    failures: 2,
                    exceptions: 3,
                    losses: 4,
                    round: Span::from_nanos(5),
                    diagnosis: 6,
                };
                assert_eq!(Status::from_words(&status.to_words()), Some(status));
                let bare = Status { state, ..Status::default() };
                assert_eq!(Status::from_words(&bare.to_words()), Some(bare));
            }
        }
        for noise in [4, 0xFF, 5 << 24, u64::MAX] {
            assert_eq!(Status::from_words(&[noise; 8]), None, "{noise:x}");
        }
    }
}
