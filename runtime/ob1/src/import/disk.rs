//! A project on the disk: its folder, its `.s7p` or `.s7l`, or an archive of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ob1_project::{Archive, FileSource, LONGEST_FILE};

/// The deepest folder that is looked into: a project's own files lie four deep.
const DEEPEST: u32 = 8;
/// More than any archive of a project, in bytes.
const LONGEST_ARCHIVE: u64 = 1 << 30;
/// Most files that are listed.
const MOST: usize = 200_000;

/// The files below a folder.
#[derive(Debug)]
struct Folder {
    root: PathBuf,
    /// Each path as text, and as the system has it: names that were unpacked in another code page are not UTF-8.
    paths: BTreeMap<String, PathBuf>,
}

impl FileSource for Folder {
    fn paths(&self) -> Vec<String> {
        self.paths.keys().cloned().collect()
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        let path = self.paths.get(path).ok_or("there is no such file")?;
        ob1_process::files::read(&self.root.join(path), LONGEST_FILE).map_err(|error| error.to_string())
    }
}

/// True for a path that ends in `.s7p` or `.s7l` and is no folder.
pub(super) fn is_project_file(path: &Path) -> bool {
    let is = |ending: &str| path.extension().is_some_and(|end| end.eq_ignore_ascii_case(ending));
    (is("s7p") || is("s7l")) && !path.is_dir()
}

/// Opens what the command line names.
///
/// # Errors
/// Why it cannot be read, in one sentence.
pub(super) fn open(path: &Path) -> Result<Box<dyn FileSource>, String> {
    let named = |error: String| format!("{}: {error}", path.display());
    let kind = std::fs::metadata(path).map_err(|error| named(error.to_string()))?;
    if kind.is_dir() {
        return folder(path).map_err(named);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "s7p" | "s7l" => folder(path.parent().filter(|p| *p != Path::new("")).unwrap_or(Path::new("."))).map_err(named),
        "zip" => {
            let bytes = ob1_process::files::read(path, LONGEST_ARCHIVE).map_err(|error| named(error.to_string()))?;
            Ok(Box::new(Archive::open(bytes).map_err(named)?))
        }
        _ => Err(named(match other(&path.to_string_lossy()) {
            Some(what) => format!("it is {what}"),
            None => "it is neither a project's folder, nor its .s7p or .s7l, nor a .zip of it".to_owned(),
        })),
    }
}

/// What a file is that is no project of STEP 7 V5, by its ending, and what to do with it.
pub(super) fn other(path: &str) -> Option<&'static str> {
    let ending = path.rsplit_once('.')?.1.to_ascii_lowercase();
    // `.ap16`, `.zap15_1`; `.al16` and `.zal16` are libraries.
    let start = ending.trim_end_matches(|c: char| c.is_ascii_digit() || c == '_');
    match start {
        "ap" | "zap" | "al" | "zal" if start.len() < ending.len() => {
            Some("of TIA Portal: generate sources from its blocks there, and check them (docs/porting.md)")
        }
        "zip" | "arj" | "lha" | "lzh" | "rar" | "7z" => Some("an archive: unpack it, and import the folder"),
        _ => None,
    }
}

fn folder(root: &Path) -> Result<Box<dyn FileSource>, String> {
    let mut paths = BTreeMap::new();
    walk(root, Path::new(""), 0, &mut paths)?;
    Ok(Box::new(Folder { root: root.to_owned(), paths }))
}

/// Lists files; links are not followed, a folder that cannot be read is skipped unless it is the first.
fn walk(root: &Path, below: &Path, depth: u32, paths: &mut BTreeMap<String, PathBuf>) -> Result<(), String> {
    let entries = std::fs::read_dir(root.join(below)).map_err(|error| error.to_string())?;
    for entry in entries.flatten() {
        let (Ok(kind), name) = (entry.file_type(), entry.file_name()) else { continue };
        let path = below.join(&name);
        if kind.is_file() && paths.len() < MOST {
            paths.insert(path.to_string_lossy().into_owned(), path);
        } else if kind.is_dir() && depth < DEEPEST && !name.to_string_lossy().starts_with('.') {
            let _ = walk(root, &path, depth + 1, paths);
        }
    }
    Ok(())
}
