//! Stations with a web page and metrics, and an HTTP client that can also send what a browser would not.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::Stdio;
use std::time::Duration;

use rustix::net;
use serde_json::Value;

use super::Guard;
use super::processes::Watched;
use super::s7::free_port;
use super::site::Site;
use super::station::Running;
use super::{checkout, program};

/// An answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: String,
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|why| panic!("{why}: {self:?}"))
    }

    /// The value of a header line.
    pub(crate) fn head(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim())
        })
    }
}

/// A client of the page of a station.
#[derive(Clone, Debug)]
pub(crate) struct Visitor {
    pub(crate) address: SocketAddr,
    pub(crate) cookie: Option<String>,
    /// The own address; `None`: any.
    pub(crate) from: Option<Ipv4Addr>,
}

impl Visitor {
    pub(crate) fn at(port: u16) -> Self {
        Self { address: SocketAddr::from(([127, 0, 0, 1], port)), cookie: None, from: None }
    }

    pub(crate) fn connect(&self) -> Option<TcpStream> {
        let stream = match self.from {
            None => TcpStream::connect(self.address).ok()?,
            Some(from) => {
                let socket = net::socket(net::AddressFamily::INET, net::SocketType::STREAM, None).ok()?;
                net::bind(&socket, &SocketAddr::from((from, 0))).ok()?;
                net::connect(&socket, &self.address).ok()?;
                TcpStream::from(socket)
            }
        };
        stream.set_read_timeout(Some(Duration::from_secs(60))).ok()?;
        Some(stream)
    }

    /// Sends these bytes and reads to the end; `None`: there is no answer.
    pub(crate) fn raw(&self, bytes: &[u8]) -> Option<Answer> {
        let mut stream = self.connect()?;
        // If the request is refused before its end, the answer is still read.
        let _ = stream.write_all(bytes);
        read(&mut BufReader::new(stream))
    }

    fn request(&self, method: &str, path: &str, more: &str, body: &str) -> String {
        let cookie = self.cookie.as_ref().map_or_else(String::new, |cookie| format!("Cookie: {cookie}\r\n"));
        let length = if body.is_empty() { String::new() } else { format!("Content-Length: {}\r\n", body.len()) };
        let host = self.address;
        format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\n{cookie}{more}{length}Connection: close\r\n\r\n{body}")
    }

    pub(crate) fn try_get(&self, path: &str) -> Option<Answer> {
        self.raw(self.request("GET", path, "", "").as_bytes())
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        self.try_get(path).unwrap_or_else(|| panic!("no answer to {path}"))
    }

    pub(crate) fn get_with(&self, path: &str, more: &str) -> Answer {
        self.raw(self.request("GET", path, more, "").as_bytes()).unwrap_or_else(|| panic!("no answer to {path}"))
    }

    /// Sends a request like the page.
    pub(crate) fn post(&self, path: &str, body: &Value) -> Answer {
        let more = format!("Origin: http://{}\r\nContent-Type: application/json\r\n", self.address);
        self.post_with(path, &more, body)
    }

    pub(crate) fn post_with(&self, path: &str, more: &str, body: &Value) -> Answer {
        self.send("POST", path, more, body)
    }

    /// Sends a body with any method.
    pub(crate) fn send(&self, method: &str, path: &str, more: &str, body: &Value) -> Answer {
        let request = self.request(method, path, more, &body.to_string());
        self.raw(request.as_bytes()).unwrap_or_else(|| panic!("no answer to {method} {path}"))
    }

    /// A client that is logged in.
    pub(crate) fn as_user(port: u16, user: &str, password: &str) -> Self {
        let mut visitor = Self::at(port);
        let answer = visitor.post("/api/login", &serde_json::json!({ "user": user, "password": password }));
        assert_eq!(answer.status, 200, "{answer:?}");
        let cookie = answer.head("set-cookie").expect("a cookie");
        for part in ["HttpOnly", "SameSite=Strict", "Path=/"] {
            assert!(cookie.contains(part), "{cookie}");
        }
        visitor.cookie = cookie.split(';').next().map(str::to_owned);
        visitor
    }

    /// The head of an answer whose body may never end.
    pub(crate) fn get_head(&self, path: &str) -> String {
        let mut stream = self.connect().expect("it listens");
        stream.write_all(self.request("GET", path, "", "").as_bytes()).expect("connected");
        head(&mut BufReader::new(stream)).unwrap_or_else(|| panic!("no answer to {path}"))
    }

    /// A stream of server-sent events.
    pub(crate) fn stream(&self, query: &str, more: &str) -> Stream {
        let mut stream = self.connect().expect("it listens");
        let request = self.request("GET", &format!("/api/stream{query}"), more, "");
        stream.write_all(request.as_bytes()).expect("connected");
        let mut reader = BufReader::new(stream);
        let head = head(&mut reader).expect("an answer");
        assert!(head.starts_with("HTTP/1.1 200") && head.contains("text/event-stream"), "{head}");
        Stream { reader, text: String::new() }
    }
}

/// Reads the answer from a connection.
pub(crate) fn answer(stream: TcpStream) -> Option<Answer> {
    read(&mut BufReader::new(stream))
}

fn head(reader: &mut BufReader<TcpStream>) -> Option<String> {
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        if reader.read_line(&mut head).ok()? == 0 {
            return None;
        }
    }
    Some(head)
}

fn read(reader: &mut BufReader<TcpStream>) -> Option<Answer> {
    let head = head(reader)?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    let mut body = Vec::new();
    let heads = head.to_ascii_lowercase();
    if heads.contains("transfer-encoding: chunked") {
        while let Some(mut chunk) = chunk(reader) {
            body.append(&mut chunk);
        }
    } else {
        let length = heads.lines().find_map(|line| line.strip_prefix("content-length:")?.trim().parse().ok());
        let _ = reader.take(length.unwrap_or(u64::MAX)).read_to_end(&mut body);
    }
    Some(Answer { status, head, body: String::from_utf8_lossy(&body).into_owned() })
}

/// The next chunk of a body; `None` after the last one.
fn chunk(reader: &mut BufReader<TcpStream>) -> Option<Vec<u8>> {
    let mut size = String::new();
    reader.read_line(&mut size).ok()?;
    let size = usize::from_str_radix(size.trim(), 16).ok().filter(|size| *size > 0)?;
    let mut chunk = vec![0; size + 2];
    reader.read_exact(&mut chunk).ok()?;
    chunk.truncate(size);
    Some(chunk)
}

/// Server-sent events, one after the other.
pub(crate) struct Stream {
    reader: BufReader<TcpStream>,
    text: String,
}

impl Stream {
    /// The next line of the body, independent of the chunks.
    fn line(&mut self) -> Option<String> {
        loop {
            if let Some((line, rest)) = self.text.split_once('\n') {
                let (line, rest) = (line.to_owned(), rest.to_owned());
                self.text = rest;
                return Some(line);
            }
            let chunk = chunk(&mut self.reader)?;
            self.text += &String::from_utf8(chunk).ok()?;
        }
    }

    /// The next event of this name: its number and its data; `None`: the stream has ended.
    pub(crate) fn next(&mut self, name: &str) -> Option<(Option<u64>, Value)> {
        let (mut id, mut event) = (None, String::new());
        loop {
            let line = self.line()?;
            if let Some(number) = line.strip_prefix("id: ") {
                id = number.parse().ok();
            } else if let Some(name) = line.strip_prefix("event: ") {
                event = name.to_owned();
            } else if let Some(data) = line.strip_prefix("data: ")
                && event == name
            {
                return Some((id, serde_json::from_str(data).expect("JSON")));
            } else if line.is_empty() {
                (id, event) = (None, String::new());
            }
        }
    }

    /// Waits for the first event of this name that `wanted` accepts.
    pub(crate) fn until(&mut self, name: &str, wanted: impl Fn(&Value) -> bool) -> (Option<u64>, Value) {
        loop {
            let (id, data) = self.next(name).expect("the stream goes on");
            if wanted(&data) {
                return (id, data);
            }
        }
    }
}

/// The example station with these keys for its page, another name and free ports for the page and the metrics.
pub(crate) fn station(site: &Site, name: &str, keys: &str) -> (Running, u16, u16) {
    let (page, figures) = (free_port(), free_port());
    for file in ["plant.awl", "plant.sdf"] {
        std::fs::copy(checkout("examples/web").join(file), site.path(file)).expect("a file of the example");
    }
    let link = |kind: &str, port: u16| {
        format!("[[link]]\ntype = \"{kind}\"\nname = \"{kind}\"\nlisten = \"127.0.0.1:{port}\"\n")
    };
    let file = format!(
        "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"10s\"\n\n[program]\n\
         sources = [\"plant.awl\"]\nsymbols = [\"plant.sdf\"]\n\n{}{keys}\n{}",
        link("web", page),
        link("metrics", figures)
    );
    site.write("station.toml", &file);
    let station = site.run("station.toml").until_run();
    station.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    (station, page, figures)
}

/// A press with a guard (tests/stations/press) with these keys for its page.
pub(crate) fn press(site: &Site, name: &str, keys: &str) -> (Running, u16) {
    let page = free_port();
    let folder = checkout("tests/stations/press");
    for file in ["press.awl", "press.sdf"] {
        std::fs::copy(folder.join(file), site.path(file)).expect("a file of the station");
    }
    let file = std::fs::read_to_string(folder.join("station.toml")).expect("a station");
    let file = file.replace("name = \"press\"", &format!("name = \"{name}\""));
    let link = format!("[[link]]\ntype = \"web\"\nname = \"web\"\nlisten = \"127.0.0.1:{page}\"\n{keys}\n");
    site.write("station.toml", &(file + &link));
    let station = site.run("station.toml").until_run();
    station.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    (station, page)
}

/// Adds a user to a file with the command.
pub(crate) fn add_user(site: &Site, file: &str, name: &str, rights: &str, password: &str) {
    let mut command = site.command(program("ob1-gate"));
    command.args(["user", "add", file, name, "--rights", rights]).stdin(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("ob1-gate starts");
    writeln!(child.stdin.take().expect("a pipe"), "{password}").expect("it reads");
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The process of the gate of a station, and its process ID.
pub(crate) fn gate(station: &Running) -> (u32, Watched) {
    let of = |pid: u32| {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let field = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
        let parent = station.status().pid.to_string();
        (field("Name:") == Some("ob1-gate") && field("PPid:") == Some(parent.as_str())).then_some(pid)
    };
    let guard = Guard::begin();
    loop {
        let entries = std::fs::read_dir("/proc").expect("/proc").flatten();
        let found = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).find_map(of);
        if let Some((pid, process)) = found.and_then(|pid| Some((pid, Watched::find(pid)?))) {
            return (pid, process);
        }
        assert!(!guard.is_over(), "no gate");
    }
}
