//! Files and folders that are a program: which are sources, which symbol tables.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Extensions of sources, including those in languages that are recognised and refused.
const SOURCES: [&str; 7] = ["awl", "stl", "db", "udt", "scl", "gr7", "inp"];

/// Extensions of symbol tables.
const TABLES: [&str; 4] = ["sdf", "asc", "seq", "dif"];

/// What the name of a test file ends with.
pub const TEST_FILE: &str = ".test.toml";

/// Files a folder is looked into for.
const MOST: usize = 100_000;

/// The files that a list of files and folders names, sources and symbol tables apart, in the order of their names
/// within a folder. A file that is named is a source, unless it bears the extension of a symbol table.
pub fn expand(files: &[PathBuf], symbols: &[PathBuf]) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let (mut sources, mut tables) = (Vec::new(), symbols.to_vec());
    for path in files {
        let is_folder = path.is_dir();
        let found = if is_folder { within(path) } else { vec![path.clone()] };
        for file in found {
            match kind(&file) {
                Some(false) if !tables.contains(&file) => tables.push(file),
                Some(false) => {}
                Some(true) => sources.push(file),
                None if is_folder => {}
                None => sources.push(file),
            }
        }
    }
    (sources, tables)
}

/// True for a source or a symbol table, by its extension.
#[must_use]
pub fn is_known(path: &Path) -> bool {
    kind(path).is_some()
}

/// The files of folders that look like tag tables of TIA Portal in forms that are not read: Excel and XML.
#[must_use]
pub fn unread_tables(files: &[PathBuf]) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = files.iter().filter(|path| path.is_dir()).flat_map(|path| within(path)).collect();
    found.retain(|path| {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        extension == "xlsx" || extension == "xml" && beginning(path).is_some_and(|text| text.contains("<Tagtable"))
    });
    found
}

/// The first bytes of a file.
fn beginning(path: &Path) -> Option<String> {
    if !path.is_file() {
        return None;
    }
    let mut begin = Vec::new();
    File::open(path).and_then(|file| file.take(4096).read_to_end(&mut begin)).ok()?;
    Some(String::from_utf8_lossy(&begin).into_owned())
}

/// True for a source, false for a symbol table.
fn kind(path: &Path) -> Option<bool> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    if SOURCES.contains(&extension.as_str()) {
        return Some(true);
    }
    if extension == "xml" {
        // Of the many XML files only those with blocks count.
        return beginning(path)?.contains("<SW.").then_some(true);
    }
    TABLES.contains(&extension.as_str()).then_some(false)
}

/// All files below a folder, in order. Links are not followed.
fn within(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for entry in entries.flatten() {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                Ok(kind) if kind.is_file() => files.push(entry.path()),
                _ => {}
            }
        }
        if files.len() > MOST {
            break;
        }
    }
    files.sort();
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_gives_its_sources_and_tables() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("made");
            std::fs::write(&path, text).expect("written");
            path
        };
        let main = write("main.AWL", "");
        let data = write("sub/data.db", "");
        let table = write("symbols.sdf", "");
        let block = write("sub/x.xml", "<?xml?><Document><SW.Blocks.FC>");
        write("note.txt", "");
        write("other.xml", "<?xml?>");
        let tags = [write("sub/tags.xml", "<?xml?>\n<Tagtable name='Tags'>"), write("tags.XLSX", "PK")];
        assert_eq!(unread_tables(&[folder.path().to_owned(), main.clone()]), tags);
        let (sources, tables) = expand(&[folder.path().to_owned()], &[]);
        assert_eq!((sources, tables), (vec![main.clone(), data, block], vec![table.clone()]));
        // Each file that is named counts; a symbol table once.
        let note = folder.path().join("note.txt");
        let named = [main.clone(), table.clone(), note.clone()];
        let expected = (vec![main, note], vec![table.clone()]);
        assert_eq!(expand(&named, &[]), expected);
        assert_eq!(expand(&named, &[table]), expected);
    }
}
