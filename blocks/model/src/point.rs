//! Test functions: cells that are read and written together at one point of a cycle.

use crate::{Piece, Put};

/// The test functions of S7 communication that are served, for those who serve them and for status list 0131/2.
pub const TEST_FUNCTIONS: [u8; 19] =
    [0x01, 0x02, 0x03, 0x04, 0x05, 0x07, 0x08, 0x09, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x10, 0x11, 0x12, 0x13, 0x16];

/// Jobs at one time in a CPU.
pub const POINT_JOBS: usize = 16;

/// A point of a cycle. In STOP, begin and end come in each round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Point {
    /// The next cycle control point.
    Now,
    /// The begin of the cycle: the process image of the inputs has been read.
    Start,
    /// The end of the cycle: the process image of the outputs has not been written yet.
    End,
    /// The CPU goes from RUN to STOP.
    Stop,
}

/// One thing to do at a point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PointItem {
    /// Reads this piece of memory.
    Read(Piece),
    /// Writes this value or these bytes.
    Write(Put),
}

/// What is to be done at a point; each item has an outcome of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointOrder {
    /// The point of the cycle.
    pub point: Point,
    /// Each time, until nobody wants it any more; it has no answer until then.
    pub stays: bool,
    /// What is done, in this order.
    pub items: Vec<PointItem>,
}
