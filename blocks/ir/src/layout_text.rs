//! Types with their bounds, and the addresses of what lies within composed ones, for listings.

use std::fmt::{self, Formatter};

use ob1_model::{BitAddr, DataType, Layout};

/// A type as declared: `STRING[8]`, `ARRAY [1..3] OF INT`.
pub(crate) fn type_text(ty: &DataType) -> String {
    match ty {
        DataType::String(length) => format!("STRING[{length}]"),
        DataType::Array(dims, element) => {
            let bounds: Vec<_> = dims.iter().map(|d| format!("{}..{}", d.low, d.high)).collect();
            format!("ARRAY [{}] OF {}", bounds.join(", "), type_text(element))
        }
        _ => ty.name().to_owned(),
    }
}

/// The components of a structure, one a line, each at its address from `base`; those of an array's element once, as
/// `+offset` from the element. Takes lines in the number of declarations, whatever the bounds of arrays. `lead` is the
/// width of the column before the address.
pub(crate) fn components(
    ty: &DataType,
    base: Option<BitAddr>,
    lead: usize,
    depth: usize,
    f: &mut Formatter<'_>,
) -> fmt::Result {
    match ty {
        DataType::Struct(fields) => {
            let mut layout = Layout::new();
            for field in fields {
                let offset = layout.place(&field.ty);
                // Sections of an instance are separated by nameless structures of no length.
                if field.name.is_empty() {
                    continue;
                }
                let at = base.map_or_else(|| format!("+{offset}"), |base| BitAddr(base.0 + offset.0).to_string());
                let indent = "  ".repeat(depth);
                let column = lead + 7;
                writeln!(f, "  {at:>column$} {indent}{} : {}", field.name, type_text(&field.ty))?;
                components(&field.ty, base.map(|base| BitAddr(base.0 + offset.0)), lead, depth + 1, f)?;
            }
            Ok(())
        }
        DataType::Array(_, element) => components(element, None, lead, depth, f),
        _ => Ok(()),
    }
}
