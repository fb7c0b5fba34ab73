//! Services of a programming device that wait for the CPU.

use super::alarms::Wanted;
use super::messages::LogOn;
use super::test_jobs::Ending;
use super::var::Slot;
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
    /// Cyclic data: the first answer, or a message.
    Cyclic {
        first: bool,
        job: u8,
        sub: u8,
        slots: Vec<Slot>,
    },
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
