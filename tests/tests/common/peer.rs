//! The foreign partner: `tests/peers/s3964r.py` on a station's pty.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Stdio};

use serde_json::Value;

use super::processes::Watched;
use super::site::Site;
use super::{checkout, python};

/// The events recorded by a partner.
#[derive(Debug)]
pub(crate) struct Events(pub(crate) Vec<Value>);

impl Events {
    /// All events of a kind.
    pub(crate) fn all(&self, kind: &str) -> Vec<&Value> {
        self.0.iter().filter(|event| event["event"] == kind).collect()
    }

    /// The payloads of the telegrams that arrived, in hexadecimal.
    pub(crate) fn received(&self) -> Vec<&str> {
        self.all("received").iter().map(|event| event["data"].as_str().expect("hexadecimal")).collect()
    }

    /// The reasons why blocks or requests of the station were not acknowledged.
    pub(crate) fn refused(&self) -> Vec<&str> {
        self.all("refused").iter().map(|event| event["why"].as_str().expect("a reason")).collect()
    }

    /// The answers instead of DLE: (to what, which character).
    pub(crate) fn answers(&self) -> Vec<(&str, &str)> {
        self.all("answer")
            .into_iter()
            .map(|event| (event["to"].as_str().expect("text"), event["byte"].as_str().expect("text")))
            .collect()
    }
}

/// The running partner on a tty. It plays one step after the other, with its own time limit for each step.
#[derive(Debug)]
pub(crate) struct Partner {
    process: Watched,
    child: Child,
    steps: Option<ChildStdin>,
    out: PathBuf,
}

impl Partner {
    pub(crate) fn start(site: &Site, tty: &Path, priority: &str) -> Self {
        Self::start_script(site, tty, priority, "tests/peers/s3964r.py")
    }

    /// Starts another script with the same options.
    pub(crate) fn start_script(site: &Site, tty: &Path, priority: &str, script: &str) -> Self {
        let out = site.path("peer.out");
        let mut child = site
            .command(python())
            .arg(checkout(script))
            .arg(tty)
            // Long times, as in the stations of these tests.
            .args(["--priority", priority, "--qvz-ms", "2000", "--zvz-ms", "1000"])
            .stdin(Stdio::piped())
            .stdout(File::create(&out).expect("room for a file"))
            .spawn()
            .expect("the interpreter starts");
        let process = Watched::find(child.id()).expect("a child, living or dead, is there until it is waited for");
        let steps = child.stdin.take();
        Self { process, child, steps, out }
    }

    /// Adds a step.
    pub(crate) fn give(&mut self, step: &Value) {
        let steps = self.steps.as_mut().expect("open until the end");
        writeln!(steps, "{step}").expect("a partner that reads its steps");
    }

    /// Waits until all steps have been played and returns the events.
    pub(crate) fn end(mut self) -> Events {
        drop(self.steps.take());
        self.process.wait("the partner");
        let status = self.child.wait().expect("a child that has ended");
        let text = std::fs::read_to_string(&self.out).expect("its output");
        let events = Events(text.lines().map(|line| serde_json::from_str(line).expect("an event a line")).collect());
        assert!(status.success(), "the partner gave up: {events:#?}");
        events
    }
}
