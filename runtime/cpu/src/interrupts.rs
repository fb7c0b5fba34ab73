//! Interrupts by time and by modules: what is due, what waits, what is lost. Pure state; [`crate::context::Context`]
//! runs the blocks.
//!
//! Times are the CPU's own `now`. A due time is absolute: lateness of one interrupt does not move the next.
//! ["Organization Blocks" of the system software reference]

use ob1_time::{Instant, Span};

use crate::{CyclicInterrupt, Missed};

/// Interrupt OBs that have a place here: 10-17, 20-23, 30-38, 40-47.
pub(crate) const SLOTS: usize = 29;
/// The first slot of each class.
const DELAY: usize = 8;
const CYCLIC: usize = 12;
const HARDWARE: usize = 21;
/// Hardware interrupts that can wait.
const QUEUE: usize = 16;
/// Diagnostic interrupts that can wait.
const DIAGNOSES: usize = 16;
/// A due time that never comes.
pub(crate) const NEVER: Instant = Instant::NEVER;

/// The slot of an organization block.
pub(crate) const fn slot_of(ob: u16) -> Option<usize> {
    Some(match ob {
        10..=17 => ob as usize - 10,
        20..=23 => ob as usize - 20 + DELAY,
        30..=38 => ob as usize - 30 + CYCLIC,
        40..=47 => ob as usize - 40 + HARDWARE,
        _ => return None,
    })
}

/// The organization block of a slot.
pub(crate) const fn ob_of(slot: usize) -> u16 {
    match slot {
        0..DELAY => slot as u16 + 10,
        DELAY..CYCLIC => (slot - DELAY) as u16 + 20,
        CYCLIC..HARDWARE => (slot - CYCLIC) as u16 + 30,
        _ => (slot - HARDWARE) as u16 + 40,
    }
}

/// The priority class of an organization block while the CPU is in RUN.
pub(crate) const fn priority_of(ob: u16) -> u8 {
    match ob {
        1 => 1,
        10..=17 => 2,
        20..=23 => 3 + (ob - 20) as u8,
        30..=38 => 7 + (ob - 30) as u8,
        40..=47 => 16 + (ob - 40) as u8,
        88 => 28,
        100..=102 => 27,
        _ => 26,
    }
}

/// Intervals of OB 30 to 38 in milliseconds when nothing else is configured.
pub(crate) const DEFAULT_MS: [u64; 9] = [5000, 2000, 1000, 500, 200, 100, 50, 20, 10];

/// A hardware interrupt that waits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Hardware {
    pub(crate) slot: u8,
    /// The outputs' address, not the inputs'.
    pub(crate) output: bool,
    pub(crate) address: u16,
    pub(crate) point: u32,
    /// When the module raised it.
    pub(crate) at: Instant,
}

/// A request whose turn has come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    pub(crate) slot: usize,
    /// When it should have started.
    pub(crate) due: Instant,
    pub(crate) hardware: Hardware,
}

/// A time-delay interrupt under way.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Delay {
    /// SIGN and DTIME of its start information.
    pub(crate) sign: u16,
    pub(crate) ms: u32,
}

/// The timing of one of OB 30 to 38.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cyclic {
    pub(crate) period: Span,
    pub(crate) phase: Span,
    missed: Missed,
    loaded: bool,
}

/// What the passed due times have led to, one bit per slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Passed {
    /// Due while its OB was still being executed.
    pub(crate) running: u32,
    /// Due while a request was waiting already.
    pub(crate) waiting: u32,
    /// Time-of-day and time-delay interrupts whose time has come.
    pub(crate) elapsed: u32,
}

/// All interrupts of a CPU: what is due and what waits.
#[derive(Debug)]
pub(crate) struct Interrupts {
    /// The CPU is in RUN: requests are served.
    active: bool,
    due: [Instant; HARDWARE],
    /// The least of `due` while active.
    next_due: Instant,
    pending: u32,
    running: u32,
    /// When the pending request was due.
    asked: [Instant; HARDWARE],
    cyclic: [Cyclic; HARDWARE - CYCLIC],
    pub(crate) delays: [Delay; CYCLIC - DELAY],
    queue: [Hardware; QUEUE],
    queued: usize,
    /// Periods and requests lost, by slot.
    pub(crate) overruns: [u64; SLOTS],
}

impl Interrupts {
    /// `loaded` says which organization blocks there are.
    pub(crate) fn new(configured: &[CyclicInterrupt], loaded: impl Fn(u16) -> bool) -> Self {
        let cyclic = std::array::from_fn(|i| {
            let ob = 30 + i as u16;
            let default = CyclicInterrupt::new(ob, Span::from_millis(DEFAULT_MS[i]));
            let c = configured.iter().find(|c| c.ob == ob).unwrap_or(&default);
            Cyclic { period: c.period.max(Span::from_nanos(1)), phase: c.phase, missed: c.missed, loaded: loaded(ob) }
        });
        Self {
            active: false,
            due: [NEVER; HARDWARE],
            next_due: NEVER,
            pending: 0,
            running: 0,
            asked: [Instant::START; HARDWARE],
            cyclic,
            delays: [Delay::default(); CYCLIC - DELAY],
            queue: [Hardware::default(); QUEUE],
            queued: 0,
            overruns: [0; SLOTS],
        }
    }

    /// Another program: these organization blocks are loaded now. In RUN the intervals of new ones begin, and those
    /// that are gone are no longer due.
    pub(crate) fn loaded(&mut self, now: Instant, loaded: impl Fn(u16) -> bool) {
        for ((ob, cyclic), due) in (30..).zip(&mut self.cyclic).zip(&mut self.due[CYCLIC..]) {
            let begins = loaded(ob) && !cyclic.loaded && self.active;
            cyclic.loaded = loaded(ob);
            if begins {
                *due = now.saturating_add(cyclic.period).saturating_add(cyclic.phase);
            }
        }
        for slot in (10..=38).filter(|ob| !loaded(*ob)).filter_map(slot_of) {
            self.withdraw(slot);
        }
        self.settle();
    }

    /// Interval and phase of a cyclic interrupt.
    pub(crate) fn cyclic(&self, slot: usize) -> Cyclic {
        self.cyclic[slot - CYCLIC]
    }

    /// Nothing is due and nothing waits any more: a start-up begins.
    pub(crate) fn clear(&mut self) {
        self.active = false;
        self.due = [NEVER; HARDWARE];
        (self.next_due, self.pending, self.running, self.queued) = (NEVER, 0, 0, 0);
    }

    /// RUN begins: so do the intervals of the cyclic interrupts. Each comes for the first time after its interval and
    /// phase.
    pub(crate) fn start(&mut self, now: Instant) {
        for (due, c) in self.due[CYCLIC..].iter_mut().zip(&self.cyclic) {
            *due = if c.loaded { now.saturating_add(c.period).saturating_add(c.phase) } else { NEVER };
        }
        self.active = true;
        self.running = 0;
        self.settle();
    }

    /// RUN ends: nothing is served until the next start.
    pub(crate) fn stop(&mut self) {
        self.active = false;
        self.next_due = NEVER;
        self.running = 0;
    }

    /// Requests are served: the CPU is in RUN.
    pub(crate) fn is_active(&self) -> bool {
        self.active
    }

    /// A time-of-day or time-delay interrupt is cancelled: it is not due, and a request of it does not wait.
    pub(crate) fn withdraw(&mut self, slot: usize) {
        self.pending &= !(1 << slot);
        self.set_due(slot, NEVER);
    }

    /// Sets when a time-of-day or time-delay interrupt is due.
    pub(crate) fn set_due(&mut self, slot: usize, due: Instant) {
        self.due[slot] = due;
        self.settle();
    }

    /// Its time has come, and [`Interrupts::collect`] has not run since.
    pub(crate) fn is_due(&self, slot: usize, now: Instant) -> bool {
        self.due[slot] <= now
    }

    fn settle(&mut self) {
        self.next_due = if self.active { self.due.iter().copied().min().unwrap_or(NEVER) } else { NEVER };
    }

    /// When the next interrupt by time comes.
    pub(crate) fn next_due(&self) -> Instant {
        self.next_due
    }

    /// Something is due or waits.
    #[inline]
    pub(crate) fn wants(&self, now: Instant) -> bool {
        self.next_due <= now || self.pending != 0 && self.active
    }

    /// Turns due times that have passed into requests.
    pub(crate) fn collect(&mut self, now: Instant) -> Passed {
        let mut passed = Passed::default();
        if self.next_due > now {
            return passed;
        }
        for slot in 0..HARDWARE {
            let due = self.due[slot];
            if due > now {
                continue;
            }
            let bit = 1 << slot;
            let mut keep = true;
            if slot >= CYCLIC {
                let c = self.cyclic[slot - CYCLIC];
                // Intervals that passed before the CPU could look are skipped and counted.
                let skipped = (now - due) / c.period;
                self.overruns[slot] += skipped;
                self.due[slot] = due.saturating_add(c.period.times(skipped + 1));
                keep = c.missed == Missed::CatchUp;
            } else {
                self.due[slot] = NEVER;
                passed.elapsed |= bit;
            }
            if (self.pending | self.running) & bit != 0 {
                self.overruns[slot] += 1;
                if self.pending & bit != 0 {
                    passed.waiting |= bit;
                } else {
                    passed.running |= bit;
                }
                if !keep {
                    continue;
                }
            }
            if self.pending & bit == 0 {
                self.asked[slot] = due;
            }
            self.pending |= bit;
        }
        self.settle();
        passed
    }

    /// Enters a hardware interrupt; `false`, and counted as lost, when no more can wait.
    pub(crate) fn fire(&mut self, request: Hardware) -> bool {
        let slot = usize::from(request.slot);
        let Some(place) = self.queue.get_mut(self.queued) else {
            self.overruns[slot] += 1;
            return false;
        };
        *place = request;
        self.queued += 1;
        self.pending |= 1 << slot;
        true
    }

    /// The request of the highest class above `priority`; it counts as running until [`Interrupts::done`].
    pub(crate) fn take(&mut self, priority: u8) -> Option<Request> {
        if self.pending == 0 || !self.active {
            return None;
        }
        // Classes ascend with the slots, except for the time-of-day interrupts, which share one.
        let highest = 31 - self.pending.leading_zeros() as usize;
        let slot = if highest < DELAY { self.pending.trailing_zeros() as usize } else { highest };
        if priority_of(ob_of(slot)) <= priority {
            return None;
        }
        let mut hardware = Hardware::default();
        let mut more = false;
        if slot >= HARDWARE {
            let waiting = &mut self.queue[..self.queued];
            let first = waiting.iter().position(|h| usize::from(h.slot) == slot)?;
            hardware = waiting[first];
            more = waiting[first + 1..].iter().any(|h| usize::from(h.slot) == slot);
            waiting.copy_within(first + 1.., first);
            self.queued -= 1;
        }
        if !more {
            self.pending &= !(1 << slot);
        }
        self.running |= 1 << slot;
        let due = self.asked.get(slot).copied().unwrap_or(hardware.at);
        Some(Request { slot, due, hardware })
    }

    /// Requests of these slots are lost: their OBs are locked.
    pub(crate) fn cancel(&mut self, locked: impl Fn(u16) -> bool) {
        for slot in 0..SLOTS {
            if self.pending & 1 << slot == 0 || !locked(ob_of(slot)) {
                continue;
            }
            self.pending &= !(1 << slot);
            let mut kept = 0;
            for i in 0..self.queued {
                if usize::from(self.queue[i].slot) != slot {
                    self.queue[kept] = self.queue[i];
                    kept += 1;
                }
            }
            self.queued = kept;
        }
    }

    /// The OB of this slot has ended.
    pub(crate) fn done(&mut self, slot: usize) {
        self.running &= !(1 << slot);
    }
}

/// Diagnostic interrupts that wait: an OB of their class runs, and one of its blocks reports another.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Diagnoses {
    list: [(u32, [u8; 4]); DIAGNOSES],
    len: usize,
    /// Those that have waited are being served.
    pub(crate) serving: bool,
}

impl Diagnoses {
    /// False when no more can wait.
    pub(crate) fn put(&mut self, address: u32, data: [u8; 4]) -> bool {
        let Some(place) = self.list.get_mut(self.len) else { return false };
        *place = (address, data);
        self.len += 1;
        true
    }

    /// The one that has waited longest.
    pub(crate) fn take(&mut self) -> Option<(u32, [u8; 4])> {
        let first = *self.list[..self.len].first()?;
        self.list.copy_within(1..self.len, 0);
        self.len -= 1;
        Some(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn nanos(nanos: u64) -> Span {
        Span::from_nanos(nanos)
    }

    const fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    fn with(missed: Missed) -> Interrupts {
        let ob35 = CyclicInterrupt { phase: nanos(3), missed, ..CyclicInterrupt::new(35, nanos(10)) };
        let mut interrupts = Interrupts::new(&[ob35], |ob| ob == 35 || ob == 40);
        interrupts.start(at(100));
        interrupts
    }

    #[test]
    fn every_ob_has_its_slot_and_classes_ascend() {
        for slot in 0..SLOTS {
            assert_eq!(slot_of(ob_of(slot)), Some(slot));
        }
        let classes: Vec<_> = (DELAY - 1..SLOTS).map(|slot| priority_of(ob_of(slot))).collect();
        assert!(classes.windows(2).all(|pair| pair[0] < pair[1]), "{classes:?}");
        assert_eq!([18, 29, 39, 48].map(slot_of), [None; 4]);
    }

    #[test]
    fn due_times_are_absolute_and_skipped_periods_are_counted() {
        let mut i = with(Missed::CatchUp);
        assert_eq!(i.next_due(), at(113));
        assert!(!i.wants(at(112)) && i.wants(at(113)));
        assert_eq!(i.collect(at(115)), Passed::default());
        assert_eq!((i.next_due(), i.take(12).is_none()), (at(123), true), "not above its own class");
        let request = i.take(11).expect("due");
        assert_eq!((ob_of(request.slot), request.due), (35, at(113)));
        i.done(request.slot);
        assert_eq!(i.collect(at(145)), Passed::default());
        assert_eq!((i.overruns[request.slot], i.next_due()), (2, at(153)), "123 is late, 133 and 143 are lost");
    }

    #[test]
    fn due_while_running_is_caught_up_once_or_skipped() {
        for (missed, again) in [(Missed::CatchUp, true), (Missed::Skip, false)] {
            let mut i = with(missed);
            i.collect(at(113));
            let slot = i.take(1).expect("due").slot;
            assert_eq!(i.collect(at(123)), Passed { running: 1 << slot, ..Passed::default() });
            i.done(slot);
            assert_eq!((i.take(1).is_some(), i.overruns[slot]), (again, 1), "{missed:?}");
        }
    }

    #[test]
    fn hardware_interrupts_queue_in_their_order() {
        let mut i = with(Missed::Skip);
        let slot = slot_of(40).expect("a slot");
        for point in 0..QUEUE as u32 {
            assert!(i.fire(Hardware { slot: slot as u8, point, ..Hardware::default() }));
        }
        assert!(!i.fire(Hardware { slot: slot as u8, ..Hardware::default() }));
        for point in 0..QUEUE as u32 {
            assert_eq!(i.take(1).map(|r| r.hardware.point), Some(point));
            i.done(slot);
        }
        assert_eq!((i.take(1).is_none(), i.overruns[slot]), (true, 1));
    }
}
