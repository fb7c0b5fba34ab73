//! Mistakes in SCL: one finding each, with its place and what to do; and nothing that a text can do to the compiler.

use std::path::Path;

use ob1_scl::compile;
use ob1_stl::{Library, Options, Output, Source};

fn compiled(text: &str) -> Output {
    compile(&[Source::new("p.scl", text.as_bytes())], &Library::new(), &Options::default())
}

/// Number, line and remedy of each finding.
fn findings(text: &str) -> Vec<(&'static str, u32, String)> {
    compiled(text).diagnostics.into_iter().map(|d| (d.code, d.line, d.remedy)).collect()
}

/// The number of the only finding of statements in a function.
fn only(declared: &str, statements: &str) -> &'static str {
    let text = format!("FUNCTION FC1 : VOID\nVAR_TEMP {declared} END_VAR\nBEGIN\n{statements}\nEND_FUNCTION\n");
    let found = findings(&text);
    let codes: Vec<_> = found.iter().map(|(code, ..)| *code).collect();
    assert_eq!(codes.len(), 1, "{declared} {statements}: {codes:?}");
    codes[0]
}

#[test]
fn each_mistake_has_its_number() {
    for (declared, statements, code) in [
        ("a : INT; w : WORD;", "w := 1; a := w;", "S2201"),
        ("a : INT; r : REAL;", "r := 1.0; a := r;", "S2201"),
        ("a : INT;", "a := 1; a := a AND 3;", "S2202"),
        ("a : BYTE;", "a := 300;", "S2203"),
        ("a : INT;", "a := 1; a := a / 0;", "S2204"),
        ("a : ARRAY[1..3] OF INT;", "a[4] := 1;", "S2105"),
        ("", "POKE(area := 16#84, dbNumber := 70000, byteOffset := 0, value := B#16#1);", "S2408"),
        ("b : BYTE;", "b := PEEK(area := 16#84, dbNumber := 0, byteOffset := 0);", "S2408"),
        ("b : BYTE; r : REAL;", "r := 1.0; b := PEEK(area := 16#84, dbNumber := r, byteOffset := 0);", "S2202"),
        ("", "POKE(area := 16#85, dbNumber := 1, byteOffset := 0, value := B#16#1);", "S2408"),
        ("a : ARRAY[1..3] OF INT;", "a[1, 2] := 1;", "S2105"),
        ("r : REAL;", "FOR r := 1 TO 3 DO ; END_FOR;", "S2303"),
        ("a : INT;", "FOR a := 1 TO 32767 DO ; END_FOR;", "S2304"),
        ("a : INT;", "a := 1; CASE a OF 1: ; 1: ; END_CASE;", "S2301"),
        ("a : INT;", "a := 1; CASE a OF 1..5: ; 3: ; END_CASE;", "S2302"),
        ("a : INT;", "EXIT;", "S2305"),
        ("a : INT;", "GOTO nowhere;", "S2306"),
        ("a : INT;", "a := 1; GOTO l; IF a = 1 THEN l: a := 2; END_IF;", "S2306"),
        ("a : INT;", "a := b;", "S2101"),
        ("a : INT;", "nothing_like_that(1);", "S2101"),
        ("#T3 : INT;", "T3 := 1;", "S2103"),
        ("#MW3 : INT; w : WORD;", "#MW3 := 1; w := MW3;", "S2107"),
        ("a : INT;", "MW100 := INT_TO_WORD(a);", "S2502"),
        ("r : REAL; b : BOOL;", "r := 1.0; b := r = 2.0;", "S2205"),
        ("s : STRING[2];", "s := 'abc';", "S2206"),
        ("a : INT;", "a := 1 +;", "S2003"),
        ("a : INT;", "a := 1", "S2005"),
        ("a : INT;", "IF TRUE THEN a := 1;", "S2001"),
    ] {
        assert_eq!(only(declared, statements), code, "{declared} {statements}");
    }
}

#[test]
fn the_remedy_names_the_conversion() {
    let text = "FUNCTION FC1 : VOID\nVAR_TEMP a : INT; d : DINT; END_VAR\nBEGIN\nd := 1;\na := d;\nEND_FUNCTION\n";
    assert_eq!(findings(text), [("S2201", 5, "Write DINT_TO_INT(...).".to_owned())]);
}

#[test]
fn fourteen_mistakes_are_fourteen_findings() {
    let wrong = [
        "a := b;",
        "a := 1.5;",
        "a := ;",
        "IF a THEN END_IF;",
        "w := a;",
        "a := TRUE;",
        "x[9] := 1;",
        "EXIT;",
        "a := (1 + 2;",
        "FOR r := 1 TO 2 DO ; END_FOR;",
        "a := a MOD 0;",
        "s := 5;",
        "GOTO gone;",
        "f(1);",
    ];
    let text = format!(
        "FUNCTION FC1 : VOID\nVAR_TEMP a : INT; w : WORD; r : REAL; s : STRING[5]; x : ARRAY[1..3] OF INT; END_VAR\nBEGIN\n\
         {}\na := 1;\nEND_FUNCTION\n",
        wrong.join("\n")
    );
    let lines: Vec<u32> = findings(&text).iter().map(|(_, line, _)| *line).collect();
    assert_eq!(lines, (4..18).collect::<Vec<_>>());
}

#[test]
fn a_function_that_assigns_no_result_is_found() {
    let text = "FUNCTION FC1 : INT\nBEGIN\nMW100 := 1;\nEND_FUNCTION\n";
    assert_eq!(findings(text).iter().map(|(code, ..)| *code).collect::<Vec<_>>(), ["S2501"]);
}

#[test]
fn calls_of_functions_are_complete() {
    let callee = "FUNCTION FC2 : INT VAR_INPUT a, b : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN q := a; FC2 := b; END_FUNCTION\n";
    for (call, code) in [
        ("x := FC2(a := 1, q := x);", "S2403"),
        ("x := FC2(a := 1, b := 2, c := 3, q := x);", "S2402"),
        ("x := FC2(a => x, b := 2, q := x);", "S2404"),
        ("x := FC2(a := 1, b := 2, q := 5);", "S2405"),
        ("x := FB9.DB1();", "S0602"),
    ] {
        let text = format!("{callee}FUNCTION FC1 : VOID VAR_TEMP x : INT; END_VAR BEGIN {call} END_FUNCTION\n");
        let codes: Vec<_> = findings(&text).into_iter().map(|(code, ..)| code).collect();
        assert_eq!(codes, [code], "{call}");
    }
}

#[test]
fn comments_lie_in_each_other() {
    let text = "FUNCTION FC1 : VOID\nBEGIN\n(* a (* b *) MW0 := nothing; *)\nMW2 := 1;\nEND_FUNCTION\n";
    assert_eq!(findings(text), []);
}

/// Changes a text at random: bytes, words, pieces.
fn mutated(rng: &mut fastrand::Rng, text: &str) -> Vec<u8> {
    const WORDS: [&str; 24] = [
        "IF",
        "END_IF",
        "(",
        ")",
        ";",
        ":=",
        "FOR",
        "CASE",
        "OF",
        "..",
        "[",
        "]",
        "#",
        "\"",
        "'",
        "END_FUNCTION",
        "AND",
        "-",
        "16#",
        "VAR",
        "END_VAR",
        "**",
        "REPEAT",
        "(*",
    ];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..rng.usize(1..6) {
        let at = rng.usize(..=bytes.len());
        match rng.u8(..5) {
            0 if at < bytes.len() => bytes[at] = rng.u8(..),
            1 => drop(bytes.splice(at..at, WORDS[rng.usize(..WORDS.len())].bytes())),
            2 => {
                let end = (at + rng.usize(..20)).min(bytes.len());
                bytes.drain(at..end);
            }
            3 => {
                let end = (at + rng.usize(..40)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = rng.usize(..=bytes.len());
                drop(bytes.splice(to..to, piece));
            }
            _ => drop(bytes.splice(at..at, [b' ', b'\n'])),
        }
    }
    bytes
}

/// The corpus of the fuzz target: classic blocks, a machine, TIA Portal's dialect, calls and texts, mistakes.
const SEEDS: [&str; 5] = [
    include_str!("../../../fuzz/corpus/scl/01_classic.scl"),
    include_str!("../../../fuzz/corpus/scl/02_tank.scl"),
    include_str!("../../../fuzz/corpus/scl/03_tia.scl"),
    include_str!("../../../fuzz/corpus/scl/04_calls.scl"),
    include_str!("../../../fuzz/corpus/scl/05_mistakes.scl"),
];

#[test]
#[allow(clippy::disallowed_methods, reason = "the length of the campaign comes from the environment")]
fn no_text_breaks_the_compiler() {
    // `SCL_MUTATIONS=1000000 cargo test -p ob1-scl --release` is the campaign.
    let count = std::env::var("SCL_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(2_000);
    let mut rng = fastrand::Rng::with_seed(36);
    let mut library = Library::new();
    for block in ob1_std::standard_blocks() {
        library.insert(block.id, block.name, block.interface);
    }
    let mut good = 0;
    for _ in 0..count {
        let seed = SEEDS[rng.usize(..SEEDS.len())];
        let bytes = mutated(&mut rng, seed);
        let length = bytes.len() as u64;
        let output = compile(&[Source::new("p.scl", bytes)], &library, &Options::default());
        assert!(output.diagnostics.len() < 400, "findings are bounded");
        assert!(output.steps < 200_000 + 8_192 * length, "the work is linear: {}", output.steps);
        if output.is_good() {
            good += 1;
            let verified = ob1_ir::verify(&output.program, &|id| library.get(id).map(|block| &block.interface));
            assert_eq!(verified.map(drop), Ok(()));
        }
    }
    assert!(good > count / 100, "some are left good, and pass the verifier: {good}");
}

#[test]
fn nesting_is_bounded() {
    for (open, close) in
        [("(", ")"), ("IF TRUE THEN ", " END_IF;"), ("NOT ", ""), ("- ", ""), ("WHILE TRUE DO ", " END_WHILE;")]
    {
        let inner = if open.starts_with(['(', 'N', '-']) { "MD0 := " } else { "" };
        let text =
            format!("FUNCTION FC1 : VOID BEGIN {inner}{}1{} END_FUNCTION", open.repeat(20_000), close.repeat(20_000));
        assert!(!compiled(&text).is_good(), "{open}");
    }
}

#[test]
fn the_page_lists_every_number() {
    let mut page = "# Diagnostics of the SCL compiler\n\nMade from the table in `blocks/scl/src/messages.rs`; a test holds the two \
                    together (`UPDATE=1 cargo test -p ob1-scl`\nwrites this page anew). Declarations, constants and names have \
                    the numbers of [STL](stl-errors.md).\n\n| Number | Kind | What | Remedy |\n|---|---|---|---|\n"
        .to_owned();
    for code in ob1_scl::messages::ALL {
        page += &format!("| {} | {} | {} | {} |\n", code.number, code.severity.name(), code.title, code.remedy);
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/scl-errors.md");
    #[allow(clippy::disallowed_methods, reason = "the test writes a page of the book")]
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &page).expect("the page is written");
    }
    #[allow(clippy::disallowed_methods, reason = "the test reads a page of the book")]
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(written == page, "run UPDATE=1 cargo test -p ob1-scl");
}
