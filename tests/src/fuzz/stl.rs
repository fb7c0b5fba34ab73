//! The STL front end: sources in both sets of mnemonics, and in the detected set.

use std::sync::LazyLock;

use ob1_stl::{Library, Mnemonics, Options, Output, Source, compile, render};

/// Maximum steps of work for each byte of source, and a constant: the work is linear. The number is large because a
/// data block declared in one line has up to 64 KiB of start values.
const STEPS_PER_BYTE: u64 = 8_192;
const STEPS: u64 = 200_000;

/// Compiles in each set of mnemonics.
pub fn run(data: &[u8]) {
    for mnemonics in [Mnemonics::German, Mnemonics::International, Mnemonics::Auto] {
        let source = Source::new("fuzz.awl", data);
        let options = Options { mnemonics, lints: true, ..Options::default() };
        judge(&source, &compile(std::slice::from_ref(&source), &LIBRARY, &options));
    }
}

/// The result passes the verifier, and each diagnostic points into the source.
pub(super) fn judge(source: &Source, output: &Output) {
    let verified = ob1_ir::verify(&output.program, &|id| LIBRARY.get(id).map(|block| &block.interface));
    // The rest of a source with errors may lack brackets; of SCL a block with an error is left out.
    let unsound = |f: &ob1_ir::Finding| match f.defect {
        ob1_ir::Defect::Brackets | ob1_ir::Defect::McrBrackets => output.is_good(),
        ob1_ir::Defect::UnknownBlock(_) => output.is_good() || !source.name.ends_with(".scl"),
        _ => true,
    };
    let findings: Vec<_> = verified.err().unwrap_or_default().into_iter().filter(unsound).collect();
    assert_eq!(findings, []);
    assert!(output.steps <= STEPS + STEPS_PER_BYTE * source.bytes.len() as u64, "{} steps", output.steps);
    for diagnostic in output.diagnostics.iter().take(20) {
        assert!(diagnostic.line >= 1 && diagnostic.column >= 1 && diagnostic.length >= 1);
        assert!(render(diagnostic, source).contains(diagnostic.code));
    }
    assert!(ob1_stl::listing(&output.program).starts_with("source 1: "));
    assert!(ob1_stl::xref_with(&output.program, &LIBRARY).is_sorted());
}

/// The standard blocks with the numbers of STEP 7, as in `ob1 exec`; created once.
pub(super) static LIBRARY: LazyLock<Library> = LazyLock::new(|| {
    let mut library = Library::new();
    for block in ob1_std::system_functions() {
        library.insert(block.id, block.name, block.interface);
    }
    library
});
