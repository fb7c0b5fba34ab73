//! The master of one line or connection: it asks its couplers in turn, one request at a time.
//!
//! The owner passes in what happened and when, and sends the bytes it gets. It calls again at the time that
//! [`LineMaster::step`] returns, and when the outputs have changed.

use ob1_protocols::{Input, LineFault, LineInput};

use crate::config::{Instant, LineConfig};
use crate::coupler::{Coupler, Job};
use crate::image::{Image, State};
use crate::wire::{MasterInput, Outcome, Wire};

/// After this many consecutive requests without an answer a connection is reopened.
const SILENT: u32 = 3;

/// The master of one line.
pub struct LineMaster {
    wire: Wire,
    couplers: Vec<Coupler>,
    /// The coupler being asked, and the request.
    asked: Option<(usize, Job)>,
    /// It shows whether the coupler knows a function; asked at this time.
    probe: Option<Instant>,
    turn: usize,
    is_up: bool,
    silent: u32,
    reconnect: bool,
}

impl LineMaster {
    /// The master of a line whose couplers begin at `first` in [`Image::status`].
    pub fn new(config: &LineConfig, first: usize, input_bytes: usize, now: Instant) -> Self {
        let coupler = |(n, config)| Coupler::new(config, first + n, input_bytes, now);
        Self {
            wire: Wire::new(config),
            couplers: config.couplers.iter().enumerate().map(coupler).collect(),
            asked: None,
            probe: None,
            turn: 0,
            is_up: false,
            silent: 0,
            reconnect: false,
        }
    }

    /// Takes an event; `out` gets the bytes to send. Returns when to call again at the latest.
    pub fn step(&mut self, now: Instant, input: MasterInput<'_>, image: &mut Image, out: &mut Vec<u8>) -> Instant {
        match input {
            Input::Line(LineInput::Fault(LineFault::Back)) => {
                (self.is_up, self.reconnect, self.silent) = (true, false, 0);
                self.couplers.iter_mut().for_each(|coupler| coupler.connect(now));
            }
            Input::Line(LineInput::Fault(LineFault::Gone)) => {
                self.is_up = false;
                // It cannot be answered any more, which is no failure of the coupler.
                self.probe_is_over(now);
                if let Some((who, job)) = self.asked.take()
                    && let Some(coupler) = self.couplers.get_mut(who)
                {
                    coupler.unanswered(job);
                }
            }
            _ => {}
        }
        if let Some(outcome) = self.wire.step(now, input, out) {
            self.ended(now, outcome, image);
        }
        if self.probe.is_none() {
            self.couplers.iter_mut().for_each(|coupler| coupler.tick(now, image));
        }
        self.reconnect |= self.is_up && self.wire.is_broken();
        // A request that cannot even be sent has ended too.
        for _ in 0..=self.couplers.len() {
            if self.asked.is_some() || !self.is_up || self.reconnect {
                break;
            }
            let Some((who, job)) = self.choose(now, image) else { break };
            let Some(coupler) = self.couplers.get_mut(who) else { break };
            let telegram = coupler.telegram(job, image);
            self.probe = coupler.is_probe(job).then_some(now);
            self.asked = Some((who, job));
            if let Some(outcome) = self.wire.ask(now, &telegram, out) {
                self.ended(now, outcome, image);
            }
        }
        self.deadline(image)
    }

    /// Whether the connection must be closed and reopened: it is silent, or its input has no meaning. Reported once.
    pub fn wants_reconnect(&mut self) -> bool {
        std::mem::take(&mut self.reconnect) && {
            self.is_up = false;
            (self.asked, self.probe) = (None, None);
            true
        }
    }

    /// Whether every reachable coupler has the current outputs.
    pub fn has_told_outputs(&self, image: &Image) -> bool {
        let reached =
            |coupler: &&Coupler| image.status.get(coupler.index()).is_some_and(|status| status.state == State::Running);
        !self.is_up || self.couplers.iter().filter(reached).all(|coupler| coupler.has_outputs(image))
    }

    /// The next coupler with a request, beginning after the last one asked.
    fn choose(&mut self, now: Instant, image: &Image) -> Option<(usize, Job)> {
        let count = self.couplers.len();
        for step in 1..=count {
            let who = (self.turn + step) % count;
            if let Some(job) = self.couplers.get_mut(who).and_then(|coupler| coupler.next(now, image)) {
                self.turn = who;
                return Some((who, job));
            }
        }
        None
    }

    fn ended(&mut self, now: Instant, outcome: Outcome, image: &mut Image) {
        let was_probe = self.probe.is_some();
        self.probe_is_over(now);
        let Some((who, job)) = self.asked.take() else { return };
        let Some(coupler) = self.couplers.get_mut(who) else { return };
        match outcome {
            Outcome::Answer(answer) => {
                self.silent = 0;
                coupler.answered(now, job, &answer, image);
            }
            Outcome::Failed => {
                coupler.failed(now, job, image);
                self.silent = self.silent.saturating_add(u32::from(!was_probe));
                self.reconnect |= self.silent >= SILENT && self.wire.is_connection();
            }
        }
    }

    /// A request of a function that the coupler may not know has ended.
    fn probe_is_over(&mut self, now: Instant) {
        if let Some(since) = self.probe.take() {
            self.couplers.iter_mut().for_each(|coupler| coupler.forgive(now.since(since)));
        }
    }

    fn deadline(&self, image: &Image) -> Instant {
        let is_lost =
            |coupler: &Coupler| image.status.get(coupler.index()).is_some_and(|status| status.state == State::Lost);
        let busy = self.asked.is_some() || !self.is_up;
        let coupler = |coupler: &Coupler| match (busy, is_lost(coupler)) {
            (true, true) => Instant::NEVER,
            (true, false) if self.probe.is_some() => Instant::NEVER,
            (true, false) => coupler.lost_at(),
            (false, is_lost) => coupler.due(is_lost),
        };
        self.couplers.iter().map(coupler).chain(self.wire.deadline()).fold(Instant::NEVER, Instant::min)
    }
}
