//! The janitor: a child process that removes what a station has published, should the runtime be killed.
//!
//! It holds the read end of a pipe whose write end only the runtime has, and waits for its end of file. It does nothing
//! else, so nothing can keep it from doing that. (docs/decisions/0003-janitor.md)

use std::io::{self, PipeWriter, Read as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::rundir;

/// How long the drivers get to remove what they have published themselves.
const GRACE: Duration = Duration::from_secs(3);
const STEP: Duration = Duration::from_millis(20);

/// The janitor of this runtime. Dropping it lets it finish and waits for it.
#[derive(Debug)]
pub struct Janitor {
    lifeline: Option<PipeWriter>,
    child: Child,
}

impl Janitor {
    /// Starts the janitor for a runtime directory and for links that drivers publish (ptys).
    ///
    /// # Errors
    /// What the system says.
    pub fn start(rundir: &Path, published: &[PathBuf]) -> io::Result<Self> {
        let (stdin, lifeline) = io::pipe()?;
        let child = Command::new(std::env::current_exe()?)
            .arg("janitor")
            .arg(rundir)
            .args(published)
            .stdin(stdin)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            // Out of reach of Ctrl-C and of a kill of the runtime's group.
            .process_group(0)
            .current_dir("/")
            .spawn()?;
        Ok(Self { lifeline: Some(lifeline), child })
    }
}

impl Drop for Janitor {
    fn drop(&mut self) {
        drop(self.lifeline.take());
        let _ = self.child.wait();
    }
}

/// The janitor's whole life: waits for end of file on stdin, then cleans up.
pub fn run(rundir: &Path, published: &[PathBuf]) {
    let runtime = rundir::owner(rundir);
    let mut ignored = [0; 64];
    let mut stdin = io::stdin().lock();
    while stdin.read(&mut ignored).is_ok_and(|read| read > 0) {}
    rundir::bury(rundir, &runtime, || remove_published(published));
}

/// Removes links the drivers have left. A living driver ends by the same end of file and removes its own.
fn remove_published(published: &[PathBuf]) {
    let mut waited = Duration::ZERO;
    loop {
        let left: Vec<&PathBuf> = published.iter().filter(|path| !removed(path)).collect();
        if left.is_empty() || waited >= GRACE {
            for path in left {
                let _ = std::fs::remove_file(path);
            }
            return;
        }
        std::thread::sleep(STEP);
        waited += STEP;
    }
}

/// Whether nothing of ours is there any more: removes a link that leads nowhere, leaves alone what is no link to a pty.
fn removed(path: &Path) -> bool {
    match std::fs::read_link(path) {
        Ok(target) if !target.starts_with("/dev/pts") => true,
        Ok(_) if path.exists() => false,
        Ok(_) => std::fs::remove_file(path).is_ok(),
        Err(_) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_dead_links_to_ptys_go() {
        let dir = tempfile::tempdir().expect("a directory");
        let path = |name: &str| dir.path().join(name);
        std::fs::write(path("file"), "").expect("a file");
        std::os::unix::fs::symlink("/dev/pts/999999", path("dead")).expect("a link");
        std::os::unix::fs::symlink("/nowhere", path("foreign")).expect("a link");
        remove_published(&[path("file"), path("dead"), path("foreign"), path("missing")]);
        assert!(path("file").exists());
        assert!(std::fs::symlink_metadata(path("dead")).is_err());
        assert!(std::fs::symlink_metadata(path("foreign")).is_ok());
    }
}
