//! Writing.

use std::fmt::{self, Write as _};

use super::types::{hex, initial, type_line};
use crate::text::section;
use crate::{DataKind, Program};

/// Bytes of a data block on one line.
const ROW: usize = 32;

/// The file form of a program.
pub fn write(program: &Program) -> String {
    let mut text = String::new();
    // A String takes everything.
    let _ = put(program, &mut text);
    text
}

fn put(program: &Program, text: &mut String) -> fmt::Result {
    for source in &program.sources {
        writeln!(text, "source {source:?}")?;
    }
    for symbol in &program.symbols {
        write!(text, "symbol {:?} {:?}", symbol.name, symbol.address)?;
        if !symbol.comment.is_empty() {
            write!(text, " says {:?}", symbol.comment)?;
        }
        match &symbol.ty {
            Some(ty) => writeln!(text, " {}", type_line(ty))?,
            None => writeln!(text)?,
        }
    }
    for block in &program.blocks {
        let interface = &block.interface;
        let (instance, local) = (interface.instance_bytes, interface.temp_bytes);
        write!(text, "block {} source {} instance {instance} local {local}", block.id, block.source)?;
        name(block.name.as_deref(), text)?;
        writeln!(text)?;
        for param in &interface.params {
            let (section, at) = (section(param.section), param.at);
            write!(
                text,
                "  {section} {:?} @{at} {}{}",
                param.name,
                type_line(&param.ty),
                initial(param.initial.as_deref())
            )?;
            param.aliases.iter().try_for_each(|alias| write!(text, " or {alias:?}"))?;
            writeln!(text)?;
        }
        for stmt in &block.code {
            writeln!(text, "  {}/{} {:#}", stmt.network, stmt.line, stmt.op)?;
        }
    }
    for data in &program.data {
        write!(text, "data DB {}", data.number)?;
        name(data.name.as_deref(), text)?;
        if let DataKind::Instance(of) = data.kind {
            write!(text, " of {of}")?;
        }
        for (is_so, word) in [(data.read_only, " read_only"), (data.non_retain, " non_retain")] {
            text.push_str(if is_so { word } else { "" });
        }
        writeln!(text)?;
        for component in &data.components {
            writeln!(text, "  at {:?} @{} {}", component.path, component.at, type_line(&component.ty))?;
        }
        for row in data.bytes.chunks(ROW) {
            writeln!(text, "  bytes {}", hex(row))?;
        }
    }
    Ok(())
}

fn name(name: Option<&str>, text: &mut String) -> fmt::Result {
    name.map_or(Ok(()), |name| write!(text, " {name:?}"))
}
