//! A minimal Debian of each supported release to test the package: created once by debootstrap, booted by
//! systemd-nspawn with a temporary layer; if nothing can be booted, a chroot in which `ob1 run` replaces the unit.
//! `xtask/package/inside.sh` runs inside.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Made, Site};
use crate::cargo;
use crate::failure::{Outcome, step};
use crate::shell;

/// Debian 12 and 13.
const SUITES: [&str; 2] = ["bookworm", "trixie"];
/// The last line of the script after success.
const DONE: &str = "inside: all is well";

/// Runs the check; returns how it was run.
pub(super) fn run(site: &Site, made: &Made) -> Outcome<String> {
    let mut how = Vec::new();
    for suite in SUITES {
        how.push(format!("{suite} {}", run_in(site, made, suite)?));
    }
    Ok(how.join(", "))
}

fn run_in(site: &Site, made: &Made, suite: &str) -> Outcome<&'static str> {
    let system = system(site, suite)?;
    let check = site.dist.join("check");
    let _ = std::fs::remove_dir_all(&check);
    std::fs::create_dir_all(&check).map_err(|why| step(format!("{}: {why}", check.display())))?;
    let own = cargo::root().join("xtask/package");
    for (from, name) in [
        (made.debian.clone(), "ob1.deb"),
        (own.join("inside.sh"), "inside.sh"),
        (own.join("inside.service"), "inside.service"),
    ] {
        std::fs::copy(&from, check.join(name)).map_err(|why| step(format!("{}: {why}", from.display())))?;
    }
    if boots(&system) {
        booted(&system, &check)?;
        return Ok("booted by systemd-nspawn");
    }
    chrooted(site, &system, &check)?;
    Ok("chroot, without systemd: the unit itself was not started")
}

/// The system, created if it does not exist yet.
fn system(site: &Site, suite: &str) -> Outcome<PathBuf> {
    let system = site.dist.join(format!("debian-{suite}"));
    if !system.join("usr/bin/dpkg").exists() {
        let mut command = Command::new("debootstrap");
        command.args(["--variant=minbase", "--include=systemd,systemd-sysv,dbus", suite]).arg(&system);
        shell::run(&mut command)?;
    }
    Ok(system)
}

/// A container of the system that discards all changes.
fn container(system: &Path) -> Command {
    let mut command = Command::new("systemd-nspawn");
    command.args(["--quiet", "--register=no", "--keep-unit", "--volatile=overlay", "--console=pipe"]);
    command.arg("--directory").arg(system);
    command
}

/// Whether systemd can be booted here.
fn boots(system: &Path) -> bool {
    let mut command = Command::new("timeout");
    command.args(["--kill-after=5", "60"]).arg("systemd-nspawn").args(container(system).get_args());
    shell::works(command.args(["--boot", "systemd.unit=exit.target"]))
}

fn booted(system: &Path, check: &Path) -> Outcome {
    let mut command = container(system);
    // The script writes its log there, because a container without a terminal has no readable console.
    command.arg(format!("--bind={}:/check", check.display()));
    command.arg(format!("--bind-ro={}:/etc/systemd/system/inside.service", check.join("inside.service").display()));
    // The unit needs FIFO scheduling and locked memory, so the container must have them.
    command.args(["--capability=CAP_SYS_NICE,CAP_IPC_LOCK", "--rlimit=RLIMIT_RTPRIO=99"]);
    command.args(["--rlimit=RLIMIT_MEMLOCK=infinity", "--boot", "systemd.unit=inside.service"]);
    let ended = shell::run(&mut command);
    let log = std::fs::read_to_string(check.join("log")).unwrap_or_default();
    print!("{log}");
    ended?;
    if log.contains(DONE) { Ok(()) } else { Err(step("the check in the bare system did not finish")) }
}

fn chrooted(site: &Site, system: &Path, check: &Path) -> Outcome {
    // Everything in a separate mount namespace: nothing stays mounted, even after an error.
    let script = "set -e; mount -t tmpfs layer \"$2\"; mkdir \"$2/up\" \"$2/work\" \"$2/root\"; \
        mount -t overlay overlay -o lowerdir=\"$1\",upperdir=\"$2/up\",workdir=\"$2/work\" \"$2/root\"; cd \"$2/root\"; \
        mount -t proc proc proc; mount --rbind /dev dev; mount -t tmpfs run run; mkdir check; \
        mount --bind \"$3\" check; exec chroot . /bin/sh /check/inside.sh";
    let layer = site.dist.join("layer");
    std::fs::create_dir_all(&layer).map_err(|why| step(format!("{}: {why}", layer.display())))?;
    let mut command = Command::new("unshare");
    command.args(["--mount", "--pid", "--fork", "--kill-child", "sh", "-c", script, "sh"]);
    told(command.arg(system).arg(&layer).arg(check))
}

/// Requires the last line of the script, because a system that shuts down early also ends with exit code 0.
fn told(command: &mut Command) -> Outcome {
    let lines = shell::watch(command, |line| line.contains(DONE))?;
    if lines.is_empty() { Err(step("the check in the bare system did not finish")) } else { Ok(()) }
}
