//! Holds the SCL compiler against Siemens' own: every source of the sample releases compiles, and each block gives the
//! same as the machine code beside it. `cargo xtask oscat` says how.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a campaign reads files")]
#![allow(clippy::print_stdout, reason = "its output")]
#![allow(missing_docs, unreachable_pub, reason = "a program")]

mod judge;
mod samples;

use std::collections::BTreeSet;
use std::path::Path;

use ob1_stl::{Options, Severity, Source};

fn main() {
    let mut args = std::env::args().skip(1);
    let (filter, calls) = (args.next().unwrap_or_default(), args.next().and_then(|n| n.parse().ok()).unwrap_or(0u32));
    let only = args.next();
    let Some(folder) = std::env::var_os("OB1_STEP7_PROJECTS") else {
        println!("skipped: OB1_STEP7_PROJECTS names no folder with the sample releases");
        return;
    };
    let mut distinct: BTreeSet<Vec<u8>> = BTreeSet::new();
    let (mut files, mut good, mut shown) = (0, 0, 0);
    let releases = samples::archives(Path::new(&folder)).into_iter().filter(|p| p.to_string_lossy().contains(&filter));
    for release in releases.flat_map(|path| samples::read(&path)) {
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
        let (ours, theirs) = (output.program.blocks.len(), release.reference.blocks.len());
        println!("{}: {count} SCL sources, {scl_bad} with errors; {ours} of {theirs} blocks", release.name);
        for (at, (_, source)) in release.scl.iter().enumerate() {
            if distinct.insert(source.bytes.clone()) {
                files += 1;
                good += usize::from(!bad.contains(&at));
            }
        }
        let natives = release.library.clone();
        let external = |id| natives.get(id).map(|b| &b.interface);
        for program in [&release.reference, &output.program] {
            let Err(defects) = ob1_ir::verify(program, &external) else { continue };
            for defect in defects.iter().take(20) {
                let name = program.blocks.iter().find(|b| Some(b.id) == defect.block).and_then(|b| b.name.clone());
                println!("  defect: {} {defect}", name.unwrap_or_default());
            }
        }
        if calls > 0 {
            equality(&release, &output.program, calls, only.as_deref());
        }
    }
    println!("distinct sources: {good} of {files} compile");
}

/// Each function and function block of a release, and how many are equal.
fn equality(release: &samples::Release, ours: &ob1_ir::Program, calls: u32, only: Option<&str>) {
    let (mut equal, mut different, mut left) = (0, 0, 0);
    let ids = release.scl.iter().filter_map(|(id, source)| Some(((*id)?, &source.name)));
    for (id, name) in ids.filter(|(id, _)| id.kind != ob1_model::BlockKind::Db) {
        if only.is_some_and(|only| !name.eq_ignore_ascii_case(&format!("{only}.scl"))) {
            continue;
        }
        match judge::judge(&release.reference, ours, id, &release.replaced, calls) {
            judge::Verdict::Equal(_) => equal += 1,
            judge::Verdict::Differs(call, what) => {
                different += 1;
                println!("  {id} {name}: call {call}: {what}");
            }
            judge::Verdict::Left(why) => {
                left += 1;
                println!("  {id} {name}: left out: {why}");
            }
        }
    }
    println!("{}: {equal} equal, {different} different, {left} left out", release.name);
}
