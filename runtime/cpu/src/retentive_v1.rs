//! Images of version 1: read, not written any more.
//!
//! Magic, version, length and number of data blocks made by the program as in version 2 (`retentive.rs`). Then a
//! checksum over the declarations of the whole program; the retentive ranges of bit memory, of all data blocks as they
//! lay one behind the other, of timers and of counters, each a list with its length; number, length and attributes of
//! each made data block; and the contents in this order. Only a program with the same declarations can say where its
//! data blocks lay.

use std::fmt::Write as _;

use ob1_ir::Program;
use ob1_model::BlockKind;

use crate::arena::Range;
use crate::memory::Memory;
use crate::retentive::{Piece, Reader, What, Why};
use crate::retentive_ranges::{Hash, Keep, common};

/// The version in the image.
pub(crate) const VERSION: u32 = 1;

/// The pieces of an image and their bytes, from behind its head.
pub(crate) fn pieces<'a>(
    reader: &mut Reader<'a>,
    made: u32,
    keep: &Keep,
    memory: &Memory,
) -> Result<Vec<(Piece, &'a [u8])>, Why> {
    if reader.take(8)? != keep.declarations.to_le_bytes() {
        return Err(Why::OtherProgram);
    }
    let piece = |what, at, len| Piece { what, number: 0, at, len, meaning: 0 };
    let [bits, data, timers, counters] = [ranges(reader)?, ranges(reader)?, ranges(reader)?, ranges(reader)?];
    let mut blocks = Vec::new();
    for _ in 0..made {
        let (number, len, attributes) = (reader.u32()?, reader.u32()?, reader.u32()?);
        blocks.push(Piece { number, meaning: attributes.into(), ..piece(What::Made, 0, len) }.checked()?);
    }
    let mut pieces = Vec::new();
    for (at, len) in bits {
        pieces.push((piece(What::Memory, at, len).checked()?, reader.take(len as usize)?));
    }
    for (at, len) in data {
        let bytes = reader.take(len as usize)?;
        let at = memory.all_dbs.at.0.checked_add(at).filter(|at| at.checked_add(len).is_some()).ok_or(Why::Damaged)?;
        let range = Range { at: crate::arena::ArenaByte(at), len };
        for (db, meaning) in memory.dbs[..memory.program_dbs].iter().zip(&keep.meanings) {
            for part in common(&[range], db.range()).filter(|part| part.len > 0) {
                let from = (part.at.0 - at) as usize;
                let piece = piece(What::Data, part.at.0 - db.at.0, part.len);
                let piece = Piece { number: db.number.into(), meaning: *meaning, ..piece };
                pieces.push((piece, &bytes[from..from + part.len as usize]));
            }
        }
    }
    let timers = timers.into_iter().map(|(at, len)| piece(What::Timers, at, len));
    let counters = counters.into_iter().map(|(at, len)| piece(What::Counters, at, len));
    for piece in timers.chain(counters).chain(blocks) {
        let piece = piece.checked()?;
        pieces.push((piece, reader.take(piece.content())?));
    }
    Ok(pieces)
}

/// A list of ranges: first and length.
fn ranges(reader: &mut Reader<'_>) -> Result<Vec<(u32, u32)>, Why> {
    (0..reader.u32()?).map(|_| Ok((reader.u32()?, reader.u32()?))).collect()
}

/// The declarations of data blocks and function blocks of a program, as version 1 summed them up.
pub(crate) fn declarations(program: &Program) -> u64 {
    let mut hash = Hash::default();
    // Writing into the hash cannot fail.
    for db in &program.data {
        let _ = write!(hash, "{} {:?} {} {:?};", db.number, db.kind, db.bytes.len(), db.components);
    }
    for fb in program.blocks.iter().filter(|block| block.id.kind == BlockKind::Fb) {
        let _ = write!(hash, "{} {:?};", fb.id, fb.interface);
    }
    hash.0
}
