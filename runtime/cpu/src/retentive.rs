//! The image of retentive memory for a power cycle.
//!
//! The image is one contiguous piece, all numbers little-endian: magic, version, length, number of data blocks made by
//! the program; then what has to be the same when it is restored (checksum of the declarations, the ranges); then the
//! made data blocks, the contents, and a checksum over everything before. Keeping it on a disk is the caller's
//! task.

use crate::keep::Hash;
use crate::made::Attributes;
use crate::memory::Memory;
use crate::timers::{Counter, Timer};
use crate::{Cpu, OperatingState};

const MAGIC: [u8; 8] = *b"ob1 keep";
const VERSION: u32 = 1;
/// Magic, version, length, made data blocks.
const HEAD: usize = 20;
const CHECKSUM: usize = 8;

/// Why an image is not restored. Nothing has been changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// Not such an image at all.
    NoImage,
    /// Written by another version of this software.
    Version(u32),
    /// Cut off or changed.
    Damaged,
    /// Data blocks or function blocks are declared differently: the bytes would mean something else.
    OtherProgram,
    /// Other ranges are retentive now.
    OtherRanges,
    /// The data blocks the program had made find no room.
    NoRoom,
    /// The CPU is not in STOP.
    NotInStop,
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Why::NoImage => f.write_str("this is no image of retentive memory"),
            Why::Version(v) => write!(f, "the image has version {v}; this software reads version {VERSION}"),
            Why::Damaged => f.write_str("the image is cut off or damaged"),
            Why::OtherProgram => f.write_str("the image belongs to a program with other data blocks"),
            Why::OtherRanges => f.write_str("the image was made with other retentive ranges"),
            Why::NoRoom => f.write_str("there is no room for the data blocks made by the program"),
            Why::NotInStop => f.write_str("the CPU is not in STOP"),
        }
    }
}

impl std::error::Error for Why {}

fn checksum(bytes: &[u8]) -> [u8; CHECKSUM] {
    let mut hash = Hash::default();
    hash.add(bytes);
    hash.0.to_le_bytes()
}

/// Takes the image apart.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, len: usize) -> Result<&'a [u8], Why> {
        let (head, rest) = self.0.split_at_checked(len).ok_or(Why::Damaged)?;
        self.0 = rest;
        Ok(head)
    }

    fn u32(&mut self) -> Result<u32, Why> {
        self.take(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }
}

impl Cpu {
    /// Bytes of the image of retentive memory now. More only when the program makes data blocks.
    #[must_use]
    pub fn retentive_len(&self) -> usize {
        let keep = &self.machine.keep;
        let made: usize =
            if keep.made { self.machine.memory.made_dbs().map(|made| 12 + made.db.len as usize).sum() } else { 0 };
        let ranges: usize = keep.memory.iter().chain(&keep.data).map(|r| r.len as usize).sum();
        let timers: usize = keep.timers.iter().map(|r| r.len() * Timer::IMAGE).sum();
        let counters: usize = keep.counters.iter().map(|r| r.len() * Counter::IMAGE).sum();
        HEAD + keep.same.len() + made + ranges + timers + counters + CHECKSUM
    }

    /// Replaces what `into` holds by the image of retentive memory as it is between two cycles. Allocates only when
    /// `into` has no room for [`Cpu::retentive_len`] bytes.
    pub fn retentive_image(&self, into: &mut Vec<u8>) {
        let m = &self.machine;
        let len = self.retentive_len();
        into.clear();
        into.reserve(len);
        let made = || m.memory.made_dbs().filter(|_| m.keep.made);
        into.extend_from_slice(&MAGIC);
        for number in [VERSION, len as u32, made().count() as u32] {
            into.extend_from_slice(&number.to_le_bytes());
        }
        into.extend_from_slice(&m.keep.same);
        for made in made() {
            for number in [u32::from(made.db.number), made.db.len, made.attributes.bits()] {
                into.extend_from_slice(&number.to_le_bytes());
            }
        }
        for range in m.keep.memory.iter().chain(&m.keep.data) {
            into.extend_from_slice(m.memory.slice(*range));
        }
        for timer in m.keep.timers.iter().flat_map(|r| &m.timers[r.clone()]) {
            // Time stands still in STOP.
            let now = if self.state == OperatingState::Stop { m.stopped_at } else { m.hot.now };
            into.extend_from_slice(&timer.image(now));
        }
        for counter in m.keep.counters.iter().flat_map(|r| &m.counters[r.clone()]) {
            into.extend_from_slice(&counter.image());
        }
        for made in made() {
            // Of one that is not retentive: what it begins with again.
            into.extend_from_slice(m.memory.slice(made.load_values()));
        }
        let sum = checksum(into);
        into.extend_from_slice(&sum);
    }

    /// Puts an image back, in STOP; the next warm or hot restart keeps it.
    ///
    /// # Errors
    /// Why not; nothing has been changed then.
    pub fn restore_retentive(&mut self, image: &[u8]) -> Result<(), Why> {
        if self.state != OperatingState::Stop {
            return Err(Why::NotInStop);
        }
        let mut reader = Reader(image);
        if reader.take(MAGIC.len()).map_err(|_| Why::NoImage)? != MAGIC {
            return Err(Why::NoImage);
        }
        let version = reader.u32()?;
        if version != VERSION {
            return Err(Why::Version(version));
        }
        let (len, made) = (reader.u32()?, reader.u32()?);
        let end = image.len().checked_sub(CHECKSUM).ok_or(Why::Damaged)?;
        if len as usize != image.len() || image[end..] != checksum(&image[..end]) {
            return Err(Why::Damaged);
        }
        let m = &mut self.machine;
        let same = reader.take(m.keep.same.len()).map_err(|_| Why::OtherRanges)?;
        if same[..CHECKSUM] != m.keep.same[..CHECKSUM] {
            return Err(Why::OtherProgram);
        }
        if same != m.keep.same {
            return Err(Why::OtherRanges);
        }
        let blocks = reader.take(made as usize * 12)?;
        let ranges: usize = m.keep.memory.iter().chain(&m.keep.data).map(|r| r.len as usize).sum();
        let contents = reader.take(ranges)?;
        let timers: usize = m.keep.timers.iter().map(std::ops::Range::len).sum();
        let counters: usize = m.keep.counters.iter().map(std::ops::Range::len).sum();
        let timers = reader.take(timers * Timer::IMAGE)?;
        let counters = reader.take(counters * Counter::IMAGE)?;
        let timers: Vec<Timer> = timers
            .chunks_exact(Timer::IMAGE)
            .map(|b| Timer::from_image(b, m.hot.now).ok_or(Why::Damaged))
            .collect::<Result<_, _>>()?;
        let counters: Vec<Counter> = counters
            .chunks_exact(Counter::IMAGE)
            .map(|b| Counter::from_image(b).ok_or(Why::Damaged))
            .collect::<Result<_, _>>()?;

        m.memory.delete_made();
        if let Err(why) = make(&mut m.memory, blocks, &mut reader) {
            m.memory.delete_made();
            return Err(why);
        }
        let mut contents = Reader(contents);
        for range in m.keep.memory.iter().chain(&m.keep.data) {
            m.memory.bytes[range.bytes()].copy_from_slice(contents.take(range.len as usize)?);
        }
        let (mut timers, mut counters) = (timers.into_iter(), counters.into_iter());
        m.keep.timers.iter().for_each(|r| m.timers[r.clone()].iter_mut().zip(&mut timers).for_each(|(t, n)| *t = n));
        m.keep
            .counters
            .iter()
            .for_each(|r| m.counters[r.clone()].iter_mut().zip(&mut counters).for_each(|(t, n)| *t = n));
        m.stopped_at = m.hot.now;
        self.has_run = true;
        Ok(())
    }
}

/// Makes the data blocks the program had made.
fn make(memory: &mut Memory, blocks: &[u8], contents: &mut Reader<'_>) -> Result<(), Why> {
    let mut blocks = Reader(blocks);
    while !blocks.0.is_empty() {
        let (number, len, attributes) = (blocks.u32()?, blocks.u32()?, Attributes::of_bits(blocks.u32()?));
        let number = u16::try_from(number).map_err(|_| Why::Damaged)?;
        let bytes = contents.take(len as usize)?;
        let number = memory.make_db(number, number, len, attributes).map_err(|_| Why::NoRoom)?;
        if let Some(made) = memory.made_db(number) {
            memory.slice_mut(made.db.range()).copy_from_slice(bytes);
            memory.slice_mut(made.load_values()).copy_from_slice(bytes);
        }
    }
    Ok(())
}
