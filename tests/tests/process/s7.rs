//! Foreign clients of S7 communication with a running station: python-snap7 with its C++ library and its pure client,
//! pyS7, nodes7. They read the same values as `ob1 get`, and their writes arrive.

use std::collections::BTreeSet;
use std::io::Write as _;

use ob1_station::access::protocol::Op;
use ob1_tests::s7_raw::{CALL, Raw, counters_job};
use serde_json::{Value, json};

use crate::common;
use crate::common::s7::{Client, free_port, station};
use crate::common::site::Site;

const WITH_VALUES: [&str; 3] = ["native", "pure", "pys7"];
const SNAP7: [&str; 2] = ["native", "pure"];

fn hex(answer: &Value) -> Vec<u8> {
    let text = answer["hex"].as_str().expect("hexadecimal");
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("digits")).collect()
}

#[test]
fn values_are_those_of_the_station() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-values", "rights = \"write\"");
    for name in WITH_VALUES {
        let mut client = Client::start(&site, name, port);
        let db = |at: u32, bytes: u32| json!({ "op": "read", "db": 10, "at": at, "bytes": bytes });
        assert_eq!(hex(&client.done(&db(6, 2))), [0x80, 0x01], "{name}");
        assert_eq!(client.done(&json!({ "op": "string", "db": 10, "at": 8 }))["value"], "hello", "{name}");
        client.done(&json!({ "op": "write", "db": 10, "at": 40, "hex": "0102030405" }));
        assert_eq!(hex(&client.done(&db(39, 7))), [0, 1, 2, 3, 4, 5, 0], "{name}");
        assert_eq!(station.cell("DB10.DBD 40"), 0x0102_0304, "{name}");
        client.done(&json!({ "op": "write", "db": 10, "at": 40, "hex": "0000000000" }));
        assert_eq!(client.done(&json!({ "op": "real", "db": 10, "at": 2, "value": -2.25 }))["value"], -2.25);
        for (area, cell) in [("M", "MW 20"), ("PA", "AW 20"), ("PE", "EW 20")] {
            client.done(&json!({ "op": "write", "area": area, "at": 20, "hex": "1234" }));
            assert_eq!(station.cell(cell), 0x1234, "{name} {area}");
            assert_eq!(hex(&client.done(&json!({ "op": "read", "area": area, "at": 20, "bytes": 2 }))), [0x12, 0x34]);
            client.done(&json!({ "op": "write", "area": area, "at": 20, "hex": "0000" }));
        }
        for value in [true, false] {
            let bit = json!({ "op": "bit", "area": "M", "at": 30, "bit": 5, "value": value });
            assert_eq!(client.done(&bit)["value"], value, "{name}");
            assert_eq!(station.cell("M 30.5"), i64::from(value), "{name}");
        }
        let items = json!([["DB", 10, 0, 2], ["M", 0, 20, 2], ["DB", 10, 6, 2]]);
        assert_eq!(
            client.done(&json!({ "op": "multi", "items": items }))["hex"],
            json!(["1234", "0000", "8001"]),
            "{name}"
        );
        assert_eq!(client.ask(&json!({ "op": "read", "db": 99, "at": 0, "bytes": 2 }))["ok"], false, "{name}");
        assert_eq!(client.ask(&json!({ "op": "read", "db": 10, "at": 9000, "bytes": 2 }))["ok"], false, "{name}");
        assert_eq!(client.done(&json!({ "op": "state" }))["value"], "RUN", "{name}");
    }
    // Timers and counters, which pyS7 does not support.
    for name in SNAP7 {
        let mut client = Client::start(&site, name, port);
        client.done(&json!({ "op": "write", "area": "C", "at": 4, "hex": "0123" }));
        assert_eq!(station.cell("Z 4"), 123, "{name}");
        assert_eq!(
            hex(&client.done(&json!({ "op": "read", "area": "C", "at": 4, "bytes": 1 }))),
            [0x01, 0x23],
            "{name}"
        );
        client.done(&json!({ "op": "write", "area": "C", "at": 4, "hex": "0000" }));
    }
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
}

#[test]
fn who_is_connected_is_told() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-told", "rights = \"read\"");
    let connections = |station: &common::station::Running| {
        let links = station.ask(Op::Links).expect("never refused").links.expect("an answer to links");
        links.into_iter().find(|link| link.name == "panel").filter(|link| link.up).map(|link| link.connections)
    };
    let mut client = Client::start(&site, "native", port);
    client.done(&json!({ "op": "read", "db": 10, "at": 0, "bytes": 2 }));
    assert_eq!(client.ask(&json!({ "op": "stop" }))["ok"], false);
    let one = station.until("the connection is told", |station| {
        let list = connections(station)?;
        list.into_iter().find(|one| one.pdu > 0 && one.jobs >= 3 && one.errors >= 1)
    });
    assert_eq!((one.name.as_str(), one.state.as_str()), ("01.02", "up"));
    assert!(one.partner.starts_with("127.0.0.1:"), "{one:?}");
    drop(client);
    station.until("it is gone", |station| connections(station)?.is_empty().then_some(()));
    let shown = site.ob1(&["top", "s7-told", "--plain", "--count", "1"]);
    assert!(shown.out.contains("panel            up"), "{}", shown.out);
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn nodes7_reads_and_writes() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-nodes7", "rights = \"write\"");
    let mut client = Client::start(&site, "nodes7", port);
    let items =
        json!({ "n": "DB10,INT0", "r": "DB10,REAL2", "x": "DB10,X6.7", "t": "DB10,S8.20", "m": "MW20", "c": "C4" });
    let read = json!({ "op": "read", "items": items });
    let values = client.done(&read)["values"].clone();
    assert_eq!((&values["n"], &values["x"], &values["t"]), (&json!(4660), &json!(true), &json!("hello")), "{values}");
    client.done(
        &json!({ "op": "write", "items": { "DB10,INT0": -7, "DB10,X6.7": false, "MW20": 321, "DB10,S8.20": "bye" } }),
    );
    assert_eq!((station.cell("DB10.DBW 0") as i16, station.cell("MW 20")), (-7, 321));
    let values = client.done(&read)["values"].clone();
    assert_eq!((&values["n"], &values["x"], &values["t"]), (&json!(-7), &json!(false), &json!("bye")), "{values}");
    drop(client);
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_programming_device_sees_lists_blocks_and_the_clock() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-lists", "rights = \"operate\"");
    for name in SNAP7 {
        let mut client = Client::start(&site, name, port);
        let list = client.done(&json!({ "op": "szl", "id": 0x0011, "index": 0 }));
        assert_eq!((list["record"].as_u64(), list["count"].as_u64()), (Some(28), Some(4)), "{name}");
        assert_eq!(hex(&list)[2..12], *b"ob1 S7-300", "{name}");
        for (id, index, record) in [
            (0x001C, 0, 34),
            (0x0131, 1, 40),
            (0x0131, 0, 40),
            (0x0232, 4, 40),
            (0x0232, 0, 40),
            (0x0424, 0, 20),
            (0x0074, 0, 4),
        ] {
            let list = client.done(&json!({ "op": "szl", "id": id, "index": index }));
            assert_eq!(list["record"].as_u64(), Some(record), "{name} {id:04X}");
        }
        let counts = client.done(&json!({ "op": "counts" }));
        assert_eq!((&counts["OB"], &counts["DB"], &counts["FC"]), (&json!(1), &json!(1), &json!(0)), "{name}");
        assert_eq!(client.done(&json!({ "op": "list", "type": "DB" }))["numbers"], json!([10]), "{name}");
        let set = client.done(&json!({ "op": "clock", "value": "2030-01-02T03:04:05" }))["value"].clone();
        assert!(set.as_str().is_some_and(|time| time.starts_with("2030-01-02T03:04:")), "{name}: {set}");
    }
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn stop_and_start_by_right() {
    let site = Site::new();
    let (with_right, port) = station(&site, "s7-operate", "rights = \"operate\"");
    for name in SNAP7 {
        let mut client = Client::start(&site, name, port);
        client.done(&json!({ "op": "stop" }));
        assert_eq!(client.done(&json!({ "op": "state" }))["value"], "STOP", "{name}");
        assert_eq!(with_right.status().state, "STOP", "{name}");
        // A CPU also serves in STOP: reads, and writes to bit memory.
        client.done(&json!({ "op": "write", "area": "M", "at": 22, "hex": "77" }));
        assert_eq!(hex(&client.done(&json!({ "op": "read", "area": "M", "at": 22, "bytes": 1 }))), [0x77], "{name}");
        client.done(&json!({ "op": "warm" }));
        assert_eq!(client.done(&json!({ "op": "state" }))["value"], "RUN", "{name}");
        client.done(&json!({ "op": "stop" }));
        client.done(&json!({ "op": "cold" }));
        assert_eq!(with_right.status().state, "RUN", "{name}");
    }
    assert_eq!(with_right.interrupt().code(), Some(0));

    let site = Site::new();
    let (without, port) = station(&site, "s7-read", "password = \"secret\"\npassword_rights = \"operate\"");
    for name in SNAP7 {
        let mut client = Client::start(&site, name, port);
        assert_eq!(client.ask(&json!({ "op": "stop" }))["ok"], false, "{name}");
        assert_eq!(client.ask(&json!({ "op": "write", "db": 10, "at": 0, "hex": "00" }))["ok"], false, "{name}");
        assert_eq!(client.ask(&json!({ "op": "clock", "value": "2030-01-02T03:04:05" }))["ok"], false, "{name}");
        assert_eq!((without.status().state.as_str(), without.cell("DB10.DBW 0")), ("RUN", 4660), "{name}");
        client.done(&json!({ "op": "login", "password": "secret" }));
        client.done(&json!({ "op": "stop" }));
        client.done(&json!({ "op": "warm" }));
        // This does not apply to another connection.
        let mut other = Client::start(&site, name, port);
        assert_eq!(other.ask(&json!({ "op": "stop" }))["ok"], false, "{name}");
    }
    let mut wrong = Client::start(&site, "native", port);
    assert_eq!(wrong.ask(&json!({ "op": "login", "password": "wrong" }))["ok"], false);
    assert_eq!(wrong.ask(&json!({ "op": "stop" }))["ok"], false);
    drop(wrong);
    // Who it was, in the diagnostic buffer, the log and the audit log.
    let texts: Vec<_> = without.diagnostics().into_iter().filter(|e| e.event == "F501h").map(|e| e.text).collect();
    let log = without.said();
    let audit = std::fs::read_to_string(site.path("s7-read.audit")).expect("an audit log");
    for what in ["password: wrong", "stop: taken", "warm"] {
        assert!(
            texts.iter().any(|text| text.contains("panel, 127.0.0.1:") && text.contains(what)),
            "{what}: {texts:?}"
        );
        assert!(log.lines().any(|line| line.contains("127.0.0.1:") && line.contains(what)), "{what}: {log}");
    }
    let lines: Vec<serde_json::Value> = audit.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    for (what, outcome) in [("password", "wrong"), ("stop", "taken")] {
        let is_it =
            |line: &&serde_json::Value| line["link"] == "panel" && line["what"] == what && line["outcome"] == outcome;
        let line = lines.iter().find(is_it).unwrap_or_else(|| panic!("{what}: {audit}"));
        assert!(line["client"].as_str().is_some_and(|client| client.starts_with("127.0.0.1:")), "{line}");
    }
    assert_eq!(without.interrupt().code(), Some(0));
}

/// A client that calls another slot, or a CPU in another network, does not get this one.
#[test]
fn a_call_for_another_cpu_is_refused() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-elsewhere", "rights = \"write\"");
    let call = |tsap: &[u8]| {
        let stream = std::net::TcpStream::connect(("127.0.0.1", port)).expect("a connection");
        Raw(stream).call(&[(0xC2, tsap)]).expect("an answer")
    };
    let mut routed = vec![1, 6, 1, 2, 1, 0x52, 0, 0, 0, 0x13, 3];
    routed.resize(26, 0);
    routed.extend_from_slice(&[1, 2]);
    assert_eq!([&[1, 2][..], &[1, 3], &routed].map(call), [0xD0, 0x80, 0x80]);
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_flood_of_connections_keeps_nobody_out() {
    use std::io::{Read as _, Write as _};
    use std::net::TcpStream;
    let site = Site::new();
    let (station, port) = station(&site, "s7-flood", "rights = \"read\"\nclients = 4");
    let connect = || TcpStream::connect(("127.0.0.1", port)).expect("a connection");
    // Half-open connections without data, and connections that are silent after the connection request.
    let half_open: Vec<TcpStream> = (0..300).map(|_| connect()).collect();
    let mut silent: Vec<TcpStream> = (0..100).map(|_| connect()).collect();
    for stream in &mut silent {
        let _ = stream.write_all(CALL);
    }
    // Each gets an answer, or finds its connection closed.
    for stream in &mut silent {
        let _ = stream.read(&mut [0; 22]);
    }
    station.until("a working client gets in", |_| {
        let mut client = connect();
        client.write_all(CALL).ok()?;
        let mut answer = [0; 22];
        client.read_exact(&mut answer).ok()?;
        (answer[5] == 0xD0).then_some(())
    });
    // The connection reserved for a programming device.
    let mut client = Client::start(&site, "native", port);
    assert_eq!(client.done(&json!({ "op": "state" }))["value"], "RUN");
    drop((half_open, silent, client));
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The order for DB10.DBW 0 each second.
const CYCLIC: [u8; 45] = [
    3, 0, 0, 45, 2, 0xF0, 0x80, 0x32, 7, 0, 0, 0, 2, 0, 8, 0, 20, 0, 1, 0x12, 4, 0x11, 0x42, 1, 0, 0xFF, 9, 0, 16, 0,
    1, 1, 1, 0x12, 0x0A, 0x10, 2, 0, 2, 0, 10, 0x84, 0, 0, 0,
];

/// `idle` ends silent connections, not one that waits for cyclic data.
#[test]
fn a_client_that_waits_for_cyclic_data_is_not_idle() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-idle", "rights = \"read\"\nidle = 1");
    let mut waits = Raw::open(port).expect("a connection");
    waits.0.write_all(&CYCLIC).expect("sent");
    let mut silent = Raw::open(port).expect("a connection");
    assert!(silent.frame().is_err(), "it is closed");
    // The answer, and its messages.
    let kinds: Vec<_> = (0..4).map(|_| waits.frame().expect("values").get(22).copied()).collect();
    assert_eq!(kinds, [Some(0x82), Some(0x02), Some(0x02), Some(0x02)]);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Counters that count together, and a word that counts the scans in which they differed.
const COUNTERS: &str = "
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [0..19] OF BYTE;
END_VAR
BEGIN
NETWORK
      UN    M 120.0;
      =     M 120.0;
      U     M 120.0;
      ZV    Z 0;
      U     M 120.0;
      ZV    Z 70;
      U     M 120.0;
      ZV    Z 199;
      L     Z 0;
      L     Z 70;
      <>I   ;
      SPB   TORN;
      L     Z 0;
      L     Z 199;
      <>I   ;
      SPBN  GOOD;
TORN: L     MW 110;
      +     1;
      T     MW 110;
GOOD: NOP   0;
END_ORGANIZATION_BLOCK
";

/// Each timer, counter and peripheral value is a separate entry: all of a telegram are read in one scan, and written
/// between two scans.
#[test]
fn two_hundred_counters_are_read_and_written_whole() {
    let (site, port) = (Site::new(), free_port());
    site.write("c.awl", COUNTERS);
    site.write(
        "c.toml",
        &format!(
            "[station]\nname = \"s7-whole\"\n\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\n\n[program]\n\
             sources = [\"c.awl\"]\n\n[[link]]\ntype = \"s7\"\nname = \"panel\"\n\
             listen = \"127.0.0.1:{port}\"\nrights = \"write\"\n"
        ),
    );
    let station = site.run("c.toml").until_run();
    let mut raw = station.until("the link listens", |_| Raw::open(port).ok());
    for value in [0x100, 0x000].repeat(20) {
        raw.0.write_all(&counters_job(7, 200, Some(value))).expect("sent");
        let frame = raw.frame().expect("an answer");
        assert_eq!(frame.last(), Some(&0xFF), "{value:x}: {frame:?}");
    }
    let mut seen = BTreeSet::new();
    station.until("the counters go on", |_| {
        raw.0.write_all(&counters_job(8, 200, None)).expect("sent");
        let frame = raw.frame().expect("an answer");
        let counters = frame.get(25..).expect("a head").as_chunks::<2>().0;
        assert_eq!(counters.len(), 200, "{frame:?}");
        assert_eq!((counters[70], counters[199]), (counters[0], counters[0]), "of one scan");
        seen.insert(counters[0]);
        (seen.len() >= 20).then_some(())
    });
    assert_eq!(station.cell("MW 110"), 0, "no scan has seen a part of a write");
    assert_eq!(station.interrupt().code(), Some(0));
}
