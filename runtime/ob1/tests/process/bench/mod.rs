//! A small station without drivers for tests that run the command: a folder of its own, its runtime directory in it.

// Each test binary uses a part of it.
#![allow(dead_code)]

use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::Value;

pub(crate) const PROGRAM: &str = "\
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  START_INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
NETWORK
      L     EW     0;
      T     AW     4;
      L     MW     0;
      L     1;
      +I    ;
      T     MW     0;
      U     M      2.0;
      SPBN  ok;
      AUF   DB    77;
ok:   NOP   0;
END_ORGANIZATION_BLOCK

DATA_BLOCK DB 5
STRUCT
  SETPOINT : REAL := 1.5;
  COUNT : INT := -3;
END_STRUCT;
BEGIN
END_DATA_BLOCK
";

pub(crate) const STATION: &str = "\
[station]
name = \"bench\"

[program]
sources = [\"bench.awl\"]

[[module]]
type = \"di\"
name = \"panel\"
address = 0
bytes = 2

[[module]]
type = \"do\"
name = \"lamps\"
address = 4
bytes = 2

[process_io]
stimulus = \"panel.toml\"
";

pub(crate) const STIMULUS: &str = "[[at]]\ntime = \"0ms\"\nset = { \"EW 0\" = \"16#1234\" }\n";

/// A folder with a station in it, and a runtime directory of its own.
pub(crate) struct Bench {
    pub(crate) folder: tempfile::TempDir,
}

impl Bench {
    pub(crate) fn new() -> Self {
        let bench = Self { folder: tempfile::tempdir().expect("a directory") };
        bench.write("bench.toml", STATION);
        bench.write("bench.awl", PROGRAM);
        bench.write("panel.toml", STIMULUS);
        bench
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.folder.path().join(name), text).expect("writable");
    }

    pub(crate) fn rundir(&self) -> PathBuf {
        self.folder.path().join("ob1/bench")
    }

    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
        command.args(args).current_dir(self.folder.path()).env("XDG_RUNTIME_DIR", self.folder.path());
        command.env_remove("OB1_LOG").stdin(Stdio::null());
        command
    }

    pub(crate) fn ob1(&self, args: &[&str]) -> Output {
        self.command(args).output().expect("ob1 starts")
    }

    pub(crate) fn code(&self, args: &[&str]) -> Option<i32> {
        self.ob1(args).status.code()
    }

    /// Starts a run and waits until it answers in RUN.
    pub(crate) fn start(&self, args: &[&str]) -> Station {
        let mut command = self.command(&["run", "bench.toml", "--quiet"]);
        let station = Station { child: command.args(args).stdout(Stdio::null()).spawn().expect("ob1 starts") };
        until(|| self.json(&["ctl", "bench", "status", "--json"])["state"] == "RUN");
        station
    }

    /// Waits until the station answers in this state.
    pub(crate) fn until_state(&self, state: &str) {
        until(|| self.json(&["ctl", "bench", "status", "--json"])["state"] == state);
    }

    pub(crate) fn json(&self, args: &[&str]) -> Value {
        serde_json::from_slice(&self.ob1(args).stdout).unwrap_or(Value::Null)
    }

    pub(crate) fn value(&self, cell: &str) -> Value {
        self.json(&["get", "bench", cell, "--json"])[0]["value"].clone()
    }
}

/// A running station, killed when the test is over.
pub(crate) struct Station {
    pub(crate) child: Child,
}

impl Station {
    pub(crate) fn signal(&self, name: &str) {
        let status = Command::new("kill").args([name, &self.child.id().to_string()]).status();
        assert!(status.expect("kill is there").success());
    }

    /// From now on its files grow no further than this.
    pub(crate) fn limit_files(&self, bytes: Option<u64>) {
        let pid = Pid::from_child(&self.child);
        prlimit(Some(pid), Resource::Fsize, Rlimit { current: bytes, maximum: None }).expect("our own child");
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Looks until it holds. The test runner's own limit ends a test that waits for ever.
pub(crate) fn until(mut holds: impl FnMut() -> bool) {
    while !holds() {
        std::thread::yield_now();
    }
}
