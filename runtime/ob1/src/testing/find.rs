//! Finding test files.

use std::path::{Path, PathBuf};

use ob1_station_file::program_files::TEST_FILE;

/// Folders deeper than this are not searched: links may go in circles.
const DEPTH: usize = 16;

/// The test files that `paths` name: files as they are, folders searched for `*.test.toml`, hidden ones and `target`
/// left out.
///
/// # Errors
/// A path that does not exist or cannot be read.
pub fn find_tests(paths: &[PathBuf]) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() {
            search(path, DEPTH, &mut found).map_err(|error| format!("{}: {error}", path.display()))?;
        } else if path.exists() {
            found.push(path.clone());
        } else {
            return Err(format!("{}: there is no such file or folder", path.display()));
        }
    }
    found.dedup();
    Ok(found)
}

fn search(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with('.') || name == "target" {
            continue;
        }
        if path.is_dir() && depth > 0 {
            search(&path, depth - 1, found)?;
        } else if name.ends_with(TEST_FILE) {
            // "./" in front says nothing.
            found.push(path.strip_prefix(".").map(Path::to_owned).unwrap_or(path));
        }
    }
    Ok(())
}
