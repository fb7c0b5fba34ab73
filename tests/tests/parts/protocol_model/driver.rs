//! The steps of a driver.

use super::{Break, Driver, Protocol, READY, STARTING, W, Whole};

// Steps of a driver.
const LOCK: u8 = 0;
const CLEAR: u8 = 3;
const BOOK: u8 = 8;
const GENERATION: u8 = 9;
const LOOP: u8 = 11;
const SLEEP: u8 = 17;
const CHECK: u8 = 18;
pub(super) const POLL: u8 = 19;
const AWAKE: u8 = 20;
const WRITE: u8 = 30;
const COMPLETE: u8 = 40;

impl Protocol {
    /// One step of a driver: one load or store.
    pub(super) fn driver(&self, s: &mut Whole, me: u8) {
        let mut d = s.drivers[usize::from(me)].clone();
        d.pc = match d.pc {
            LOCK => {
                if s.lock.is_some() && self.break_ != Break::NoLock {
                    d.alive = false;
                }
                if d.alive {
                    if s.lock.is_some() {
                        s.breaks(4);
                    }
                    s.lock = Some(me);
                }
                1
            }
            1 => {
                s.set(W::Sleeping, 0);
                2
            }
            2 => {
                s.set(W::State, STARTING);
                CLEAR
            }
            CLEAR if self.break_ == Break::NotCleared => BOOK,
            CLEAR => {
                (d.shows, d.then) = (0, BOOK);
                WRITE
            }
            BOOK => {
                if self.break_ != Break::NotBooked {
                    s.book_lost();
                }
                GENERATION
            }
            GENERATION => {
                if s.get(W::In0) != 0 || s.get(W::In1) != 0 {
                    s.breaks(6);
                }
                // What is not cleared is not ended either; the clearing is what is broken then.
                if s.get(W::InSequence) % 2 == 1 && self.break_ != Break::NotCleared {
                    s.breaks(10);
                }
                let before = s.get(W::Generation);
                if self.break_ != Break::SameGeneration {
                    s.set(W::Generation, before + 1);
                } else if before > 0 {
                    s.breaks(16);
                } else {
                    s.set(W::Generation, 1);
                }
                d.generation = s.get(W::Generation);
                10
            }
            10 => {
                s.set(W::State, READY);
                LOOP
            }
            LOOP => {
                if d.order == 0 && s.get(W::Accepted) != s.get(W::Sent) + s.get(W::Lost) {
                    s.breaks(11);
                }
                (d.mark, d.again) = (s.get(W::Changes), false);
                12
            }
            12 => {
                d.a = s.get(W::OutSequence);
                let is_odd = d.a % 2 == 1 && self.break_ != Break::TakesTorn;
                d.again = is_odd;
                if is_odd || d.a == d.seen { SLEEP } else { 13 }
            }
            13 => {
                d.c0 = s.get(W::Out0);
                14
            }
            14 => {
                d.c1 = s.get(W::Out1);
                15
            }
            15 => {
                let next = if s.get(W::OutSequence) == d.a {
                    self.take(s, &mut d)
                } else {
                    d.again = true;
                    SLEEP
                };
                (d.c0, d.c1) = (0, 0);
                next
            }
            SLEEP if self.break_ == Break::LooksTooSoon => {
                if s.get(W::Changes) == d.mark && !d.again {
                    21
                } else {
                    AWAKE
                }
            }
            21 => {
                s.set(W::Sleeping, 1);
                POLL
            }
            SLEEP => {
                s.set(W::Sleeping, 1);
                CHECK
            }
            CHECK => {
                if s.get(W::Changes) == d.mark && !d.again {
                    POLL
                } else {
                    AWAKE
                }
            }
            // Enabled when there is a byte or the end of the pipe.
            POLL => {
                s.bell = false;
                AWAKE
            }
            AWAKE => {
                s.set(W::Sleeping, 0);
                if !s.runtime_alive {
                    if self.break_ == Break::OutlivesRuntime {
                        s.breaks(25);
                    }
                    d.alive = false;
                    s.lock = None;
                }
                LOOP
            }
            // A write of the registers, under their sequence.
            WRITE => {
                d.a = s.get(W::InSequence);
                31
            }
            31 => {
                d.a = if d.a.is_multiple_of(2) || self.break_ == Break::StaysOdd { d.a + 1 } else { d.a + 2 };
                if self.break_ != Break::NoSequence {
                    s.set(W::InSequence, d.a);
                }
                32
            }
            32 => {
                s.set(W::In0, d.shows);
                33
            }
            33 => {
                s.set(W::In1, std::mem::take(&mut d.shows));
                34
            }
            34 => {
                s.set(W::InSequence, d.a + 1);
                std::mem::take(&mut d.then)
            }
            // A complete order: taken over, onto the line, done.
            COMPLETE => {
                s.set(W::Accepted, s.get(W::Accepted) + 1);
                41
            }
            41 => {
                self.execute(s, &d);
                42
            }
            _ => {
                s.set(W::Sent, s.get(W::Sent) + 1);
                (d.order, d.shows, d.then) = (0, 0, SLEEP);
                WRITE
            }
        };
        // What is not read again makes no states.
        if !matches!(d.pc, 13..=15 | 31..=34) {
            d.a = 0;
        }
        s.drivers[usize::from(me)] = if d.alive { d } else { Driver::default() };
    }

    fn execute(&self, s: &mut Whole, d: &Driver) {
        let count = &mut s.executed[usize::from(d.order % 4)];
        *count += 1;
        if *count > 1 {
            s.breaks(46);
        }
        if s.posted_to != d.generation {
            s.breaks(42);
        }
    }

    /// The driver has a copy of the output registers.
    fn take(&self, s: &mut Whole, d: &mut Driver) -> u8 {
        if d.c0 != d.c1 {
            s.breaks(21);
        }
        (d.seen, d.shows, d.then) = (d.a, d.c0, SLEEP);
        match (d.c0, d.order) {
            (0, 0) => SLEEP,
            (order, 0) if order / 4 != d.generation && self.break_ != Break::TakesOld => SLEEP,
            (order, 0) => {
                d.order = order;
                if self.break_ == Break::SendsTwice {
                    self.execute(s, d);
                }
                WRITE
            }
            (0, _) => COMPLETE,
            _ => SLEEP,
        }
    }
}
