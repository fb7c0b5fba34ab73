//! Formats a segment, and checks one created by another process.

use crate::fault::SegmentError;
use crate::layout::{CHANNELS_VERSION, COUNTER_WORDS, EVENT_SLOTS, JSON_BYTES, LAYOUT_VERSION, MAGIC, RECORD_BYTES};
use crate::registers::IoBytes;
use crate::segment::Segment;
use crate::sync::{AtomicU64, Ordering};

/// Empties the segment and writes its header, the version last: a reader that finds the version finds everything else.
pub(crate) fn format(segment: &Segment, io: IoBytes) {
    segment.cells().header.version.store(0, Ordering::Release);
    clear(segment);
    write(segment, io);
}

/// Writes the header; its version comes last, and only then is the segment valid for others.
pub(crate) fn write(segment: &Segment, io: IoBytes) {
    for (cell, word, _) in fixed_words(segment) {
        cell.store(word, Ordering::Relaxed);
    }
    let cells = segment.cells();
    cells.header.io_bytes.store(io.get() as u64, Ordering::Relaxed);
    // Pairs with the load(Acquire) in `check`.
    cells.header.version.store(LAYOUT_VERSION, Ordering::Release);
}

/// Checks the header and returns the number of register bytes in it.
pub(crate) fn check(segment: &Segment) -> Result<IoBytes, SegmentError> {
    let cells = segment.cells();
    // Pairs with the last store(Release) in `write`.
    let version = cells.header.version.load(Ordering::Acquire);
    if version != LAYOUT_VERSION {
        return Err(SegmentError::Header { field: "header.version", found: version });
    }
    for (cell, word, field) in fixed_words(segment) {
        let found = cell.load(Ordering::Relaxed);
        if found != word {
            return Err(SegmentError::Header { field, found });
        }
    }
    let found = cells.header.io_bytes.load(Ordering::Relaxed);
    let io = usize::try_from(found).ok().and_then(IoBytes::new);
    io.ok_or(SegmentError::Header { field: "header.io_bytes", found })
}

/// The words of the header that are the same in every segment of this version and size.
fn fixed_words(segment: &Segment) -> [(&AtomicU64, u64, &'static str); 7] {
    let cells = segment.cells();
    let header = &cells.header;
    [
        (&header.magic, MAGIC, "header.magic"),
        (&header.total_bytes, segment.bytes() as u64, "header.total_bytes"),
        (&header.json_bytes, JSON_BYTES as u64, "header.json_bytes"),
        (&header.record_bytes, RECORD_BYTES as u64, "header.record_bytes"),
        (&header.event_slots, EVENT_SLOTS as u64, "header.event_slots"),
        (&header.counter_words, COUNTER_WORDS as u64, "header.counter_words"),
        (&cells.channels.version, CHANNELS_VERSION, "channels.version"),
    ]
}

/// Zero in every word. A model's segment is always new.
#[cfg(loom)]
fn clear(_segment: &Segment) {}

/// Zero in every word.
#[cfg(not(loom))]
fn clear(segment: &Segment) {
    for cell in segment.words() {
        cell.store(0, Ordering::Relaxed);
    }
}
