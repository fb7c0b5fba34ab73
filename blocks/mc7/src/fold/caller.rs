//! The block in which a frame stands: its operands as the source names them, and the actuals of a call.

use ob1_ir::{Arg, Number, Operand, Place, Width};
use ob1_model::{BitAddr, Param, Section};

use super::values::{Copies, Source};
use crate::block::MachineBlock;
use crate::parts;

/// The block in which a frame stands.
pub(crate) struct Caller<'c, 'b> {
    pub(crate) block: &'c MachineBlock<'b>,
    /// Its own formals in the order of the list.
    pub(crate) order: &'c [u16],
}

impl Caller<'_, '_> {
    /// An operand of the caller as its source names it: variables of its instance, its parameters.
    pub(super) fn operand(&self, operand: Operand) -> Option<Operand> {
        let has_instance = self.block.id.kind.has_instance();
        let place = match operand.place {
            Place::Param { index, at } => {
                if !self.block.id.kind.is_function() {
                    return None;
                }
                Place::Param { index: *self.order.get(usize::from(index))?, at }
            }
            Place::Instance(at) => {
                let bits = u32::from(operand.width.bits());
                if !has_instance || !parts::variable_at(self.block.interface, at, bits) {
                    return None;
                }
                Place::Instance(at)
            }
            other => other,
        };
        Some(Operand { place, ..operand })
    }

    /// The argument of an elementary formal that a value stands for.
    pub(super) fn value(&self, source: Source, formal: &Param) -> Option<Arg> {
        match source {
            Source::Const(value) if formal.ty.is_parameter_type() => {
                u16::try_from(value).ok().map(|n| Arg::Number(Number::Fixed(n)))
            }
            Source::Const(value) => Some(Arg::Const(value)),
            Source::From(operand) if formal.ty.is_parameter_type() => match operand.place {
                Place::Instance(at) => {
                    let (param, offset) = self.block.interface.in_instance(at)?;
                    (param.ty == formal.ty && offset == 0).then_some(Arg::Number(Number::Instance(at)))
                }
                _ => None,
            },
            Source::From(operand) => self.operand(operand).map(Arg::Operand),
            Source::InstanceNumber | Source::InstancePointer(_) => None,
        }
    }

    /// The actual of a formal whose value is copied through `at`; `open` stands for one that is not copied at all.
    pub(super) fn copied(
        &self,
        formal: &Param,
        width: Width,
        at: BitAddr,
        copies: &mut Copies,
        open: Arg,
    ) -> Option<Arg> {
        let put = copies.puts.iter_mut().find(|p| p.at == at && p.width == width && !p.used);
        let out = copies.taken.iter_mut().find(|t| t.at == at && t.width == width && !t.used);
        match (formal.section, put, out) {
            (_, None, None) => Some(open),
            (Section::Input, Some(put), None) => {
                put.used = true;
                self.value(put.source, formal)
            }
            (Section::Output | Section::Return, None, Some(out)) => {
                out.used = true;
                self.operand(Operand { width, place: out.to }).map(Arg::Operand)
            }
            (Section::InOut, Some(put), Some(out)) => {
                (put.used, out.used) = (true, true);
                let Source::From(from) = put.source else { return None };
                (from.place == out.to).then(|| self.operand(from).map(Arg::Operand))?
            }
            // A constant is written to, and lost.
            (Section::InOut, Some(put), None) if matches!(put.source, Source::Const(_)) => {
                put.used = true;
                self.value(put.source, formal)
            }
            _ => None,
        }
    }
}
