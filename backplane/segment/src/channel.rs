//! The two channels of a CP 341, one for each of its handling blocks: each side writes a block of 64 bytes for the
//! other under a sequence lock. What the blocks mean is in `docs/cp341-channels.md`; here they are bytes.

use crate::bytes::copy_out;
use crate::cells::{ChannelsCells, IO_WORDS};
use crate::registers::{IoBytes, RegisterWriter};
use crate::seqlock::{Freshness, SeqCell, SeqReader};

pub use ob1_words::channels::{Channel, ChannelBlock};

#[derive(Clone, Copy)]
pub(crate) enum Way {
    ToCp,
    ToCpu,
}

fn cell(cells: &ChannelsCells, channel: Channel, way: Way) -> &SeqCell<IO_WORDS> {
    match (channel, way) {
        (Channel::Send, Way::ToCp) => &cells.send_to_cp.block,
        (Channel::Receive, Way::ToCp) => &cells.receive_to_cp.block,
        (Channel::Send, Way::ToCpu) => &cells.send_to_cpu.block,
        (Channel::Receive, Way::ToCpu) => &cells.receive_to_cpu.block,
    }
}

/// One end of both channels: writes one way, reads the other.
pub(crate) struct ChannelEnd {
    writes: Way,
    reads: Way,
    writers: [RegisterWriter; 2],
    readers: [SeqReader<IO_WORDS>; 2],
}

impl ChannelEnd {
    pub(crate) fn new(writes: Way) -> Self {
        let reads = match writes {
            Way::ToCp => Way::ToCpu,
            Way::ToCpu => Way::ToCp,
        };
        let writer = || RegisterWriter::new(IoBytes::MAX);
        Self { writes, reads, writers: [writer(), writer()], readers: [SeqReader::new(), SeqReader::new()] }
    }

    /// Zeroes both blocks of this end, whatever a predecessor has left.
    pub(crate) fn clear(&mut self, cells: &ChannelsCells) {
        for channel in Channel::ALL {
            self.writers[channel as usize].clear(cell(cells, channel, self.writes));
        }
    }

    /// Writes the last blocks again.
    pub(crate) fn rewrite(&mut self, cells: &ChannelsCells) {
        for channel in Channel::ALL {
            self.writers[channel as usize].rewrite(cell(cells, channel, self.writes));
        }
    }

    /// Writes a block; true if it differs from the last one.
    pub(crate) fn write(&mut self, cells: &ChannelsCells, channel: Channel, block: &ChannelBlock) -> bool {
        self.writers[channel as usize].write(cell(cells, channel, self.writes), block)
    }

    /// Copies the block of the other side.
    pub(crate) fn read(&mut self, cells: &ChannelsCells, channel: Channel, into: &mut ChannelBlock) -> Freshness {
        let reader = &mut self.readers[channel as usize];
        let freshness = reader.read(cell(cells, channel, self.reads), IO_WORDS);
        copy_out(reader.last(), into);
        freshness
    }

    /// Whether the other side has written a block since the last read.
    pub(crate) fn changed(&self, cells: &ChannelsCells, channel: Channel) -> bool {
        self.readers[channel as usize].is_outdated(cell(cells, channel, self.reads))
    }
}
