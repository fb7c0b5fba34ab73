//! What the text of a source says besides its statements: titles and comments of networks, labels, how constants are
//! written; and what the table of symbols says.

use std::collections::BTreeMap;

use ob1_ir::{CodeBlock, Notation, Op, Operand, Place, Program};
use ob1_model::{Layout, Width};
use ob1_stl::print::Listing;
use ob1_stl::{Mnemonics, address_in_set};

/// The listing of a block by the lines of its source, from the first one on.
pub fn listing(block: &CodeBlock, lines: &[&str]) -> Listing {
    let line = |number: u32| lines.get((number as usize).wrapping_sub(1)).copied().unwrap_or_default();
    let mut listing = Listing::default();
    for (at, stmt) in (0u32..).zip(&block.code) {
        if matches!(stmt.op, Op::LoadConst(_))
            && let Some(notation) = notation(code(line(stmt.line)))
        {
            listing.notations.insert(at, notation);
        }
    }
    let targets = block.code.iter().filter_map(|stmt| match &stmt.op {
        Op::Jump(_, to) | Op::Loop(to) => Some(*to),
        _ => None,
    });
    for to in targets {
        let Some(stmt) = block.code.get(to as usize) else { continue };
        let label = code(line(stmt.line)).split_once(':').map(|(label, _)| label.trim());
        if let Some(label) = label.filter(|label| !label.is_empty() && !label.contains([' ', '=', '#', '"'])) {
            listing.labels.insert(to, label.to_owned());
        }
    }
    listing.networks = networks(block, lines);
    listing
}

/// Names of components that are shown at most, and bits of a declaration whose components are.
const COMPONENTS: usize = 50_000;
const DECLARATION: u32 = 64 * 1024;

/// Names by addresses in a set of mnemonics: the symbols, of whichever set their table is, and the components of the
/// data blocks (`DB12.DBX 0.1`: `"Alarms".pump`). Those of very long declarations are left out.
pub fn symbols(program: &Program, mnemonics: Mnemonics) -> BTreeMap<String, String> {
    let symbols = program.symbols.iter();
    let mut all: BTreeMap<String, String> =
        symbols.filter_map(|one| Some((address_in_set(&one.address, mnemonics)?, one.name.clone()))).collect();
    for block in &program.data {
        let named = all.get(&format!("DB {}", block.number)).or(block.name.as_ref());
        let own = named.map_or_else(|| format!("DB{}", block.number), |name| format!("\"{name}\""));
        let mut leaves = Vec::new();
        for declared in block.components.iter().filter(|declared| Layout::bits(&declared.ty) <= DECLARATION) {
            if all.len() + leaves.len() < COMPONENTS {
                Layout::components(&declared.path, &declared.ty, declared.at, &mut leaves);
            }
        }
        for leaf in leaves {
            let Some(width) = Width::of(&leaf.ty) else { continue };
            let operand = Operand { width, place: Place::InDb(block.number, leaf.at) };
            all.insert(operand.to_string(), format!("{own}.{}", leaf.path));
        }
    }
    all
}

/// A line without its comment.
fn code(line: &str) -> &str {
    line.split_once("//").map_or(line, |(code, _)| code)
}

/// Title and comment of each network: what stands between `NETWORK` and its first statement.
fn networks(block: &CodeBlock, lines: &[&str]) -> Vec<(String, String)> {
    let last = block.code.last().map_or(0, |stmt| stmt.network);
    let of = |number: u16| {
        let first = block.code.iter().find(|stmt| stmt.network == number)?.line as usize;
        let before = lines.get(..first.saturating_sub(1))?;
        let head = before.iter().rposition(|line| line.trim_start().to_ascii_uppercase().starts_with("NETWORK"))?;
        let (mut title, mut comment) = (String::new(), Vec::new());
        for line in before.get(head + 1..)? {
            let line = line.trim();
            match (line.strip_prefix("//"), line.split_once('=')) {
                (Some(text), _) => comment.push(text.trim_end()),
                (None, Some((word, text))) if word.trim().eq_ignore_ascii_case("TITLE") => {
                    title = text.trim().trim_matches('\'').to_owned();
                }
                _ => {}
            }
        }
        Some((title, comment.join("\n")))
    };
    (1..=last).map(|number| of(number).unwrap_or_default()).collect()
}

/// How the constant of this line is written.
fn notation(line: &str) -> Option<Notation> {
    let statement = line.rsplit_once(": ").map_or(line, |(_, statement)| statement);
    let constant = statement.trim().split_once(char::is_whitespace)?.1.trim().trim_end_matches(';').trim();
    if constant.starts_with('\'') {
        return Some(Notation::Text);
    }
    let upper = constant.to_ascii_uppercase();
    let prefixes = [
        ("S5T", Notation::S5Time),
        ("T#", Notation::Time),
        ("TIME#", Notation::Time),
        ("C#", Notation::Count),
        ("L#", Notation::DInt),
        ("DW#16#", Notation::DWord),
        ("DWORD#16#", Notation::DWord),
        ("W#16#", Notation::Word),
        ("WORD#16#", Notation::Word),
        ("B#16#", Notation::Byte),
        ("BYTE#16#", Notation::Byte),
        ("B#(", Notation::Bytes),
        ("2#", Notation::Binary),
        ("D#", Notation::Date),
        ("DATE#", Notation::Date),
        ("TOD#", Notation::TimeOfDay),
        ("P#", Notation::Pointer),
    ];
    let found = prefixes.into_iter().find(|(prefix, _)| upper.starts_with(prefix)).map(|(_, notation)| notation);
    found.or_else(|| match (constant.parse::<i32>(), constant.parse::<f32>()) {
        (Ok(_), _) => Some(Notation::Int),
        (_, Ok(_)) => Some(Notation::Real),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_stl::{Library, Options, Source, compile};

    #[test]
    fn a_source_says_more_than_its_statements() {
        let text = "FUNCTION FC 1 : VOID\nBEGIN\nNETWORK\nTITLE = Pump on\n// when there is water\nU E 0.0;\nL S5T#5S;\nSE T 1;\n\
                    U E 0.1;\nSPB next;\nNETWORK\nTITLE = the rest\nnext: NOP 0;\nL 1.5;\nT MD 4; // L 7\nEND_FUNCTION\n";
        let output = compile(&[Source::new("a", text)], &Library::new(), &Options::default());
        assert!(output.is_good(), "{:?}", output.diagnostics);
        let listing = listing(&output.program.blocks[0], &text.lines().collect::<Vec<_>>());
        let titles: Vec<(&str, &str)> = listing.networks.iter().map(|(t, c)| (t.as_str(), c.as_str())).collect();
        assert_eq!(titles, [("Pump on", " when there is water"), ("the rest", "")]);
        assert_eq!(listing.labels.values().collect::<Vec<_>>(), ["next"]);
        assert_eq!(listing.notations.values().collect::<Vec<_>>(), [&Notation::S5Time, &Notation::Real]);
    }

    #[test]
    fn components_of_data_blocks_have_names_as_symbols_have() {
        let text = "DATA_BLOCK DB 12\nSTRUCT\nready : BOOL;\nlamps : ARRAY [1..3] OF BOOL;\nspeed : INT;\npart : STRUCT\nlong : REAL;\nEND_STRUCT;\n\
                    END_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";
        let table = "\"Alarms\",\"DB     12\",\"DB     12\",\"\"\n\"run\",\"E       0.1\",\"BOOL\",\"\"\n";
        let sources = [Source::new("a.awl", text), Source::new("a.sdf", table)];
        let options = Options { symbols: ob1_stl::read_symbols(&sources[1]).symbols, ..Options::default() };
        let program = compile(&sources[..1], &Library::new(), &options).program;
        let names = symbols(&program, Mnemonics::International);
        for (address, name) in [
            ("I 0.1", "run"),
            ("DB12.DBX 0.0", "\"Alarms\".ready"),
            ("DB12.DBX 2.2", "\"Alarms\".lamps[3]"),
            ("DB12.DBW 4", "\"Alarms\".speed"),
            ("DB12.DBD 6", "\"Alarms\".part.long"),
        ] {
            assert_eq!(names.get(address).map(String::as_str), Some(name), "{address}: {names:?}");
        }
    }
}
