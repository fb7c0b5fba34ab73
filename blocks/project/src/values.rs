//! Values of data blocks as constants of an STL source.

use ob1_model::{BitAddr, Component, DataType, Layout, cells};
use ob1_stl::print::constant;

/// The assignments that make `wanted` out of `start`, component by component; and the paths of values that no constant
/// stands for.
pub(crate) fn assignments(
    components: &[Component],
    start: &[u8],
    wanted: &[u8],
) -> (Vec<(String, String)>, Vec<String>) {
    let mut flat = Vec::new();
    for component in components {
        Layout::components(&component.path, &component.ty, component.at, &mut flat);
    }
    let (mut values, mut unsaid) = (Vec::new(), Vec::new());
    for component in flat {
        let (before, after) = (value(&component.ty, component.at, start), value(&component.ty, component.at, wanted));
        if before == after {
            continue;
        }
        match constant(&component.ty, &after) {
            Some(constant) => values.push((component.path, constant)),
            None => unsaid.push(component.path),
        }
    }
    (values, unsaid)
}

/// The bytes of a value within those of its data block; those outside are 0.
fn value(ty: &DataType, at: BitAddr, bytes: &[u8]) -> Vec<u8> {
    if *ty == DataType::Bool {
        return vec![u8::from(cells::bit(bytes, at.0 as usize).unwrap_or(false))];
    }
    let length = Layout::bits(ty).div_ceil(8) as usize;
    let start = at.byte() as usize;
    let mut out = bytes.get(start.min(bytes.len())..bytes.len().min(start + length)).unwrap_or_default().to_vec();
    out.resize(length, 0);
    out
}
