//! Folders of STEP 7 projects: the example with changes given by the bytes, and files that consist of the bytes.

use std::sync::OnceLock;

use ob1_project::{Archive, FileSource as _, Files, Project, Table, Tree, Wanted, translate};
use ob1_stl::{Library, Mnemonics};

/// Reads a changed project like the command. The first byte chooses: an archive, a table, or changes of 4 bytes each
/// (file, place, value) to the example's folder.
pub fn run(data: &[u8]) {
    let Some((what, rest)) = data.split_first() else { return };
    match what % 8 {
        0 => {
            if let Ok(archive) = Archive::open(rest.to_vec()) {
                let paths = archive.paths();
                paths.iter().take(16).for_each(|path| drop(archive.read(path)));
            }
        }
        1 => {
            if let Ok(table) = Table::parse(rest.to_vec()) {
                assert!(table.rows().count() <= rest.len());
            }
        }
        _ => import(&changed(rest)),
    }
}

/// The folder of the example with changes.
fn changed(rest: &[u8]) -> Files {
    static EXAMPLE: OnceLock<Files> = OnceLock::new();
    let mut files = EXAMPLE.get_or_init(|| crate::step7::example().files()).clone();
    let names: Vec<String> = files.0.keys().cloned().collect();
    for change in rest.chunks_exact(4).take(64) {
        let [file, high, low, value] = [change[0], change[1], change[2], change[3]];
        let name = &names[usize::from(file) % names.len()];
        let Some(bytes) = files.0.get_mut(name).filter(|bytes| !bytes.is_empty()) else { continue };
        let at = usize::from(u16::from_be_bytes([high, low])) % bytes.len();
        match (file, value) {
            (0..224, _) => bytes[at] = value,
            (224..240, _) => bytes.truncate(at),
            _ => drop(files.0.remove(name)),
        }
    }
    files
}

fn import(files: &Files) {
    let tree = Tree::new(files);
    for root in tree.roots() {
        let project = Project::read(&tree, &root);
        for choice in project.choices() {
            let mut notes = Vec::new();
            let _ = (project.title(choice), project.symbols(&tree, choice, &mut notes), project.sources(&tree, choice));
            let Ok(folder) = project.blocks(&tree, choice) else { continue };
            let wanted = Wanted {
                page: project.page,
                library: &Library::new(),
                replaced: &std::collections::BTreeSet::new(),
                symbols: Vec::new(),
                mnemonics: Mnemonics::International,
            };
            let translation = translate(&folder, &wanted);
            assert!(translation.decoded <= translation.blocks && translation.printed <= translation.blocks);
        }
    }
}
