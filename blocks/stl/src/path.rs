//! Paths into composed types: `.name` and `[i, j]`.

use std::cell::RefCell;
use std::collections::BTreeMap;

use ob1_model::{BitAddr, DataType, Field, Layout};

use crate::codes;
use crate::operand::with_article;
use crate::parser::unquote;
use crate::reader::Reader;
use crate::token::Kind;

/// Names in capitals, to the index of the component and its place.
type Places = BTreeMap<String, (usize, BitAddr)>;

/// The components of structures by name, each structure indexed when first used. Valid as long as the types it has
/// seen are neither changed nor dropped: structures are told apart by their address.
#[derive(Debug, Default)]
pub(crate) struct FieldIndex {
    known: RefCell<BTreeMap<*const Field, Places>>,
}

impl FieldIndex {
    fn find<'t>(&self, fields: &'t [Field], name: &str) -> Option<(&'t DataType, BitAddr)> {
        let mut known = self.known.borrow_mut();
        let index = known.entry(fields.as_ptr()).or_insert_with(|| index(fields));
        let (at, address) = index.get(&name.to_uppercase())?;
        fields.get(*at).map(|f| (&f.ty, *address))
    }
}

fn index(fields: &[Field]) -> Places {
    let mut layout = Layout::new();
    fields.iter().enumerate().map(|(i, f)| (f.name.to_uppercase(), (i, layout.place(&f.ty)))).collect()
}

/// Reads `.name` and `[i]` as far as they go, from `ty` at `base`. `None` when a step leads nowhere (reported).
pub(crate) fn follow<'t>(
    reader: &mut Reader<'_, '_>,
    fields: &FieldIndex,
    mut ty: &'t DataType,
    mut base: BitAddr,
) -> Option<(&'t DataType, BitAddr)> {
    loop {
        match reader.peek_kind() {
            Some(Kind::Dot) => {
                reader.next();
                let (inner, at) = component(reader, fields, ty)?;
                (ty, base) = (inner, BitAddr(base.0 + at.0));
            }
            Some(Kind::LeftBracket) => {
                let (inner, at) = element(reader, ty)?;
                (ty, base) = (inner, BitAddr(base.0 + at.0));
            }
            _ => return Some((ty, base)),
        }
    }
}

fn component<'t>(
    reader: &mut Reader<'_, '_>,
    fields: &FieldIndex,
    ty: &'t DataType,
) -> Option<(&'t DataType, BitAddr)> {
    let span = reader.here();
    let name = match reader.peek_kind() {
        Some(Kind::Word | Kind::Symbol) => reader.next().map(|t| unquote(reader.text(t))),
        _ => None,
    };
    let Some(name) = name else {
        reader.report(span, &codes::COMPONENT, "the name of a component is missing after the point");
        return None;
    };
    let DataType::Struct(inner) = ty else {
        reader.report(span, &codes::COMPONENT, format!("{} has no component {name}", with_article(ty.name())));
        return None;
    };
    let found = fields.find(inner, name);
    if found.is_none() {
        let known = inner.iter().map(|f| f.name.as_str());
        let message = format!("the structure has no component {name}");
        reader.sink.report_unknown(reader.index, span, &codes::COMPONENT, message, name, known);
    }
    found
}

/// What a STRING is made of.
static CHARACTER: DataType = DataType::Char;

/// `[1, -2]` on an array; `[3]` on a STRING.
fn element<'t>(reader: &mut Reader<'_, '_>, ty: &'t DataType) -> Option<(&'t DataType, BitAddr)> {
    let span = reader.here();
    reader.next();
    let mut indices = Vec::new();
    loop {
        let negative = reader.eat(Kind::Operator).is_some_and(|t| reader.text(t) == "-");
        let number = reader.eat(Kind::Number).and_then(|t| reader.text(t).parse::<i32>().ok());
        // More indices than an array can have are counted, not kept.
        match number {
            Some(n) if indices.len() < 8 => indices.push(if negative { -n } else { n }),
            Some(_) => {}
            None => {
                reader.report(span, &codes::ARRAY_INDEX, "the index of an array element is a number");
                return None;
            }
        }
        if reader.eat(Kind::Comma).is_none() {
            break;
        }
    }
    if reader.eat(Kind::RightBracket).is_none() {
        reader.report(span, &codes::ARRAY_INDEX, "the index is not closed with ]");
        return None;
    }
    // A character of a STRING lies behind the two bytes of its lengths.
    if let (DataType::String(max), [index]) = (ty, indices.as_slice()) {
        let at = u32::try_from(*index).ok().filter(|i| (1..=u32::from(*max)).contains(i));
        if at.is_none() {
            let message = format!("the index lies outside the STRING, which has {max} characters from 1");
            reader.report(span, &codes::ARRAY_INDEX, message);
        }
        return at.map(|i| (&CHARACTER, BitAddr::byte_addr(i + 1)));
    }
    let DataType::Array(dims, inner) = ty else {
        reader.report(span, &codes::ARRAY_INDEX, format!("{} has no elements", with_article(ty.name())));
        return None;
    };
    let at = Layout::element(dims, inner, &indices);
    if at.is_none() {
        let bounds: Vec<_> = dims.iter().map(|d| format!("{}..{}", d.low, d.high)).collect();
        let message = format!("the index lies outside the array's bounds [{}]", bounds.join(", "));
        reader.report(span, &codes::ARRAY_INDEX, message);
    }
    at.map(|at| (&**inner, at))
}
