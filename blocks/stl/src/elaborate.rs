//! Declarations to the world: block numbers, types, interfaces and data blocks, whatever their order in the sources.

use std::collections::BTreeMap;

use ob1_model::{BlockId, BlockKind, DataType, Dimension, Field, Interface, Layout, Param, Section};

use crate::codes;
use crate::diagnostic::Sink;
use crate::initial;
use crate::library::Library;
use crate::mnemonics::{BlockWord, Words};
use crate::operand::{Resolver, with_article};
use crate::parse_types::TYPE_DEPTH;
use crate::reader::Reader;
use crate::syntax::{Block, Declaration, Frame, NameRef, Tokens, Type, TypeKind};
use crate::token::{File, Span};
use crate::world::{Info, Symbolic, World};

/// The longest data block, instance and local data, in bytes.
pub(crate) const LONGEST: u32 = 65_534;

/// Parameters of one block.
const FORMALS: usize = 512;

/// Types and start values of all declarations together, in components and bytes: far above any CPU's memory, and a
/// bound for sources that declare arrays of arrays.
const BUDGET: u64 = 64 << 20;

/// A type or interface on its way.
#[derive(Debug)]
enum State<T> {
    /// Being made: whoever asks for it now is part of a circle.
    Busy,
    Done(T),
    /// It has a mistake, reported.
    Bad,
}

/// A resolved type.
#[derive(Clone, Debug)]
pub(crate) struct Resolved {
    pub(crate) ty: DataType,
    /// The FB it is an instance of.
    pub(crate) fb: Option<BlockId>,
    /// How deep types lie in each other.
    depth: u32,
}

/// A block's number and the index of its syntax.
pub(crate) type Named = (BlockWord, u16);

pub(crate) struct Elaborator<'e> {
    pub(crate) files: &'e [File<'e>],
    pub(crate) blocks: &'e [Block],
    pub(crate) words: &'e Words,
    pub(crate) library: &'e Library,
    pub(crate) sink: &'e mut Sink,
    pub(crate) world: World,
    /// The number of each block of the sources; `None` when it has none or another has it.
    pub(crate) names: Vec<Option<Named>>,
    by_name: BTreeMap<Named, usize>,
    udts: BTreeMap<u16, State<Resolved>>,
    fbs: BTreeMap<u16, State<()>>,
    budget: u64,
    budget_reported: bool,
}

impl<'e> Elaborator<'e> {
    pub(crate) fn new(
        files: &'e [File<'e>],
        blocks: &'e [Block],
        words: &'e Words,
        library: &'e Library,
        symbols: BTreeMap<String, Symbolic>,
        sink: &'e mut Sink,
    ) -> Self {
        let world = World { symbols, ..World::default() };
        Self {
            files,
            blocks,
            words,
            library,
            sink,
            world,
            names: Vec::new(),
            by_name: BTreeMap::new(),
            udts: BTreeMap::new(),
            fbs: BTreeMap::new(),
            budget: BUDGET,
            budget_reported: false,
        }
    }

    /// Everything but the statements.
    pub(crate) fn run(&mut self) {
        self.name_blocks();
        for (id, block) in self.library.iter() {
            let info = Info::new(Some(block.name.clone()), block.interface.clone(), BTreeMap::new());
            self.world.blocks.insert(id, info);
        }
        for index in 0..self.blocks.len() {
            match self.names.get(index).copied().flatten() {
                Some((BlockWord::Udt, n)) => {
                    self.udt(n, 0);
                }
                Some((BlockWord::Fb, n)) => {
                    self.function_block(n, 0);
                }
                Some((BlockWord::Ob, n)) => self.plain_block(index, BlockId::new(BlockKind::Ob, n)),
                Some((BlockWord::Fc, n)) => self.plain_block(index, BlockId::new(BlockKind::Fc, n)),
                _ => {}
            }
        }
        for index in 0..self.blocks.len() {
            if let Some((BlockWord::Db, n)) = self.names.get(index).copied().flatten() {
                self.data_block(index, n);
            }
        }
    }

    fn name_blocks(&mut self) {
        for (index, block) in self.blocks.iter().enumerate() {
            let name =
                self.resolve_name(block.file, &block.name, block.span).filter(|name| self.fits_frame(block, *name));
            let name = name.filter(|name| {
                let twice = self.by_name.contains_key(name);
                if twice {
                    let message = format!("{} {} is there twice", name.0.name(), name.1);
                    self.sink.report(block.file, block.span, &codes::DUPLICATE_BLOCK, message);
                }
                !twice
            });
            if let Some(name) = name {
                self.by_name.insert(name, index);
                let id = name.0.kind().map(|kind| BlockId::new(kind, name.1));
                if let Some(known) = id.and_then(|id| self.library.get(id)) {
                    let message = format!("{} {} is also in the library, as {}", name.0.name(), name.1, known.name);
                    self.sink.report(block.file, block.span, &codes::ALSO_IN_LIBRARY, message);
                }
            }
            self.names.push(name);
        }
    }

    fn fits_frame(&mut self, block: &Block, (word, number): Named) -> bool {
        let expected = match block.frame {
            Frame::Ob => BlockWord::Ob,
            Frame::Fc => BlockWord::Fc,
            Frame::Fb => BlockWord::Fb,
            Frame::Db => BlockWord::Db,
            Frame::Udt => BlockWord::Udt,
        };
        let fits = word == expected && (word != BlockWord::Db || number > 0);
        if !fits {
            let message =
                format!("{} {number} cannot be the name of this block, {} n is", word.name(), expected.name());
            self.sink.report(block.file, block.span, &codes::BLOCK_NAME, message);
        }
        fits
    }

    /// A block's kind and number, through the symbol table where it is named by symbol.
    pub(crate) fn resolve_name(&mut self, file: usize, name: &NameRef, span: Span) -> Option<Named> {
        let symbol = match name {
            NameRef::Absolute(word, number) => return Some((*word, *number)),
            NameRef::Symbol(symbol) => symbol,
        };
        match self.world.symbol(symbol) {
            Some(Symbolic::Block(word, number)) => Some((*word, *number)),
            Some(_) => {
                self.sink.report(file, span, &codes::UNKNOWN_SYMBOL, format!("\"{symbol}\" is the symbol of no block"));
                None
            }
            None => {
                let known = self.world.symbols.keys().map(String::as_str);
                let message = format!("the symbol \"{symbol}\" is in no symbol table");
                self.sink.report_unknown(file, span, &codes::UNKNOWN_SYMBOL, message, symbol, known);
                None
            }
        }
    }

    /// Takes from the budget; false when it is used up (reported once).
    pub(crate) fn spend(&mut self, file: usize, span: Span, cost: u64) -> bool {
        self.sink.steps += cost / 64;
        match self.budget.checked_sub(cost) {
            Some(left) => {
                self.budget = left;
                true
            }
            None => {
                if !self.budget_reported {
                    self.budget_reported = true;
                    self.sink.report(
                        file,
                        span,
                        &codes::TOO_MUCH_DATA,
                        "the program declares more data than any CPU holds",
                    );
                }
                false
            }
        }
    }

    /// A type as written. `None` when it has a mistake (reported).
    pub(crate) fn ty(&mut self, file: usize, ty: &Type, nesting: u32) -> Option<Resolved> {
        let resolved = match &ty.kind {
            TypeKind::Bad => return None,
            TypeKind::Simple(simple) => Resolved { ty: simple.clone(), fb: None, depth: 0 },
            TypeKind::Array(dims, element) => self.array(file, ty.span, dims, element, nesting)?,
            TypeKind::Struct(declarations) => {
                let (fields, depth) = self.fields(file, declarations, nesting)?;
                if fields.is_empty() {
                    self.sink.report(file, ty.span, &codes::EMPTY_STRUCT, "the structure has no components");
                    return None;
                }
                Resolved { ty: DataType::Struct(fields), fb: None, depth: depth + 1 }
            }
            TypeKind::Named(name) => self.named(file, name, ty.span, nesting)?,
        };
        if resolved.depth > TYPE_DEPTH {
            self.sink.report(
                file,
                ty.span,
                &codes::TYPE_DEPTH,
                format!("types lie more than {TYPE_DEPTH} deep in each other"),
            );
            return None;
        }
        Some(resolved)
    }

    fn array(
        &mut self,
        file: usize,
        span: Span,
        dims: &[(i32, i32)],
        element: &Type,
        nesting: u32,
    ) -> Option<Resolved> {
        let inner = self.ty(file, element, nesting)?;
        if inner.ty.is_parameter_type() {
            let message = format!("there are no arrays of {}", inner.ty.name());
            self.sink.report(file, element.span, &codes::TYPE_NOT_HERE, message);
            return None;
        }
        let dims: Vec<_> = dims.iter().map(|(low, high)| Dimension { low: *low, high: *high }).collect();
        let count = dims.iter().fold(1u64, |n, d| n.saturating_mul(u64::from(d.len())));
        // Rows begin on even bytes, so the size is held against the limit row by row.
        let row = dims.last().map_or(0, |d| u64::from(d.len()).saturating_mul(u64::from(Layout::stride(&inner.ty))));
        let rows = count / dims.last().map_or(1, |d| u64::from(d.len()).max(1));
        let bits = row.saturating_add(15).saturating_mul(rows.max(1));
        if bits > u64::from(LONGEST) * 8 + 15 || count > u64::from(LONGEST) * 8 {
            self.too_long(file, span, "the array");
            return None;
        }
        Some(Resolved { ty: DataType::Array(dims, Box::new(inner.ty)), fb: None, depth: inner.depth + 1 })
    }

    fn too_long(&mut self, file: usize, span: Span, what: &str) {
        self.sink.report(file, span, &codes::TOO_LONG, format!("{what} is longer than {LONGEST} bytes"));
    }

    /// The components of a structure. `None` when one has a mistake: the layout of the others would be wrong.
    pub(crate) fn fields(
        &mut self,
        file: usize,
        declarations: &[Declaration],
        nesting: u32,
    ) -> Option<(Vec<Field>, u32)> {
        let mut fields = Vec::with_capacity(declarations.len());
        let mut layout = Layout::new();
        let mut depth = 0;
        let mut good = true;
        let mut names = BTreeMap::new();
        for declaration in declarations {
            self.sink.steps += 1;
            good &= self.not_twice(file, declaration, &mut names);
            let Some(resolved) = self.ty(file, &declaration.ty, nesting) else {
                good = false;
                continue;
            };
            if resolved.ty.is_parameter_type() || resolved.fb.is_some() {
                let message = format!("a structure has no components of the type {}", declared_type(&resolved));
                self.sink.report(file, declaration.span, &codes::TYPE_NOT_HERE, message);
                good = false;
                continue;
            }
            layout.place(&resolved.ty);
            if layout.bytes() > LONGEST {
                self.too_long(file, declaration.span, "the structure");
                return None;
            }
            let initial = self.start_value(file, declaration.initial.as_ref(), declaration.span, &resolved.ty);
            depth = depth.max(resolved.depth);
            fields.push(Field { name: declaration.name.clone(), ty: resolved.ty, initial });
        }
        good.then_some((fields, depth))
    }

    fn not_twice(&mut self, file: usize, declaration: &Declaration, names: &mut BTreeMap<String, ()>) -> bool {
        let fresh = names.insert(declaration.name.to_uppercase(), ()).is_none();
        if !fresh {
            let message = format!("{} is declared twice", declaration.name);
            self.sink.report(file, declaration.span, &codes::DECLARED_TWICE, message);
        }
        fresh
    }

    /// A declaration's start value. `None` when there is none or it has a mistake (reported).
    fn start_value(&mut self, file: usize, tokens: Option<&Tokens>, span: Span, ty: &DataType) -> Option<Vec<u8>> {
        let tokens = tokens?.clone();
        if !self.spend(file, span, initial::size(ty) as u64 * 8) {
            return None;
        }
        let resolver = Resolver::new(&self.world, self.words, None);
        let mut reader = Reader::new(file, self.files.get(file)?, self.sink, tokens, span);
        initial::read(&resolver, &mut reader, ty)
    }

    fn named(&mut self, file: usize, name: &NameRef, span: Span, nesting: u32) -> Option<Resolved> {
        let (word, number) = self.resolve_name(file, name, span)?;
        let resolved = match word {
            BlockWord::Udt => match self.udt(number, nesting + 1) {
                Some(resolved) => resolved,
                None => {
                    self.unusable_type(file, span, word, number);
                    return None;
                }
            },
            BlockWord::Fb | BlockWord::Sfb => self.instance(file, span, word, number, nesting)?,
            _ => {
                self.sink.report(file, span, &codes::UNKNOWN_TYPE, format!("{} {number} is no data type", word.name()));
                return None;
            }
        };
        let cost = nodes(&resolved.ty);
        self.spend(file, span, cost).then_some(resolved)
    }

    fn unusable_type(&mut self, file: usize, span: Span, word: BlockWord, number: u16) {
        let name = format!("{} {number}", word.name());
        let message = match self.udts.get(&number) {
            Some(State::Busy) => format!("{name} contains itself"),
            Some(_) => format!("{name} has mistakes of its own"),
            None => format!("{name} is not in the program"),
        };
        self.sink.report(file, span, &codes::UNUSABLE_TYPE, message);
    }

    /// A UDT. `None` when it is missing, has a mistake, or is being made.
    fn udt(&mut self, number: u16, nesting: u32) -> Option<Resolved> {
        match self.udts.get(&number) {
            Some(State::Done(resolved)) => return Some(resolved.clone()),
            Some(_) => return None,
            None => {}
        }
        let index = *self.by_name.get(&(BlockWord::Udt, number))?;
        let block = self.blocks.get(index)?;
        self.udts.insert(number, State::Busy);
        let resolved = match &block.shape {
            Some(shape) if nesting <= TYPE_DEPTH => self.ty(block.file, shape, nesting),
            Some(_) => None,
            None => {
                self.sink.report(block.file, block.span, &codes::NO_STRUCTURE, "the TYPE has no structure");
                None
            }
        };
        let state = resolved.clone().map_or(State::Bad, State::Done);
        self.udts.insert(number, state);
        resolved
    }

    /// The type of a multi-instance: a structure with the layout of the FB's instance.
    fn instance(&mut self, file: usize, span: Span, word: BlockWord, number: u16, nesting: u32) -> Option<Resolved> {
        let kind = if word == BlockWord::Sfb { BlockKind::Sfb } else { BlockKind::Fb };
        let id = BlockId::new(kind, number);
        if word == BlockWord::Fb
            && !self.function_block(number, nesting + 1)
            && self.by_name.contains_key(&(word, number))
        {
            let message = match self.fbs.get(&number) {
                Some(State::Busy) => format!("{id} contains itself"),
                _ => format!("{id} has mistakes of its own, or lies too deep"),
            };
            self.sink.report(file, span, &codes::UNUSABLE_TYPE, message);
            return None;
        }
        let Some(info) = self.world.blocks.get(&id) else {
            self.sink.report(
                file,
                span,
                &codes::NO_BLOCK,
                format!("{id} is neither in the program nor in the library"),
            );
            return None;
        };
        let ty = instance_type(&info.interface);
        let depth = depth_of(&ty);
        Some(Resolved { ty, fb: Some(id), depth })
    }

    /// Makes the interface of an FB of the program. False when it is missing, being made, or has a mistake.
    fn function_block(&mut self, number: u16, nesting: u32) -> bool {
        match self.fbs.get(&number) {
            Some(State::Done(())) => return true,
            Some(_) => return false,
            None => {}
        }
        let Some(index) = self.by_name.get(&(BlockWord::Fb, number)).copied() else { return false };
        if nesting > TYPE_DEPTH {
            return false;
        }
        self.fbs.insert(number, State::Busy);
        let info = self.interface(index, nesting);
        let state = if info.is_some() { State::Done(()) } else { State::Bad };
        self.fbs.insert(number, state);
        let good = info.is_some();
        if let Some(info) = info {
            self.world.blocks.insert(BlockId::new(BlockKind::Fb, number), info);
        }
        good
    }

    fn plain_block(&mut self, index: usize, id: BlockId) {
        if let Some(info) = self.interface(index, 0) {
            self.world.blocks.insert(id, info);
        }
    }

    /// The interface of a code block. `None` when a declaration has a mistake that moves the others.
    fn interface(&mut self, index: usize, nesting: u32) -> Option<Info> {
        let block = self.blocks.get(index)?;
        let has_instance = block.frame == Frame::Fb;
        let mut params = Vec::new();
        let mut fbs = Vec::new();
        let mut names = BTreeMap::new();
        let mut good = true;
        for (section, declarations) in &block.sections {
            for declaration in declarations {
                self.sink.steps += 1;
                good &= self.not_twice(block.file, declaration, &mut names);
                match self.param(block, *section, declaration, nesting) {
                    Some((param, fb)) => {
                        params.push(param);
                        fbs.push(fb);
                    }
                    None => good = false,
                }
            }
        }
        if let Some(result) = &block.result {
            match self.ty(block.file, result, nesting) {
                Some(resolved) => {
                    params.push(Param::new("RET_VAL", Section::Return, resolved.ty));
                    fbs.push(None);
                }
                None => good = false,
            }
        }
        let mut order: Vec<usize> = (0..params.len()).collect();
        order.sort_by_key(|i| rank(params.get(*i).map_or(Section::Temp, |p| p.section)));
        let instances = order.iter().enumerate().filter_map(|(at, i)| Some((at, (*fbs.get(*i)?)?))).collect();
        let mut slots: Vec<Option<Param>> = params.into_iter().map(Some).collect();
        let params: Vec<Param> = order.iter().filter_map(|i| slots.get_mut(*i)?.take()).collect();
        let mut interface = Interface { params, ..Interface::default() };
        good &= self.check_size(block, &interface);
        if !good {
            return None;
        }
        interface.lay_out(has_instance);
        Some(Info::new(block.header_name.clone(), interface, instances))
    }

    /// Holds the interface against the limits before anything is laid out.
    fn check_size(&mut self, block: &Block, interface: &Interface) -> bool {
        let sum = |temp: bool| {
            let of = interface.params.iter().filter(|p| (p.section == Section::Temp) == temp);
            of.map(|p| u64::from(Layout::bits(&p.ty)) + 16).sum::<u64>() / 8
        };
        // Up to two bytes a declaration are counted for alignment; the exact sum is taken only when that is too much.
        let exact = |temp: bool| {
            let mut layout = Layout::new();
            interface.params.iter().filter(|p| (p.section == Section::Temp) == temp).any(|p| {
                layout.place(&p.ty);
                layout.bytes() > LONGEST
            })
        };
        for temp in [false, true] {
            let counted = temp || block.frame == Frame::Fb;
            if counted && sum(temp) > u64::from(LONGEST) && exact(temp) {
                self.too_long(block.file, block.span, if temp { "the local data" } else { "the instance" });
                return false;
            }
        }
        if interface.formals().count() > FORMALS {
            let message = format!("a block has at most {FORMALS} parameters");
            self.sink.report(block.file, block.span, &codes::TOO_MANY_PARAMETERS, message);
            return false;
        }
        true
    }

    fn param(
        &mut self,
        block: &Block,
        section: Section,
        declaration: &Declaration,
        nesting: u32,
    ) -> Option<(Param, Option<BlockId>)> {
        let resolved = self.ty(block.file, &declaration.ty, nesting)?;
        let placed = matches!(section, Section::Static | Section::Temp);
        let wrong = resolved.fb.is_some() && section != Section::Static
            || resolved.ty.is_parameter_type() && (placed || section == Section::Output)
            || resolved.ty == DataType::Pointer && placed
            || resolved.ty == DataType::Any && section == Section::Static;
        if wrong {
            let message = format!("{} cannot be declared in this section", with_article(&declared_type(&resolved)));
            self.sink.report(block.file, declaration.span, &codes::TYPE_NOT_HERE, message);
            return None;
        }
        let takes_initial = block.frame == Frame::Fb && section != Section::Temp && resolved.fb.is_none();
        let mut param = Param::new(&declaration.name, section, resolved.ty);
        if declaration.initial.is_some() && (!takes_initial || param.is_pointer()) {
            self.sink.report(block.file, declaration.span, &codes::INITIAL_VALUE, "there is no start value here");
        } else {
            param.initial = self.start_value(block.file, declaration.initial.as_ref(), declaration.span, &param.ty);
        }
        Some((param, resolved.fb))
    }
}

/// The order of sections in an interface.
const fn rank(section: Section) -> u8 {
    match section {
        Section::Input => 0,
        Section::Output => 1,
        Section::InOut => 2,
        Section::Return => 3,
        Section::Static => 4,
        Section::Temp => 5,
    }
}

fn declared_type(resolved: &Resolved) -> String {
    resolved.fb.map_or_else(|| resolved.ty.name().to_owned(), |fb| fb.to_string())
}

/// An FB's instance as a structure. Each section begins on an even byte: an empty structure between them, which takes no
/// room of its own, makes the layout do that.
fn instance_type(interface: &Interface) -> DataType {
    let mut fields: Vec<Field> = Vec::new();
    let mut last = None;
    for param in interface.params.iter().filter(|p| p.section != Section::Temp) {
        if last.is_some_and(|section| section != param.section) {
            fields.push(Field { name: String::new(), ty: DataType::Struct(Vec::new()), initial: None });
        }
        last = Some(param.section);
        let ty = if param.is_pointer() { DataType::Pointer } else { param.ty.clone() };
        fields.push(Field { name: param.name.clone(), ty, initial: param.initial.clone() });
    }
    DataType::Struct(fields)
}

fn depth_of(ty: &DataType) -> u32 {
    match ty {
        DataType::Struct(fields) => 1 + fields.iter().map(|f| depth_of(&f.ty)).max().unwrap_or(0),
        DataType::Array(_, element) => 1 + depth_of(element),
        _ => 0,
    }
}

/// What a copy of the type costs.
fn nodes(ty: &DataType) -> u64 {
    match ty {
        DataType::Struct(fields) => fields.iter().map(|f| 1 + nodes(&f.ty)).sum::<u64>() + 1,
        DataType::Array(_, element) => 1 + nodes(element),
        _ => 1,
    }
}
