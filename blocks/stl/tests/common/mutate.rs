//! Lines of good sources are deleted and doubled at random: nothing panics or hangs, and there are never more messages
//! than asked for.

#![allow(clippy::disallowed_methods, reason = "it reads the data files of the tests")]

use std::path::Path;

use ob1_stl::{Limit, Mnemonics, Options, Source, compile};

fn gather(folder: &Path, sources: &mut Vec<(String, Vec<String>)>) {
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            gather(&path, sources);
        } else if path.extension().is_some_and(|e| e == "awl" || e == "db" || e == "udt") {
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            let text = Source::new(name.clone(), std::fs::read(&path).unwrap()).text().into_owned();
            sources.push((name, text.lines().map(str::to_owned).collect()));
        }
    }
}

/// So many mutations; gives how many messages they made.
pub(crate) fn run(rounds: usize) -> usize {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    gather(&root.join("tests/data"), &mut sources);
    gather(&root.join("tests/constructs/accepted"), &mut sources);
    gather(&root.join("../../examples"), &mut sources);
    assert!(sources.len() > 40);
    let library = super::library();
    let limit = Limit { file: 20, run: 100 };
    let mut dice = fastrand::Rng::with_seed(0x0B1);
    let mut messages = 0;
    for round in 0..rounds {
        let (name, lines) = &sources[dice.usize(..sources.len())];
        let mut lines = lines.clone();
        for _ in 0..=dice.usize(..3) {
            if lines.is_empty() {
                break;
            }
            let at = dice.usize(..lines.len());
            if dice.bool() {
                lines.remove(at);
            } else {
                lines.insert(at, lines[at].clone());
            }
        }
        let text = lines.join("\n");
        let source = Source::new(name.clone(), text.clone().into_bytes());
        let options = Options {
            mnemonics: Mnemonics::Auto,
            symbols: super::symbols(),
            lints: true,
            limit: Some(limit),
            ..Options::default()
        };
        let output = compile(std::slice::from_ref(&source), &library, &options);
        assert!(output.diagnostics.len() <= limit.file, "round {round}: {name}");
        assert!(output.steps < 2_000_000 + 400 * text.len() as u64, "round {round}: {name}, {} steps", output.steps);
        messages += output.diagnostics.len() + output.rest.count();
        if output.is_good() {
            let verified = ob1_ir::verify(&output.program, &|id| library.get(id).map(|b| &b.interface));
            assert_eq!(verified.map(drop), Ok(()), "round {round}: {name}\n{text}");
        }
    }
    messages
}
