//! Names of blocks on the wire (`_0A00001P`), and their entries in lists.

/// Flags of a block in lists and block infos: linked into the program, and a part of the CPU.
const LINKED: u8 = 0x22;
const IN_CPU: u8 = 0x42;

/// Types of blocks a CPU lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names say it")]
pub enum BlockType {
    Ob,
    Db,
    Sdb,
    Fc,
    Sfc,
    Fb,
    Sfb,
}

impl BlockType {
    /// All, in the order of a list of blocks.
    pub const ALL: [Self; 7] = [Self::Ob, Self::Fb, Self::Fc, Self::Db, Self::Sdb, Self::Sfc, Self::Sfb];

    /// The letter after the 0.
    #[must_use]
    pub const fn letter(self) -> u8 {
        match self {
            Self::Ob => b'8',
            Self::Db => b'A',
            Self::Sdb => b'B',
            Self::Fc => b'C',
            Self::Sfc => b'D',
            Self::Fb => b'E',
            Self::Sfb => b'F',
        }
    }

    /// From the letter, upper or lower case.
    #[must_use]
    pub fn of(letter: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|ty| ty.letter() == letter.to_ascii_uppercase())
    }

    /// From the byte in the header of a block.
    #[must_use]
    pub fn of_head(byte: u8) -> Option<Self> {
        let digit = char::from_digit(u32::from(byte), 16)?;
        Self::of(digit as u8)
    }

    /// Whether it is a block of the CPU itself.
    #[must_use]
    pub const fn is_system(self) -> bool {
        matches!(self, Self::Sfc | Self::Sfb)
    }

    /// Its flags in a list of blocks.
    #[must_use]
    pub const fn flags(self) -> u8 {
        if self.is_system() { IN_CPU } else { LINKED }
    }

    /// The usual name of the type, "OB".
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ob => "OB",
            Self::Db => "DB",
            Self::Sdb => "SDB",
            Self::Fc => "FC",
            Self::Sfc => "SFC",
            Self::Fb => "FB",
            Self::Sfb => "SFB",
        }
    }
}

/// The place of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileSystem {
    /// Linked: the program that runs.
    Active,
    /// Loaded, but not linked yet.
    Passive,
    /// Linked ones and others.
    Both,
}

impl FileSystem {
    const fn of(letter: u8) -> Option<Self> {
        match letter {
            b'A' => Some(Self::Active),
            b'P' => Some(Self::Passive),
            b'B' => Some(Self::Both),
            _ => None,
        }
    }

    const fn letter(self) -> u8 {
        match self {
            Self::Active => b'A',
            Self::Passive => b'P',
            Self::Both => b'B',
        }
    }
}

/// A block by its name on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockName {
    /// Its type: OB, DB, FC and so on.
    pub ty: BlockType,
    /// Number of the block.
    pub number: u16,
    /// Where it is: linked or not.
    pub place: FileSystem,
}

impl BlockName {
    /// Bytes of a name.
    pub const BYTES: usize = 8;

    /// `0A00001P`; in uploads and downloads preceded by `_`.
    #[must_use]
    pub fn read(text: &[u8]) -> Option<Self> {
        let text = text.strip_prefix(b"_").unwrap_or(text);
        let (&[zero, letter, a, b, c, d, e, place], []) = text.split_first_chunk::<8>()? else { return None };
        let number = [a, b, c, d, e]
            .iter()
            .try_fold(0u32, |number, digit| digit.is_ascii_digit().then(|| number * 10 + u32::from(digit - b'0')))?;
        Some(Self {
            ty: BlockType::of(letter).filter(|_| zero == b'0')?,
            number: u16::try_from(number).ok()?,
            place: FileSystem::of(place)?,
        })
    }

    /// Its bytes, in ASCII.
    #[must_use]
    pub fn text(&self) -> [u8; Self::BYTES] {
        let digit = |power: u16| b'0' + (self.number / power % 10) as u8;
        let digits = [digit(10_000), digit(1000), digit(100), digit(10), digit(1)];
        let [a, b, c, d, e] = digits;
        [b'0', self.ty.letter(), a, b, c, d, e, self.place.letter()]
    }
}

/// Bytes of the answer to a block info.
pub const INFO_BYTES: usize = 78;
/// Length of the header of a block, and of its footer.
const HEAD: usize = 36;

/// The values in the bytes of a whole data block; `None`: not a data block.
#[must_use]
pub fn values_mut(block: &mut [u8]) -> Option<&mut [u8]> {
    let head = block.first_chunk::<HEAD>()?;
    let len = usize::from(u16::from_be_bytes([head[34], head[35]]));
    let is_data = BlockType::of_head(head[5]) == Some(BlockType::Db);
    block.get_mut(HEAD..HEAD + len).filter(|_| is_data)
}

/// The content of a block info: the header and the footer of the block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockInfo {
    /// Type of the block.
    pub ty: BlockType,
    /// The first 36 bytes of the block.
    pub head: [u8; HEAD],
    /// The last 36 bytes of the block.
    pub foot: [u8; HEAD],
}

impl BlockInfo {
    /// From a whole block.
    #[must_use]
    pub fn of(block: &[u8]) -> Option<Self> {
        let head = block.first_chunk::<HEAD>()?;
        let foot = block.get(HEAD..)?.last_chunk::<HEAD>()?;
        Some(Self { ty: BlockType::of_head(head[5])?, head: *head, foot: *foot })
    }

    /// The data of the answer: flags, head, foot.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        // One block; the length of the rest; its flags and origin.
        let origin = if self.ty.is_system() { 0x30 } else { 0 };
        let mut out = vec![1, 0, 0, (INFO_BYTES - 4) as u8, self.ty.flags(), origin];
        out.extend_from_slice(&self.head);
        out.extend_from_slice(&self.foot);
        out
    }

    /// From the answer's data.
    #[must_use]
    pub fn read(data: &[u8]) -> Option<Self> {
        let (_, rest) = data.split_first_chunk::<6>()?;
        let (head, rest) = rest.split_first_chunk::<HEAD>()?;
        let foot = rest.first_chunk::<HEAD>()?;
        Some(Self { ty: BlockType::of_head(head[5])?, head: *head, foot: *foot })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_go_both_ways() {
        for (text, ty, number, place) in [
            (b"0800001P", BlockType::Ob, 1, FileSystem::Passive),
            (b"0A65535A", BlockType::Db, 65_535, FileSystem::Active),
            (b"0F00052B", BlockType::Sfb, 52, FileSystem::Both),
        ] {
            let name = BlockName { ty, number, place };
            assert_eq!(BlockName::read(text), Some(name));
            assert_eq!(name.text(), *text);
        }
        assert!(BlockName::read(b"_0A00001P").is_some());
        for wrong in
            [&b"0A65536A"[..], b"0A0001A", b"0X00001A", b"1A00001A", b"0A0000xA", b"0A00001Q", b"", b"0A00001AA"]
        {
            assert_eq!(BlockName::read(wrong), None);
        }
    }

    #[test]
    fn values_lie_behind_the_head_of_a_data_block() {
        let mut block: Vec<u8> = (0..80).collect();
        (block[5], block[34], block[35]) = (0x0A, 0, 8);
        assert_eq!(values_mut(&mut block), Some(&mut [36, 37, 38, 39, 40, 41, 42, 43][..]));
        block[34] = 1;
        assert_eq!(values_mut(&mut block), None, "longer than the block");
        (block[5], block[34]) = (0x0C, 0);
        assert_eq!(values_mut(&mut block), None, "a function");
        assert_eq!(values_mut(&mut []), None);
    }

    #[test]
    fn an_info_is_head_and_foot() {
        let mut block: Vec<u8> = (0..100).collect();
        block[5] = 0x0A;
        let info = BlockInfo::of(&block).expect("long enough");
        assert_eq!(info.ty, BlockType::Db);
        assert_eq!(info.bytes().len(), INFO_BYTES);
        assert_eq!(BlockInfo::read(&info.bytes()), Some(info));
        assert_eq!(BlockInfo::of(&block[..71]), None);
    }
}
