//! Calls as text, with the names of their parameters.

use std::fmt::Write as _;

use ob1_ir::compose::Handed;
use ob1_ir::{Arg, Call, CallMode, CodeBlock, Number, Operand, Place, Target, Width};
use ob1_model::{Area, BitAddr, BlockId, DataType, Interface, Param, Section};

use super::constant::{constant, elementary};
use super::operand::{of_instance, of_param, of_temp};
use super::printer::{Printer, quoted};
use crate::fit::same_layout;
use crate::identifiers::Identifier;
use crate::mnemonics::Shape;
use crate::tia;

impl Printer<'_> {
    /// A call with its actual parameters; `handed`: what was put together for it. The error says what cannot be said.
    pub(super) fn call(&self, block: &CodeBlock, call: &Call, handed: &[Handed]) -> Result<String, String> {
        let mode = call.mode;
        let mut out = self.mnemonic(&|shape| matches!(shape, Shape::Call(m) if *m == mode)).to_owned();
        out.push_str(&self.called(block, call)?);
        match mode {
            CallMode::Call => {
                let actuals = self.actuals(block, call, handed)?;
                for (at, (name, text)) in actuals.iter().enumerate() {
                    let before = if at == 0 { " (\n        " } else { ",\n        " };
                    let _ = write!(out, "{before}{name} := {text}");
                }
                if !actuals.is_empty() {
                    out.push(')');
                }
            }
            _ => self.list(call, &mut out)?,
        }
        Ok(out)
    }

    /// ` FB 5, DB 6`: what is called.
    pub(super) fn called(&self, block: &CodeBlock, call: &Call) -> Result<String, String> {
        let mut out = String::new();
        let interface = &block.interface;
        match call.target {
            Target::Block(id) => {
                let _ = write!(out, " {id}");
            }
            Target::Local(id, at) => {
                if call.instance.is_some() {
                    return Err(format!("an instance of {id} within a data block"));
                }
                let name = self.instance(interface, id, at).ok_or_else(|| format!("an instance of {id} at {at}"))?;
                // The type of one in a structure does not say its block.
                let block = if tia::is_data_type(id) { format!("{id}, ") } else { String::new() };
                let _ = write!(out, " {block}{name}");
            }
            Target::Indirect(kind, number) => {
                let wanted = |ty: &DataType| matches!(ty, DataType::BlockFb | DataType::BlockFc);
                let number = self.number(interface, kind.name(), number, &wanted);
                let _ = write!(out, " {}", number.ok_or("a block given in this way")?);
            }
        }
        match call.instance {
            Some(Number::Fixed(n)) if n > 0 => {
                let _ = write!(out, ", DB {n}");
            }
            Some(_) => return Err("an instance data block given in this way".to_owned()),
            None => {}
        }
        Ok(out)
    }

    /// `{ P#M 1.0, N#15 }` of `UC` and `CC`.
    fn list(&self, call: &Call, out: &mut String) -> Result<(), String> {
        for (at, arg) in call.args.iter().enumerate() {
            let Arg::Raw(bits) = arg else { return Err("parameters of UC or CC".to_owned()) };
            let text = match bits {
                number if number & 0x8000_FFFF == 0 => format!("N#{}", number >> 16),
                bits => self.pointer(*bits, 0).unwrap_or_else(|| format!("DW#16#{bits:X}")),
            };
            let _ = write!(out, "{}{text}", if at == 0 { " { " } else { ", " });
        }
        if !call.args.is_empty() {
            out.push_str(" }");
        }
        Ok(())
    }

    /// Names and texts of the actual parameters that are supplied.
    pub(super) fn actuals(
        &self,
        block: &CodeBlock,
        call: &Call,
        handed: &[Handed],
    ) -> Result<Vec<(String, String)>, String> {
        let mut out = Vec::new();
        let (Target::Block(id) | Target::Local(id, _)) = call.target else { return Ok(out) };
        let callee = (self.callees)(id).ok_or_else(|| format!("a call of {id}, whose parameters are not known"))?;
        let mut named = 0;
        for (formal, arg) in callee.formals().zip(&call.args) {
            let one = handed.iter().find(|one| *arg == one.arg());
            let text = match arg {
                Arg::Open => continue,
                Arg::Const(bits) => elementary(&formal.ty, *bits),
                Arg::Bytes(bytes) if formal.is_pointer() => {
                    self.pointer_bytes(bytes).filter(|_| id.kind.has_instance() && bytes.len() == 6)
                }
                Arg::Bytes(bytes) => match formal.ty {
                    DataType::Any | DataType::Pointer => self.pointer_bytes(bytes),
                    ref ty => constant(ty, bytes),
                },
                Arg::Operand(operand) => match one {
                    Some(one) => {
                        named += 1;
                        of_instance(&block.interface, one.to, &|ty| one.fits(ty))
                    }
                    None => self.actual(&block.interface, formal, *operand, id),
                },
                Arg::Number(number) => self.actual_number(&block.interface, formal, *number),
                Arg::Raw(_) => None,
            };
            let text = text.ok_or_else(|| format!("the actual `{arg}` of {} of {id}", formal.name))?;
            out.push((quoted(&formal.name), text));
        }
        if named == handed.len() { Ok(out) } else { Err("a pointer that it does not take".to_owned()) }
    }

    /// An operand as actual parameter.
    fn actual(&self, interface: &Interface, formal: &Param, operand: Operand, callee: BlockId) -> Option<String> {
        if !formal.ty.is_composed() {
            let wanted = Width::of(&formal.ty).or(matches!(formal.ty, DataType::TimerOrWord).then_some(Width::Word))?;
            let write = matches!(formal.section, Section::Output | Section::InOut | Section::Return);
            return self.operand(interface, operand, write).filter(|_| wanted == operand.width);
        }
        // What is handed over whole has a name of the same type, or else its place.
        let own = matches!(formal.ty, DataType::Any | DataType::Pointer);
        if operand.width != Width::Byte || callee.kind.has_instance() && formal.is_pointer() {
            return None;
        }
        let same = |ty: &DataType| if own { *ty == formal.ty } else { same_layout(&formal.ty, ty) };
        match operand.place {
            Place::Fixed(Area::Local, at) => {
                of_temp(interface, at, &same).or_else(|| self.place(Area::Local, at, 0).filter(|_| !own))
            }
            Place::Fixed(area, at) if !own => self.place(area, at, 0),
            Place::InDb(db, at) if !own => self.place(Area::Db, at, db),
            Place::Instance(at) => of_instance(interface, at, &same),
            Place::Param { index, at } => of_param(interface, index, at, &same),
            _ => None,
        }
    }

    fn place(&self, area: Area, at: BitAddr, db: u16) -> Option<String> {
        self.pointer(u32::from(area.pointer_code()) << 24 | at.0, db)
    }

    fn actual_number(&self, interface: &Interface, formal: &Param, number: Number) -> Option<String> {
        let letters = match formal.ty {
            DataType::Timer | DataType::TimerOrWord => self.identifier(Identifier::Timer, false)?,
            DataType::Counter => self.identifier(Identifier::Counter, false)?,
            DataType::BlockDb => "DB",
            DataType::BlockFb => "FB",
            DataType::BlockFc => "FC",
            _ => return None,
        };
        if formal.ty == DataType::BlockDb && number == Number::Fixed(0) {
            return None;
        }
        let timer = |ty: &DataType| matches!(ty, DataType::Timer | DataType::TimerOrWord);
        self.number(interface, letters, number, &|ty| *ty == formal.ty || timer(ty) && timer(&formal.ty))
    }

    /// `#name` of the multi-instance at an address: what is declared there is as long as the block's instance.
    fn instance(&self, interface: &Interface, id: BlockId, at: BitAddr) -> Option<String> {
        let bytes = (self.callees)(id)?.instance_bytes;
        let long = |ty: &DataType| matches!(ty, DataType::Struct(_)) && ob1_model::Layout::bits(ty) == bytes * 8;
        of_instance(interface, at, &long)
    }
}
