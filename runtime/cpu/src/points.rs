//! Cells that are read and written at a point of the cycle: variable tables of programming devices.
//!
//! A job comes as a box with room for its answer, so that the scan allocates nothing. Without one, a point of the cycle
//! is a look at a byte.

use ob1_model::{POINT_JOBS, Piece, Point, PointItem, PointOrder};

use crate::exchange::{Exchange, Job};
use crate::machine::Machine;
use crate::{CellError, Cpu, cells};

/// A job, with room for its answer.
#[derive(Debug)]
pub struct PointJob {
    id: u64,
    order: PointOrder,
    /// The place of its link.
    pub(crate) link: usize,
    /// What was read, one after the other.
    bytes: Vec<u8>,
    outcomes: Vec<Result<(), CellError>>,
    full: bool,
}

impl PointJob {
    /// A job with the link's own number.
    #[must_use]
    pub fn new(id: u64, order: PointOrder) -> Self {
        let len = order.items.iter().map(read_bytes).sum();
        let (bytes, outcomes) = (Vec::with_capacity(len), Vec::with_capacity(order.items.len()));
        Self { id, order, link: 0, bytes, outcomes, full: false }
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// There were [`POINT_JOBS`] already.
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.full
    }

    /// What became of each item: the bytes read, none of a write. Nothing at all if its point has not come.
    pub fn outcomes(&self) -> impl Iterator<Item = Result<&[u8], CellError>> {
        let mut at = 0;
        self.order.items.iter().zip(&self.outcomes).map(move |(item, outcome)| {
            let from = at;
            at += read_bytes(item);
            outcome.map(|()| self.bytes.get(from..at).unwrap_or_default())
        })
    }

    fn run(&mut self, m: &mut Machine) {
        self.bytes.clear();
        self.outcomes.clear();
        for item in &self.order.items {
            let outcome = match item {
                PointItem::Write(put) => cells::put(m, put),
                PointItem::Read(piece) => read(m, *piece, &mut self.bytes),
            };
            if outcome.is_err() {
                let len = self.bytes.len() + read_bytes(item);
                self.bytes.resize(len, 0);
            }
            self.outcomes.push(outcome);
        }
    }
}

fn read_bytes(item: &PointItem) -> usize {
    match item {
        PointItem::Read(piece) => piece.len() as usize,
        PointItem::Write(_) => 0,
    }
}

fn read(m: &mut Machine, piece: Piece, into: &mut Vec<u8>) -> Result<(), CellError> {
    match piece {
        Piece::Bytes { at, len } => {
            let place = cells::place(m, at, len, false)?;
            into.extend_from_slice(m.memory.bytes.get(place).ok_or(CellError::Outside)?);
        }
        Piece::Value(cell, width) => {
            let value = cells::read(m, cell, width)?.to_be_bytes();
            into.extend_from_slice(value.get(4 - width.bytes() as usize..).unwrap_or_default());
        }
    }
    Ok(())
}

/// The places of jobs.
#[derive(Debug, Default)]
pub(crate) struct Points {
    jobs: [Option<Box<PointJob>>; POINT_JOBS],
    /// The points some job waits for.
    awaited: u8,
}

const fn bit(point: Point) -> u8 {
    1 << point as u8
}

impl Points {
    /// Takes a job, or gives it back.
    pub(crate) fn take(&mut self, mut job: Box<PointJob>) -> Option<Box<PointJob>> {
        let Some(place) = self.jobs.iter_mut().find(|place| place.is_none()) else {
            job.full = true;
            return Some(job);
        };
        self.awaited |= bit(job.order.point);
        *place = Some(job);
        None
    }

    /// Nobody waits for this job any more.
    pub(crate) fn forget(&mut self, link: usize, id: u64) -> Option<Box<PointJob>> {
        let mut job = self.jobs.iter_mut().find_map(|place| place.take_if(|job| (job.link, job.id) == (link, id)))?;
        self.look();
        // One that stays has no answer.
        job.outcomes.clear();
        Some(job)
    }

    fn look(&mut self) {
        self.awaited = self.jobs.iter().flatten().fold(0, |all, job| all | bit(job.order.point));
    }
}

impl Cpu {
    /// The cycle has come to a point.
    #[inline]
    pub(crate) fn point(&mut self, point: Point) {
        self.machine.point(point, &mut self.exchange);
    }
}

impl Machine {
    /// The same, in HOLD too.
    #[inline]
    pub(crate) fn point(&mut self, point: Point, exchange: &mut Exchange) {
        if self.points.awaited & bit(point) != 0 {
            self.jobs_at(point, exchange);
        }
    }

    #[cold]
    fn jobs_at(&mut self, point: Point, exchange: &mut Exchange) {
        let mut points = std::mem::take(&mut self.points);
        for place in &mut points.jobs {
            let Some(job) = place.as_mut().filter(|job| job.order.point == point) else { continue };
            job.run(self);
            if !job.order.stays
                && let Some(job) = place.take()
            {
                exchange.give_back(job.link, Job::Point(job));
            }
        }
        points.look();
        self.points = points;
    }
}
