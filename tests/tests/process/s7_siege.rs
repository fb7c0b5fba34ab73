//! Sieges of the S7 link: its process is killed, flooded, attacked with damaged sessions; values are read while the
//! program writes them. Short here; long runs with `cargo xtask siege s7_sessions s7_torn`.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use ob1_station::access::protocol::Op;
use ob1_tests::s7_raw::{CALL, Raw, SETUP, read_job};
use ob1_tests::siege::{mutate, random, rounds};
use rustix::process::{Resource, Rlimit, Signal, getrlimit, setrlimit};

use crate::common::processes::Watched;
use crate::common::s7::{free_port, link_of, station};
use crate::common::site::Site;
use crate::common::station::{Running, counting};

/// Reads the first word of DB 10.
fn works(raw: &mut Raw) -> std::io::Result<bool> {
    raw.0.write_all(&read_job(7, 0, 2))?;
    Ok(raw.frame()?.ends_with(&[0x12, 0x34]))
}

/// Waits until a new client is served.
fn until_served(station: &Running, port: u16, what: &str) -> Raw {
    station.until(what, |_| {
        let mut raw = Raw::open(port).ok()?;
        works(&mut raw).is_ok_and(|works| works).then_some(raw)
    })
}

/// Resident memory in KiB.
fn resident(process: &Watched) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.pid)).expect("a living process");
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).expect("a process has memory");
    line.split_whitespace().nth(1).and_then(|number| number.parse().ok()).expect("a number")
}

/// The process is killed at any time: the scan continues, the next process serves.
#[test]
fn s7_kill() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-kill", "rights = \"write\"");
    for _ in 0..rounds(4).min(100) {
        let mut client = until_served(&station, port, "a client is served");
        let scans = station.status().scans;
        let link = link_of(&station);
        link.signal(Signal::KILL);
        link.wait("killed");
        // Its connections end with it.
        assert!(!works(&mut client).unwrap_or(false));
        until_served(&station, port, "the next process serves");
        assert!(station.status().scans > scans, "the scan goes on");
    }
    assert_eq!(station.status().state, "RUN");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A thousand connections without a connection request, and a thousand that are silent after it: a working client is
/// served.
#[test]
fn s7_flood() {
    let limit = getrlimit(Resource::Nofile);
    let wanted = limit.maximum.map_or(8192, |most| most.min(8192));
    setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), ..limit }).expect("within the maximum");
    let site = Site::new();
    let (station, port) = station(&site, "s7-flood", "rights = \"write\"");
    let link = link_of(&station);
    let mut worker = until_served(&station, port, "a client is served");
    let before = resident(&link);
    // The process may close connections meanwhile: all are opened nevertheless.
    let open = |call: bool| {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).expect("the kernel accepts");
        if call {
            let _ = stream.write_all(CALL);
        }
        stream
    };
    let mut all: Vec<TcpStream> = (0..1000).map(|_| open(false)).collect();
    assert!(works(&mut worker).expect("it is served beside a thousand half-open ones"));
    all.extend((0..1000).map(|_| open(true)));
    assert!(works(&mut worker).expect("it is served beside a thousand silent ones"));
    until_served(&station, port, "a new client gets in");
    assert!(works(&mut worker).expect("nobody who works was given up for a silent one"));
    assert!(!link.has_ended(), "the process has lived through it");
    assert!(resident(&link) < before + 32 * 1024, "{before} -> {} KiB", resident(&link));
    drop(all);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A partner breaks the connection off while nobody takes its data, because the program does not call AG_RECV. The CP
/// notices, and does not run in circles.
#[test]
fn s7_broken_off() {
    let (site, port, tcp) = (Site::new(), free_port(), free_port());
    site.write("none.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n      NOP   0;\nEND_ORGANIZATION_BLOCK\n");
    let file = format!(
        "[station]\nname = \"s7-broken-off\"\n\n[program]\nsources = [\"none.awl\"]\n\n\
         [[link]]\ntype = \"s7\"\nname = \"ethernet\"\nlisten = \"127.0.0.1:{port}\"\n\n\
         [[module]]\ntype = \"cp343\"\nname = \"cp\"\naddress = 256\n\n\
         [[connection]]\nmodule = \"cp\"\nid = 1\ntype = \"tcp\"\nlocal_port = {tcp}\n"
    );
    site.write("cp.toml", &file);
    let station = site.run("cp.toml").until_run();
    let link = link_of(&station);
    let is = |station: &Running, state: &str| {
        let links = station.ask(Op::Links).expect("never refused").links.expect("an answer to links");
        links.iter().flat_map(|link| &link.connections).any(|one| one.state == state).then_some(())
    };
    let mut partner = station.until("the CP listens", |_| TcpStream::connect(("127.0.0.1", tcp)).ok());
    station.until("the connection is up", |station| is(station, "up"));
    partner.set_nonblocking(true).expect("a socket");
    while matches!(partner.write(&[7; 65_536]), Ok(len) if len > 0) {}
    assert!(link.sleeps(), "it waits for the program");
    rustix::net::sockopt::set_socket_linger(&partner, Some(Duration::ZERO)).expect("a socket");
    drop(partner);
    station.until("the connection is down", |station| is(station, "down"));
    assert!(link.sleeps(), "it runs in circles");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Callers for whom the process has no descriptor left do not keep it awake. They are served when it has one again.
#[test]
fn s7_without_descriptors() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-descriptors", "rights = \"write\"");
    let link = link_of(&station);
    let mut worker = until_served(&station, port, "a client is served");
    link.limit_descriptors(true);
    let callers: Vec<TcpStream> =
        (0..3).map(|_| TcpStream::connect(("127.0.0.1", port)).expect("the kernel accepts")).collect();
    assert!(link.sleeps(), "it tries to accept them all the time");
    assert!(works(&mut worker).expect("it is served meanwhile"));
    drop(callers);
    link.limit_descriptors(false);
    until_served(&station, port, "a new client gets in");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Sessions damaged at any place: the process survives, its memory does not grow, the next client is served, and
/// without the right nothing is changed.
#[test]
fn s7_sessions() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-sessions", "clients = 64");
    let link = link_of(&station);
    let list: &[u8] = &[
        3, 0, 0, 33, 2, 0xF0, 0x80, 0x32, 7, 0, 0, 5, 0, 0, 8, 0, 8, 0, 1, 0x12, 4, 0x11, 0x44, 1, 0, 0xFF, 9, 0, 4, 0,
        0x11, 0, 0,
    ];
    let write: &[u8] = &[
        3, 0, 0, 37, 2, 0xF0, 0x80, 0x32, 1, 0, 0, 0, 9, 0, 14, 0, 6, 5, 1, 0x12, 0x0A, 0x10, 2, 0, 2, 0, 10, 0x84, 0,
        0, 0, 0, 4, 0, 16, 0xAB, 0xCD,
    ];
    let stop: &[u8] = &[
        3, 0, 0, 33, 2, 0xF0, 0x80, 0x32, 1, 0, 0, 0, 9, 0, 16, 0, 0, 0x29, 0, 0, 0, 0, 0, 9, b'P', b'_', b'P', b'R',
        b'O', b'G', b'R', b'A', b'M',
    ];
    let read = read_job(3, 0, 200);
    let whole: Vec<u8> = [CALL, SETUP, &read, list, write, stop, &read].concat();
    let count = rounds(2_000);
    let mut first = None;
    for seed in 0..count {
        let mut random = random(seed);
        // In one of eight the connection request itself is damaged.
        let damaged = match random.below(8) {
            0 => mutate(&mut random, &whole, list),
            _ => {
                let (head, rest) = whole.split_at(CALL.len() + SETUP.len());
                [head, &mutate(&mut random, rest, &read)].concat()
            }
        };
        // A previous connection may still be in use for a short time.
        let mut stream = TcpStream::connect(("127.0.0.1", port)).expect("the kernel accepts");
        let _ = stream.write_all(&damaged);
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let mut answers = Vec::new();
        let _ = stream.set_read_timeout(Some(std::time::Duration::from_secs(60)));
        let _ = stream.read_to_end(&mut answers);
        assert!(!link.has_ended(), "seed {seed} has ended the process");
        if seed == count / 4 {
            first = Some(resident(&link));
        }
    }
    let (first, last) = (first.expect("there are rounds"), resident(&link));
    assert!(last < first + 8 * 1024, "{first} -> {last} KiB after {count} sessions");
    until_served(&station, port, "a whole client is served");
    assert_eq!((station.status().state.as_str(), station.cell("DB10.DBW 0")), ("RUN", 0x1234));
    println!("{count} sessions, {first} -> {last} KiB");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// 200 bytes that the program writes in each scan, all with the same number: every PDU must contain a single number.
const DATA: &str = "
DATA_BLOCK DB 10
STRUCT
  D : ARRAY[0..99] OF WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
";
/// The program after the counting.
const REST: &str = "\
      L     0;
      T     LD 20;
      AUF   DB 10;
NEXT: L     MW 100;
      T     DBW [LD 20];
      L     LD 20;
      L     L#16;
      +D    ;
      T     LD 20;
      L     L#1600;
      <D    ;
      SPB   NEXT;
";

#[test]
fn s7_torn() {
    let site = Site::new();
    let port = free_port();
    site.write("torn.awl", &counting(DATA, REST));
    site.write(
        "station.toml",
        &format!(
            "[station]\nname = \"s7-torn\"\n\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"10s\"\n\n[program]\nsources = [\"torn.awl\"]\n\n\
             [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\n"
        ),
    );
    let station = site.run("station.toml").until_run();
    let mut raw = station.until("the link listens", |_| Raw::open(port).ok());
    let count = rounds(20_000);
    let (mut numbers, mut last) = (0u64, None);
    for reference in 0..8 {
        raw.0.write_all(&read_job(reference, 0, 200)).expect("room");
    }
    for done in 0..count {
        let frame = raw.frame().expect("an answer");
        // TPKT 4, COTP 3, header 12, function and count 2, code 1, transport 1, length 2.
        let words = frame.get(25..225).expect("200 bytes").as_chunks::<2>().0;
        assert!(words.iter().all(|word| word == &words[0]), "torn after {done}: {words:02X?}");
        if last != Some(words[0]) {
            numbers += 1;
            last = Some(words[0]);
        }
        raw.0.write_all(&read_job(8, 0, 200)).expect("room");
    }
    // The values have changed meanwhile.
    assert!(numbers > 10, "{numbers} different numbers in {count} reads");
    println!("{count} PDUs, {numbers} different numbers, none torn");
    assert_eq!(station.interrupt().code(), Some(0));
}
