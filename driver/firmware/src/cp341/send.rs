//! The send channel: jobs of P_SND_RK, piece by piece. [TIA help "PtP data link CP 341"]

use super::model::{JOB_MAX, Model};
use ob1_words::channels::{Block, ChannelBlock, Command, Job, State, pieces, range};

/// Progress of the job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No start number acknowledged.
    Off,
    Ready,
    /// Its data are coming; this many pieces are here.
    Collecting {
        taken: u16,
    },
    /// The CP has the complete job.
    Running,
    /// Fetched data go to the CPU, which has this many pieces.
    Giving {
        given: u16,
    },
    Done,
    Failed(u16),
}

/// Identifies a job. Start and job numbers do not: after a STOP the CPU begins again with the first ones, while the job
/// from before may still be on the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Token(u32);

/// The effect of a block of the CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing for the CP to do.
    Nothing,
    /// A new start number: an incomplete job is dropped.
    Started,
    /// The job is complete.
    Complete,
    /// It is not a possible job; STATUS.
    Refused(u16),
}

/// The channel and the data of its job.
#[derive(Debug)]
pub(crate) struct SendChannel {
    model: &'static Model,
    phase: Phase,
    start: u16,
    number: u16,
    jobs: u32,
    job: Job,
    data: Box<[u8; JOB_MAX]>,
    /// Bytes of fetched data.
    fetched: usize,
}

impl SendChannel {
    pub(crate) fn new(model: &'static Model) -> Self {
        let data = Box::new([0; JOB_MAX]);
        Self { model, phase: Phase::Off, start: 0, number: 0, jobs: 0, job: Job::default(), data, fetched: 0 }
    }

    /// The CPU is in STOP, or the CP starts again: nobody waits for an answer.
    pub(crate) fn off(&mut self) {
        (self.phase, self.start) = (Phase::Off, 0);
    }

    /// The CP has the complete current job.
    pub(crate) fn is_running(&self) -> bool {
        self.phase == Phase::Running
    }

    /// Which job it is.
    pub(crate) fn token(&self) -> Token {
        Token(self.jobs)
    }

    /// The job and the data that came with it.
    pub(crate) fn job(&self) -> (Job, &[u8]) {
        let len = if self.job.has_data() { self.len() } else { 0 };
        (self.job, &self.data[..len])
    }

    /// The data of a SEND in the length its request states: with an odd LEN a filler 00h is appended.
    /// [TIA help "PtP data link CP 341"]
    pub(crate) fn padded(&mut self, bytes: usize) -> &[u8] {
        let len = self.job().1.len();
        if len == 0 {
            return &[];
        }
        self.data[len..bytes].fill(0);
        &self.data[..bytes]
    }

    fn len(&self) -> usize {
        usize::try_from(self.job.len).unwrap_or(0).min(self.model.bytes)
    }

    /// Evaluates the CPU's block.
    pub(crate) fn look(&mut self, block: &ChannelBlock) -> Step {
        let cpu = Block(*block);
        if cpu.command() == Command::Start && cpu.start() != 0 {
            if cpu.start() == self.start {
                return Step::Nothing;
            }
            (self.phase, self.start, self.number) = (Phase::Ready, cpu.start(), 0);
            return Step::Started;
        }
        if cpu.start() != self.start || self.phase == Phase::Off {
            return Step::Nothing;
        }
        match (cpu.command(), self.phase) {
            (Command::Rest, Phase::Done | Phase::Failed(_)) => {
                self.phase = Phase::Ready;
                Step::Nothing
            }
            (Command::Job, _) if cpu.job() != self.number => {
                (self.number, self.job, self.fetched) = (cpu.job(), cpu.order(), 0);
                self.jobs = self.jobs.wrapping_add(1);
                self.phase = Phase::Collecting { taken: 0 };
                self.collect(&cpu)
            }
            (Command::Job, Phase::Collecting { .. }) => self.collect(&cpu),
            (Command::Job, Phase::Giving { given }) if cpu.piece() == given + 1 => {
                self.phase = if cpu.piece() >= pieces(self.fetched) {
                    Phase::Done
                } else {
                    Phase::Giving { given: cpu.piece() }
                };
                Step::Nothing
            }
            _ => Step::Nothing,
        }
    }

    fn collect(&mut self, cpu: &Block) -> Step {
        let Phase::Collecting { taken } = self.phase else { return Step::Nothing };
        let len = self.len();
        if len == 0 || usize::try_from(self.job.len) != Ok(len) {
            self.phase = Phase::Running;
            // "Length too large or too small"
            return Step::Refused(self.model.length);
        }
        if !self.job.has_data() {
            self.phase = Phase::Running;
            return Step::Complete;
        }
        if cpu.piece() != taken {
            return Step::Nothing;
        }
        let range = range(taken, len);
        let bytes = range.len();
        self.data[range].copy_from_slice(&cpu.data()[..bytes]);
        if taken + 1 == pieces(len) {
            self.phase = Phase::Running;
            return Step::Complete;
        }
        self.phase = Phase::Collecting { taken: taken + 1 };
        Step::Nothing
    }

    /// The job has ended; a FETCH with these data.
    pub(crate) fn ended(&mut self, outcome: Result<&[u8], u16>) {
        if self.phase != Phase::Running {
            return;
        }
        self.phase = match outcome {
            Err(status) => Phase::Failed(status),
            Ok([]) => Phase::Done,
            // More may have come than LEN states: with an odd LEN a filler is appended.
            // [TIA help "PtP data link CP 341"]
            Ok(data) => {
                self.fetched = data.len().min(self.len());
                self.data[..self.fetched].copy_from_slice(&data[..self.fetched]);
                Phase::Giving { given: 0 }
            }
        };
    }

    /// The block for the CPU.
    pub(crate) fn show(&self) -> ChannelBlock {
        let block = |state| Block::of_cp(state, self.start, self.number);
        match self.phase {
            Phase::Off => Block::of_cp(State::Off, 0, 0).0,
            Phase::Ready => block(State::Ready).0,
            Phase::Collecting { taken } => block(State::Collecting).with_piece(taken).0,
            Phase::Running => block(State::Running).with_piece(pieces(self.len())).0,
            Phase::Giving { given } => {
                let data = &self.data[range(given, self.fetched)];
                block(State::Giving).with_piece(given).with_len(self.fetched as u16).with_data(data).0
            }
            Phase::Done => block(State::Done).with_len(self.fetched as u16).0,
            Phase::Failed(status) => block(State::Failed).with_status(status).0,
        }
    }
}
