//! The environment of a test: a folder with station files, a runtime directory, and the cleanup.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rustix::process::Signal;
use tempfile::TempDir;

use super::processes::{self, Watched};
use super::station::Running;
use super::{Guard, checkout, plugin_dir, program};

/// QVZ and ZVZ long enough for a partner on a busy machine: the tests check telegrams and not speed.
pub(crate) const PATIENT: &str = "qvz_ms = 2000, zvz_ms = 1000, ";

/// The cycle watchdog of the demo's stations: longer than a busy machine interrupts a scan, shorter than the second
/// after which a silent driver is treated as hanging. It detects an OB 1 that waits for such a driver.
const WATCHDOG: &str = "watchdog = \"500ms\"";

/// The folder of a test. Dropping it ends every process started from it, directly or indirectly.
#[derive(Debug)]
pub(crate) struct Site {
    folder: TempDir,
}

/// The output of a finished command.
#[derive(Debug)]
pub(crate) struct Said {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Said {
    /// The standard output of a command that must succeed.
    pub(crate) fn fine(self) -> String {
        assert_eq!(self.code, Some(0), "{}{}", self.out, self.err);
        self.out
    }
}

impl Site {
    pub(crate) fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("ob1-test-").tempdir().expect("a folder");
        fs::create_dir(folder.path().join("run")).expect("a runtime directory");
        fs::set_permissions(folder.path().join("run"), fs::Permissions::from_mode(0o700)).expect("ours");
        Self { folder }
    }

    /// With the files of the demo, and delay times long enough for a busy machine.
    pub(crate) fn two_stations() -> Self {
        let site = Self::new();
        for name in ["a.awl", "b.awl"] {
            fs::copy(checkout("examples/two-stations").join(name), site.path(name)).expect("a file of the demo");
        }
        for name in ["station-a.toml", "station-b.toml"] {
            site.write(name, &demo_station(name, |text| text));
        }
        site
    }

    /// The same on a simulated cable. A pty is served by a kernel thread, which may be seconds late on a busy machine;
    /// then 3964R sends a telegram twice.
    pub(crate) fn two_stations_on_a_cable() -> Self {
        let site = Self::two_stations();
        for name in ["station-a.toml", "station-b.toml"] {
            site.write(name, &demo_station(name, |text| on_a_simulated_line(&text, "null-modem")));
        }
        site
    }

    /// Takes the cycle watchdog from a station: a machine that stands still does not stop its CPU.
    pub(crate) fn without_watchdog(&self, file: &str) {
        let text = fs::read_to_string(self.path(file)).expect("a station file");
        self.write(file, &replaced(&text, WATCHDOG, "watchdog = \"0ms\""));
    }

    pub(crate) fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).expect("room for a file");
        path
    }

    /// The runtime directory of a station.
    pub(crate) fn rundir(&self, name: &str) -> PathBuf {
        self.path("run/ob1").join(name)
    }

    fn environment(&self) -> String {
        format!("XDG_RUNTIME_DIR={}", self.path("run").display())
    }

    /// Processes started from this folder, directly or indirectly.
    pub(crate) fn processes(&self) -> Vec<Watched> {
        processes::with_environment(&self.environment())
    }

    /// Waits until no process of this folder is left.
    pub(crate) fn wait_until_empty(&self) {
        let guard = Guard::begin();
        while let Some(process) = self.processes().first() {
            assert!(!guard.is_over(), "left behind: {:?}", process.threads());
            process.ends_within(std::time::Duration::from_millis(50));
        }
    }

    /// A command in this environment.
    pub(crate) fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command
            .current_dir(self.folder.path())
            .env("XDG_RUNTIME_DIR", self.path("run"))
            .env("OB1_PLUGIN_DIR", plugin_dir())
            .env_remove("OB1_LOG")
            .env_remove("OB1_CP")
            .stdin(Stdio::null());
        command
    }

    /// Runs `ob1` with these arguments until its end.
    pub(crate) fn ob1(&self, args: &[&str]) -> Said {
        let output = self.command(program("ob1")).args(args).output().expect("ob1 starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        Said { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    /// Starts `ob1 run` with a station file.
    pub(crate) fn run(&self, file: &str) -> Running {
        self.run_with(file, &[], &[])
    }

    /// The same, with its log and those of its drivers redirected.
    pub(crate) fn run_logging_to(&self, file: &str, log: impl Into<Stdio>) -> Running {
        let mut command = self.command(program("ob1"));
        command.args(["run", file]);
        Running::start_with(self, file, command, Some(log.into()))
    }

    /// The same with additional arguments and environment.
    pub(crate) fn run_with(&self, file: &str, args: &[&str], environment: &[(&str, &OsStr)]) -> Running {
        let mut command = self.command(program("ob1"));
        command.args(["run", file]).args(args).envs(environment.iter().copied());
        Running::start(self, file, command)
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        // Repeated until there is none, because a process that is just starting is not visible yet.
        let guard = Guard::begin();
        loop {
            let left = self.processes();
            if left.is_empty() || guard.is_over() {
                return;
            }
            for process in left {
                process.signal(Signal::KILL);
                process.ends_within(std::time::Duration::from_secs(5));
            }
        }
    }
}

/// A station file of the demo with [`PATIENT`] times, [`WATCHDOG`], and an edit. Its stations are `tested-a` and
/// `tested-b`: a demo running on this machine would be found by its name.
pub(crate) fn demo_station(name: &str, edit: impl FnOnce(String) -> String) -> String {
    example_station("examples/two-stations", name, |text| edit(replaced(&text, "\"two-stations-", "\"tested-")))
}

/// The same for another example.
pub(crate) fn example_station(folder: &str, name: &str, edit: impl FnOnce(String) -> String) -> String {
    let text = fs::read_to_string(checkout(folder).join(name)).expect("a file of the example");
    let text = replaced(&text, "watchdog = \"150ms\"", WATCHDOG);
    edit(replaced(&text, "priority = ", &format!("{PATIENT}priority = ")))
}

/// Replaces the pty of this name by a simulated line shared by both stations.
pub(crate) fn on_a_simulated_line(station: &str, name: &str) -> String {
    let kind = if station.contains(&format!("pty:{name}.pty")) { "pty" } else { "serial" };
    let text = replaced(station, &format!("{kind}:{name}.pty"), &format!("sim:{name}"));
    text + &format!("\n[[simulated_line]]\nname = \"{name}\"\nshared = true\nseed = 341\n")
}

/// Replaces a text, which must exist.
pub(crate) fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "no `{from}` in:\n{text}");
    text.replace(from, to)
}
