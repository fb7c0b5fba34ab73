//! Absolute addresses: `MW20`, `I1.0`, `DB11.DW4`, `MW[i]`, `T3`.

use ob1_ir::{Number, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType};
use ob1_stl::front::{Identifier, Span, Token, split_digits};

use crate::check::Checker;
use crate::messages;
use crate::names::Named;
use crate::syntax::{Ref, Step};
use crate::tree::{Base, Kind, Side, Term, Typed, Var};
use crate::types::{BOOL, BYTE, COUNTER, DWORD, TIMER, WORD};

impl<'c> Checker<'c> {
    /// `DW4`, `DX4.0`, `DW[i]`, `DBX4.0` of a data block.
    pub(crate) fn db_element(
        &mut self,
        base: Base<'c>,
        token: Token,
        rest: &[Step],
        span: Span,
    ) -> Option<(Named<'c>, usize)> {
        let Some((width, digits)) = db_address(self.name(token)) else {
            self.report(token.span, &messages::ADDRESS, "behind a data block stands DX, DB, DW or DD with its address");
            return None;
        };
        let var = Var { base, at: BitAddr(0), terms: Vec::new(), declared: None, side: Side::Both };
        let (var, used) = self.addressed(var, width, digits, rest, span)?;
        Some((Named::Value(Typed::new(Kind::Var(var), of_width(width), span)), used))
    }

    /// An absolute address where a word is one: `MW20`, `I1.0`, `DB11.DW4`, `T3`. The outer `None`: reported.
    pub(crate) fn absolute(&mut self, reference: &Ref) -> Option<Option<(Named<'c>, usize)>> {
        let token = reference.first;
        let text = self.text(token);
        let (letters, digits) = split_digits(text);
        let apart = matches!(reference.steps.first(), Some(Step::Number(_)));
        let indexed = matches!(reference.steps.first(), Some(Step::Index(_)));
        if digits.is_empty() && !apart && !indexed || letters.is_empty() || letters.len() > 4 {
            return Some(None);
        }
        if self.declared_plainly(text) {
            return Some(None);
        }
        let number = |this: &Self| match reference.steps.first() {
            Some(Step::Number(n)) if digits.is_empty() => (this.text(*n).parse::<u16>().ok(), 1),
            _ => (digits.parse().ok(), 0),
        };
        let span = reference.span;
        let bits =
            letters.strip_suffix(['X', 'x']).and_then(|l| self.words.identifier(l)).filter(|_| letters.len() == 2);
        match self.words.identifier(letters).or(bits) {
            Some(Identifier::Memory(area, width)) if !matches!(area, Area::Local | Area::Db | Area::Di) => {
                if indexed && self.info.declared(text).is_some() {
                    return Some(None);
                }
                let side = match letters.get(1..2) {
                    Some("E" | "e" | "I" | "i") if area == Area::Peripheral => Side::Read,
                    Some(_) if area == Area::Peripheral => Side::Write,
                    _ => Side::Both,
                };
                let var = Var { base: Base::Fixed(area), at: BitAddr(0), terms: Vec::new(), declared: None, side };
                let (var, used) = self.addressed(var, width, digits, &reference.steps, span)?;
                Some(Some((Named::Value(Typed::new(Kind::Var(var), of_width(width), span)), used)))
            }
            Some(Identifier::Timer) if !indexed => {
                let (n, used) = number(self);
                let Some(n) = n else { return Some(None) };
                Some(Some((Named::Value(Typed::new(Kind::Timer(Number::Fixed(n)), &TIMER, span)), used)))
            }
            Some(Identifier::Counter) if !indexed => {
                let (n, used) = number(self);
                let Some(n) = n else { return Some(None) };
                Some(Some((Named::Value(Typed::new(Kind::Counter(Number::Fixed(n)), &COUNTER, span)), used)))
            }
            Some(Identifier::Block(word)) if !indexed => {
                let (n, used) = number(self);
                let (Some(n), Some(kind)) = (n, word.kind()) else { return Some(None) };
                let id = BlockId::new(kind, n);
                if id == self.id && !matches!(reference.steps.get(used), Some(Step::Call(_))) {
                    let Some(named) = self.own_result(span) else {
                        self.report(
                            span,
                            &messages::NOT_A_VALUE,
                            format!("{id} has no value: it is declared without one"),
                        );
                        return None;
                    };
                    return Some(Some((named, used)));
                }
                let named = if kind == BlockKind::Db { Named::Db(n) } else { Named::Block(id) };
                Some(Some((named, used)))
            }
            _ => Some(None),
        }
    }

    /// True for a name that is declared without `#`, and so means the declaration.
    pub(crate) fn declared_plainly(&self, name: &str) -> bool {
        if self.info.declared(name).is_none() && !self.info.constants.contains_key(&name.to_uppercase()) {
            return false;
        }
        let declared =
            self.block.sections.iter().flat_map(|(_, list)| list).find(|d| d.name.eq_ignore_ascii_case(name));
        declared.is_none_or(|d| !self.file.slice(d.span).starts_with('#'))
    }

    /// The address behind letters: digits, a number apart, or indices. Gives how many steps it took.
    fn addressed(
        &mut self,
        mut var: Var<'c>,
        width: Width,
        digits: &str,
        steps: &[Step],
        span: Span,
    ) -> Option<(Var<'c>, usize)> {
        let wrong = |this: &mut Self| {
            this.report(span, &messages::ADDRESS, "an address is written I0.0, QB4, MW20, DB11.DW4, MX[i, b] or MW[i]");
            None
        };
        let byte = |text: &str| text.parse::<u32>().ok().filter(|b| *b <= BitAddr::MAX_BYTE);
        match steps.first() {
            Some(Step::Index(indices)) if digits.is_empty() => {
                let (first, second) = match (indices.as_slice(), width) {
                    ([byte, bit], Width::Bit) => (byte, Some(bit)),
                    ([byte], _) if width != Width::Bit => (byte, None),
                    _ => return wrong(self),
                };
                let index = self.index(first)?;
                add_index(&mut var, index, (0, i32::from(u16::MAX)), 8);
                if let Some(second) = second {
                    let index = self.index(second)?;
                    add_index(&mut var, index, (0, 7), 1);
                }
                Some((var, 1))
            }
            Some(Step::Number(number)) if digits.is_empty() => {
                let text = self.text(*number);
                let (first, second) = text.split_once('.').unwrap_or((text, ""));
                let (Some(byte), bit) = (byte(first), second.parse::<u8>().ok().filter(|b| *b < 8)) else {
                    return wrong(self);
                };
                match (width, bit) {
                    (Width::Bit, Some(bit)) => var.at = BitAddr::new(byte, bit),
                    (Width::Bit, None) => return wrong(self),
                    _ => var.at = BitAddr::byte_addr(byte),
                }
                Some((var, 1))
            }
            Some(Step::Dot(bit)) if width == Width::Bit && !digits.is_empty() => {
                let bit = self.text(*bit).parse::<u8>().ok().filter(|b| *b < 8);
                let (Some(byte), Some(bit)) = (byte(digits), bit) else { return wrong(self) };
                var.at = BitAddr::new(byte, bit);
                Some((var, 1))
            }
            _ if width != Width::Bit && !digits.is_empty() => {
                let Some(byte) = byte(digits) else { return wrong(self) };
                var.at = BitAddr::byte_addr(byte);
                Some((var, 0))
            }
            _ => wrong(self),
        }
    }
}

/// Adds an index to an address: to the fixed part where it is a constant.
pub(crate) fn add_index<'c>(var: &mut Var<'c>, index: Typed<'c>, (low, high): (i32, i32), stride: u32) {
    match index.kind {
        Kind::Constant(value) => {
            let distance = i64::from(value as i32) - i64::from(low);
            var.at.0 = var.at.0.wrapping_add((distance * i64::from(stride)) as u32);
        }
        _ => var.terms.push(Term { index, low, high, stride }),
    }
}

/// The type that an address without declaration has.
pub(crate) const fn of_width(width: Width) -> &'static DataType {
    match width {
        Width::Bit => &BOOL,
        Width::Byte => &BYTE,
        Width::Word => &WORD,
        Width::DWord => &DWORD,
    }
}

/// `DW4` behind a data block: the letters X, B, W, D with or without D or DB before them. The `D` of `DB` is a byte.
pub(crate) fn db_address(name: &str) -> Option<(Width, &str)> {
    let (letters, digits) = split_digits(name);
    let width = match letters.to_ascii_uppercase().as_str() {
        "X" | "DX" | "DBX" => Width::Bit,
        "B" | "DB" | "DBB" => Width::Byte,
        "W" | "DW" | "DBW" => Width::Word,
        "D" | "DD" | "DBD" => Width::DWord,
        _ => return None,
    };
    Some((width, digits))
}
