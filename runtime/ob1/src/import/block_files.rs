//! Blocks in machine code: files, folders of them, the program of a station.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ob1_mc7::BlockImage;
use ob1_model::{BlockId, BlockKind};
use ob1_station_file::finding::Finding;
use ob1_station_file::program_files;

use crate::xref::Asked;

/// Where the blocks lie as they came from the CPU.
pub(super) const UPLOADED: &str = "uploaded";

/// Blocks by name, as they came.
pub(super) type Blocks = BTreeMap<String, Vec<u8>>;

/// Whether this is a block in machine code, or a folder of them.
pub(crate) fn is_machine_code(path: &Path) -> bool {
    let is = |path: &Path| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mc7"));
    let of_folder = || std::fs::read_dir(path).into_iter().flatten().flatten();
    is(path) || path.join(UPLOADED).is_dir() || of_folder().any(|entry| is(&entry.path()))
}

/// The blocks of files and folders, by their names.
pub(super) fn collect(paths: &[PathBuf]) -> Result<Blocks, String> {
    let mut blocks = Blocks::new();
    for path in paths {
        let uploaded = path.join(UPLOADED);
        let is = |ending: &str| path.extension().is_some_and(|end| end.eq_ignore_ascii_case(ending));
        if uploaded.is_dir() {
            folder(&uploaded, &mut blocks)?;
        } else if path.is_dir() {
            folder(path, &mut blocks)?;
        } else if is("toml") {
            station(path, &mut blocks)?;
        } else if path.is_file() && program_files::is_known(path) {
            let remedy = "name a station file that has it in [program] (`ob1 new station` writes one), or a .mc7";
            return Err(format!(
                "{}: this is a source or a symbol table, not machine code\n  = {remedy}",
                path.display()
            ));
        } else {
            file(path, &mut blocks)?;
        }
    }
    Ok(blocks)
}

fn folder(path: &Path, blocks: &mut Blocks) -> Result<(), String> {
    let refused = |error: std::io::Error| format!("{}: {error}", path.display());
    let mut found = false;
    for entry in std::fs::read_dir(path).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mc7")) {
            file(&path, blocks)?;
            found = true;
        }
    }
    if found {
        return Ok(());
    }
    let remedy = "name a station file (.toml) to take its program; `ob1 upload` makes .mc7 of the blocks of a CPU";
    Err(format!("{}: it has no .mc7\n  = {remedy}", path.display()))
}

/// A file may hold several blocks, one after another.
fn file(path: &Path, blocks: &mut Blocks) -> Result<(), String> {
    let bytes = ob1_process::files::read(path, ob1_process::files::LONGEST)
        .map_err(|error| format!("{}: {error}", path.display()))?;
    let mut rest = bytes.as_slice();
    while !rest.is_empty() {
        let (block, length) = BlockImage::read(rest).map_err(|why| format!("{}: {why}", path.display()))?;
        let kind = block.head.block_kind().ok_or_else(|| format!("{}: system data", path.display()))?;
        let (bytes, after) = rest.split_at_checked(length).unwrap_or((rest, &[]));
        blocks.insert(name(BlockId::new(kind, block.head.number)), bytes.to_vec());
        rest = after;
    }
    Ok(())
}

/// The program of a station, as machine code.
fn station(path: &Path, blocks: &mut Blocks) -> Result<(), String> {
    let told = |findings: Vec<Finding>| findings.iter().map(ToString::to_string).collect::<String>();
    let asked = Asked::of_station(path).map_err(told)?;
    let (program, library) = (&asked.program, &asked.library);
    let callee = |id| library.get(id).map(|block| &block.interface);
    let code = program.blocks.iter().map(|block| block.id);
    let data = program.data.iter().map(|db| BlockId::new(BlockKind::Db, db.number));
    for id in code.chain(data) {
        let image = ob1_mc7::image(program, id, &callee).and_then(|image| image.bytes().ok());
        let image = image.ok_or_else(|| format!("{id} has a statement for which there is no machine code"))?;
        blocks.insert(name(id), image);
    }
    Ok(())
}

/// `FC5`, as files are named.
fn name(id: BlockId) -> String {
    format!("{}{}", id.kind.name(), id.number)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is not machine code is told with the way to it.
    #[test]
    fn a_source_and_a_folder_without_blocks_are_refused_with_the_remedy() {
        let folder = tempfile::tempdir().expect("a folder");
        let source = folder.path().join("main.awl");
        std::fs::write(&source, "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n").expect("room");
        let refused = |path: &Path| collect(&[path.to_owned()]).expect_err("no machine code");
        let said = refused(&source);
        assert!(said.contains("not machine code\n  = name a station file"), "{said}");
        let said = refused(folder.path());
        assert!(said.contains("it has no .mc7\n  = name a station file"), "{said}");
        assert!(refused(&folder.path().join("gone.awl")).contains("No such file"));
    }
}
