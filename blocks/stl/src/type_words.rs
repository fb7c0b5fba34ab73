//! Types in words, and their widths.

use ob1_ir::Width;
use ob1_model::DataType;

/// `an INT`, `a WORD`.
pub(crate) fn with_article(name: &str) -> String {
    let vowel = name.starts_with(['A', 'E', 'I', 'O', 'S']) && !matches!(name, "STRING" | "STRUCT");
    format!("{} {name}", if vowel { "an" } else { "a" })
}

/// Width of an elementary type.
pub(crate) fn width_of(ty: &DataType) -> Option<Width> {
    Some(match ty.elementary_bits()? {
        1 => Width::Bit,
        8 => Width::Byte,
        16 => Width::Word,
        _ => Width::DWord,
    })
}
