//! Where a project's files come from: a folder, an archive, a test's memory. This crate never touches the disk.

use std::collections::BTreeMap;
use std::fmt;

/// Files by path. Paths have `/` between their parts and keep the case they were written in.
pub trait FileSource: fmt::Debug {
    /// All files there are, as paths from the source's root.
    fn paths(&self) -> Vec<String>;

    /// The bytes of one of [`FileSource::paths`].
    ///
    /// # Errors
    /// Why it cannot be read, in one sentence.
    fn read(&self, path: &str) -> Result<Vec<u8>, String>;
}

/// Files that lie in memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Files(pub BTreeMap<String, Vec<u8>>);

impl Files {
    /// Adds a file; what had the path before is replaced.
    pub fn put(&mut self, path: &str, bytes: impl Into<Vec<u8>>) {
        self.0.insert(path.to_owned(), bytes.into());
    }
}

impl FileSource for Files {
    fn paths(&self) -> Vec<String> {
        self.0.keys().cloned().collect()
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        self.0.get(path).cloned().ok_or_else(|| "there is no such file".to_owned())
    }
}

/// A file source whose paths are found without regard to case: `hOmSave7` and `HOMSAVE7` are one folder, as they are
/// on the file systems STEP 7 writes to.
#[derive(Debug)]
pub struct Tree<'s> {
    source: &'s dyn FileSource,
    /// Paths in small letters, to the path as it is written.
    names: BTreeMap<String, String>,
}

/// A project or library in a tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Root {
    /// The folder, with a `/` at its end; empty for the tree's own root.
    pub folder: String,
    /// The `.s7p` or `.s7l`, from the tree's root; `None` where only the block folders are left.
    pub file: Option<String>,
}

impl<'s> Tree<'s> {
    /// The files of a source.
    pub fn new(source: &'s dyn FileSource) -> Self {
        let names = source.paths().into_iter().map(|path| (key(&path), path)).collect();
        Self { source, names }
    }

    /// The bytes of a file; `None` when there is none of this name or it cannot be read.
    pub fn read(&self, path: &str) -> Option<Vec<u8>> {
        self.source.read(self.names.get(&key(path))?).ok()
    }

    /// Why a file gives no bytes: that it is missing, or what stands in the way of reading it.
    pub fn why_not(&self, path: &str) -> String {
        let found = self.names.get(&key(path)).map(|path| self.source.read(path));
        found.and_then(Result::err).unwrap_or_else(|| "the file is missing".to_owned())
    }

    /// True when there is such a file.
    pub fn has(&self, path: &str) -> bool {
        self.names.contains_key(&key(path))
    }

    /// The parts that follow `folder` (which ends in `/`) in the paths below it, each once: files and folders.
    pub fn list(&self, folder: &str) -> Vec<String> {
        let start = key(folder);
        let below = self.names.range(start.clone()..).take_while(|(name, _)| name.starts_with(&start));
        let mut parts: Vec<String> =
            below.filter_map(|(_, path)| path.get(start.len()..)?.split(SLASHES).next().map(str::to_owned)).collect();
        parts.dedup_by(|a, b| a.eq_ignore_ascii_case(b));
        parts
    }

    /// The projects and libraries: folders with a `.s7p` or `.s7l`; without any, folders with block folders.
    pub fn roots(&self) -> Vec<Root> {
        let mut roots: Vec<Root> = Vec::new();
        for (name, path) in &self.names {
            // `._plant.s7p` is what a Mac puts beside a file of an archive.
            let is_mac = name.rsplit('/').next().is_some_and(|file| file.starts_with("._"));
            if (name.ends_with(".s7p") || name.ends_with(".s7l")) && !is_mac {
                let folder = path.get(..name.rfind('/').map_or(0, |at| at + 1)).unwrap_or_default().to_owned();
                if !roots.iter().any(|root| root.folder.eq_ignore_ascii_case(&folder)) {
                    roots.push(Root { folder, file: Some(path.clone()) });
                }
            }
        }
        if roots.is_empty() {
            for (name, path) in &self.names {
                let Some(at) = name.find("ombstx/offline/").filter(|at| *at == 0 || name[..*at].ends_with('/')) else {
                    continue;
                };
                let folder = path.get(..at).unwrap_or_default().to_owned();
                if !roots.iter().any(|root| root.folder.eq_ignore_ascii_case(&folder)) {
                    roots.push(Root { folder, file: None });
                }
            }
        }
        roots
    }
}

/// What ends a folder's name: an archive of Windows that was unpacked elsewhere may have left the second one.
const SLASHES: [char; 2] = ['/', '\\'];

/// ASCII letters alone: the lengths stay, and STEP 7's own names are ASCII.
fn key(path: &str) -> String {
    path.replace('\\', "/").to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_in_any_case() {
        let mut files = Files::default();
        files.put("Plant/Plant.S7P", "x");
        files.put("Plant/OMBSTX/offline/0000000A/SUBBLK.DBF", "y");
        files.put("Plant/ombstx/OFFLINE/0000000a/subblk.dbt", "z");
        let tree = Tree::new(&files);
        assert_eq!(tree.read("plant/ombstx/offline/0000000a/SubBlk.dbf").as_deref(), Some(&b"y"[..]));
        assert!(tree.has("PLANT/PLANT.s7p") && !tree.has("plant"));
        assert_eq!(tree.list("plant/ombstx/offline/").len(), 1);
        let roots = tree.roots();
        assert_eq!((roots.len(), roots[0].folder.as_str()), (1, "Plant/"));
        files.put("__MACOSX/Plant/._Plant.S7P", "z");
        assert_eq!(Tree::new(&files).roots(), roots);
        files.0.remove("Plant/Plant.S7P");
        let roots = Tree::new(&files).roots();
        assert_eq!((roots.len(), roots[0].folder.as_str(), roots[0].file.is_none()), (1, "Plant/", true));
    }

    #[test]
    fn a_folder_ends_at_either_slash() {
        let mut files = Files::default();
        files.put("Plant\\Plant.s7p", "x");
        files.put("Plant\\Global\\Language", "y");
        let tree = Tree::new(&files);
        let roots = tree.roots();
        let folder = &roots[0].folder;
        assert_eq!(tree.read(&format!("{folder}Global/Language")).as_deref(), Some(&b"y"[..]));
        assert_eq!(tree.list(folder), ["Global", "Plant.s7p"]);
    }
}
