//! Files that are not STL, recognised as what they are, so that one message is enough.

use ob1_model::Section;

use crate::words::Words;

/// What a file is instead of STL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Other {
    /// Structured control language; its declarations are those of STL.
    Scl,
    /// A sequencer of S7-GRAPH.
    Graph,
    /// STL of an S7-200.
    S7200,
    /// An export of TIA Portal's openness, or other XML.
    Xml,
    /// A tag table of TIA Portal as XML.
    TagTable,
    /// A table of Excel, as TIA Portal exports its tag tables, or an archive.
    Packed,
    /// A template that a program fills in.
    Template,
    /// No text at all.
    Binary,
}

impl Other {
    /// What it is, and what to do.
    pub(crate) const fn says(self) -> (&'static str, &'static str) {
        match self {
            Other::Scl => (
                "this is SCL; its declarations are known, its statements are not compiled",
                "Generate the block from it in STEP 7 and export that as STL, or write it in STL.",
            ),
            Other::Graph => ("this is S7-GRAPH", "Write the sequencer in STL."),
            Other::S7200 => (
                "this is STL of an S7-200, which has other statements and areas than that of an S7-300",
                "Convert it into a program for an S7-300.",
            ),
            Other::Xml => (
                "this is XML, not a source",
                "Export the block from TIA Portal as a source: \"Generate source from blocks\".",
            ),
            Other::TagTable => ("this is a tag table as XML", EXPORT_TAGS),
            Other::Packed => ("this is a table of Excel or an archive, not a text file", EXPORT_TAGS),
            Other::Template => {
                ("this is a template with places to be filled in, not a source", "Load what is generated from it.")
            }
            Other::Binary => ("this is not a text file", "Load the source the file was made from."),
        }
    }
}

/// What to do with tag tables in forms that are not read.
pub const EXPORT_TAGS: &str = "Export the tag table from TIA Portal as .sdf; unpack an archive.";

/// Whether this is the number of a diagnostic about a symbol that no table has.
pub fn names_no_symbol(code: &str) -> bool {
    code == crate::messages::UNKNOWN_SYMBOL.number
}

/// What a `.zip` begins with, and so a `.xlsx`.
const ZIP: &str = "PK\u{3}\u{4}";

/// Lines of statements after which a file of one language is taken for that.
const ENOUGH: usize = 60;

/// Words that begin a line of SCL and never one of STL.
const SCL_WORDS: [&str; 14] = [
    "IF",
    "ELSIF",
    "END_IF",
    "CASE",
    "END_CASE",
    "FOR",
    "END_FOR",
    "WHILE",
    "END_WHILE",
    "REPEAT",
    "UNTIL",
    "END_REPEAT",
    "REGION",
    "END_REGION",
];

const GRAPH_WORDS: [&str; 5] = ["INITIAL_STEP", "END_STEP", "END_TRANSITION", "END_STEPS", "END_TRANSITIONS"];

const S7200_WORDS: [&str; 12] = ["LD", "LDN", "LPS", "LPP", "LRD", "ALD", "OLD", "MOVB", "MOVW", "MOVD", "SBR", "LDI"];

/// What a source is by its name and text; `None` for STL, and for what nothing is known of.
pub(crate) fn other(name: &str, text: &str, words: [&Words; 2]) -> Option<Other> {
    let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension);
    if extension.eq_ignore_ascii_case("scl") {
        return Some(Other::Scl);
    }
    if text.starts_with(ZIP) {
        return Some(Other::Packed);
    }
    if text.get(..text.len().min(4096)).unwrap_or(text).contains('\0') {
        return Some(Other::Binary);
    }
    let start = text.trim_start();
    if start.starts_with('<') && text.lines().take(4).any(|line| line.trim_start().starts_with("<Tagtable")) {
        return Some(Other::TagTable);
    }
    if start.starts_with("<?xml") || start.starts_with("<!DOCTYPE") || start.starts_with("<Document") {
        return Some(Other::Xml);
    }
    if is_template(text) {
        return Some(Other::Template);
    }
    let signs = Signs::of(text, words);
    if signs.graph > 0 {
        return Some(Other::Graph);
    }
    if signs.s7200_frame || signs.s7200 > 2 && signs.s7200 * 4 > signs.stl {
        return Some(Other::S7200);
    }
    (signs.scl > signs.stl).then_some(Other::Scl)
}

/// True for a text with `{{`, `{%` or `<%`, comments, titles and texts in quotes left out. Single signs are searched at
/// first, which is many times faster than pairs.
fn is_template(text: &str) -> bool {
    let next = |at: usize| text.as_bytes().get(at + 1).copied();
    let signs = text.match_indices('{').any(|(at, _)| matches!(next(at), Some(b'{' | b'%')))
        || text.match_indices('<').any(|(at, _)| next(at) == Some(b'%'));
    signs
        && text.lines().any(|line| {
            let line = line.split("//").next().unwrap_or("").trim_start();
            let title = line.get(..5).is_some_and(|word| word.eq_ignore_ascii_case("TITLE"));
            let signs = |text: &str| ["{{", "{%", "<%"].iter().any(|sign| text.contains(sign));
            // `$'` is a quote within a text.
            !title && signs(line) && line.replace("$$", "").replace("$'", "").split('\'').step_by(2).any(signs)
        })
}

/// Lines by the language that their first word shows.
#[derive(Default)]
struct Signs {
    stl: usize,
    scl: usize,
    graph: usize,
    s7200: usize,
    s7200_frame: bool,
}

impl Signs {
    fn of(text: &str, words: [&Words; 2]) -> Self {
        let mut signs = Self::default();
        // In the statements of a code block; within the parameters of a call, which may begin anywhere in a line.
        let (mut block, mut code, mut call) = (false, false, false);
        let mut brackets = 0usize;
        let mut comment = false;
        for line in text.lines() {
            if signs.stl > ENOUGH && signs.scl + signs.graph + signs.s7200 == 0 {
                break;
            }
            let line = line.trim();
            if comment || line.starts_with("(*") {
                comment = !line.contains("*)");
                continue;
            }
            let end = line.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(line.len());
            let (word, rest) = line.split_at(end);
            let is = |words: &[&str]| words.iter().any(|w| w.eq_ignore_ascii_case(word));
            if word.len() > 9 && is(&["SUBROUTINE_BLOCK", "INTERRUPT_BLOCK"]) {
                signs.s7200_frame = true;
            } else if word.len() > 7 && is(&["ORGANIZATION_BLOCK", "FUNCTION_BLOCK", "FUNCTION"]) {
                // A symbol in quotes may have any signs.
                signs.s7200_frame |= !rest.contains('"') && rest.split("//").next().unwrap_or("").contains(":OB");
                (block, code) = (true, true);
                brackets = 0;
            } else if is(&["DATA_BLOCK", "TYPE", "END_DATA_BLOCK", "END_TYPE"]) {
                (block, code) = (false, false);
            } else if Section::opened_by(word).is_some() {
                code = false;
            } else if is(&["END_VAR", "BEGIN"]) {
                code = block;
            } else if is(&["NETWORK"]) {
                signs.stl += 4;
                code = true;
            } else if code && !line.is_empty() && !line.starts_with("//") && !is_attribute(word, line) {
                signs.line(word, line, call || brackets > 0, words);
                let body = line.split("//").next().unwrap_or("").trim_end();
                let count = |bracket: char| body.matches(bracket).count();
                brackets = (brackets + count('(')).saturating_sub(count(')'));
                call = (call || is(&["CALL"]) || rest.trim_start_matches([':', ' ', '\t']).starts_with("CALL"))
                    && !body.ends_with(';');
            }
        }
        signs
    }

    fn line(&mut self, word: &str, line: &str, call: bool, words: [&Words; 2]) {
        // `LD := x` names a parameter or a variable, `LD: ` is a label, whatever the word means elsewhere.
        let rest = line.get(word.len()..).unwrap_or("").trim_start();
        let named = rest.starts_with(':');
        let call = call || named && rest.trim_start_matches([':', ' ', '\t']).starts_with("CALL");
        let is = |words: &[&str]| !named && words.iter().any(|w| w.eq_ignore_ascii_case(word));
        if is(&GRAPH_WORDS) {
            self.graph += 1;
        } else if is(&SCL_WORDS) {
            self.scl += 1;
        } else if is(&S7200_WORDS) {
            self.s7200 += 1;
        } else if line.starts_with('=') || !named && words.iter().any(|set| set.mnemonic(word).is_some()) {
            self.stl += 1;
        } else if !call && line.contains(":=") && line.contains(';') {
            self.scl += 1;
        }
    }
}

/// True for a line that begins with attributes, or goes on with those of a block.
fn is_attribute(word: &str, line: &str) -> bool {
    line.starts_with('{') || word.starts_with("S7_")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mnemonics::Mnemonics;

    #[test]
    fn languages_are_told_apart() {
        let stl = "FUNCTION FC 1 : VOID\nBEGIN\nNETWORK\nCALL FC 2 (\n a := 1,\n b := #x);\nL 1;\nEND_FUNCTION\n";
        let scl = "FUNCTION FC 1 : VOID\nVAR_INPUT\n x : INT := 5;\nEND_VAR\n  #y := #x + 1;\n  IF #y > 1 THEN\n  END_IF;\nEND_FUNCTION\n";
        let data = "DATA_BLOCK DB 1\nSTRUCT\n x : INT;\nEND_STRUCT;\nBEGIN\n x := 5;\nEND_DATA_BLOCK\n";
        let words = [Mnemonics::German, Mnemonics::International].map(Words::new);
        let words = [&words[0], &words[1]];
        let s7200 = "ORGANIZATION_BLOCK MAIN:OB1\nTITLE=x\nBEGIN\nNetwork 1\nLD SM0.0\nEND_ORGANIZATION_BLOCK\n";
        let graph = "FUNCTION_BLOCK FB 1\nSTEPS\nINITIAL_STEP Init (*1*)\nEND_STEP\nEND_FUNCTION_BLOCK\n";
        let behind = "ORGANIZATION_BLOCK OB 1 BEGIN\nSET; CALL SFC 1 (a := 1,\n b := 2,\n c := 3);CALL SFC 1 (a := 1,\n b := 2);\n";
        let calls = "CALL FB 1, DB 1\n LD :=E0.0\n INITIAL_STEP :=M0.0\n".repeat(9);
        let counters = format!("ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n{calls}END_ORGANIZATION_BLOCK\n");
        let attributes = "FUNCTION_BLOCK FB 1\n{ S7_m_c := 'true'; S7_a := 'b' }\n{ S7_x := 'y';\n S7_z := 'a';\n S7_b := 'c' }\nBEGIN\nEND_FUNCTION_BLOCK\n";
        let comments = "FUNCTION FC 1 : VOID\nTITLE = {{ x\nBEGIN\n(* IF x\n y := 5;\n IF y\n*)\n//open <%MIN\nU E 0.0;\nEND_FUNCTION\n";
        let labels = "FUNCTION FC 1 : VOID\nBEGIN\nLD: SET;\nIF:SET\nLDN : SET;\nLPS: SET;\nm1: CALL FC 2 (a := 1);\nEND_FUNCTION\n";
        for (text, expected) in [
            (stl, None),
            (behind, None),
            (counters.as_str(), None),
            (attributes, None),
            (comments, None),
            ("FUNCTION \"Error:OB82\" : VOID\nBEGIN\nSET;\nEND_FUNCTION\n", None),
            (labels, None),
            (scl, Some(Other::Scl)),
            (data, None),
            (s7200, Some(Other::S7200)),
            (graph, Some(Other::Graph)),
            ("<?xml version=\"1.0\"?><Document/>", Some(Other::Xml)),
            ("<?xml version='1.0'?>\n<Tagtable name='Tags'>\n</Tagtable>", Some(Other::TagTable)),
            ("PK\u{3}\u{4}\u{14}\0", Some(Other::Packed)),
            ("FUNCTION FC {{ number }} : VOID\n", Some(Other::Template)),
            ("DATA_BLOCK DB 1\nSTRUCT\n s : STRING[9] := '{{$'<%';\nEND_STRUCT;\n", None),
            ("DATA_BLOCK DB 1\nSTRUCT\n s : STRING[{{ n }}] := 'a';\nEND_STRUCT;\n", Some(Other::Template)),
            ("PK\u{3}\0\0", Some(Other::Binary)),
        ] {
            assert_eq!(other("a.awl", text, words), expected, "{text}");
        }
        assert_eq!(other("a.SCL", stl, words), Some(Other::Scl));
    }
}
