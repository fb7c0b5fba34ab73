//! A running station: `ob1 run` as a process, accessed through its socket.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::{Diagnostic, Op, Response, Status};
use rustix::process::Signal;
use serde_json::Value;

use super::Guard;
use super::processes::Watched;
use super::site::Site;

/// Pause between two checks.
const PAUSE: Duration = Duration::from_millis(5);

/// A program with these data blocks that counts its scans in MW 100, and then executes `rest`, which may use the local
/// data from byte 20 on.
pub(crate) fn counting(data: &str, rest: &str) -> String {
    format!(
        "{data}
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  info : ARRAY[0..19] OF BYTE;
  own : DWORD;
END_VAR
BEGIN
NETWORK
      L     MW 100;
      +     1;
      T     MW 100;
{rest}END_ORGANIZATION_BLOCK
"
    )
}

/// `ob1 run`. Its end also ends every wait for it.
#[derive(Debug)]
pub(crate) struct Running {
    /// The name in its file.
    pub(crate) name: String,
    /// Its file, as given to `ob1`.
    pub(crate) file: String,
    pub(crate) rundir: PathBuf,
    pub(crate) process: Watched,
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

/// The end of a run, and its output.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Ended {
    pub(crate) fn code(&self) -> Option<i32> {
        self.status.code()
    }

    pub(crate) fn signal(&self) -> Option<i32> {
        self.status.signal()
    }
}

impl Running {
    pub(crate) fn start_command(site: &Site, file: &str, command: Command) -> Self {
        Self::start(site, file, command)
    }

    pub(super) fn start(site: &Site, file: &str, command: Command) -> Self {
        Self::start_with(site, file, command, None)
    }

    /// The same with a log other than a file.
    pub(super) fn start_with(site: &Site, file: &str, mut command: Command, log: Option<Stdio>) -> Self {
        let name = name_in(&site.path(file));
        let (out, err) = (site.path(format!("{name}.out")), site.path(format!("{name}.err")));
        let create = |path: &Path| File::create(path).expect("room for a file");
        let said = create(&err);
        let log = log.unwrap_or_else(|| said.into());
        let child = command.stdout(create(&out)).stderr(log).spawn().expect("ob1 starts");
        let process = Watched::find(child.id()).expect("a child, living or dead, is there until it is waited for");
        let rundir = site.rundir(&name);
        Self { name, file: file.to_owned(), rundir, process, child, out, err }
    }

    pub(crate) fn said(&self) -> String {
        let read = |path| fs::read_to_string(path).unwrap_or_default();
        format!("{} said:\n{}{}", self.name, read(&self.out), read(&self.err))
    }

    /// Waits until `look` returns a value. The wait fails at the end of the station or after the time limit.
    pub(crate) fn until<T>(&self, what: &str, mut look: impl FnMut(&Self) -> Option<T>) -> T {
        let guard = Guard::begin();
        loop {
            if let Some(found) = look(self) {
                return found;
            }
            assert!(!self.process.ends_within(PAUSE), "{what}: the station has ended; {}", self.said());
            assert!(!guard.is_over(), "{what}: not so far; {}\n{:#?}", self.said(), self.diagnostics());
        }
    }

    /// Waits until the CPU is in RUN.
    pub(crate) fn until_run(self) -> Self {
        self.until("RUN", |s| (s.try_ask(Op::Status)?.status?.state == "RUN").then_some(()));
        self
    }

    fn try_ask(&self, op: Op) -> Option<Response> {
        Client::to_socket(&self.rundir.join("control.sock")).ok()?.ask(op).ok()
    }

    /// Sends a request; a refusal is also an answer.
    pub(crate) fn ask(&self, op: Op) -> Result<Response, String> {
        let client = Client::to_socket(&self.rundir.join("control.sock"));
        match client.map_err(AccessError::Io).and_then(|mut client| client.ask(op)) {
            Ok(response) => Ok(response),
            Err(AccessError::Refused(why)) => Err(why),
            Err(why) => panic!("{why}; {}", self.said()),
        }
    }

    /// Cells, read at one control point, as numbers.
    pub(crate) fn cells(&self, names: &[&str]) -> Vec<i64> {
        let items = names.iter().map(|&name| name.to_owned()).collect();
        let values = self.ask(Op::Get { items }).expect("these cells exist").values.expect("an answer to get");
        let number = |value: &Value| value.as_i64().or_else(|| value.as_bool().map(i64::from));
        values.iter().map(|cell| number(&cell.value).expect("a whole number")).collect()
    }

    pub(crate) fn cell(&self, name: &str) -> i64 {
        self.cells(&[name])[0]
    }

    pub(crate) fn set(&self, name: &str, value: i64) {
        let items = BTreeMap::from([(name.to_owned(), Value::from(value))]);
        self.ask(Op::Set { items }).expect("this cell can be written");
    }

    /// The same for a station that may end before it answers.
    pub(crate) fn try_set(&self, name: &str, value: i64) {
        self.try_ask(Op::Set { items: BTreeMap::from([(name.to_owned(), Value::from(value))]) });
    }

    pub(crate) fn status(&self) -> Status {
        self.ask(Op::Status).expect("never refused").status.expect("an answer to status")
    }

    /// The whole diagnostic buffer, newest first; empty when the station does not answer.
    pub(crate) fn diagnostics(&self) -> Vec<Diagnostic> {
        self.try_ask(Op::Diag { count: 100 }).and_then(|response| response.diagnostics).unwrap_or_default()
    }

    /// Number of entries of an event in the diagnostic buffer: `"4302h"`.
    pub(crate) fn entries(&self, event: &str) -> usize {
        self.diagnostics().iter().filter(|entry| entry.event == event).count()
    }

    /// A counter of the station's CP: `"telegrams_sent"`.
    pub(crate) fn counter(&self, name: &str) -> i64 {
        let status = self.status();
        let cp = status.modules.iter().find(|module| module.driver.is_some()).expect("a CP");
        cp.counters[name] as i64
    }

    /// The driver of the station's CP: its process, number of starts, number of losses.
    pub(crate) fn driver(&self) -> (u32, u32, u32) {
        let status = self.status();
        let driver = status.modules.iter().find_map(|module| module.driver.as_ref()).expect("a CP");
        (driver.pid, driver.starts, driver.losses)
    }

    /// The same for the CP with this name.
    pub(crate) fn driver_of(&self, cp: &str) -> (u32, u32, u32) {
        let status = self.status();
        let module = status.modules.iter().find(|module| module.name == cp);
        let driver = module.and_then(|module| module.driver.as_ref()).expect("a CP of this name");
        (driver.pid, driver.starts, driver.losses)
    }

    /// The process of the driver, after its start.
    pub(crate) fn driver_process(&self) -> Watched {
        self.until("a driver", |s| Watched::find(s.driver().0))
    }

    /// The same for the CP with this name.
    pub(crate) fn driver_process_of(&self, cp: &str) -> Watched {
        self.until("a driver", |s| Watched::find(s.driver_of(cp).0))
    }

    /// Waits for some more scans in RUN.
    pub(crate) fn scans(&self, more: u64) {
        let begin = self.status().scans;
        self.until("scans go on", |s| (s.status().scans >= begin + more).then_some(()));
    }

    /// Sends Ctrl-C and waits for the end.
    pub(crate) fn interrupt(self) -> Ended {
        self.process.signal(Signal::INT);
        self.end()
    }

    /// Sends kill -9 and waits for the end.
    pub(crate) fn kill(self) -> Ended {
        self.process.signal(Signal::KILL);
        self.end()
    }

    /// Waits for its end.
    pub(crate) fn end(mut self) -> Ended {
        self.process.wait(&self.name);
        let status = self.child.wait().expect("a child that has ended");
        let read = |path: &PathBuf| fs::read_to_string(path).expect("its output");
        Ended { status, out: read(&self.out), err: read(&self.err) }
    }
}

fn name_in(file: &Path) -> String {
    let text = fs::read_to_string(file).expect("a station file");
    let line = text.lines().find_map(|line| line.strip_prefix("name = ")).expect("name = ... on a line of its own");
    line.trim().trim_matches('"').to_owned()
}
