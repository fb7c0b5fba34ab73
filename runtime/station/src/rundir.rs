//! The runtime directory of a station: the control socket, links to what tools may open, and the proof that the station
//! lives.
//!
//! `$XDG_RUNTIME_DIR/ob1/NAME`, or `/run/ob1/NAME` for root and for the user who owns `/run/ob1`, or
//! `/run/ob1-UID/NAME` for a user root has dropped to, or `/tmp/ob1-UID/NAME`; mode 0700. In it: `control.sock`
//! (0600), `io` and `MODULE.segment` (links to `/proc/PID/fd/N`), and `pid`. Whoever holds the lock on `pid` owns the
//! directory: the lock ends with its process, however that ends, so an unlocked directory is a leftover.

use std::ffi::{OsStr, OsString};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};

/// Where root's stations are, or those of the user to whom an installation gives this directory.
const INSTALLED: &str = "/run/ob1";
/// Name of the control socket in the directory.
pub const SOCKET: &str = "control.sock";
/// Name of the socket for recordings.
pub const RECORD: &str = "record.sock";
/// Name of the process I/O image.
pub const IO: &str = "io";
const PID: &str = "pid";
/// How often a directory is tried whose owner may vanish between two looks. With [`STEP`] in between, this is also how
/// long a dead runtime and its guardian are waited for: 5 s.
const ATTEMPTS: usize = 500;
const STEP: Duration = Duration::from_millis(10);

/// Why there is no runtime directory.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// The station runs already.
    #[error("the station \"{name}\" runs already, as process {pid} (directory {})", .path.display())]
    Running {
        /// Name of the station.
        name: String,
        /// Its process, as it says itself.
        pid: String,
        /// Directory of the station that runs.
        path: PathBuf,
    },
    /// The directory belongs to somebody else or is open to others.
    #[error("{} is not a directory that only this user can use; remove it, or set XDG_RUNTIME_DIR", .0.display())]
    Foreign(PathBuf),
    /// The system refused to make, lock or write it.
    #[error("runtime directory {}: {source}", .path.display())]
    Io {
        /// The path that was touched.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

fn at(path: &Path) -> impl FnOnce(io::Error) -> RunDirError + '_ {
    move |source| RunDirError::Io { path: path.to_owned(), source }
}

/// The directories a station's directory may lie in, the preferred one first.
#[must_use]
pub fn bases() -> Vec<PathBuf> {
    let user = rustix::process::getuid();
    let mut bases = Vec::new();
    if let Some(dir) = std::env::var_os("XDG_RUNTIME_DIR").filter(|d| Path::new(d).is_absolute()) {
        bases.push(PathBuf::from(dir).join("ob1"));
    }
    let installed = Path::new(INSTALLED);
    if user.is_root() || fs::metadata(installed).is_ok_and(|found| found.uid() == user.as_raw()) {
        bases.push(installed.to_owned());
    }
    let prepared = prepared_for(user.as_raw());
    if prepared.is_dir() {
        bases.push(prepared);
    }
    bases.push(PathBuf::from(format!("/tmp/ob1-{}", user.as_raw())));
    bases
}

/// What root makes for a user that could not make it itself.
fn prepared_for(uid: u32) -> PathBuf {
    PathBuf::from(format!("/run/ob1-{uid}"))
}

/// For root, before it becomes that user: a directory for its stations. Without it there is the one in `/tmp`.
pub fn prepare_for(user: &ob1_process::User) {
    let path = prepared_for(user.uid);
    if DirBuilder::new().mode(0o700).create(&path).is_ok() {
        let _ = std::os::unix::fs::lchown(&path, Some(user.uid), Some(user.gid));
    }
}

/// The directory of a running station, for tools: the first base that has its socket.
#[must_use]
pub fn find(name: &str) -> Option<PathBuf> {
    bases().into_iter().map(|base| base.join(name)).find(|dir| dir.join(SOCKET).exists())
}

/// The stations that run, by name, each with its directory: of two bases the first counts, as for [`find`].
#[must_use]
pub fn running() -> Vec<(String, PathBuf)> {
    let mut all = std::collections::BTreeMap::new();
    for base in bases() {
        for entry in fs::read_dir(base).into_iter().flatten().flatten() {
            let path = entry.path();
            if let Ok(name) = entry.file_name().into_string()
                && path.join(SOCKET).exists()
            {
                all.entry(name).or_insert(path);
            }
        }
    }
    all.into_iter().collect()
}

/// The directories that are looked into, in words.
#[must_use]
pub fn listed() -> String {
    bases().iter().map(|base| base.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// The runtime directory, owned. Dropping it removes it.
#[derive(Debug)]
pub struct RunDir {
    path: PathBuf,
    lock: File,
    /// What is published: names, and where they lead.
    links: Vec<(OsString, PathBuf)>,
}

impl RunDir {
    /// Makes the directory of a station, or takes over what a dead runtime has left.
    ///
    /// # Errors
    /// [`RunDirError`]: the station runs already, or no directory can be made or is safe to use.
    pub fn claim(name: &str) -> Result<Self, RunDirError> {
        let mut last = None;
        for base in bases() {
            match private_dir(&base) {
                Ok(()) => return Self::claim_in(&base, name),
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or(RunDirError::Foreign(PathBuf::from("/tmp"))))
    }

    /// The same below a given directory.
    ///
    /// # Errors
    /// [`RunDirError`]: the station runs already, or the directory cannot be made or is not safe to use.
    pub fn claim_in(base: &Path, name: &str) -> Result<Self, RunDirError> {
        let path = base.join(name);
        for _ in 0..ATTEMPTS {
            private_dir(&path)?;
            let Some(lock) = lock_of(&path)? else {
                let pid = owner(&path);
                // A runtime that was killed a moment ago, or its guardian at work.
                if !lives(&pid) {
                    std::thread::sleep(STEP);
                    continue;
                }
                return Err(RunDirError::Running { name: name.to_owned(), pid, path });
            };
            // A guardian may have removed the directory between our opening and our locking.
            if !still_there(&path, &lock) {
                continue;
            }
            sweep(&path);
            let mut owned = Self { path, lock, links: Vec::new() };
            owned.write_pid()?;
            return Ok(owned);
        }
        Err(RunDirError::Io { path, source: io::Error::other("others keep creating and removing it") })
    }

    fn write_pid(&mut self) -> Result<(), RunDirError> {
        let file = &mut self.lock;
        file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id())).map_err(at(&self.path))
    }

    /// The directory of this station.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the control socket goes.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.path.join(SOCKET)
    }

    /// Publishes `target` (a `/proc/PID/fd/N`) under a name.
    ///
    /// # Errors
    /// [`RunDirError::Io`]: there is something of this name, or the directory is gone.
    pub fn link(&mut self, name: impl AsRef<OsStr>, target: &Path) -> Result<(), RunDirError> {
        let link = self.path.join(name.as_ref());
        std::os::unix::fs::symlink(target, &link).map_err(at(&link))?;
        self.links.push((name.as_ref().to_owned(), target.to_owned()));
        Ok(())
    }

    /// Makes again what others have removed: the end of a login takes `XDG_RUNTIME_DIR` away, and temporary folders are
    /// cleaned up. True: something was missing, and the control socket is to be opened again.
    ///
    /// # Errors
    /// [`RunDirError`]; [`RunDirError::Running`] when another process has claimed the directory meanwhile.
    pub fn restore(&mut self) -> Result<bool, RunDirError> {
        let there = |name: &OsStr| fs::symlink_metadata(self.path.join(name)).is_ok();
        let owned = still_there(&self.path, &self.lock);
        if owned && there(OsStr::new(SOCKET)) && self.links.iter().all(|(name, _)| there(name)) {
            return Ok(false);
        }
        if !owned {
            if let Some(base) = self.path.parent() {
                private_dir(base)?;
            }
            private_dir(&self.path)?;
            let Some(lock) = lock_of(&self.path)? else {
                let name = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                return Err(RunDirError::Running { name, pid: owner(&self.path), path: self.path.clone() });
            };
            self.lock = lock;
            self.write_pid()?;
        }
        for (name, target) in &self.links {
            let link = self.path.join(name);
            match std::os::unix::fs::symlink(target, &link) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                outcome => outcome.map_err(at(&link))?,
            }
        }
        Ok(true)
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        // Others may have removed it, and another runtime may have made it again.
        if still_there(&self.path, &self.lock) {
            remove(&self.path);
        }
    }
}

/// Makes a directory of mode 0700, or checks that the one there is ours and no link.
fn private_dir(path: &Path) -> Result<(), RunDirError> {
    loop {
        match DirBuilder::new().recursive(false).mode(0o700).create(path) {
            Ok(()) => return Ok(()),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(source) => return Err(at(path)(source)),
        }
        match is_ours(path) {
            Ok(true) => return Ok(()),
            Ok(false) => return Err(RunDirError::Foreign(path.to_owned())),
            // The guardian of a runtime that was killed has removed it between the two looks.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(source) => return Err(at(path)(source)),
        }
    }
}

/// Whether this is a directory of this user's; its mode is made 0700.
fn is_ours(path: &Path) -> io::Result<bool> {
    let found = fs::symlink_metadata(path)?;
    let ours = found.is_dir() && found.uid() == rustix::process::getuid().as_raw();
    if ours && found.permissions().mode() & 0o077 != 0 {
        fs::set_permissions(path, fs::Permissions::from_mode(0o700))?;
    }
    Ok(ours)
}

/// The lock of a directory; `None` while somebody else holds it.
fn lock_of(dir: &Path) -> Result<Option<File>, RunDirError> {
    let path = dir.join(PID);
    let nofollow = rustix::fs::OFlags::NOFOLLOW.bits() as i32;
    let opened = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .custom_flags(nofollow)
        .open(&path);
    let file = match opened {
        Ok(file) => file,
        // Removed under our feet: the caller makes it again.
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            private_dir(dir)?;
            return lock_of(dir);
        }
        Err(source) => return Err(at(&path)(source)),
    };
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Some(file)),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
        Err(errno) => Err(at(&path)(errno.into())),
    }
}

/// Whether the locked file is still the one under its name.
fn still_there(dir: &Path, lock: &File) -> bool {
    let (Ok(named), Ok(held)) = (fs::metadata(dir.join(PID)), lock.metadata()) else { return false };
    (named.dev(), named.ino()) == (held.dev(), held.ino())
}

/// Removes what a dead owner has left; the lock stays.
fn sweep(dir: &Path) {
    let Ok(entries) = fs::read_dir(dir) else { return };
    for entry in entries.flatten().filter(|e| e.file_name() != PID) {
        let _ = fs::remove_file(entry.path());
    }
}

/// Removes a directory its caller owns.
fn remove(dir: &Path) {
    sweep(dir);
    // The lock last: until then nobody else begins.
    let _ = fs::remove_file(dir.join(PID));
    let _ = fs::remove_dir(dir);
}

/// The process that owns a directory, as it says itself; empty while it is being claimed or buried.
pub(crate) fn owner(dir: &Path) -> String {
    fs::read_to_string(dir.join(PID)).unwrap_or_default().trim().to_owned()
}

/// Whether there is a process of this number.
fn lives(pid: &str) -> bool {
    let pid = pid.parse().ok().filter(|pid| *pid > 0).and_then(Pid::from_raw);
    pid.is_some_and(|pid| test_kill_process(pid) != Err(Errno::SRCH))
}

/// For the guardian: takes the directory of the runtime `dead` over and keeps it while `work` runs; then removes it.
/// False if it has a living owner or its lock is not released.
///
/// A dying process closes its files in no useful order: the guardian may know of its end before the lock is gone.
pub(crate) fn remove_of_dead(dir: &Path, dead: &str, work: impl FnOnce()) -> bool {
    for _ in 0..ATTEMPTS {
        if fs::symlink_metadata(dir).is_err() {
            work();
            return true;
        }
        match lock_of(dir) {
            Ok(Some(lock)) if still_there(dir, &lock) => {
                // It belongs to nobody now; a runtime that wants it waits.
                let _ = lock.set_len(0);
                work();
                remove(dir);
                return true;
            }
            Ok(Some(_)) | Err(_) => return false,
            Ok(None) => {
                let now = owner(dir);
                if now != dead && lives(&now) {
                    return false;
                }
                std::thread::sleep(STEP);
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_owner_at_a_time() {
        let base = tempfile::tempdir().expect("a directory");
        let first = RunDir::claim_in(base.path(), "s").expect("free");
        assert_eq!(fs::metadata(first.path()).expect("there").permissions().mode() & 0o777, 0o700);
        match RunDir::claim_in(base.path(), "s") {
            Err(RunDirError::Running { pid, .. }) => assert_eq!(pid, std::process::id().to_string()),
            other => panic!("{other:?}"),
        }
        let path = first.path().to_owned();
        drop(first);
        assert!(!path.exists());
        RunDir::claim_in(base.path(), "s").expect("free again");
    }

    #[test]
    fn leftovers_are_swept() {
        let base = tempfile::tempdir().expect("a directory");
        let dir = base.path().join("s");
        private_dir(&dir).expect("made");
        fs::write(dir.join(SOCKET), "").expect("a leftover");
        fs::write(dir.join(PID), "1\n").expect("a leftover");
        std::os::unix::fs::symlink("/proc/1/fd/3", dir.join(IO)).expect("a leftover");
        let mut owned = RunDir::claim_in(base.path(), "s").expect("nobody holds it");
        assert!(!dir.join(SOCKET).exists() && fs::symlink_metadata(dir.join(IO)).is_err());
        owned.link(IO, Path::new("/proc/self/fd/0")).expect("the name is free");
        drop(owned);
        assert!(!dir.exists());
    }

    #[test]
    fn a_link_in_its_place_is_refused() {
        let base = tempfile::tempdir().expect("a directory");
        std::os::unix::fs::symlink("/tmp", base.path().join("s")).expect("a link");
        assert!(matches!(RunDir::claim_in(base.path(), "s"), Err(RunDirError::Foreign(_))));
    }

    #[test]
    fn a_living_station_is_not_buried() {
        let base = tempfile::tempdir().expect("a directory");
        let living = RunDir::claim_in(base.path(), "s").expect("free");
        assert!(!remove_of_dead(living.path(), "1", || panic!("it lives")));
        assert!(living.path().exists());
    }

    #[test]
    fn a_dying_owner_is_waited_for() {
        let base = tempfile::tempdir().expect("a directory");
        let dying = RunDir::claim_in(base.path(), "s").expect("free");
        let (path, pid) = (dying.path().to_owned(), std::process::id().to_string());
        let guardian = std::thread::spawn({
            let path = path.clone();
            move || remove_of_dead(&path, &pid, || ())
        });
        // As at its death: the lock goes, the directory stays.
        let RunDir { lock, .. } = &dying;
        rustix::fs::flock(lock, FlockOperation::Unlock).expect("it is held");
        assert!(guardian.join().expect("no panic"));
        assert!(!path.exists());
    }

    #[test]
    fn what_others_have_removed_is_made_again() {
        let base = tempfile::tempdir().expect("a directory");
        let all = base.path().join("ob1");
        private_dir(&all).expect("made");
        let mut dir = RunDir::claim_in(&all, "s").expect("free");
        let target = Path::new("/proc/self/fd/0");
        dir.link(IO, target).expect("the name is free");
        fs::write(dir.socket(), "").expect("a socket");
        assert!(!dir.restore().expect("whole"));
        for removed in [dir.path().join(IO), dir.path().join(PID), dir.path().to_owned(), all.clone()] {
            if removed.is_dir() {
                fs::remove_dir_all(&removed).expect("removed");
            } else {
                fs::remove_file(&removed).expect("removed");
            }
            assert!(dir.restore().expect("made again"), "{}", removed.display());
            fs::write(dir.socket(), "").expect("a socket");
            assert!(!dir.restore().expect("whole"), "{}", removed.display());
            assert_eq!(fs::read_link(dir.path().join(IO)).expect("a link"), target);
            assert_eq!(owner(dir.path()), std::process::id().to_string());
            assert!(matches!(RunDir::claim_in(&all, "s"), Err(RunDirError::Running { .. })), "it has an owner");
        }
    }

    #[test]
    fn the_directory_of_another_is_left_alone() {
        let base = tempfile::tempdir().expect("a directory");
        let mut first = RunDir::claim_in(base.path(), "s").expect("free");
        fs::remove_dir_all(first.path()).expect("removed");
        let second = RunDir::claim_in(base.path(), "s").expect("free again");
        fs::write(second.socket(), "").expect("a socket");
        assert!(matches!(first.restore(), Err(RunDirError::Running { .. })));
        drop(first);
        assert!(second.socket().exists());
    }

    #[test]
    fn who_claims_while_a_guardian_removes_gets_it() {
        let base = tempfile::tempdir().expect("a directory");
        let path = base.path().join("s");
        let over = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !over.load(std::sync::atomic::Ordering::Relaxed) {
                    let _ = fs::create_dir(&path).and_then(|()| fs::remove_dir(&path));
                }
            });
            let claims = (0..3000).map(|_| RunDir::claim_in(base.path(), "s").map(drop));
            let refused = claims.filter_map(Result::err).next();
            over.store(true, std::sync::atomic::Ordering::Relaxed);
            assert!(refused.is_none(), "{refused:?}");
        });
    }

    #[test]
    fn who_claims_waits_for_the_guardian() {
        let base = tempfile::tempdir().expect("a directory");
        let dead = RunDir::claim_in(base.path(), "s").expect("free");
        dead.lock.set_len(0).expect("a file");
        let next = std::thread::spawn({
            let base = base.path().to_owned();
            move || RunDir::claim_in(&base, "s").map(|dir| dir.path().exists())
        });
        drop(dead);
        assert!(next.join().expect("no panic").expect("free at last"));
    }
}
