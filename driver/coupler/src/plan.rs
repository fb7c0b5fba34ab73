//! Ranges merged into requests.

use ob1_protocols::modbus::pdu;

use crate::config::{Range, Table};

/// Consecutive elements of one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// The table that the elements belong to.
    pub table: Table,
    /// Number of the first element, from 0.
    pub first: u16,
    /// Their number, at most the maximum of a request.
    pub count: u16,
}

impl Chunk {
    const fn end(&self) -> u32 {
        self.first as u32 + self.count as u32
    }

    /// Whether it overlaps a range.
    pub fn meets(&self, range: &Range) -> bool {
        self.table == range.table && u32::from(range.first) < self.end() && u32::from(self.first) < range.end()
    }

    /// Bytes of its elements as transferred.
    pub const fn bytes(&self) -> usize {
        if self.table.has_bits() { (self.count as usize).div_ceil(8) } else { 2 * self.count as usize }
    }
}

/// The requests that read these ranges. Adjacent or overlapping ranges are one request, up to its maximum length. A gap
/// is never read too, because a coupler refuses a request with a missing address.
pub fn reads(ranges: &[Range]) -> Vec<Chunk> {
    let most = |table: Table| if table.has_bits() { pdu::READ_BITS_MAX } else { pdu::READ_WORDS_MAX };
    merged(ranges, most)
}

/// The requests that write these ranges, which do not overlap.
pub fn writes(ranges: &[Range]) -> Vec<Chunk> {
    let most = |table: Table| if table.has_bits() { pdu::WRITE_BITS_MAX } else { pdu::READ_WRITE_WORDS_MAX };
    merged(ranges, most)
}

fn merged(ranges: &[Range], most: impl Fn(Table) -> u16) -> Vec<Chunk> {
    let mut sorted: Vec<&Range> = ranges.iter().filter(|range| range.count > 0).collect();
    sorted.sort_by_key(|range| (range.table, range.first, range.count));
    let mut chunks: Vec<Chunk> = Vec::new();
    for range in sorted {
        let most = u32::from(most(range.table));
        if let Some(last) = chunks.last_mut()
            && last.table == range.table
            && u32::from(range.first) <= last.end()
        {
            let end = last.end().max(range.end());
            if end - u32::from(last.first) <= most {
                last.count = (end - u32::from(last.first)) as u16;
                continue;
            }
        }
        // One range in as few requests as it takes. Two registers can be one value, so a request ends behind a pair.
        let mut first = u32::from(range.first);
        while first < range.end() {
            let rest = range.end() - first;
            let count = if rest <= most { rest } else { most & !1 };
            chunks.push(Chunk { table: range.table, first: first as u16, count: count as u16 });
            first += count;
        }
    }
    chunks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Order;

    fn range(table: Table, first: u16, count: u16) -> Range {
        Range { table, first, count, order: Order::Big, at: 0 }
    }

    fn chunks(ranges: &[Range]) -> Vec<(Table, u16, u16)> {
        reads(ranges).iter().map(|chunk| (chunk.table, chunk.first, chunk.count)).collect()
    }

    #[test]
    fn what_touches_is_one_request() {
        use Table::{Coil, Holding, Input};
        assert_eq!(chunks(&[range(Holding, 4, 4), range(Holding, 0, 4)]), [(Holding, 0, 8)]);
        assert_eq!(chunks(&[range(Holding, 0, 4), range(Holding, 2, 1)]), [(Holding, 0, 4)]);
        assert_eq!(chunks(&[range(Holding, 0, 4), range(Holding, 5, 1)]), [(Holding, 0, 4), (Holding, 5, 1)]);
        assert_eq!(chunks(&[range(Holding, 0, 4), range(Input, 4, 1)]), [(Holding, 0, 4), (Input, 4, 1)]);
        assert_eq!(chunks(&[range(Coil, 0, 16), range(Coil, 16, 3), range(Coil, 30, 0)]), [(Coil, 0, 19)]);
    }

    #[test]
    fn a_request_carries_so_much_and_no_more() {
        use Table::{Discrete, Holding};
        assert_eq!(chunks(&[range(Holding, 0, 100), range(Holding, 100, 25)]), [(Holding, 0, 125)]);
        assert_eq!(chunks(&[range(Holding, 0, 100), range(Holding, 100, 26)]), [(Holding, 0, 100), (Holding, 100, 26)]);
        assert_eq!(chunks(&[range(Holding, 65_400, 136)]), [(Holding, 65_400, 124), (Holding, 65_524, 12)]);
        assert_eq!(chunks(&[range(Holding, 1, 125)]), [(Holding, 1, 125)]);
        assert_eq!(chunks(&[range(Discrete, 0, 2001)]), [(Discrete, 0, 2000), (Discrete, 2000, 1)]);
        let written = writes(&[range(Holding, 0, 122)]);
        assert_eq!(written.iter().map(|chunk| chunk.count).collect::<Vec<_>>(), [120, 2], "no value in two requests");
        assert_eq!(writes(&[range(Table::Coil, 0, 1968)]).len(), 1);
    }
}
