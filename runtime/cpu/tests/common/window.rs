//! A window that a test looks through.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ob1_cpu::{
    Answer, Ask, CellError, Cpu, Frame, Group, Job, Link, Listing, Mark, OperatingState, Piece, Question, Window,
};
use ob1_model::FRAME_WORDS;
use ob1_time::Instant;

#[derive(Clone)]
struct Glass(Arc<([AtomicU64; 4], Vec<AtomicU64>)>);

impl Window for Glass {
    fn put(&mut self, mark: Mark, fill: &mut dyn FnMut(&[AtomicU64])) {
        fill(&self.0.1);
        let words = [mark.generation, mark.scan, mark.time.nanos(), mark.state.number().into()];
        self.0.0.iter().zip(words).for_each(|(to, word)| to.store(word, Ordering::Relaxed));
    }
}

/// A link with the window it looks through.
pub struct Looker {
    pub link: Link,
    glass: Glass,
    frames: Vec<Frame>,
}

impl Looker {
    pub fn of(cpu: &mut Cpu) -> Option<Self> {
        let glass = Glass(Arc::new((Default::default(), (0..FRAME_WORDS).map(|_| AtomicU64::new(0)).collect())));
        Some(Self { link: cpu.link(Box::new(glass.clone()))?, glass, frames: Vec::new() })
    }

    /// Watches these pieces; the generation counts from 1.
    pub fn watch(&mut self, pieces: &[Piece]) -> Result<u64, ob1_cpu::TooMuch> {
        let (frame, generation) = (Frame::of(pieces), self.link.generation() + 1);
        self.link.watch(generation, &frame)?;
        self.frames.push(frame);
        Ok(generation)
    }

    pub fn mark(&self) -> Option<Mark> {
        let [generation, scan, time, state] = self.glass.0.0.each_ref().map(|word| word.load(Ordering::Relaxed));
        (scan > 0).then(|| Mark { generation, scan, time: Instant::from_nanos(time), state: OperatingState::of(state) })
    }

    /// The bytes of a piece in the newest snapshot.
    pub fn piece(&self, index: usize) -> Result<Vec<u8>, CellError> {
        let generation = self.mark().expect("a snapshot").generation;
        let frame = &self.frames[generation as usize - 1];
        let mut bytes = Vec::new();
        let word = |at: usize| self.glass.0.1[at].load(Ordering::Relaxed);
        frame.read(index, 0, frame.pieces()[index].len(), word, &mut bytes).map(|()| bytes)
    }

    pub fn word(&self, index: usize) -> u16 {
        let bytes = self.piece(index).expect("there");
        u16::from_be_bytes([bytes[0], bytes[1]])
    }

    /// The next group that has come back.
    pub fn answer(&mut self) -> Option<Box<Group>> {
        loop {
            if let Job::Group(group) = self.link.take()? {
                return Some(group);
            }
        }
    }

    /// The next list.
    pub fn listing(&mut self) -> Option<Box<Listing>> {
        loop {
            if let Job::List(listing) = self.link.take()? {
                return Some(listing);
            }
        }
    }
}

/// A link that asks.
pub struct Client(pub Link);

impl Client {
    pub fn of(cpu: &mut Cpu) -> Self {
        Self(Looker::of(cpu).expect("a link").link)
    }

    pub fn ask(&mut self, id: u64, asks: impl Into<Vec<Ask>>) {
        self.0.hand(Question::new(id, asks.into())).expect("room");
    }

    /// The next question that has come back.
    pub fn take(&mut self) -> Option<Box<Question>> {
        loop {
            if let Job::Question(question) = self.0.take()? {
                return Some(question);
            }
        }
    }

    /// The first answer to it.
    pub fn answer(&mut self) -> Option<Answer> {
        self.take().map(|question| question.answers()[0])
    }
}
