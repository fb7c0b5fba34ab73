//! The guardian: a child process that outlives the runtime.
//!
//! While the runtime lives, the guardian holds its pidfd and the image of its process I/O, and watches its signs of
//! life. When the runtime dies or stands still for too long, the guardian sets the outputs to their safe state; once
//! the runtime is dead, it removes what that has published. It does nothing else, so little can keep it from that.
//! (docs/process-io.md)

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use ob1_backplane::{GuardPage, Guardian, io_layout::IO_AREA_BYTES};
use ob1_process::{Confinement, Network};
use ob1_socket::handover;
use ob1_time::Span;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use super::Patience;
use crate::rundir;

/// How long the drivers get to remove what they have published themselves.
const GRACE: Span = Span::from_secs(3);
const STEP: Span = Span::from_millis(20);
/// Between two looks at the runtime. Looks are counted, not time: if the whole machine stood still, nothing is dead.
const LOOK: Span = Span::from_millis(50);

/// Decides, look by look, whether the runtime counts as dead. Pure.
#[derive(Debug)]
struct Vigil {
    stopped: u32,
    silent: u32,
    beats: Option<u64>,
    looks: u32,
    looks_stopped: u32,
}

impl Vigil {
    fn new(patience: Patience) -> Self {
        let looks = |time: Span| u32::try_from(time.div_ceil(LOOK)).unwrap_or(u32::MAX);
        Self {
            stopped: looks(patience.stopped),
            silent: looks(patience.silent),
            beats: None,
            looks: 0,
            looks_stopped: 0,
        }
    }

    /// One look: the signs of life so far, and whether the kernel says that the process is stopped. True: dead.
    fn look(&mut self, beats: u64, stopped: bool) -> bool {
        if self.beats != Some(beats) {
            (self.beats, self.looks, self.looks_stopped) = (Some(beats), 0, 0);
            return false;
        }
        self.looks = self.looks.saturating_add(1);
        self.looks_stopped = if stopped { self.looks_stopped.saturating_add(1) } else { 0 };
        self.looks >= self.silent || self.looks_stopped >= self.stopped
    }
}

/// What the runtime has handed over.
enum Held {
    /// Its pidfd, the page and its image.
    Outputs(OwnedFd, Guardian),
    /// The same without an image: it has no process I/O.
    NoOutputs(OwnedFd, GuardPage),
}

/// The guardian's whole life.
pub fn run(rundir: &Path, published: &[PathBuf], patience: Patience) {
    ob1_process::close_inherited();
    // It ends after the runtime, not before: a shutdown sends SIGTERM to all.
    for signal in [SIGTERM, SIGINT, SIGHUP] {
        let _ = signal_hook::flag::register(signal, Arc::new(AtomicBool::new(false)));
    }
    confine(rundir, published);
    let runtime = rundir::owner(rundir);
    let held = receive();
    watch(&runtime, held.as_ref(), patience);
    rundir::remove_of_dead(rundir, &runtime, || remove_published(published));
}

/// Confines itself to what it needs: the folders it removes things from, and a look at the runtime in `/proc`. Refusals
/// are ignored: nobody would read about them, and each confinement that works helps.
fn confine(rundir: &Path, published: &[PathBuf]) {
    let folders = [Some(rundir), rundir.parent()].into_iter().flatten();
    let links = published.iter().filter_map(|path| path.parent());
    let _refused = ob1_process::confine(&Confinement {
        folders: folders.map(Path::to_owned).collect(),
        links: links.map(Path::to_owned).collect(),
        devices: true,
        processes: true,
        network: Network::None,
        memory: 64 << 20,
        oom_score: -500,
        ..Confinement::default()
    });
}

/// What came with the first message; `None`: nothing that can be used, but the connection still says when it ends.
fn receive() -> Option<Held> {
    let stdin = rustix::stdio::stdin();
    let mut safe = [0; IO_AREA_BYTES];
    let (length, descriptors) = loop {
        match handover::receive(stdin, &mut safe) {
            Ok(Some(message)) => break message,
            Ok(None) => {
                let _ = poll(&mut [PollFd::new(&stdin, PollFlags::IN)], None);
            }
            Err(_) => return None,
        }
    };
    let mut descriptors = descriptors.into_iter();
    let (pidfd, page, image) = (descriptors.next()?, descriptors.next()?, descriptors.next());
    Some(match image {
        Some(image) => Held::Outputs(pidfd, Guardian::received(image, page, safe.get(..length)?).ok()?),
        None => Held::NoOutputs(pidfd, GuardPage::received(page).ok()?),
    })
}

/// Returns when the runtime is dead.
fn watch(runtime: &str, held: Option<&Held>, patience: Patience) {
    let mut vigil = Vigil::new(patience);
    let pid = runtime.parse().ok();
    let mut taken = false;
    loop {
        let gone = has_gone(held);
        let (page, guardian) = match held {
            Some(Held::Outputs(_, guardian)) => (Some(guardian.page()), Some(guardian)),
            Some(Held::NoOutputs(_, page)) => (Some(page), None),
            None => (None, None),
        };
        if let Some(page) = page {
            page.guardian_beat();
            let stopped = || pid.and_then(ob1_rt::process_state).is_some_and(|state| matches!(state.state, 'T' | 't'));
            taken |= gone || vigil.look(page.beats(), stopped());
        }
        if let Some(guardian) = guardian.filter(|guardian| !guardian.page().has_let_go())
            && taken
        {
            guardian.take_over();
        }
        if gone {
            return;
        }
    }
}

/// Waits for the time of a look, or until the runtime has ended: true.
fn has_gone(held: Option<&Held>) -> bool {
    let stdin = rustix::stdio::stdin();
    let mut fds = vec![PollFd::new(&stdin, PollFlags::IN)];
    if let Some(Held::Outputs(pidfd, _) | Held::NoOutputs(pidfd, _)) = held {
        fds.push(PollFd::new(pidfd, PollFlags::IN));
    }
    match poll(&mut fds, Timespec::try_from(Duration::from(LOOK)).ok().as_ref()) {
        Ok(_) => {}
        Err(_) => return false,
    }
    if fds.get(1).is_some_and(|pidfd| !pidfd.revents().is_empty()) {
        return true;
    }
    if fds.first().is_none_or(|stdin| stdin.revents().is_empty()) {
        return false;
    }
    // The end of the connection, or something nobody sends.
    let mut ignored = [0; 64];
    match handover::receive(stdin, &mut ignored) {
        Ok(Some((length, _))) => length == 0,
        Ok(None) => false,
        Err(error) => error.kind() != io::ErrorKind::Interrupted,
    }
}

/// Removes links the drivers have left. A living driver sees the same end of file and removes its own.
fn remove_published(published: &[PathBuf]) {
    let mut waited = Span::ZERO;
    loop {
        let left: Vec<&PathBuf> = published.iter().filter(|path| !removed(path)).collect();
        if left.is_empty() || waited >= GRACE {
            for path in left {
                let _ = std::fs::remove_file(path);
            }
            return;
        }
        std::thread::sleep(STEP.into());
        waited += STEP;
    }
}

/// Removes a link that leads nowhere; leaves everything that is not a link to a pty. True if nothing of ours is left.
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

    const PATIENCE: Patience = Patience { stopped: Span::from_secs(1), silent: Span::from_secs(3) };

    #[test]
    fn silence_is_death_and_sooner_so_when_the_process_is_stopped() {
        let mut vigil = Vigil::new(PATIENCE);
        let died = (0..).find(|_| vigil.look(7, false));
        assert_eq!(died, Some(60), "3 s of 50 ms each, and the first look");
        let mut vigil = Vigil::new(PATIENCE);
        assert_eq!((0..).find(|_| vigil.look(7, true)), Some(20));
        // It was continued in time, again and again.
        let mut vigil = Vigil::new(PATIENCE);
        for beats in 0..100 {
            assert!((0..20).all(|_| !vigil.look(beats, true)), "{beats}");
        }
        let mut vigil = Vigil::new(PATIENCE);
        assert!((0..40).all(|look| !vigil.look(1, look % 19 != 0)), "continued for a moment, without a scan");
    }

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
