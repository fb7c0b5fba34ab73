//! The text form of a program, for listings: one line a statement, German mnemonics, operands in their typed form.
//!
//! It is made to be read and compared: jump targets are statement numbers, variables are addresses (`PAR0W+0`,
//! `INSTX+2.0`). A statement in the alternate form (`{:#}`) can be read back without loss: [`crate::parse`].

use std::fmt::{self, Display, Formatter, Write as _};

use ob1_model::{Area, BitAddr, Interface, Section, Width};

use crate::layout_text::{components, type_text};
use crate::{
    AccuOp, AddressRegister, Arg, BitTest, Call, CallMode, CodeBlock, DataBlock, DataKind, DbRegister, Logic, Number,
    NumberFormat, Op, Operand, Place, Pointer, Program, Target,
};

/// The letter of a width, `X B W D`.
pub(crate) const fn letter(width: Width) -> &'static str {
    match width {
        Width::Bit => "X",
        Width::Byte => "B",
        Width::Word => "W",
        Width::DWord => "D",
    }
}

/// `MW`, `DBX`, `M`, `PB`: an area with a width.
pub(crate) fn area_text(area: Area, width: Width) -> String {
    let data = matches!(area, Area::Db | Area::Di);
    let letter = if width == Width::Bit && !data { "" } else { letter(width) };
    format!("{}{letter}", area.name())
}

/// `3.0` for a bit, `10` for everything else that lies on a whole byte.
fn address(at: BitAddr, width: Width) -> String {
    if width == Width::Bit || at.bit() != 0 { at.to_string() } else { at.byte().to_string() }
}

impl Display for Pointer {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.area.name(), self.at.byte())
    }
}

impl Display for AddressRegister {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AddressRegister::Ar1 => "AR1",
            AddressRegister::Ar2 => "AR2",
        })
    }
}

impl Display for DbRegister {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DbRegister::Db => "DB",
            DbRegister::Di => "DI",
        })
    }
}

impl Display for Operand {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let width = self.width;
        match self.place {
            Place::Fixed(area, at) => write!(f, "{} {}", area_text(area, width), address(at, width)),
            Place::InDb(db, at) => write!(f, "DB{db}.{} {}", area_text(Area::Db, width), address(at, width)),
            Place::InDi(db, at) => write!(f, "DI{db}.{} {}", area_text(Area::Di, width), address(at, width)),
            Place::Param { index, at } => write!(f, "PAR{index}{}+{}", letter(width), address(at, width)),
            Place::Instance(at) => write!(f, "INST{}+{}", letter(width), address(at, width)),
            Place::Memory(area, pointer) => {
                let at = address(pointer.at, Width::DWord);
                write!(f, "{} [{}D {at}]", area_text(area, width), pointer.area.name())
            }
            Place::Register(Some(area), register, at) => write!(f, "{} [{register},P#{at}]", area_text(area, width)),
            Place::Register(None, register, at) if width == Width::Bit => write!(f, "[{register},P#{at}]"),
            Place::Register(None, register, at) => write!(f, "{} [{register},P#{at}]", letter(width)),
        }
    }
}

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Number::Fixed(n) => write!(f, "{n}"),
            Number::Memory(pointer) => {
                write!(f, "[{}W {}]", pointer.area.name(), address(pointer.at, Width::Word))
            }
            Number::Param(index) => write!(f, "PAR{index}"),
            Number::Instance(at) => write!(f, "INST+{}", address(*at, Width::Word)),
        }
    }
}

impl Display for BitTest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            BitTest::Bit(place) => write!(f, "{}", Operand { width: Width::Bit, place: *place }),
            BitTest::Timer(n) => write!(f, "T {n}"),
            BitTest::Counter(n) => write!(f, "Z {n}"),
            BitTest::Status(status) => f.write_str(status.name()),
        }
    }
}

pub(crate) fn logic(logic: Logic, negate: bool) -> &'static str {
    match (logic, negate) {
        (Logic::And, false) => "U",
        (Logic::And, true) => "UN",
        (Logic::Or, false) => "O",
        (Logic::Or, true) => "ON",
        (Logic::Xor, false) => "X",
        (Logic::Xor, true) => "XN",
    }
}

impl Display for Op {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let bit = |place: &Place| Operand { width: Width::Bit, place: *place };
        let register = |r: &AddressRegister| if *r == AddressRegister::Ar1 { 1 } else { 2 };
        match self {
            Op::Scan { logic: l, negate, test } => write!(f, "{} {test}", logic(*l, *negate)),
            Op::Open { logic: l, negate } => write!(f, "{}(", logic(*l, *negate)),
            Op::Close => f.write_str(")"),
            Op::OrBranch => f.write_str("O"),
            Op::Assign(p) => write!(f, "= {}", bit(p)),
            Op::Set(p) => write!(f, "S {}", bit(p)),
            Op::Reset(p) => write!(f, "R {}", bit(p)),
            Op::EdgePositive(p) => write!(f, "FP {}", bit(p)),
            Op::EdgeNegative(p) => write!(f, "FN {}", bit(p)),
            Op::SetRlo => f.write_str("SET"),
            Op::ClearRlo => f.write_str("CLR"),
            Op::NotRlo => f.write_str("NOT"),
            Op::SaveRlo => f.write_str("SAVE"),
            Op::Load(o) => write!(f, "L {o}"),
            Op::LoadConst(v) => write!(f, "L DW#16#{v:X}"),
            Op::LoadParamPointer { index, at: None } => write!(f, "L P##PAR{index}"),
            Op::LoadParamPointer { index, at: Some(at) } => write!(f, "L P##PAR{index} by P#L {at}"),
            Op::LoadParamCopy { index, bytes, at } => write!(f, "L P##PAR{index} by {bytes} bytes at P#L {at}"),
            Op::Transfer(o) => write!(f, "T {o}"),
            Op::LoadStatus => f.write_str("L STW"),
            Op::TransferStatus => f.write_str("T STW"),
            Op::LoadTimer(n) => write!(f, "L T {n}"),
            Op::LoadTimerBcd(n) => write!(f, "LC T {n}"),
            Op::LoadCounter(n) => write!(f, "L Z {n}"),
            Op::LoadCounterBcd(n) => write!(f, "LC Z {n}"),
            Op::LoadDbLength(r) => write!(f, "L {r}LG"),
            Op::LoadDbNumber(r) => write!(f, "L {r}NO"),
            Op::Arithmetic(NumberFormat::DInt, AccuOp::Mod) => f.write_str("MOD"),
            Op::Arithmetic(format, op) => write!(f, "{}{}", op.name(), format.name()),
            Op::AddConst { format: NumberFormat::DInt, value } => write!(f, "+ L#{value}"),
            Op::AddConst { format: NumberFormat::Real, value } => write!(f, "+ R#{value}"),
            Op::AddConst { value, .. } => write!(f, "+ {value}"),
            Op::Compare(format, how) => write!(f, "{}{}", how.name(), format.name()),
            Op::WordLogic(l, None) => write!(f, "{}W", l.name()),
            Op::WordLogic(l, Some(v)) => write!(f, "{}W W#16#{v:X}", l.name()),
            Op::DWordLogic(l, None) => write!(f, "{}D", l.name()),
            Op::DWordLogic(l, Some(v)) => write!(f, "{}D DW#16#{v:X}", l.name()),
            Op::Shift(s, None) => f.write_str(s.name()),
            Op::Shift(s, Some(n)) => write!(f, "{} {n}", s.name()),
            Op::RotateLeftCc1 => f.write_str("RLDA"),
            Op::RotateRightCc1 => f.write_str("RRDA"),
            Op::Convert(c) => f.write_str(c.name()),
            Op::Math(m) => f.write_str(m.name()),
            Op::ExchangeAccus => f.write_str("TAK"),
            Op::Push => f.write_str("PUSH"),
            Op::Pop => f.write_str("POP"),
            Op::Enter => f.write_str("ENT"),
            Op::Leave => f.write_str("LEAVE"),
            Op::Increment(n) => write!(f, "INC {n}"),
            Op::Decrement(n) => write!(f, "DEC {n}"),
            Op::LoadAr(r) => write!(f, "LAR{}", register(r)),
            Op::LoadArConst(r, v) => write!(f, "LAR{} {}", register(r), pointer_constant(*v)),
            Op::LoadArFrom(r, o) => write!(f, "LAR{} {o}", register(r)),
            Op::CopyAr2ToAr1 => f.write_str("LAR1 AR2"),
            Op::TransferAr(r) => write!(f, "TAR{}", register(r)),
            Op::TransferArTo(r, o) => write!(f, "TAR{} {o}", register(r)),
            Op::CopyAr1ToAr2 => f.write_str("TAR1 AR2"),
            Op::ExchangeArs => f.write_str("TAR"),
            Op::AddAr(r) => write!(f, "+AR{}", register(r)),
            Op::AddArConst(r, at) => write!(f, "+AR{} P#{at}", register(r)),
            Op::OpenDb(r, n) => write!(f, "AUF {r} {n}"),
            Op::ExchangeDbs => f.write_str("TDB"),
            Op::StartTimer(kind, n) => write!(f, "{} T {n}", kind.name()),
            Op::ResetTimer(n) => write!(f, "R T {n}"),
            Op::EnableTimer(n) => write!(f, "FR T {n}"),
            Op::CountUp(n) => write!(f, "ZV Z {n}"),
            Op::CountDown(n) => write!(f, "ZR Z {n}"),
            Op::SetCounter(n) => write!(f, "S Z {n}"),
            Op::ResetCounter(n) => write!(f, "R Z {n}"),
            Op::EnableCounter(n) => write!(f, "FR Z {n}"),
            Op::Jump(j, to) => write!(f, "{} @{to}", j.name()),
            Op::Loop(to) => write!(f, "LOOP @{to}"),
            Op::JumpList { targets, otherwise } => {
                f.write_str("SPL")?;
                targets.iter().try_for_each(|to| write!(f, " @{to}"))?;
                write!(f, " else @{otherwise}")
            }
            Op::Call(call) => call.fmt(f),
            Op::End => f.write_str("BEA"),
            Op::EndIf => f.write_str("BEB"),
            Op::McrActivate => f.write_str("MCRA"),
            Op::McrDeactivate => f.write_str("MCRD"),
            Op::McrOpen => f.write_str("MCR("),
            Op::McrClose => f.write_str(")MCR"),
            Op::Nop => f.write_str("NOP 0"),
            Op::Build(n) => write!(f, "BLD {n}"),
        }
    }
}

/// `P#12.0`, `P#M 3.0`, or the bits if they are not a pointer.
fn pointer_constant(bits: u32) -> String {
    let at = BitAddr::of_pointer(bits);
    match (bits >> 24, Area::from_pointer_code((bits >> 24) as u8)) {
        _ if bits & 0x00F8_0000 != 0 => format!("DW#16#{bits:X}"),
        (0, _) => format!("P#{at}"),
        (_, Some(area)) => format!("P#{} {at}", area_text(area, Width::Bit)),
        _ => format!("DW#16#{bits:X}"),
    }
}

impl Display for Call {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self.mode {
            CallMode::Call => "CALL ",
            CallMode::Unconditional => "UC ",
            CallMode::Conditional => "CC ",
        })?;
        match self.target {
            Target::Block(id) => write!(f, "{id}")?,
            Target::Indirect(kind, number @ Number::Fixed(_)) if f.alternate() => {
                write!(f, "{} #{number}", kind.name())?;
            }
            Target::Indirect(kind, number) => write!(f, "{} {number}", kind.name())?,
            Target::Local(id, at) => write!(f, "{id} INST+{}", address(at, Width::Word))?,
        }
        if let Some(instance) = self.instance {
            write!(f, ", DB {instance}")?;
        }
        if self.args.is_empty() {
            return Ok(());
        }
        let (open, close) = if self.mode == CallMode::Call { (" (", ")") } else { (" { ", " }") };
        f.write_str(open)?;
        for (i, arg) in self.args.iter().enumerate() {
            if i > 0 {
                f.write_str(", ")?;
            }
            arg.fmt(f)?;
        }
        f.write_str(close)
    }
}

impl Display for Arg {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Arg::Open => f.write_char('-'),
            Arg::Const(v) => write!(f, "16#{v:X}"),
            Arg::Bytes(bytes) => {
                f.write_str(if f.alternate() { "B#16#" } else { "16#" })?;
                bytes.iter().try_for_each(|b| write!(f, "{b:02X}"))
            }
            Arg::Operand(o) => write!(f, "{o}"),
            Arg::Number(n) => write!(f, "#{n}"),
            Arg::Raw(bits) if bits & 0x8000_FFFF == 0 => write!(f, "N#{}", bits >> 16),
            Arg::Raw(bits) => f.write_str(&pointer_constant(*bits)),
        }
    }
}

pub(crate) const fn section(section: Section) -> &'static str {
    match section {
        Section::Input => "IN",
        Section::Output => "OUT",
        Section::InOut => "IN_OUT",
        Section::Static => "STAT",
        Section::Temp => "TEMP",
        Section::Return => "RETURN",
    }
}

fn interface(interface: &Interface, has_instance: bool, f: &mut Formatter<'_>) -> fmt::Result {
    for param in &interface.params {
        let at = param.at.to_string();
        write!(f, "  {:<6} {at:>7} {} : {}", section(param.section), param.name, type_text(&param.ty))?;
        match &param.initial {
            Some(bytes) => {
                f.write_str(" := 16#")?;
                bytes.iter().try_for_each(|b| write!(f, "{b:02X}"))?;
                f.write_char('\n')?;
            }
            None => f.write_char('\n')?,
        }
        // What a reference or a POINTER leads to has no address of its own.
        let placed = (has_instance && !param.is_pointer()) || matches!(param.section, Section::Temp);
        components(&param.ty, placed.then_some(param.at), 7, 1, f)?;
    }
    Ok(())
}

impl Display for CodeBlock {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.id)?;
        if let Some(name) = &self.name {
            write!(f, " \"{name}\"")?;
        }
        let Interface { instance_bytes, temp_bytes, .. } = self.interface;
        writeln!(
            f,
            ": {} statements, instance {instance_bytes} bytes, local data {temp_bytes} bytes",
            self.code.len()
        )?;
        interface(&self.interface, self.id.kind.has_instance(), f)?;
        let mut network = 0;
        for (at, stmt) in self.code.iter().enumerate() {
            if stmt.network != network {
                network = stmt.network;
                writeln!(f, "  network {network}")?;
            }
            writeln!(f, "  {at:>5} line {:<5} {}", stmt.line, stmt.op)?;
        }
        Ok(())
    }
}

impl Display for DataBlock {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "DB {}", self.number)?;
        if let Some(name) = &self.name {
            write!(f, " \"{name}\"")?;
        }
        if let DataKind::Instance(fb) = self.kind {
            write!(f, ", instance of {fb}")?;
        }
        let protection = if self.read_only { ", read only" } else { "" };
        let retention = if self.non_retain { ", not retentive" } else { "" };
        writeln!(f, ": {} bytes{protection}{retention}", self.bytes.len())?;
        for component in &self.components {
            let at = component.at.to_string();
            writeln!(f, "  {at:>7} {} : {}", component.path, type_text(&component.ty))?;
            components(&component.ty, Some(component.at), 0, 1, f)?;
        }
        // Rows of zeros are left out.
        for (row, bytes) in (0..).step_by(16).zip(self.bytes.chunks(16)).filter(|(_, b)| b.iter().any(|b| *b != 0)) {
            write!(f, "  {row:>5}:")?;
            bytes.iter().try_for_each(|b| write!(f, " {b:02X}"))?;
            f.write_char('\n')?;
        }
        Ok(())
    }
}

impl Display for Program {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for block in &self.blocks {
            writeln!(f, "{block}")?;
        }
        for data in &self.data {
            writeln!(f, "{data}")?;
        }
        Ok(())
    }
}
