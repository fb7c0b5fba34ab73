//! A program that plays JSON lines from its standard input and answers each with a JSON line: the devices of the tests.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::Value;

/// Such a running program.
pub(crate) struct Steps {
    child: Child,
    steps: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

impl Steps {
    /// Starts it, and returns its first output.
    pub(crate) fn start(command: &mut Command) -> (Self, Value) {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the interpreter starts");
        let steps = child.stdin.take();
        let answers = BufReader::new(child.stdout.take().expect("piped"));
        let mut steps = Self { child, steps, answers };
        let first = steps.answer();
        (steps, first)
    }

    /// Gives one step and returns the answer.
    pub(crate) fn ask(&mut self, step: &Value) -> Value {
        writeln!(self.steps.as_mut().expect("open until the end"), "{step}").expect("a device that reads its steps");
        self.answer()
    }

    /// Closes its standard input and returns the answer.
    pub(crate) fn finish(&mut self) -> Value {
        drop(self.steps.take());
        self.answer()
    }

    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("it runs");
        self.child.wait().expect("ours");
    }

    fn answer(&mut self) -> Value {
        let mut text = String::new();
        self.answers.read_line(&mut text).expect("its output");
        serde_json::from_str(&text).unwrap_or_else(|why| panic!("{why}: {text:?}"))
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        let _ = (self.child.kill(), self.child.wait());
    }
}
