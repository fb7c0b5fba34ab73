//! S5 timers: five kinds, started by edges, read as time passes. ["Timer Instructions" of the STL reference]
//!
//! A timer holds the time at which it runs out; nothing ticks. What it shows is a function of the CPU's own `now`.

use ob1_model::{FaultKind, S5Time, TimerKind};

use ob1_time::{Instant, Span};

use crate::TimerState;

/// An S5 timer: its kind, its end, and what its edges were.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Timer {
    /// The kind of the last start statement.
    pub kind: TimerKind,
    /// Runs, unless `end` has passed.
    pub running: bool,
    /// RLO at the last start statement.
    pub start_rlo: bool,
    /// RLO at the last `FR`.
    pub enable_rlo: bool,
    /// The signal state apart from the running time: elapsed on-delays, the input of an off-delay.
    pub latched: bool,
    /// Time base code, 0 to 3.
    pub base: u16,
    /// What is left while it does not run, in units of the base.
    pub rest: u16,
    /// When it runs out.
    pub end: Instant,
}

impl Default for Timer {
    fn default() -> Self {
        Self {
            kind: TimerKind::Pulse,
            running: false,
            start_rlo: false,
            enable_rlo: false,
            latched: false,
            base: 0,
            rest: 0,
            end: Instant::START,
        }
    }
}

impl Timer {
    fn unit(&self) -> Span {
        Span::MILLISECOND * S5Time(self.base << 12).base_ms().into()
    }

    fn runs(&self, now: Instant) -> bool {
        self.running && now < self.end
    }

    /// Notes that the time has run out, if it has.
    pub(crate) fn settle(&mut self, now: Instant) {
        if self.running && now >= self.end {
            self.running = false;
            self.rest = 0;
            self.latched |= matches!(self.kind, TimerKind::OnDelay | TimerKind::RetentiveOnDelay);
        }
    }

    fn start(&mut self, now: Instant, time: u16) -> Result<(), FaultKind> {
        let digits = S5Time(time).digits().ok_or(FaultKind::BcdConversion)?;
        self.base = time >> 12 & 3;
        self.end = now.saturating_add(self.unit() * u64::from(digits));
        self.rest = digits as u16;
        self.running = true;
        self.latched = false;
        self.settle(now);
        Ok(())
    }

    /// Stops and keeps what is left of the time.
    fn halt(&mut self, now: Instant) {
        self.rest = self.remaining(now);
        self.running = false;
    }

    /// `SI SV SE SS SA` with the RLO and the S5TIME in ACCU1-L.
    pub fn run(&mut self, kind: TimerKind, rlo: bool, time: u16, now: Instant) -> Result<(), FaultKind> {
        self.settle(now);
        let rising = rlo && !self.start_rlo;
        let falling = !rlo && self.start_rlo;
        self.start_rlo = rlo;
        self.kind = kind;
        match kind {
            TimerKind::Pulse | TimerKind::OnDelay => {
                if rising {
                    return self.start(now, time);
                }
                if !rlo {
                    self.latched = false;
                    if self.running {
                        self.halt(now);
                    }
                }
            }
            TimerKind::ExtendedPulse => {
                if rising {
                    return self.start(now, time);
                }
            }
            TimerKind::RetentiveOnDelay => {
                // Once elapsed it must be reset before it can be started again.
                if rising && !self.latched {
                    return self.start(now, time);
                }
            }
            TimerKind::OffDelay => {
                if falling {
                    return self.start(now, time);
                }
                if rising {
                    // Reset, not only stopped: the value is 0 while the RLO is 1 (decided in tests/cpu/timers.rs).
                    self.running = false;
                    self.rest = 0;
                    self.latched = true;
                }
            }
        }
        Ok(())
    }

    /// `R` with RLO = 1: time and signal state go to 0; edges are still remembered.
    pub fn reset(&mut self) {
        self.running = false;
        self.latched = false;
        self.rest = 0;
    }

    /// `FR`: a rising edge makes the next start statement with RLO = 1 (`SA`: 0) start again.
    pub fn enable(&mut self, rlo: bool) {
        if rlo && !self.enable_rlo {
            self.start_rlo = self.kind == TimerKind::OffDelay;
        }
        self.enable_rlo = rlo;
    }

    /// The signal state, `U T n`.
    #[inline]
    pub fn output(&self, now: Instant) -> bool {
        match self.kind {
            TimerKind::Pulse | TimerKind::ExtendedPulse => self.runs(now),
            TimerKind::OnDelay | TimerKind::RetentiveOnDelay => self.latched || self.running && now >= self.end,
            TimerKind::OffDelay => self.latched || self.runs(now),
        }
    }

    /// Units of the base that are left, rounded up; `L T n`.
    pub fn remaining(&self, now: Instant) -> u16 {
        if self.running { self.end.since(now).div_ceil(self.unit()).min(999) as u16 } else { self.rest }
    }

    /// The remaining time as S5TIME; `LC T n`.
    pub fn remaining_bcd(&self, now: Instant) -> u16 {
        self.base << 12 | to_bcd(self.remaining(now))
    }

    /// Sets the time from outside, as an S5TIME: a running timer continues with it, a stopped one shows it. False if it
    /// is not an S5TIME.
    pub(crate) fn preset(&mut self, time: u16, now: Instant) -> bool {
        let Some(digits) = S5Time(time).digits() else { return false };
        self.settle(now);
        self.base = time >> 12 & 3;
        self.rest = digits as u16;
        self.end = now.saturating_add(self.unit() * u64::from(digits));
        self.settle(now);
        true
    }

    /// Bytes of an image.
    pub(crate) const IMAGE: usize = 16;

    /// Moves the end by a time during which time stood still.
    pub(crate) fn shift(&mut self, by: Span) {
        if self.running {
            self.end = self.end.saturating_add(by);
        }
    }

    /// What is kept over a power cycle: kind, flags, base, and the time that is left.
    pub(crate) fn image(&self, now: Instant) -> [u8; Self::IMAGE] {
        let mut image = [0; Self::IMAGE];
        let kind = TimerKind::ALL.iter().position(|kind| *kind == self.kind).unwrap_or(0);
        let flags = [self.running, self.start_rlo, self.enable_rlo, self.latched];
        let bits = flags.into_iter().rev().fold(0, |bits, flag| bits << 1 | u8::from(flag));
        image[..3].copy_from_slice(&[kind as u8, bits, self.base as u8]);
        image[4..6].copy_from_slice(&self.rest.to_le_bytes());
        image[8..].copy_from_slice(&self.end.since(now).nanos().to_le_bytes());
        image
    }

    /// The timer of an image; `None` when the image is not one of a timer.
    pub(crate) fn from_image(image: &[u8], now: Instant) -> Option<Self> {
        let [kind, bits, base, _, low, high, _, _, left @ ..] = image else { return None };
        let flag = |n: u8| bits >> n & 1 == 1;
        let rest = u16::from_le_bytes([*low, *high]);
        if *bits > 0b1111 || *base > 3 || rest > 999 {
            return None;
        }
        let left = u64::from_le_bytes(left.try_into().ok()?);
        Some(Self {
            kind: *TimerKind::ALL.get(usize::from(*kind))?,
            running: flag(0),
            start_rlo: flag(1),
            enable_rlo: flag(2),
            latched: flag(3),
            base: u16::from(*base),
            rest,
            end: now.checked_add(Span::from_nanos(left))?,
        })
    }

    pub(crate) fn state(&self, now: Instant) -> TimerState {
        TimerState { output: self.output(now), running: self.runs(now), remaining: self.remaining_bcd(now) }
    }
}

/// A counter. ["Counter Instructions" of the STL reference]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Counter {
    /// Count value, 0 to 999.
    pub value: u16,
    /// RLO at the last `ZV`.
    pub up_rlo: bool,
    /// RLO at the last `ZR`.
    pub down_rlo: bool,
    /// RLO at the last `S`.
    pub set_rlo: bool,
    /// RLO at the last `FR`.
    pub enable_rlo: bool,
}

impl Counter {
    pub(crate) const MAX: u16 = 999;

    /// `ZV`: counts up at an edge of the RLO, to 999 at most.
    pub fn up(&mut self, rlo: bool) {
        if rlo && !self.up_rlo && self.value < Self::MAX {
            self.value += 1;
        }
        self.up_rlo = rlo;
    }

    /// `ZR`: counts down at an edge of the RLO, to 0 at least.
    pub fn down(&mut self, rlo: bool) {
        if rlo && !self.down_rlo && self.value > 0 {
            self.value -= 1;
        }
        self.down_rlo = rlo;
    }

    /// `S Z n` with three BCD digits in ACCU1-L.
    pub fn set(&mut self, rlo: bool, bcd: u16) -> Result<(), FaultKind> {
        let rising = rlo && !self.set_rlo;
        self.set_rlo = rlo;
        if rising {
            self.value = S5Time(bcd & 0x0FFF).digits().ok_or(FaultKind::BcdConversion)? as u16;
        }
        Ok(())
    }

    /// `FR`: a rising edge makes the next statement with RLO = 1 count or set again.
    pub fn enable(&mut self, rlo: bool) {
        if rlo && !self.enable_rlo {
            (self.up_rlo, self.down_rlo, self.set_rlo) = (false, false, false);
        }
        self.enable_rlo = rlo;
    }

    /// Bytes of an image.
    pub(crate) const IMAGE: usize = 4;

    /// What is kept over a power cycle.
    pub(crate) fn image(self) -> [u8; Self::IMAGE] {
        let [low, high] = self.value.to_le_bytes();
        let flags = [self.up_rlo, self.down_rlo, self.set_rlo, self.enable_rlo];
        [low, high, flags.into_iter().rev().fold(0, |bits, flag| bits << 1 | u8::from(flag)), 0]
    }

    /// The counter of an image; `None` when the image is not one of a counter.
    pub(crate) fn from_image(image: &[u8]) -> Option<Self> {
        let [low, high, bits, 0] = *image else { return None };
        let value = u16::from_le_bytes([low, high]);
        let flag = |n: u8| bits >> n & 1 == 1;
        (value <= Self::MAX && bits <= 0b1111).then(|| Self {
            value,
            up_rlo: flag(0),
            down_rlo: flag(1),
            set_rlo: flag(2),
            enable_rlo: flag(3),
        })
    }

    /// `LC Z n`: the value as three BCD digits.
    pub fn bcd(self) -> u16 {
        to_bcd(self.value)
    }
}

/// A value as three BCD digits.
pub(crate) const fn to_bcd(value: u16) -> u16 {
    (value / 100 % 10) << 8 | (value / 10 % 10) << 4 | (value % 10)
}
