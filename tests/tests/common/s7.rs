//! Foreign clients of S7 communication, and stations with an S7 link.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

use super::processes::Watched;
use super::site::Site;
use super::station::{Running, counting};
use super::{checkout, python};

/// A currently unused port.
pub(crate) fn free_port() -> u16 {
    let free = TcpListener::bind("127.0.0.1:0").expect("a port");
    free.local_addr().expect("an address").port()
}

const DATA: &str = "
DATA_BLOCK DB 10
STRUCT
  number : INT := 4660;
  real : REAL := 1.5;
  bits : WORD := W#16#8001;
  text : STRING[20] := 'hello';
  cells : ARRAY[0..69] OF BYTE;
END_STRUCT
BEGIN
END_DATA_BLOCK
";
/// The program after the counting.
const REST: &str = "\
      L     S5T#30s;
      U     M 99.0;
      SI    T 3;
      U     M 99.1;
      ZV    Z 4;
";

/// A station with a link with these keys, in RUN and reachable.
pub(crate) fn station(site: &Site, name: &str, keys: &str) -> (Running, u16) {
    let port = free_port();
    site.write("plant.awl", &counting(DATA, REST));
    let file = format!(
        "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"10s\"\n\n[program]\nsources = [\"plant.awl\"]\n\n\
         [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\n{keys}\n"
    );
    site.write("station.toml", &file);
    let station = site.run("station.toml").until_run();
    station.until("the link listens", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    (station, port)
}

/// The process of the link.
pub(crate) fn link_of(station: &Running) -> Watched {
    station.until("the process of the link", |station| {
        let task = format!("/proc/{0}/task/{0}/children", station.process.pid);
        let all = std::fs::read_to_string(task).unwrap_or_default();
        // It may have been started by any thread.
        let threads = std::fs::read_dir(format!("/proc/{}/task", station.process.pid)).ok()?;
        let more = threads.flatten().filter_map(|t| std::fs::read_to_string(t.path().join("children")).ok());
        let children: Vec<u32> = std::iter::once(all)
            .chain(more)
            .flat_map(|text| text.split_whitespace().filter_map(|pid| pid.parse().ok()).collect::<Vec<u32>>())
            .collect();
        let is_link =
            |pid: &u32| std::fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|name| name.trim() == "ob1-s7");
        children.into_iter().find(is_link).and_then(Watched::find)
    })
}

/// A running client: one line as request, one line as answer.
pub(crate) struct Client {
    child: Child,
    requests: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

impl Client {
    /// `native`, `pure`, `pys7` or `nodes7`, connected.
    pub(crate) fn start(site: &Site, name: &str, port: u16) -> Self {
        let mut command = if name == "nodes7" {
            let mut node = site.command("node");
            node.arg(checkout("tests/peers/s7_nodes7.js"));
            node
        } else {
            let mut script = site.command(python());
            script.arg(checkout("tests/peers/s7.py")).arg(name);
            script
        };
        let mut client = Self::of(command.args(["127.0.0.1", &port.to_string()]));
        let connected = client.answer();
        assert_eq!(connected["ok"], true, "{name}: {connected}");
        client
    }

    /// Starts any command that answers line by line.
    pub(crate) fn of(command: &mut Command) -> Self {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the client starts");
        let requests = child.stdin.take();
        let answers = BufReader::new(child.stdout.take().expect("a pipe"));
        Self { child, requests, answers }
    }

    /// The next line of its output.
    pub(crate) fn answer(&mut self) -> Value {
        let mut line = String::new();
        self.answers.read_line(&mut line).expect("a line");
        serde_json::from_str(&line).unwrap_or_else(|why| json!({ "ok": false, "error": format!("{why}: {line:?}") }))
    }

    /// Sends a request; returns the answer, also an error.
    pub(crate) fn ask(&mut self, request: &Value) -> Value {
        writeln!(self.requests.as_mut().expect("open until the end"), "{request}").expect("a client that reads");
        self.answer()
    }

    /// The same; the request must succeed.
    pub(crate) fn done(&mut self, request: &Value) -> Value {
        let answer = self.ask(request);
        assert_eq!(answer["ok"], true, "{request}: {answer}");
        answer
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        drop(self.requests.take());
        let _ = self.child.wait();
    }
}
