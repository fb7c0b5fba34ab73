//! Holds the rack's values against those of the replicas.

use std::collections::{BTreeSet, VecDeque};

use ob1_model::S5Time;
use ob1_time::{Instant, Span};

use super::place::Origin;
use super::rack::{Look, Rack, Whole};
use super::replica::{Placing, Replica, changes};
use super::subject::{Subject, Watched};

/// Readings in a row that no replica explains, before anybody is asked.
const UNEXPLAINED: u32 = 2;
/// A cell that differs again within this time with the same origin is a difference: once may be a change that was
/// shorter than the reading.
const AGAIN: Span = Span::from_secs(600);
/// Takings-over in a row after which nothing was equal: what differs then does so always.
const IN_VAIN: u32 = 3;
/// Readings whose distances say how long one takes.
const DISTANCES: usize = 64;
/// A gap so many times the usual distance, and at least so long, is one after which the state is taken over again.
const GAP: u64 = 8;
const SHORTEST_GAP: Span = Span::from_millis(500);
/// Readings kept before a difference.
const AROUND: usize = 200;

/// What is known about a compared cell.
#[derive(Clone, Debug, Default)]
struct Compared {
    /// Index of the cell.
    cell: usize,
    /// Readings in a row that nobody explains, and the first of them.
    run: u32,
    since: Instant,
    /// How often it differed; when last, and with which origins.
    occurrences: u64,
    last: Option<(Instant, BTreeSet<Origin>)>,
    /// It is a difference.
    known: bool,
    differing: u64,
    /// The rack does not have it.
    missing: bool,
}

/// A cell that differs, for good reason.
#[derive(Clone, Debug)]
pub(crate) struct Difference {
    pub(crate) cell: usize,
    pub(crate) since: Instant,
    pub(crate) rack: u32,
    pub(crate) shadow: Option<u32>,
    pub(crate) origins: Vec<Origin>,
    /// The readings before it.
    pub(crate) around: Vec<Look>,
}

/// Counts of a run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) readings: u64,
    pub(crate) equal: u64,
    /// Readings that were not judged: right after the state was taken over.
    pub(crate) skipped: u64,
    pub(crate) gaps: u64,
    /// The state was taken over, the first time included.
    pub(crate) taken_over: u64,
    /// The rack was not in RUN.
    pub(crate) stops: u64,
    /// Times at which a cell differed that is no difference: explained by no replica, but not again.
    pub(crate) once: u64,
}

/// The judge of a run.
pub(crate) struct Judge<'s> {
    subject: &'s Subject,
    replicas: Vec<Replica>,
    compared: Vec<Compared>,
    last: Option<Look>,
    pending: VecDeque<Look>,
    distances: VecDeque<Span>,
    around: VecDeque<Look>,
    /// Nothing before this is judged.
    hold: Instant,
    /// Takings-over since all was equal.
    in_vain: u32,
    counts: Counts,
}

impl<'s> Judge<'s> {
    /// `date`: nanoseconds since 1990 at the time 0 of the readings.
    pub(crate) fn new(subject: &'s Subject, date: u64) -> Result<Self, String> {
        let replicas = Placing::all().map(|placing| Replica::new(subject, placing, date));
        let cells = subject.cells.iter().enumerate().filter(|(_, watched)| watched.compared);
        Ok(Self {
            subject,
            replicas: replicas.collect::<Result<_, _>>()?,
            compared: cells.map(|(cell, _)| Compared { cell, ..Compared::default() }).collect(),
            last: None,
            pending: VecDeque::new(),
            distances: VecDeque::new(),
            around: VecDeque::new(),
            hold: Instant::START,
            in_vain: 0,
            counts: Counts::default(),
        })
    }

    /// For so long a value may come earlier or later: two readings and two scans.
    pub(crate) fn allowance(&self) -> Span {
        let longest = self.distances.iter().max().copied().unwrap_or_default();
        Span::from_nanos(2 * (longest.nanos() + self.subject.cycle().nanos()))
    }

    fn usual_distance(&self) -> Span {
        let sum: u64 = self.distances.iter().map(|distance| distance.nanos()).sum();
        Span::from_nanos(sum / self.distances.len().max(1) as u64)
    }

    /// The rack does not run: the state is taken over when it does again.
    pub(crate) fn stopped(&mut self) {
        self.counts.stops += u64::from(self.last.take().is_some());
        self.pending.clear();
    }

    /// The next reading; the differences that it makes certain.
    ///
    /// # Errors
    /// The rack cannot be asked. The reading is lost, nothing else.
    pub(crate) fn take(&mut self, look: Look, rack: &mut dyn Rack) -> Result<Vec<Difference>, String> {
        self.counts.readings += 1;
        let Some(last) = &self.last else {
            self.take_over(&rack.whole()?);
            return Ok(Vec::new());
        };
        let distance = look.at.since(last.at);
        if distance > SHORTEST_GAP && distance.nanos() > GAP * self.usual_distance().nanos() {
            self.counts.gaps += u64::from(!self.distances.is_empty());
            // The usual distance may have become another one.
            self.note_distance(distance);
            self.take_over(&rack.whole()?);
            return Ok(Vec::new());
        }
        self.note_distance(distance);
        self.advance(&look.inputs, look.clock, look.at);
        self.pending.push_back(look.clone());
        self.around.push_back(look.clone());
        if self.around.len() > AROUND {
            self.around.pop_front();
        }
        let now = look.at;
        self.last = Some(look);
        let allowance = self.allowance();
        while self.pending.front().is_some_and(|first| first.at.saturating_add(allowance) <= now) {
            let Some(first) = self.pending.pop_front() else { break };
            let suspicious = self.judge(&first, allowance);
            if !suspicious.is_empty() {
                return self.suspect(&suspicious, &first, rack);
            }
        }
        Ok(Vec::new())
    }

    fn note_distance(&mut self, distance: Span) {
        self.distances.push_back(distance);
        if self.distances.len() > DISTANCES {
            self.distances.pop_front();
        }
    }

    fn advance(&mut self, inputs: &[u8], clock: Option<u8>, to: Instant) {
        let Some(last) = &self.last else { return };
        let changes = changes(&self.subject.inputs, &last.inputs, inputs);
        let keep = Span::from_nanos(4 * self.allowance().nanos());
        for replica in &mut self.replicas {
            replica.advance(self.subject, &changes, (last.at, to), keep);
            if let (Some(byte), Some(value)) = (self.subject.clock_memory, clock) {
                replica.set_clock_memory(byte, value);
            }
        }
    }

    /// The compared cells that nobody explains for some time now.
    fn judge(&mut self, look: &Look, allowance: Span) -> Vec<usize> {
        if look.at < self.hold {
            self.counts.skipped += 1;
            return Vec::new();
        }
        let window = (before(look.at, allowance), look.at.saturating_add(allowance));
        let mut whole = vec![true; self.replicas.len()];
        let mut suspicious = Vec::new();
        let mut all = true;
        for (index, (compared, value)) in self.compared.iter_mut().zip(&look.values).enumerate() {
            let Some(value) = *value else {
                compared.missing = true;
                continue;
            };
            let mut explained = false;
            for (replica, whole) in self.replicas.iter().zip(&mut whole) {
                let had = replica.had(compared.cell, value, window);
                explained |= had;
                *whole &= had || compared.known;
            }
            if explained {
                compared.run = 0;
                continue;
            }
            compared.differing += 1;
            all = false;
            if compared.run == 0 {
                compared.since = look.at;
            }
            compared.run += 1;
            if compared.run >= UNEXPLAINED && !compared.known {
                suspicious.push(index);
            }
        }
        self.counts.equal += u64::from(all);
        if let Some(best) = whole.iter().position(|whole| *whole) {
            self.in_vain = 0;
            self.follow(best, &whole);
        }
        suspicious
    }

    /// Replicas that explain less become as the best one.
    fn follow(&mut self, best: usize, whole: &[bool]) {
        for index in (0..self.replicas.len()).filter(|index| whole.get(*index) == Some(&false)) {
            if let Ok([best, replica]) = self.replicas.get_disjoint_mut([best, index]) {
                replica.take_state_of(best);
            }
        }
    }

    /// Asks the rack for everything: where the differences begin, and whether they are new. Then its state is taken
    /// over, so that what comes later is seen for itself.
    fn suspect(&mut self, which: &[usize], look: &Look, rack: &mut dyn Rack) -> Result<Vec<Difference>, String> {
        let whole = rack.whole()?;
        self.advance(&whole.inputs, None, whole.at);
        let window = (before(whole.at, self.allowance()), whole.at);
        let explained = |cell: usize, value: u32| self.replicas.iter().any(|replica| replica.had(cell, value, window));
        let mut differing: BTreeSet<usize> = (0..)
            .zip(&whole.values)
            .filter(|(cell, value)| value.is_some_and(|value| self.is_other(*cell, value, &explained)))
            .map(|(cell, _)| cell)
            .collect();
        differing.extend(which.iter().filter_map(|index| self.compared.get(*index)).map(|compared| compared.cell));
        self.in_vain += 1;
        let mut found = Vec::new();
        for index in which {
            let Some(compared) = self.compared.get_mut(*index) else { continue };
            let value = look.values.get(*index).copied().flatten().unwrap_or_default();
            let origins = self.subject.wiring.origins(compared.cell, &differing);
            let again = compared.last.as_ref().is_some_and(|(at, before)| {
                look.at.since(*at) <= AGAIN && origins.iter().any(|origin| before.contains(origin))
            });
            compared.occurrences += 1;
            compared.last = Some((look.at, origins.iter().cloned().collect()));
            compared.run = 0;
            if self.in_vain >= IN_VAIN || again {
                compared.known = true;
                let shadow = self.replicas.first().and_then(|replica| replica.value(compared.cell));
                let around = self.around.iter().cloned().collect();
                let (cell, since) = (compared.cell, compared.since);
                found.push(Difference { cell, since, rack: value, shadow, origins, around });
            }
        }
        self.watch_closer(which);
        self.take_over(&whole);
        Ok(found)
    }

    /// From now on what these cells are made of is compared as well: where a difference begins is seen better there.
    fn watch_closer(&mut self, which: &[usize]) {
        let cells = which.iter().filter_map(|index| self.compared.get(*index)).map(|compared| compared.cell);
        let leading: BTreeSet<usize> = cells.flat_map(|cell| self.subject.wiring.leading_to(cell)).collect();
        for cell in leading {
            let is_timer = self.subject.cells.get(cell).is_some_and(Watched::is_timer);
            if !is_timer && self.compared.iter().all(|compared| compared.cell != cell) {
                self.compared.push(Compared { cell, ..Compared::default() });
            }
        }
    }

    /// The cells that are compared in each reading.
    pub(crate) fn wanted(&self) -> Vec<usize> {
        self.compared.iter().map(|compared| compared.cell).collect()
    }

    /// Whether no replica has the value; of a timer about the same rest is enough.
    fn is_other(&self, cell: usize, value: u32, explained: &dyn Fn(usize, u32) -> bool) -> bool {
        if !self.subject.cells.get(cell).is_some_and(Watched::is_timer) {
            return !explained(cell, value);
        }
        let time = S5Time(value as u16);
        let near = |replica: &Replica| {
            let mine = replica.value(cell).and_then(|value| S5Time(value as u16).to_ms()).unwrap_or_default();
            let apart = u64::from(mine.abs_diff(time.to_ms().unwrap_or_default()));
            apart <= 2 * (self.usual_distance().millis() + u64::from(time.base_ms()))
        };
        !self.replicas.iter().any(near)
    }

    fn take_over(&mut self, whole: &Whole) {
        for replica in &mut self.replicas {
            replica.load(self.subject, whole);
        }
        self.counts.taken_over += 1;
        self.counts.skipped += self.pending.len() as u64;
        self.pending.clear();
        let at = whole.at.saturating_add(self.subject.cycle());
        self.hold = at.saturating_add(self.allowance());
        self.last = Some(Look { at, inputs: whole.inputs.clone(), ..Look::default() });
    }

    /// Why the station's program has stopped its CPU, if it has: then nothing can be compared.
    pub(crate) fn halted(&self) -> Option<String> {
        self.replicas.iter().find_map(|replica| replica.stopped(self.subject))
    }

    /// The compared cells: how often each differed, and whether the rack has it.
    pub(crate) fn cells(&self) -> impl Iterator<Item = (usize, u64, bool)> {
        self.compared.iter().map(|compared| (compared.cell, compared.differing, compared.missing))
    }

    /// The counts so far.
    pub(crate) fn counts(&self) -> Counts {
        let once = self.compared.iter().filter(|compared| !compared.known);
        Counts { once: once.map(|compared| compared.occurrences).sum(), ..self.counts }
    }
}

fn before(at: Instant, span: Span) -> Instant {
    Instant::START.saturating_add(Span::from_nanos(at.since_start().nanos().saturating_sub(span.nanos())))
}
