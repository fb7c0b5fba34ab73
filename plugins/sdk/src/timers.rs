//! S5 timers and counters.

use crate::abi;

use crate::Cx;
use crate::reply::{Reply, reply};

/// The five S5 timers, by their German mnemonics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum TimerKind {
    /// `SI`, pulse: at most its time, while the input is 1.
    Pulse = abi::TIMER_PULSE,
    /// `SV`, extended pulse: its whole time from an edge on.
    ExtendedPulse = abi::TIMER_EXTENDED_PULSE,
    /// `SE`, on-delay: its time after the edge, while the input is 1.
    OnDelay = abi::TIMER_ON_DELAY,
    /// `SS`, retentive on-delay: its time after the edge, until it is reset.
    RetentiveOnDelay = abi::TIMER_RETENTIVE_ON_DELAY,
    /// `SA`, off-delay: its time after the input went to 0.
    OffDelay = abi::TIMER_OFF_DELAY,
}

/// A timer as `U T`, `L T` and `LC T` see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timer {
    /// Result of scanning it.
    pub output: bool,
    /// True while it runs.
    pub running: bool,
    /// Remaining time as S5TIME.
    pub remaining: u16,
}

impl<M> Cx<'_, M> {
    /// What the statement `kind T number` does with this result of logic operation; an edge of `rlo` between two calls
    /// starts the timer. `s5time` is an S5TIME: `0x0010` is 100 ms.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `Outside` when the CPU has no such timer.
    pub fn timer_run(&mut self, number: u16, kind: TimerKind, rlo: bool, s5time: u16) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: `host` and `call` belong to the running entry (Cx::new).
        reply(unsafe { (host.timer_run)(call, number, kind as u8, u8::from(rlo), s5time) })
    }

    /// Stops a timer, as `R T` does: time and output are 0.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `Outside`: there is no timer of this number.
    pub fn timer_reset(&mut self, number: u16) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: as in `timer_run`.
        reply(unsafe { (host.timer_reset)(call, number) })
    }

    /// Reads a timer without changing it.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `Outside`: there is no timer of this number.
    pub fn timer(&mut self, number: u16) -> Reply<Timer> {
        let ((host, call), size) = (self.edge(), size_of::<abi::TimerInfo>() as u32);
        let mut info = abi::TimerInfo { size, ..Default::default() };
        // SAFETY: as in `timer_run`; the size is set.
        let status = unsafe { (host.timer_get)(call, number, &raw mut info) };
        Ok(reply(status)?.map(|()| Timer {
            output: info.output != 0,
            running: info.running != 0,
            remaining: info.remaining,
        }))
    }

    /// Reads a counter, 0 to 999.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `Outside` when the CPU has no such counter.
    pub fn counter(&mut self, number: u16) -> Reply<u16> {
        let ((host, call), mut value) = (self.edge(), 0);
        // SAFETY: as in `timer_run`.
        let status = unsafe { (host.counter_get)(call, number, &raw mut value) };
        Ok(reply(status)?.map(|()| value))
    }

    /// Reads a counter as three BCD digits, as `LC` loads it.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `Outside`: there is no counter of this number.
    pub fn counter_bcd(&mut self, number: u16) -> Reply<u16> {
        let digit = |value: u16, power: u16| value / power % 10;
        Ok(self.counter(number)?.map(|value| digit(value, 100) << 8 | digit(value, 10) << 4 | digit(value, 1)))
    }

    /// Sets a counter, 0 to 999.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `Outside`: there is no counter of this number.
    pub fn set_counter(&mut self, number: u16, value: u16) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: as in `timer_run`.
        reply(unsafe { (host.counter_set)(call, number, value) })
    }
}
