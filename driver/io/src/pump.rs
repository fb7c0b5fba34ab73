//! Between the scan and the masters: outputs of a live scan go to the masters, inputs go to the scan.

use ob1_backplane::{BusMemory, BusProcessSide, BusSize, CpSide, DriverState};
use ob1_coupler::{BusConfig, Image};
use ob1_line::{Instant, Span};
use tracing::{info, warn};

/// Time between two beats; an image is published at least as often.
const HEARTBEAT: Span = Span::from_millis(50);

/// The ends of the segment and of the bus's image that belong to the process.
pub struct Pump {
    /// The segment for its supervision.
    pub segment: CpSide,
    side: BusProcessSide,
    /// Inputs, outputs, and the state of the couplers and slaves.
    pub image: Image,
    /// The generation of the last published image.
    published: u64,
    next_beat: Instant,
    /// The scan's last sign of life, and its time.
    scan: (u64, Instant),
    alive: bool,
    scan_timeout: Span,
    /// Whether the CPU wants the outputs driven.
    wanted: bool,
}

impl Pump {
    /// A pump of a new process.
    pub fn new(config: &BusConfig, segment: CpSide, memory: &BusMemory, size: BusSize, now: Instant) -> Self {
        let mut pump = Self {
            segment,
            side: BusProcessSide::new(memory, size),
            image: Image::new(config),
            published: 0,
            next_beat: now,
            scan: (0, now),
            alive: true,
            scan_timeout: config.scan_timeout,
            wanted: false,
        };
        pump.publish();
        pump.segment.set_state(DriverState::Ready);
        pump
    }

    /// Reads the outputs from the scan, and checks whether it is alive; true if anything has changed.
    pub fn look_at_scan(&mut self, now: Instant) -> bool {
        let mut changed = false;
        if let Some(driven) = self.side.take(&mut self.image.outputs) {
            (self.wanted, changed) = (driven, true);
        }
        let beats = self.segment.cpu_heartbeat();
        if beats != self.scan.0 {
            self.scan = (beats, now);
        }
        let alive = now.since(self.scan.1) < self.scan_timeout;
        if self.wanted && alive != std::mem::replace(&mut self.alive, alive) {
            if alive {
                info!("the scan gives a sign of life again: outputs on");
            } else {
                warn!("the scan gives no sign of life: outputs off");
            }
        }
        let driven = self.wanted && alive;
        if driven != self.image.driven {
            (self.image.driven, changed) = (driven, true);
        }
        changed
    }

    /// Publishes new data, and the heartbeat of the process.
    pub fn show(&mut self, now: Instant) {
        if now >= self.next_beat {
            self.segment.beat();
            self.next_beat = now + HEARTBEAT;
            self.publish();
        } else if self.image.generation != self.published {
            self.publish();
        }
    }

    /// When [`Self::show`] is due at the latest.
    pub const fn deadline(&self) -> Instant {
        self.next_beat
    }

    fn publish(&mut self) {
        self.published = self.image.generation;
        self.side.publish(self.image.status.iter().map(|status| status.to_words()), &self.image.inputs);
    }
}
