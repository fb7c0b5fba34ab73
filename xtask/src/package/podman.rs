//! podman as a user without rights, with a storage of its own; and whether this machine can run it so.
//!
//! As ours, or, for root, as a user that is made for it.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::oci;
use crate::failure::{Outcome, step};
use crate::shell;

/// The user that root makes for the check.
const GUEST: &str = "ob1check";

/// See [the module](self).
pub(super) struct Podman {
    pub(super) folder: PathBuf,
    rootless: Vec<String>,
}

impl Podman {
    pub(super) fn new() -> Outcome<Self> {
        let folder = std::env::temp_dir().join(format!("ob1-oci-{}", std::process::id()));
        for name in ["station", "state", "store", "run", "outside"] {
            let path = folder.join(name);
            std::fs::create_dir_all(&path).map_err(|why| step(format!("{}: {why}", path.display())))?;
        }
        let rootless = rootless(&folder)?;
        Ok(Self { folder, rootless })
    }

    /// Runs the image of [`oci::probe`] as ours is run.
    pub(super) fn probe(&self, archive: &Path) -> Outcome {
        self.run(&["load", "--quiet", "--input", &archive.display().to_string()])?;
        let options = self.options(&[]);
        let mut args = vec!["run", "--rm"];
        args.extend(options.iter().map(String::as_str));
        args.extend([oci::PROBE, "/bin/true"]);
        self.run(&args).map(drop)
    }

    fn command(&self, args: &[&str]) -> Command {
        let own = |name: &str| self.folder.join(name).display().to_string();
        // A machine that only nearly runs containers may let it wait for ever.
        let mut words = vec!["timeout".to_owned(), "120".to_owned()];
        words.extend_from_slice(&self.rootless);
        words.extend([
            "env".into(),
            format!("HOME={}", own("run")),
            format!("XDG_RUNTIME_DIR={}", own("run")),
            "podman".into(),
        ]);
        for (option, value) in
            [("--storage-driver", "overlay".to_owned()), ("--root", own("store")), ("--runroot", own("run"))]
        {
            words.extend([option.to_owned(), value]);
        }
        words.extend(["--cgroup-manager", "cgroupfs", "--runtime", "crun"].map(str::to_owned));
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).args(args).stdin(Stdio::null()).current_dir(&self.folder);
        command
    }

    pub(super) fn run(&self, args: &[&str]) -> Outcome<String> {
        let output = self.command(args).output().map_err(|why| step(format!("podman: {why}")))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        if output.status.success() {
            return Ok(text(&output.stdout));
        }
        let words = args.first().copied().unwrap_or_default();
        Err(step(format!("podman {words}: {} {}", text(&output.stdout), text(&output.stderr))))
    }

    /// The options of a container as this check and `docs/fleet.md` have it.
    pub(super) fn options(&self, more: &[String]) -> Vec<String> {
        let own = |name: &str| self.folder.join(name).display().to_string();
        let mut options: Vec<String> = [
            "--read-only",
            "--cap-drop=all",
            "--security-opt=no-new-privileges",
            "--network=none",
            "--cgroups=disabled",
        ]
        .map(str::to_owned)
        .to_vec();
        options.push("--userns=keep-id:uid=990,gid=990".into());
        options.push("--tmpfs=/run:mode=1777".into());
        options.push(format!("--volume={}:/etc/ob1:ro", own("station")));
        options.push(format!("--volume={}:/var/lib/ob1", own("state")));
        options.extend_from_slice(more);
        options
    }
}

impl Drop for Podman {
    fn drop(&mut self) {
        let _ = self.run(&["rm", "--force", "--all"]);
        let _ = self.run(&["rmi", "--force", "--all"]);
        let _ = self.run(&["system", "migrate"]);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// The words before podman: none for a user; for root those that make it the guest, in a view of the machine that has
/// the control groups of today only.
fn rootless(folder: &Path) -> Outcome<Vec<String>> {
    let is_root = shell::read(Command::new("id").arg("-u"))?.trim() == "0";
    if !is_root {
        return Ok(vec!["env".into()]);
    }
    if !shell::works(Command::new("id").arg(GUEST)) {
        shell::run(Command::new("useradd").args(["--system", "--add-subids-for-system", "--no-create-home", GUEST]))?;
    }
    for name in ["station", "state", "store", "run"] {
        shell::read(Command::new("chown").arg(GUEST).arg(folder.join(name)))?;
    }
    // crun refuses a machine with both kinds of control groups; a container needs none here.
    let view = "if [ -d /sys/fs/cgroup/unified ]; then umount -R /sys/fs/cgroup; mount -t cgroup2 cgroup /sys/fs/cgroup; fi; \
        mount --make-rshared /; exec runuser -u ob1check -- \"$@\"";
    Ok(["unshare", "--mount", "--propagation", "private", "sh", "-c", view, "sh"].map(str::to_owned).to_vec())
}
