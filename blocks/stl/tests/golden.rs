//! Every `tests/data/*.awl` is compiled, and the result is compared with the `.expected` file beside it: the
//! diagnostics as printed, then the listing of the program. `UPDATE=1 cargo test -p ob1-stl` rewrites the expectations.

#![allow(clippy::disallowed_methods, reason = "the tests read their data files, and write them when asked to")]

mod common;

use std::path::{Path, PathBuf};

use ob1_stl::{Source, render};

/// Compares `text` with a file, or writes it when UPDATE is set.
fn check(path: &Path, text: &str) {
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(path, text).unwrap();
    }
    let expected = std::fs::read_to_string(path).unwrap_or_default().replace("\r\n", "\n");
    assert!(expected == text, "{} differs (UPDATE=1 writes it anew):\n{text}", path.display());
}

fn report(path: &Path) -> String {
    let name = path.file_name().unwrap().to_str().unwrap();
    let bytes = std::fs::read(path).unwrap();
    let output = common::compile_one(name, &bytes);
    let source = Source::new(name, bytes);
    let mut text: String = output.diagnostics.iter().map(|d| render(d, &source) + "\n").collect();
    let library = common::library();
    let verified = ob1_ir::verify(&output.program, &|id| library.get(id).map(|b| &b.interface));
    // What is left of a source with errors may lack brackets.
    let unsound = |f: &ob1_ir::Finding| {
        output.is_good() || !matches!(f.defect, ob1_ir::Defect::Brackets | ob1_ir::Defect::McrBrackets)
    };
    let findings: Vec<_> = verified.err().unwrap_or_default().into_iter().filter(unsound).collect();
    assert_eq!(findings, [], "{name}");
    if output.is_good() {
        text.push_str(&output.program.to_string());
    }
    text
}

fn sources() -> Vec<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut all: Vec<PathBuf> = std::fs::read_dir(data).unwrap().map(|e| e.unwrap().path()).collect();
    all.retain(|p| p.extension().is_some_and(|e| e == "awl"));
    all.sort();
    all
}

#[test]
fn sources_give_what_is_expected() {
    let all = sources();
    assert!(all.len() > 6);
    for path in all {
        check(&path.with_extension("expected"), &report(&path));
    }
}

#[test]
fn listing_and_cross_reference_give_what_is_expected() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/inspect");
    let symbols = std::fs::read(data.join("plant.sdf")).unwrap();
    let symbols = ob1_stl::read_symbols(&Source::new("plant.sdf", symbols));
    assert!(symbols.is_good());
    let source = Source::new("plant.awl", std::fs::read(data.join("plant.awl")).unwrap());
    let options = ob1_stl::Options { symbols: symbols.symbols, ..Default::default() };
    let library = common::library();
    let output = ob1_stl::compile(std::slice::from_ref(&source), &library, &options);
    assert!(output.is_good(), "{:?}", output.diagnostics);
    check(&data.join("listing.expected"), &ob1_stl::listing(&output.program));
    let references = ob1_stl::xref_with(&output.program, &library);
    let german = ob1_stl::Mnemonics::German;
    check(&data.join("xref.expected"), &ob1_stl::render_xref(&references, &output.program, german));
    let alone = ob1_stl::xref(&output.program);
    assert!(alone.is_sorted() && references.is_sorted());
    assert!(
        alone.iter().any(|r| r.via.as_deref() == Some("FC 9, parameter 3") && r.access == ob1_stl::Access::ReadWrite)
    );
}

/// What a symbol table gives: findings, then name, address and type.
fn table_report(path: &Path) -> String {
    let name = path.file_name().unwrap().to_str().unwrap();
    let source = Source::new(name, std::fs::read(path).unwrap());
    let table = ob1_stl::read_symbols(&source);
    let findings: String = table.diagnostics.iter().map(|d| render(d, &source) + "\n").collect();
    let ty = |s: &ob1_ir::Symbol| s.ty.as_ref().map_or("-", ob1_model::DataType::name);
    let symbols = table.symbols.iter().map(|s| format!("{} = {} : {}\n", s.name, s.address, ty(s)));
    findings + &symbols.collect::<String>()
}

fn tables() -> Vec<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/symbols");
    let mut all: Vec<PathBuf> = std::fs::read_dir(data).unwrap().map(|e| e.unwrap().path()).collect();
    all.retain(|p| p.extension().is_some_and(|e| e != "expected"));
    all.sort();
    all
}

/// `project.sdf` to `project.sdf.expected`.
fn table_expectation(path: &Path) -> PathBuf {
    path.with_file_name(format!("{}.expected", path.file_name().unwrap().to_str().unwrap()))
}

#[test]
fn symbol_tables_give_what_is_expected() {
    let all = tables();
    assert!(all.len() > 8);
    for path in all {
        check(&table_expectation(&path), &table_report(&path));
    }
}

#[test]
fn all_forms_of_a_table_give_the_same_symbols() {
    let read = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/symbols").join(name);
        ob1_stl::read_symbols(&Source::new(name, std::fs::read(path).unwrap())).symbols
    };
    let sdf = read("project.sdf");
    assert_eq!(sdf.len(), 12);
    assert_eq!(read("project.asc"), sdf);
    assert_eq!(read("project.dif"), sdf);
    let untyped: Vec<_> = sdf.into_iter().map(|s| ob1_ir::Symbol { ty: None, ..s }).collect();
    assert_eq!(read("project.seq"), untyped);
}

/// A record whose columns were moved by hand is refused, and the message says how wide they are.
#[test]
fn the_columns_of_an_asc_file() {
    let read = |name: usize, address: usize, ty: usize| {
        let text = format!("126,{:<name$}{:<address$}{:<ty$}{:<80}\r\n", "Motor", "A       4.0", "BOOL", "comment");
        ob1_stl::read_symbols(&Source::new("a.asc", text.into_bytes()))
    };
    let good = read(24, 12, 10);
    assert_eq!((good.symbols.len(), good.diagnostics.len()), (1, 0));
    assert_eq!(good.symbols[0].ty, Some(ob1_model::DataType::Bool));
    for (name, address, ty) in [(20, 12, 10), (28, 12, 10), (24, 8, 10)] {
        let moved = read(name, address, ty);
        assert!(moved.symbols.is_empty(), "{name} {address} {ty}");
        assert!(moved.diagnostics[0].message.contains("24, 12, 10 and 80"), "{:?}", moved.diagnostics);
    }
}

#[test]
fn the_manual_s_program_is_the_same_in_both_forms() {
    let editor = common::compile_one("manual.awl", include_bytes!("data/manual.awl"));
    let source = common::compile_one("manual.awl", include_bytes!("data/manual_source.awl"));
    assert!(editor.is_good() && source.is_good());
    assert!(editor.program.blocks.iter().any(|b| b.code.len() > 5));
    assert_eq!(editor.program, source.program);
}

#[test]
fn both_sets_of_mnemonics_mean_the_same() {
    let german = common::compile_one("a.awl", include_bytes!("data/instructions.awl"));
    let international = common::compile_one("international.awl", include_bytes!("data/instructions_international.awl"));
    assert!(german.is_good() && international.is_good());
    assert_eq!(german.program.blocks, international.program.blocks);
}

#[test]
fn the_set_of_mnemonics_is_found_in_every_source() {
    let library = common::library();
    for path in sources() {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name.starts_with("auto_") || name.starts_with("errors_") {
            continue;
        }
        let source = Source::new(name.clone(), std::fs::read(path).unwrap());
        let options =
            ob1_stl::Options { mnemonics: ob1_stl::Mnemonics::Auto, symbols: common::symbols(), ..Default::default() };
        let library = if name.starts_with("bench_") { &ob1_stl::Library::new() } else { &library };
        let found = ob1_stl::compile(std::slice::from_ref(&source), library, &options);
        assert_eq!(found.program, common::compile_one(&name, &source.bytes).program, "{name}");
    }
}

#[test]
fn each_file_has_its_own_set() {
    let frame = |n: u16, body: &str| format!("FUNCTION FC {n} : VOID\nBEGIN\n{body}END_FUNCTION\n");
    let sources = [
        Source::new("de.awl", frame(60, "U E 0.0;\nL S5T#1S;\nSE T 1;\nL P#E 1.0;\n")),
        Source::new("en.awl", frame(61, "A I 0.0;\nL S5T#1S;\nSD T 1;\nL P#I 1.0;\n")),
    ];
    let options = ob1_stl::Options { mnemonics: ob1_stl::Mnemonics::Auto, ..Default::default() };
    let output = ob1_stl::compile(&sources, &ob1_stl::Library::new(), &options);
    assert_eq!(output.diagnostics, []);
    assert_eq!(output.program.blocks[0].code, output.program.blocks[1].code);
}

#[test]
fn every_number_is_seen_in_an_expectation() {
    // Made only by sources too large to be kept here; robust.rs makes them.
    let elsewhere = ["S0003", "S0213", "S0214", "S0319"];
    let expected = |path: PathBuf| std::fs::read_to_string(path.with_extension("expected")).unwrap_or_default();
    let table = |path: PathBuf| std::fs::read_to_string(table_expectation(&path)).unwrap_or_default();
    let constructs =
        ["accepted", "refused"].map(|f| Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/constructs").join(f));
    let constructs = constructs.into_iter().flat_map(|f| std::fs::read_dir(f).unwrap()).map(|e| e.unwrap().path());
    let constructs = constructs.filter(|p| p.extension().is_some_and(|e| e == "expected"));
    let all: String = sources()
        .into_iter()
        .map(expected)
        .chain(tables().into_iter().map(table))
        .chain(constructs.map(|p| std::fs::read_to_string(p).unwrap()))
        .collect();
    let unseen: Vec<_> = ob1_stl::messages::ALL.iter().map(|c| c.number).filter(|n| !all.contains(*n)).collect();
    assert_eq!(unseen, elsewhere);
}

#[test]
fn the_page_of_diagnostics_is_that_of_the_table() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/stl-errors.md");
    check(&page, &ob1_stl::messages::page());
}
