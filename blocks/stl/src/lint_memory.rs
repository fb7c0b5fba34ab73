//! Bit memory that is used under several widths: as bits here and as a word there, or as words that overlap by halves.

use std::collections::BTreeMap;

use ob1_ir::{Operand, Place, Width};
use ob1_model::{Area, BitAddr, BlockId};

use crate::diagnostic::Sink;
use crate::inspect::Inspected;
use crate::messages;
use crate::token::Span;

/// Where an operand was first used.
#[derive(Clone, Copy, Debug)]
struct First {
    file: usize,
    span: Span,
    block: BlockId,
    network: u16,
    line: u32,
}

/// The first use of each bit, word and double word of M.
#[derive(Debug, Default)]
pub(crate) struct MemoryUse {
    bits: BTreeMap<u32, First>,
    /// By first byte and length. Bytes are ignored: flags are packed into them on purpose everywhere.
    wide: BTreeMap<(u32, u32), First>,
}

fn name(byte: u32, bytes: u32) -> String {
    let width = if bytes == 2 { Width::Word } else { Width::DWord };
    Operand { width, place: Place::Fixed(Area::Memory, BitAddr::byte_addr(byte)) }.to_string()
}

impl MemoryUse {
    pub(crate) fn gather(&mut self, i: &Inspected<'_>) {
        for (at, stmt) in i.code.iter().enumerate() {
            let first =
                First { file: i.block.file, span: i.span(at), block: i.id, network: stmt.network, line: stmt.line };
            stmt.op.places(&mut |place, width| {
                let Place::Fixed(Area::Memory, at) = place else { return };
                match width {
                    Width::Bit => {
                        self.bits.entry(at.0).or_insert(first);
                    }
                    Width::Byte => {}
                    Width::Word | Width::DWord => {
                        self.wide.entry((at.byte(), width.bytes())).or_insert(first);
                    }
                }
            });
        }
    }

    /// One finding for each word or double word, whatever the number of bits and words that share its bytes.
    pub(crate) fn report(&self, sink: &mut Sink) {
        for ((byte, bytes), first) in &self.wide {
            sink.steps += 1;
            let mine = name(*byte, *bytes);
            let end = byte + bytes;
            let bit =
                self.bits.range(byte * 8..end * 8).next().map(|(at, first)| (format!("M {}", BitAddr(*at)), first));
            // Of words that overlap by halves, the one with the higher address is reported.
            let half = (byte.saturating_sub(3)..*byte)
                .flat_map(|b| [(b, 2), (b, 4)])
                .filter(|(b, n)| b + n > *byte && b + n < end)
                .find_map(|key| Some((name(key.0, key.1), self.wide.get(&key)?)));
            let Some((other, place)) = half.or(bit) else { continue };
            let message = format!(
                "{mine} and {other} share bytes; {other} is used in {}, network {}, line {}",
                place.block, place.network, place.line
            );
            sink.report(first.file, first.span, &messages::MEMORY_OVERLAP, message);
        }
    }
}
