//! SCL beside STL: statements of Siemens' structured text to operations.
//!
//! Sources of both languages are one program: [`compile`] reads what both share (places, declarations, types, numbers,
//! symbols: [`ob1_stl::front`]) with `ob1-stl`, and the statements of SCL blocks here. The way of a block: tokens ->
//! statements ([`syntax`]) -> expressions with types, every conversion written out ([`tree`]) -> operations. One
//! statement is checked and lowered after the other; a mistake costs its own statement only.
//!
//! This crate knows the instruction set ([`ob1_ir`]) and no engine.

mod address;
mod calls;
mod cases;
mod check;
mod code;
mod convert;
mod cursor;
mod dates;
mod emit_bool;
mod emit_call;
mod emit_copy;
mod emit_place;
mod emit_unsigned;
mod emit_value;
mod expr;
mod functions;
mod lower;
pub mod messages;
mod moves;
mod names;
mod options;
mod parse_expr;
mod parse_stmt;
mod peek;
mod syntax;
mod timers;
mod tree;
mod types;
mod unsigned;

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::CodeBlock;
use ob1_model::BlockId;
use ob1_stl::front::{Block, Kind, Scope, Statements, Words};
use ob1_stl::{Library, Options, Output, Source};

use check::Checker;
use code::Code;
use cursor::Cursor;
use lower::Lowerer;

/// Compiles sources of STL and SCL into a program. Blocks may call each other across sources, languages and in any
/// order.
pub fn compile(sources: &[Source], library: &Library, options: &Options) -> Output {
    let scl = Scl { words: Words::of_both(), read: Cell::default() };
    ob1_stl::compile_with(sources, library, options, Some(&scl))
}

/// The compiler of SCL statements, for one run.
#[derive(Debug)]
struct Scl {
    /// Addresses have German and international letters.
    words: Words,
    /// How far the compiler options of a source are read.
    read: Cell<options::Read>,
}

impl Statements for Scl {
    fn compile(&self, id: BlockId, block: &Block, scope: Scope<'_>) -> Option<CodeBlock> {
        let Scope { file, world, sink, wanted } = scope;
        let range = block.scl.clone()?;
        let errors = sink.errors();
        let last_line = file.tokens.get(range.end).map_or(1, |t| t.line);
        let tokens = file.tokens.get(range.clone()).unwrap_or_default();
        let statements = Cursor::new(block.file, file, sink, range).statements_of_block();
        // Its declarations have a mistake, which is reported.
        let info = world.blocks.get(&id)?;
        let read = self.read.get().until(block, file);
        self.read.set(read);
        let options = read.of(block, file);
        let named = |word: &str| {
            tokens.iter().any(|t| t.kind == Kind::Word && file.of(*t).eq_ignore_ascii_case(word))
                && info.declared(word).is_none()
        };
        let uses_ok = options.set_ok || options.monitor_limits || named("OK") || named("ENO");
        let mut code = Code::new(info.interface.temp_bytes, options);
        let checker = Checker {
            id,
            block,
            info,
            file,
            world,
            sink,
            words: &self.words,
            options,
            wanted,
            line: 1,
            written: BTreeSet::new(),
            read: BTreeMap::new(),
        };
        code.concat = checker.block_called("CONCAT");
        let move_block = BlockId::new(ob1_model::BlockKind::Sfc, 20);
        code.move_block = world.blocks.contains_key(&move_block).then_some(move_block);
        let params = info.interface.params.iter().enumerate();
        code.texts = params.filter(|(_, p)| matches!(p.ty, ob1_model::DataType::String(_))).map(|(at, _)| at).collect();
        code.has_instance = id.kind.has_instance();
        let formals = (0u16..).zip(info.interface.formals());
        code.elementary = formals.filter(|(_, p)| !p.ty.is_composed()).map(|(at, _)| at).collect();
        let mut lowerer = Lowerer::new(checker, code);
        lowerer.block(&statements, uses_ok, last_line);
        lowerer.finish_checks();
        let Lowerer { check, code, .. } = lowerer;
        if check.sink.errors() > errors {
            return None;
        }
        let (code, temp_bytes) = code.finish();
        let mut interface = info.interface.clone();
        interface.temp_bytes = interface.temp_bytes.max(temp_bytes);
        Some(CodeBlock { id, name: block.shown_name(), interface, code, source: block.file as u32 })
    }
}
