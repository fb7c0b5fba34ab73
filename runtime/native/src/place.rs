//! Which operands the translation reaches itself, and what is known of them at load.

use ob1_cpu::engine::{Db, Plan};
use ob1_ir::Place;
use ob1_model::Area;

/// How an operand is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// Always there; in the process image or bit memory at this byte of the arena, else in the local data.
    Fixed(Option<u32>),
    /// There when checks pass.
    Checked,
    /// Only the reference engine reaches it.
    Slow,
}

/// The place of a data block of the program.
pub(crate) fn data(plan: &Plan, number: u16) -> Option<Db> {
    plan.data.binary_search_by_key(&number, |db| db.number).ok().map(|i| plan.data[i])
}

/// How a place is reached with `bits` bits.
pub(crate) fn class(place: &Place, bits: u32, plan: &Plan) -> Class {
    match *place {
        Place::Fixed(area, at) => {
            let range = match area {
                Area::Input => plan.areas.inputs,
                Area::Output => plan.areas.outputs,
                Area::Memory => plan.areas.memory,
                Area::Local => return Class::Fixed(None),
                Area::Db | Area::Di => return Class::Checked,
                Area::PreviousLocal | Area::Peripheral => return Class::Slow,
            };
            range.locate(at.byte(), bits.div_ceil(8)).map_or(Class::Slow, |byte| Class::Fixed(Some(byte.0)))
        }
        Place::InDb(n, _) | Place::InDi(n, _) => {
            if data(plan, n).is_some() {
                Class::Checked
            } else {
                Class::Slow
            }
        }
        Place::Param { .. } | Place::Instance(_) => Class::Checked,
        Place::Memory(area, pointer) => {
            let reachable =
                matches!(area, Area::Db | Area::Di | Area::Memory | Area::Input | Area::Output | Area::Local);
            let pointer = match pointer.area {
                Area::Memory => plan.areas.memory.locate(pointer.at.byte(), 4).is_some(),
                Area::Local => true,
                _ => false,
            };
            if reachable && pointer { Class::Checked } else { Class::Slow }
        }
        Place::Register(area, ..) => match area {
            None | Some(Area::Db | Area::Di | Area::Memory | Area::Input | Area::Output | Area::Local) => {
                Class::Checked
            }
            Some(_) => Class::Slow,
        },
    }
}
