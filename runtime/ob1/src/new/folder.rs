//! Writing the folder: whole, or not at all.

use std::fs::Permissions;
use std::io::{self, ErrorKind};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use super::{REFUSED, Refusal, TAKEN};
use crate::exit::Exit;

/// A file of the new folder.
#[derive(Debug)]
pub(super) struct File {
    /// Its path in the folder.
    pub(super) name: String,
    /// What it is for.
    pub(super) what: &'static str,
    pub(super) text: String,
    is_program: bool,
}

impl File {
    pub(super) fn new(name: impl Into<String>, what: &'static str, text: String) -> Self {
        Self { name: name.into(), what, text, is_program: false }
    }

    /// One that can be run.
    pub(super) fn program(name: impl Into<String>, what: &'static str, text: String) -> Self {
        Self { is_program: true, ..Self::new(name, what, text) }
    }
}

/// Makes the folder and fills it. Making it also proves that nothing of any kind was there.
pub(super) fn write(path: &Path, files: &[File]) -> Result<(), Refusal> {
    if let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).map_err(|error| refused(parent, &error))?;
    }
    std::fs::create_dir(path).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => {
            let remedy = "name another folder, or move this one away; nothing was written";
            Refusal::new(Exit::Usage, TAKEN, path, "it exists already", remedy)
        }
        _ => refused(path, &error),
    })?;
    fill(path, files).map_err(|error| {
        // An incomplete folder must not stay: it could be run.
        let _ = std::fs::remove_dir_all(path);
        refused(path, &error)
    })
}

fn fill(path: &Path, files: &[File]) -> io::Result<()> {
    for file in files {
        let target = path.join(&file.name);
        if let Some(folder) = target.parent() {
            std::fs::create_dir_all(folder)?;
        }
        std::fs::write(&target, &file.text)?;
        if file.is_program {
            std::fs::set_permissions(&target, Permissions::from_mode(0o755))?;
        }
    }
    Ok(())
}

fn refused(path: &Path, error: &io::Error) -> Refusal {
    let remedy = "choose a folder this user may write to, on a disk with room; nothing was written";
    Refusal::new(Exit::System, REFUSED, path, format!("it cannot be written: {error}"), remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files() -> Vec<File> {
        vec![File::new("a", "", "1".into()), File::new("b/c", "", "2".into())]
    }

    #[test]
    fn whatever_lies_there_stays() {
        let base = tempfile::tempdir().expect("a directory");
        let at = |name: &str| base.path().join(name);
        std::fs::create_dir(at("empty")).expect("made");
        std::fs::write(at("file"), "mine").expect("written");
        std::os::unix::fs::symlink("nowhere", at("link")).expect("linked");
        for name in ["empty", "file", "link"] {
            let refusal = write(&at(name), &files()).expect_err(name);
            assert_eq!(refusal.finding.code, TAKEN, "{name}");
        }
        assert_eq!(std::fs::read_to_string(at("file")).expect("there"), "mine");
        assert_eq!(std::fs::read_dir(at("empty")).expect("there").count(), 0);
        assert!(!at("nowhere").exists());
        write(&at("deep/new"), &files()).expect("nothing lies there");
        assert_eq!(std::fs::read_to_string(at("deep/new/b/c")).expect("there"), "2");
    }

    #[test]
    fn half_a_folder_is_taken_away() {
        let base = tempfile::tempdir().expect("a directory");
        // The second file wants a folder where the first one is a file.
        let files = [File::new("a", "", String::new()), File::new("a/b", "", String::new())];
        let refusal = write(&base.path().join("new"), &files).expect_err("no room for both");
        assert_eq!((refusal.finding.code.as_str(), refusal.exit), (REFUSED, Exit::System));
        assert!(!base.path().join("new").exists());
        let refusal = write(Path::new("/proc/ob1/new"), &files).expect_err("nobody writes there");
        assert_eq!(refusal.finding.code, REFUSED);
    }
}
