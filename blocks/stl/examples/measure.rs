//! Compiles every source of a folder with its symbol tables, and says how much memory that took; `time` says how long.
//!
//!     time cargo run --release -p ob1-stl --example measure -- FOLDER

#![allow(clippy::disallowed_methods, reason = "it reads the folder")]

use ob1_stl::{Library, Limit, Mnemonics, Options, Source, TableForm, compile, read_symbols};

fn main() -> std::io::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "plant".into());
    let mut paths: Vec<_> = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    paths.sort_by_key(std::fs::DirEntry::path);
    let (mut sources, mut symbols) = (Vec::new(), Vec::new());
    for path in paths {
        let name = path.path().display().to_string();
        let source = Source::new(name.clone(), std::fs::read(path.path())?);
        match TableForm::of_name(&name) {
            Some(_) => symbols.extend(read_symbols(&source).symbols),
            None => sources.push(source),
        }
    }
    let limit = Some(Limit { file: 20, run: 100 });
    let options = Options { mnemonics: Mnemonics::Auto, symbols, limit, ..Options::default() };
    let output = compile(&sources, &Library::new(), &options);
    let errors = output.diagnostics.len() + output.rest.count();
    let blocks = output.program.blocks.len();
    let statements: usize = output.program.blocks.iter().map(|b| b.code.len()).sum();
    println!("{} sources: {blocks} blocks, {statements} statements, {errors} findings", sources.len());
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    for line in status.lines().filter(|l| l.starts_with("VmHWM")) {
        println!("{line}");
    }
    Ok(())
}
