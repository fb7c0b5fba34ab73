//! Constants of STL for tools: a value as it is written, as the bytes of a type, and back.

use ob1_model::DataType;

use crate::constant::{Constant, Encoded};
use crate::diagnostic::Sink;
use crate::lexer;
use crate::operand::Resolver;
use crate::reader::Reader;
use crate::time;
use crate::token::{File, Span};
use crate::words::Words;
use crate::world::World;

/// The bytes of a type for a constant: `S5T#2S`, `'ABC'`, `D#2026-1-31`, `B#(1,2)`, `-5`. A BOOL takes one byte.
///
/// # Errors
/// Why the text is no constant, or none of this type.
pub fn constant_bytes(text: &str, ty: &DataType) -> Result<Vec<u8>, String> {
    let bits = ty.elementary_bits().unwrap_or(0);
    Ok(match constant(text)?.encode(ty)? {
        Encoded::Bytes(bytes) => bytes,
        Encoded::Bits(value) => {
            let bytes = value.to_be_bytes();
            bytes.get(4 - (bits.div_ceil(8) as usize).min(4)..).unwrap_or_default().to_vec()
        }
    })
}

/// A constant as a number for a place without a type, and the bits that such a constant has.
///
/// # Errors
/// Why the text is no constant of up to 32 bits.
pub fn constant_bits(text: &str) -> Result<(u32, u32), String> {
    let constant = constant(text)?;
    let bits = match &constant {
        Constant::Bool(_) => 1,
        Constant::Bits(_, bits) => u32::from(*bits),
        Constant::Count(_) | Constant::S5Time(_) | Constant::Date(_) => 16,
        Constant::Text(text) => text.len() as u32 * 8,
        _ => 32,
    };
    Ok((if let Constant::Bool(bit) = constant { u32::from(bit) } else { constant.load()? }, bits))
}

fn constant(text: &str) -> Result<Constant, String> {
    let (world, words) = (World::default(), Words::of_both());
    let resolver = Resolver::new(&world, &words, None);
    let mut sink = Sink::new();
    let tokens = lexer::lex(0, text, &mut sink);
    let all = 0..tokens.len();
    let file = File { text, tokens };
    let mut reader = Reader::new(0, &file, &mut sink, all, Span::default());
    let constant = resolver.constant(&mut reader);
    let whole = reader.is_empty();
    let told = sink.finish(&[text]).into_iter().next().map(|diagnostic| diagnostic.message);
    match (constant, told) {
        (Some(constant), None) if whole => Ok(constant),
        (_, Some(message)) => Err(message),
        _ => Err("this is not one constant".into()),
    }
}

/// A duration as a constant has it: `1S500MS`, `-2M`, `0MS`.
pub fn duration_text(ms: i64) -> String {
    time::written_duration(ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_as_bytes_of_a_type() {
        for (text, ty, bytes) in [
            ("S5T#1S500MS", DataType::S5Time, &[0x01, 0x50][..]),
            ("T#-1MS", DataType::Time, &[0xFF; 4]),
            ("D#1990-1-2", DataType::Date, &[0, 1]),
            ("tod#0:0:1", DataType::TimeOfDay, &[0, 0, 3, 0xE8]),
            ("L#-5", DataType::DInt, &[0xFF, 0xFF, 0xFF, 0xFB]),
            ("1.5", DataType::Real, &[0x3F, 0xC0, 0, 0]),
            ("'A'", DataType::Char, b"A"),
            ("'AB'", DataType::String(4), &[4, 2, b'A', b'B', 0, 0]),
            ("TRUE", DataType::Bool, &[1]),
        ] {
            assert_eq!(constant_bytes(text, &ty).as_deref(), Ok(bytes), "{text}");
        }
        assert_eq!(constant_bits("C#12"), Ok((0x12, 16)));
        assert_eq!(constant_bits("'AB'"), Ok((0x4142, 16)));
        for wrong in ["", "S5T#3H", "1 2", "Motor", "'A", "D#2001-2-29"] {
            assert!(constant_bytes(wrong, &DataType::Word).is_err() && constant_bits(wrong).is_err(), "{wrong}");
        }
    }
}
