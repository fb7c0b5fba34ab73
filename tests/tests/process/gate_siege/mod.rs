//! Sieges of the gate: hostile data over HTTP, OPC UA and MQTT for read-only links; clients that request too much; a
//! killed broker. Short here; long runs with `cargo xtask siege gate_http --minutes 10`.

mod requests;

use std::collections::BTreeSet;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use ob1_line::sim::SplitMix64;
use ob1_tests::opcua::{OpcUa, OpcUaError, hello, value_of};
use ob1_tests::siege::{Span, mutate, random, rounds};
use opcua_types::{
    CloseSessionRequest, DataValue, NodeId, ReadRequest, ReadResponse, StatusCode, Variant, WriteRequest,
    WriteResponse, WriteValue,
};
use requests::{claims, seeds};
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::common::Guard;
use crate::common::fleet::{Broker, Listener, station};
use crate::common::gate::{Visitor, gate};
use crate::common::processes::Watched;
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;

/// Maximum wait for an answer that may not come.
const ANSWER: Duration = Duration::from_millis(300);
/// The same for an answer that must come, also on a machine that stands still for a while.
const PATIENCE: Duration = Duration::from_secs(120);
/// Maximum time for the restart of a gate.
const BACK: Duration = Duration::from_secs(1);
/// Values that a read-only link must not change.
const KEPT: [&str; 8] = ["DB10.DBD 0", "DB10.DBD 6", "DB10.DBD 28", "DB10.DBD 34", "M 10.0", "MW 20", "MD 40", "QW 0"];

/// A station whose values must not change, and its gate, which may die but must be restarted.
struct Besieged {
    station: Running,
    before: Vec<i64>,
    gate: Watched,
    /// Whether a client is served: the sockets belong to the runtime and accept connections even without a gate.
    served: Box<dyn Fn() -> bool>,
    /// Number of deaths of the gate, and its longest absence.
    deaths: u64,
    gone: Duration,
}

impl Besieged {
    fn new(station: Running, served: impl Fn() -> bool + 'static) -> Self {
        station.until("somebody is served", |_| served().then_some(()));
        station.set("MW 20", 4711);
        let before = station.cells(&KEPT);
        let (_, gate) = gate(&station);
        Self { station, before, gate, served: Box::new(served), deaths: 0, gone: Duration::ZERO }
    }

    /// Checks that no value has changed, and waits for the restart of a dead gate.
    fn look(&mut self, round: u64) {
        if self.gate.has_ended() {
            self.deaths += 1;
            self.wait();
            let why: Vec<_> = self.station.diagnostics().into_iter().take(3).collect();
            println!("round {round}: the gate has died: {why:?}\n{}", self.station.said());
        }
        assert_eq!(self.station.cells(&KEPT), self.before, "round {round}: something has changed");
        let status = self.station.status();
        assert_eq!((status.state.as_str(), status.watchdogs), ("RUN", 0), "round {round}");
    }

    fn wait(&mut self) {
        let begin = Instant::now();
        self.station.until("the gate is back", |_| (self.served)().then_some(()));
        self.gone = self.gone.max(begin.elapsed());
        self.gate = gate(&self.station).1;
    }

    /// Kills the gate once at the end, to measure the restart.
    fn end(mut self, span: &Span, what: &str) {
        self.look(u64::MAX);
        self.gate.signal(Signal::KILL);
        self.gate.wait("the gate");
        self.wait();
        println!("{what}; the gate has died {} times, and was gone {:?} at most", self.deaths, self.gone);
        assert_eq!(self.deaths, 0, "input has killed the gate");
        assert!(!span.is_campaign() || self.gone <= BACK, "the gate was gone too long");
        assert_eq!(self.station.interrupt().code(), Some(0));
    }
}

/// Whether the page on this port is served.
fn page_comes(port: u16) -> impl Fn() -> bool {
    move || Visitor::at(port).try_get("/").is_some_and(|answer| answer.status == 200)
}

/// Whether an OPC UA server at this address opens a channel.
fn channel_opens(address: SocketAddr) -> impl Fn() -> bool {
    move || OpcUa::open(address, BACK).is_ok()
}

/// Sends bytes and reads the beginning of an answer.
fn send(port: u16, bytes: &[u8]) -> Option<usize> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
    stream.set_read_timeout(Some(ANSWER)).ok()?;
    stream.set_write_timeout(Some(ANSWER)).ok()?;
    // The connection may be closed while sending.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(std::net::Shutdown::Write);
    stream.read(&mut [0; 512]).ok()
}

/// Damaged requests of the page: a page without users only shows values and changes nothing.
#[test]
fn gate_http() {
    let site = Site::new();
    let (page, figures) = (free_port(), free_port());
    let link = |kind: &str, port: u16| {
        format!("[[link]]\ntype = \"{kind}\"\nname = \"{kind}\"\nlisten = \"127.0.0.1:{port}\"\nclients = 16\n")
    };
    let station = station(&site, "gs-http", &(link("web", page) + &link("metrics", figures)));
    let mut besieged = Besieged::new(station, page_comes(page));
    let heads = format!(
        "Host: 127.0.0.1:{page}\r\nOrigin: http://127.0.0.1:{page}\r\nContent-Type: application/json\r\nCookie: ob1={}\r\n",
        "a1".repeat(32)
    );
    let get = |path: &str| format!("GET {path} HTTP/1.1\r\n{heads}\r\n").into_bytes();
    let post = |path: &str, body: &Value| {
        let body = body.to_string();
        format!("POST {path} HTTP/1.1\r\n{heads}Content-Length: {}\r\n\r\n{body}", body.len()).into_bytes()
    };
    let mut requests: Vec<Vec<u8>> = [
        "/",
        "/app.js",
        "/metrics",
        "/api/session",
        "/api/status",
        "/api/timing",
        "/api/why",
        "/api/diagnostics",
        "/api/program",
        "/api/block?id=OB%201",
        "/api/block?id=DB%2010",
        "/api/xref?operand=MW%20100",
        "/api/reports?name=..%2F..%2Fetc%2Fpasswd",
        "/api/stream?period=100&items=MW20%0ADB10.text%0ADB10.ramp%0AMW20:hex",
        "/api/stream?telegrams=1",
    ]
    .iter()
    .map(|path| get(path))
    .collect();
    requests.push(post("/api/write", &json!({ "item": "MW 20", "value": 1 })));
    requests.push(post("/api/write", &json!({ "item": "DB10.text", "value": "changed" })));
    requests.push(post("/api/command", &json!({ "command": "stop" })));
    requests.push(post("/api/login", &json!({ "user": "anna", "password": "anna-secret" })));
    requests.push(post("/api/logout", &json!({})));
    let span = Span::of(300);
    let mut random = random(0x4854_5450);
    let (mut round, mut answered) = (0, 0);
    while span.goes_on(round) {
        let pick = |random: &mut SplitMix64| &requests[random.below(requests.len() as u64) as usize];
        let (one, other) = (pick(&mut random), pick(&mut random));
        // Some undamaged: these also must not change anything.
        let input = if random.below(10) == 0 { one.clone() } else { mutate(&mut random, one, other) };
        let port = if random.below(5) == 0 { figures } else { page };
        answered += u64::from(send(port, &input).is_some_and(|count| count > 0));
        round += 1;
        if round % 50 == 0 {
            besieged.look(round);
        }
    }
    assert!(answered > round / 4, "{answered} of {round} were answered");
    assert_eq!(Visitor::at(page).get("/").status, 200);
    besieged.end(&span, &format!("{round} requests, {answered} answered, nothing changed"));
}

/// Damaged requests of an OPC UA session, before or after the header of their chunk.
#[test]
fn gate_opcua() {
    let site = Site::new();
    let port = free_port();
    let link = format!("[[link]]\ntype = \"opcua\"\nname = \"scada\"\nlisten = \"127.0.0.1:{port}\"\nclients = 64\n");
    let station = station(&site, "gs-opcua", &link);
    let address = SocketAddr::from(([127, 0, 0, 1], port));
    let mut besieged = Besieged::new(station, channel_opens(address));
    let span = Span::of(60);
    let mut random = random(0x4F50_4355);
    let (mut round, mut sent) = (0, 0);
    while span.goes_on(round) {
        round += 1;
        if random.below(8) == 0 {
            let greeting = hello(address);
            send(port, &mutate(&mut random, &greeting, &greeting));
        }
        // All sessions may belong to clients that have disconnected.
        let client = OpcUa::connect(address, ANSWER).or_else(|_| OpcUa::open(address, ANSWER));
        let Ok(mut client) = client else { continue };
        let seeds = seeds(&client, address);
        for _ in 0..=random.below(12) {
            let at = |random: &mut SplitMix64| random.below(seeds.len() as u64) as usize;
            let (one, other) = (&seeds[at(&mut random)], &seeds[at(&mut random)]);
            let chunk = match random.below(4) {
                0 => client.framed(false, one),
                1 => {
                    let whole = client.framed(random.below(20) == 0, one);
                    mutate(&mut random, &whole, other)
                }
                _ => {
                    let body = mutate(&mut random, one, other);
                    client.framed(false, &body)
                }
            };
            sent += 1;
            if client.raw(&chunk).is_err() {
                break;
            }
        }
        // Releases its resources, if the connection still works.
        let header = client.header();
        let close = CloseSessionRequest { request_header: header, delete_subscriptions: round % 4 != 0 };
        let _ = client.call::<_, opcua_types::CloseSessionResponse>(&close);
        if round % 20 == 0 {
            besieged.look(round);
        }
    }
    besieged.station.until("others are served", |_| {
        let mut client = OpcUa::connect(address, Duration::from_secs(10)).ok()?;
        let subscription = client.subscribe(100.0).ok()?;
        client.monitor(subscription, &["MW20".to_owned()], 100.0).ok().filter(|(taken, _)| *taken == 1)
    });
    besieged.end(&span, &format!("{round} connections, {sent} messages, nothing changed"));
}

/// Specific requests whose bytes claim more than exists or is needed. A server that allocates what they claim runs out
/// of memory.
#[test]
fn gate_claims() {
    let site = Site::new();
    let port = free_port();
    let link = format!("[[link]]\ntype = \"opcua\"\nname = \"scada\"\nlisten = \"127.0.0.1:{port}\"\nclients = 64\n");
    let station = station(&site, "gs-claims", &link);
    let address = SocketAddr::from(([127, 0, 0, 1], port));
    let mut besieged = Besieged::new(station, channel_opens(address));
    let connect = || OpcUa::connect(address, PATIENCE).expect("a session");
    let count = claims(&connect()).len();
    for round in 0..count {
        let mut client = connect();
        // With a session of its own, so that valid requests are executed.
        let (what, body, opening) = claims(&client).swap_remove(round);
        let chunk = client.framed(opening, &body);
        client.raw(&chunk).expect("it is sent");
        // Refused, or answered with something else; the gate must still work for the next request.
        let answer = client.told().map(drop);
        println!("{what}: {answer:?}");
        drop(connect());
        besieged.look(round as u64);
    }
    // A thousand times the longest array: read as far as it fits into an answer, monitored as far as there is room.
    let mut client = connect();
    let ids = vec!["DB11.long".to_owned(); 1000];
    let nodes = ids.iter().map(|id| value_of(id)).collect();
    let read = ReadRequest { request_header: client.header(), nodes_to_read: Some(nodes), ..ReadRequest::default() };
    let guard = Guard::begin();
    let statuses = loop {
        let answer: ReadResponse = client.call(&read).expect("an answer");
        let statuses: Vec<StatusCode> = answer.results.iter().flatten().map(DataValue::status).collect();
        // On a machine without a free core the scan may not answer in the time that a gate waits for it.
        if statuses[0] != StatusCode::BadTimeout || guard.is_over() {
            break statuses;
        }
    };
    assert_eq!((statuses[0], statuses[999]), (StatusCode::Good, StatusCode::BadEncodingLimitsExceeded));
    let subscription = client.subscribe(100.0).expect("a subscription");
    let (taken, refused) = client.monitor(subscription, &ids, 100.0).expect("an answer");
    assert_eq!(refused, Some(StatusCode::BadTooManyMonitoredItems));
    assert!((1..100).contains(&taken), "{taken} are watched");
    besieged.look(count as u64);
    drop(client);
    // An endless greeting before the session.
    let mut stream = TcpStream::connect(address).expect("a connection");
    stream.set_write_timeout(Some(PATIENCE)).expect("a socket");
    let _ = stream.write_all(b"HELF\xFF\xFF\xFF\xFF");
    let (part, mut sent) = (vec![0; 1 << 20], 0_u64);
    while sent < 4096 && stream.write_all(&part).is_ok() {
        sent += 1;
    }
    println!("a greeting of 4 GiB: closed after {sent} MiB");
    assert!(sent < 2048, "somebody has taken two gigabytes");
    besieged.station.until("others are served", |_| OpcUa::connect(address, BACK).ok());
    besieged.look(u64::MAX);
    // Incomplete messages of six clients that stay connected.
    let six: Vec<OpcUa> = (0..6)
        .map_while(|_| {
            let mut client = OpcUa::connect(address, BACK).ok()?;
            let mut chunk = client.framed(false, &vec![0; (4 << 20) - 24]);
            for _ in 0..60 {
                // An intermediate chunk, with the next sequence number.
                chunk[3] = b'C';
                let number = u32::from_le_bytes([chunk[16], chunk[17], chunk[18], chunk[19]]) + 1;
                if client.raw(&chunk).is_err() {
                    break;
                }
                chunk[16..20].copy_from_slice(&number.to_le_bytes());
            }
            Some(client)
        })
        .collect();
    besieged.station.until("others are served", |_| OpcUa::connect(address, BACK).ok());
    besieged.look(u64::MAX);
    drop(six);
    besieged.end(&Span::of(1), &format!("{} claims", count + 2));
}

/// A broker with invalid messages: the link connects again, and writes nothing.
#[test]
fn gate_mqtt() {
    let site = Site::new();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let (port, page) = (listener.local_addr().expect("an address").port(), free_port());
    let links = format!(
        "[[link]]\ntype = \"mqtt\"\nname = \"cloud\"\nbroker = \"mqtt://127.0.0.1:{port}\"\nevery = \"50ms\"\n\
         publish = [\"MW100\", \"DB10\"]\n\n[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:{page}\"\n"
    );
    let station = station(&site, "gs-mqtt", &links);
    let mut besieged = Besieged::new(station, page_comes(page));
    let publish = |topic: &str, payload: &str| {
        let mut packet = vec![0x30, (2 + topic.len() + payload.len()) as u8, 0, topic.len() as u8];
        packet.extend(topic.as_bytes());
        packet.extend(payload.as_bytes());
        packet
    };
    let connected = [0x20, 2, 0, 0];
    let seeds: Vec<Vec<u8>> = vec![
        vec![0x90, 3, 0, 1, 1],
        vec![0x40, 2, 0, 1],
        vec![0x50, 2, 0, 1],
        vec![0xD0, 0],
        publish("ob1/gs-mqtt/MW20/set", "1"),
        publish("ob1/gs-mqtt/DB10.text/set", "\"changed\""),
        publish("spBv1.0/plant/NCMD/gs-mqtt", "\u{8}\u{1}\u{12}\u{4}MW20"),
    ];
    let span = Span::of(8);
    let mut random = random(0x4D51_5454);
    let mut round = 0;
    while span.goes_on(round) {
        let (mut stream, _) = listener.accept().expect("the link connects again");
        stream.set_read_timeout(Some(ANSWER)).expect("a socket");
        stream.set_write_timeout(Some(ANSWER)).expect("a socket");
        let _ = stream.read(&mut [0; 4096]);
        // Mostly a correct greeting, so that the following data are evaluated, and the next attempt comes soon.
        let greeting =
            if random.below(16) == 0 { mutate(&mut random, &connected, &connected) } else { connected.into() };
        let _ = stream.write_all(&greeting);
        for _ in 0..=random.below(30) {
            let at = |random: &mut SplitMix64| random.below(seeds.len() as u64) as usize;
            let (one, other) = (&seeds[at(&mut random)], &seeds[at(&mut random)]);
            let input = if random.below(4) == 0 { one.clone() } else { mutate(&mut random, one, other) };
            if stream.write_all(&input).is_err() {
                break;
            }
            let _ = stream.read(&mut [0; 65536]);
        }
        round += 1;
        if round % 4 == 0 {
            besieged.look(round);
        }
    }
    besieged.end(&span, &format!("{round} false brokers, nothing changed"));
}

/// Resident memory of a process in KiB.
fn resident(process: &Watched) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.pid)).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// Clients that subscribe and disconnect, that request a million items, that write huge arrays: requests beyond the
/// limits are refused, other clients are served, and the memory of the gate does not grow.
#[test]
fn gate_greed() {
    let site = Site::new();
    let port = free_port();
    let link = format!(
        "[[link]]\ntype = \"opcua\"\nname = \"scada\"\nlisten = \"127.0.0.1:{port}\"\nclients = 40\nitems = 2000\n"
    );
    let station = station(&site, "gs-greed", &link);
    let address = SocketAddr::from(([127, 0, 0, 1], port));
    let besieged = Besieged::new(station, channel_opens(address));
    let patience = Duration::from_secs(60);
    let span = Span::of(6);
    let million: u64 = if span.is_campaign() { 1_000_000 } else { 10_000 };
    let ids: Vec<String> = (0..1000).map(|word| format!("MW{}", word % 100 * 2)).collect();
    // The maximum in the first third, in which all resources have been used once, and in the last third.
    let (mut early, mut late) = (0, 0);
    let (mut round, mut refused) = (0, 0);
    while span.goes_on(round) {
        let share = span.share(round);
        match round % 6 {
            // A million items: accepted up to the limit.
            0 => {
                if let Ok(mut client) = OpcUa::connect(address, patience) {
                    let subscription = client.subscribe(1000.0).expect("a subscription");
                    let mut asked = 0;
                    let mut all = 0;
                    while asked < million {
                        match client.monitor(subscription, &ids, 1000.0) {
                            Ok((taken, why)) => {
                                all += taken;
                                refused += u64::from(why.is_some());
                            }
                            Err(OpcUaError::Status(why)) => {
                                assert_eq!(why, StatusCode::BadTooManyMonitoredItems);
                                refused += 1;
                            }
                            Err(why) => panic!("{why}"),
                        }
                        asked += ids.len() as u64;
                    }
                    assert!(all <= 2000, "{all} items of 2000");
                    assert!(refused > 0, "2000 items are all there are");
                }
            }
            // Endless arrays: refused, or the connection is closed.
            1 => {
                if let Ok(mut client) = OpcUa::connect(address, patience) {
                    let value = DataValue::value_only(Variant::from(vec![0i32; 1 << 20]));
                    let nodes = vec![WriteValue {
                        node_id: NodeId::new(2, "DB10.ramp"),
                        attribute_id: 13,
                        value,
                        ..WriteValue::default()
                    }];
                    let write = WriteRequest { request_header: client.header(), nodes_to_write: Some(nodes) };
                    assert!(client.call::<_, WriteResponse>(&write).is_err(), "four megabytes in a chunk");
                }
            }
            // Subscriptions of a client that disconnects silently.
            _ => {
                if let Ok(mut client) = OpcUa::connect(address, patience) {
                    for _ in 0..12 {
                        let Ok(subscription) = client.subscribe(50.0) else { break };
                        let _ = client.monitor(subscription, &ids[..50], 50.0);
                    }
                }
            }
        }
        round += 1;
        let now = resident(&besieged.gate);
        if share < 0.34 {
            early = early.max(now);
        } else if share > 0.67 {
            late = late.max(now);
        }
    }
    println!("{round} greedy clients; memory of the gate {early} KiB, later {late} KiB");
    assert!(late < early + early / 4 + 32 * 1024, "the memory of the gate grows: {early} KiB, {late} KiB");
    // A normal client is served after the sessions of the disconnected clients have expired.
    let guard = Guard::begin();
    let mut client = loop {
        match OpcUa::connect(address, patience) {
            Ok(client) => break client,
            Err(why) => assert!(!guard.is_over(), "{why}"),
        }
        std::thread::yield_now();
    };
    assert!(client.subscribe(100.0).is_ok());
    drop(client);
    besieged.end(&span, &format!("{round} greedy clients, {refused} requests for items refused"));
}

/// mosquitto is killed repeatedly: no value is lost at QoS 1, Sparkplug is completed by historical values, and the scan
/// is not affected.
#[test]
fn gate_broker() {
    let site = Site::new();
    let mut broker = Broker::start(&site);
    let plain = Listener::start(&site, broker.port, "ob1/gs-broker/MW20");
    let sparkplug = Listener::start(&site, broker.port, "spBv1.0/plant/#");
    let link = |name: &str, keys: &str| {
        format!(
            "[[link]]\ntype = \"mqtt\"\nname = \"{name}\"\nbroker = \"mqtt://127.0.0.1:{}\"\nevery = \"50ms\"\npublish = [\"MW20\"]\n{keys}\n",
            broker.port
        )
    };
    let station = station(&site, "gs-broker", &(link("plain", "") + &link("spb", "sparkplug = \"plant\"\n")));
    let mut said = 0;
    let mut numbers = BTreeSet::new();
    // Values of Sparkplug, received in time or later.
    let mut values = BTreeSet::new();
    let hear = |said: &Value, values: &mut BTreeSet<i64>| {
        for metric in said["payload"]["metrics"].as_array().into_iter().flatten() {
            if metric["name"] == "MW20" || metric["name"] == "" {
                values.extend(metric["value"].as_i64());
            }
        }
    };
    let mut tell = |count: i64| {
        for _ in 0..count {
            said += 1;
            station.set("MW 20", said);
            // Longer than the sampling interval of the link, in scans of the CPU: each value is sampled.
            station.scans(30);
        }
        said
    };
    let kills = rounds(3);
    let begin = station.status();
    for round in 0..kills {
        let last = tell(3);
        sparkplug.until("values before the kill", |said| {
            hear(said, &mut values);
            values.contains(&last).then_some(())
        });
        broker.kill();
        let last = tell(2);
        broker.begin();
        plain.until(&format!("kill {round}: what was told meanwhile"), |said| {
            numbers.extend(said["payload"]["number"].as_u64());
            (said["payload"]["value"] == last).then_some(())
        });
        sparkplug.until(&format!("kill {round}: what was missed"), |said| {
            hear(said, &mut values);
            values.contains(&last).then_some(())
        });
    }
    let last = tell(1);
    plain.until("the last", |said| {
        numbers.extend(said["payload"]["number"].as_u64());
        (said["payload"]["value"] == last).then_some(())
    });
    let highest = numbers.last().copied().unwrap_or(0);
    let lost: Vec<u64> = (1..=highest).filter(|number| !numbers.contains(number)).collect();
    assert!(lost.is_empty(), "lost of {highest}: {lost:?}");
    // A birth contains the newest value; the missed values follow.
    sparkplug.until("all values, in time or as historical ones", |said| {
        hear(said, &mut values);
        (1..=last).all(|value| values.contains(&value)).then_some(())
    });
    let end = station.status();
    assert_eq!((end.state.as_str(), end.watchdogs), ("RUN", 0));
    println!(
        "mosquitto killed {kills} times: {highest} values, none lost; {} scans, {} late of them",
        end.scans - begin.scans,
        end.late - begin.late
    );
    assert_eq!(station.interrupt().code(), Some(0));
}
