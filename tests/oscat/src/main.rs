//! Holds the SCL compiler against Siemens' own: every source of the sample releases compiles, and each block gives the
//! same as the machine code beside it. `cargo xtask oscat` says how.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a campaign reads files")]
#![allow(clippy::print_stdout, reason = "its output")]
#![allow(missing_docs, unreachable_pub, reason = "a program")]

mod samples;

use std::collections::BTreeSet;
use std::path::Path;

use ob1_stl::{Options, Severity, Source};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let Some(folder) = std::env::var_os("OB1_STEP7_PROJECTS") else {
        println!("skipped: OB1_STEP7_PROJECTS names no folder with the sample releases");
        return;
    };
    let filter = args.first().cloned().unwrap_or_default();
    let mut distinct: BTreeSet<Vec<u8>> = BTreeSet::new();
    let (mut files, mut good, mut shown) = (0, 0, 0);
    for path in samples::archives(Path::new(&folder)) {
        if !path.to_string_lossy().contains(&filter) {
            continue;
        }
        let Some(release) = samples::read(&path) else {
            println!("{}: no program with SCL sources", path.display());
            continue;
        };
        let mut sources: Vec<Source> = release.scl.iter().map(|(_, s)| s.clone()).collect();
        let count = sources.len();
        sources.extend(release.rest.iter().cloned());
        let mnemonics = ob1_stl::Mnemonics::International;
        let options = Options { symbols: release.symbols.clone(), mnemonics, ..Options::default() };
        let output = ob1_scl::compile(&sources, &release.library, &options);
        let mut bad = BTreeSet::new();
        for d in output.diagnostics.iter().filter(|d| d.severity == Severity::Error) {
            bad.extend(d.sources());
            if shown < 60 {
                shown += 1;
                print!("{}", ob1_stl::render(d, &sources[d.source]));
            }
        }
        let scl_bad = bad.iter().filter(|b| **b < count).count();
        println!(
            "{}: {} SCL, {} bad, {} others, {} bad, replaced {}, blocks {} of {}",
            release.name, count, scl_bad, release.rest.len(), bad.len() - scl_bad, release.replaced.len(),
            output.program.blocks.len(), release.reference.blocks.len()
        );
        for (at, (_, source)) in release.scl.iter().enumerate() {
            if distinct.insert(source.bytes.clone()) {
                files += 1;
                good += usize::from(!bad.contains(&at));
            }
        }
    }
    println!("distinct sources: {good} of {files} compile");
}
