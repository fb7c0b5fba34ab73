//! `linkhrs.lnk`: which block folder, symbol list and source container a program has.

/// What a program's record links to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Links {
    pub(crate) folder: Option<u32>,
    pub(crate) symbols: Option<i64>,
    pub(crate) sources: Option<u32>,
}

/// Length of a record.
pub(crate) const RECORD: usize = 512;
/// Length of its head (own offset, a flag, number of entries, 0) and of an entry: unit type, unit ID, object type,
/// object ID, relation, kind.
pub(crate) const HEAD: usize = 16;
const ENTRY: usize = 24;

/// Object type and relation of the three.
pub(crate) const FOLDER: (u32, u32) = (0x0011_6001, 0x1E);
pub(crate) const SYMBOLS: (u32, u32) = (0x0011_3001, 0x18);
pub(crate) const SOURCES: (u32, u32) = (0x0011_2004, 0x62);

/// Reads the record at `offset`. A record that is outside the file, or invalid, links to nothing.
pub(crate) fn read(bytes: &[u8], offset: i64) -> Links {
    let mut links = Links::default();
    let Some(start) = usize::try_from(offset).ok().filter(|start| *start < bytes.len()) else { return links };
    let record = &bytes[start..bytes.len().min(start + RECORD)];
    let word = |at: usize| Some(u32::from_le_bytes(record.get(at..at + 4)?.try_into().ok()?));
    let count = word(8).map_or(0, |n| n as usize).min((RECORD - HEAD) / ENTRY);
    // After the unit.
    for at in (0..count).map(|i| HEAD + i * ENTRY + 8) {
        let (Some(ty), Some(id), Some(relation)) = (word(at), word(at + 4), word(at + 8)) else { break };
        match (ty, relation) {
            FOLDER => links.folder = links.folder.or(Some(id)),
            SYMBOLS => links.symbols = links.symbols.or(Some(i64::from(id))),
            SOURCES => links.sources = links.sources.or(Some(id)),
            _ => {}
        }
    }
    links
}
