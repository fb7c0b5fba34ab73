//! The steps of the runtime: its scan, and its supervisor.

use super::{ABSENT, Break, Driver, Protocol, READY, W, Whole};

impl Protocol {
    /// One step of the scan: it posts an order, waits for its echo, writes 0, waits for the end. Orders are numbered.
    pub(super) fn scan(&self, s: &mut Whole) {
        let (posts, before) = (s.scan < 10, s.scan);
        s.scan = match s.scan {
            0 | 10 => {
                if posts {
                    (s.posted_to, s.failed) = (s.get(W::Generation), false);
                }
                s.set(W::OutSequence, s.get(W::OutSequence) + 1);
                s.scan + 1
            }
            1 | 11 => {
                s.set(W::Out0, if posts { s.tagged() } else { 0 });
                s.scan + 1
            }
            2 | 12 => {
                s.set(W::Out1, if posts { s.tagged() } else { 0 });
                s.scan + 1
            }
            3 | 13 => {
                s.set(W::OutSequence, s.get(W::OutSequence) + 1);
                s.scan + 1
            }
            4 | 14 => {
                s.set(W::Changes, s.get(W::Changes) + 1);
                s.scan + 1
            }
            5 | 15 => {
                if s.get(W::Sleeping) == 0 {
                    if posts { 20 } else { 30 }
                } else {
                    s.scan + 1
                }
            }
            6 | 16 => {
                s.set(W::Sleeping, 0);
                s.scan + 1
            }
            7 | 17 => {
                s.bell = true;
                if posts { 20 } else { 30 }
            }
            20 | 30 => {
                (s.c0, s.c1, s.a) = (0, 0, s.get(W::InSequence));
                if s.a % 2 == 1 { s.scan } else { s.scan + 1 }
            }
            21 | 31 => {
                s.c0 = s.get(W::In0);
                s.scan + 1
            }
            22 | 32 => {
                s.c1 = s.get(W::In1);
                s.scan + 1
            }
            23 | 33 => {
                if s.get(W::InSequence) == s.a {
                    if s.c0 != s.c1 {
                        s.breaks(19);
                    }
                    s.scan + 1
                } else {
                    s.scan - 3
                }
            }
            24 | 34 => {
                // The state, and then the generation: two loads in this order, of which only the first can be early.
                if self.break_ != Break::AsksFirst {
                    s.is_present = s.get(W::State) == READY;
                }
                s.scan + 1
            }
            25 => {
                s.failed |= s.get(W::Generation) != s.posted_to || !s.is_present;
                if s.failed || s.c0 == s.tagged() { 10 } else { 20 }
            }
            _ => {
                if self.break_ != Break::AsksFirst {
                    s.is_present &= s.get(W::Generation) == s.posted_to;
                }
                s.failed |= !s.is_present;
                if !s.failed && s.c0 != 0 {
                    30
                } else {
                    if !s.failed && s.executed[usize::from(s.order)] != 1 {
                        let rule = if self.break_ == Break::ClearsFirst { 101 } else { 102 };
                        s.breaks(rule);
                    }
                    // What was posted to no driver or to a dead one was not executed by its successor.
                    s.order += 1;
                    0
                }
            }
        };
        // Asked before the registers are read, and not again when the copy was torn.
        if self.break_ == Break::AsksFirst && matches!(s.scan, 20 | 30) && !matches!(before, 20 | 23 | 30 | 33) {
            s.is_present = s.get(W::State) == READY && s.get(W::Generation) == s.posted_to;
        }
        if !matches!(s.scan, 20..40) {
            (s.a, s.c0, s.c1, s.is_present) = (0, 0, 0, false);
        }
    }

    /// One step of the supervisor after a death: the words of the dead driver, and a new process.
    pub(super) fn supervisor(&self, s: &mut Whole) {
        let state_first = self.break_ != Break::ClearsFirst;
        s.supervisor = match s.supervisor {
            1 => {
                if state_first {
                    s.set(W::State, ABSENT);
                }
                2
            }
            2 => {
                let before = s.get(W::InSequence);
                s.set(W::InSequence, if before.is_multiple_of(2) { before + 1 } else { before + 2 });
                3
            }
            3 => {
                s.set(W::In0, 0);
                4
            }
            4 => {
                s.set(W::In1, 0);
                5
            }
            5 => {
                s.set(W::InSequence, s.get(W::InSequence) + 1);
                6
            }
            6 => {
                s.set(W::State, ABSENT);
                s.set(W::Sleeping, 0);
                7
            }
            _ => {
                // A driver that died in its attaching may have cleared nothing; here the successor must do it alone.
                s.drivers[0] = Driver { alive: true, ..Driver::default() };
                0
            }
        };
    }
}
