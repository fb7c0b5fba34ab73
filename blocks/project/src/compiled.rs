//! The compiled interface of a block beside its text: whether both say the same, and declarations made of it alone.

use std::fmt::Write as _;

use ob1_mc7::{CompiledInterface, Entry, EntryType, InterfaceKind};
use ob1_model::{BlockId, Component, DataType, Field, Interface, Param, Section};

use crate::source::Declarations;

/// True when both say the same: the same declarations in each section, with types that lie alike.
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

/// The compiler of SCL puts the declarations of a data block into one more structure. Without it, where the text has
/// none.
fn unframed(compiled: &CompiledInterface, text: &[Component]) -> Option<CompiledInterface> {
    let is_structure = matches!(text, [Component { ty: DataType::Struct(_), .. }]);
    let [Entry { ty: EntryType::Struct(inner), .. }] = compiled.entries.as_slice() else { return None };
    (!text.is_empty() && !is_structure).then(|| CompiledInterface { entries: inner.clone(), ..compiled.clone() })
}

/// The same of a global data block.
pub(crate) fn agree_data(compiled: &CompiledInterface, components: &[Component]) -> bool {
    let unframed = unframed(compiled, components);
    let compiled = unframed.as_ref().unwrap_or(compiled);
    let made = compiled.interface(false).params;
    compiled.kind != InterfaceKind::Global
        || made.len() == components.len() && made.iter().zip(components).all(|(a, b)| alike(&a.ty, &b.ty))
}

/// The same type, except for names.
pub(crate) fn alike(a: &DataType, b: &DataType) -> bool {
    match (a, b) {
        (DataType::Struct(_), DataType::Struct(b)) if is_unknown(b) => true,
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

/// The one component of a structure in the place of a UDT that is not there.
const UNKNOWN: &str = "UDT_UNKNOWN";

fn is_unknown(fields: &[Field]) -> bool {
    matches!(fields, [field] if field.name == UNKNOWN)
}

/// A source with a stand-in for each UDT that is not there, for the names of its other declarations.
pub(crate) fn with_unknown_types(source: &str, is_there: &dyn Fn(u16) -> bool) -> String {
    let mut out = String::with_capacity(source.len());
    let mut rest = source;
    while let Some((before, after)) = rest.split_once("UDT") {
        out.push_str(before);
        let number = after.trim_start_matches(' ');
        let behind = number.trim_start_matches(|c: char| c.is_ascii_digit());
        let digits = number.strip_suffix(behind).unwrap_or_default();
        let begins = !before.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        match digits.parse().ok().filter(|number| begins && !is_there(*number)) {
            Some(_) => {
                let _ = write!(out, "STRUCT {UNKNOWN} : BYTE ; END_STRUCT");
                rest = behind;
            }
            None => {
                out.push_str("UDT");
                rest = after;
            }
        }
    }
    out.push_str(rest);
    out
}

/// Declarations made of the compiled interface, with the names of `text` as far as types agree in order.
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

/// The structure of a data block made of its compiled interface, with the names of `text` as far as types agree in
/// order.
pub(crate) fn structure(compiled: &CompiledInterface, text: &[Component], known: &dyn Fn(BlockId) -> bool) -> String {
    let unframed = unframed(compiled, text);
    let compiled = unframed.as_ref().unwrap_or(compiled);
    let made = compiled.interface(false).params;
    let agreed = text.iter().zip(&made).take_while(|(theirs, made)| alike(&made.ty, &theirs.ty));
    let field = |theirs: &Component| Field { name: theirs.path.clone(), ty: theirs.ty.clone(), initial: None };
    let named = DataType::Struct(agreed.map(|(theirs, _)| field(theirs)).collect());
    let mut out = String::new();
    write_type(&mut out, &EntryType::Struct(compiled.entries.clone()), Some(&named), known, 0);
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
                Some(DataType::Struct(fields)) if !is_unknown(fields) => {
                    fields.iter().filter(|f| !is_break(&f.ty)).collect()
                }
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

#[cfg(test)]
mod tests {
    use ob1_mc7::InterfaceKind;
    use ob1_model::BitAddr;

    use super::*;

    #[test]
    fn a_missing_type_has_a_stand_in() {
        let text = "a : UDT 1;\n UDT2 : INT ;\n b : ARRAY [0 .. 3 ] OF UDT 22;\n c : UDT 3 ;";
        let stand_in = "STRUCT UDT_UNKNOWN : BYTE ; END_STRUCT";
        let wanted = text.replace("UDT 1", stand_in).replace("UDT 22", stand_in);
        assert_eq!(with_unknown_types(text, &|number| matches!(number, 2 | 3)), wanted);
    }

    #[test]
    fn a_structure_has_the_names_of_the_text_as_far_as_it_agrees() {
        let entry = |ty| Entry { ty, attribute: 4, extra: 0 };
        let simple = |ty| entry(EntryType::Simple(ty));
        let inner = entry(EntryType::Struct(vec![simple(DataType::Int), simple(DataType::Bool)]));
        let entries = vec![simple(DataType::Int), inner, simple(DataType::Real), simple(DataType::Int)];
        let (start, rest) = (Vec::new(), vec![0]);
        let compiled = CompiledInterface { kind: InterfaceKind::Global, number: 1, entries, start, rest };
        let component = |path: &str, ty| Component { path: path.into(), ty, at: BitAddr(0) };
        let unknown = Field { name: UNKNOWN.into(), ty: DataType::Byte, initial: None };
        let text = [
            component("first", DataType::Int),
            component("data", DataType::Struct(vec![unknown])),
            component("level", DataType::Real),
            component("now_long", DataType::DInt),
        ];
        let made = structure(&compiled, &text, &|_| false);
        // As SCL compiles it: within one more structure.
        let frame = vec![entry(EntryType::Struct(compiled.entries.clone()))];
        let framed = CompiledInterface { entries: frame, ..compiled.clone() };
        assert_eq!(structure(&framed, &text, &|_| false), made);
        assert!(agree_data(&framed, &compiled.components()) && !agree_data(&framed, &text));
        let words: Vec<&str> = made.split_whitespace().collect();
        let wanted = "STRUCT first : INT ; data : STRUCT C0 : INT ; C1 : BOOL ; END_STRUCT ; level : REAL ; C3 : INT ; \
                      END_STRUCT ;";
        assert_eq!(words.join(" "), wanted);
    }
}
