//! Stations with links of `ob1-gate`, and the partners of OPC UA and MQTT.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::gate::add_user;
use super::s7::{Client, free_port};
use super::site::Site;
use super::station::{Running, counting};
use super::{Guard, checkout, python};

const DATA: &str = "
DATA_BLOCK DB 10
TITLE = Press
STRUCT
  number : INT := -7;
  real : REAL := 1.5;
  text : STRING[20] := 'hello';
  delay : TIME := T#1500ms;
  ramp : ARRAY[1..3] OF INT := 1, 2, 3;
  motor : STRUCT
    speed : DINT := 70000;
    on : BOOL := TRUE;
  END_STRUCT;
  moment : DATE_AND_TIME := DT#2026-1-2-3:4:5.678;
  axes : ARRAY[0..1] OF STRUCT
    pos : REAL;
  END_STRUCT;
END_STRUCT
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 11
STRUCT
  long : ARRAY[0..29999] OF INT;
END_STRUCT
BEGIN
END_DATA_BLOCK
";

/// Starts a station with these links; returns when it is in RUN.
pub(crate) fn station(site: &Site, name: &str, links: &str) -> Running {
    site.write("plant.awl", &counting(DATA, ""));
    site.write("plant.sdf", "\"Start\",\"M 10.0\",\"BOOL\",\"\"\r\n\"Level\",\"MW 20\",\"INT\",\"\"\r\n");
    let file = format!(
        "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"10s\"\n\n[program]\nsources = \
         [\"plant.awl\"]\nsymbols = [\"plant.sdf\"]\n\n{links}\n"
    );
    site.write("station.toml", &file);
    site.run("station.toml").until_run()
}

/// A file of users: `anna` may operate, `bert` only read. The password is the name and `-secret`.
pub(crate) fn users(site: &Site) {
    for (name, rights) in [("anna", "operate"), ("bert", "read")] {
        add_user(site, "gate.users", name, rights, &format!("{name}-secret"));
    }
}

/// A station with an OPC UA link of these keys, and the port it listens on.
pub(crate) fn opcua(site: &Site, name: &str, keys: &str) -> (Running, u16) {
    let port = free_port();
    let link = format!("[[link]]\ntype = \"opcua\"\nname = \"scada\"\nlisten = \"127.0.0.1:{port}\"\n{keys}");
    let station = station(site, name, &link);
    station.until("the link answers", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    (station, port)
}

/// Starts asyncua; its first answer says whether it is connected.
pub(crate) fn asyncua(site: &Site, port: u16, more: &[&str]) -> Client {
    let mut command = site.command(python());
    command.arg(checkout("tests/peers/opcua.py")).arg(format!("opc.tcp://127.0.0.1:{port}/")).args(more);
    Client::of(&mut command)
}

/// Starts node-opcua; its first answer says whether it is connected, or why not. Arguments: URL, user, password,
/// policy.
pub(crate) fn node_opcua(site: &Site, port: u16, more: &[&str]) -> Client {
    let mut command = site.command("node");
    command.arg(checkout("tests/peers/opcua_node.js")).arg(format!("opc.tcp://127.0.0.1:{port}/")).args(more);
    Client::of(&mut command)
}

/// The same, checked to be connected.
pub(crate) fn connected(site: &Site, port: u16, more: &[&str]) -> Client {
    let mut client = asyncua(site, port, more);
    let answer = client.answer();
    assert_eq!(answer["ok"], true, "{answer}");
    client
}

/// mosquitto, which can be stopped and started again with its stored data.
pub(crate) struct Broker<'s> {
    site: &'s Site,
    pub(crate) port: u16,
    child: Option<Child>,
}

impl<'s> Broker<'s> {
    pub(crate) fn start(site: &'s Site) -> Self {
        let port = free_port();
        std::fs::create_dir_all(site.path("broker")).expect("a folder");
        let file = format!(
            "listener {port} 127.0.0.1\nallow_anonymous true\nmax_inflight_messages 0\npersistence true\npersistence_location {}/\n\
             autosave_interval 1\nautosave_on_changes true\nmax_queued_messages 0\nqueue_qos0_messages true\nuser root\n",
            site.path("broker").display()
        );
        site.write("mosquitto.conf", &file);
        let mut broker = Self { site, port, child: None };
        broker.begin();
        broker
    }

    /// Starts it and waits until it accepts connections.
    pub(crate) fn begin(&mut self) {
        let place =
            ["/usr/sbin/mosquitto", "mosquitto"].into_iter().find(|place| std::path::Path::new(place).is_file());
        let mut command = self.site.command(place.unwrap_or("mosquitto"));
        command.args(["-c", "mosquitto.conf"]).stdout(Stdio::null()).stderr(Stdio::null());
        self.child = Some(command.spawn().expect("mosquitto starts (cargo xtask test installs it)"));
        let guard = Guard::begin();
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(!guard.is_over(), "mosquitto does not listen");
            std::thread::yield_now();
        }
    }

    /// Stopped like by a service manager: it keeps everything it has acknowledged.
    pub(crate) fn end(&mut self) {
        self.signal(Signal::TERM);
    }

    /// Killed.
    pub(crate) fn kill(&mut self) {
        self.signal(Signal::KILL);
    }

    fn signal(&mut self, signal: Signal) {
        if let Some(mut child) = self.child.take() {
            if let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
                let _ = kill_process(pid, signal);
            }
            let _ = child.wait();
        }
    }
}

impl Drop for Broker<'_> {
    fn drop(&mut self) {
        self.end();
    }
}

/// paho, which reports received messages, and publishes messages on request.
pub(crate) struct Listener {
    child: Child,
    says: Option<ChildStdin>,
    heard: Receiver<Value>,
}

impl Listener {
    /// Starts it with a subscription.
    pub(crate) fn start(site: &Site, port: u16, topic: &str) -> Self {
        let mut command: Command = site.command(python());
        command.arg(checkout("tests/peers/mqtt.py")).args(["127.0.0.1", &port.to_string(), topic]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the client starts");
        let (to, heard) = channel();
        let lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let value = serde_json::from_str(&line).unwrap_or_else(|why| panic!("{why}: {line}"));
                if to.send(value).is_err() {
                    return;
                }
            }
        });
        let says = child.stdin.take();
        let listener = Self { child, says, heard };
        listener.until("subscribed", |said| said["subscribed"].as_bool());
        listener
    }

    /// Waits for the first message for which `look` returns a value.
    pub(crate) fn until<T>(&self, what: &str, mut look: impl FnMut(&Value) -> Option<T>) -> T {
        let guard = Guard::begin();
        let mut last = Value::Null;
        loop {
            match self.heard.recv_timeout(Duration::from_millis(100)) {
                Ok(said) => match look(&said) {
                    Some(found) => return found,
                    None => last = said,
                },
                Err(RecvTimeoutError::Timeout) => assert!(!guard.is_over(), "{what}: not so far; last: {last}"),
                Err(RecvTimeoutError::Disconnected) => panic!("{what}: the client has ended; last: {last}"),
            }
        }
    }

    pub(crate) fn say(&mut self, what: &Value) {
        writeln!(self.says.as_mut().expect("open until the end"), "{what}").expect("a client that reads");
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        drop(self.says.take());
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
