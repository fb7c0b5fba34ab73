//! Statements as text.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_ir::compose::Handed;
use ob1_ir::{
    AddressRegister, BitTest, CodeBlock, DbRegister, Jump, Number, NumberFormat, Op, Operand, Place, StatusBit, Width,
};
use ob1_model::{Area, BitAddr, DataType};

use super::labels::labels;
use super::operand::{behind, of_param, of_width};
use super::printer::{Listing, Printer, Unprintable};
use crate::identifiers::{Identifier, RELATIONS};
use crate::mnemonics::Shape;

impl Printer<'_> {
    /// The statements of a block one by one, without headings and labels' columns: the index of the first operation of
    /// each, and its text.
    ///
    /// # Errors
    /// What no source can express, with its statement, as of [`Printer::statements`].
    pub fn lines(&self, block: &CodeBlock, listing: &Listing) -> Result<Vec<(usize, String)>, Unprintable> {
        let labels = labels(block, &listing.labels);
        let mut lines = Lines { printer: *self, block, listing, labels, out: String::new(), network: 0 };
        let (mut at, mut all) = (0, Vec::new());
        while at < block.code.len() {
            lines.networks(block.code.get(at).map_or(0, |stmt| stmt.network));
            lines.out.clear();
            let used = lines.statement(at)?;
            // A call with parameters has several lines.
            all.push((at, lines.out.trim_end().replace("\n        ", " ")));
            at += used;
        }
        Ok(all)
    }

    /// The statements of a block in parts; where one cannot be expressed in a source, it is shown as the operation.
    pub fn shown(&self, block: &CodeBlock, listing: &Listing) -> Vec<Shown> {
        let labels = labels(block, &listing.labels);
        let lines = Lines { printer: *self, block, listing, labels, out: String::new(), network: 0 };
        let (mut at, mut all) = (0, Vec::new());
        while at < block.code.len() {
            let shown = lines.shown(at);
            at += shown.used as usize;
            all.push(shown);
        }
        all
    }

    /// The statements of a block, each network with its heading, each line ended.
    ///
    /// # Errors
    /// The first statement that no source can express.
    pub fn statements(&self, block: &CodeBlock, listing: &Listing) -> Result<String, Unprintable> {
        let labels = labels(block, &listing.labels);
        let mut lines = Lines { printer: *self, block, listing, labels, out: String::new(), network: 0 };
        let mut at = 0;
        while at < block.code.len() {
            at += lines.statement(at)?;
        }
        lines.networks(listing.networks.len().min(usize::from(u16::MAX)) as u16);
        Ok(lines.out)
    }
}

struct Lines<'l, 'p> {
    printer: Printer<'p>,
    block: &'l CodeBlock,
    listing: &'l Listing,
    labels: BTreeMap<u32, String>,
    out: String,
    network: u16,
}

/// A statement as it is shown, in parts; for views other than text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// The first operation, and how many it is. The last one does what the statement says.
    pub at: u32,
    /// How many operations it is.
    pub used: u32,
    /// Its label; empty without one.
    pub label: String,
    /// What follows the mnemonic, perhaps nothing; of a call what is called.
    pub operand: String,
    /// The actual parameters of a `CALL` that are supplied, each with the name of its formal.
    pub actuals: Vec<(String, String)>,
}

impl Lines<'_, '_> {
    fn wrong(&self, at: usize, what: impl Into<String>) -> Unprintable {
        Unprintable { block: self.block.id, statement: Some(at as u32), what: what.into() }
    }

    /// Begins networks up to this one.
    fn networks(&mut self, upto: u16) {
        while self.network < upto {
            self.out.push_str("NETWORK\n");
            let heading = self.listing.networks.get(usize::from(self.network));
            self.network += 1;
            let Some((title, comment)) = heading else { continue };
            if !title.is_empty() {
                let _ = writeln!(self.out, "TITLE = {}", one_line(title));
            }
            for line in comment.lines() {
                let _ = writeln!(self.out, "//{}", one_line(line));
            }
        }
    }

    /// Prints the statement at an index, and gives how many operations it is.
    fn statement(&mut self, at: usize) -> Result<usize, Unprintable> {
        let Some(stmt) = self.block.code.get(at) else { return Ok(1) };
        if stmt.network < self.network || stmt.network == 0 {
            return Err(self.wrong(at, "a network before the one begun"));
        }
        self.networks(stmt.network);
        for line in self.listing.before.get(&(at as u32)).into_iter().flatten() {
            let _ = writeln!(self.out, "// {}", one_line(line));
        }
        let several = self.through(at).map(|text| (text, 3)).or_else(|| self.pointed(at).map(|text| (text, 7)));
        let (text, used) = match several.or_else(|| self.handed(at)) {
            Some(several) => several,
            None => (self.text(at)?, 1),
        };
        let label = self.labels.get(&(at as u32)).map(|name| format!("{name}:"));
        let _ = write!(self.out, "{:<6}{text};", label.unwrap_or_default());
        if let Some(comment) = self.listing.beside.get(&(at as u32)) {
            let _ = write!(self.out, "  // {}", one_line(comment));
        }
        self.out.push('\n');
        Ok(used)
    }

    /// The statement at an index, in parts.
    fn shown(&self, at: usize) -> Shown {
        let mut shown = Shown { at: at as u32, used: 1, ..Shown::default() };
        shown.label = self.labels.get(&shown.at).cloned().unwrap_or_default();
        let pointers = self.pointers(at).unwrap_or_else(|| (Vec::new(), 1));
        let several = self.through(at).map(|text| (text, 3)).or_else(|| self.pointed(at).map(|text| (text, 7)));
        if let Some((text, used)) = several {
            (shown.operand, shown.used) = (text.split_once(' ').map_or("", |(_, operand)| operand).to_owned(), used);
            return shown;
        }
        let Some(op) = self.block.code.get(at + pointers.1 - 1).map(|stmt| &stmt.op) else { return shown };
        shown.used = pointers.1 as u32;
        let Op::Call(call) = op else {
            shown.operand = self.operand(at, op).unwrap_or_else(|| op.to_string());
            return shown;
        };
        let called = self.printer.called(self.block, call);
        match (called, self.printer.actuals(self.block, call, &pointers.0)) {
            (Ok(called), Ok(actuals)) => (shown.operand, shown.actuals) = (called.trim_start().to_owned(), actuals),
            _ => shown.operand = op.to_string(),
        }
        shown
    }

    /// A component of a composed in/out of a function block: the data block its POINTER names is opened, AR1 loaded,
    /// and the statement done through AR1.
    fn through(&self, at: usize) -> Option<String> {
        let [open, load, last] = self.block.code.get(at..at + 3)? else { return None };
        let Op::OpenDb(DbRegister::Db, Number::Instance(pointer)) = open.op else { return None };
        let from = Operand { width: Width::DWord, place: Place::Instance(BitAddr(pointer.0 + 16)) };
        if load.op != Op::LoadArFrom(AddressRegister::Ar1, from) || open.network != last.network {
            return None;
        }
        let inside = [at + 1, at + 2].iter().any(|i| self.labels.contains_key(&(*i as u32)));
        let operand = last.op.operand().filter(|_| !inside)?;
        let Place::Register(None, AddressRegister::Ar1, offset) = operand.place else { return None };
        let name = behind(&self.block.interface, pointer, offset, &of_width(operand.width))?;
        if matches!(last.op, Op::TransferArTo(AddressRegister::Ar1, _)) {
            return None;
        }
        Some(format!("{} {name}", self.mnemonic(&last.op)))
    }

    /// `LAR1 P##name` of a function's parameter: the pointer comes by ACCU1, both accumulators are kept in the local
    /// data after what is declared.
    fn pointed(&self, at: usize) -> Option<String> {
        let [a, tak, b, pointer, load, back, again] = self.block.code.get(at..at + 7)? else { return None };
        let (Op::Transfer(accu1), Op::Transfer(accu2)) = (&a.op, &b.op) else { return None };
        let hidden = |operand: &Operand| {
            let Place::Fixed(Area::Local, at) = operand.place else { return false };
            operand.width == Width::DWord && at.byte() >= self.block.interface.declared_temps()
        };
        let kept = hidden(accu1) && hidden(accu2) && tak.op == Op::ExchangeAccus;
        let restored = back.op == Op::Load(*accu2) && again.op == Op::Load(*accu1);
        let inside = (at + 1..at + 7).any(|i| self.labels.contains_key(&(i as u32)));
        if !kept || !restored || inside || again.network != a.network {
            return None;
        }
        let (Op::LoadParamPointer { .. } | Op::LoadParamCopy { .. }, Op::LoadAr(_)) = (&pointer.op, &load.op) else {
            return None;
        };
        Some(format!("{} {}", self.mnemonic(&load.op), self.operand(at + 3, &pointer.op)?))
    }

    /// A `CALL` to which a POINTER or ANY to a variable of the own instance is handed: what puts them together stands
    /// before it. Gives them, and how many operations that is.
    fn pointers(&self, at: usize) -> Option<(Vec<Handed>, usize)> {
        let (code, mut handed, mut next) = (&self.block.code, Vec::new(), at);
        while let Some(one) = Handed::at(code.get(next..)?) {
            if one.byte < self.block.interface.declared_temps() {
                return None;
            }
            next += one.ops().len();
            handed.push(one);
        }
        let last = code.get(next).filter(|last| code.get(at).is_some_and(|first| first.network == last.network))?;
        let inside = (at + 1..=next).any(|i| self.labels.contains_key(&(i as u32)));
        (matches!(last.op, Op::Call(_)) && !handed.is_empty() && !inside).then(|| (handed, next + 1 - at))
    }

    fn handed(&self, at: usize) -> Option<(String, usize)> {
        let (handed, used) = self.pointers(at)?;
        let Op::Call(call) = &self.block.code.get(at + used - 1)?.op else { return None };
        Some((self.printer.call(self.block, call, &handed).ok()?, used))
    }

    fn mnemonic(&self, op: &Op) -> &'static str {
        self.printer.mnemonic(&|shape| has_shape(shape, op))
    }

    /// The text of one operation.
    fn text(&self, at: usize) -> Result<String, Unprintable> {
        let Some(stmt) = self.block.code.get(at) else { return Ok(String::new()) };
        let op = &stmt.op;
        if let Op::Call(call) = op {
            return self.printer.call(self.block, call, &[]).map_err(|what| self.wrong(at, what));
        }
        let mnemonic = self.mnemonic(op);
        if mnemonic.is_empty() {
            return Err(self.wrong(at, format!("`{op}`")));
        }
        match self.operand(at, op) {
            Some(operand) if operand.is_empty() => Ok(mnemonic.to_owned()),
            Some(operand) => Ok(format!("{mnemonic} {operand}")),
            None => Err(self.wrong(at, format!("`{op}`"))),
        }
    }

    /// What follows the mnemonic, perhaps nothing. `None`: it cannot be expressed.
    fn operand(&self, at: usize, op: &Op) -> Option<String> {
        let p = self.printer;
        let interface = &self.block.interface;
        let label = |to: &u32| self.labels.get(to).cloned();
        if let Some(operand) = op.operand() {
            return p.operand(interface, operand, op.writes());
        }
        Some(match op {
            Op::Scan { test: BitTest::Status(status), .. } => match status {
                StatusBit::Overflow | StatusBit::StoredOverflow | StatusBit::Unordered | StatusBit::BinaryResult => {
                    p.identifier(Identifier::Status(*status), false)?.to_owned()
                }
                relation => RELATIONS.iter().find(|(_, s)| s == relation).map(|(text, _)| format!("{text}0"))?,
            },
            Op::LoadConst(value) => p.loaded(self.listing.notations.get(&(at as u32)).copied(), *value),
            Op::LoadParamPointer { index, .. } | Op::LoadParamCopy { index, .. } => {
                format!("P#{}", of_param(interface, *index, BitAddr(0), &|_| true)?)
            }
            Op::LoadStatus | Op::TransferStatus => p.identifier(Identifier::StatusWord, false)?.to_owned(),
            Op::LoadDbLength(register) => p.identifier(Identifier::DbLength(*register), false)?.to_owned(),
            Op::LoadDbNumber(register) => p.identifier(Identifier::DbNumber(*register), false)?.to_owned(),
            Op::AddConst { format: NumberFormat::DInt, value } => format!("L#{value}"),
            Op::AddConst { format: NumberFormat::Int, value } => i16::try_from(*value).ok()?.to_string(),
            Op::AddConst { .. } => return None,
            Op::WordLogic(_, Some(value)) => format!("W#16#{value:X}"),
            Op::DWordLogic(_, Some(value)) => format!("DW#16#{value:X}"),
            Op::Shift(_, Some(n)) => n.to_string(),
            Op::Increment(n) | Op::Decrement(n) => n.to_string(),
            Op::LoadArConst(_, bits) => p.pointer(*bits, 0)?,
            Op::AddArConst(_, at) if at.byte() <= BitAddr::MAX_BYTE => format!("P#{at}"),
            Op::AddArConst(..) => return None,
            Op::CopyAr2ToAr1 | Op::CopyAr1ToAr2 => "AR2".to_owned(),
            Op::OpenDb(register, number) => self.opened(*register, *number)?,
            Op::Jump(_, to) | Op::Loop(to) => label(to)?,
            Op::JumpList { targets, otherwise } => {
                self.list_stands(at, targets, *otherwise).then(|| label(otherwise))??
            }
            Op::Nop => "0".to_owned(),
            Op::Build(n) => n.to_string(),
            other => match timed(other) {
                Some((counter, number)) => self.timer(counter, number)?,
                None => String::new(),
            },
        })
    }

    /// True if the SPAs of a jump list follow it, and then the statement for a number beyond.
    fn list_stands(&self, at: usize, targets: &[u32], otherwise: u32) -> bool {
        let jumps = self.block.code.get(at + 1..).into_iter().flatten();
        let same = targets.iter().zip(jumps).filter(|(to, s)| s.op == Op::Jump(Jump::Always, **to)).count();
        same == targets.len() && (1..=255).contains(&same) && otherwise as usize == at + 1 + same
    }

    fn opened(&self, register: DbRegister, number: Number) -> Option<String> {
        let wanted = |ty: &DataType| *ty == DataType::BlockDb;
        match (register, number) {
            (_, Number::Fixed(0)) => None,
            (DbRegister::Db, number) => self.printer.number(&self.block.interface, "DB", number, &wanted),
            (DbRegister::Di, Number::Param(_) | Number::Instance(_)) => {
                let name = self.printer.number(&self.block.interface, "", number, &wanted)?;
                Some(format!("DI {name}"))
            }
            (DbRegister::Di, number) => self.printer.number(&self.block.interface, "DI", number, &wanted),
        }
    }

    fn timer(&self, counter: bool, number: Number) -> Option<String> {
        let letters = self.printer.identifier(if counter { Identifier::Counter } else { Identifier::Timer }, false)?;
        let wanted = |ty: &DataType| match ty {
            DataType::Counter => counter,
            DataType::Timer | DataType::TimerOrWord => !counter,
            _ => false,
        };
        self.printer.number(&self.block.interface, letters, number, &wanted)
    }
}

/// A text on one line.
fn one_line(text: &str) -> String {
    text.replace(['\r', '\n'], " ").trim_end().to_owned()
}

/// The timer or counter (true) an operation is about.
const fn timed(op: &Op) -> Option<(bool, Number)> {
    Some(match op {
        Op::Scan { test: BitTest::Timer(n), .. }
        | Op::LoadTimer(n)
        | Op::LoadTimerBcd(n)
        | Op::StartTimer(_, n)
        | Op::ResetTimer(n)
        | Op::EnableTimer(n) => (false, *n),
        Op::Scan { test: BitTest::Counter(n), .. }
        | Op::LoadCounter(n)
        | Op::LoadCounterBcd(n)
        | Op::CountUp(n)
        | Op::CountDown(n)
        | Op::SetCounter(n)
        | Op::ResetCounter(n)
        | Op::EnableCounter(n) => (true, *n),
        _ => return None,
    })
}

/// True for the shape of the mnemonic that an operation has.
fn has_shape(shape: &Shape, op: &Op) -> bool {
    match (shape, op) {
        (Shape::Scan(logic, negate), Op::Scan { logic: l, negate: n, .. }) => logic == l && negate == n,
        (Shape::Scan(ob1_ir::Logic::Or, false), Op::OrBranch) => true,
        (Shape::Plain(plain), op) => plain == op,
        (Shape::Assign, Op::Assign(_)) => true,
        (Shape::Set, Op::Set(_) | Op::SetCounter(_)) => true,
        (Shape::Reset, Op::Reset(_) | Op::ResetTimer(_) | Op::ResetCounter(_)) => true,
        (Shape::Edge(positive), Op::EdgePositive(_)) => *positive,
        (Shape::Edge(positive), Op::EdgeNegative(_)) => !positive,
        (Shape::LoadBcd, Op::LoadTimerBcd(_) | Op::LoadCounterBcd(_)) => true,
        (Shape::Load, Op::LoadTimerBcd(_) | Op::LoadCounterBcd(_)) => false,
        (Shape::Load, op) => op.loads(),
        (Shape::Transfer, Op::Transfer(_) | Op::TransferStatus) => true,
        (Shape::WordLogic(logic), Op::WordLogic(l, _)) | (Shape::DWordLogic(logic), Op::DWordLogic(l, _)) => logic == l,
        (Shape::Shift(shift, most), Op::Shift(s, n)) => shift == s && n.is_none_or(|n| n <= *most),
        (Shape::AddConst, Op::AddConst { .. }) => true,
        (Shape::Increment, Op::Increment(_)) | (Shape::Decrement, Op::Decrement(_)) => true,
        (Shape::LoadAr(register), Op::LoadAr(r) | Op::LoadArConst(r, _) | Op::LoadArFrom(r, _))
        | (Shape::TransferAr(register), Op::TransferAr(r) | Op::TransferArTo(r, _))
        | (Shape::AddAr(register), Op::AddAr(r) | Op::AddArConst(r, _)) => register == r,
        (Shape::LoadAr(register), Op::CopyAr2ToAr1) | (Shape::TransferAr(register), Op::CopyAr1ToAr2) => {
            *register == AddressRegister::Ar1
        }
        (Shape::OpenDb, Op::OpenDb(..)) => true,
        (Shape::StartTimer(kind), Op::StartTimer(k, _)) => kind == k,
        (Shape::Enable, Op::EnableTimer(_) | Op::EnableCounter(_)) => true,
        (Shape::CountUp, Op::CountUp(_)) | (Shape::CountDown, Op::CountDown(_)) => true,
        (Shape::Jump(jump), Op::Jump(j, _)) => jump == j,
        (Shape::Loop, Op::Loop(_)) | (Shape::JumpList, Op::JumpList { .. }) => true,
        (Shape::Nothing, Op::Nop) | (Shape::Build, Op::Build(_)) => true,
        _ => false,
    }
}
