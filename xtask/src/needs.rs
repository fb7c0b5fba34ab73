//! What a verb needs in addition to the Rust toolchain and a C compiler: Debian packages. As root the verb installs
//! them; otherwise it prints one command that installs them before it builds anything.

use std::path::Path;
use std::process::Command;

use crate::failure::{Outcome, step};
use crate::shell;

/// A requirement for the machine.
pub(crate) struct Need {
    /// Its description in the message.
    what: &'static str,
    /// The Debian packages that provide it.
    packages: &'static [&'static str],
    here: fn() -> bool,
}

/// The interpreter of the partners, with the module that creates their environment.
pub(crate) const PYTHON: Need =
    Need { what: "Python 3.11 with venv", packages: &["python3", "python3-venv"], here: python_with_venv };

/// The interpreter of the partners from npm, with its package manager.
pub(crate) const NODE: Need =
    Need { what: "Node.js with npm", packages: &["nodejs", "npm"], here: || on_path("node") && on_path("npm") };

/// libmodbus as a master.
pub(crate) const MBPOLL: Need =
    Need { what: "mbpoll, a Modbus master", packages: &["mbpoll"], here: || on_path("mbpoll") };

/// libmodbus itself, which `tests/peers/modbus.py` loads as a slave.
pub(crate) const LIBMODBUS: Need = Need {
    what: "libmodbus, a Modbus slave",
    packages: &["libmodbus5"],
    here: || python("import ctypes; ctypes.CDLL('libmodbus.so.5')"),
};

/// The browser that shows the page of a station, and its driver.
pub(crate) const BROWSER: Need = Need {
    what: "Chromium with its driver",
    packages: &["chromium", "chromium-driver"],
    here: || on_path("chromium") && on_path("chromedriver"),
};

/// Reads the metrics of a station.
pub(crate) const PROMETHEUS: Need =
    Need { what: "Prometheus", packages: &["prometheus"], here: || on_path("prometheus") && on_path("promtool") };

/// lintian, which checks Debian packages.
pub(crate) const LINTIAN: Need = Need { what: "lintian", packages: &["lintian"], here: || on_path("lintian") };

/// The C compiler for AArch64, used for linking.
pub(crate) const AARCH64_GCC: Need = Need {
    what: "the C compiler for AArch64, with its library",
    packages: &["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross"],
    here: || on_path("aarch64-linux-gnu-gcc"),
};

/// Runs programs of other processors.
pub(crate) const QEMU_USER: Need =
    Need { what: "QEMU's user-mode emulation", packages: &["qemu-user"], here: || on_path("qemu-aarch64") };

/// Creates a minimal Debian.
pub(crate) const DEBOOTSTRAP: Need =
    Need { what: "debootstrap", packages: &["debootstrap"], here: || on_path("debootstrap") };

/// systemd-nspawn, which boots the Debian that debootstrap made.
pub(crate) const NSPAWN: Need =
    Need { what: "systemd-nspawn", packages: &["systemd-container"], here: || on_path("systemd-nspawn") };

/// The broker for the tests of MQTT.
pub(crate) const MOSQUITTO: Need = Need {
    what: "mosquitto, an MQTT broker",
    packages: &["mosquitto"],
    here: || on_path("mosquitto") || Path::new("/usr/sbin/mosquitto").is_file(),
};

/// Checks the telegrams of the S7 link.
pub(crate) const TSHARK: Need =
    Need { what: "tshark, the dissectors of Wireshark", packages: &["tshark"], here: || on_path("tshark") };

/// Counts instructions.
pub(crate) const VALGRIND: Need = Need { what: "valgrind", packages: &["valgrind"], here: || on_path("valgrind") };

/// Makes images of containers, without a daemon.
pub(crate) const BUILDAH: Need =
    Need { what: "buildah", packages: &["buildah", "uidmap"], here: || on_path("buildah") && on_path("newuidmap") };

/// Runs containers without rights.
pub(crate) const PODMAN: Need = Need {
    what: "podman with crun",
    packages: &["podman", "crun", "uidmap"],
    here: || on_path("podman") && on_path("crun") && on_path("newuidmap"),
};

/// A batch engine, with the daemon that vouches for its users.
pub(crate) const SLURM: Need = Need {
    what: "Slurm, a batch engine",
    packages: &["slurm-wlm", "munge"],
    here: || on_path("sbatch") && Path::new("/usr/sbin/munged").is_file(),
};

/// Reads the headers of C for the build of iceoryx2.
pub(crate) const LIBCLANG: Need = Need { what: "libclang", packages: &["libclang-dev"], here: has_libclang };

/// Makes sure that all `needs` are installed.
///
/// # Errors
/// If something is missing and cannot be installed: the message contains the command that installs it.
pub(crate) fn satisfy(needs: &[Need]) -> Outcome {
    let packages = packages(needs, |need| (need.here)());
    if packages.is_empty() {
        return Ok(());
    }
    if may_install() && on_path("apt-get") {
        let apt = |args: &[&str]| {
            let mut command = Command::new("apt-get");
            command.env("DEBIAN_FRONTEND", "noninteractive").args(args);
            command
        };
        shell::run(&mut apt(&["update", "-qq"]))?;
        shell::run(apt(&["install", "-y", "-qq"]).args(&packages))?;
    }
    let missing: Vec<&Need> = needs.iter().filter(|need| !(need.here)()).collect();
    if missing.is_empty() { Ok(()) } else { Err(step(refusal(&missing))) }
}

/// The message: what is missing, and the command that installs it.
fn refusal(missing: &[&Need]) -> String {
    let what: Vec<&str> = missing.iter().map(|need| need.what).collect();
    let packages = packages(missing.iter().copied(), |_| false).join(" ");
    format!(
        "not here: {}. Install it, then call this again (names of Debian's packages):\n  sudo apt-get install -y {packages}",
        what.join("; "),
    )
}

/// The packages for everything that is missing, each once.
fn packages<'a>(needs: impl IntoIterator<Item = &'a Need>, here: impl Fn(&Need) -> bool) -> Vec<&'static str> {
    let mut packages = Vec::new();
    for package in needs.into_iter().filter(|need| !here(need)).flat_map(|need| need.packages) {
        if !packages.contains(package) {
            packages.push(*package);
        }
    }
    packages
}

/// Whether packages may be installed: only as root.
fn may_install() -> bool {
    shell::works(Command::new("sh").args(["-c", "[ \"$(id -u)\" = 0 ]"]))
}

fn has_libclang() -> bool {
    let versions = std::fs::read_dir("/usr/lib").into_iter().flatten().flatten();
    versions.map(|version| version.path().join("lib/libclang.so")).any(|library| library.is_file())
}

fn on_path(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

fn python_with_venv() -> bool {
    python("import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))")
}

fn python(program: &str) -> bool {
    shell::works(Command::new("python3").args(["-c", program]))
}

#[cfg(test)]
mod tests {
    use super::{LIBMODBUS, MBPOLL, PYTHON, packages, refusal, satisfy};

    #[test]
    fn only_what_is_missing_is_asked_for_and_once() {
        let needs = [PYTHON, MBPOLL, LIBMODBUS, MBPOLL];
        assert_eq!(packages(&needs, |_| true), [""; 0]);
        assert_eq!(packages(&needs, |need| need.packages == PYTHON.packages), ["mbpoll", "libmodbus5"]);
        assert_eq!(packages(&needs, |_| false), ["python3", "python3-venv", "mbpoll", "libmodbus5"]);
    }

    #[test]
    fn what_cannot_be_installed_is_named_with_its_command() {
        let said = refusal(&[&PYTHON, &MBPOLL]);
        assert!(said.contains("Python 3.11 with venv; mbpoll, a Modbus master"), "{said}");
        assert!(said.ends_with("  sudo apt-get install -y python3 python3-venv mbpoll"), "{said}");
        assert!(satisfy(&[]).is_ok());
    }
}
