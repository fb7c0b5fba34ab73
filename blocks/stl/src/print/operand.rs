//! Operands as text: addresses, names of variables and parameters, numbers.

use ob1_ir::{AddressRegister, Number, Operand, Place, Pointer, Width};
use ob1_model::{Area, BitAddr, DataType, Interface, Layout, Param, Section};

use super::printer::{Printer, quoted};
use crate::identifiers::Identifier;

/// The path to what lies `offset` bits into a type and is what `wanted` says, `[2].x`; empty for the type itself.
pub(super) fn path(ty: &DataType, offset: u32, wanted: &dyn Fn(&DataType) -> bool) -> Option<String> {
    if offset == 0 && wanted(ty) {
        return Some(String::new());
    }
    match ty {
        DataType::Struct(fields) => {
            let (field, into) = Layout::field_at(fields, offset)?;
            let inner = (into < Layout::bits(&field.ty)).then(|| path(&field.ty, into, wanted))??;
            Some(format!(".{}{inner}", quoted(&field.name)))
        }
        DataType::Array(dims, element) => {
            let (flat, into) = Layout::element_at(dims, element, offset)?;
            let inner = path(element, into, wanted)?;
            Some(format!("{}{inner}", Layout::index_text(dims, flat)))
        }
        _ => None,
    }
}

/// What an access of this width may be declared as.
pub(super) fn of_width(width: Width) -> impl Fn(&DataType) -> bool {
    move |ty| Width::of(ty) == Some(width)
}

/// `#name` of what lies at an address among the declarations.
fn named<'i>(
    params: impl Iterator<Item = &'i Param>,
    at: BitAddr,
    wanted: &dyn Fn(&DataType) -> bool,
) -> Option<String> {
    for param in params {
        let inside = param.at.0 <= at.0 && at.0 < param.at.0 + Layout::bits(&param.ty).max(1);
        if inside && !param.name.is_empty() {
            return path(&param.ty, at.0 - param.at.0, wanted).map(|path| format!("#{}{path}", quoted(&param.name)));
        }
    }
    None
}

/// `#name` of a declared temporary or a component of one.
pub(super) fn of_temp(interface: &Interface, at: BitAddr, wanted: &dyn Fn(&DataType) -> bool) -> Option<String> {
    named(interface.params.iter().filter(|p| p.section == Section::Temp), at, wanted)
}

/// `#name` of a variable of the instance.
pub(super) fn of_instance(interface: &Interface, at: BitAddr, wanted: &dyn Fn(&DataType) -> bool) -> Option<String> {
    named(interface.params.iter().filter(|p| p.section != Section::Temp && !p.is_pointer()), at, wanted)
}

/// `#name` of a function's parameter.
pub(super) fn of_param(
    interface: &Interface,
    index: u16,
    at: BitAddr,
    wanted: &dyn Fn(&DataType) -> bool,
) -> Option<String> {
    let param = interface.formals().nth(usize::from(index))?;
    path(&param.ty, at.0, wanted).map(|path| format!("#{}{path}", quoted(&param.name)))
}

/// `#name` of what the POINTER of a composed in/out of a function block leads to.
pub(super) fn behind(
    interface: &Interface,
    pointer: BitAddr,
    at: BitAddr,
    wanted: &dyn Fn(&DataType) -> bool,
) -> Option<String> {
    let param = interface.params.iter().find(|p| p.is_pointer() && p.at == pointer)?;
    path(&param.ty, at.0, wanted).map(|path| format!("#{}{path}", quoted(&param.name)))
}

const fn register(register: AddressRegister) -> &'static str {
    match register {
        AddressRegister::Ar1 => "AR1",
        AddressRegister::Ar2 => "AR2",
    }
}

impl Printer<'_> {
    /// An operand of the block with this interface; `write` chooses `PA` over `PE`.
    pub(super) fn operand(&self, interface: &Interface, operand: Operand, write: bool) -> Option<String> {
        let Operand { width, place } = operand;
        let wanted = of_width(width);
        match place {
            Place::Fixed(Area::Local, at) => {
                of_temp(interface, at, &wanted).or_else(|| self.absolute(Area::Local, at, width, write))
            }
            Place::Fixed(area, at) => {
                let absolute = self.absolute(area, at, width, write)?;
                let symbol = self.symbols.and_then(|symbols| symbols.get(&absolute));
                Some(symbol.map_or(absolute, |symbol| format!("\"{symbol}\"")))
            }
            Place::InDb(db, at) => Some(format!("DB{db}.{}", self.absolute(Area::Db, at, width, write)?)),
            Place::InDi(db, at) => Some(format!("DI{db}.{}", self.absolute(Area::Di, at, width, write)?)),
            Place::Param { index, at } => of_param(interface, index, at, &wanted),
            Place::Instance(at) => of_instance(interface, at, &wanted),
            Place::Memory(area, at) => Some(format!(
                "{} [{}]",
                self.area(area, width, write)?,
                self.pointer_place(interface, at, Width::DWord)?
            )),
            Place::Register(area, r, at) => {
                if at.byte() > BitAddr::MAX_BYTE {
                    return None;
                }
                let identifier = match (area, width) {
                    (Some(area), width) => format!("{} ", self.area(area, width, write)?),
                    (None, Width::Bit) => String::new(),
                    (None, width) => format!("{} ", self.identifier(Identifier::Crossing(width), false)?),
                };
                Some(format!("{identifier}[{},P#{at}]", register(r)))
            }
        }
    }

    fn area(&self, area: Area, width: Width, write: bool) -> Option<&'static str> {
        self.identifier(Identifier::Memory(area, width), write && area == Area::Peripheral)
    }

    /// `M 1.0`, `DBW 2`.
    pub(super) fn absolute(&self, area: Area, at: BitAddr, width: Width, write: bool) -> Option<String> {
        let identifier = self.area(area, width, write)?;
        if at.byte() + width.bytes() > BitAddr::MAX_BYTE + 1 {
            return None;
        }
        match width {
            Width::Bit => Some(format!("{identifier} {at}")),
            _ if at.bit() == 0 => Some(format!("{identifier} {}", at.byte())),
            _ => None,
        }
    }

    /// `MD 20` of `[MD 20]`, `#name` of `[#name]`.
    fn pointer_place(&self, interface: &Interface, pointer: Pointer, width: Width) -> Option<String> {
        if !matches!(pointer.area, Area::Memory | Area::Local | Area::Db | Area::Di) {
            return None;
        }
        let name = (pointer.area == Area::Local).then(|| of_temp(interface, pointer.at, &of_width(width))).flatten();
        name.or_else(|| self.absolute(pointer.area, pointer.at, width, false))
    }

    /// A number after the letters of what it counts; `#name` alone for a parameter.
    pub(super) fn number(
        &self,
        interface: &Interface,
        letters: &str,
        number: Number,
        ty: &dyn Fn(&DataType) -> bool,
    ) -> Option<String> {
        Some(match number {
            Number::Fixed(n) => format!("{letters} {n}"),
            Number::Memory(pointer) => format!("{letters} [{}]", self.pointer_place(interface, pointer, Width::Word)?),
            Number::Param(index) => of_param(interface, index, BitAddr(0), ty)?,
            Number::Instance(at) => of_instance(interface, at, ty)?,
        })
    }
}
