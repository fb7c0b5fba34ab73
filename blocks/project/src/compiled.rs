//! The compiled interface of a block beside its text: whether both say the same, and declarations made of it alone.

use std::fmt::Write as _;

use ob1_mc7::{CompiledInterface, Entry, EntryType};
use ob1_model::{BlockId, DataType, Field, Interface, Param, Section};

use crate::source::Declarations;

/// True when both say the same: the same declarations in each section, with types that lie alike.
#[must_use]
pub(crate) fn agree(compiled: &CompiledInterface, interface: &Interface) -> bool {
    let mine = compiled.interface(false);
    mine.params.len() == interface.params.len()
        && Section::ALL.iter().all(|section| {
            let of = |interface: &Interface| {
                interface.params.iter().filter(|p| p.section == *section).cloned().collect::<Vec<_>>()
            };
            let (a, b) = (of(&mine), of(interface));
            a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| alike(&a.ty, &b.ty))
        })
}

/// The same type, except for names.
fn alike(a: &DataType, b: &DataType) -> bool {
    match (a, b) {
        (DataType::Struct(a), DataType::Struct(b)) => {
            let real = |fields: &'_ [Field]| {
                fields.iter().filter(|f| !is_break(&f.ty)).map(|f| f.ty.clone()).collect::<Vec<_>>()
            };
            let (a, b) = (real(a), real(b));
            a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| alike(a, b))
        }
        (DataType::Array(d, a), DataType::Array(e, b)) => d == e && alike(a, b),
        _ => a == b,
    }
}

/// The mark between two sections of an instance.
fn is_break(ty: &DataType) -> bool {
    matches!(ty, DataType::Struct(fields) if fields.is_empty())
}

/// Declarations made of the compiled interface, with the names of `text` as far as types agree in order.
#[must_use]
pub(crate) fn declarations(
    compiled: &CompiledInterface,
    text: Option<&Interface>,
    known: &dyn Fn(BlockId) -> bool,
) -> Declarations {
    let made = compiled.interface(false);
    let mut result = None;
    let mut out = String::new();
    for (section, word) in Section::WORDS {
        let entries: Vec<&Entry> = compiled.entries.iter().filter(|e| e.section() == Some(section)).collect();
        if entries.is_empty() {
            continue;
        }
        let named: Vec<&Param> = text.iter().flat_map(|i| &i.params).filter(|p| p.section == section).collect();
        let made: Vec<&Param> = made.params.iter().filter(|p| p.section == section).collect();
        let _ = writeln!(out, "{word}");
        let mut trusted = true;
        for (i, entry) in entries.iter().enumerate() {
            let theirs = named.get(i).filter(|p| trusted && made.get(i).is_some_and(|m| alike(&m.ty, &p.ty)));
            trusted = theirs.is_some();
            let Some(param) = theirs.or(made.get(i)) else { continue };
            let _ = write!(out, "  {} : ", param.name);
            write_type(&mut out, &entry.ty, Some(&param.ty), known, 1);
            out.push_str(" ;\n");
        }
        out.push_str("END_VAR\n");
    }
    if let Some(entry) = compiled.entries.iter().find(|e| e.section() == Some(Section::Return)) {
        let mut ty = String::new();
        write_type(&mut ty, &entry.ty, None, known, 0);
        result = Some(ty);
    }
    Declarations { result, text: out }
}

/// The structure of a data block made of its compiled interface.
#[must_use]
pub(crate) fn structure(compiled: &CompiledInterface, known: &dyn Fn(BlockId) -> bool) -> String {
    let mut out = String::new();
    write_type(&mut out, &EntryType::Struct(compiled.entries.clone()), None, known, 0);
    out.push_str(" ;\n");
    out
}

fn write_type(
    out: &mut String,
    entry: &EntryType,
    named: Option<&DataType>,
    known: &dyn Fn(BlockId) -> bool,
    depth: usize,
) {
    match entry {
        EntryType::Simple(ty) => out.push_str(ty.name()),
        EntryType::String(length) => {
            let _ = write!(out, "STRING [{length}]");
        }
        EntryType::Array(dims, element) => {
            let bounds: Vec<String> = dims.iter().map(|d| format!("{} .. {}", d.low, d.high)).collect();
            let _ = write!(out, "ARRAY [{}] OF ", bounds.join(", "));
            let inner = named.and_then(|ty| match ty {
                DataType::Array(_, element) => Some(&**element),
                _ => None,
            });
            write_type(out, &element.ty, inner, known, depth);
        }
        EntryType::Instance(id, _) if known(*id) => {
            let _ = write!(out, "{id}");
        }
        EntryType::Instance(_, inner) => write_type(out, &inner.ty, named, known, depth),
        EntryType::Struct(entries) => {
            let indent = "  ".repeat(depth + 1);
            let named: Vec<&Field> = match named {
                Some(DataType::Struct(fields)) => fields.iter().filter(|f| !is_break(&f.ty)).collect(),
                _ => Vec::new(),
            };
            out.push_str("STRUCT\n");
            for (i, entry) in entries.iter().enumerate() {
                let field = named.get(i);
                let name = field.map_or_else(|| format!("C{i}"), |f| f.name.clone());
                let _ = write!(out, "{indent}  {name} : ");
                write_type(out, &entry.ty, field.map(|f| &f.ty), known, depth + 1);
                out.push_str(" ;\n");
            }
            let _ = write!(out, "{indent}END_STRUCT");
        }
    }
}
