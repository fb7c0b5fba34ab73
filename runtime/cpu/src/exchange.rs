//! The exchange: what links read and write in the CPU, at the cycle control point.
//!
//! The order, in STOP too: outputs, writes of the links, snapshots, inputs. A link says which pieces of memory it
//! watches; they are copied together into its window ([`crate::Window`]). Its writes come in groups that land whole; a
//! group is answered after the snapshot that contains it. Everything else goes through the rings of a link. What a link
//! has sent is returned to it, so the scan allocates and frees nothing, and never waits.
//!
//! Commands and questions have a ring of their own: they are answered before the cycle changes the operating state, and
//! within a cycle that does not end, where nothing may be written.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use ob1_model::{Cell, Frame, Head, PASS_JOBS, POINT_JOBS, Piece, WRITE_BYTES, Width, fits_a_share};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::alarms::AlarmJob;
use crate::cells;
use crate::context::Blocks;
use crate::holding::DebugJob;
use crate::machine::Machine;
use crate::orders::{Answer, Group, Listing, Question, TooMuch};
use crate::points::PointJob;
use crate::recording::Recordings;
use crate::watching::PassJob;
use crate::{Mark, OperatingState, Window};

/// Most links of a CPU.
pub const LINKS: usize = 9;

/// Orders and groups of one link that can be under way, and as many questions.
const RING: usize = 32;
/// Groups of a link that one cycle control point takes.
const GROUPS: usize = 8;

/// What a link watches, as the scan copies it.
#[derive(Debug)]
pub(crate) struct Watch {
    generation: u64,
    steps: Box<[Step]>,
    copies: Box<[Copied]>,
}

/// A value, or pieces of one block.
#[derive(Debug)]
enum Step {
    Value {
        cell: Cell,
        width: Width,
        head: usize,
    },
    Block {
        at: Cell,
        head: usize,
        copies: Range<usize>,
    },
    /// Like `Block`, when each piece fits a word: a whole word is copied from where it begins.
    Words {
        at: Cell,
        head: usize,
        copies: Range<usize>,
    },
}

/// Bytes of a block, and the words they go to.
#[derive(Clone, Copy, Debug)]
struct Copied {
    from: u32,
    len: u32,
    at: u32,
}

impl Watch {
    pub(crate) fn new(generation: u64, frame: &Frame) -> Self {
        let (mut steps, mut copies) = (Vec::with_capacity(frame.runs().len()), Vec::new());
        for run in frame.runs() {
            let pieces = frame.pieces().get(run.first..run.end).unwrap_or_default();
            let first = copies.len();
            let mut next = run.head + 1;
            for piece in pieces {
                match *piece {
                    Piece::Value(cell, width) => steps.push(Step::Value { cell, width, head: run.head }),
                    Piece::Bytes { at, len } => {
                        copies.push(Copied { from: at.byte(), len, at: next as u32 });
                        next += len.div_ceil(8) as usize;
                    }
                }
            }
            if let Some(Piece::Bytes { at, .. }) = pieces.first() {
                let (at, head, range) = (*at, run.head, first..copies.len());
                let small = copies.get(first..).unwrap_or_default().iter().all(|copied| (1..=8).contains(&copied.len));
                steps.push(match small {
                    true => Step::Words { at, head, copies: range },
                    false => Step::Block { at, head, copies: range },
                });
            }
        }
        Self { generation, steps: steps.into(), copies: copies.into() }
    }

    /// Fills the words of a window; a data block is found by its number, because it may have been made or deleted
    /// since.
    pub(crate) fn fill(&self, m: &mut Machine, words: &[AtomicU64]) {
        let put = |at: usize, word: u64| {
            if let Some(cell) = words.get(at) {
                cell.store(word, Ordering::Relaxed);
            }
        };
        for step in &self.steps {
            match step {
                Step::Value { cell, width, head } => put(*head, Head::of(cells::read(m, *cell, *width)).word()),
                Step::Block { at, head, copies } => {
                    let block = cells::block(m, *at);
                    put(*head, Head::of(block.map(|bytes| bytes.len() as u32)).word());
                    let Ok(block) = block else { continue };
                    for copied in self.copies.get(copies.clone()).unwrap_or_default() {
                        let (from, len, at) = (copied.from as usize, copied.len as usize, copied.at as usize);
                        let Some(into) = words.get(at..at + len.div_ceil(8)) else { continue };
                        // The bytes that exist; the head holds the length of the block.
                        let there = block.get(from..from + len).or_else(|| block.get(from..));
                        copy(there.unwrap_or_default(), into);
                    }
                }
                Step::Words { at, head, copies } => {
                    let block = cells::block(m, *at);
                    put(*head, Head::of(block.map(|bytes| bytes.len() as u32)).word());
                    let Ok(block) = block else { continue };
                    let copies = self.copies.get(copies.clone()).unwrap_or_default();
                    for (copied, word) in copies.iter().zip(words.get(head + 1..).unwrap_or_default()) {
                        let rest = block.get(copied.from as usize..).unwrap_or_default();
                        match rest.first_chunk() {
                            Some(eight) => word.store(u64::from_ne_bytes(*eight), Ordering::Relaxed),
                            None => copy(rest, std::slice::from_ref(word)),
                        }
                    }
                }
            }
        }
    }
}

/// Bytes into whole words.
#[inline]
fn copy(bytes: &[u8], into: &[AtomicU64]) {
    let (whole, rest) = bytes.as_chunks::<8>();
    for (word, bytes) in into.iter().zip(whole) {
        word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
    }
    if rest.is_empty() {
        return;
    }
    let Some(last) = into.get(whole.len()) else { return };
    let mut bytes = [0; 8];
    bytes.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
    last.store(u64::from_ne_bytes(bytes), Ordering::Relaxed);
}

/// What a link hands to the CPU, and gets back when it is done.
#[derive(Debug)]
pub enum Job {
    /// Commands and questions.
    Question(Box<Question>),
    /// Writes that land together. When they come back, the newest snapshot contains them.
    Group(Box<Group>),
    /// A system status list.
    List(Box<Listing>),
    /// A pass through a block.
    Pass(Box<PassJob>),
    /// Breakpoints, HOLD, stacks.
    Debug(Box<DebugJob>),
    /// Cells read and written at a point of the cycle.
    Point(Box<PointJob>),
    /// About alarms.
    Alarms(Box<AlarmJob>),
}

/// A job by the type of what is asked.
macro_rules! jobs {
    ($($kind:ident($asked:ty),)*) => {
        $(impl From<$asked> for Job {
            fn from(asked: $asked) -> Self {
                Self::$kind(Box::new(asked))
            }
        })*
    };
}

jobs! {
    Question(Question), Group(Group), List(Listing), Pass(PassJob), Debug(DebugJob), Point(PointJob), Alarms(AlarmJob),
}

/// What goes from a link to the CPU.
#[derive(Debug)]
enum Order {
    Job(Job),
    Watch(Box<Watch>),
    /// Nobody waits for the job with this number any more.
    Forget(u64),
}

/// What goes from the CPU to a link.
#[derive(Debug)]
pub(crate) enum Back {
    Job(Job),
    /// A replaced watch, to be freed.
    OldWatch(#[expect(dead_code, reason = "it comes back to be freed")] Box<Watch>),
}

/// A link's end. It belongs to one thread.
#[derive(Debug)]
pub struct Link {
    questions: Producer<Box<Question>>,
    orders: Producer<Order>,
    back: Consumer<Back>,
    generation: u64,
}

impl Link {
    /// Watches these pieces from the next cycle control point on, instead of those before. Their snapshots carry
    /// `generation`.
    ///
    /// # Errors
    /// [`TooMuch::Watch`] for more than a link's share; [`TooMuch::UnderWay`] while too many orders wait.
    pub fn watch(&mut self, generation: u64, frame: &Frame) -> Result<(), TooMuch> {
        if !fits_a_share(frame.pieces().iter().copied()) {
            return Err(TooMuch::Watch);
        }
        let watch = Box::new(Watch::new(generation, frame));
        self.orders.push(Order::Watch(watch)).map_err(|_| TooMuch::UnderWay)?;
        self.generation = generation;
        Ok(())
    }

    /// The generation that was watched last.
    #[must_use]
    pub const fn generation(&self) -> u64 {
        self.generation
    }

    /// Hands a job over; it comes back with [`Link::take`]. A question can be asked again then.
    ///
    /// # Errors
    /// [`TooMuch::UnderWay`]: its ring is full.
    pub fn hand(&mut self, job: impl Into<Job>) -> Result<(), TooMuch> {
        match job.into() {
            Job::Question(question) => self.questions.push(question).map_err(|_| TooMuch::UnderWay),
            job => self.orders.push(Order::Job(job)).map_err(|_| TooMuch::UnderWay),
        }
    }

    /// Nobody waits for this pass or point any more; what there is of it comes back all the same.
    ///
    /// # Errors
    /// [`TooMuch::UnderWay`]: the ring of orders is full.
    pub fn forget(&mut self, id: u64) -> Result<(), TooMuch> {
        self.orders.push(Order::Forget(id)).map_err(|_| TooMuch::UnderWay)
    }

    /// The next job that has come back.
    pub fn take(&mut self) -> Option<Job> {
        loop {
            if let Back::Job(job) = self.back.pop().ok()? {
                return Some(job);
            }
        }
    }

    /// True when the CPU is gone.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.orders.is_abandoned()
    }
}

/// The CPU's end of a link.
struct End {
    /// Its place among all.
    place: usize,
    questions: Consumer<Box<Question>>,
    /// A question with more parts than a look answers.
    question: Option<Box<Question>>,
    orders: Consumer<Order>,
    back: Producer<Back>,
    window: Box<dyn Window>,
    watch: Option<Box<Watch>>,
    /// Groups that have landed and whose answers wait for the snapshot.
    landed: [Option<Box<Group>>; GROUPS],
}

/// The CPU's end of all links.
#[derive(Default)]
pub(crate) struct Exchange {
    ends: Vec<End>,
    /// Cycle control points so far.
    scan: u64,
    /// The link whose groups come first this time, and the one whose questions do.
    first: usize,
    asker: usize,
    pub(crate) recordings: Recordings,
}

impl Exchange {
    /// Another link, unless there are [`LINKS`].
    pub(crate) fn link(&mut self, window: Box<dyn Window>) -> Option<Link> {
        if self.ends.len() == LINKS {
            return None;
        }
        let (to_cpu, orders) = RingBuffer::new(RING);
        let (ask, questions) = RingBuffer::new(RING);
        // Room for all orders and questions, for the watch that an order may replace, and for the jobs that stay with
        // the CPU.
        let (back, from_cpu) = RingBuffer::new(3 * RING + PASS_JOBS + POINT_JOBS);
        let place = self.ends.len();
        let landed = [const { None }; GROUPS];
        self.ends.push(End { place, questions, question: None, orders, back, window, watch: None, landed });
        Some(Link { questions: ask, orders: to_cpu, back: from_cpu, generation: 0 })
    }

    /// Whether there is anything to do for a link at this cycle control point.
    pub(crate) fn is_idle(&self) -> bool {
        let watches = |end: &End| end.watch.as_ref().is_some_and(|watch| !watch.steps.is_empty());
        self.recordings.is_idle() && self.ends.iter().all(|end| !watches(end) && end.orders.is_empty())
    }

    /// Answers what links ask, each in turn, up to the bound of a look.
    pub(crate) fn questions(&mut self, m: &mut Machine, blocks: &Blocks, state: OperatingState) {
        let (mut left, links) = (m.config.questions_per_scan.max(1), self.ends.len());
        for turn in 0..links {
            let at = if self.asker + turn < links { self.asker + turn } else { self.asker + turn - links };
            if !self.ends[at].questions(m, blocks, state, &mut left) {
                // The others were not heard: they are first next time.
                self.asker = if at + 1 < links { at + 1 } else { 0 };
                return;
            }
        }
    }

    /// The cycle control point: writes, then the snapshots, then the answers.
    pub(crate) fn serve(&mut self, m: &mut Machine, state: OperatingState) {
        self.scan += 1;
        m.alarms.control_point();
        self.writes(m, state);
        for end in &mut self.ends {
            end.snapshot(m, self.scan, state);
            end.answers(self.scan);
        }
        self.recordings.control_point(m, self.scan, state);
    }

    /// A job of this link has ended.
    pub(crate) fn give_back(&mut self, link: usize, job: Job) {
        if let Some(end) = self.ends.get_mut(link) {
            let _ = end.back.push(Back::Job(job));
        }
    }

    /// One group of each link in turn, until there is none or the bytes of this scan are used up.
    fn writes(&mut self, m: &mut Machine, state: OperatingState) {
        let (mut left, links) = (WRITE_BYTES, self.ends.len().max(1));
        self.first = (self.first + 1) % links;
        for _ in 0..GROUPS {
            let mut any = false;
            for turn in 0..self.ends.len() {
                let end = &mut self.ends[(self.first + turn) % links];
                any |= end.one_group(m, state, &mut left);
            }
            if !any {
                return;
            }
        }
    }
}

impl End {
    /// Answers its questions as long as there is room; false when nothing is `left` for others.
    fn questions(&mut self, m: &mut Machine, blocks: &Blocks, state: OperatingState, left: &mut u32) -> bool {
        loop {
            if self.question.is_none() {
                // What is taken must find room on its way back.
                if self.questions.is_empty() || self.back.slots() < GROUPS + 1 {
                    return true;
                }
                self.question = self.questions.pop().ok();
                self.question.iter_mut().for_each(|question| question.begin());
            }
            while let Some(question) = &mut self.question
                && let Some(ask) = question.next()
            {
                if *left == 0 {
                    return false;
                }
                *left -= 1;
                question.answer(m.answer(blocks, state, ask).unwrap_or_else(Answer::Refused));
            }
            if let Some(question) = self.question.take() {
                let _ = self.back.push(Back::Job(Job::Question(question)));
            }
        }
    }

    /// Takes orders up to the next group, and lands that; false when there is none for this scan.
    fn one_group(&mut self, m: &mut Machine, state: OperatingState, left: &mut usize) -> bool {
        let Some(place) = self.landed.iter().position(Option::is_none) else { return false };
        let mut listed = false;
        loop {
            // Everything taken must find room on its way back.
            if self.back.slots() < GROUPS + 1 {
                return false;
            }
            match self.orders.peek() {
                Ok(Order::Job(Job::Group(group))) if group.bytes > *left => return false,
                // One list per call: each takes time.
                Ok(Order::Job(Job::List(_) | Job::Alarms(_))) if listed => return false,
                _ => {}
            }
            let job = match self.orders.pop() {
                Ok(Order::Job(job)) => job,
                Ok(Order::Watch(watch)) => {
                    if let Some(old) = self.watch.replace(watch) {
                        let _ = self.back.push(Back::OldWatch(old));
                    }
                    continue;
                }
                Ok(Order::Forget(id)) => {
                    m.watching.forget(self.place, id);
                    if let Some(job) = m.points.forget(self.place, id) {
                        let _ = self.back.push(Back::Job(Job::Point(job)));
                    }
                    continue;
                }
                Err(_) => return false,
            };
            let done = match job {
                Job::Group(mut group) => {
                    *left -= group.bytes;
                    group.land(m);
                    m.put_forced();
                    self.landed[place] = Some(group);
                    return true;
                }
                Job::List(mut listing) => {
                    listing.ask(m, state);
                    listed = true;
                    Some(Job::List(listing))
                }
                Job::Alarms(mut job) => {
                    let time = m.alarm_time();
                    job.carry_out(&mut m.alarms, time);
                    listed = true;
                    Some(Job::Alarms(job))
                }
                Job::Pass(mut job) => {
                    job.link = self.place;
                    m.watching.take(job, m.hot.now).map(Job::Pass)
                }
                Job::Debug(mut job) => {
                    job.link = self.place;
                    m.debugging.take(job).map(Job::Debug)
                }
                Job::Point(mut job) => {
                    job.link = self.place;
                    m.points.take(job).map(Job::Point)
                }
                // It has a ring of its own.
                Job::Question(question) => Some(Job::Question(question)),
            };
            if let Some(job) = done {
                let _ = self.back.push(Back::Job(job));
            }
        }
    }

    fn snapshot(&mut self, m: &mut Machine, scan: u64, state: OperatingState) {
        let Some(watch) = self.watch.as_deref().filter(|watch| !watch.steps.is_empty()) else { return };
        let mark = Mark { generation: watch.generation, scan, time: m.real(), state };
        self.window.put(mark, &mut |words| watch.fill(m, words));
    }

    fn answers(&mut self, scan: u64) {
        for place in &mut self.landed {
            if let Some(mut group) = place.take() {
                group.scan = scan;
                let _ = self.back.push(Back::Job(Job::Group(group)));
            }
        }
    }
}
