//! Cells of a running CPU, read and written for whoever asks at the socket.
//!
//! What is asked for is watched: copied at each cycle control point into a snapshot, all of it at once. What is not
//! asked for any more gives way when the room is needed. Nobody who asks costs the scan more than that copy, and while
//! nobody asks it is not made: the buffers lie here.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use ob1_access::Plan;
use ob1_cpu::{Cell, CellError, CellWidth, GROUP_ENTRIES, Group, Link, Put, TooMuch};

/// Pause between two looks at what has come.
const LOOK: Duration = Duration::from_micros(200);
/// A cell that was not in so many requests is not watched any more when others come.
const FORGOTTEN: u64 = 64;

/// A cell and how much of it.
pub(super) type Wanted = (Cell, CellWidth);

pub(super) struct Cells {
    link: Link,
    plan: Plan,
    generation: u64,
    /// Requests so far, and in which one a cell was last.
    requests: u64,
    used: BTreeMap<Wanted, u64>,
    groups: u64,
    answer_time: Duration,
}

impl Cells {
    pub(super) fn new(link: Link, answer_time: Duration) -> Self {
        Self { link, plan: Plan::default(), generation: 0, requests: 0, used: BTreeMap::new(), groups: 0, answer_time }
    }

    /// The bits of these cells, all of one cycle control point after this call has begun.
    pub(super) fn read(&mut self, wanted: &[Wanted]) -> Result<Vec<Result<u32, CellError>>, String> {
        if wanted.is_empty() {
            return Ok(Vec::new());
        }
        self.requests += 1;
        for cell in wanted {
            self.used.insert(*cell, self.requests);
        }
        if wanted.iter().any(|(cell, width)| !self.plan.has(*cell, *width)) && !self.watch(wanted)? {
            // More than can be watched at a time: one part after the other.
            let (first, rest) = wanted.split_at(wanted.len() / 2);
            let mut values = self.read(first)?;
            values.extend(self.read(rest)?);
            return Ok(values);
        }
        // What lies there already may have been taken long ago.
        self.link.take();
        let seen = self.link.newest().map_or(0, |snapshot| snapshot.scan());
        let give_up = Instant::now() + self.answer_time;
        loop {
            self.link.take();
            let fresh = self.link.newest().filter(|s| s.generation() == self.generation && s.scan() > seen);
            if let Some(snapshot) = fresh {
                let filled =
                    |piece: usize| snapshot.filled().get(piece).map_or((0, None), |filled| (filled.len, filled.error));
                let value = |(cell, width): &Wanted| self.plan.value(*cell, *width, snapshot.bytes(), filled);
                return Ok(wanted.iter().map(value).collect());
            }
            self.wait(give_up)?;
        }
    }

    /// Watches these cells too, and those that were asked for lately as long as there is room; false: even these are
    /// more than a link may watch.
    fn watch(&mut self, wanted: &[Wanted]) -> Result<bool, String> {
        let since = self.requests.saturating_sub(FORGOTTEN);
        self.used.retain(|_, last| *last > since);
        let all = Plan::of(self.used.keys().copied());
        let only = Plan::of(wanted.iter().copied());
        for (plan, keep) in [(all, true), (only, false)] {
            let give_up = Instant::now() + self.answer_time;
            loop {
                match self.link.watch(plan.pieces()) {
                    Ok(generation) => {
                        (self.plan, self.generation) = (plan, generation);
                        if !keep {
                            self.used.retain(|_, last| *last == self.requests);
                        }
                        return Ok(true);
                    }
                    Err(TooMuch::Watch | TooMuch::Group) => break,
                    Err(TooMuch::UnderWay) => self.wait(give_up)?,
                }
            }
        }
        if wanted.len() == 1 { Err("the cell cannot be watched".into()) } else { Ok(false) }
    }

    /// Writes: up to [`GROUP_ENTRIES`] of them land at one cycle control point, or none does. The error names the
    /// entry. A read after this sees what was written.
    pub(super) fn write(&mut self, puts: Vec<Put>) -> Result<Result<(), (usize, CellError)>, String> {
        let mut puts = puts.into_iter().peekable();
        let mut before = 0;
        while puts.peek().is_some() {
            let part: Vec<Put> = puts.by_ref().take(GROUP_ENTRIES).collect();
            let count = part.len();
            self.groups += 1;
            let group = Group::new(self.groups, part).map_err(|_| "more than can be written at once".to_owned())?;
            if let Err((index, error)) = self.group(group)? {
                return Ok(Err((before + index, error)));
            }
            before += count;
        }
        Ok(Ok(()))
    }

    fn group(&mut self, mut group: Group) -> Result<Result<(), (usize, CellError)>, String> {
        let (id, give_up) = (group.id(), Instant::now() + self.answer_time);
        // Buffers on their way back must not fill the ring.
        self.link.take();
        while let Err(full) = self.link.write(group) {
            group = full;
            self.wait(give_up)?;
        }
        loop {
            self.link.take();
            while let Some(answer) = self.link.answer() {
                // Others are of a request that was given up.
                if answer.id() == id {
                    return Ok(answer.outcome());
                }
            }
            self.wait(give_up)?;
        }
    }

    fn wait(&self, give_up: Instant) -> Result<(), String> {
        if self.link.is_closed() {
            return Err("the CPU is gone".into());
        }
        if Instant::now() >= give_up {
            return Err("the CPU does not answer: its scan hangs, or its cycle is very long".into());
        }
        std::thread::sleep(LOOK);
        Ok(())
    }
}
