//! The STEP 7 data layout: BOOLs fill bits, bytes lie anywhere, everything longer on an even byte; arrays, structures
//! and strings begin on an even byte and are padded to one.

use crate::{BitAddr, DataType, Dimension, Field};

/// One addressable component of a laid-out type: `sub[3].name`.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// The path from the outermost name: `sub[3].name`.
    pub path: String,
    /// The type found there. A list made by [`Layout::components`] holds elementary types and strings; the declarations
    /// of a data block hold composed types whole, to be entered by [`Component::find`].
    pub ty: DataType,
    /// Its address from the start.
    pub at: BitAddr,
}

impl Component {
    /// The component a path leads to, from a list of declarations: `name`, `sub[3].name`, `grid[1,-2]`. Names compare
    /// without regard to case. `None` when the path leads nowhere.
    pub fn find(declarations: &[Component], path: &str) -> Option<Component> {
        let end = path.find(['.', '[']).unwrap_or(path.len());
        let (name, mut rest) = path.split_at(end);
        let first = declarations.iter().find(|c| c.path.eq_ignore_ascii_case(name))?;
        let (mut ty, mut at) = (&first.ty, first.at.0);
        while !rest.is_empty() {
            if let Some(tail) = rest.strip_prefix('.') {
                let end = tail.find(['.', '[']).unwrap_or(tail.len());
                let DataType::Struct(fields) = ty else { return None };
                let mut layout = Layout::new();
                let places = fields.iter().map(|f| (f, layout.place(&f.ty)));
                let (field, offset) = places.into_iter().find(|(f, _)| f.name.eq_ignore_ascii_case(&tail[..end]))?;
                (ty, at, rest) = (&field.ty, at + offset.0, &tail[end..]);
            } else {
                let (indices, tail) = rest.strip_prefix('[')?.split_once(']')?;
                let indices: Vec<i32> = indices.split(',').map(|i| i.trim().parse().ok()).collect::<Option<_>>()?;
                let DataType::Array(dims, element) = ty else { return None };
                let offset = Layout::element(dims, element, &indices)?;
                (ty, at, rest) = (&**element, at + offset.0, tail);
            }
        }
        Some(Component { path: path.to_owned(), ty: ty.clone(), at: BitAddr(at) })
    }
}

/// Builds a layout declaration by declaration.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    next_bit: u32,
}

/// `bit` rounded up to a multiple of `step` bits.
pub const fn align_to(bit: u32, step: u32) -> u32 {
    bit.next_multiple_of(step)
}

impl Layout {
    /// An empty layout at byte 0.
    pub const fn new() -> Self {
        Self { next_bit: 0 }
    }

    /// Places one declaration and returns its address.
    pub fn place(&mut self, ty: &DataType) -> BitAddr {
        let at = align_to(self.next_bit, Self::alignment(ty));
        self.next_bit = at + Self::bits(ty);
        BitAddr(at)
    }

    /// Ends a section (inputs, outputs, ...): the next declaration starts on an even byte.
    pub fn end_section(&mut self) {
        self.next_bit = align_to(self.next_bit, 16);
    }

    /// Bytes used so far, padded to an even number.
    pub const fn bytes(&self) -> u32 {
        align_to(self.next_bit, 16) / 8
    }

    /// Alignment in bits: 1, 8 or 16.
    pub const fn alignment(ty: &DataType) -> u32 {
        match ty.elementary_bits() {
            Some(bits) if bits < 16 => bits,
            _ => 16,
        }
    }

    /// Size in bits, padding of composed types included.
    pub fn bits(ty: &DataType) -> u32 {
        if let Some(bits) = ty.elementary_bits() {
            return bits;
        }
        match ty {
            DataType::DateAndTime => 64,
            DataType::String(n) => align_to((u32::from(*n) + 2) * 8, 16),
            DataType::Pointer => 48,
            DataType::Any => 80,
            DataType::Struct(fields) => {
                let mut inner = Layout::new();
                for field in fields {
                    inner.place(&field.ty);
                }
                inner.bytes() * 8
            }
            DataType::Array(dims, element) => {
                // The last dimension is packed; each row of it starts on an even byte.
                let (last, outer) = match dims.split_last() {
                    Some((last, outer)) => (last.len(), outer.iter().map(|d| d.len()).product::<u32>()),
                    None => (0, 0),
                };
                align_to(last.saturating_mul(Self::stride(element)), 16).saturating_mul(outer)
            }
            // Block, timer and counter numbers are words where they are stored at all.
            _ => 16,
        }
    }

    /// Distance in bits between two elements of an array.
    pub fn stride(element: &DataType) -> u32 {
        align_to(Self::bits(element), Self::alignment(element))
    }

    /// Where the element with these indices lies in an array; `None` when an index is missing or outside its bounds.
    pub fn element(dims: &[Dimension], element: &DataType, indices: &[i32]) -> Option<BitAddr> {
        if dims.len() != indices.len() {
            return None;
        }
        let (last, outer) = dims.split_last()?;
        let offset = |dim: &Dimension, index: i32| {
            (dim.low..=dim.high).contains(&index).then(|| i64::from(index).abs_diff(i64::from(dim.low)) as u32)
        };
        let mut row = 0u32;
        for (dim, index) in outer.iter().zip(indices) {
            row = row.checked_mul(dim.len())?.checked_add(offset(dim, *index)?)?;
        }
        let column = offset(last, *indices.last()?)?;
        let row_bits = align_to(last.len().checked_mul(Self::stride(element))?, 16);
        let at = row.checked_mul(row_bits)?.checked_add(column.checked_mul(Self::stride(element))?)?;
        Some(BitAddr(at))
    }

    /// The element that lies `offset` bits into an array, counted as [`Layout::places`] does, and the bits into it;
    /// `None` where no element lies.
    pub fn element_at(dims: &[Dimension], element: &DataType, offset: u32) -> Option<(u32, u32)> {
        let stride = Self::stride(element).max(1);
        let (last, outer) = dims.split_last()?;
        let row_bits = align_to(last.len().saturating_mul(stride), 16).max(1);
        let rows = outer.iter().map(|d| d.len()).fold(1u32, u32::saturating_mul);
        let (row, in_row) = (offset / row_bits, offset % row_bits);
        let column = in_row / stride;
        (row < rows && column < last.len()).then(|| (row * last.len() + column, in_row % stride))
    }

    /// The last field of a structure with a name that begins `offset` bits into it or before, and the bits behind its
    /// beginning. Nameless structures of no length separate the sections of an instance.
    pub fn field_at(fields: &[Field], offset: u32) -> Option<(&Field, u32)> {
        let mut layout = Self::new();
        let places = fields.iter().map(|field| (field, layout.place(&field.ty).0));
        let begun = places.take_while(|(_, at)| *at <= offset).filter(|(field, _)| !field.name.is_empty());
        begun.last().map(|(field, at)| (field, offset - at))
    }

    /// Where each element of an array lies, the last dimension fastest.
    pub fn places(dims: &[Dimension], element: &DataType) -> Vec<BitAddr> {
        let stride = Self::stride(element);
        let row_bits = dims.last().map_or(0, |d| align_to(d.len().saturating_mul(stride), 16));
        let count: u32 = dims.iter().map(|d| d.len()).product();
        let per_row = dims.last().map_or(1, |d| d.len()).max(1);
        (0..count).map(|i| BitAddr(i / per_row * row_bits + i % per_row * stride)).collect()
    }

    /// The indices of an element, counted as [`Layout::places`] does: `[1,-2]`.
    pub fn index_text(dims: &[Dimension], flat: u32) -> String {
        format!("[{}]", index_text(dims, flat))
    }

    /// All elementary components of `ty` at `base`, in address order.
    pub fn components(path: &str, ty: &DataType, base: BitAddr, out: &mut Vec<Component>) {
        match ty {
            DataType::Struct(fields) => Self::struct_components(path, fields, base, out),
            DataType::Array(dims, element) => {
                for (i, at) in Self::places(dims, element).into_iter().enumerate() {
                    let path = format!("{path}{}", Self::index_text(dims, i as u32));
                    Self::components(&path, element, BitAddr(base.0 + at.0), out);
                }
            }
            _ => out.push(Component { path: path.to_owned(), ty: ty.clone(), at: base }),
        }
    }

    fn struct_components(path: &str, fields: &[Field], base: BitAddr, out: &mut Vec<Component>) {
        let mut inner = Layout::new();
        for field in fields {
            let at = BitAddr(base.0 + inner.place(&field.ty).0);
            let path = if path.is_empty() { field.name.clone() } else { format!("{path}.{}", field.name) };
            Self::components(&path, &field.ty, at, out);
        }
    }
}

fn index_text(dims: &[Dimension], mut flat: u32) -> String {
    let mut indices = Vec::with_capacity(dims.len());
    for dim in dims.iter().rev() {
        let len = dim.len().max(1);
        indices.push((i64::from(dim.low) + i64::from(flat % len)).to_string());
        flat /= len;
    }
    indices.reverse();
    indices.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, ty: DataType) -> Field {
        Field { name: name.into(), ty, initial: None }
    }

    #[test]
    fn bits_then_bytes_then_words() {
        let mut layout = Layout::new();
        let places: Vec<_> = [
            DataType::Bool,
            DataType::Bool,
            DataType::Byte,
            DataType::Bool,
            DataType::Int,
            DataType::Byte,
            DataType::Real,
        ]
        .iter()
        .map(|ty| layout.place(ty).to_string())
        .collect();
        assert_eq!(places, ["0.0", "0.1", "1.0", "2.0", "4.0", "6.0", "8.0"]);
        assert_eq!(layout.bytes(), 12);
    }

    #[test]
    fn arrays_of_bool_take_whole_rows() {
        let dims = vec![Dimension { low: 1, high: 2 }, Dimension { low: 0, high: 9 }];
        let ty = DataType::Array(dims, Box::new(DataType::Bool));
        assert_eq!(Layout::bits(&ty), 64 - 32);
        let mut out = Vec::new();
        Layout::components("a", &ty, BitAddr(0), &mut out);
        assert_eq!(out.len(), 20);
        assert_eq!((out[10].path.as_str(), out[10].at.to_string().as_str()), ("a[2,0]", "2.0"));
        let DataType::Array(dims, element) = &ty else { unreachable!() };
        assert_eq!(Layout::element(dims, element, &[2, 3]), Some(out[13].at));
        assert_eq!(Layout::element(dims, element, &[3, 0]), None);
        assert_eq!(Layout::element(dims, element, &[1]), None);
    }

    #[test]
    fn paths_lead_to_components() {
        let inner = DataType::Struct(vec![field("x", DataType::Bool), field("y", DataType::Int)]);
        let dims = vec![Dimension { low: -1, high: 1 }];
        let whole = DataType::Array(dims, Box::new(inner));
        let declarations = [Component { path: "List".into(), ty: whole.clone(), at: BitAddr(32) }];
        let found = Component::find(&declarations, "list[0].Y").map(|c| (c.ty, c.at.to_string()));
        assert_eq!(found, Some((DataType::Int, "10.0".into())));
        assert_eq!(Component::find(&declarations, "LIST").map(|c| c.ty), Some(whole));
        for wrong in ["", "lists", "list[2]", "list[0", "list[a]", "list.x", "list[0].z", "list[0]x"] {
            assert_eq!(Component::find(&declarations, wrong), None, "{wrong}");
        }
    }

    #[test]
    fn strings_and_structs_are_even() {
        assert_eq!(Layout::bits(&DataType::String(3)), 48);
        let ty = DataType::Struct(vec![
            field("x", DataType::Bool),
            field("y", DataType::Struct(vec![field("z", DataType::Byte)])),
        ]);
        assert_eq!(Layout::bits(&ty), 32);
        let mut out = Vec::new();
        Layout::components("s", &ty, BitAddr(16), &mut out);
        let flat: Vec<_> = out.iter().map(|c| format!("{} {}", c.path, c.at)).collect();
        assert_eq!(flat, ["s.x 2.0", "s.y.z 4.0"]);
    }
}
