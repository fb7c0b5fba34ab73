//! Services of a programming device that wait for the CPU.

use super::alarms::Wanted;
use super::messages::LogOn;
use super::test_jobs::Ending;
use super::var::ReadItem;
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
        wanted: Vec<ReadItem>,
    },
    /// A message of a cyclic job.
    CyclicDue,
    /// Messages are subscribed to.
    LogOn(LogOn),
    AlarmQuery(Wanted),
    /// Alarms are acknowledged, locked, unlocked; the function of the request comes back.
    AlarmOrder {
        sub: u8,
        function: u8,
    },
    /// A service of the test functions.
    Test(Ending),
}
