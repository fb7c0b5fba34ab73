//! The segment table: how long each network is, and where the jumps stand.

use crate::error::{Mc7Error, Problem};

/// The table after a block's code, in the project folder and on the CPU alike.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Segments {
    /// Bytes of code of each network. The final `BE` belongs to none, except in blocks from SCL, whose one network
    /// counts it.
    pub networks: Vec<u16>,
    /// The place of each jump statement, in words from the beginning of the code, in no order. The names of labels go
    /// by these entries.
    pub jumps: Vec<u16>,
    /// What follows; its meaning is unknown.
    pub rest: Vec<u8>,
}

impl Segments {
    /// Reads a table. An empty one is one without networks.
    ///
    /// # Errors
    /// S1507 where a count leads beyond the bytes.
    pub fn read(bytes: &[u8]) -> Result<Self, Mc7Error> {
        if bytes.is_empty() {
            return Ok(Self::default());
        }
        let (networks, rest) = list(bytes, 0)?;
        // A block without any jump may lack the count.
        if rest.is_empty() {
            return Ok(Self { networks, ..Self::default() });
        }
        let (jumps, rest) = list(rest, bytes.len() - rest.len())?;
        Ok(Self { networks, jumps, rest: rest.to_vec() })
    }

    /// The bytes of the table.
    pub fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for part in [&self.networks, &self.jumps] {
            // More than 65,535 are impossible: the code has as many bytes at most.
            let count = part.len().min(usize::from(u16::MAX));
            out.extend_from_slice(&(count as u16).to_le_bytes());
            part.iter().take(count).for_each(|word| out.extend_from_slice(&word.to_le_bytes()));
        }
        out.extend_from_slice(&self.rest);
        out
    }

    /// The network, from 1, of the statement at an offset of the code.
    pub fn network_at(&self, offset: usize) -> u16 {
        let mut end = 0usize;
        for (number, length) in (1u16..).zip(&self.networks) {
            end += usize::from(*length);
            if offset < end {
                return number;
            }
        }
        // The final BE, or no table: the last network.
        u16::try_from(self.networks.len()).unwrap_or(u16::MAX).max(1)
    }
}

/// A count and so many words, and what follows.
fn list(bytes: &[u8], at: usize) -> Result<(Vec<u16>, &[u8]), Mc7Error> {
    let short = || Mc7Error::at(Problem::SegmentTable, at, bytes);
    let count = bytes.get(..2).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]]))).ok_or_else(short)?;
    let words = bytes.get(2..2 + 2 * count).ok_or_else(short)?;
    let words = words.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    Ok((words, bytes.get(2 + 2 * count..).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_network_without_jumps() {
        let bytes = [1, 0, 0x34, 0, 0, 0];
        let table = Segments::read(&bytes).expect("a table");
        assert_eq!(table, Segments { networks: vec![52], ..Segments::default() });
        assert_eq!(table.bytes(), bytes);
    }

    #[test]
    fn networks_of_length_nothing_are_passed_over() {
        let table = Segments { networks: vec![4, 0, 6], jumps: vec![1, 3], rest: vec![9, 0] };
        assert_eq!(Segments::read(&table.bytes()), Ok(table.clone()));
        let at: Vec<_> = [0, 2, 4, 8, 10, 99].map(|offset| table.network_at(offset)).into();
        assert_eq!(at, [1, 1, 3, 3, 3, 3]);
        assert_eq!(Segments::default().network_at(7), 1);
    }

    #[test]
    fn counts_beyond_the_bytes_are_refused() {
        for bytes in [&[1][..], &[2, 0, 1, 0], &[0, 0, 1, 0], &[0xFF, 0xFF, 0, 0]] {
            assert_eq!(Segments::read(bytes).map_err(|e| e.code()), Err("S1507"), "{bytes:?}");
        }
    }
}
