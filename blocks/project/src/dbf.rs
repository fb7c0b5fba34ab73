//! dBase tables (`.DBF`) and their memo files (`.DBT`), read from bytes that cannot be trusted.

use std::fmt;

use crate::tree::Tree;

/// Why a table or a memo cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Damage {
    /// No dBase file at all, or its head is cut off.
    Header,
    /// Its records would not fit together: lengths in the head contradict each other.
    Shape,
    /// There is no memo file.
    NoMemoFile,
    /// The memo file cannot be read, and why.
    MemoFile(String),
    /// The memo's number lies outside the memo file.
    MemoOutside(u64),
    /// The block of that number is free, or holds something else.
    MemoFree(u64),
    /// The memo file ends within the memo.
    MemoCutOff(u64),
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Damage::Header => f.write_str("it is not a dBase file, or its head is cut off"),
            Damage::Shape => f.write_str("the lengths in its head contradict each other"),
            Damage::NoMemoFile => f.write_str("the memo file (.DBT) is missing"),
            Damage::MemoFile(why) => write!(f, "the memo file (.DBT) cannot be read: {why}"),
            Damage::MemoOutside(n) => write!(f, "memo {n} lies outside the memo file (.DBT)"),
            Damage::MemoFree(n) => write!(f, "memo {n} is not in use in the memo file (.DBT)"),
            Damage::MemoCutOff(n) => write!(f, "the memo file (.DBT) ends within memo {n}"),
        }
    }
}

#[derive(Clone, Debug)]
struct Field {
    name: String,
    at: usize,
    length: usize,
}

/// A dBase table in memory.
#[derive(Clone, Debug)]
pub struct Table {
    bytes: Vec<u8>,
    fields: Vec<Field>,
    header: usize,
    record: usize,
    count: usize,
    /// Records the head counts and the file does not have.
    missing: usize,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

impl Table {
    /// A table from the bytes of its file.
    ///
    /// # Errors
    /// [`Damage::Header`] and [`Damage::Shape`]. A file that ends within its records gives those that are whole.
    pub fn parse(bytes: Vec<u8>) -> Result<Self, Damage> {
        let count = u32_at(&bytes, 4).ok_or(Damage::Header)? as usize;
        let header = usize::from(u16_at(&bytes, 8).ok_or(Damage::Header)?);
        let record = usize::from(u16_at(&bytes, 10).ok_or(Damage::Header)?);
        if bytes.first().is_none_or(|kind| kind & 0x07 != 3) || header > bytes.len() {
            return Err(Damage::Header);
        }
        let mut fields = Vec::new();
        let mut at = 1;
        for descriptor in bytes.get(32..header).unwrap_or_default().chunks_exact(32) {
            if descriptor[0] == 0x0D {
                break;
            }
            let name: String = descriptor[..11].iter().take_while(|b| **b != 0).map(|b| char::from(*b)).collect();
            let length = usize::from(descriptor[16]);
            fields.push(Field { name, at, length });
            at += length;
        }
        if fields.is_empty() || record < at {
            return Err(Damage::Shape);
        }
        // The file says what is there; the head only claims it.
        let room = (bytes.len() - header) / record;
        let missing = count.saturating_sub(room);
        Ok(Self { bytes, fields, header, record, count: count.min(room), missing })
    }

    /// What there is to say of records that the head counts and the file does not have.
    pub fn cut_off(&self) -> Option<String> {
        (self.missing > 0).then(|| format!("the file is cut off: {} records are missing", self.missing))
    }

    /// The live records; those marked as deleted are passed over.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        (0..self.count).filter_map(|i| {
            let start = self.header + i * self.record;
            let bytes = self.bytes.get(start..start + self.record)?;
            (bytes[0] != b'*').then_some(Row { table: self, bytes })
        })
    }

    /// True when there is such a field.
    pub fn has(&self, field: &str) -> bool {
        self.fields.iter().any(|f| f.name.eq_ignore_ascii_case(field))
    }
}

/// A record of a table.
#[derive(Clone, Copy, Debug)]
pub struct Row<'t> {
    table: &'t Table,
    bytes: &'t [u8],
}

impl<'t> Row<'t> {
    /// The bytes of a field as they stand; empty when there is no such field.
    pub fn bytes(&self, field: &str) -> &'t [u8] {
        let field = self.table.fields.iter().find(|f| f.name.eq_ignore_ascii_case(field));
        field.and_then(|f| self.bytes.get(f.at..f.at + f.length)).unwrap_or_default()
    }

    /// The bytes of a text field without the blanks and NULs around it.
    pub fn trimmed(&self, field: &str) -> &'t [u8] {
        let bytes = self.bytes(field);
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        bytes[..end].trim_ascii()
    }

    /// A number field: decimal text. Empty, or not a number: 0.
    pub fn number(&self, field: &str) -> i64 {
        std::str::from_utf8(self.trimmed(field)).ok().and_then(|text| text.parse().ok()).unwrap_or(0)
    }
}

/// A memo file: the long texts of a table.
#[derive(Clone, Debug)]
pub struct Memos {
    bytes: Vec<u8>,
    block: usize,
}

impl Memos {
    /// A memo file from its bytes. Its block size is 512 where the head says nothing usable.
    pub fn parse(bytes: Vec<u8>) -> Self {
        let block = u16_at(&bytes, 20).filter(|size| *size >= 8).map_or(512, usize::from);
        Self { bytes, block }
    }

    /// The memo file at `path`.
    ///
    /// # Errors
    /// [`Damage`], when the file is missing or cannot be read.
    pub(crate) fn open(tree: &Tree<'_>, path: &str) -> Result<Self, Damage> {
        match tree.read(path) {
            Some(bytes) => Ok(Self::parse(bytes)),
            None if tree.has(path) => Err(Damage::MemoFile(tree.why_not(path))),
            None => Err(Damage::NoMemoFile),
        }
    }

    /// The memo a field names; `length` is what the record says of it, and the smaller of both counts.
    ///
    /// # Errors
    /// [`Damage`], when the field names a memo that is not there.
    pub fn get(memos: Result<&Memos, &Damage>, row: &Row<'_>, field: &str, length: usize) -> Result<Vec<u8>, Damage> {
        let number = row.number(field);
        if number <= 0 {
            return Ok(Vec::new());
        }
        let number = number as u64;
        let memo = memos.map_err(Damage::clone)?;
        let start = usize::try_from(number).ok().and_then(|n| n.checked_mul(memo.block));
        let start = start.filter(|s| *s < memo.bytes.len()).ok_or(Damage::MemoOutside(number))?;
        let head = memo.bytes.get(start..start + 8).ok_or(Damage::MemoCutOff(number))?;
        if head[..4] != [0xFF, 0xFF, 8, 0] {
            return Err(Damage::MemoFree(number));
        }
        let whole = u32_at(head, 4).map_or(0, |n| n as usize);
        let net = whole.checked_sub(8).ok_or(Damage::MemoFree(number))?.min(length);
        let bytes = memo.bytes.get(start + 8..start + 8 + net).ok_or(Damage::MemoCutOff(number))?;
        Ok(bytes.to_vec())
    }
}
