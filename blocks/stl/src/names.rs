//! Addresses back to names: which component lies where.

use ob1_ir::CodeBlock;
use ob1_model::{BitAddr, Component, DataType, Layout};

/// The path that follows a name, `.sub[2].x`, to what lies `offset` bits into `ty` and has `bits` bits; as far as it
/// leads.
fn path_in(ty: &DataType, offset: u32, bits: u32) -> String {
    match ty {
        _ if offset == 0 && Layout::bits(ty) <= bits => String::new(),
        DataType::Struct(fields) => Layout::field_at(fields, offset)
            .map_or_else(String::new, |(field, into)| format!(".{}{}", field.name, path_in(&field.ty, into, bits))),
        DataType::Array(dims, element) => {
            let stride = Layout::stride(element).max(1);
            let columns = dims.last().map_or(1, |d| d.len()).max(1);
            let row_bits = ob1_model::align_to(columns.saturating_mul(stride), 16).max(1);
            let (row, column) = (offset / row_bits, offset % row_bits / stride);
            let flat = row.saturating_mul(columns).saturating_add(column.min(columns - 1));
            let inner = path_in(element, (offset % row_bits).saturating_sub(column * stride), bits);
            format!("{}{inner}", Layout::index_text(dims, flat))
        }
        _ => String::new(),
    }
}

/// The component of a data block that lies at `at`: `sub[2].x`.
pub(crate) fn in_data(components: &[Component], at: BitAddr, bits: u32) -> Option<String> {
    let index = components.partition_point(|c| c.at.0 <= at.0).checked_sub(1)?;
    let component = components.get(index)?;
    let offset = at.0 - component.at.0;
    (offset < Layout::bits(&component.ty))
        .then(|| format!("{}{}", component.path, path_in(&component.ty, offset, bits)))
}

/// `#name` of what lies at `at` in a function block's instance.
pub(crate) fn in_instance(block: &CodeBlock, at: BitAddr, bits: u32) -> Option<String> {
    let (param, offset) = block.interface.in_instance(at)?;
    if param.is_pointer() {
        return Some(format!("#{}", param.name));
    }
    Some(format!("#{}{}", param.name, path_in(&param.ty, offset, bits)))
}

/// `#name` of what lies `at` bits into the composed in/out with this POINTER.
pub(crate) fn behind(block: &CodeBlock, pointer: BitAddr, at: BitAddr, bits: u32) -> Option<String> {
    let param = block.interface.params.iter().find(|p| p.is_pointer() && p.at == pointer)?;
    Some(format!("#{}{}", param.name, path_in(&param.ty, at.0, bits)))
}

/// `#name` of what lies at `at` in a block's local data; `None` beyond what is declared.
pub(crate) fn in_local(block: &CodeBlock, at: BitAddr, bits: u32) -> Option<String> {
    let (param, offset) = block.interface.in_local(at)?;
    (offset < Layout::bits(&param.ty)).then(|| format!("#{}{}", param.name, path_in(&param.ty, offset, bits)))
}

/// `#name` of a function's parameter, with what lies `at` bits into it.
pub(crate) fn of_param(block: &CodeBlock, index: u16, at: BitAddr, bits: u32) -> Option<String> {
    let param = block.interface.formals().nth(usize::from(index))?;
    Some(format!("#{}{}", param.name, path_in(&param.ty, at.0, bits)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::{Dimension, Field};

    #[test]
    fn addresses_lead_to_names() {
        let field = |name: &str, ty| Field { name: name.into(), ty, initial: None };
        let one = DataType::Struct(vec![field("x", DataType::Bool), field("y", DataType::Int)]);
        let dims = vec![Dimension { low: 1, high: 2 }, Dimension { low: 0, high: 1 }];
        let ty = DataType::Array(dims, Box::new(one));
        let mut flat = Vec::new();
        Layout::components("a", &ty, BitAddr(16), &mut flat);
        assert_eq!(flat.len(), 8);
        let declared = [Component { path: "a".into(), ty, at: BitAddr(16) }];
        for component in flat {
            assert_eq!(in_data(&declared, component.at, Layout::bits(&component.ty)), Some(component.path));
        }
        assert_eq!(in_data(&declared, BitAddr(16 + 32), 32), Some("a[1,1]".into()));
        assert_eq!(in_data(&declared, BitAddr(0), 1), None);
        assert_eq!(in_data(&declared, BitAddr(16 + 16 * 8), 1), None);
    }
}
