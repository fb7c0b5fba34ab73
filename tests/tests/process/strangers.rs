//! Strangers at the links of a station: what they cannot take from those who know their password, and how little they
//! can make it write. Short here; long runs with `cargo xtask siege honest logs --minutes 2`.

use std::collections::VecDeque;
use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpStream};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Scope, scope};
use std::time::{Duration, Instant};

use ob1_tests::opcua::{OpcUa, OpcUaError};
use ob1_tests::s7_raw::Raw;
use ob1_tests::siege::Span;
use opcua_types::CreateSessionResponse;
use serde_json::json;

use crate::common::fleet::{Broker, Listener, connected, station, users};
use crate::common::gate::Visitor;
use crate::common::s7::free_port;
use crate::common::site::Site;

/// Attackers at a time.
const ATTACKERS: u64 = 24;
/// Within this time a right password gets in.
const IN: Duration = Duration::from_secs(5);
/// Waits for an answer that must come, also on a machine that has other things to do.
const PATIENCE: Duration = Duration::from_secs(60);
/// Lines a second that strangers may cause.
const LINES: usize = 50;

/// Ends the attackers when a test ends, also by a panic.
struct Attack<'a>(&'a AtomicBool);

impl Drop for Attack<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Attackers who do something again and again, until `stop`; each time has a number.
fn attack<'s>(
    scope: &'s Scope<'s, '_>,
    stop: &'s AtomicBool,
    count: &'s AtomicU64,
    act: impl Fn(u64, u64) + Send + Sync + Copy + 's,
) {
    for attacker in 0..ATTACKERS {
        scope.spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                act(attacker, count.fetch_add(1, Ordering::Relaxed));
            }
        });
    }
}

/// One wrong password.
fn guess(visitor: &Visitor, user: &str) {
    let _ = log_in(visitor, user, "wrong");
}

/// The status of a login; `None`: the connection has ended before the answer.
fn log_in(visitor: &Visitor, user: &str, password: &str) -> Option<u16> {
    let body = json!({ "user": user, "password": password }).to_string();
    let host = visitor.address;
    let request = format!(
        "POST /api/login HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    visitor.raw(request.as_bytes()).map(|answer| answer.status)
}

/// A try with a password at an S7 link, from its connection on; `None`: the connection was refused or has ended.
fn unlock(port: u16, password: &str) -> Option<u16> {
    let mut raw = Raw::open(port).ok()?;
    raw.0.set_read_timeout(Some(PATIENCE)).ok()?;
    raw.password(password).ok()
}

/// The address of an attacker, which nobody else has.
fn address(number: u64) -> Ipv4Addr {
    Ipv4Addr::from_bits(0x7F01_0000 + (number % 60_000) as u32)
}

/// A right password gets in within five seconds, whatever 24 attackers do; a `read` user ends nobody's session.
#[test]
fn honest() {
    let site = Site::new();
    users(&site);
    let [page, scada, panel] = [(); 3].map(|()| free_port());
    let links = format!(
        "[[link]]\ntype = \"web\"\nname = \"web\"\nlisten = \"127.0.0.1:{page}\"\nrights = \"operate\"\nusers = \
         \"gate.users\"\n\n[[link]]\ntype = \"opcua\"\nname = \"scada\"\nlisten = \"127.0.0.1:{scada}\"\nrights = \
         \"operate\"\nusers = \"gate.users\"\ntrust = \"any\"\n\n[[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \
         \"127.0.0.1:{panel}\"\npassword = \"secret\"\npassword_rights = \"operate\"\n"
    );
    let station = station(&site, "st-honest", &links);
    let opcua = SocketAddr::from(([127, 0, 0, 1], scada));
    station.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    station.until("clients are served", |_| OpcUa::open(opcua, Duration::from_secs(1)).ok());
    station.until("panels are served", |_| Raw::open(panel).ok());
    let anna = || drop(Visitor::as_user(page, "anna", "anna-secret"));
    let span = Span::of(1);
    // Times of the honest ones under an attack.
    let under = |what: &str, act: &(dyn Fn(u64, u64) + Sync), honest: &dyn Fn()| {
        let (stop, count) = (AtomicBool::new(false), AtomicU64::new(0));
        let (mut worst, mut times, begin) = (Duration::ZERO, 0, Instant::now());
        scope(|scope| {
            let _end = Attack(&stop);
            attack(scope, &stop, &count, act);
            // The attack is under way.
            while count.load(Ordering::Relaxed) < 2 * ATTACKERS && begin.elapsed() < PATIENCE {
                station.scans(4);
            }
            while times < 1 || span.is_campaign() && times < 10 {
                let begin = Instant::now();
                honest();
                worst = worst.max(begin.elapsed());
                times += 1;
            }
        });
        println!("{what}: {times} in, the last after {worst:?}; {} attacks", count.into_inner());
        assert!(!span.is_campaign() || worst <= IN, "{what}: {worst:?}");
    };
    let mut round = 0;
    while span.goes_on(round) {
        round += 1;
        let invented = |_: u64, number: u64| guess(&Visitor::at(page), &format!("user{number}"));
        under("invented names, one address", &invented, &anna);
        let many = |_: u64, number: u64| {
            let visitor = Visitor { from: Some(address(number)), ..Visitor::at(page) };
            guess(&visitor, &format!("user{number}"));
        };
        under("many addresses", &many, &anna);
        let elsewhere = |attacker: u64, _: u64| {
            let visitor = Visitor { from: Some(address(attacker)), ..Visitor::at(page) };
            guess(&visitor, "anna");
        };
        under("her name, other addresses", &elsewhere, &anna);
        under("her name, her address", &|_, _| guess(&Visitor::at(page), "anna"), &anna);
        under("her name, her address, OPC UA", &|_, _| guess(&Visitor::at(page), "anna"), &|| {
            drop(connected(&site, scada, &["--user", "anna", "--password", "anna-secret"]));
        });
        // A user of the link, also after minutes of what strangers do with sessions and channels.
        let by_opcua = || {
            let mut client = connected(&site, scada, &["--user", "anna", "--password", "anna-secret"]);
            let _ = client.done(&json!({ "op": "read", "ids": ["MW20"] }));
        };
        let patience = Duration::from_secs(5);
        let create = |client: &mut OpcUa| {
            let created: Result<CreateSessionResponse, OpcUaError> = client.call(&client.create_session(opcua));
            created.is_ok()
        };
        // As many on each connection as there may be, and one more.
        let many = |_: u64, _: u64| {
            let Ok(mut client) = OpcUa::open(opcua, patience) else { return };
            while create(&mut client) {}
        };
        under("sessions that are never activated", &many, &by_opcua);
        // Noise ends the connection: nobody can close the session over it any more.
        let broken = |_: u64, number: u64| {
            let Ok(mut client) = OpcUa::open(opcua, patience) else { return };
            while create(&mut client) && number.is_multiple_of(3) {}
            let noise = client.framed(false, &number.to_le_bytes());
            let _ = client.raw(&noise);
            let _ = create(&mut client);
        };
        under("sessions on connections that break", &broken, &by_opcua);
        let gone = |_: u64, _: u64| drop(OpcUa::connect(opcua, patience));
        under("anonymous sessions", &gone, &by_opcua);
        // They ask for something, so they have places.
        let places = |_: u64, _: u64| {
            let all: Vec<_> = (0..4).filter_map(|_| OpcUa::connect(opcua, patience).ok()).collect();
            for mut client in all {
                let _ =
                    client.subscribe(1000.0).and_then(|number| client.monitor(number, &["MW20".to_owned()], 1000.0));
            }
        };
        under("anonymous clients", &places, &by_opcua);
        let held = Mutex::new(VecDeque::new());
        let keep = |_: u64, number: u64| {
            let Ok(mut client) = OpcUa::open(opcua, patience) else { return };
            while create(&mut client) && number.is_multiple_of(2) {}
            let mut held = held.lock().expect("free");
            held.push_back(client);
            held.truncate(3000);
        };
        under("connections that stay", &keep, &by_opcua);
        drop(held);
        // Held for a moment, or until the gate closes them.
        let hold = |_: u64, _: u64| {
            let mut all: Vec<_> = (0..3).filter_map(|_| Visitor::at(page).connect()).collect();
            for stream in &mut all {
                let _ = stream.set_read_timeout(Some(Duration::from_millis(100)));
                let _ = stream.read(&mut [0; 64]);
            }
        };
        // Where thousands connect in a second, a browser may have to try again.
        under("connections that ask for nothing", &hold, &|| {
            let tries = (0..1000).find_map(|_| log_in(&Visitor::at(page), "anna", "anna-secret"));
            assert_eq!(tries, Some(200));
        });
        // A user with the least right logs in more often than there are sessions.
        let bert = |_: u64, _: u64| drop(Visitor::as_user(page, "bert", "bert-secret"));
        under("logins of somebody else", &bert, &anna);
        // All of them at the address of the engineer, and more than there are places.
        let engineer = || {
            let tries = (0..10_000).find_map(|_| unlock(panel, "secret"));
            assert_eq!(tries, Some(0));
        };
        let guess_pin = |_: u64, number: u64| _ = unlock(panel, &format!("pin{number}"));
        under("S7 passwords, her address", &guess_pin, &engineer);
        let silent = |_: u64, _: u64| {
            let Ok(mut raw) = Raw::open(panel) else { return };
            let _ = raw.0.set_read_timeout(Some(Duration::from_millis(300)));
            let _ = raw.frame();
        };
        under("S7 connections that ask for nothing", &silent, &engineer);
        let operator = Visitor::as_user(page, "anna", "anna-secret");
        let times = if span.is_campaign() { 130 } else { 20 };
        (0..times).for_each(|_| drop(Visitor::as_user(page, "bert", "bert-secret")));
        assert_eq!(operator.get("/api/status").status, 200, "the operator's session");
    }
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Whatever strangers do at the links of the gate, they cause at most 50 lines a second, and the log says how many were
/// left out.
#[test]
fn logs() {
    let site = Site::new();
    users(&site);
    let [page, figures, scada, panel] = [(); 4].map(|()| free_port());
    let link = |kind: &str, port: u16| {
        format!(
            "[[link]]\ntype = \"{kind}\"\nname = \"{kind}\"\nlisten = \"127.0.0.1:{port}\"\nusers = \"gate.users\"\n\n"
        )
    };
    let broker = Broker::start(&site);
    let mqtt = format!(
        "[[link]]\ntype = \"mqtt\"\nname = \"mqtt\"\nbroker = \"mqtt://127.0.0.1:{}\"\nrights = \"write\"\npublish = \
         [\"MW20\"]\ncommands = [\"MW20\"]\n",
        broker.port
    );
    let s7 = format!(
        "\n[[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{panel}\"\npassword = \
         \"secret\"\npassword_rights = \"operate\"\n"
    );
    let links = link("web", page) + &link("metrics", figures) + &link("opcua", scada) + &mqtt + &s7;
    let station = station(&site, "st-logs", &links);
    let mut listener = Listener::start(&site, broker.port, "ob1/st-logs/online");
    listener.until("online", |said| (said["payload"] == true).then_some(()));
    let opcua = SocketAddr::from(([127, 0, 0, 1], scada));
    station.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    station.until("clients are served", |_| OpcUa::open(opcua, Duration::from_secs(1)).ok());
    station.until("panels are served", |_| Raw::open(panel).ok());
    let span = Span::of(1);
    let seconds = if span.is_campaign() { 10 } else { 2 };
    let lines = || station.said().lines().count();
    // `left_out` is part of the line that is left out, if there are more than the log has room for.
    let under = |what: &str, least: u64, left_out: Option<&str>, act: &(dyn Fn(u64, u64) + Sync)| {
        let (stop, count) = (AtomicBool::new(false), AtomicU64::new(0));
        // The number of those that the attack before left out is told first.
        station.scans(250);
        let (mut worst, mut last, first) = (0, lines(), lines());
        scope(|scope| {
            let _end = Attack(&stop);
            attack(scope, &stop, &count, act);
            for _ in 0..seconds {
                let begin = Instant::now();
                // A second, or a little more.
                station.scans(200);
                let now = lines();
                worst = worst.max((now - last).div_ceil(begin.elapsed().as_secs().max(1) as usize));
                last = now;
            }
        });
        let count = count.into_inner();
        println!("{what}: {count} times, {} lines, at most {worst} a second", last - first);
        assert!(worst <= LINES, "{what}: {worst} lines a second");
        assert!(count > least, "{what}: only {count} times");
        let Some(text) = left_out else { return };
        let is_told = |line: &str| line.contains("like this one are left out: ") && line.contains(text);
        let told = |said: &str| said.lines().skip(first).any(is_told);
        station.until("what was left out", |station| told(&station.said()).then_some(()));
    };
    let get = |port: u16, heads: &str| {
        let _ = Visitor::at(port).raw(format!("GET / HTTP/1.1\r\n{heads}Connection: close\r\n\r\n").as_bytes());
    };
    let (many, mut round) = (2 * LINES as u64, 0);
    // Its lines are many.
    const LIBRARY: Option<&str> = Some("");
    while span.goes_on(round) {
        round += 1;
        under("a wrong host", many, Some("not a name of the station"), &|_, _| get(page, "Host: evil.example\r\n"));
        under("a wrong origin", many, Some("another page"), &|_, _| {
            get(figures, "Host: localhost\r\nOrigin: http://evil.example\r\n");
        });
        under("connections", many, LIBRARY, &|_, _| drop(OpcUa::open(opcua, Duration::from_secs(5))));
        under("noise", many, LIBRARY, &|_, number| {
            let Ok(mut stream) = TcpStream::connect(opcua) else { return };
            let _ = stream.write_all(&number.to_le_bytes().repeat(20));
            let _ = stream.shutdown(Shutdown::Write);
            let _ = stream.read(&mut [0; 64]);
        });
        // Each takes its turn, so there are fewer.
        under("wrong passwords", ATTACKERS, Some("wrong name or password"), &|_, number| {
            let visitor = Visitor { from: Some(address(number)), ..Visitor::at(page) };
            guess(&visitor, &format!("user{number}"));
        });
        let (said, first) = (Mutex::new(&mut listener), AtomicU64::new(0));
        under("unknown commands", 0, Some("command "), &|_, _| {
            // Not faster than the client reads.
            let _ = Visitor::at(page).try_get("/api/session");
            let number = first.fetch_add(1, Ordering::Relaxed);
            let topic = if number % 2 == 0 { "MW20".to_owned() } else { format!("X{number}") };
            let mut listener = said.lock().expect("free");
            listener.say(&json!({ "topic": format!("ob1/st-logs/{topic}/set"), "payload": "wrong" }));
        });
        // Who asks for nothing, or not for S7, has no line.
        under("S7 connections", many, None, &|_, _| drop(Raw::open(panel)));
        under("S7 noise", many, None, &|_, number| {
            let Ok(mut stream) = TcpStream::connect(("127.0.0.1", panel)) else { return };
            let _ = stream.write_all(&number.to_le_bytes().repeat(20));
            let _ = stream.shutdown(Shutdown::Write);
            let _ = stream.read(&mut [0; 64]);
        });
        // All guess at one address and wait for each other: the log has room for each.
        under("S7 passwords", ATTACKERS, None, &|_, number| _ = unlock(panel, &format!("pin{number}")));
        under("sessions", many, LIBRARY, &|_, _| {
            let Ok(mut client) = OpcUa::open(opcua, Duration::from_secs(5)) else { return };
            let _: Result<CreateSessionResponse, OpcUaError> = client.call(&client.create_session(opcua));
        });
    }
    assert_eq!(station.interrupt().code(), Some(0));
}
