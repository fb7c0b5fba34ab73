//! Blocks around their statements: headings, declarations, data blocks, user-defined types.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_ir::{CodeBlock, DataBlock, DataKind};
use ob1_model::{BitAddr, BlockId, BlockKind, Component, DataType, Field, Interface, Layout, Section, cells};

use super::constant::constant;
use super::operand::path;
use super::printer::{Listing, Printer, Unprintable, quoted};
use crate::initial;

/// The head of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Heading {
    /// `TITLE =`; empty without one.
    pub title: String,
    /// Comment lines below the title; empty: none.
    pub comment: String,
    /// `AUTHOR`; empty without one.
    pub author: String,
    /// `FAMILY`; empty without one.
    pub family: String,
    /// `VERSION`, a digit in each half; 0: none.
    pub version: u8,
}

/// Names of declared types, which the types alone do not hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Declared {
    /// Variables that are instances of a function block, by their index in the interface.
    pub instances: BTreeMap<usize, BlockId>,
    /// Declarations of a user-defined type, by their index.
    pub udts: BTreeMap<usize, u16>,
}

impl Printer<'_> {
    /// A code block from its first word to its last.
    ///
    /// # Errors
    /// What no source can express.
    pub fn block(
        &self,
        block: &CodeBlock,
        heading: &Heading,
        declared: &Declared,
        listing: &Listing,
    ) -> Result<String, Unprintable> {
        let wrong = |what: String| Unprintable { block: block.id, statement: None, what };
        let (begin, end) = match block.id.kind {
            BlockKind::Ob => ("ORGANIZATION_BLOCK", "END_ORGANIZATION_BLOCK"),
            BlockKind::Fb => ("FUNCTION_BLOCK", "END_FUNCTION_BLOCK"),
            BlockKind::Fc => ("FUNCTION", "END_FUNCTION"),
            other => return Err(wrong(format!("the code of an {}", other.name()))),
        };
        let mut out = format!("{begin} {}", block.id);
        if block.id.kind == BlockKind::Fc {
            let value = block.interface.params.iter().find(|p| p.section == Section::Return);
            out.push_str(" : ");
            match value {
                Some(value) => self.ty(&mut out, &value.ty, 0).map_err(wrong)?,
                None => out.push_str("VOID"),
            }
        }
        out.push('\n');
        self.heading(&mut out, heading, block.name.as_deref());
        self.sections(&mut out, &block.interface, declared).map_err(wrong)?;
        out.push_str("BEGIN\n");
        out.push_str(&self.statements(block, listing)?);
        let _ = writeln!(out, "{end}");
        Ok(out)
    }

    /// A data block: its structure, or the function block it is an instance of, and the values that differ from those
    /// it would begin with.
    ///
    /// # Errors
    /// What no source can express, such as a value without a constant.
    pub fn data(&self, data: &DataBlock, heading: &Heading) -> Result<String, Unprintable> {
        let wrong =
            |what: String| Unprintable { block: BlockId::new(BlockKind::Db, data.number), statement: None, what };
        let mut out = format!("DATA_BLOCK DB {}\n", data.number);
        self.heading(&mut out, heading, data.name.as_deref());
        if data.read_only {
            out.push_str("READ_ONLY\n");
        }
        if data.non_retain {
            out.push_str("NON_RETAIN\n");
        }
        let mut image = vec![0; data.bytes.len()];
        match data.kind {
            DataKind::Instance(fb) => {
                let _ = writeln!(out, "{fb}");
                let interface =
                    (self.callees)(fb).ok_or_else(|| wrong(format!("an instance of {fb}, which is not known")))?;
                for param in interface.params.iter().filter(|p| p.section != Section::Temp) {
                    let ty = if param.is_pointer() { &DataType::Pointer } else { &param.ty };
                    match &param.initial {
                        Some(bytes) => initial::put(&mut image, param.at, ty, bytes),
                        None => initial::write_default(ty, param.at, &mut image),
                    }
                }
            }
            DataKind::Global => {
                out.push_str("  STRUCT\n");
                for component in &data.components {
                    let _ = write!(out, "    {} : ", quoted(&component.path));
                    self.ty(&mut out, &component.ty, 2).map_err(wrong)?;
                    out.push_str(";\n");
                    initial::write_default(&component.ty, component.at, &mut image);
                }
                out.push_str("  END_STRUCT;\n");
            }
        }
        out.push_str("BEGIN\n");
        for (path, value) in assignments(&data.components, &image, &data.bytes).map_err(wrong)? {
            let _ = writeln!(out, "  {path} := {value};");
        }
        out.push_str("END_DATA_BLOCK\n");
        Ok(out)
    }

    /// The source of a user-defined type.
    ///
    /// # Errors
    /// What no source can express, in words.
    pub fn udt(&self, number: u16, ty: &DataType, heading: &Heading) -> Result<String, String> {
        let mut out = format!("TYPE UDT {number}\n");
        self.heading(&mut out, heading, None);
        out.push_str("  ");
        self.ty(&mut out, ty, 1)?;
        out.push_str(";\nEND_TYPE\n");
        Ok(out)
    }

    fn heading(&self, out: &mut String, heading: &Heading, name: Option<&str>) {
        let line = |text: &str| text.replace(['\r', '\n'], " ").trim().to_owned();
        if !heading.title.is_empty() {
            let _ = writeln!(out, "TITLE = {}", line(&heading.title));
        }
        for comment in heading.comment.lines() {
            let _ = writeln!(out, "//{}", comment.trim_end());
        }
        let words = [("AUTHOR", Some(heading.author.as_str())), ("FAMILY", Some(&heading.family)), ("NAME", name)];
        for (key, text) in words {
            if let Some(text) = text.filter(|t| !t.trim().is_empty()) {
                let _ = writeln!(out, "{key} : '{}'", line(text).replace('\'', " "));
            }
        }
        if heading.version != 0 {
            let _ = writeln!(out, "VERSION : {}.{}", heading.version >> 4, heading.version & 15);
        }
    }

    /// The declaration sections of an interface.
    fn sections(&self, out: &mut String, interface: &Interface, declared: &Declared) -> Result<(), String> {
        for (section, word) in Section::WORDS {
            let mut of = interface.params.iter().enumerate().filter(|(_, p)| p.section == section).peekable();
            if of.peek().is_none() {
                continue;
            }
            let _ = writeln!(out, "{word}");
            for (index, param) in of {
                let _ = write!(out, "  {} : ", quoted(&param.name));
                match (declared.instances.get(&index), declared.udts.get(&index)) {
                    (Some(fb), _) => out.push_str(&fb.to_string()),
                    (None, Some(udt)) => {
                        let _ = write!(out, "UDT {udt}");
                    }
                    (None, None) => self.ty(out, &param.ty, 1)?,
                }
                if let Some(bytes) = &param.initial {
                    let value =
                        start_value(&param.ty, bytes).ok_or_else(|| format!("the start value of {}", param.name))?;
                    let _ = write!(out, " := {value}");
                }
                out.push_str(";\n");
            }
            out.push_str("END_VAR\n");
        }
        Ok(())
    }

    /// A type as declared.
    fn ty(&self, out: &mut String, ty: &DataType, depth: usize) -> Result<(), String> {
        match ty {
            DataType::String(length) => {
                let _ = write!(out, "STRING [{length}]");
            }
            DataType::Array(dims, element) => {
                let bounds: Vec<_> = dims.iter().map(|d| format!("{} .. {}", d.low, d.high)).collect();
                let _ = write!(out, "ARRAY [{}] OF ", bounds.join(", "));
                self.ty(out, element, depth)?;
            }
            DataType::Struct(fields) => {
                out.push_str("STRUCT\n");
                let indent = "  ".repeat(depth + 1);
                for Field { name, ty, initial } in fields {
                    if name.is_empty() {
                        return Err("the instance of a function block without its number".to_owned());
                    }
                    let _ = write!(out, "{indent}{} : ", quoted(name));
                    self.ty(out, ty, depth + 1)?;
                    if let Some(bytes) = initial {
                        let value = start_value(ty, bytes).ok_or_else(|| format!("the start value of {name}"))?;
                        let _ = write!(out, " := {value}");
                    }
                    out.push_str(";\n");
                }
                let _ = write!(out, "{}END_STRUCT", "  ".repeat(depth));
            }
            DataType::TimerOrWord => return Err("a parameter that is a timer or a word".to_owned()),
            simple => out.push_str(simple.name()),
        }
        Ok(())
    }
}

/// A start value: a constant, or those of an array's elements.
fn start_value(ty: &DataType, bytes: &[u8]) -> Option<String> {
    let DataType::Array(dims, element) = ty else { return constant(ty, bytes) };
    let stride = Layout::stride(element);
    let columns = dims.last()?.len();
    let rows: u32 = dims.iter().rev().skip(1).map(|d| d.len()).product();
    let row_bits = ob1_model::align_to(columns * stride, 16);
    let mut runs: Vec<(u32, String)> = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let value = value_at(element, bytes, BitAddr(row * row_bits + column * stride))?;
            match runs.last_mut().filter(|(_, last)| *last == value) {
                Some((count, _)) => *count += 1,
                None => runs.push((1, value)),
            }
        }
    }
    let runs = runs.into_iter().map(|(n, value)| if n == 1 { value } else { format!("{n} ({value})") });
    Some(runs.collect::<Vec<_>>().join(", "))
}

/// The constant of what lies at an address.
fn value_at(ty: &DataType, bytes: &[u8], at: BitAddr) -> Option<String> {
    if *ty == DataType::Bool {
        let bit = cells::bit(bytes, at.0 as usize)?;
        return constant(ty, &[u8::from(bit)]);
    }
    let start = at.byte() as usize;
    constant(ty, bytes.get(start..start + initial::size(ty))?)
}

/// The assignments that make `wanted` of `start`, component by component.
fn assignments(components: &[Component], start: &[u8], wanted: &[u8]) -> Result<Vec<(String, String)>, String> {
    let mut out = Vec::new();
    for component in components {
        let mut parts = Vec::new();
        Layout::components("", &component.ty, component.at, &mut parts);
        for part in parts {
            let length = initial::size(&part.ty).max(1);
            let from = part.at.byte() as usize;
            let differs = match part.ty {
                DataType::Bool => cells::bit(start, part.at.0 as usize) != cells::bit(wanted, part.at.0 as usize),
                _ => start.get(from..from + length) != wanted.get(from..from + length),
            };
            if differs {
                let path = path(&component.ty, part.at.0 - component.at.0, &|ty| *ty == part.ty).unwrap_or_default();
                let path = format!("{}{path}", quoted(&component.path));
                let value = value_at(&part.ty, wanted, part.at).ok_or_else(|| format!("the value of {path}"))?;
                out.push((path, value));
            }
        }
    }
    Ok(out)
}
