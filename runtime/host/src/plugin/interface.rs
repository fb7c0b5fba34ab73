//! Parameter lists of a plugin as the interface a compiler and a CPU work with.

use std::collections::BTreeSet;

use ob1_model::{BitAddr, BlockKind, DataType, Dimension, Interface, Layout, Param, Section};
use ob1_sdk::abi::{self as abi, ParamDesc, ty};

use super::text::{text, word};

/// Converts the parameters and lays them out; `Err`: what is wrong with them.
pub(super) fn of(kind: BlockKind, descs: Vec<&ParamDesc>) -> Result<Interface, String> {
    let mut names = BTreeSet::new();
    let mut params = Vec::new();
    for desc in descs {
        let param = param(kind, desc)?;
        for name in std::iter::once(&param.name).chain(&param.aliases) {
            if !names.insert(name.to_uppercase()) {
                return Err(format!("two parameters are called {name}"));
            }
        }
        if param.section != Section::Static && params.last().is_some_and(|p: &Param| p.section == Section::Static) {
            return Err(format!("parameter {} stands behind instance variables", param.name));
        }
        params.push(param);
    }
    if kind == BlockKind::Ob && !params.is_empty() {
        return Err("an OB has no parameters".to_owned());
    }
    if params.iter().filter(|p| p.section == Section::Return).count() > 1 {
        return Err("two function values".to_owned());
    }
    let instance_bytes = if kind.has_instance() { lay_out(&mut params) } else { 0 };
    Ok(Interface { params, instance_bytes, temp_bytes: 0 })
}

fn param(kind: BlockKind, desc: &ParamDesc) -> Result<Param, String> {
    let name = word(desc.name, "the name of a parameter").map_err(|e| e.to_string())?;
    let aliases = text(desc.aliases, &format!("the other names of {name}")).map_err(|e| e.to_string())?;
    let section = match (desc.section, kind) {
        (abi::SECTION_IN, _) => Section::Input,
        (abi::SECTION_OUT, _) => Section::Output,
        (abi::SECTION_IN_OUT, _) => Section::InOut,
        (abi::SECTION_STATIC, kind) if kind.has_instance() => Section::Static,
        (abi::SECTION_RETURN, BlockKind::Fc | BlockKind::Sfc) => Section::Return,
        (other, _) => return Err(format!("{name} in section {other}, which the block cannot have")),
    };
    let ty = data_type(desc, section).ok_or_else(|| format!("{name} has type {}({})", desc.ty, desc.length))?;
    let initial = kind.has_instance().then(|| initial(&ty, desc.initial)).flatten();
    Ok(Param {
        name,
        aliases: aliases.split('|').filter(|a| !a.is_empty()).map(str::to_owned).collect(),
        section,
        ty,
        at: BitAddr(0),
        initial,
    })
}

fn data_type(desc: &ParamDesc, section: Section) -> Option<DataType> {
    Some(match desc.ty {
        ty::BOOL => DataType::Bool,
        ty::BYTE => DataType::Byte,
        ty::CHAR => DataType::Char,
        ty::WORD => DataType::Word,
        ty::INT => DataType::Int,
        ty::DWORD => DataType::DWord,
        ty::DINT => DataType::DInt,
        ty::REAL => DataType::Real,
        ty::S5TIME => DataType::S5Time,
        ty::TIME => DataType::Time,
        ty::DATE => DataType::Date,
        ty::TIME_OF_DAY => DataType::TimeOfDay,
        ty::DATE_AND_TIME => DataType::DateAndTime,
        ty::STRING => match u8::try_from(desc.length) {
            Ok(n @ 1..=254) => DataType::String(n),
            _ => return None,
        },
        ty::BYTES if section == Section::Static && desc.length > 0 => {
            let dimension = Dimension { low: 0, high: i32::from(desc.length) - 1 };
            DataType::Array(vec![dimension], Box::new(DataType::Byte))
        }
        ty::POINTER => DataType::Pointer,
        ty::ANY => DataType::Any,
        ty::BLOCK_DB => DataType::BlockDb,
        ty::BLOCK_FB => DataType::BlockFb,
        ty::BLOCK_FC => DataType::BlockFc,
        ty::TIMER => DataType::Timer,
        ty::COUNTER => DataType::Counter,
        ty::TIMER_OR_WORD => DataType::TimerOrWord,
        _ => return None,
    })
}

/// The initial value as laid-out bytes; 0 says nothing, and a BOOL is one byte.
fn initial(ty: &DataType, value: u32) -> Option<Vec<u8>> {
    let bits = ty.elementary_bits()?;
    let bytes = value.to_be_bytes();
    let width = bits.div_ceil(8) as usize;
    (value != 0).then(|| bytes[bytes.len() - width..].to_vec())
}

/// Inputs, outputs, in/outs, statics, each from an even byte; the bytes in all.
fn lay_out(params: &mut [Param]) -> u32 {
    let mut layout = Layout::new();
    for section in [Section::Input, Section::Output, Section::InOut, Section::Static] {
        for param in params.iter_mut().filter(|p| p.section == section) {
            param.at = layout.place(&param.ty);
        }
        layout.end_section();
    }
    layout.bytes()
}
