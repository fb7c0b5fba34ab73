//! A component of a composed parameter: STEP 7 saves the accumulators, opens the data block that the POINTER names,
//! loads AR1 from it, and then does the statement through AR1.

use ob1_ir::{AddressRegister, DbRegister, Number, Op, Operand, Place, Pointer, Width};
use ob1_model::{Area, BitAddr};

use super::values::Cursor;
use crate::block::Item;
use crate::parts;
use crate::statement::Mc7Op;

/// Where the POINTER comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Base {
    /// A parameter of a function, by its place in the list.
    Param(u16),
    /// The instance of a function block.
    Instance(BitAddr),
}

/// The component that the statements reach.
#[derive(Clone, Debug)]
pub(crate) struct Component {
    pub(crate) base: Base,
    /// The local data used on the way.
    pub(crate) locals: Vec<BitAddr>,
    /// Statements taken, the `BLD` included, the last one not.
    pub(crate) used: usize,
    /// The statement through AR1 itself.
    pub(crate) last: Option<Op>,
}

const fn crossing(width: Width, bytes: u32) -> Op {
    let place = Place::Register(None, AddressRegister::Ar1, BitAddr::byte_addr(bytes));
    Op::Load(Operand { width, place })
}

/// The statements after `BLD 5` (a function) or `BLD 18` (a function block).
pub(crate) fn component(kind: u8, rest: &[Item]) -> Option<Component> {
    let ops: Vec<&Mc7Op> = rest.iter().take(16).map(|item| &item.op).collect();
    let mut cursor = Cursor::new(&ops);
    let saved = save(&mut cursor);
    let mut used = 1 + if saved.is_some() { 3 } else { 0 };
    let base = if kind == 5 {
        let Mc7Op::ParamPointer { index, .. } = cursor.next()? else { return None };
        cursor.eat(&Op::LoadAr(AddressRegister::Ar1))?;
        cursor.eat(&crossing(Width::Word, 0))?;
        used += 3;
        Base::Param(*index)
    } else {
        let at = instance_load(cursor.next()?, Width::Word)?;
        used += 1;
        Base::Instance(at)
    };
    let word = parts::local_transfer(cursor.next()?, Width::Word)?;
    let number = Number::Memory(Pointer { area: Area::Local, at: word });
    cursor.eat(&Op::OpenDb(DbRegister::Db, number))?;
    match base {
        Base::Param(_) => cursor.eat(&crossing(Width::DWord, 2))?,
        Base::Instance(at) => {
            let pointer = instance_load(cursor.next()?, Width::DWord)?;
            (pointer.0 == at.0 + 16).then_some(())?;
        }
    }
    cursor.eat(&Op::LoadAr(AddressRegister::Ar1))?;
    used += 4;
    let mut locals = vec![word];
    if let Some((accu1, accu2)) = saved {
        (parts::local_load(cursor.next()?, Width::DWord)? == accu2).then_some(())?;
        (parts::local_load(cursor.next()?, Width::DWord)? == accu1).then_some(())?;
        used += 2;
        locals.extend([accu1, accu2]);
    }
    let last = match cursor.peek() {
        Some(Mc7Op::Plain(op)) => Some(op.clone()),
        _ => None,
    };
    // Without the accumulators put back only a load shows no difference.
    if saved.is_none() && !matches!(last, Some(Op::Load(_))) && kind == 5 {
        return None;
    }
    Some(Component { base, locals, used, last })
}

/// `T LD a; TAK; T LD b`: both accumulators put aside.
fn save(cursor: &mut Cursor<'_>) -> Option<(BitAddr, BitAddr)> {
    let accu1 = parts::local_transfer(cursor.peek()?, Width::DWord)?;
    cursor.next();
    cursor.eat(&Op::ExchangeAccus)?;
    let accu2 = parts::local_transfer(cursor.next()?, Width::DWord)?;
    Some((accu1, accu2))
}

/// Where in the instance a statement loads from.
fn instance_load(op: &Mc7Op, width: Width) -> Option<BitAddr> {
    match op {
        Mc7Op::Plain(Op::Load(Operand {
            width: w,
            place: Place::Register(Some(Area::Di), AddressRegister::Ar2, at),
        })) if *w == width => Some(*at),
        _ => None,
    }
}
