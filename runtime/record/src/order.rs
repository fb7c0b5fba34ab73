//! What is to be recorded, as a person or a station file says it.

use ob1_access::{Item, Names};
use ob1_cpu::{RecordingClient, Rows};
use ob1_time::Span;
use serde::{Deserialize, Serialize};

use crate::head::{frame, piece_fits};
use crate::{Signal, Trigger};

/// Bytes that the history of one recording may take.
const LONGEST_HISTORY: usize = 256 << 20;
/// Time for which rows have room in the ring of the scan.
const ROOM: Span = Span::from_secs(2);
/// Rows with room at least and at most.
const ROOMS: std::ops::RangeInclusive<u64> = 256..=16_384;

/// What is to be recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Order {
    /// Names of signals; none: scans and events alone.
    pub signals: Vec<String>,
    /// What begins a part; empty: at once.
    pub trigger: String,
    /// History before the trigger.
    pub before_ns: u64,
    /// Length of a part after its trigger; 0: until the recording is ended.
    pub for_ns: u64,
    /// Parts; 0: without end.
    pub repeat: u64,
}

/// An order that the names of a program have been found for.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The signals; those of the trigger that were not asked for come last.
    pub signals: Vec<Signal>,
    /// Where they lie.
    pub items: Vec<Item>,
    /// What begins a part.
    pub trigger: Trigger,
    /// History before the trigger.
    pub before: Span,
    /// Length of a part after its trigger; 0: for ever.
    pub length: Span,
    /// Parts; 0: without end.
    pub repeat: u64,
    /// Rows of history that have room.
    pub(crate) history: usize,
}

impl Order {
    /// Finds the signals.
    ///
    /// # Errors
    /// What cannot be recorded, in one sentence.
    pub fn settle(&self, names: &Names, min_cycle: Span) -> Result<Settings, String> {
        let mut items: Vec<Item> = Vec::new();
        for name in &self.signals {
            items.push(names.parse(name)?);
        }
        let mut find = |name: &str| {
            let item = names.parse(name)?;
            let same = |known: &Item| (known.cell, known.width) == (item.cell, item.width);
            Ok(items.iter().position(same).unwrap_or_else(|| {
                items.push(item);
                items.len() - 1
            }))
        };
        let trigger = Trigger::parse(&self.trigger, &mut find)?;
        if !piece_fits(&items) {
            return Err(format!("{} signals are more than one recording can have", items.len()));
        }
        let (before, length) = (Span::from_nanos(self.before_ns), Span::from_nanos(self.for_ns));
        // Without a minimum cycle time a scan takes a tenth of a millisecond at least, or the history is shorter.
        let cycle = if min_cycle.is_zero() { Span::from_micros(100) } else { min_cycle };
        let history = usize::try_from(before.div_ceil(cycle)).unwrap_or(usize::MAX).saturating_add(1);
        let row = size_of::<crate::Row>() + 8 * items.len();
        if !before.is_zero() && history.saturating_mul(row) > LONGEST_HISTORY {
            return Err(format!(
                "a history of {} s with {} signals needs more than {} MiB; shorten `before`",
                before.as_secs_f64(),
                items.len(),
                LONGEST_HISTORY >> 20
            ));
        }
        let history = if before.is_zero() { 0 } else { history };
        let signals = items.iter().map(Signal::of).collect();
        Ok(Settings { signals, items, trigger, before, length, repeat: self.repeat, history })
    }
}

impl Settings {
    /// Has a CPU with this minimum cycle time record them.
    ///
    /// # Errors
    /// It records too much already.
    pub fn start(&self, cpu: &mut RecordingClient, min_cycle: Span) -> Result<Rows, String> {
        let rows = if min_cycle.is_zero() { *ROOMS.end() } else { ROOM.div_ceil(min_cycle) };
        let room = rows.clamp(*ROOMS.start(), *ROOMS.end()) as usize;
        cpu.record(frame(&self.items), room).map_err(|_| "too much is recorded at once".into())
    }
}
