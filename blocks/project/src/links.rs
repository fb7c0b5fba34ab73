//! `linkhrs.lnk`: which block folder, symbol list and source container a program has.

/// What a program's record links to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Links {
    pub(crate) folder: Option<u32>,
    pub(crate) symbols: Option<i64>,
    pub(crate) sources: Option<u32>,
}

/// Length of a record.
const RECORD: usize = 512;
/// Length of its head (own offset, a flag, number of entries, 0) and of an entry: unit type, unit ID, object type,
/// object ID, relation, kind.
const HEAD: usize = 16;
const ENTRY: usize = 24;

/// Object type and relation of the three.
const FOLDER: (u32, u32) = (0x0011_6001, 0x1E);
const SYMBOLS: (u32, u32) = (0x0011_3001, 0x18);
const SOURCES: (u32, u32) = (0x0011_2004, 0x62);

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

/// A record with these links, for writing projects.
pub(crate) fn write(offset: u32, links: Links) -> Vec<u8> {
    let symbols = links.symbols.and_then(|id| u32::try_from(id).ok());
    let entries = [(FOLDER, links.folder), (SYMBOLS, symbols), (SOURCES, links.sources)];
    let entries: Vec<((u32, u32), u32)> = entries.into_iter().filter_map(|(kind, id)| Some((kind, id?))).collect();
    let mut record = Vec::with_capacity(RECORD);
    record.extend(offset.to_le_bytes());
    record.extend(0u32.to_le_bytes());
    record.extend((entries.len() as u32).to_le_bytes());
    record.resize(HEAD, 0);
    for ((ty, relation), id) in entries {
        for word in [0, 0, ty, id, relation, 2] {
            record.extend(word.to_le_bytes());
        }
    }
    record.resize(RECORD, 0);
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_read_as_it_was_written() {
        let links = Links { folder: Some(3), symbols: Some(638), sources: None };
        let mut bytes = vec![0xAA; 512];
        bytes.extend(write(512, links));
        assert_eq!(read(&bytes, 512), links);
        for offset in [-1, 0, 513, 900, 1024, i64::MAX] {
            assert_eq!(read(&bytes, offset).folder, None, "{offset}");
        }
    }
}
