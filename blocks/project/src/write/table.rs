//! dBase tables and memo files, written.

/// Bytes of a block of the memo file.
const BLOCK: usize = 512;

/// A table on its way to the file.
pub(crate) struct TableWriter {
    fields: Vec<(&'static str, u8, u8)>,
    records: Vec<Vec<u8>>,
    memos: Option<Vec<u8>>,
}

/// The content of a field.
pub(crate) enum Cell {
    /// A number, as decimal text.
    Number(i64),
    /// Text or binary, padded.
    Bytes(Vec<u8>),
    /// A memo; an empty one has no number.
    Memo(Vec<u8>),
}

impl TableWriter {
    /// A table with these fields: name, type, length.
    pub(crate) fn new(fields: &[(&'static str, char, u8)]) -> Self {
        let has_memo = fields.iter().any(|(_, kind, _)| *kind == 'M');
        let mut head = vec![0u8; BLOCK];
        head[0] = 1;
        head[20..22].copy_from_slice(&(BLOCK as u16).to_le_bytes());
        Self {
            fields: fields.iter().map(|(name, kind, length)| (*name, *kind as u8, *length)).collect(),
            records: Vec::new(),
            memos: has_memo.then_some(head),
        }
    }

    /// Adds a record; fields without a cell stay empty.
    pub(crate) fn row(&mut self, cells: Vec<(&str, Cell)>) {
        let mut record = vec![b' '];
        let mut cells: Vec<(&str, Option<Cell>)> = cells.into_iter().map(|(name, cell)| (name, Some(cell))).collect();
        for (name, _, length) in &self.fields {
            let length = usize::from(*length);
            let cell = cells.iter_mut().find(|(of, _)| of == name).and_then(|(_, cell)| cell.take());
            let (mut bytes, pad) = match cell {
                Some(Cell::Number(number)) => (format!("{number:>length$}").into_bytes(), b' '),
                Some(Cell::Bytes(bytes)) => (bytes, 0),
                Some(Cell::Memo(memo)) => (memo_number(self.memos.as_mut(), &memo, length), b' '),
                None => (Vec::new(), b' '),
            };
            bytes.resize(length, pad);
            record.extend(bytes);
        }
        self.records.push(record);
    }

    /// The bytes of the table, and of its memo file when it has one.
    pub(crate) fn finish(self) -> (Vec<u8>, Option<Vec<u8>>) {
        let record: usize = 1 + self.fields.iter().map(|(.., length)| usize::from(*length)).sum::<usize>();
        let header = 32 + 32 * self.fields.len() + 2;
        let mut out = vec![0u8; 32];
        out[0] = if self.memos.is_some() { 0x8B } else { 0x03 };
        out[4..8].copy_from_slice(&(self.records.len() as u32).to_le_bytes());
        out[8..10].copy_from_slice(&(header as u16).to_le_bytes());
        out[10..12].copy_from_slice(&(record as u16).to_le_bytes());
        for (name, kind, length) in &self.fields {
            let mut descriptor = [0u8; 32];
            descriptor[..name.len()].copy_from_slice(name.as_bytes());
            descriptor[11] = *kind;
            descriptor[16] = *length;
            out.extend(descriptor);
        }
        out.extend([0x0D, 0]);
        self.records.iter().for_each(|record| out.extend(record));
        out.push(0x1A);
        (out, self.memos)
    }
}

/// Puts a memo after the others and gives its block number as text.
fn memo_number(memos: Option<&mut Vec<u8>>, memo: &[u8], length: usize) -> Vec<u8> {
    let Some(memos) = memos.filter(|_| !memo.is_empty()) else { return Vec::new() };
    let number = memos.len() / BLOCK;
    memos.extend([0xFF, 0xFF, 8, 0]);
    memos.extend((memo.len() as u32 + 8).to_le_bytes());
    memos.extend(memo);
    memos.resize(memos.len().next_multiple_of(BLOCK), 0);
    format!("{number:>length$}").into_bytes()
}
