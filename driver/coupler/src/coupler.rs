//! One coupler: its next request, and the evaluation of its answers.

use ob1_protocols::modbus::pdu::{self, Function};

use crate::codec;
use crate::config::{CouplerConfig, Instant, Proof, Range, Setup, Span, Table};
use crate::image::{Image, RANGES_MAX, Refusal, State};
use crate::plan::{self, Chunk};

/// Minimum time for a coupler's first answer, before it counts as lost.
const START: Span = Span::from_secs(2);
/// A refused request is tried again after this time, or before the coupler would count as lost.
const REFUSED_AGAIN: Span = Span::from_secs(1);
/// Wait after the second request without an answer; it doubles each time.
const SHORTEST_PAUSE: Span = Span::from_millis(10);
/// Maximum of this wait.
const LONGEST_PAUSE: Span = Span::from_secs(1);

/// After this many consecutive requests without an answer a coupler may have lost power, and with it all its settings,
/// including the watchdog.
const MAY_HAVE_RESTARTED: u32 = 2;
/// Exception 04h, device failure: the answer of a coupler whose watchdog has expired.
const DEVICE_FAILURE: u8 = 4;
/// A coupler that knows function 17h and leaves this many requests of it unanswered, one after the other, is asked for
/// it no more. One that has never answered it does not know it: the first is enough.
const BOTH_UNANSWERED: u8 = 3;
/// Exceptions 05h and 06h, acknowledge and busy: the request comes too early, and is repeated.
const TOO_EARLY: [u8; 2] = [5, 6];
/// A request that comes too early counts as refused after this many repetitions.
const REPETITIONS: u8 = 10;

/// A request to a coupler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Job {
    /// Read whether its watchdog runs.
    Prove,
    Setup(usize),
    Write(usize),
    Read(usize),
    /// Function 17h: write and read in one telegram.
    Both {
        write: usize,
        read: usize,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The proof that its watchdog runs is due.
    Proof,
    /// The set-up writes of a connect; this many are done.
    Setup(usize),
    Exchange,
}

/// Outputs that form one request.
struct Outputs {
    chunk: Chunk,
    /// The coupler's present data, as transferred; `None`: unknown.
    acknowledged: Option<Vec<u8>>,
    at: Instant,
    not_before: Instant,
}

pub(crate) struct Coupler {
    config: CouplerConfig,
    /// Its place in the image's list.
    index: usize,
    phase: Phase,
    reads: Vec<Chunk>,
    writes: Vec<Outputs>,
    /// Inputs read in this round, at their places in the image.
    staged: Vec<u8>,
    /// The next request of the current round.
    round: Option<usize>,
    round_began: Instant,
    /// A round was completed on this connection.
    has_read: bool,
    due: Instant,
    not_before: Instant,
    /// The time of the last answer, or of the start.
    heard: Instant,
    patience: Span,
    misses: u32,
    /// The coupler does not support function 17h.
    never_both: bool,
    /// It has answered one.
    knows_both: bool,
    /// Unanswered requests of function 17h since the last one that it has answered, over all connections; a coupler
    /// that does not answer what comes next either was away, and that one does not count.
    both_unanswered: u8,
    /// The last one of them is not counted yet.
    both_doubtful: bool,
    /// The last one was not answered: until a round is complete, the coupler is written and read separately.
    apart: bool,
    /// Consecutive answers that it is busy.
    busy: u8,
    wrote_last: bool,
    /// The earliest time at which a device failure triggers the set-up again.
    set_up_again: Instant,
    /// The exception with which its gateway reports it as unreachable.
    unreached: Option<Refusal>,
    sending: Vec<u8>,
}

impl Coupler {
    pub(crate) fn new(config: &CouplerConfig, index: usize, input_bytes: usize, now: Instant) -> Self {
        let outputs = |chunk| Outputs { chunk, acknowledged: None, at: Instant::START, not_before: Instant::START };
        Self {
            index,
            phase: Phase::Proof,
            reads: plan::reads(&config.inputs),
            writes: plan::writes(&config.outputs).into_iter().map(outputs).collect(),
            staged: vec![0; input_bytes],
            round: None,
            round_began: Instant::START,
            has_read: false,
            due: Instant::START,
            not_before: Instant::START,
            heard: now,
            patience: config.lost_after.max(START),
            misses: 0,
            never_both: false,
            knows_both: false,
            both_unanswered: 0,
            both_doubtful: false,
            apart: false,
            busy: 0,
            wrote_last: false,
            set_up_again: Instant::START,
            unreached: None,
            sending: Vec::new(),
            config: config.clone(),
        }
    }

    pub(crate) const fn index(&self) -> usize {
        self.index
    }

    /// The connection is new, or was given up: the coupler may have forgotten everything.
    pub(crate) fn connect(&mut self, now: Instant) {
        (self.has_read, self.due) = (false, now);
        (self.not_before, self.misses, self.never_both) = (now, 0, false);
        // `both_unanswered` stays: function 17h may be the reason why the connection was closed.
        self.busy = 0;
        self.set_up();
    }

    /// Starts from the beginning: the set-up writes, then its outputs and inputs.
    fn set_up(&mut self) {
        (self.phase, self.round) = (Phase::Proof, None);
        for outputs in &mut self.writes {
            (outputs.acknowledged, outputs.not_before) = (None, Instant::START);
        }
    }

    /// Time has passed: a coupler that has been silent for too long is lost, and its connection is made anew.
    pub(crate) fn tick(&mut self, now: Instant, image: &mut Image) {
        let state = image.status.get(self.index).map(|status| status.state);
        if state != Some(State::Lost) && now >= self.lost_at() {
            let pause = (self.not_before, self.misses);
            self.connect(now);
            (self.not_before, self.misses) = pause;
            let unreached = self.unreached;
            image.tell(self.index, |status| {
                status.state = State::Lost;
                status.losses += 1;
                (status.refusal, status.bad) = (unreached, 0);
            });
        }
    }

    /// When it counts as lost without an answer.
    pub(crate) const fn lost_at(&self) -> Instant {
        self.heard.saturating_add(self.patience)
    }

    /// When [`Self::tick`] or [`Self::next`] is due, independent of the outputs.
    pub(crate) fn due(&self, is_lost: bool) -> Instant {
        let lost = if is_lost { Instant::NEVER } else { self.lost_at() };
        let work = match self.phase {
            Phase::Proof | Phase::Setup(_) => Instant::START,
            Phase::Exchange if self.round.is_some() => Instant::START,
            Phase::Exchange => {
                let read = if self.reads.is_empty() { Instant::NEVER } else { self.due };
                self.writes.iter().map(|outputs| outputs.due(self.config.refresh)).fold(read, Instant::min)
            }
        };
        lost.min(work.max(self.not_before))
    }

    /// The next request now.
    pub(crate) fn next(&mut self, now: Instant, image: &Image) -> Option<Job> {
        if now < self.not_before {
            return None;
        }
        if self.phase == Phase::Proof {
            if self.config.proof.is_some() {
                return Some(Job::Prove);
            }
            self.phase = Phase::Setup(0);
        }
        if let Phase::Setup(done) = self.phase {
            if done < self.config.setup.len() {
                return Some(Job::Setup(done));
            }
            (self.phase, self.due) = (Phase::Exchange, now);
        }
        if self.round.is_none() && now >= self.due && !self.reads.is_empty() {
            (self.round, self.round_began) = (Some(0), now);
        }
        let refresh = self.config.refresh;
        let write = self.writes.iter().position(|outputs| {
            now >= outputs.not_before
                && (now >= outputs.due(refresh)
                    || outputs.acknowledged.as_ref() != Some(&gathered(&self.config.outputs, &outputs.chunk, image)))
        });
        match (write, self.round) {
            (Some(write), Some(read)) if self.goes_together(write, read) => Some(Job::Both { write, read }),
            // Outputs that change all the time must not keep the inputs from being read.
            (Some(_), Some(read)) if self.wrote_last => Some(Job::Read(read)),
            (Some(write), _) => Some(Job::Write(write)),
            (None, Some(read)) => Some(Job::Read(read)),
            (None, None) => None,
        }
    }

    fn goes_together(&self, write: usize, read: usize) -> bool {
        let is_words = |table: Option<Table>| table == Some(Table::Holding);
        !(self.never_both || self.apart)
            && self.both_unanswered < if self.knows_both { BOTH_UNANSWERED } else { 1 }
            && is_words(self.writes.get(write).map(|outputs| outputs.chunk.table))
            && is_words(self.reads.get(read).map(|chunk| chunk.table))
    }

    /// The request of a job.
    pub(crate) fn telegram(&mut self, job: Job, image: &Image) -> Vec<u8> {
        self.sending.clear();
        let unit = self.config.unit;
        if let Job::Write(write) | Job::Both { write, .. } = job
            && let Some(outputs) = self.writes.get(write)
        {
            self.sending = gathered(&self.config.outputs, &outputs.chunk, image);
        }
        match job {
            Job::Prove => {
                self.config.proof.as_ref().map_or_else(Vec::new, |proof| {
                    head(unit, Function::ReadOutputWords as u8, proof.first, proof.count)
                })
            }
            Job::Setup(n) => self.config.setup.get(n).map_or_else(Vec::new, |setup| of_setup(unit, setup)),
            Job::Read(n) => self.reads.get(n).map_or_else(Vec::new, |chunk| of_read(unit, chunk)),
            Job::Write(n) => {
                self.writes.get(n).map_or_else(Vec::new, |outputs| of_write(unit, &outputs.chunk, &self.sending))
            }
            Job::Both { write, read } => match (self.writes.get(write), self.reads.get(read)) {
                (Some(outputs), Some(chunk)) => {
                    let mut telegram = head(unit, pdu::READ_WRITE_WORDS, chunk.first, chunk.count);
                    telegram.extend(outputs.chunk.first.to_be_bytes());
                    telegram.extend(outputs.chunk.count.to_be_bytes());
                    telegram.push(self.sending.len() as u8);
                    telegram.extend(&self.sending);
                    telegram
                }
                _ => Vec::new(),
            },
        }
    }

    /// The request was sent, but no usable answer came.
    pub(crate) fn failed(&mut self, now: Instant, job: Job, image: &mut Image) {
        self.misses = self.misses.saturating_add(1);
        // The first repetition at once, then with pauses.
        if let Some(doublings) = self.misses.checked_sub(2) {
            let pause = SHORTEST_PAUSE.times(1 << doublings.min(20)).min(LONGEST_PAUSE);
            self.not_before = now.saturating_add(pause);
        }
        // The set-up is a sequence, and an interrupted one starts again: if only the answer to the setting of a
        // watchdog was lost, the watchdog would refuse to be set a second time.
        if self.misses == MAY_HAVE_RESTARTED || matches!(job, Job::Setup(_)) {
            self.set_up();
        }
        // It is unknown whether it was written.
        self.forget_written(job);
        self.both_doubtful = false;
        self.unanswered(job);
        image.tell(self.index, |status| status.failures += 1);
    }

    /// A request was not answered, or the connection was closed instead: some couplers do that to functions they do not
    /// know.
    pub(crate) fn unanswered(&mut self, job: Job) {
        if matches!(job, Job::Both { .. }) {
            (self.apart, self.both_doubtful) = (true, true);
        }
    }

    /// It has answered something: if it has not answered function 17h before, it was there and does not know it.
    fn is_there(&mut self) {
        if std::mem::take(&mut self.both_doubtful) {
            self.both_unanswered = self.both_unanswered.saturating_add(1);
        }
    }

    /// Whether a request is the one that shows whether it knows function 17h.
    pub(crate) fn is_probe(&self, job: Job) -> bool {
        matches!(job, Job::Both { .. }) && !self.knows_both
    }

    /// The line was taken for this long by a request that may have been one too many: this is no silence of anybody.
    pub(crate) fn forgive(&mut self, time: Span) {
        self.heard = self.heard.saturating_add(time);
    }

    /// What a request would have written is written again.
    fn forget_written(&mut self, job: Job) {
        if let Job::Write(write) | Job::Both { write, .. } = job {
            self.forget(write);
        }
    }

    fn forget(&mut self, write: usize) {
        if let Some(outputs) = self.writes.get_mut(write) {
            outputs.acknowledged = None;
        }
    }

    /// An answer that belongs to the request.
    pub(crate) fn answered(&mut self, now: Instant, job: Job, answer: &[u8], image: &mut Image) {
        if let &[_, code, exception] = answer
            && code & pdu::ERROR_BIT != 0
        {
            return self.refused(now, job, code & !pdu::ERROR_BIT, exception, image);
        }
        // Checks the length of the data read by function 17h; the other answers have been checked.
        let data = match job {
            Job::Read(n) | Job::Both { read: n, .. } => {
                let bytes = self.reads.get(n).map_or(0, Chunk::bytes);
                match answer.get(2..) {
                    Some([count, data @ ..]) if usize::from(*count) == bytes && data.len() == bytes => data,
                    _ => return self.failed(now, job, image),
                }
            }
            Job::Prove => answer.get(3..).unwrap_or_default(),
            Job::Setup(_) | Job::Write(_) => &[],
        };
        self.is_there();
        (self.heard, self.misses, self.not_before, self.unreached) = (now, 0, now, None);
        (self.patience, self.busy) = (self.config.lost_after, 0);
        match job {
            Job::Prove => {
                let proof = self.config.proof.as_ref().filter(|proof| is_proven(proof, data));
                self.phase = Phase::Setup(proof.map_or(0, |proof| proof.skips));
            }
            Job::Setup(done) => self.phase = Phase::Setup(done + 1),
            Job::Read(read) => self.has_read_one(now, read, data, image),
            Job::Write(write) => self.has_written(now, write, image),
            Job::Both { write, read } => {
                (self.knows_both, self.both_unanswered) = (true, 0);
                self.has_written(now, write, image);
                self.has_read_one(now, read, data, image);
            }
        }
        self.wrote_last = matches!(job, Job::Write(_));
    }

    fn has_written(&mut self, now: Instant, write: usize, image: &mut Image) {
        let Some(outputs) = self.writes.get_mut(write) else { return };
        outputs.acknowledged = Some(std::mem::take(&mut self.sending));
        (outputs.at, outputs.not_before) = (now, Instant::START);
        let chunk = outputs.chunk;
        self.mark(&chunk, true, None, image);
        if self.reads.is_empty() {
            self.completed(now, now, image);
        }
    }

    fn has_read_one(&mut self, now: Instant, read: usize, data: &[u8], image: &mut Image) {
        let Some(chunk) = self.reads.get(read).copied() else { return };
        for range in self.config.inputs.iter().filter(|range| chunk.meets(range)) {
            codec::unpack(range, chunk.first, chunk.count, data, &mut self.staged);
        }
        self.mark(&chunk, false, None, image);
        self.next_read(now, read, image);
    }

    fn next_read(&mut self, now: Instant, read: usize, image: &mut Image) {
        if read + 1 < self.reads.len() {
            self.round = Some(read + 1);
            return;
        }
        (self.round, self.apart) = (None, false);
        self.has_read = true;
        // In step with the period; missed rounds are not made up.
        self.due = self.due.saturating_add(self.config.period);
        if self.due <= now {
            self.due = now.saturating_add(self.config.period);
        }
        let bad = image.status.get(self.index).map_or(0, |status| status.bad);
        for (n, range) in self.config.inputs.iter().enumerate() {
            let bytes = range.at..range.at + range.bytes();
            if bad >> (n % RANGES_MAX) & 1 == 0
                && let (Some(from), Some(to)) = (self.staged.get(bytes.clone()), image.inputs.get_mut(bytes))
            {
                to.copy_from_slice(from);
            }
        }
        self.completed(now, self.round_began, image);
    }

    /// A round is complete; the coupler runs as soon as it has its outputs too.
    fn completed(&self, now: Instant, began: Instant, image: &mut Image) {
        let whole = (self.has_read || self.reads.is_empty())
            && self.writes.iter().all(|outputs| outputs.acknowledged.is_some() || outputs.not_before > Instant::START);
        image.tell(self.index, |status| {
            status.exchanges += 1;
            status.round = now.since(began);
            if whole && status.state != State::Running {
                status.state = State::Running;
                // A refusal during the set-up is over.
                status.refusal = status.refusal.filter(|_| status.bad != 0);
            }
        });
    }

    /// The coupler answers with an exception.
    fn refused(&mut self, now: Instant, job: Job, function: u8, exception: u8, image: &mut Image) {
        image.tell(self.index, |status| status.exceptions += 1);
        let (table, first) = self.asked_for(job);
        let refusal = Refusal { function, exception, table, first };
        if matches!(exception, 10 | 11) {
            // A gateway that does not reach it: it counts as not reached, and the reason is kept.
            self.unreached = Some(refusal);
            return self.failed(now, job, image);
        }
        self.unreached = None;
        self.is_there();
        (self.heard, self.misses, self.patience) = (now, 0, self.config.lost_after);
        if TOO_EARLY.contains(&exception) && self.busy < REPETITIONS {
            (self.busy, self.not_before) = (self.busy + 1, now.saturating_add(SHORTEST_PAUSE));
            self.wrote_last = matches!(job, Job::Write(_));
            return self.forget_written(job);
        }
        if exception == DEVICE_FAILURE
            && !matches!(job, Job::Prove | Job::Setup(_))
            && !self.config.setup.is_empty()
            && now >= self.set_up_again
        {
            self.set_up_again = self.again(now);
            return self.set_up();
        }
        match job {
            // It does not have these registers, so the watchdog is set.
            Job::Prove => self.phase = Phase::Setup(0),
            Job::Both { write, .. } => {
                // Tried again separately, to find out which one was refused.
                self.never_both = true;
                self.forget(write);
            }
            Job::Setup(_) => {
                (self.phase, self.not_before) = (Phase::Setup(0), self.again(now));
                image.tell(self.index, |status| (status.state, status.refusal) = (State::Refused, Some(refusal)));
            }
            Job::Write(n) => {
                let again = self.again(now);
                let Some(outputs) = self.writes.get_mut(n) else { return };
                (outputs.acknowledged, outputs.not_before) = (None, again);
                let chunk = outputs.chunk;
                self.mark(&chunk, true, Some(refusal), image);
                if self.reads.is_empty() {
                    self.completed(now, now, image);
                }
            }
            Job::Read(n) => {
                let Some(chunk) = self.reads.get(n).copied() else { return };
                self.mark(&chunk, false, Some(refusal), image);
                self.next_read(now, n, image);
            }
        }
    }

    /// Table and first element of a request.
    fn asked_for(&self, job: Job) -> (Table, u16) {
        let of_chunk = |chunk: &Chunk| (chunk.table, chunk.first);
        let found = match job {
            Job::Prove => self.config.proof.as_ref().map(|proof| (Table::Holding, proof.first)),
            Job::Setup(n) => self.config.setup.get(n).map(|setup| (setup.table, setup.at)),
            Job::Write(n) => self.writes.get(n).map(|outputs| of_chunk(&outputs.chunk)),
            Job::Read(n) | Job::Both { read: n, .. } => self.reads.get(n).map(of_chunk),
        };
        found.unwrap_or((Table::Holding, 0))
    }

    /// When a refused request is tried again.
    fn again(&self, now: Instant) -> Instant {
        now.saturating_add(REFUSED_AGAIN.min(self.config.lost_after / 2))
    }

    /// Marks the ranges of a chunk as refused or not refused.
    fn mark(&self, chunk: &Chunk, outputs: bool, refusal: Option<Refusal>, image: &mut Image) {
        let (ranges, first) =
            if outputs { (&self.config.outputs, self.config.inputs.len()) } else { (&self.config.inputs, 0) };
        let met = ranges.iter().enumerate().filter(|(_, range)| chunk.meets(range));
        let mask = met.fold(0_u64, |mask, (n, _)| mask | 1 << ((first + n) % RANGES_MAX));
        let Some(status) = image.status.get(self.index) else { return };
        match refusal {
            None if status.bad & mask != 0 => image.tell(self.index, |status| {
                status.bad &= !mask;
                if status.bad == 0 {
                    status.refusal = None;
                }
            }),
            Some(refusal) if status.bad & mask != mask || status.refusal != Some(refusal) => {
                image.tell(self.index, |status| {
                    status.bad |= mask;
                    status.refusal = Some(refusal);
                });
            }
            _ => {}
        }
    }

    /// Whether it has the current outputs, as far as it accepts them.
    pub(crate) fn has_outputs(&self, image: &Image) -> bool {
        self.writes.iter().all(|outputs| {
            outputs.not_before > Instant::START
                || outputs.acknowledged.as_ref() == Some(&gathered(&self.config.outputs, &outputs.chunk, image))
        })
    }
}

impl Outputs {
    fn due(&self, refresh: Span) -> Instant {
        let refreshed = if self.acknowledged.is_some() { self.at.saturating_add(refresh) } else { Instant::START };
        refreshed.max(self.not_before)
    }
}

/// The outputs of a chunk as transferred; all 0 when they are not driven.
fn gathered(ranges: &[Range], chunk: &Chunk, image: &Image) -> Vec<u8> {
    let mut data = vec![0; chunk.bytes()];
    if image.driven {
        for range in ranges.iter().filter(|range| chunk.meets(range)) {
            codec::pack(range, chunk.first, chunk.count, &image.outputs, &mut data);
        }
    }
    data
}

/// Whether the registers of an answer have the required values.
fn is_proven(proof: &Proof, data: &[u8]) -> bool {
    let word = |n: u16| data.chunks_exact(2).nth(usize::from(n)).map(|word| u16::from_be_bytes([word[0], word[1]]));
    proof.expected.iter().all(|(n, value)| word(*n) == Some(*value))
}

fn head(unit: u8, function: u8, first: u16, value: u16) -> Vec<u8> {
    let ([f0, f1], [v0, v1]) = (first.to_be_bytes(), value.to_be_bytes());
    vec![unit, function, f0, f1, v0, v1]
}

/// The value of a coil in function 05h.
const fn of_bit(on: bool) -> u16 {
    if on { 0xFF00 } else { 0 }
}

fn of_setup(unit: u8, setup: &Setup) -> Vec<u8> {
    if setup.table.has_bits() {
        head(unit, Function::WriteBit as u8, setup.at, of_bit(setup.value != 0))
    } else {
        head(unit, Function::WriteWord as u8, setup.at, setup.value)
    }
}

fn of_read(unit: u8, chunk: &Chunk) -> Vec<u8> {
    let function = match chunk.table {
        Table::Coil => Function::ReadOutputBits,
        Table::Discrete => Function::ReadInputBits,
        Table::Holding => Function::ReadOutputWords,
        Table::Input => Function::ReadInputWords,
    };
    head(unit, function as u8, chunk.first, chunk.count)
}

fn of_write(unit: u8, chunk: &Chunk, data: &[u8]) -> Vec<u8> {
    let bits = chunk.table.has_bits();
    match *data {
        [bit] if bits && chunk.count == 1 => head(unit, Function::WriteBit as u8, chunk.first, of_bit(bit & 1 == 1)),
        [high, low] if !bits => head(unit, Function::WriteWord as u8, chunk.first, u16::from_be_bytes([high, low])),
        _ => {
            let function = if bits { Function::WriteBits } else { Function::WriteWords };
            let mut telegram = head(unit, function as u8, chunk.first, chunk.count);
            telegram.push(data.len() as u8);
            telegram.extend(data);
            telegram
        }
    }
}
