//! Operands: tokens to places, numbers, constants and blocks.

use std::collections::BTreeMap;

use ob1_ir::{AddressRegister, Number, Operand, Place, StatusBit, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Section};

use crate::constant::Constant;
use crate::identifiers::{BlockWord, Identifier, RELATIONS};
use crate::messages;
use crate::parser::{split_digits, unquote};
use crate::path::{self, Indices};
use crate::reader::Reader;
use crate::token::{Kind, Span, Token};
use crate::value::{Term, Value};
use crate::words::Words;
use crate::world::{Info, Symbolic, World};

/// Letters of the longest operand identifier, `DBNO`.
const LONGEST_IDENTIFIER: usize = 4;

/// The names in scope.
#[derive(Clone, Copy)]
pub struct Resolver<'w> {
    pub(crate) world: &'w World,
    pub(crate) words: &'w Words,
    /// The block whose statements are resolved.
    pub(crate) block: Option<(BlockKind, &'w Info)>,
    /// Set within `[ ]`, where no further indirect address may stand.
    nested: bool,
    /// Constants by name in capitals, where expressions of them may stand: in SCL.
    pub(crate) constants: Option<&'w BTreeMap<String, Constant>>,
}

impl Indices for Resolver<'_> {
    fn whole_number(&self, name: &str) -> Option<i32> {
        self.block?.1.constants.get(&name.to_uppercase())?.whole()
    }

    fn variable(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<Value<'_>> {
        self.inner(reader, span)
    }
}

impl<'w> Resolver<'w> {
    /// The names of the world; `block` adds the declarations of one of its blocks.
    pub fn new(world: &'w World, words: &'w Words, block: Option<(BlockKind, &'w Info)>) -> Self {
        Self { world, words, block, nested: false, constants: None }
    }

    /// The same with names of constants, of which there may be expressions.
    #[must_use]
    pub const fn with(self, constants: &'w BTreeMap<String, Constant>) -> Self {
        Self { constants: Some(constants), ..self }
    }

    /// Reads the operand within `[ ]`.
    pub(crate) fn inner(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<Value<'w>> {
        if self.nested {
            reader.report(span, &messages::INDIRECT, "an indirect address cannot be at an indirect address itself");
            return None;
        }
        Self { nested: true, ..*self }.operand(reader)
    }

    /// Reads one operand. `None` when it is not valid (reported).
    pub(crate) fn operand(&self, reader: &mut Reader<'_, '_>) -> Option<Value<'w>> {
        let span = reader.here();
        let Some(token) = reader.peek() else {
            reader.report(span, &messages::OPERAND_MISSING, "an operand is missing");
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

    /// A condition of the status word: `==0`, `<>0`, ...
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

    /// A word: operand identifier, TRUE/FALSE, or the name of a local or symbol without its sign.
    fn word(&self, reader: &mut Reader<'_, '_>, token: Token) -> Option<Value<'w>> {
        let text = reader.text(token);
        let (letters, digits) = split_digits(text);
        // `B`, `W` and `D` are no areas: `D1` is no address, and a name where it is declared.
        let indirect = reader.peek_second().is_some_and(|next| next.kind == Kind::LeftBracket);
        let is_name = matches!(self.words.identifier(letters), Some(Identifier::Crossing(_)))
            && self.is_declared(text)
            && (!indirect || !digits.is_empty());
        if is_name {
            reader.next();
            return self.local(reader, text, token.span);
        }
        if let Some(identifier) = self.words.identifier(text) {
            reader.next();
            return self.identified(reader, identifier, "", token.span);
        }
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
        if self.is_declared(text) {
            return self.local(reader, text, token.span);
        }
        if self.world.symbol(text).is_some() {
            return self.symbol(reader, text, token.span);
        }
        if let Some(value) = self.dotted(reader, text, token.span) {
            return Some(value);
        }
        if let Some(id) = self.offered(text) {
            return Some(Value::Block(BlockWord::of(id.kind), Number::Fixed(id.number)));
        }
        let shown: String = text.chars().take(32).collect();
        if self.words.is_foreign(letters) {
            let (message, remedy) = self.words.foreign(letters);
            reader.sink.report_with(reader.index, token.span, &messages::FOREIGN_MNEMONIC, message, remedy);
        } else if reader.peek_kind() == Some(Kind::Dot) || text.len() > LONGEST_IDENTIFIER {
            // No identifier is that long or has a component: it is a symbol without its quotes.
            self.world.report_unknown_symbol(text, reader.index, token.span, reader.sink);
        } else {
            let message = format!("{shown} is not an operand");
            let known = self.words.identifier_words();
            reader.sink.report_unknown(reader.index, token.span, &messages::UNKNOWN_OPERAND, message, letters, known);
        }
        None
    }

    /// The block of the library that has this name.
    pub(crate) fn offered(&self, name: &str) -> Option<BlockId> {
        let id = self.world.names.get(&name.to_uppercase()).copied();
        id.filter(|id| self.world.blocks.contains_key(id))
    }

    /// The block whose usual name this is, where neither program nor library have it.
    pub(crate) fn lacking(&self, name: &str) -> Option<BlockId> {
        let id = self.world.names.get(&name.to_uppercase()).copied()?;
        let is_there =
            self.world.blocks.contains_key(&id) || self.is_declared(name) || self.world.symbol(name).is_some();
        (!is_there && self.words.identifier(name).is_none()).then_some(id)
    }

    /// True for a name that the block declares.
    pub(crate) fn is_declared(&self, name: &str) -> bool {
        self.block.is_some_and(|(_, info)| info.declared(name).is_some())
    }

    /// True for a word that means nothing here, and of which nothing is known.
    pub(crate) fn is_unknown(&self, word: &str) -> bool {
        let (letters, digits) = split_digits(word);
        let is_identifier = |word: &str| self.words.identifier(word).is_some();
        let is_operand = is_identifier(word) || !digits.is_empty() && is_identifier(letters);
        let is_usual = self.world.names.contains_key(&word.to_uppercase());
        let is_name = is_usual || self.is_declared(word) || self.world.symbol(word).is_some();
        let is_known = is_operand || is_name || self.words.is_foreign(letters);
        !is_known
    }

    /// A symbol with points in its name, written without quotes.
    fn dotted(&self, reader: &mut Reader<'_, '_>, first: &str, span: Span) -> Option<Value<'w>> {
        let mut name = first.to_owned();
        let parts: Vec<Token> = reader.ahead().take(16).collect();
        let mut found = None;
        for (at, pair) in parts.chunks(2).enumerate() {
            let [dot, word] = pair else { break };
            if dot.kind != Kind::Dot || !matches!(word.kind, Kind::Word | Kind::Number) || word.spaced {
                break;
            }
            name.push('.');
            name.push_str(reader.text(*word));
            if self.world.symbol(&name).is_some() {
                found = Some((name.clone(), at + 1));
            }
        }
        let (name, pairs) = found?;
        for _ in 0..pairs * 2 {
            reader.next();
        }
        self.symbol(reader, &name, span)
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
                if area == Area::Di && self.block.is_some_and(|(_, info)| info.optimized) {
                    let message = "the instance of this block is optimised, so it has no addresses";
                    reader.report(span, &messages::OPTIMIZED, message);
                    return None;
                }
                let (operand, ty) = path::sliced(reader, Operand { width, place });
                let place = self.at_periphery(reader, operand.place, operand.width)?;
                Some(Value::Memory { operand: Operand { place, ..operand }, ty })
            }
            Identifier::Crossing(width) => {
                if reader.peek_kind() != Some(Kind::LeftBracket) {
                    reader.report(
                        span,
                        &messages::UNKNOWN_OPERAND,
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

    /// `:P` after an address or tag of inputs or outputs: the module itself. `None`: a bit (reported).
    fn at_periphery(&self, reader: &mut Reader<'_, '_>, place: Place, width: Width) -> Option<Place> {
        let Place::Fixed(Area::Input | Area::Output, at) = place else { return Some(place) };
        let colon = reader.peek_kind() == Some(Kind::Colon);
        let p = reader.peek_second().is_some_and(|t| t.kind == Kind::Word && reader.text(t).eq_ignore_ascii_case("P"));
        if !colon || !p {
            return Some(place);
        }
        if width == Width::Bit {
            let message = "the periphery has no bits here: load or transfer the byte, and take the bit from there";
            reader.report(reader.here(), &messages::NOT_SUPPORTED, message);
            return None;
        }
        reader.next();
        reader.next();
        Some(Place::Fixed(Area::Peripheral, at))
    }

    /// `DB10`, `FC 9`, `DB10.DBW 20`, `DB10.name`.
    fn block_operand(
        &self,
        reader: &mut Reader<'_, '_>,
        word: BlockWord,
        digits: &str,
        span: Span,
    ) -> Option<Value<'w>> {
        let data = matches!(word, BlockWord::Db | BlockWord::Di);
        let named = reader.peek().filter(|t| data && digits.is_empty() && matches!(t.kind, Kind::Local | Kind::Symbol));
        if let Some(token) = named {
            // `AUF DI #db`, `AUF DI "data"`: the name says which data block, the word before it the register.
            reader.next();
            let name = unquote(reader.text(token));
            let value = match token.kind {
                Kind::Local => self.local(reader, name, token.span),
                _ => self.symbol(reader, name, token.span),
            };
            return match value? {
                Value::Block(BlockWord::Db, number) => Some(Value::Block(word, number)),
                other => {
                    reader.report(
                        span,
                        &messages::WRONG_OPERAND,
                        format!("a data block is needed, this is {}", other.describe()),
                    );
                    None
                }
            };
        }
        let number = self.number(reader, digits, span)?;
        if data && number == Number::Fixed(0) {
            reader.report(span, &messages::NUMBER, "data blocks are numbered from 1");
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
    pub(crate) fn in_data(
        &self,
        reader: &mut Reader<'_, '_>,
        word: BlockWord,
        db: u16,
        span: Span,
    ) -> Option<Value<'w>> {
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
                self.refuse_optimized(reader, db, span)?;
                self.check_inside(reader, db, at, width, span);
                return Some(Value::Memory { operand: Operand { width, place: place(at) }, ty: None });
            }
        }
        let name = match token.map(|t| t.kind) {
            Some(Kind::Word | Kind::Symbol) => reader.next().map_or("", |t| unquote(reader.text(t))),
            _ => {
                reader.report(
                    span,
                    &messages::COMPONENT,
                    "DBX, DBB, DBW, DBD or a component's name should follow the point",
                );
                return None;
            }
        };
        let name_span = token.map_or(span, |t| t.span);
        let Some(data) = self.world.data.get(&db) else {
            self.world.report_missing_data(db, name, reader.index, span, reader.sink);
            return None;
        };
        let Some(component) = data.find(name) else {
            let known = data.components.iter().map(|c| c.path.as_str());
            let message = format!("DB {db} has no component {name}");
            reader.sink.report_unknown(reader.index, name_span, &messages::COMPONENT, message, name, known);
            return None;
        };
        let mut terms = Vec::new();
        let (ty, at) = path::follow(self, reader, &self.world.fields, &component.ty, component.at, &mut terms)?;
        let width = Width::of(ty).unwrap_or(Width::Byte);
        Some(at_index(Operand { width, place: place(at) }, ty, None, terms))
    }

    /// An optimised data block has no addresses. `None`: reported.
    pub fn refuse_optimized(&self, reader: &mut Reader<'_, '_>, db: u16, span: Span) -> Option<()> {
        if self.world.data.get(&db).is_some_and(|data| data.optimized) {
            let message = format!("DB {db} is optimised, so it has no addresses");
            reader.report(span, &messages::OPTIMIZED, message);
            return None;
        }
        Some(())
    }

    /// Warns when an absolute address lies beyond the end of a data block of the program.
    fn check_inside(&self, reader: &mut Reader<'_, '_>, db: u16, at: BitAddr, width: Width, span: Span) {
        let Some(data) = self.world.data.get(&db) else { return };
        if (at.byte() + width.bytes()) as usize > data.image.len() {
            let message = format!("DB {db} has {} bytes, this is beyond its end", data.image.len());
            reader.report(span, &messages::BEYOND_DATA_BLOCK, message);
        }
    }

    /// `"symbol"`; a component may follow that of a data block.
    pub(crate) fn symbol(&self, reader: &mut Reader<'_, '_>, name: &str, span: Span) -> Option<Value<'w>> {
        match self.world.symbol(name) {
            Some(Symbolic::Block(BlockWord::Db, n)) if reader.peek_kind() == Some(Kind::Dot) => {
                reader.next();
                self.in_data(reader, BlockWord::Db, *n, span)
            }
            Some(Symbolic::Block(word, n)) => Some(Value::Block(*word, Number::Fixed(*n))),
            Some(Symbolic::Memory(operand, ty)) => {
                // A type of another width (from a careless table) does not change what the address says.
                let ty = ty.as_ref().filter(|ty| Width::of(ty) == Some(operand.width));
                if let (operand, Some(ty)) = path::sliced(reader, *operand) {
                    return Some(Value::Memory { operand, ty: Some(ty) });
                }
                let place = self.at_periphery(reader, operand.place, operand.width)?;
                Some(Value::Memory { operand: Operand { place, ..*operand }, ty })
            }
            Some(Symbolic::Timer(n)) => Some(Value::Timer(Number::Fixed(*n))),
            Some(Symbolic::Counter(n)) => Some(Value::Counter(Number::Fixed(*n))),
            Some(Symbolic::Unknown(address)) => {
                let message = format!("the symbol table gives \"{name}\" the address {address}, which is not valid");
                reader.report(span, &messages::UNKNOWN_SYMBOL, message);
                None
            }
            Some(Symbolic::Nameless) => None,
            None => {
                self.world.report_unknown_symbol(name, reader.index, span, reader.sink);
                None
            }
        }
    }

    /// `#name` with its components.
    pub(crate) fn local(&self, reader: &mut Reader<'_, '_>, name: &str, span: Span) -> Option<Value<'w>> {
        let declared = self.block.and_then(|(kind, info)| {
            let (index, overlay) = info.declared(name)?;
            Some((kind, info, index, overlay))
        });
        let Some((kind, info, index, overlay)) = declared else {
            let constant = self.block.and_then(|(_, info)| info.constants.get(&name.to_uppercase()));
            if let Some(constant) = constant {
                return Some(Value::Constant(constant.clone()));
            }
            if self.block.is_some() && self.world.symbol(name).is_some() {
                let shown: String = name.chars().take(32).collect();
                let message = format!("#{shown} is not declared in this block; the symbol \"{shown}\" is taken");
                reader.report(span, &messages::LOCAL_IS_SHARED, message);
                return self.symbol(reader, name, span);
            }
            let known = self.block.into_iter().flat_map(|(_, i)| &i.interface.params).map(|p| p.name.as_str());
            let shown: String = name.chars().take(64).collect();
            let key = format!("#{} {}", reader.index, name.to_uppercase());
            reader.sink.missing(&key, reader.index, span, &messages::UNKNOWN_LOCAL, |sink| {
                let near = sink.nearest(name, known);
                let remedy = near
                    .map_or_else(|| messages::UNKNOWN_LOCAL.remedy.to_owned(), |near| format!("Did you mean {near}?"));
                (format!("#{shown} is not declared in this block"), remedy)
            });
            return None;
        };
        let param = info.interface.params.get(index)?;
        if info.unsupplied.contains(&index) {
            let message = format!("nothing supplies the input #{} of this organization block", param.name);
            reader.report(span, &messages::OB_INPUT, message);
        }
        let ty = overlay.unwrap_or(&param.ty);
        if let Some(fb) = info.instances.get(&index) {
            return self.instance(reader, *fb, &param.ty, param.at);
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
        if in_instance && param.is_pointer() {
            let whole = !matches!(reader.peek_kind(), Some(Kind::Dot | Kind::LeftBracket));
            let mut terms = Vec::new();
            let (ty, at) = path::follow(self, reader, &self.world.fields, ty, BitAddr(0), &mut terms)?;
            let place = Place::Register(None, AddressRegister::Ar1, at);
            let operand = Operand { width: Width::of(ty).unwrap_or(Width::Byte), place };
            if !terms.is_empty() {
                return Some(at_index(operand, ty, Some(param.at), terms));
            }
            return Some(Value::Through { pointer: param.at, operand, ty, whole });
        }
        let base = if param.section == Section::Temp || in_instance { param.at } else { BitAddr(0) };
        let mut terms = Vec::new();
        let (ty, at) = path::follow(self, reader, &self.world.fields, ty, base, &mut terms)?;
        if !terms.is_empty() && formal.is_some() && !in_instance {
            let message =
                "the address of a parameter of a function is known only at run time, and so is that of its element";
            reader.report(span, &messages::NOT_SUPPORTED, message);
            return None;
        }
        let place = match formal {
            _ if param.section == Section::Temp => Place::Fixed(Area::Local, at),
            _ if in_instance => Place::Instance(at),
            Some(index) => Place::Param { index, at },
            None => return None,
        };
        let width = Width::of(ty).unwrap_or(Width::Byte);
        Some(at_index(Operand { width, place }, ty, None, terms))
    }

    /// What `#pump` or `#pumps[2]` names: an instance, or with a component after it a place within one.
    fn instance(
        &self,
        reader: &mut Reader<'_, '_>,
        fb: BlockId,
        declared: &'w DataType,
        base: BitAddr,
    ) -> Option<Value<'w>> {
        let mut one = declared;
        while let DataType::Array(_, element) = one {
            one = element;
        }
        let mut terms = Vec::new();
        let span = reader.here();
        let (ty, at) = path::follow(self, reader, &self.world.fields, declared, base, &mut terms)?;
        if std::ptr::eq(ty, one) {
            if !terms.is_empty() {
                let message =
                    "an instance can be called with a fixed index only, not with one that is known at run time";
                reader.report(span, &messages::NOT_SUPPORTED, message);
                return None;
            }
            return Some(Value::Instance(fb, at));
        }
        let operand = Operand { width: Width::of(ty).unwrap_or(Width::Byte), place: Place::Instance(at) };
        Some(at_index(operand, ty, None, terms))
    }
}

/// A place in memory, or with indices known at run time only what leads to it.
fn at_index<'w>(operand: Operand, ty: &'w DataType, through: Option<BitAddr>, terms: Vec<Term>) -> Value<'w> {
    if terms.is_empty() {
        return Value::Memory { operand, ty: Some(ty) };
    }
    Value::Indexed { operand, through, terms, ty }
}
