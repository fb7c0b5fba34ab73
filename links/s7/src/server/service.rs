//! Services of a programming device that wait for the CPU.

use super::test_jobs::Ending;
use super::var::Wanted;
use crate::wire::BlockType;

/// A service that waits for the CPU.
#[derive(Debug)]
pub(super) enum Service {
    Szl {
        id: u16,
        index: u16,
    },
    Counts,
    List(BlockType),
    Info,
    Clock {
        sub: u8,
    },
    SetClock {
        sub: u8,
    },
    Password {
        sub: u8,
    },
    /// The answer to a cyclic job.
    Cyclic {
        job: u8,
        sub: u8,
        wanted: Vec<Wanted>,
    },
    /// A message of a cyclic job.
    CyclicDue,
    /// A service of the test functions.
    Test(Ending),
}
