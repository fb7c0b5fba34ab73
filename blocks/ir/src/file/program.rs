//! Reading line by line.

use std::fmt;

use ob1_model::{Component, Interface, Param, Section};

use super::cursor::{Cursor, Expected};
use super::ops::op;
use crate::text::section;
use crate::{CodeBlock, DataBlock, DataKind, Program, Stmt, Symbol};

/// Why a text is not a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParseError {
    /// The line, from 1.
    pub line: usize,
    /// What was expected there.
    pub expected: &'static str,
    /// What is there instead.
    pub found: String,
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: expected {}, found \"{}\"", self.line, self.expected, self.found)
    }
}

impl std::error::Error for ParseError {}

/// The program of a text in the file form.
///
/// # Errors
/// The first line that does not belong to it.
pub fn parse(text: &str) -> Result<Program, ParseError> {
    let mut program = Program::default();
    let mut inside = Inside::Nothing;
    for (line, written) in (1..).zip(text.lines()) {
        let trimmed = written.trim();
        if trimmed.is_empty() || trimmed.starts_with(';') {
            continue;
        }
        let mut rest = Cursor(trimmed);
        let read = read(&mut rest, &mut program, &mut inside);
        let read = read.and_then(|()| if rest.is_empty() { Ok(()) } else { Err("the end of the line") });
        read.map_err(|expected| ParseError { line, expected, found: rest.0.trim().to_owned() })?;
    }
    Ok(program)
}

/// What the lines belong to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Inside {
    Nothing,
    Block,
    Data,
}

fn read(line: &mut Cursor<'_>, program: &mut Program, inside: &mut Inside) -> Expected<()> {
    if line.eat("source ") {
        program.sources.push(line.quoted()?);
    } else if line.eat("symbol ") {
        let (name, address) = (line.quoted()?, line.quoted()?);
        let comment = if line.eat("says ") { line.quoted()? } else { String::new() };
        let ty = if line.is_empty() { None } else { Some(line.ty()?) };
        program.symbols.push(Symbol { name, address, ty, comment });
    } else if line.eat("block ") {
        let id = line.block()?;
        line.need("source")?;
        let source = line.number()?;
        line.need("instance")?;
        let instance_bytes = line.number()?;
        line.need("local")?;
        let interface = Interface { params: Vec::new(), instance_bytes, temp_bytes: line.number()? };
        let name = if line.is_empty() { None } else { Some(line.quoted()?) };
        program.blocks.push(CodeBlock { id, name, interface, code: Vec::new(), source });
        *inside = Inside::Block;
    } else if line.eat("data DB") {
        let number = line.number()?;
        let named = line.0.trim_start().starts_with('"');
        let name = if named { Some(line.quoted()?) } else { None };
        let kind = if line.eat("of") { DataKind::Instance(line.block()?) } else { DataKind::Global };
        let (read_only, non_retain) = (line.eat("read_only"), line.eat("non_retain"));
        let (bytes, components) = (Vec::new(), Vec::new());
        program.data.push(DataBlock { number, name, kind, bytes, components, read_only, non_retain });
        *inside = Inside::Data;
    } else {
        match (*inside, program.blocks.last_mut(), program.data.last_mut()) {
            (Inside::Block, Some(block), _) => of_block(line, block)?,
            (Inside::Data, _, Some(data)) => of_data(line, data)?,
            _ => return Err("source, symbol, block or data"),
        }
    }
    Ok(())
}

fn of_block(line: &mut Cursor<'_>, block: &mut CodeBlock) -> Expected<()> {
    if line.0.starts_with(|c: char| c.is_ascii_digit()) {
        let network = line.number()?;
        line.need("/")?;
        let number = line.number()?;
        let op = op(line.0)?;
        line.0 = "";
        block.code.push(Stmt { op, network, line: number });
        return Ok(());
    }
    let section = line.choice(Section::ALL, |one| format!("{} ", section(one)), "a section or a statement")?;
    let name = line.quoted()?;
    line.need("@")?;
    let at = line.address()?;
    let (ty, initial) = (line.ty()?, line.initial()?);
    let mut aliases = Vec::new();
    while line.eat("or ") {
        aliases.push(line.quoted()?);
    }
    block.interface.params.push(Param { name, aliases, section, ty, at, initial });
    Ok(())
}

fn of_data(line: &mut Cursor<'_>, data: &mut DataBlock) -> Expected<()> {
    if line.eat("bytes ") {
        data.bytes.extend(line.bytes()?);
        return Ok(());
    }
    line.need("at ")?;
    let path = line.quoted()?;
    line.need("@")?;
    data.components.push(Component { path, at: line.address()?, ty: line.ty()? });
    Ok(())
}
