//! Declarations to the world: block numbers, types, interfaces and data blocks, whatever their order in the sources.

use std::collections::{BTreeMap, BTreeSet};

use ob1_model::{BlockId, BlockKind, DataType, Dimension, Interface, Layout, Param, Section, is_organization_block};

use crate::auto::Sets;
use crate::constant::Constant;
use crate::diagnostic::Sink;
use crate::identifiers::BlockWord;
use crate::initial;
use crate::library::Library;
use crate::messages;
use crate::numbering::numbered::Numbered;
use crate::operand::Resolver;
use crate::parse_types::{TYPE_DEPTH, type_words};
use crate::reader::Reader;
use crate::syntax::{Block, Declaration, Frame, NameRef, Tokens, TypeKind};
use crate::tia;
use crate::token::{File, Span};
use crate::type_words::with_article;
use crate::types::needed;
use crate::world::{Info, Symbolic, World};

/// The longest data block, instance and local data, in bytes.
pub(crate) const LONGEST: u32 = 65_534;

/// The block that runs in each cycle.
const MAIN: BlockId = BlockId::new(BlockKind::Ob, 1);

/// Parameters of one block.
const FORMALS: usize = 512;

/// Types and start values of all declarations together, in components and bytes: far above any CPU's memory, and a
/// bound for sources that declare arrays of arrays.
const BUDGET: u64 = 64 << 20;

/// A type or interface on its way.
#[derive(Debug)]
pub(crate) enum State<T> {
    /// Being made: a request for it now is part of a cycle.
    Busy,
    Done(T),
    /// It has a mistake, reported.
    Bad,
}

/// A type with all names in it resolved.
#[derive(Clone, Debug)]
pub(crate) struct Resolved {
    pub(crate) ty: DataType,
    /// The FB it is an instance of.
    pub(crate) fb: Option<BlockId>,
    /// How deep types lie in each other.
    pub(crate) depth: u32,
}

impl Resolved {
    /// A structure without components.
    pub(crate) const fn nothing() -> Self {
        Self { ty: DataType::Struct(Vec::new()), fb: None, depth: 0 }
    }
}

/// A block's number and the index of its syntax.
pub(crate) type Named = (BlockWord, u16);

pub(crate) struct Elaborator<'e> {
    pub(crate) files: &'e [File<'e>],
    pub(crate) blocks: &'e [Block],
    pub(crate) sets: &'e Sets,
    pub(crate) library: &'e Library,
    pub(crate) sink: &'e mut Sink,
    pub(crate) world: World,
    /// The number of each block of the sources; `None` when it has none or another has it.
    pub(crate) names: Vec<Option<Named>>,
    pub(crate) by_name: BTreeMap<Named, usize>,
    pub(crate) udts: BTreeMap<u16, State<Resolved>>,
    pub(crate) fbs: BTreeMap<u16, State<()>>,
    /// `VAR CONSTANT` of the block whose declarations are read, by name in capitals.
    pub(crate) constants: BTreeMap<String, Constant>,
    budget: u64,
    budget_reported: bool,
}

impl<'e> Elaborator<'e> {
    pub(crate) fn new(
        files: &'e [File<'e>],
        blocks: &'e [Block],
        sets: &'e Sets,
        library: &'e Library,
        symbols: BTreeMap<String, Symbolic>,
        sink: &'e mut Sink,
    ) -> Self {
        let world = World { symbols, ..World::default() };
        Self {
            files,
            blocks,
            sets,
            library,
            sink,
            world,
            names: Vec::new(),
            by_name: BTreeMap::new(),
            udts: BTreeMap::new(),
            fbs: BTreeMap::new(),
            constants: BTreeMap::new(),
            budget: BUDGET,
            budget_reported: false,
        }
    }

    /// Everything but the statements. Gives the blocks called by bare name.
    pub(crate) fn run(&mut self) -> Vec<Numbered> {
        self.world.explain = self.library.explained();
        self.world.names = self.library.names();
        self.name_blocks();
        let demanded = self.demand_blocks();
        for (id, block) in self.library.iter() {
            // The program's own block replaces one that is only offered, whatever its mistakes.
            if self.world.own.contains(&id) {
                continue;
            }
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
        demanded
    }

    fn name_blocks(&mut self) {
        for (index, block) in self.blocks.iter().enumerate() {
            let name =
                self.resolve_name(block.file, &block.name, block.span).filter(|name| self.fits_frame(block, *name));
            let name = name.filter(|name| {
                let twice = self.by_name.contains_key(name);
                if twice {
                    let first = self.by_name.get(name).and_then(|first| self.blocks.get(*first));
                    let line =
                        first.and_then(|first| Some((first.file, self.files.get(first.file)?.line_of(first.span))));
                    let place = match line {
                        Some((file, line)) if file == block.file => format!(", first in line {line}"),
                        Some((file, line)) => format!(", first in {}:{line}", self.sink.name(file)),
                        None => String::new(),
                    };
                    let message = format!("{} {} occurs twice{place}", name.0.name(), name.1);
                    self.sink.report(block.file, block.span, &messages::DUPLICATE_BLOCK, message);
                }
                !twice
            });
            if let Some(name) = name {
                self.by_name.insert(name, index);
                if name.0 == BlockWord::Ob && !is_organization_block(name.1) {
                    let message =
                        format!("nothing calls OB {}: no CPU has an organization block of this number", name.1);
                    self.sink.report(block.file, block.span, &messages::NEVER_CALLED, message);
                }
                let id = name.0.kind().map(|kind| BlockId::new(kind, name.1));
                self.world.own.extend(id);
                if let Some(known) = id.and_then(|id| self.library.get(id)).filter(|known| !known.yields) {
                    let by = if known.origin.is_empty() { "the library" } else { known.origin.as_str() };
                    let message = format!("{} {} is both this block and {} of {by}", name.0.name(), name.1, known.name);
                    self.sink.report(block.file, block.span, &messages::ALSO_IN_LIBRARY, message);
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
                format!("{} {number} cannot be the name of this block; write {} n", word.name(), expected.name());
            self.sink.report(block.file, block.span, &messages::BLOCK_NAME, message);
        }
        fits
    }

    /// A block's kind and number, through the symbol table where it is named by symbol.
    pub(crate) fn resolve_name(&mut self, file: usize, name: &NameRef, span: Span) -> Option<Named> {
        let symbol = match name {
            NameRef::Absolute(word, number) => return Some((*word, *number)),
            NameRef::Symbol(symbol) | NameRef::Bare(symbol) => symbol,
        };
        match self.world.symbol(symbol) {
            Some(Symbolic::Block(word, number)) => Some((*word, *number)),
            Some(Symbolic::Nameless) => None,
            Some(_) => {
                self.sink.report(
                    file,
                    span,
                    &messages::UNKNOWN_SYMBOL,
                    format!("\"{symbol}\" is not the symbol of a block"),
                );
                None
            }
            None if matches!(name, NameRef::Bare(_)) => {
                // TIA Portal names the block of an instance.
                if let Some(id) = self.world.names.get(&symbol.to_uppercase()).filter(|id| id.kind.has_instance()) {
                    return Some((BlockWord::of(id.kind), id.number));
                }
                let symbols = &self.world.symbols;
                let known = symbols.keys().map(String::as_str).chain(type_words().map(|w| -> &str { w }));
                let shown: String = symbol.chars().take(64).collect();
                let message = format!("{shown} is not a data type");
                self.sink.report_unknown(file, span, &messages::UNKNOWN_TYPE, message, symbol, known);
                None
            }
            None => {
                self.world.report_unknown_symbol(symbol, file, span, self.sink);
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
                        &messages::TOO_MUCH_DATA,
                        "the program declares more data than any CPU holds",
                    );
                }
                false
            }
        }
    }

    pub(crate) fn too_long(&mut self, file: usize, span: Span, what: &str) {
        self.sink.report(file, span, &messages::TOO_LONG, format!("{what} is longer than {LONGEST} bytes"));
    }

    pub(crate) fn not_twice(
        &mut self,
        file: usize,
        declaration: &Declaration,
        names: &mut BTreeMap<String, ()>,
    ) -> bool {
        let fresh = names.insert(declaration.name.to_uppercase(), ()).is_none();
        if !fresh {
            let message = format!("{} is declared twice", declaration.name);
            self.sink.report(file, declaration.span, &messages::DECLARED_TWICE, message);
        }
        fresh
    }

    /// A declaration's start value. `None` when there is none or it has a mistake (reported).
    pub(crate) fn start_value(
        &mut self,
        file: usize,
        tokens: Option<&Tokens>,
        span: Span,
        ty: &DataType,
    ) -> Option<Vec<u8>> {
        let tokens = tokens?.clone();
        if !self.spend(file, span, initial::size(ty) as u64 * 8) {
            return None;
        }
        let mut resolver = Resolver::new(&self.world, self.sets.of(file), None);
        if self.sets.is_scl(file) {
            resolver = resolver.with(&self.constants);
        }
        let mut reader = Reader::new(file, self.files.get(file)?, self.sink, tokens, span);
        initial::read(&resolver, &mut reader, ty)
    }

    /// Makes the interface of an FB of the program. False when it is missing, being made, or has a mistake.
    pub(crate) fn function_block(&mut self, number: u16, nesting: u32) -> bool {
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
        if let Some(mut info) = self.interface(index, 0) {
            if id.kind == BlockKind::Ob {
                self.ob_inputs(index, id, &mut info);
            }
            self.world.blocks.insert(id, info);
        }
    }

    /// The inputs that TIA Portal declares in organization blocks: one of OB 1 is supplied.
    fn ob_inputs(&self, index: usize, id: BlockId, info: &mut Info) {
        let Some(block) = self.blocks.get(index) else { return };
        for at in block.inputs().filter_map(|declaration| info.find(&declaration.name)).collect::<Vec<_>>() {
            let Some(param) = info.interface.params.get(at) else { continue };
            if id == MAIN && param.is_called("Initial_Call") && param.ty == DataType::Bool {
                info.initial_call = Some(param.at);
            } else {
                info.unsupplied.insert(at);
            }
        }
    }

    /// The inputs of the type DB_ANY.
    fn db_any(&self, block: &Block, info: &Info) -> BTreeSet<usize> {
        let Some(file) = self.files.get(block.file) else { return BTreeSet::new() };
        let is_one = |declaration: &&Declaration| file.slice(declaration.ty.span).eq_ignore_ascii_case(tia::DB_ANY);
        block.inputs().filter(is_one).filter_map(|declaration| info.find(&declaration.name)).collect()
    }

    /// The interface of a code block. `None` when a declaration has a mistake that moves the others.
    fn interface(&mut self, index: usize, nesting: u32) -> Option<Info> {
        let block = self.blocks.get(index)?;
        let outer = std::mem::take(&mut self.constants);
        for declaration in &block.constants {
            if let Some(constant) = self.constant(block, declaration) {
                self.constants.insert(declaration.name.to_uppercase(), constant);
            }
        }
        let info = self.declarations(block, nesting);
        let constants = std::mem::replace(&mut self.constants, outer);
        info.map(|mut info| {
            info.constants = constants;
            info
        })
    }

    /// The declarations of a code block.
    fn declarations(&mut self, block: &Block, nesting: u32) -> Option<Info> {
        let has_instance = block.frame == Frame::Fb;
        let mut params = Vec::new();
        let mut fbs = Vec::new();
        let mut names = BTreeMap::new();
        let mut overlays = Vec::new();
        let mut good = true;
        // Limits are checked as declarations come: names of one declaration share a type that may be large.
        let (mut instance_bits, mut temp_bits, mut formals) = (0u64, 0u64, 0usize);
        // Inputs of an organization block are temps after the start information, which the CPU writes.
        let of_ob = block.frame == Frame::Ob && block.sections.iter().any(|(section, _)| *section == Section::Input);
        if of_ob {
            let bytes = Dimension { low: 1, high: 20 };
            let ty = DataType::Array(vec![bytes], Box::new(DataType::Byte));
            params.push(Param::new("OB_START_INFO", Section::Temp, ty));
            fbs.push(None);
        }
        for (section, declarations) in &block.sections {
            let section = if of_ob { &Section::Temp } else { section };
            for declaration in declarations {
                self.sink.steps += 1;
                good &= self.not_twice(block.file, declaration, &mut names);
                if let Some(over) = &declaration.over {
                    match self.overlay(block.file, declaration, over, &params, nesting) {
                        Some(ty) => overlays.push((declaration.name.to_uppercase(), over, ty)),
                        None => good = false,
                    }
                    continue;
                }
                let Some((param, fb)) = self.param(block, *section, declaration, nesting) else {
                    good = false;
                    continue;
                };
                match section {
                    Section::Temp => temp_bits += u64::from(Layout::bits(&param.ty)),
                    _ => instance_bits += u64::from(Layout::bits(&param.ty)),
                }
                formals += usize::from(!matches!(section, Section::Static | Section::Temp));
                let instance_bytes = if has_instance { instance_bits / 8 } else { 0 };
                self.within_limits(block, instance_bytes, temp_bits / 8, formals)?;
                params.push(param);
                fbs.push(fb);
            }
        }
        if let Some(result) = &block.result {
            match self.ty(block.file, result, nesting) {
                Some(resolved) => {
                    let mut param = Param::new("RET_VAL", Section::Return, resolved.ty);
                    // TIA Portal calls it like its function.
                    let called = match &block.name {
                        NameRef::Symbol(name) => Some(name),
                        NameRef::Bare(name) if block.scl.is_some() => Some(name),
                        _ => None,
                    };
                    if let Some(name) = called
                        && !names.contains_key(&name.to_uppercase())
                    {
                        param.aliases.push(name.clone());
                    }
                    params.push(param);
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
        if !good {
            return None;
        }
        interface.lay_out(has_instance);
        let (instance, temp) = (u64::from(interface.instance_bytes), u64::from(interface.temp_bytes));
        self.within_limits(block, instance, temp, formals)?;
        let mut info = Info::new(block.header_name.clone(), interface, instances);
        info.db_any = self.db_any(block, &info);
        info.optimized = block.optimized;
        info.code_version1 = block.code_version1;
        for (name, over, ty) in overlays {
            if let Some(index) = info.find(over) {
                info.overlays.insert(name, (index, ty));
            }
        }
        Some(info)
    }

    /// `y AT x : TYPE`: a second type with which `x` is seen. `None` when there is no such variable, or it cannot be
    /// seen so (reported).
    fn overlay(
        &mut self,
        file: usize,
        declaration: &Declaration,
        over: &str,
        before: &[Param],
        nesting: u32,
    ) -> Option<DataType> {
        let Some(below) = before.iter().find(|p| p.is_called(over)).map(|p| p.ty.clone()) else {
            let message = format!("{over} is not declared before it, so AT cannot overlay it");
            self.sink.report(file, declaration.span, &messages::UNKNOWN_LOCAL, message);
            return None;
        };
        let resolved = self.ty(file, &declaration.ty, nesting)?;
        // SCL looks into POINTER and ANY by views.
        let scl = self.sets.is_scl(file);
        let special = |ty: &DataType| ty.is_parameter_type() || matches!(ty, DataType::Pointer) && !scl;
        if resolved.fb.is_some() || special(&resolved.ty) || special(&below) {
            let message = "AT overlays values only, not instances, timers, counters or blocks";
            self.sink.report(file, declaration.span, &messages::TYPE_NOT_HERE, message);
            return None;
        }
        if needed(&resolved.ty) > Layout::bits(&below).max(8) {
            let message = format!("{} is longer than {over}, which it overlays", declaration.name);
            self.sink.report(file, declaration.span, &messages::TYPE_NOT_HERE, message);
            return None;
        }
        Some(resolved.ty)
    }

    /// One of `VAR CONSTANT`. `None` when it has no value, or a mistake (reported).
    fn constant(&mut self, block: &Block, declaration: &Declaration) -> Option<Constant> {
        let file = block.file;
        let Some(tokens) = declaration.initial.clone() else {
            self.sink.report(
                file,
                declaration.span,
                &messages::INITIAL_VALUE,
                "a constant has a value: name : TYPE := 5;",
            );
            return None;
        };
        let mut resolver = Resolver::new(&self.world, self.sets.of(file), None);
        if block.scl.is_some() {
            resolver = resolver.with(&self.constants);
        }
        let mut reader = Reader::new(file, self.files.get(file)?, self.sink, tokens, declaration.span);
        let constant = resolver.constant(&mut reader)?;
        reader.finish(&messages::INITIAL_VALUE);
        Some(match (constant, &declaration.ty.kind) {
            // The type says how wide a number is.
            (Constant::Integer(v), TypeKind::Simple(DataType::DInt)) => {
                i32::try_from(v).map_or(Constant::Integer(v), Constant::DInt)
            }
            (Constant::Integer(v), TypeKind::Simple(DataType::Real)) => Constant::Real(v as f32),
            (constant, _) => constant,
        })
    }

    /// Checks an interface against the limits; `None` when it breaks one (reported).
    fn within_limits(&mut self, block: &Block, instance_bytes: u64, temp_bytes: u64, formals: usize) -> Option<()> {
        for (bytes, what) in [(instance_bytes, "the instance"), (temp_bytes, "the local data")] {
            if bytes > u64::from(LONGEST) {
                self.too_long(block.file, block.span, what);
                return None;
            }
        }
        if formals > FORMALS {
            let message = format!("a block has at most {FORMALS} parameters");
            self.sink.report(block.file, block.span, &messages::TOO_MANY_PARAMETERS, message);
            return None;
        }
        Some(())
    }

    fn param(
        &mut self,
        block: &Block,
        section: Section,
        declaration: &Declaration,
        nesting: u32,
    ) -> Option<(Param, Option<BlockId>)> {
        let mut resolved = self.ty(block.file, &declaration.ty, nesting)?;
        if section != Section::Static && resolved.fb.is_some_and(tia::is_data_type) {
            // Elsewhere it is a structure like any other.
            resolved.fb = None;
        }
        let placed = matches!(section, Section::Static | Section::Temp);
        let wrong = resolved.fb.is_some() && section != Section::Static
            || resolved.ty.is_parameter_type() && (placed || section == Section::Output)
            || resolved.ty == DataType::Pointer && placed
            || resolved.ty == DataType::Any && section == Section::Static;
        if wrong {
            let message = format!("{} cannot be declared in this section", with_article(&declared_type(&resolved)));
            self.sink.report(block.file, declaration.span, &messages::TYPE_NOT_HERE, message);
            return None;
        }
        let of_function = block.frame == Frame::Fc && section == Section::Input;
        let takes_initial =
            (block.frame == Frame::Fb && section != Section::Temp || of_function) && resolved.fb.is_none();
        let mut param = Param::new(&declaration.name, section, resolved.ty);
        if declaration.initial.is_some() && (!takes_initial || section == Section::InOut && param.ty.is_composed()) {
            self.sink.report(
                block.file,
                declaration.span,
                &messages::INITIAL_VALUE,
                "a start value is not allowed here",
            );
        } else {
            param.initial = self.start_value(block.file, declaration.initial.as_ref(), declaration.span, &param.ty);
            if of_function && param.initial.is_some() {
                let message = format!("the start value of {} has no effect: each call supplies it", param.name);
                self.sink.report(block.file, declaration.span, &messages::START_OF_INPUT, message);
            }
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

pub(crate) fn declared_type(resolved: &Resolved) -> String {
    resolved.fb.map_or_else(|| resolved.ty.name().to_owned(), |fb| fb.to_string())
}
