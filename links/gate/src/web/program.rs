//! The program: its blocks, their statements, declarations of data blocks, and cross references.

use hyper::StatusCode;
use ob1_access::{Allowed, Cell, Names};
use ob1_ir::{CodeBlock, DataBlock, DataKind, Program};
use ob1_model::{BitAddr, DataType};
use ob1_stl::{Match, Reference, Unknown, in_set};
use serde_json::{Value, json};

use super::api::{send, trouble};
use super::insight::Insight;
use super::{Page, ladder};
use crate::http::{Reply, plain, query};

/// Maximum of references shown at a time.
const REFERENCES: usize = 500;

/// A link that is limited to some cells does not show statements: they tell of all others.
pub(super) fn hidden() -> Reply {
    plain(StatusCode::FORBIDDEN, "this link does not show the program: see its keys `areas`, `blocks` and `program`")
}

/// All blocks, and the symbols; where the program is hidden, the data blocks and symbols that may be read.
pub(super) async fn overview(page: &Page) -> Reply {
    match page.insight.get(&page.station).await {
        Ok(insight) => send(&listed(insight.all.program(), &insight.names, &page.allowed)),
        Err(why) => trouble(&why),
    }
}

fn listed(program: &Program, names: &Names, allowed: &Allowed) -> Value {
    let is_shown = allowed.has_program();
    let code = |block: &CodeBlock| {
        json!({
            "id": block.id.to_string(), "name": block.name, "statements": block.code.len(),
            "source": program.sources.get(block.source as usize),
        })
    };
    let data = |block: &DataBlock| {
        let of = match block.kind {
            DataKind::Global => None,
            DataKind::Instance(fb) => Some(fb.to_string()),
        };
        json!({ "id": format!("DB {}", block.number), "name": block.name, "bytes": block.bytes.len(), "of": of })
    };
    let mut blocks: Vec<&CodeBlock> = program.blocks.iter().filter(|_| is_shown).collect();
    blocks.sort_by_key(|block| block.id);
    let has = |name: &str| names.parse(name).is_ok_and(|item| allowed.has(item.cell));
    let symbols = program.symbols.iter().filter(|symbol| is_shown || has(&symbol.name));
    let seen = program.data.iter().filter(|block| is_seen(block, allowed));
    json!({
        "blocks": blocks.into_iter().map(code).collect::<Vec<_>>(),
        "data": seen.map(data).collect::<Vec<_>>(),
        "symbols": symbols.map(|s| json!([s.name, s.address, s.comment])).collect::<Vec<_>>(),
    })
}

/// Whether the declarations of a data block are shown: with the program, or if its values may be read.
fn is_seen(block: &DataBlock, allowed: &Allowed) -> bool {
    allowed.has_program() || allowed.has(Cell::Db(block.number, 0))
}

/// `?id=FC 1`: its lines and networks; `?id=DB 10`: its declarations.
pub(super) async fn block(page: &Page, asked: &str) -> Reply {
    let allowed = &page.allowed;
    let insight = match page.insight.get(&page.station).await {
        Ok(insight) => insight,
        Err(why) => return trouble(&why),
    };
    let id = query(asked, "id").unwrap_or_default();
    let program = insight.all.program();
    let number = id.strip_prefix("DB ").and_then(|number| number.parse().ok());
    if number.is_none() && !allowed.has_program() {
        return hidden();
    }
    if let Some(block) = insight.block(&id) {
        let text = insight.text(block.id);
        let instances = program.data.iter().filter(|data| data.kind == DataKind::Instance(block.id));
        return send(&json!({
            "id": id, "name": block.name, "source": text.map(|text| &text.file), "lines": text.map(|text| &text.lines),
            "networks": ladder::heads(&insight.networks(block)),
            "instances": instances.map(|data| data.number).collect::<Vec<_>>(),
        }));
    }
    match number.and_then(|number: u16| program.data.iter().find(|block| block.number == number)) {
        Some(block) if !is_seen(block, allowed) => hidden(),
        Some(block) => {
            let rows: Vec<Value> =
                block.components.iter().flat_map(|c| rows(block.number, &c.path, c.at, &c.ty)).collect();
            send(&json!({ "id": id, "name": block.name, "components": rows }))
        }
        None => plain(StatusCode::NOT_FOUND, "there is no such block"),
    }
}

/// A declaration, and the members of a structure below it.
fn rows(db: u16, path: &str, at: BitAddr, ty: &DataType) -> Vec<Value> {
    let mut all = vec![json!([path, ty.name(), at.to_string(), format!("DB{db}.{path}")])];
    if let DataType::Struct(fields) = ty {
        let mut layout = ob1_model::Layout::new();
        for field in fields {
            let place = layout.place(&field.ty);
            all.extend(rows(db, &format!("{path}.{}", field.name), BitAddr(at.0 + place.0), &field.ty));
        }
    }
    all
}

/// `?operand=MW 10`: what reaches an operand in either set of mnemonics, a symbol, a component, a block or a part.
pub(super) async fn xref(page: &Page, asked: &str) -> Reply {
    if !page.allowed.has_program() {
        return hidden();
    }
    let insight = match page.insight.get(&page.station).await {
        Ok(insight) => insight,
        Err(why) => return trouble(&why),
    };
    let wanted = query(asked, "operand").unwrap_or_default();
    // In a large program it takes a while.
    match tokio::task::spawn_blocking(move || references(&insight, &wanted)).await {
        Ok(Ok(found)) => send(&found),
        Ok(Err(unknown)) => plain(StatusCode::NOT_FOUND, format!("{unknown}. {}", unknown.remedy)),
        Err(error) => plain(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

fn references(insight: &Insight, wanted: &str) -> Result<Value, Unknown> {
    let (uses, set) = (insight.all.find(wanted)?, insight.set);
    let symbol = |symbol: &Option<String>| symbol.as_ref().map(|s| format!(" \"{s}\"")).unwrap_or_default();
    // Those that are certain first: of the others there may be many.
    let mut found = uses.found;
    found.sort_by_key(|(how, _)| *how == Match::Possible);
    let row = |(how, reference): &(Match, &Reference)| {
        let name = format!("{}{}", reference.operand_in(set), symbol(&reference.symbol));
        let (network, line) = (reference.network, reference.line);
        let possible = *how == Match::Possible;
        json!([name, reference.block.to_string(), network, line, reference.access.name(), reference.via, possible])
    };
    let rows: Vec<Value> = found.iter().take(REFERENCES).map(row).collect();
    let operand = format!("{}{}", in_set(&uses.operand, set), symbol(&uses.symbol));
    Ok(json!({ "operand": operand, "more": found.len() > REFERENCES, "uses": rows }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_limited_to_a_block_does_not_list_the_program() {
        let text = "symbol \"start\" \"E 0.0\" BOOL\nsymbol \"level\" \"DB7.DBW 0\" INT\ndata DB 7 \"TANK\" of FB 3\n  at \
                    \"level\" @0.0 INT\n  bytes 00FF\ndata DB 20 \"RECIPE\" of FB 3\n  at \"acid\" @0.0 INT\n  bytes 00FF\n";
        let program = ob1_ir::parse(text).expect("a program");
        let names = Names::new(&program);
        let all = Allowed::default();
        let few = Allowed::of(Some(&["DB".to_owned()]), Some(&["DB7".to_owned()])).expect("right");
        let count =
            |allowed: &Allowed, key: &str| listed(&program, &names, allowed)[key].as_array().map_or(0, Vec::len);
        assert_eq!((count(&all, "data"), count(&all, "symbols")), (2, 2));
        assert_eq!((count(&few, "data"), count(&few, "symbols")), (1, 1), "{}", listed(&program, &names, &few));
        assert_eq!(count(&few.with_program(Some(true)), "data"), 2);
    }
}
