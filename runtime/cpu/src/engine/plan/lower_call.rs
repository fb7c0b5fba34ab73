//! Calls at load: actual parameters against the called block's formals, as references and copies.

use ob1_ir::{Arg, Call as IrCall, CallMode, CodeBlock, Number, Operand, Place, Target};
use ob1_model::{Area, BlockId, Layout, Section, Site};

use super::lowering::{Constants, Lowering, fixed};
use super::{
    Call, CallTarget, Formal, InSource, InstanceIn, InstanceOf, InstanceOut, List, OutTarget, RefArg, Signature,
    Signatures,
};
use crate::LoadError;
use crate::scan_position::Packed;

/// Formals a block may have.
const FORMALS: usize = 256;

/// The bytes of a constant of a formal: right-aligned value to the formal's own width.
fn constant_bytes(value: u32, bits: u32) -> ([u8; 4], usize) {
    match bits {
        1..=8 => ([value as u8, 0, 0, 0], 1),
        9..=16 => {
            let [a, b] = (value as u16).to_be_bytes();
            ([a, b, 0, 0], 2)
        }
        _ => (value.to_be_bytes(), 4),
    }
}

/// Collects the constants of all calls before the memory is laid out.
pub(crate) fn collect(call: &IrCall, signatures: &Signatures, constants: &mut Constants) {
    let (Target::Block(id) | Target::Local(id, _)) = call.target else { return };
    let Some(signature) = signatures.find(id) else { return };
    for (arg, formal) in call.args.iter().zip(&signature.formals) {
        match arg {
            Arg::Const(value) if formal.elementary => {
                let (bytes, len) = constant_bytes(*value, formal.bits);
                constants.add(&bytes[..len]);
            }
            Arg::Bytes(bytes) => constants.add(bytes),
            _ => {}
        }
    }
}

/// Lowers the call at statement `index` of `block`.
pub(crate) fn lower_call(block: &CodeBlock, index: usize, call: &IrCall, l: &Lowering<'_>) -> Result<Call, LoadError> {
    let stmt = &block.code[index];
    let site = Site { block: block.id, network: stmt.network, line: stmt.line };
    let mut lowered = Call {
        mode: call.mode,
        target: CallTarget::Indirect(ob1_model::BlockKind::Fc, Number::Fixed(0)),
        instance: InstanceOf::None,
        instance_bytes: 0,
        refs: Box::default(),
        patches: Box::default(),
        list: None,
        scratch: 0,
        ins: Box::default(),
        outs: Box::default(),
        given: 0,
        copies_out: false,
        safe_point: true,
        site: Packed::of(site),
    };
    let id = match call.target {
        Target::Block(id) | Target::Local(id, _) => id,
        Target::Indirect(kind, number) => {
            let id = BlockId::new(kind, 0);
            lowered.list = raw_list(call, id, None).map_err(|reason| LoadError::Arguments {
                block: id,
                site,
                reason: reason.into(),
            })?;
            lowered.target = CallTarget::Indirect(kind, number);
            return Ok(lowered);
        }
    };
    let Some(signature) = l.signatures.find(id) else {
        return Err(LoadError::MissingBlock { block: id, site });
    };
    lowered.target = CallTarget::Known(signature.callee);
    let wrong = |reason: String| LoadError::Arguments { block: id, site, reason };
    if call.mode != CallMode::Call {
        lowered.list = raw_list(call, id, l.signatures.index(id)).map_err(|reason| wrong(reason.into()))?;
        return Ok(lowered);
    }
    if call.args.len() != signature.formals.len() {
        let (given, wants) = (call.args.len(), signature.formals.len());
        return Err(wrong(format!("{given} parameters instead of {wants}")));
    }
    if signature.formals.len() > FORMALS {
        return Err(wrong(format!("more than {FORMALS} parameters")));
    }
    for (i, arg) in call.args.iter().enumerate().take(64) {
        lowered.given |= u64::from(!matches!(arg, Arg::Open)) << i;
    }
    if id.kind.has_instance() {
        instance_call(call, signature, l, &mut lowered, &wrong)?;
    } else {
        if call.instance.is_some() || matches!(call.target, Target::Local(..)) {
            return Err(wrong("an FC has no instance".into()));
        }
        reference_call(block, call, signature, l, &mut lowered, &wrong)?;
    }
    Ok(lowered)
}

/// The list of pointers of a call without parameters: of an FC or SFC, however short.
fn raw_list(call: &IrCall, id: BlockId, signature: Option<u32>) -> Result<Option<List>, &'static str> {
    if call.mode == CallMode::Call || call.instance.is_some() {
        return Err("a block by number, UC and CC take no parameters");
    }
    if id.kind.has_instance() {
        return if call.args.is_empty() { Ok(None) } else { Err("UC and CC of an FB take no list of pointers") };
    }
    if call.args.len() > FORMALS {
        return Err("a list of more than 256 pointers");
    }
    let raw = |arg: &Arg| if let Arg::Raw(bits) = arg { Some(*bits) } else { None };
    let pointers = call.args.iter().map(raw).collect::<Option<_>>().ok_or("UC and CC take a list of pointers")?;
    Ok(Some(List { pointers, signature }))
}

fn instance_call(
    call: &IrCall,
    signature: &Signature,
    l: &Lowering<'_>,
    lowered: &mut Call,
    wrong: &dyn Fn(String) -> LoadError,
) -> Result<(), LoadError> {
    lowered.instance_bytes = signature.instance_bytes;
    lowered.instance = match (call.target, call.instance) {
        (Target::Local(_, at), None) => InstanceOf::Local(at.0),
        (Target::Block(_), Some(number)) => InstanceOf::Db(number),
        (Target::Local(_, at), Some(number)) => InstanceOf::Within(number, at.0),
        _ => return Err(wrong("an FB runs on an instance data block or as multi-instance".into())),
    };
    let known = match lowered.instance {
        InstanceOf::Db(Number::Fixed(number)) => Some((number, 0)),
        InstanceOf::Within(Number::Fixed(number), at) => Some((number, at / 8)),
        _ => None,
    };
    if let Some((number, first)) = known {
        let end = u64::from(first) + u64::from(signature.instance_bytes);
        match l.program.data.iter().find(|db| db.number == number) {
            Some(db) if (db.bytes.len() as u64) < end => {
                return Err(LoadError::Instance { number, block: signature.id });
            }
            _ => {}
        }
    }
    let (mut ins, mut outs) = (Vec::new(), Vec::new());
    for (i, (arg, formal)) in call.args.iter().zip(&signature.formals).enumerate() {
        let input = matches!(formal.section, Section::Input | Section::InOut);
        let output = formal.section != Section::Input;
        let (at, bits) = (formal.at, formal.bits);
        let from = match arg {
            Arg::Open => continue,
            Arg::Const(value) => InSource::Const(*value),
            Arg::Bytes(bytes) => {
                let base = l.memory.constants.at;
                let at = l.constants.find(bytes).ok_or_else(|| wrong("constant not collected".into()))?;
                InSource::Bytes { at: base.plus(at), len: (bytes.len() as u32).min(bits / 8) }
            }
            Arg::Number(number) if formal.number => InSource::Number(*number),
            Arg::Number(_) => return Err(wrong(format!("parameter {} is no number", i + 1))),
            Arg::Raw(_) => return Err(wrong("CALL takes no list of pointers".into())),
            Arg::Operand(operand) => {
                check_width(*operand, formal, i, wrong)?;
                let known = fixed(operand.place, bits, l).map(|(byte, mask)| byte.bit(mask.trailing_zeros()));
                if output {
                    let to = known.map_or(OutTarget::Place(operand.place), OutTarget::Arena);
                    outs.push(InstanceOut { to, at, bits });
                }
                known.map_or(InSource::Place(operand.place), InSource::Arena)
            }
        };
        if input {
            ins.push(InstanceIn { from, at, bits });
        }
    }
    lowered.copies_out = !outs.is_empty();
    lowered.ins = ins.into_boxed_slice();
    lowered.outs = outs.into_boxed_slice();
    Ok(())
}

/// An elementary formal takes an operand of its own width, a composed one any.
fn check_width(
    operand: Operand,
    formal: &Formal,
    index: usize,
    wrong: &dyn Fn(String) -> LoadError,
) -> Result<(), LoadError> {
    let bits = u32::from(operand.width.bits());
    if (formal.elementary || formal.number) && bits != formal.bits {
        return Err(wrong(format!("parameter {} has {} bits, its operand {bits}", index + 1, formal.bits)));
    }
    Ok(())
}

fn reference_call(
    caller: &CodeBlock,
    call: &IrCall,
    signature: &Signature,
    l: &Lowering<'_>,
    lowered: &mut Call,
    wrong: &dyn Fn(String) -> LoadError,
) -> Result<(), LoadError> {
    let mut refs = Vec::with_capacity(call.args.len());
    let mut patches = Vec::new();
    let mut scratch = 0u32;
    for (i, (arg, formal)) in call.args.iter().zip(&signature.formals).enumerate() {
        let mut take = |bits: u32| {
            let at = scratch * 8;
            scratch += bits.div_ceil(8).next_multiple_of(4);
            at
        };
        let patch = match arg {
            Arg::Open => return Err(wrong(format!("parameter {} is not supplied", i + 1))),
            Arg::Const(value) if formal.number => {
                refs.push(*value & 0xFFFF);
                continue;
            }
            Arg::Const(value) if formal.elementary => {
                if formal.written {
                    RefArg::Scratch { value: *value, bits: formal.bits as u8, scratch: take(formal.bits) }
                } else {
                    let (bytes, len) = constant_bytes(*value, formal.bits);
                    let at = l.constants.find(&bytes[..len]).ok_or_else(|| wrong("constant not collected".into()))?;
                    refs.push(l.memory.constants.at.plus(at).bit(0).0);
                    continue;
                }
            }
            Arg::Const(_) => return Err(wrong(format!("parameter {} is no single value", i + 1))),
            Arg::Bytes(bytes) => {
                if formal.number || formal.elementary || bytes.len() < (formal.least_bits() / 8) as usize {
                    return Err(wrong(format!("parameter {} has {} bits", i + 1, formal.bits)));
                }
                let at = l.constants.find(bytes).ok_or_else(|| wrong("constant not collected".into()))?;
                let at = l.memory.constants.at.plus(at);
                if formal.written {
                    let len = bytes.len() as u32;
                    RefArg::Bytes { at, len, scratch: take(len * 8) }
                } else {
                    refs.push(at.bit(0).0);
                    continue;
                }
            }
            Arg::Number(Number::Fixed(n)) if formal.number => {
                refs.push(u32::from(*n));
                continue;
            }
            Arg::Number(number) if formal.number => RefArg::Number(*number),
            Arg::Number(_) => return Err(wrong(format!("parameter {} is no number", i + 1))),
            Arg::Raw(_) => return Err(wrong("CALL takes no list of pointers".into())),
            Arg::Operand(operand) => {
                check_width(*operand, formal, i, wrong)?;
                if formal.number {
                    RefArg::Value(operand.place)
                } else if let Some((byte, mask)) = fixed(operand.place, formal.least_bits(), l) {
                    refs.push(byte.bit(mask.trailing_zeros()).0);
                    continue;
                } else {
                    operand_reference(caller, operand.place, formal, i, &mut take, wrong)?
                }
            }
        };
        refs.push(0);
        patches.push((i as u16, patch));
    }
    lowered.copies_out = patches.iter().any(|(_, p)| matches!(p, RefArg::Copy { out: true, .. }));
    lowered.refs = refs.into_boxed_slice();
    lowered.patches = patches.into_boxed_slice();
    lowered.scratch = scratch;
    Ok(())
}

/// The reference to an operand that is neither E, A nor M.
fn operand_reference(
    caller: &CodeBlock,
    place: Place,
    formal: &Formal,
    index: usize,
    take: &mut dyn FnMut(u32) -> u32,
    wrong: &dyn Fn(String) -> LoadError,
) -> Result<RefArg, LoadError> {
    let (bits, out) = (formal.least_bits(), formal.section != Section::Input);
    Ok(match place {
        Place::Fixed(Area::Local, at) => {
            let end = u64::from(at.0) + u64::from(bits);
            if end > u64::from(caller.interface.temp_bytes.max(at.byte() + bits.div_ceil(8).min(4))) * 8 {
                return Err(wrong(format!("parameter {} reaches beyond the caller's local data", index + 1)));
            }
            RefArg::Local(at.0)
        }
        Place::Fixed(Area::Db, at) => RefArg::Db { at: at.0, bits },
        Place::Param { index: own, at } => {
            let Some(param) = caller.interface.formals().nth(usize::from(own)) else {
                return Err(wrong(format!("no parameter {own}")));
            };
            if u64::from(at.0) + u64::from(bits) > u64::from(Layout::bits(&param.ty).max(8)) {
                return Err(wrong(format!("{} is too small for parameter {}", param.name, index + 1)));
            }
            // STEP 7 copies what an FC hands on: a write to the actual parameter by another name does not reach it.
            match formal.elementary {
                true => RefArg::Copy { place, bits, scratch: take(bits), out },
                false => RefArg::Param { index: own, at: at.0 },
            }
        }
        place if formal.elementary => RefArg::Copy { place, bits, scratch: take(bits), out },
        Place::Fixed(Area::Peripheral, _) => {
            return Err(wrong(format!("parameter {} cannot lie in the peripheral area", index + 1)));
        }
        place => RefArg::Located { place, bits, out },
    })
}
