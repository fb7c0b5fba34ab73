//! Parts of operations, and what lies at an address of a declaration.

use ob1_ir::{Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, DataType, Interface, Layout};

use crate::statement::Mc7Op;

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

/// True when a variable of the instance, or a component of one, lies at this address with this many bits.
pub(crate) fn variable_at(interface: &Interface, at: BitAddr, bits: u32) -> bool {
    interface.in_instance(at).is_some_and(|(param, offset)| {
        !param.is_pointer() && !param.name.is_empty() && component_at(&param.ty, offset, bits).is_some()
    })
}

/// The elementary type that lies so many bits into a type and is so many bits long.
pub(crate) fn component_at(ty: &DataType, offset: u32, bits: u32) -> Option<&DataType> {
    match ty {
        DataType::Struct(fields) => {
            let (field, into) = Layout::field_at(fields, offset)?;
            component_at(&field.ty, into, bits)
        }
        DataType::Array(dims, element) => {
            let (_, into) = Layout::element_at(dims, element, offset)?;
            component_at(element, into, bits)
        }
        _ => (offset == 0 && ty.elementary_bits() == Some(bits)).then_some(ty),
    }
}

/// True when something that is `wanted` begins so many bits into a type.
pub(crate) fn begins(ty: &DataType, offset: u32, wanted: &dyn Fn(&DataType) -> bool) -> bool {
    let inner = match ty {
        _ if offset == 0 && wanted(ty) => return true,
        DataType::Struct(fields) => Layout::field_at(fields, offset).map(|(field, into)| (&field.ty, into)),
        DataType::Array(dims, element) => Layout::element_at(dims, element, offset).map(|(_, into)| (&**element, into)),
        _ => None,
    };
    inner.is_some_and(|(ty, into)| begins(ty, into, wanted))
}
