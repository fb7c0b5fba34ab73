//! The tree of files that is packed: every file with its mode, without information about the build machine.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::cargo;
use crate::failure::{Failure, Outcome, step};
use crate::shell;

/// The tree and its files: paths from its root with their modes, sorted.
pub(super) struct Stage {
    pub(super) root: PathBuf,
    pub(super) files: BTreeMap<String, u32>,
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> Failure + '_ {
    move |why| step(format!("{}: {why}", path.display()))
}

impl Stage {
    /// An empty tree; removes an old one.
    pub(super) fn new(root: PathBuf) -> Outcome<Self> {
        if root.exists() {
            fs::remove_dir_all(&root).map_err(at(&root))?;
        }
        fs::create_dir_all(&root).map_err(at(&root))?;
        Ok(Self { root, files: BTreeMap::new() })
    }

    /// Adds a file with these bytes. Programs are 0755, everything else 0644.
    pub(super) fn put(&mut self, to: &str, bytes: &[u8], mode: u32) -> Outcome {
        let path = self.root.join(to);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(at(folder))?;
        }
        fs::write(&path, bytes).map_err(at(&path))?;
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).map_err(at(&path))?;
        self.files.insert(to.to_owned(), mode);
        Ok(())
    }

    pub(super) fn copy(&mut self, from: &Path, to: &str) -> Outcome {
        let bytes = fs::read(from).map_err(at(from))?;
        self.put(to, &bytes, 0o644)
    }

    /// Adds a program or library without debug information.
    pub(super) fn object(&mut self, from: &Path, to: &str, mode: u32) -> Outcome {
        self.copy(from, to)?;
        let path = self.root.join(to);
        shell::run(Command::new("strip").args(["--strip-unneeded", "--remove-section=.comment"]).arg(&path))?;
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).map_err(at(&path))?;
        self.files.insert(to.to_owned(), mode);
        Ok(())
    }

    /// Adds a folder with everything below it.
    pub(super) fn folder(&mut self, from: &Path, to: &str) -> Outcome {
        let entries = fs::read_dir(from).map_err(at(from))?;
        for entry in entries {
            let path = entry.map_err(at(from))?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let to = format!("{to}/{name}");
            if path.is_dir() { self.folder(&path, &to)? } else { self.copy(&path, &to)? }
        }
        Ok(())
    }

    /// Adds the files of a folder of the checkout that git knows.
    pub(super) fn tracked(&mut self, folder: &str, to: &str) -> Outcome {
        let names = shell::read(Command::new("git").args(["ls-files", folder]).current_dir(cargo::root()))?;
        for name in names.lines() {
            let below = name.strip_prefix(folder).unwrap_or(name).trim_start_matches('/');
            self.copy(&cargo::root().join(name), &format!("{to}/{below}"))?;
        }
        Ok(())
    }

    /// Size of all files in KiB, as Debian counts it.
    pub(super) fn kib(&self) -> Outcome<u64> {
        let mut sum = 0;
        for name in self.files.keys() {
            let path = self.root.join(name);
            sum += fs::metadata(&path).map_err(at(&path))?.len().div_ceil(1024);
        }
        Ok(sum)
    }

    /// Sets the same date for all files and folders, so that two runs give the same archive.
    pub(super) fn date(root: &Path, epoch: u64) -> Outcome {
        shell::run(Command::new("find").arg(root).args(["-exec", "touch", "--no-dereference", "--date"]).args([
            &format!("@{epoch}"),
            "{}",
            "+",
        ]))?;
        shell::run(Command::new("find").arg(root).args(["-type", "d", "-exec", "chmod", "0755", "{}", "+"]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_holds_what_was_put_and_nothing_older() {
        let base = cargo::target_dir().expect("cargo answers").join(format!("stage-test-{}", std::process::id()));
        let mut stage = Stage::new(base.clone()).expect("made");
        stage.put("usr/bin/b", &[0; 1025], 0o755).expect("written");
        stage.put("usr/a", b"x", 0o644).expect("written");
        assert_eq!(stage.files.keys().collect::<Vec<_>>(), ["usr/a", "usr/bin/b"]);
        assert_eq!(stage.kib().expect("there"), 3);
        assert_eq!(fs::metadata(base.join("usr/bin/b")).expect("there").permissions().mode() & 0o777, 0o755);
        stage.tracked("include", "usr/include").expect("git answers");
        assert!(stage.files.contains_key("usr/include/ob1.h"));
        let again = Stage::new(base.clone()).expect("made anew");
        assert!(again.files.is_empty() && !base.join("usr").exists());
        fs::remove_dir_all(&base).expect("removed");
    }
}
