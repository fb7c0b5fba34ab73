//! Parts of operations, and what lies at an address of a declaration.

use ob1_ir::{BitTest, Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, DataType, Interface, Layout, Param, Section};

use crate::statement::Mc7Op;

/// The one place an operation reads or writes.
pub(crate) const fn place_mut(op: &mut Op) -> Option<&mut Place> {
    match op {
        Op::Scan { test: BitTest::Bit(place), .. }
        | Op::Assign(place)
        | Op::Set(place)
        | Op::Reset(place)
        | Op::EdgePositive(place)
        | Op::EdgeNegative(place) => Some(place),
        Op::Load(operand) | Op::Transfer(operand) | Op::LoadArFrom(_, operand) | Op::TransferArTo(_, operand) => {
            Some(&mut operand.place)
        }
        _ => None,
    }
}

/// The bits of that access.
pub(crate) fn bits_of(op: &Op) -> Option<u32> {
    Some(match op {
        Op::Scan { test: BitTest::Bit(_), .. }
        | Op::Assign(_)
        | Op::Set(_)
        | Op::Reset(_)
        | Op::EdgePositive(_)
        | Op::EdgeNegative(_) => 1,
        Op::Load(operand) | Op::Transfer(operand) | Op::LoadArFrom(_, operand) | Op::TransferArTo(_, operand) => {
            u32::from(operand.width.bits())
        }
        _ => return None,
    })
}

/// Where in the local data a statement transfers to.
pub(crate) fn local_transfer(op: &Mc7Op, width: Width) -> Option<BitAddr> {
    match op {
        Mc7Op::Plain(Op::Transfer(Operand { width: w, place: Place::Fixed(Area::Local, at) })) if *w == width => {
            Some(*at)
        }
        _ => None,
    }
}

/// Where in the local data a statement loads from.
pub(crate) fn local_load(op: &Mc7Op, width: Width) -> Option<BitAddr> {
    match op {
        Mc7Op::Plain(Op::Load(Operand { width: w, place: Place::Fixed(Area::Local, at) })) if *w == width => Some(*at),
        _ => None,
    }
}

/// The declaration that an address of the instance lies in, and the bits into it.
pub(crate) fn in_instance(interface: &Interface, at: BitAddr) -> Option<(&Param, u32)> {
    let placed = interface.params.iter().filter(|p| p.section != Section::Temp);
    let param = placed.filter(|p| p.at.0 <= at.0).max_by_key(|p| p.at.0)?;
    Some((param, at.0 - param.at.0))
}

/// True when a variable of the instance, or a component of one, lies at this address with this many bits.
pub(crate) fn variable_at(interface: &Interface, at: BitAddr, bits: u32) -> bool {
    in_instance(interface, at).is_some_and(|(param, offset)| {
        !param.is_pointer() && !param.name.is_empty() && component_at(&param.ty, offset, bits).is_some()
    })
}

/// The elementary type that lies so many bits into a type and is so many bits long.
pub(crate) fn component_at(ty: &DataType, offset: u32, bits: u32) -> Option<&DataType> {
    match ty {
        DataType::Struct(fields) => {
            let mut layout = Layout::new();
            let mut found = None;
            for field in fields {
                let at = layout.place(&field.ty);
                if !field.name.is_empty() && at.0 <= offset {
                    found = Some((&field.ty, offset - at.0));
                }
            }
            let (ty, offset) = found?;
            component_at(ty, offset, bits)
        }
        DataType::Array(dims, element) => {
            let stride = Layout::stride(element).max(1);
            let (last, outer) = dims.split_last()?;
            let row = ob1_model::align_to(last.len().saturating_mul(stride), 16).max(1);
            let rows = outer.iter().map(|d| d.len()).fold(1u32, u32::saturating_mul);
            let column = offset % row;
            if offset / row >= rows || column / stride >= last.len() {
                return None;
            }
            component_at(element, column % stride, bits)
        }
        _ => (offset == 0 && ty.elementary_bits() == Some(bits)).then_some(ty),
    }
}
