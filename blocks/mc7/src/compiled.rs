//! The compiled interface of a block: declarations with types and sections, then start values. The same bytes in the
//! project folder and on the CPU. Little-endian, without names.

use ob1_model::{BlockId, BlockKind, DataType, Dimension, Layout, Section};

use crate::error::{Mc7Error, Problem};

/// How deep types may lie in each other: STEP 7 allows 8, instances in instances come on top.
pub(crate) const DEPTH: u32 = 24;
/// Bits of the largest data block; and the most that all declarations of a block have together, of which some are only
/// pointed to.
const LARGEST: u64 = 65_536 * 8;
const LARGEST_TOGETHER: u64 = 64 * LARGEST;

/// The first byte: what the block is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterfaceKind {
    /// 01: a code block.
    Code,
    /// 05: a global data block.
    Global,
    /// 0A: the instance of an FB.
    OfFb,
    /// 0B: the instance of an SFB.
    OfSfb,
    /// 0C: a data block of a UDT.
    OfUdt,
    /// Any other value, kept.
    Other(u8),
}

impl InterfaceKind {
    const fn read(code: u8) -> Self {
        match code {
            0x01 => Self::Code,
            0x05 => Self::Global,
            0x0A => Self::OfFb,
            0x0B => Self::OfSfb,
            0x0C => Self::OfUdt,
            other => Self::Other(other),
        }
    }

    const fn code(self) -> u8 {
        match self {
            Self::Code => 0x01,
            Self::Global => 0x05,
            Self::OfFb => 0x0A,
            Self::OfSfb => 0x0B,
            Self::OfUdt => 0x0C,
            Self::Other(code) => code,
        }
    }
}

/// The types without further bytes.
#[rustfmt::skip]
const SIMPLE: [(u8, DataType); 22] = [
    (0x01, DataType::Bool), (0x02, DataType::Byte), (0x03, DataType::Char), (0x04, DataType::Word),
    (0x05, DataType::Int), (0x06, DataType::DWord), (0x07, DataType::DInt), (0x08, DataType::Real),
    (0x09, DataType::Date), (0x0A, DataType::TimeOfDay), (0x0B, DataType::Time), (0x0C, DataType::S5Time),
    (0x0E, DataType::DateAndTime), (0x14, DataType::Pointer), (0x16, DataType::Any), (0x17, DataType::BlockFb),
    (0x18, DataType::BlockFc), (0x19, DataType::BlockDb), (0x1A, DataType::BlockSdb), (0x1C, DataType::Counter),
    (0x1D, DataType::Timer), (0x1D, DataType::TimerOrWord),
];

const ARRAY: u8 = 0x10;
const STRUCT: u8 = 0x11;
const STRING: u8 = 0x13;
const FB: u8 = 0x15;
const SFB: u8 = 0x1B;

/// Bit 3 of the attribute: a start value; bit 4: a byte more.
pub(crate) const STARTS: u8 = 0x08;
const EXTRA: u8 = 0x10;

/// The type of an entry.
#[derive(Clone, Debug, PartialEq)]
pub enum EntryType {
    /// A type without further bytes.
    Simple(DataType),
    /// Bounds and the element.
    Array(Vec<Dimension>, Box<Entry>),
    /// The components, in their order.
    Struct(Vec<Entry>),
    /// Its greatest length, 0 to 254.
    String(u8),
    /// A multi-instance: the block, and its interface as a structure.
    Instance(BlockId, Box<Entry>),
}

impl EntryType {
    /// The bits it takes at least: gaps between components are not counted, nothing is empty.
    fn bits(&self) -> u64 {
        match self {
            EntryType::Simple(ty) => u64::from(Layout::bits(ty)),
            EntryType::String(length) => (u64::from(*length) + 2) * 8,
            EntryType::Array(dims, element) => {
                let count = |dim: &Dimension| u64::try_from(i64::from(dim.high) - i64::from(dim.low) + 1).unwrap_or(1);
                let counts = dims.iter().map(|dim| count(dim).max(1));
                counts.fold(element.ty.bits(), u64::saturating_mul)
            }
            EntryType::Struct(children) => {
                children.iter().fold(0u64, |bits, child| bits.saturating_add(child.ty.bits())).max(1)
            }
            EntryType::Instance(_, inner) => inner.ty.bits(),
        }
    }
}

/// A declaration, without its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Its type, with all that lies in it.
    pub ty: EntryType,
    /// The attribute: section in the low three bits, bit 3 a start value, bit 4 a byte more. 0 for an instance, which
    /// has none.
    pub attribute: u8,
    /// The byte of bit 4; 0 without it.
    pub extra: u8,
}

/// A compiled interface, as it lies in a block.
#[derive(Clone, Debug, PartialEq)]
pub struct CompiledInterface {
    /// What the block is.
    pub kind: InterfaceKind,
    /// The block's own number, or that of the FB, SFB or UDT it is made from.
    pub number: u16,
    /// The declarations in order.
    pub entries: Vec<Entry>,
    /// The start values, packed, in the order of the entries that have one.
    pub start: Vec<u8>,
    /// What follows, mostly one byte.
    pub rest: Vec<u8>,
}

impl Entry {
    /// The section; `None` for a value no section has.
    pub fn section(&self) -> Option<Section> {
        // The attribute of an instance is that of its structure.
        let attribute = match &self.ty {
            EntryType::Instance(_, inner) => inner.attribute,
            _ => self.attribute,
        };
        SECTIONS.into_iter().zip(1..).find(|(_, code)| *code == attribute & 7).map(|(section, _)| section)
    }

    /// True when the entry has a start value.
    pub const fn has_start(&self) -> bool {
        self.attribute & STARTS != 0
    }

    /// Takes the marks of start values away, for an instance whose values stand elsewhere.
    pub(crate) fn clear_starts(&mut self) {
        self.attribute &= !STARTS;
        match &mut self.ty {
            EntryType::Struct(children) => children.iter_mut().for_each(Entry::clear_starts),
            EntryType::Array(_, inner) | EntryType::Instance(_, inner) => inner.clear_starts(),
            EntryType::Simple(_) | EntryType::String(_) => {}
        }
    }

    /// How many entries of its parent it counts for.
    fn count(&self) -> usize {
        match &self.ty {
            EntryType::Instance(..) => 2,
            _ => 1,
        }
    }
}

/// The sections in the order of their codes, from 1.
const SECTIONS: [Section; 6] =
    [Section::Input, Section::Output, Section::InOut, Section::Static, Section::Temp, Section::Return];

/// The attribute of a section.
pub(crate) fn section_code(section: Section) -> u8 {
    SECTIONS.into_iter().zip(1..).find(|(of, _)| *of == section).map_or(0, |(_, code)| code)
}

impl CompiledInterface {
    /// Reads a compiled interface.
    ///
    /// # Errors
    /// S1508 where it is cut off, nested too deep, larger than a data block, or has an unknown type.
    pub fn read(bytes: &[u8]) -> Result<Self, Mc7Error> {
        let wrong = |what, at: usize| Mc7Error::at(Problem::Interface(what), at, bytes.get(at..).unwrap_or_default());
        let Some(head) = bytes.first_chunk::<7>() else {
            return Err(wrong("a compiled interface has a head of 7 bytes", 0));
        };
        let word = |at: usize| usize::from(u16::from_le_bytes([head[at], head[at + 1]]));
        let Some(entries) = bytes.get(7..7 + word(3)) else {
            return Err(wrong("the entries are cut off", bytes.len()));
        };
        let mut reader = Reader { bytes: entries, at: 0 };
        let mut list = Vec::new();
        let mut together = 0u64;
        while reader.at < entries.len() {
            let at = reader.at;
            let entry = reader.entry(0).map_err(|what| wrong(what, 7 + at))?;
            let bits = entry.ty.bits();
            together = together.saturating_add(bits);
            if bits > LARGEST || together > LARGEST_TOGETHER {
                return Err(wrong("a declaration is larger than a data block", 7 + at));
            }
            list.push(entry);
        }
        let behind = bytes.get(7 + word(3)..).unwrap_or_default();
        let (start, rest) = behind.split_at(word(5).min(behind.len()));
        Ok(Self {
            kind: InterfaceKind::read(head[0]),
            number: u16::from_le_bytes([head[1], head[2]]),
            entries: list,
            start: start.to_vec(),
            rest: rest.to_vec(),
        })
    }

    /// Its bytes, as they lie in a block.
    ///
    /// # Errors
    /// S1508 where entries or start values are longer than their length can say.
    pub fn bytes(&self) -> Result<Vec<u8>, Mc7Error> {
        let mut entries = Vec::new();
        self.entries.iter().for_each(|entry| entry.write(&mut entries));
        let length = |part: &[u8]| {
            u16::try_from(part.len()).map_err(|_| {
                Mc7Error::at(Problem::Interface("the interface is longer than 65,535 bytes"), part.len(), &[])
            })
        };
        let mut out = vec![self.kind.code()];
        for word in [self.number, length(&entries)?, length(&self.start)?] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        for part in [&entries, &self.start, &self.rest] {
            out.extend_from_slice(part);
        }
        Ok(out)
    }
}

struct Reader<'b> {
    bytes: &'b [u8],
    at: usize,
}

impl Reader<'_> {
    fn byte(&mut self) -> Result<u8, &'static str> {
        let byte = self.bytes.get(self.at).copied().ok_or("an entry is cut off")?;
        self.at += 1;
        Ok(byte)
    }

    fn word(&mut self) -> Result<u16, &'static str> {
        Ok(u16::from_le_bytes([self.byte()?, self.byte()?]))
    }

    fn entry(&mut self, depth: u32) -> Result<Entry, &'static str> {
        if depth > DEPTH {
            return Err("types are nested too deep");
        }
        let code = self.byte()?;
        if matches!(code, FB | SFB) {
            let kind = if code == FB { BlockKind::Fb } else { BlockKind::Sfb };
            let id = BlockId::new(kind, self.word()?);
            let inner = self.entry(depth + 1)?;
            return Ok(Entry { ty: EntryType::Instance(id, Box::new(inner)), attribute: 0, extra: 0 });
        }
        let attribute = self.byte()?;
        let extra = if attribute & EXTRA == 0 { 0 } else { self.byte()? };
        let ty = match code {
            ARRAY => {
                let count = self.byte()?;
                let mut dims = Vec::new();
                for _ in 0..count {
                    let (low, high) = (i32::from(self.word()? as i16), i32::from(self.word()? as i16));
                    dims.push(Dimension { low, high });
                }
                EntryType::Array(dims, Box::new(self.entry(depth + 1)?))
            }
            STRUCT => {
                let count = match self.byte()? {
                    0xFF => usize::from(self.word()?),
                    few => usize::from(few),
                };
                let mut children: Vec<Entry> = Vec::new();
                let mut counted = 0;
                while counted < count {
                    let child = self.entry(depth + 1)?;
                    counted += child.count();
                    children.push(child);
                }
                EntryType::Struct(children)
            }
            STRING => EntryType::String(self.byte()?),
            code => match SIMPLE.iter().find(|(c, _)| *c == code) {
                Some((_, ty)) => EntryType::Simple(ty.clone()),
                None => return Err("an entry of an unknown type"),
            },
        };
        Ok(Entry { ty, attribute, extra })
    }
}

impl Entry {
    fn write(&self, out: &mut Vec<u8>) {
        let head = |code: u8, out: &mut Vec<u8>| {
            out.extend_from_slice(&[code, self.attribute]);
            if self.attribute & EXTRA != 0 {
                out.push(self.extra);
            }
        };
        match &self.ty {
            EntryType::Simple(ty) => {
                let code = SIMPLE.iter().find(|(_, t)| t == ty).map_or(0, |(code, _)| *code);
                head(code, out);
            }
            EntryType::Array(dims, element) => {
                head(ARRAY, out);
                out.push(dims.len() as u8);
                for dim in dims {
                    out.extend_from_slice(&(dim.low as i16).to_le_bytes());
                    out.extend_from_slice(&(dim.high as i16).to_le_bytes());
                }
                element.write(out);
            }
            EntryType::Struct(children) => {
                head(STRUCT, out);
                let count: usize = children.iter().map(Entry::count).sum();
                match u8::try_from(count) {
                    Ok(few) if few < 0xFF => out.push(few),
                    _ => {
                        out.push(0xFF);
                        out.extend_from_slice(&(count.min(0xFFFF) as u16).to_le_bytes());
                    }
                }
                children.iter().for_each(|child| child.write(out));
            }
            EntryType::String(length) => {
                head(STRING, out);
                out.push(*length);
            }
            EntryType::Instance(id, inner) => {
                out.push(if id.kind == BlockKind::Sfb { SFB } else { FB });
                out.extend_from_slice(&id.number.to_le_bytes());
                inner.write(out);
            }
        }
    }
}
