//! Whatever the bytes: no panic, a program that passes the verifier, and work linear in the input.

#![allow(clippy::disallowed_methods, reason = "the corpus lies in files")]

mod common;

use ob1_stl::{Library, Mnemonics, Options, Output, Severity, Source, compile, render};
use proptest::prelude::*;

const SEEDS: [&[u8]; 9] = [
    include_bytes!("data/pointers.awl"),
    include_bytes!("data/lints_traps.awl"),
    include_bytes!("data/manual.awl"),
    include_bytes!("data/manual_mbus.awl"),
    include_bytes!("data/manual_enocean.awl"),
    include_bytes!("data/bench_calls.awl"),
    include_bytes!("data/declarations.awl"),
    include_bytes!("data/instructions.awl"),
    include_bytes!("data/errors_calls.awl"),
];

/// Pieces that decide what comes after them.
const WORDS: [&str; 40] = [
    "CALL",
    "(",
    ")",
    "[",
    "]",
    ":=",
    ";",
    ",",
    "\n",
    "\"",
    "'",
    "#",
    "P#",
    "P##",
    "B#(",
    "DB10.",
    "STRUCT",
    "END_STRUCT",
    "ARRAY [0..32767] OF",
    "ARRAY [1..9,1..9]",
    "UDT 1",
    "FB 1",
    "VAR_INPUT",
    "VAR",
    "END_VAR",
    "BEGIN",
    "NETWORK",
    "TITLE=",
    "FUNCTION FC 1 : VOID",
    "END_FUNCTION",
    "TYPE UDT 1",
    "FUNCTION_BLOCK FB 1",
    "DATA_BLOCK DB 1",
    "SPL a",
    "SPA a",
    "a:",
    "L",
    "U(",
    "[AR1,P#",
    "65535",
];

/// Compiles, and checks the result against what is promised.
fn check(bytes: &[u8]) -> Output {
    let source = Source::new("any.awl", bytes);
    // With all lints.
    let output = common::compile_one("lints_any.awl", bytes);
    let library = common::library();
    let verified = ob1_ir::verify(&output.program, &|id| library.get(id).map(|b| &b.interface));
    // What is left of a source with errors may lack brackets.
    let unsound = |f: &ob1_ir::Finding| {
        output.is_good() || !matches!(f.defect, ob1_ir::Defect::Brackets | ob1_ir::Defect::McrBrackets)
    };
    let findings: Vec<_> = verified.err().unwrap_or_default().into_iter().filter(unsound).collect();
    assert_eq!(findings, []);
    if bytes.len() < 10_000 {
        let references = ob1_stl::xref_with(&output.program, &library);
        assert!(references.is_sorted() && ob1_stl::xref(&output.program).is_sorted());
        let text = ob1_stl::render_xref(&references, &output.program, ob1_stl::Mnemonics::International);
        assert_eq!(references.is_empty(), text.is_empty());
        let all = ob1_stl::CrossReference::new(&output.program, &library);
        // Nothing of these panics; every use is found under its own name.
        let _ = (all.calls(), all.unused(), all.written_twice(), all.assignment().render(ob1_stl::Mnemonics::German));
        assert!(ob1_stl::listing(&output.program).starts_with("source 1: "));
    }
    for diagnostic in output.diagnostics.iter().take(20) {
        assert!(diagnostic.line >= 1 && diagnostic.column >= 1 && diagnostic.length >= 1);
        assert!(render(diagnostic, &source).contains(diagnostic.code));
    }
    output
}

/// Found by random words: the FB counts as SCL, so it has no code, and the instance was without its FB.
#[test]
fn an_instance_of_a_block_in_another_language_is_left_out_with_it() {
    let output = check(b"CALL\nFUNCTION FC 1 : VOID'\nFUNCTION_BLOCK FB 1CALLCALL\n;DATA_BLOCK DB 1FB 1:=");
    assert!(output.diagnostics.iter().any(|d| d.code == "S0111"), "{:?}", output.diagnostics);
    assert_eq!(output.program.data, []);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..2_000)) {
        check(&bytes);
    }

    #[test]
    fn random_words(words in proptest::collection::vec(0..WORDS.len(), 0..200), spaced in any::<bool>()) {
        let text: Vec<&str> = words.into_iter().filter_map(|w| WORDS.get(w).copied()).collect();
        check(text.join(if spaced { " " } else { "" }).as_bytes());
    }

    /// Pieces of real sources cut out, doubled, moved and overwritten.
    #[test]
    fn mutated_sources(
        seed in 0..SEEDS.len(),
        edits in proptest::collection::vec((any::<u32>(), any::<u32>(), 0u8..5, any::<u8>(), 0..WORDS.len()), 1..12),
    ) {
        let mut bytes = SEEDS[seed].to_vec();
        for (from, len, kind, byte, word) in edits {
            let from = from as usize % (bytes.len() + 1);
            let to = (from + len as usize % 60).min(bytes.len());
            match kind {
                0 => drop(bytes.drain(from..to)),
                1 => bytes[from..to].fill(byte),
                2 => {
                    let piece = bytes[from..to].to_vec();
                    bytes.splice(from..from, piece);
                }
                3 => drop(bytes.splice(from..to, WORDS[word].bytes())),
                _ => bytes.truncate(to),
            }
        }
        check(&bytes);
    }
}

/// Reads bytes as a symbol table under each name, and checks the result against what is promised.
fn check_table(bytes: &[u8]) {
    for name in ["a.sdf", "a.asc", "a.seq", "a.dif", "a"] {
        let table = ob1_stl::read_symbols(&Source::new(name, bytes));
        let lines = bytes.iter().filter(|b| **b == b'\n').count() as u32 + 1;
        assert!(table.diagnostics.iter().all(|d| (1..=lines).contains(&d.line) && d.column >= 1));
        let options = Options { symbols: table.symbols.clone(), ..Options::default() };
        let _ = compile(&[Source::new("a", *b"")], &Library::new(), &options);
    }
}

const TABLES: [&[u8]; 4] = [
    include_bytes!("symbols/project.sdf"),
    include_bytes!("symbols/project.asc"),
    include_bytes!("symbols/project.seq"),
    include_bytes!("symbols/project.dif"),
];

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_tables(bytes in proptest::collection::vec(prop_oneof![any::<u8>(), Just(b'"'), Just(b'\t'), Just(b'\n')], 0..600)) {
        check_table(&bytes);
    }

    #[test]
    fn mutated_tables(seed in 0..TABLES.len(), edits in proptest::collection::vec((any::<u32>(), any::<u8>(), 0u8..3), 1..10)) {
        let mut bytes = TABLES[seed].to_vec();
        for (at, byte, kind) in edits {
            let at = at as usize % (bytes.len() + 1);
            match kind {
                0 => bytes.insert(at, byte),
                1 => drop(bytes.drain(at..(at + usize::from(byte) / 8).min(bytes.len()))),
                _ => bytes.splice(at..at, *b"\r\n\"").for_each(drop),
            }
        }
        check_table(&bytes);
    }
}

#[test]
fn work_of_symbol_tables_grows_linearly() {
    type RowOf = fn(usize) -> String;
    let forms: [(&str, RowOf); 6] = [
        ("a.sdf", |i| format!("\"s{i}\",\"M {}.0\",\"BOOL\",\"x\"\n", i % 1000)),
        ("b.sdf", |i| format!("\"s\",\"M{i}\",\"BO\"\n")),
        ("a.asc", |i| format!("126,{:<24}{:<12}{:<10}\n", format!("s{i}"), "M 1.0", "BOOL")),
        ("a.seq", |i| format!("\tM 1.0\ts{i}\t\n")),
        ("a.dif", |i| format!("-1,0\nBOT\n1,0\n\"s{i}\"\n1,0\n\"M 1.0\"\n1,0\n\"BOOL\"\n1,0\n\"\"\n")),
        ("b.seq", |_| "\t".to_owned()),
    ];
    for (name, row) in forms {
        let header = if name.ends_with("dif") { "TABLE\nDATA\n0,0\n\"\"\n" } else { "" };
        let steps = |n: usize| {
            let text = header.to_owned() + &(0..n).map(row).collect::<String>();
            ob1_stl::read_symbols(&Source::new(name, text)).steps
        };
        let (small, large) = (steps(1_000), steps(4_000));
        assert!(large <= small * 4 + 16, "{name}: {small} steps become {large}");
    }
}

/// More names than numbers: said once, not for each of them and each call.
#[test]
fn names_without_a_number_are_one_error() {
    let mut text: String = (0..65_540).map(|i| format!("FUNCTION \"b{i}\" : VOID\nBEGIN\nEND_FUNCTION\n")).collect();
    text += "ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL \"b65530\";\nCALL \"b9\";\nEND_ORGANIZATION_BLOCK\n";
    let output = compile(&[Source::new("a", text.into_bytes())], &Library::new(), &Options::default());
    let errors: Vec<&str> = output.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(errors, ["S0319"], "{:?}", output.diagnostics.first());
    assert_eq!(output.numbers.len(), 65_535);
}

/// Every file of `tests/corpus`, as a source in each set of mnemonics and as a symbol table of each form: the fuzzer's
/// starting points, and what it has found.
#[test]
fn the_corpus_is_replayed() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 12);
    for file in files {
        let bytes = std::fs::read(&file).unwrap();
        check(&bytes);
        check_table(&bytes);
        for mnemonics in [Mnemonics::German, Mnemonics::International, Mnemonics::Auto] {
            let options = Options { mnemonics, symbols: common::symbols(), lints: true, ..Options::default() };
            let output = compile(&[Source::new("corpus", bytes.clone())], &common::library(), &options);
            assert_eq!(output.is_good(), output.diagnostics.iter().all(|d| d.severity != Severity::Error));
            assert!(output.steps <= 200 * bytes.len() as u64 + 1_000, "{}", file.display());
        }
    }
}

#[test]
fn deep_nesting_ends_in_diagnostics_not_in_the_stack() {
    let frame = |inner: &str| format!("FUNCTION_BLOCK FB 1\nVAR\n{inner}\nEND_VAR\nBEGIN\nEND_FUNCTION_BLOCK\n");
    let n = 20_000;
    for text in [
        frame(&"a : STRUCT ".repeat(n)),
        frame(&format!("a : {} INT;", "ARRAY [0..1] OF ".repeat(n))),
        format!("ORGANIZATION_BLOCK OB 1\nL MW {}", "[MD ".repeat(n)),
        format!("ORGANIZATION_BLOCK OB 1\nCALL FC 1 {}", "(x := ".repeat(n)),
        "[".repeat(n),
        // Each UDT and FB lies in the one before.
        (1..3_000).map(|i| format!("TYPE UDT {i}\nSTRUCT a : UDT {};\nEND_STRUCT;\nEND_TYPE\n", i + 1)).collect(),
        (1..3_000)
            .map(|i| format!("FUNCTION_BLOCK FB {i}\nVAR a : FB {};\nEND_VAR\nEND_FUNCTION_BLOCK\n", i + 1))
            .collect(),
    ] {
        let output = check(text.as_bytes());
        assert!(!output.is_good());
    }
}

#[test]
fn giant_arrays_are_refused_before_they_are_made() {
    let text = "DATA_BLOCK DB 1\nSTRUCT\n a : ARRAY [-32768..32767, -32768..32767, -32768..32767] OF BOOL;\n\
                b : ARRAY [0..32767] OF STRUCT c : ARRAY [0..32767] OF STRING; END_STRUCT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";
    let codes: Vec<_> = check(text.as_bytes()).diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(codes, ["S0207", "S0207"]);
}

#[test]
fn all_data_together_is_bounded() {
    let one = |i| format!("DATA_BLOCK DB {i} UDT 1 BEGIN END_DATA_BLOCK\n");
    let udt = "TYPE UDT 1\nSTRUCT a : ARRAY [0..32766] OF WORD;\nEND_STRUCT;\nEND_TYPE\n";
    let text: String = std::iter::once(udt.to_owned()).chain((1..1_100).map(one)).collect();
    let output = check(text.as_bytes());
    assert_eq!(output.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["S0213"]);
}

#[test]
fn too_many_parameters_are_refused() {
    let params: String = (0..513).map(|i| format!("p{i} : INT;\n")).collect();
    let text = format!("FUNCTION FC 70 : VOID\nVAR_INPUT\n{params}END_VAR\nBEGIN\nEND_FUNCTION\n");
    let output = check(text.as_bytes());
    assert_eq!(output.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["S0214"]);
}

#[test]
fn an_endless_source_is_refused() {
    let output = compile(&[Source::new("a", vec![b' '; (64 << 20) + 1])], &Library::new(), &Options::default());
    assert_eq!(output.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["S0003"]);
}

/// Sources of `n` parts, each form a way in which work could grow faster than the text.
fn forms(n: usize) -> Vec<(&'static str, String)> {
    let ob = |body: String| format!("ORGANIZATION_BLOCK OB 1\nBEGIN\n{body}END_ORGANIZATION_BLOCK\n");
    let numbered = |f: &dyn Fn(usize) -> String| (0..n).map(f).collect::<String>();
    let udt = |a: usize, b: usize| format!("TYPE UDT {a}\nSTRUCT a : UDT {b};\nEND_STRUCT;\nEND_TYPE\n");
    let locals = numbered(&|i| format!("v{i} : BOOL;\n"));
    let uses = numbered(&|i| format!("U #v{i};\n"));
    vec![
        ("statements", ob("U M 1.0;\n= A 0.0;\n".repeat(n))),
        ("mistakes", ob("QX M 1.0;\nU MW 1;\n".repeat(n))),
        ("one line", ob("QX M 1.0; U MW 1; ".repeat(n))),
        ("labels", ob(numbered(&|i| format!("l{i}: SPA l{};\n", n - 1 - i)))),
        ("unknown labels", ob(numbered(&|i| format!("SPA k{i};\n")))),
        ("jump lists", ob("SPL a;\n".repeat(n) + &"SPA a;\n".repeat(n) + "a: L 1;\n")),
        ("brackets", ob("U(;\n".repeat(n) + &");\n".repeat(n))),
        ("calls", ob("CALL FC 9 (ADR := 0);\n".repeat(n))),
        ("open calls", ob("CALL FC 9 (ADR := 0\n".repeat(n))),
        ("editor calls", ob("CALL FC 9\nADR:=0\nANL:=M 1.0\n".repeat(n))),
        ("locals", format!("FUNCTION FC 50 : VOID\nVAR_TEMP\n{locals}END_VAR\nBEGIN\n{uses}END_FUNCTION\n")),
        ("statements in one line", ob("L MW 10; T MW 12; ".repeat(n))),
        ("names of blocks", numbered(&|i| format!("FUNCTION \"b{i}\" : VOID\nBEGIN\nL 1;\nEND_FUNCTION\n"))),
        ("blocks", numbered(&|i| format!("FUNCTION FC {} : VOID\nBEGIN\nL 1;\nEND_FUNCTION\n", 100 + i))),
        (
            "data",
            format!(
                "DATA_BLOCK DB 1\nSTRUCT\n{locals}END_STRUCT;\nBEGIN\n{}END_DATA_BLOCK\n",
                numbered(&|i| format!("v{i} := TRUE;\n"))
            ),
        ),
        (
            "names of one type",
            format!(
                "DATA_BLOCK DB 1\nSTRUCT\n{}z : STRUCT\n{locals}END_STRUCT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n",
                "a, ".repeat(n)
            ),
        ),
        (
            "locals of one type",
            format!(
                "FUNCTION FC 50 : VOID\nVAR_TEMP\n{}z : STRUCT\n{locals}END_STRUCT;\nEND_VAR\nBEGIN\nEND_FUNCTION\n",
                numbered(&|i| format!("w{i}, "))
            ),
        ),
        (
            "memory under all widths",
            ob(numbered(&|i| {
                format!("U M {}.0;\nL MW {};\nL MD {};\nT MW {};\n", i % 60_000, i * 7 % 60_000, i * 3 % 60_000, i % 9)
            })),
        ),
        (
            "outputs on many paths",
            format!(
                "FUNCTION FC 50 : INT\nVAR_OUTPUT\na, b : INT;\nEND_VAR\nBEGIN\n{}END_FUNCTION\n",
                numbered(&|i| format!("l{i}: T #a;\nSPB l{};\nT #b;\nLOOP l{i};\n", (i + 1) % n))
            ),
        ),
        ("calls and BR", ob("SAVE;\nCALL FC 9 (ADR := 0);\nU BIE;\nT MW 2;\n".repeat(n))),
        ("a chain of types", numbered(&|i| udt(i + 1, i + 2))),
        ("a chain of types backwards", numbered(&|i| udt(i + 2, i + 1))),
        (
            "a chain of names",
            numbered(&|i| format!("TYPE \"t{i}\"\nSTRUCT a : \"t{}\";\nEND_STRUCT;\nEND_TYPE\n", i + 1)),
        ),
        (
            "names without numbers",
            numbered(&|i| format!("FUNCTION \"f{i}\" : VOID\nBEGIN\nCALL \"f{}\";\nEND_FUNCTION\n", (i + 7) % n)),
        ),
        ("blocks that are missing", ob(numbered(&|i| format!("CALL FC {};\nAUF DB {};\n", i + 500, i + 1)))),
        ("symbols that are missing", ob(numbered(&|i| format!("U \"s{i}\";\nU \"s\";\nU #s{i};\n")))),
        ("heads without end", "FUNCTION FC 1 : VOID\nTITLE = x\nFOO\n".repeat(n)),
        ("lists without end", ob("UC FC 9 { P#M 1.0\n".repeat(n))),
        ("lists", ob("UC FC 9 { P#M 1.0, N#5 };\n".repeat(n))),
        ("comments", ob("L 1; (* a\n b *) T MW 2;\n".repeat(n))),
        ("comments without end", "(* \n".repeat(n)),
        ("open strings", "\"".repeat(n) + &"'\n".repeat(n)),
        ("stray", "~ ".repeat(n)),
        ("ends", "END_FUNCTION\n".repeat(n)),
    ]
}

/// Types nested much deeper than types can be: the work is that of reading them.
#[test]
fn a_chain_of_20_000_types() {
    for (name, text) in forms(20_000).into_iter().filter(|(name, _)| name.starts_with("a chain")) {
        let output = check(text.as_bytes());
        assert!(output.steps < 40 * 20_000 + 20 * text.len() as u64, "{name}: {} steps", output.steps);
    }
}

#[test]
fn work_grows_linearly() {
    for ((name, small), (_, large)) in forms(1_000).into_iter().zip(forms(4_000)) {
        let (small, large) = (check(small.as_bytes()).steps, check(large.as_bytes()).steps);
        assert!(small > 500, "{name}: {small} steps count nothing");
        assert!(large <= small * 4 + small / 2, "{name}: {small} steps become {large}");
    }
}

#[test]
fn a_hundred_thousand_statements_compile() {
    let text = format!(
        "ORGANIZATION_BLOCK OB 1\n{}END_ORGANIZATION_BLOCK\n",
        "L MW 10\n+ 1\nT MW 10\nU M 1.0\nS M 2.0\n".repeat(20_000)
    );
    let output = check(text.as_bytes());
    assert!(output.is_good());
    assert_eq!(output.program.blocks[0].code.len(), 100_000);
    assert!(output.diagnostics.iter().all(|d| d.severity == Severity::Lint));
}
