//! Operands: tokens to places, numbers, constants and blocks.

use ob1_ir::{AddressRegister, DbRegister, Number, Operand, Place, Pointer, StatusBit, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Section};

use crate::codes;
use crate::constant::{self, ANY_TYPES, Constant, PointerConstant};
use crate::mnemonics::{BlockWord, Identifier, RELATIONS, Words};
use crate::parser::{split_digits, unquote};
use crate::path;
use crate::reader::Reader;
use crate::token::{Kind, Span, Token};
use crate::world::{Info, Symbolic, World};

/// An operand.
#[derive(Clone, Debug)]
pub(crate) enum Value<'w> {
    /// A place in memory; `ty` where a declaration or the symbol table gives one. A composed variable has the width of a byte.
    Memory {
        operand: Operand,
        ty: Option<&'w DataType>,
    },
    Timer(Number),
    Counter(Number),
    Block(BlockWord, Number),
    Status(StatusBit),
    StatusWord,
    DbLength(DbRegister),
    DbNumber(DbRegister),
    Register(AddressRegister),
    Constant(Constant),
    /// A multi-instance: its FB and where it lies within the caller's instance.
    Instance(BlockId, BitAddr),
}

impl Value<'_> {
    /// What it is, for messages.
    pub(crate) fn describe(&self) -> String {
        match self {
            Value::Memory { ty: Some(ty), .. } => with_article(ty.name()),
            Value::Memory { operand, .. } => match operand.width {
                Width::Bit => "a bit".into(),
                Width::Byte => "a byte".into(),
                Width::Word => "a word".into(),
                Width::DWord => "a double word".into(),
            },
            Value::Timer(_) => "a timer".into(),
            Value::Counter(_) => "a counter".into(),
            Value::Block(word, _) => format!("a block ({})", word.name()),
            Value::Status(_) => "a status bit".into(),
            Value::StatusWord => "the status word".into(),
            Value::DbLength(_) | Value::DbNumber(_) => "a length or number of a data block".into(),
            Value::Register(_) => "an address register".into(),
            Value::Constant(_) => "a constant".into(),
            Value::Instance(fb, _) => format!("an instance of {fb}"),
        }
    }
}

/// `an INT`, `a WORD`.
pub(crate) fn with_article(name: &str) -> String {
    let vowel = name.starts_with(['A', 'E', 'I', 'O', 'S']) && !matches!(name, "STRING" | "STRUCT");
    format!("{} {name}", if vowel { "an" } else { "a" })
}

/// Width of an elementary type.
pub(crate) fn width_of(ty: &DataType) -> Option<Width> {
    Some(match ty.elementary_bits()? {
        1 => Width::Bit,
        8 => Width::Byte,
        16 => Width::Word,
        _ => Width::DWord,
    })
}

/// The names in scope.
#[derive(Clone, Copy)]
pub(crate) struct Resolver<'w> {
    pub(crate) world: &'w World,
    pub(crate) words: &'w Words,
    /// The block whose statements are resolved.
    pub(crate) block: Option<(BlockKind, &'w Info)>,
    /// Set within `[ ]`, where no further indirect address may stand.
    nested: bool,
}

impl<'w> Resolver<'w> {
    /// The names of the world; `block` adds the declarations of one of its blocks.
    pub(crate) fn new(world: &'w World, words: &'w Words, block: Option<(BlockKind, &'w Info)>) -> Self {
        Self { world, words, block, nested: false }
    }

    /// Reads the operand within `[ ]`.
    fn inner(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<Value<'w>> {
        if self.nested {
            reader.report(span, &codes::INDIRECT, "an indirect address cannot itself lie at an indirect address");
            return None;
        }
        Self { nested: true, ..*self }.operand(reader)
    }

    /// Reads one operand. `None` when it is none (reported).
    pub(crate) fn operand(&self, reader: &mut Reader<'_, '_>) -> Option<Value<'w>> {
        let span = reader.here();
        let Some(token) = reader.peek() else {
            reader.report(span, &codes::OPERAND_MISSING, "an operand is missing");
            return None;
        };
        match token.kind {
            Kind::Local => {
                reader.next();
                self.local(reader, unquote(reader.text(token)), span)
            }
            Kind::Symbol => {
                reader.next();
                self.symbol(reader, unquote(reader.text(token)), span)
            }
            Kind::Word => self.word(reader, token),
            Kind::LeftBracket => {
                let place = self.bracket(reader, None)?;
                Some(Value::Memory { operand: Operand { width: Width::Bit, place }, ty: None })
            }
            Kind::Operator => match self.relation(reader) {
                Some(status) => Some(Value::Status(status)),
                None => self.constant(reader).map(Value::Constant),
            },
            Kind::Bad => None,
            _ => self.constant(reader).map(Value::Constant),
        }
    }

    /// `==0`, `<>0`, ...
    fn relation(&self, reader: &mut Reader<'_, '_>) -> Option<StatusBit> {
        let (relation, zero) = (reader.peek()?, reader.peek_second()?);
        let (_, status) = RELATIONS.iter().find(|(text, _)| *text == reader.text(relation))?;
        if reader.text(zero) != "0" {
            return None;
        }
        reader.next();
        reader.next();
        Some(*status)
    }

    /// A constant of any kind. `None` when there is none (reported).
    pub(crate) fn constant(&self, reader: &mut Reader<'_, '_>) -> Option<Constant> {
        let span = reader.here();
        let negative = match reader.peek().filter(|t| t.kind == Kind::Operator).map(|t| reader.text(t)) {
            Some(sign @ ("+" | "-")) => {
                reader.next();
                sign == "-"
            }
            _ => false,
        };
        let token = reader.peek();
        let result = match token.map(|t| (t.kind, reader.text(t))) {
            Some((Kind::Number, text)) => {
                reader.next();
                constant::parse(text, negative)
            }
            Some((Kind::Typed, text)) if !negative => {
                reader.next();
                if text.ends_with('#') { self.byte_list(reader) } else { constant::parse(text, false) }
            }
            Some((Kind::Text, text)) if !negative => {
                reader.next();
                constant::text(text).map(Constant::Text)
            }
            Some((Kind::PointerSign, _)) if !negative => {
                reader.next();
                return self.pointer(reader, span).map(Constant::Pointer);
            }
            Some((Kind::Word, text)) if !negative && text.eq_ignore_ascii_case("TRUE") => {
                reader.next();
                Ok(Constant::Bool(true))
            }
            Some((Kind::Word, text)) if !negative && text.eq_ignore_ascii_case("FALSE") => {
                reader.next();
                Ok(Constant::Bool(false))
            }
            Some((Kind::Bad, _)) => return None,
            _ => Err("a constant should stand here".into()),
        };
        let span = token.map_or(span, |t| span.to(t.span));
        result.map_err(|message| reader.report(span, &codes::CONSTANT, message)).ok()
    }

    /// `(1, 2)` or `(1, 2, 3, 4)` after `B#`.
    fn byte_list(&self, reader: &mut Reader<'_, '_>) -> Result<Constant, String> {
        let wrong = || "bytes are written B#(1, 2) or B#(1, 2, 3, 4), each from 0 to 255".to_owned();
        reader.eat(Kind::LeftParen).ok_or_else(wrong)?;
        let mut value = 0u32;
        let mut count = 0u8;
        loop {
            let number = reader.eat(Kind::Number).and_then(|t| reader.text(t).parse::<u8>().ok()).ok_or_else(wrong)?;
            value = value << 8 | u32::from(number);
            count = count.saturating_add(1);
            if reader.eat(Kind::Comma).is_none() {
                break;
            }
        }
        reader.eat(Kind::RightParen).ok_or_else(wrong)?;
        match count {
            2 => Ok(Constant::Bits(value, 16)),
            4 => Ok(Constant::Bits(value, 32)),
            _ => Err(wrong()),
        }
    }

    /// What follows `P#`.
    fn pointer(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<PointerConstant> {
        let wrong = |reader: &mut Reader<'_, '_>| {
            reader.report(span, &codes::POINTER, "a pointer is written P#12.0, P#M 3.0 or P#DB10.DBX0.0 BYTE 12");
            None
        };
        let mut db = 0;
        let Some(token) = reader.peek() else { return wrong(reader) };
        match token.kind {
            Kind::Number => {
                reader.next();
                let Some(at) = bit_address(reader.text(token)) else { return wrong(reader) };
                return Some(PointerConstant { area: None, at, db, any: None });
            }
            Kind::Local => {
                reader.next();
                return self.pointer_to_local(reader, unquote(reader.text(token)), span);
            }
            Kind::Word => {}
            _ => return wrong(reader),
        }
        let (mut word, mut digits) = split_digits(reader.text(token));
        reader.next();
        if word.eq_ignore_ascii_case("DB") {
            let number =
                if digits.is_empty() { reader.eat(Kind::Number).map_or("", |t| reader.text(t)) } else { digits };
            db = number.parse().unwrap_or(0);
            let inner = reader.eat(Kind::Dot).and_then(|_| reader.eat(Kind::Word));
            let Some(inner) = inner.filter(|_| db > 0) else { return wrong(reader) };
            (word, digits) = split_digits(reader.text(inner));
        }
        let area = match self.words.identifier(word) {
            Some(Identifier::Memory(area, Width::Bit)) => area,
            _ if word.eq_ignore_ascii_case("P") => Area::Peripheral,
            _ if word.eq_ignore_ascii_case("V") => Area::PreviousLocal,
            _ => return wrong(reader),
        };
        let Some(at) = self.bit_part(reader, digits) else { return wrong(reader) };
        let any = self.any_length(reader, span)?;
        Some(PointerConstant { area: Some(area), at, db, any })
    }

    /// `BYTE 12` after a pointer; `Some(None)` when nothing follows.
    #[expect(clippy::option_option, reason = "reported, absent, present")]
    fn any_length(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<Option<(u8, u16)>> {
        let Some(word) = reader.peek().filter(|t| t.kind == Kind::Word) else { return Some(None) };
        let text = reader.text(word);
        let code = ANY_TYPES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)).map(|(_, code)| *code);
        reader.next();
        let count = reader.eat(Kind::Number).and_then(|t| reader.text(t).parse::<u16>().ok());
        match (code, count) {
            (Some(code), Some(count)) => Some(Some((code, count))),
            _ => {
                reader.report(span, &codes::POINTER, "the length of an ANY is written BYTE 12");
                None
            }
        }
    }

    /// `P##name`: a pointer to a variable of this block.
    fn pointer_to_local(&self, reader: &mut Reader<'_, '_>, name: &str, span: Span) -> Option<PointerConstant> {
        let Value::Memory { operand, .. } = self.local(reader, name, span)? else {
            reader.report(span, &codes::POINTER, "P## takes a variable");
            return None;
        };
        match operand.place {
            Place::Fixed(area, at) => Some(PointerConstant { area: Some(area), at, db: 0, any: None }),
            Place::Instance(at) => Some(PointerConstant { area: Some(Area::Di), at, db: 0, any: None }),
            _ => {
                reader.report(
                    span,
                    &codes::NOT_SUPPORTED,
                    "a pointer to a parameter of a function is not supported yet",
                );
                None
            }
        }
    }

    /// `12.0` after a bit identifier, in the spellings `M 12.0`, `M12.0`.
    fn bit_part(&self, reader: &mut Reader<'_, '_>, digits: &str) -> Option<BitAddr> {
        if digits.is_empty() {
            let number = reader.eat(Kind::Number)?;
            return bit_address(reader.text(number));
        }
        reader.eat(Kind::Dot)?;
        let bit = reader.eat(Kind::Number)?;
        bit_address(&format!("{digits}.{}", reader.text(bit)))
    }

    /// A word: operand identifier, TRUE/FALSE, or the name of a local or symbol without its sign.
    fn word(&self, reader: &mut Reader<'_, '_>, token: Token) -> Option<Value<'w>> {
        let text = reader.text(token);
        if let Some(identifier) = self.words.identifier(text) {
            reader.next();
            return self.identified(reader, identifier, "", token.span);
        }
        let (letters, digits) = split_digits(text);
        if !digits.is_empty()
            && let Some(identifier) = self.words.identifier(letters)
        {
            reader.next();
            return self.identified(reader, identifier, digits, token.span);
        }
        if text.eq_ignore_ascii_case("TRUE") || text.eq_ignore_ascii_case("FALSE") {
            return self.constant(reader).map(Value::Constant);
        }
        reader.next();
        if self.block.is_some_and(|(_, info)| info.find(text).is_some()) {
            return self.local(reader, text, token.span);
        }
        if self.world.symbol(text).is_some() {
            return self.symbol(reader, text, token.span);
        }
        let shown: String = text.chars().take(32).collect();
        if self.words.is_foreign(letters) {
            reader.report(
                token.span,
                &codes::FOREIGN_MNEMONIC,
                format!("{shown} belongs to the other set of mnemonics"),
            );
        } else {
            let message = format!("{shown} is no operand");
            let known = self.words.identifier_words();
            reader.sink.report_unknown(reader.index, token.span, &codes::UNKNOWN_OPERAND, message, letters, known);
        }
        None
    }

    /// An operand that begins with an identifier; `digits` are those written together with it.
    fn identified(
        &self,
        reader: &mut Reader<'_, '_>,
        identifier: Identifier,
        digits: &str,
        span: Span,
    ) -> Option<Value<'w>> {
        match identifier {
            Identifier::Memory(area, width) => {
                let place = self.place(reader, area, width, digits, span)?;
                Some(Value::Memory { operand: Operand { width, place }, ty: None })
            }
            Identifier::Crossing(width) => {
                if reader.peek_kind() != Some(Kind::LeftBracket) {
                    reader.report(
                        span,
                        &codes::UNKNOWN_OPERAND,
                        "B, W and D alone take an address register: W [AR1,P#0.0]",
                    );
                    return None;
                }
                let place = self.bracket(reader, None)?;
                Some(Value::Memory { operand: Operand { width, place }, ty: None })
            }
            Identifier::Timer => self.number(reader, digits, span).map(Value::Timer),
            Identifier::Counter => self.number(reader, digits, span).map(Value::Counter),
            Identifier::Block(word) => self.block_operand(reader, word, digits, span),
            Identifier::Status(status) => Some(Value::Status(status)),
            Identifier::StatusWord => Some(Value::StatusWord),
            Identifier::DbLength(register) => Some(Value::DbLength(register)),
            Identifier::DbNumber(register) => Some(Value::DbNumber(register)),
            Identifier::Register(register) => Some(Value::Register(register)),
        }
    }

    /// The address after an identifier: fixed, memory-indirect or register-indirect.
    fn place(&self, reader: &mut Reader<'_, '_>, area: Area, width: Width, digits: &str, span: Span) -> Option<Place> {
        if digits.is_empty() && reader.peek_kind() == Some(Kind::LeftBracket) {
            return self.bracket(reader, Some(area));
        }
        self.fixed(reader, width, digits, span).map(|at| Place::Fixed(area, at))
    }

    /// A fixed address with the bit part that its width asks for.
    fn fixed(&self, reader: &mut Reader<'_, '_>, width: Width, digits: &str, span: Span) -> Option<BitAddr> {
        let at = if width == Width::Bit {
            self.bit_part(reader, digits)
        } else {
            let text = if digits.is_empty() { reader.eat(Kind::Number).map_or("", |t| reader.text(t)) } else { digits };
            text.parse::<u32>().ok().filter(|b| b + width.bytes() <= BitAddr::MAX_BYTE + 1).map(BitAddr::byte_addr)
        };
        if at.is_none() {
            let message = if width == Width::Bit {
                "the address of a bit is written byte.bit: byte 0 to 65535, bit 0 to 7"
            } else {
                "the address is a byte number from 0 to 65535"
            };
            let span = span.to(reader.here());
            reader.report(span, &codes::ADDRESS, message);
        }
        at
    }

    /// `[MD 184]`, `[AR1,P#2.0]`.
    fn bracket(&self, reader: &mut Reader<'_, '_>, area: Option<Area>) -> Option<Place> {
        let span = reader.here();
        reader.eat(Kind::LeftBracket)?;
        let place = match self.inner(reader, span)? {
            Value::Register(register) => {
                let pointer = reader.eat(Kind::Comma).and_then(|_| reader.eat(Kind::PointerSign));
                let offset = pointer.and_then(|_| reader.eat(Kind::Number)).and_then(|t| bit_address(reader.text(t)));
                let Some(offset) = offset else {
                    reader.report(span, &codes::INDIRECT, "register-indirect is written [AR1,P#2.0]");
                    return None;
                };
                Place::Register(area, register, offset)
            }
            Value::Memory { operand, .. } => {
                let pointer = pointer_place(operand, Width::DWord);
                match (area, pointer) {
                    (Some(area), Some(pointer)) => Place::Memory(area, pointer),
                    _ => {
                        let message = "memory-indirect takes a fixed double word of M, L, DB or DI: DBW [MD 184]";
                        reader.report(span, &codes::INDIRECT, message);
                        return None;
                    }
                }
            }
            other => {
                reader.report(span, &codes::INDIRECT, format!("{} cannot hold an address", other.describe()));
                return None;
            }
        };
        self.close(reader, span)?;
        Some(place)
    }

    fn close(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<()> {
        if reader.eat(Kind::RightBracket).is_none() {
            reader.report(span, &codes::INDIRECT, "the address is not closed with ]");
            return None;
        }
        Some(())
    }

    /// The number of a timer, counter or block: `5`, `[MW 2]`.
    fn number(&self, reader: &mut Reader<'_, '_>, digits: &str, span: Span) -> Option<Number> {
        if digits.is_empty() && reader.peek_kind() == Some(Kind::LeftBracket) {
            let span = reader.here();
            reader.next();
            let pointer = match self.inner(reader, span)? {
                Value::Memory { operand, .. } => pointer_place(operand, Width::Word),
                _ => None,
            };
            let Some(pointer) = pointer else {
                reader.report(span, &codes::INDIRECT, "the number lies in a fixed word of M, L, DB or DI: [MW 50]");
                return None;
            };
            self.close(reader, span)?;
            return Some(Number::Memory(pointer));
        }
        let text = if digits.is_empty() { reader.eat(Kind::Number).map_or("", |t| reader.text(t)) } else { digits };
        let number = text.parse().ok();
        if number.is_none() {
            let span = span.to(reader.here());
            reader.report(span, &codes::NUMBER, "a number from 0 to 65535 should stand here");
        }
        number.map(Number::Fixed)
    }

    /// `DB10`, `FC 9`, `DB10.DBW 20`, `DB10.name`.
    fn block_operand(
        &self,
        reader: &mut Reader<'_, '_>,
        word: BlockWord,
        digits: &str,
        span: Span,
    ) -> Option<Value<'w>> {
        let number = self.number(reader, digits, span)?;
        let data = matches!(word, BlockWord::Db | BlockWord::Di);
        if data && number == Number::Fixed(0) {
            reader.report(span, &codes::NUMBER, "data blocks are numbered from 1");
            return None;
        }
        match number {
            Number::Fixed(n) if data && reader.peek_kind() == Some(Kind::Dot) => {
                reader.next();
                self.in_data(reader, word, n, span)
            }
            _ => Some(Value::Block(word, number)),
        }
    }

    /// What follows `DB10.`: `DBW 20` or the name of a component.
    fn in_data(&self, reader: &mut Reader<'_, '_>, word: BlockWord, db: u16, span: Span) -> Option<Value<'w>> {
        let place = |at| if word == BlockWord::Di { Place::InDi(db, at) } else { Place::InDb(db, at) };
        let token = reader.peek();
        if let Some(token) = token.filter(|t| t.kind == Kind::Word) {
            let (letters, digits) = split_digits(reader.text(token));
            let expected = if word == BlockWord::Di { Area::Di } else { Area::Db };
            if let Some(Identifier::Memory(area, width)) = self.words.identifier(letters)
                && area == expected
            {
                reader.next();
                let at = self.fixed(reader, width, digits, token.span)?;
                self.check_inside(reader, db, at, width, span);
                return Some(Value::Memory { operand: Operand { width, place: place(at) }, ty: None });
            }
        }
        let name = match token.map(|t| t.kind) {
            Some(Kind::Word | Kind::Symbol) => reader.next().map_or("", |t| unquote(reader.text(t))),
            _ => {
                reader.report(
                    span,
                    &codes::COMPONENT,
                    "after the point stands DBX, DBB, DBW, DBD or a component's name",
                );
                return None;
            }
        };
        let name_span = token.map_or(span, |t| t.span);
        let Some(data) = self.world.data.get(&db) else {
            reader.report(
                span,
                &codes::NO_DATA_BLOCK,
                format!("DB {db} is not in the program, so it has no name {name}"),
            );
            return None;
        };
        let Some(component) = data.find(name) else {
            let known = data.components.iter().map(|c| c.path.as_str());
            let message = format!("DB {db} has no component {name}");
            reader.sink.report_unknown(reader.index, name_span, &codes::COMPONENT, message, name, known);
            return None;
        };
        let (ty, at) = path::follow(reader, &self.world.fields, &component.ty, component.at)?;
        let width = width_of(ty).unwrap_or(Width::Byte);
        Some(Value::Memory { operand: Operand { width, place: place(at) }, ty: Some(ty) })
    }

    /// Warns when an absolute address lies beyond the end of a data block of the program.
    fn check_inside(&self, reader: &mut Reader<'_, '_>, db: u16, at: BitAddr, width: Width, span: Span) {
        let Some(data) = self.world.data.get(&db) else { return };
        if (at.byte() + width.bytes()) as usize > data.image.len() {
            let message = format!("DB {db} has {} bytes, this lies beyond", data.image.len());
            reader.report(span, &codes::BEYOND_DATA_BLOCK, message);
        }
    }

    /// `"symbol"`, with a component behind a data block's.
    fn symbol(&self, reader: &mut Reader<'_, '_>, name: &str, span: Span) -> Option<Value<'w>> {
        match self.world.symbol(name) {
            Some(Symbolic::Block(BlockWord::Db, n)) if reader.peek_kind() == Some(Kind::Dot) => {
                reader.next();
                self.in_data(reader, BlockWord::Db, *n, span)
            }
            Some(Symbolic::Block(word, n)) => Some(Value::Block(*word, Number::Fixed(*n))),
            Some(Symbolic::Memory(operand, ty)) => {
                // A type of another width (from a careless table) does not change what the address says.
                let ty = ty.as_ref().filter(|ty| width_of(ty) == Some(operand.width));
                Some(Value::Memory { operand: *operand, ty })
            }
            Some(Symbolic::Timer(n)) => Some(Value::Timer(Number::Fixed(*n))),
            Some(Symbolic::Counter(n)) => Some(Value::Counter(Number::Fixed(*n))),
            Some(Symbolic::Unknown(address)) => {
                let message = format!("the symbol table gives \"{name}\" the address {address}, which is none");
                reader.report(span, &codes::UNKNOWN_SYMBOL, message);
                None
            }
            None => {
                let known = self.world.symbols.keys().map(String::as_str);
                let message = format!("the symbol \"{name}\" is in no symbol table");
                reader.sink.report_unknown(reader.index, span, &codes::UNKNOWN_SYMBOL, message, name, known);
                None
            }
        }
    }

    /// `#name` with its components.
    fn local(&self, reader: &mut Reader<'_, '_>, name: &str, span: Span) -> Option<Value<'w>> {
        let declared = self.block.and_then(|(kind, info)| Some((kind, info, info.find(name)?)));
        let Some((kind, info, index)) = declared else {
            let known = self.block.into_iter().flat_map(|(_, i)| &i.interface.params).map(|p| p.name.as_str());
            let message = format!("#{name} is not declared in this block");
            reader.sink.report_unknown(reader.index, span, &codes::UNKNOWN_LOCAL, message, name, known);
            return None;
        };
        let param = info.interface.params.get(index)?;
        if let Some(fb) = info.instances.get(&index)
            && !matches!(reader.peek_kind(), Some(Kind::Dot))
        {
            return Some(Value::Instance(*fb, param.at));
        }
        let in_instance = kind.has_instance();
        let formal = info.formal(index);
        if param.ty.is_parameter_type() {
            let number = if in_instance { Number::Instance(param.at) } else { Number::Param(formal?) };
            return Some(match param.ty {
                DataType::Timer | DataType::TimerOrWord => Value::Timer(number),
                DataType::Counter => Value::Counter(number),
                DataType::BlockFb => Value::Block(BlockWord::Fb, number),
                DataType::BlockFc => Value::Block(BlockWord::Fc, number),
                _ => Value::Block(BlockWord::Db, number),
            });
        }
        let by_pointer = in_instance && param.is_pointer();
        if by_pointer && matches!(reader.peek_kind(), Some(Kind::Dot | Kind::LeftBracket)) {
            let message = "components of a composed in/out of a function block cannot be named yet";
            reader.report(span, &codes::NOT_SUPPORTED, message);
            return None;
        }
        let base = if param.section == Section::Temp || in_instance { param.at } else { BitAddr(0) };
        let (ty, at) = path::follow(reader, &self.world.fields, &param.ty, base)?;
        let place = match formal {
            _ if param.section == Section::Temp => Place::Fixed(Area::Local, at),
            _ if in_instance => Place::Instance(at),
            Some(index) => Place::Param { index, at },
            None => return None,
        };
        let width = width_of(ty).unwrap_or(Width::Byte);
        Some(Value::Memory { operand: Operand { width, place }, ty: Some(ty) })
    }
}

/// The place of a pointer, when the operand can hold one.
fn pointer_place(operand: Operand, width: Width) -> Option<Pointer> {
    match operand.place {
        Place::Fixed(area @ (Area::Memory | Area::Local | Area::Db | Area::Di), at) if operand.width == width => {
            Some(Pointer { area, at })
        }
        _ => None,
    }
}

/// `12.7`.
fn bit_address(text: &str) -> Option<BitAddr> {
    let (byte, bit) = text.split_once('.')?;
    let byte: u32 = byte.parse().ok().filter(|b| *b <= BitAddr::MAX_BYTE)?;
    let bit: u8 = bit.parse().ok().filter(|b| *b < 8 && bit.len() == 1)?;
    Some(BitAddr::new(byte, bit))
}
