//! Constructs of sources as STEP 7 V5, TIA Portal and colleagues write them. `tests/constructs/accepted` has sources
//! with what they give: lints and the listing of the program. `tests/constructs/refused` has sources with their one
//! message. A table of symbols beside a source belongs to it. `UPDATE=1 cargo test -p ob1-stl` rewrites the
//! expectations.

#![allow(clippy::disallowed_methods, reason = "the tests read their data files, and write them when asked to")]

use std::path::{Path, PathBuf};

use ob1_model::{BitAddr, BlockId, BlockKind, DataType, Interface, Param, Section};
use ob1_stl::{Library, Mnemonics, Options, Output, Severity, Source, compile, listing, render_all};

fn sources(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/constructs").join(folder);
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    all.retain(|p| p.extension().is_none_or(|e| e != "expected" && e != "sdf"));
    all.sort();
    assert!(all.len() > 12, "{all:?}");
    all
}

fn interface(params: &[(&str, Section, DataType)], has_instance: bool) -> Interface {
    let params = params.iter().map(|(name, section, ty)| Param::new(name, *section, ty.clone())).collect();
    let mut interface = Interface { params, ..Interface::default() };
    interface.lay_out(has_instance);
    interface
}

fn scale() -> Interface {
    use DataType::{Bool, Int, Real, Word};
    let params = [
        ("IN", Section::Input, Int),
        ("HI_LIM", Section::Input, Real),
        ("LO_LIM", Section::Input, Real),
        ("BIPOLAR", Section::Input, Bool),
        ("OUT", Section::Output, Real),
        ("RET_VAL", Section::Return, Word),
    ];
    interface(&params, false)
}

/// A timer with the instance of an S7-1500: ST, PT, ET, RU, IN, Q.
fn timer_of_1500() -> Interface {
    use DataType::{Bool, Byte, Time, Word};
    let params = [
        ("IN", Section::Input, Bool),
        ("PT", Section::Input, Time),
        ("Q", Section::Output, Bool),
        ("ET", Section::Output, Time),
        ("ST", Section::Static, Time),
        ("RU", Section::Static, Bool),
        ("STATE", Section::Static, Byte),
        ("PAD", Section::Static, Word),
    ];
    let mut timer = interface(&params, true);
    let places = [(12, 1), (4, 0), (12, 2), (8, 0), (0, 0), (12, 0), (13, 0), (14, 0)];
    timer.place_at(&places.map(|(byte, bit)| BitAddr::new(byte, bit)), 16);
    timer
}

/// Some system functions, one block that is offered, one that is chosen, one that comes by its name.
fn library() -> Library {
    use DataType::{Any, Bool, Int, Time};
    let mut library = Library::new();
    let move_block =
        [("SRCBLK", Section::Input, Any), ("RET_VAL", Section::Return, Int), ("DSTBLK", Section::Output, Any)];
    let sfc = |n| BlockId::new(BlockKind::Sfc, n);
    let fc = |n| BlockId::new(BlockKind::Fc, n);
    library.insert(sfc(20), "BLKMOV", interface(&move_block, false));
    library.insert(sfc(46), "STP", Interface::default());
    let timer = [
        ("IN", Section::Input, Bool),
        ("PT", Section::Input, Time),
        ("Q", Section::Output, Bool),
        ("ET", Section::Output, Time),
    ];
    for (number, name) in [(3, "TP"), (4, "TON"), (5, "TOF")] {
        library.insert(BlockId::new(BlockKind::Sfb, number), name, interface(&timer, true));
    }
    for (number, name) in [(1003, "TP_TIME"), (1004, "TON_TIME"), (1005, "TOF_TIME")] {
        library.insert(BlockId::new(BlockKind::Sfb, number), name, timer_of_1500());
    }
    library.offer(fc(105), "SCALE", scale());
    library.insert(fc(9), "EQ_DT", Interface::default());
    library.set_origin(fc(9), "[library] IEC:FC9", false);
    library.insert(fc(106), "UNSCALE", Interface::default());
    library.set_origin(fc(106), "libraries", true);
    library
}

fn compiled(path: &Path) -> (Source, Output) {
    let name = path.file_name().unwrap().to_str().unwrap();
    let source = Source::new(name, std::fs::read(path).unwrap());
    let symbols = std::fs::read(path.with_extension("sdf")).map_or(Vec::new(), |bytes| {
        let table = ob1_stl::read_symbols(&Source::new("table.sdf", bytes));
        assert!(table.is_good(), "{name}: {:?}", table.diagnostics);
        table.symbols
    });
    let options = Options { mnemonics: Mnemonics::Auto, symbols, ..Options::default() };
    let output = compile(std::slice::from_ref(&source), &library(), &options);
    (source, output)
}

fn check(path: &Path, text: &str) {
    let path = path.with_file_name(format!("{}.expected", path.file_name().unwrap().to_str().unwrap()));
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, text).unwrap();
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default().replace("\r\n", "\n");
    assert!(expected == text, "{} differs (UPDATE=1 writes it anew):\n{text}", path.display());
}

#[test]
fn accepted_with_their_listing() {
    for path in sources("accepted") {
        let (source, output) = compiled(&path);
        let found = render_all(&output.diagnostics, std::slice::from_ref(&source));
        assert!(output.is_good(), "{}:\n{found}", path.display());
        let library = library();
        let demanded = |id| output.demanded.iter().any(|d| d.id == id);
        let scale = scale();
        let interface = |id| library.get(id).map(|b| &b.interface).or_else(|| demanded(id).then_some(&scale));
        assert_eq!(ob1_ir::verify(&output.program, &interface).map(drop), Ok(()), "{}", path.display());
        let numbers: String = output.numbers.iter().map(|n| format!("\"{}\" = {}\n", n.name, n.id)).collect();
        check(&path, &format!("{found}{numbers}{}", listing(&output.program)));
    }
}

#[test]
fn refused_with_one_message() {
    for path in sources("refused") {
        let (source, output) = compiled(&path);
        let errors = output.diagnostics.iter().filter(|d| d.severity == Severity::Error).count();
        let found = render_all(&output.diagnostics, std::slice::from_ref(&source));
        assert_eq!(errors, 1, "{}:\n{found}", path.display());
        check(&path, &found);
    }
}
