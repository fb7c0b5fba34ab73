//! A block as it lies in the CPU, in a `.wld` file, and as it goes over the wire: 36 bytes of head, code or data,
//! compiled interface, segment table, 36 bytes of foot. All big-endian.

use ob1_model::BlockKind;
use ob1_model::calendar::{self, DAYS_TO_1984};

use crate::error::{Mc7Error, Problem};

/// Bytes of the head, and of the foot.
pub const HEAD_BYTES: usize = 36;

/// `pp`, with which every block begins.
const MARK: [u8; 2] = [0x70, 0x70];

/// A moment: milliseconds of the day, and days since 1984-01-01.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Days since 1984-01-01, where STEP 7 begins.
    pub days: u16,
    /// Milliseconds since midnight of that day.
    pub ms: u32,
}

impl Stamp {
    /// From the six bytes; all zero: not set.
    pub const fn read(b: [u8; 6]) -> Self {
        Self { ms: u32::from_be_bytes([b[0], b[1], b[2], b[3]]), days: u16::from_be_bytes([b[4], b[5]]) }
    }

    /// The six bytes of a head: milliseconds, then days.
    pub fn bytes(self) -> [u8; 6] {
        let [a, b, c, d] = self.ms.to_be_bytes();
        let [e, f] = self.days.to_be_bytes();
        [a, b, c, d, e, f]
    }

    /// Year, month and day of the calendar.
    pub fn date(self) -> (u32, u32, u32) {
        calendar::date_of(u32::from(self.days) + DAYS_TO_1984)
    }
}

/// The head of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockHead {
    /// Byte 2; 1 wherever it was seen.
    pub version: u8,
    /// Bit 0 linked, bit 1 standard block, bit 2 [`Self::READ_ONLY`], bit 3 know-how protected, bit 5
    /// [`Self::NON_RETAIN`].
    pub attribute: u8,
    /// The language it was made in: 1 STL, 2 LAD, 3 FBD, 4 SCL, 5 DB.
    pub language: u8,
    /// The type byte: 8 OB, 0Ah DB, 0Bh SDB, 0Ch FC, 0Dh SFC, 0Eh FB, 0Fh SFB.
    pub kind: u8,
    /// Number of the block.
    pub number: u16,
    /// 0: none; else know-how protected.
    pub password: u32,
    /// Last change of the code.
    pub code_changed: Stamp,
    /// Last change of the interface.
    pub interface_changed: Stamp,
    /// Bytes of local data.
    pub local_bytes: u16,
}

impl BlockHead {
    /// Attribute of a data block that cannot be written to.
    pub const READ_ONLY: u8 = 0x04;
    /// Attribute of a data block that is not retentive.
    pub const NON_RETAIN: u8 = 0x20;

    /// The type bytes of the kinds of blocks.
    const KINDS: [(u8, BlockKind); 7] = [
        (0x08, BlockKind::Ob),
        (0x0A, BlockKind::Db),
        (0x0B, BlockKind::Sdb),
        (0x0C, BlockKind::Fc),
        (0x0D, BlockKind::Sfc),
        (0x0E, BlockKind::Fb),
        (0x0F, BlockKind::Sfb),
    ];

    /// The kind of block; `None` for system data.
    pub fn block_kind(&self) -> Option<BlockKind> {
        let kind = Self::KINDS.into_iter().find(|(byte, _)| *byte == self.kind).map(|(_, kind)| kind);
        kind.filter(|kind| *kind != BlockKind::Sdb)
    }

    /// The type byte of a kind.
    pub fn kind_byte(kind: BlockKind) -> u8 {
        Self::KINDS.into_iter().find(|(_, of)| *of == kind).map_or(0, |(byte, _)| byte)
    }
}

/// The foot of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockFoot {
    /// `AUTHOR`, padded with zeros.
    pub author: [u8; 8],
    /// `FAMILY`, padded with zeros.
    pub family: [u8; 8],
    /// `NAME`, padded with zeros.
    pub name: [u8; 8],
    /// `VERSION`, a digit in each half.
    pub version: u8,
    /// Byte 25 of the foot; 0.
    pub reserved: u8,
    /// A checksum over the code; how it is made is unknown.
    pub checksum: u16,
    /// The last eight bytes; 0.
    pub rest: [u8; 8],
}

/// A whole block with its parts as bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockImage {
    /// The head, without its lengths: they are those of the parts.
    pub head: BlockHead,
    /// MC7 code with its final `BE`, or the values of a data block.
    pub code: Vec<u8>,
    /// The compiled interface: [`crate::CompiledInterface`].
    pub interface: Vec<u8>,
    /// The segment table: [`crate::Segments`]; empty in a data block.
    pub segments: Vec<u8>,
    /// The foot, after the segment table.
    pub foot: BlockFoot,
}

impl BlockImage {
    /// Reads the block at the beginning of `bytes` and gives its length; what follows may be the next block.
    ///
    /// # Errors
    /// S1509 where it has no head, is cut off, or its lengths do not add up.
    pub fn read(bytes: &[u8]) -> Result<(Self, usize), Mc7Error> {
        let wrong = |what, at: usize| Mc7Error::at(Problem::Head(what), at, bytes.get(at..).unwrap_or_default());
        let Some(head) = bytes.first_chunk::<HEAD_BYTES>() else {
            return Err(wrong("a block has a head of 36 bytes", 0));
        };
        if !head.starts_with(&MARK) {
            return Err(wrong("a block begins with 70 70", 0));
        }
        let word = |at: usize| u16::from_be_bytes([head[at], head[at + 1]]);
        let double = |at: usize| u32::from(word(at)) << 16 | u32::from(word(at + 2));
        let stamp = |at: usize| Stamp { ms: double(at), days: word(at + 4) };
        let (interface, segments, code) = (usize::from(word(28)), usize::from(word(30)), usize::from(word(34)));
        let total = HEAD_BYTES + code + interface + segments + HEAD_BYTES;
        if double(8) as usize != total {
            return Err(wrong("the length of the block is not that of its parts", 8));
        }
        let Some(rest) = bytes.get(HEAD_BYTES..total) else {
            return Err(wrong("the block is cut off", bytes.len()));
        };
        let (code, rest) = rest.split_at(code);
        let (interface, rest) = rest.split_at(interface);
        let (segments, foot) = rest.split_at(segments);
        let eight = |at: usize| foot.get(at..).and_then(|b| b.first_chunk::<8>().copied()).unwrap_or_default();
        let one = |at: usize| foot.get(at).copied().unwrap_or_default();
        let image = Self {
            head: BlockHead {
                version: head[2],
                attribute: head[3],
                language: head[4],
                kind: head[5],
                number: word(6),
                password: double(12),
                code_changed: stamp(16),
                interface_changed: stamp(22),
                local_bytes: word(32),
            },
            code: code.to_vec(),
            interface: interface.to_vec(),
            segments: segments.to_vec(),
            foot: BlockFoot {
                author: eight(0),
                family: eight(8),
                name: eight(16),
                version: one(24),
                reserved: one(25),
                checksum: u16::from_be_bytes([one(26), one(27)]),
                rest: eight(28),
            },
        };
        Ok((image, total))
    }

    /// The bytes of the block.
    ///
    /// # Errors
    /// S1509 where a part is longer than 65,535 bytes.
    pub fn bytes(&self) -> Result<Vec<u8>, Mc7Error> {
        let length = |part: &[u8]| {
            u16::try_from(part.len())
                .map_err(|_| Mc7Error::at(Problem::Head("a part of the block is longer than 65,535 bytes"), 0, &[]))
        };
        let (code, interface, segments) = (length(&self.code)?, length(&self.interface)?, length(&self.segments)?);
        let total = 2 * HEAD_BYTES as u32 + u32::from(code) + u32::from(interface) + u32::from(segments);
        let BlockHead { version, attribute, language, kind, number, password, local_bytes, .. } = self.head;
        let mut out = MARK.to_vec();
        out.extend_from_slice(&[version, attribute, language, kind]);
        out.extend_from_slice(&number.to_be_bytes());
        out.extend_from_slice(&total.to_be_bytes());
        out.extend_from_slice(&password.to_be_bytes());
        out.extend_from_slice(&self.head.code_changed.bytes());
        out.extend_from_slice(&self.head.interface_changed.bytes());
        for word in [interface, segments, local_bytes, code] {
            out.extend_from_slice(&word.to_be_bytes());
        }
        for part in [&self.code, &self.interface, &self.segments] {
            out.extend_from_slice(part);
        }
        for text in [&self.foot.author, &self.foot.family, &self.foot.name] {
            out.extend_from_slice(text);
        }
        out.extend_from_slice(&[self.foot.version, self.foot.reserved]);
        out.extend_from_slice(&self.foot.checksum.to_be_bytes());
        out.extend_from_slice(&self.foot.rest);
        Ok(out)
    }
}
