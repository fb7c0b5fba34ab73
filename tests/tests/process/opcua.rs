//! OPC UA of a running station with the foreign client asyncua: it reads the same values as `ob1 get`, its writes
//! arrive, and without the right they are refused.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use ob1_tests::opcua::OpcUa;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::common::fleet::{asyncua, connected, node_opcua, opcua, users};
use crate::common::gate::gate;
use crate::common::site::Site;

const WITH_USERS: &str = "rights = \"operate\"\nusers = \"gate.users\"\ntrust = \"any\"\n";

fn user(name: &str) -> [String; 4] {
    ["--user".into(), name.into(), "--password".into(), format!("{name}-secret")]
}

#[test]
fn a_client_browses_and_reads_what_the_tools_read() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-read", "");
    let mut client = connected(&site, port, &[]);
    let top = client.done(&json!({ "op": "find", "path": ["ua-read"] }));
    assert_eq!(top["id"], "/");
    let block = client.done(&json!({ "op": "find", "path": ["ua-read", "DataBlocks", "DB10", "motor", "speed"] }));
    assert_eq!(block["id"], "DB10.motor.speed");
    let names = client.done(&json!({ "op": "children", "id": "DB10" }))["names"].clone();
    assert_eq!(names, json!(["number", "real", "text", "delay", "ramp", "motor", "moment", "axes"]));
    let symbols = client.done(&json!({ "op": "children", "id": "/Symbols" }))["ids"].clone();
    assert_eq!(symbols, json!(["\"Start\"", "\"Level\""]));
    assert_eq!(client.done(&json!({ "op": "children", "id": "/Memory" }))["ids"].as_array().map(Vec::len), Some(256));

    // Many paths at once, from a node of ours and from one of the server's.
    for (id, begin) in [("DB10", &[][..]), ("Objects", &["ua-read", "DataBlocks", "DB10"])] {
        let paths =
            [&["number"][..], &["real"], &["motor", "speed"], &["nothing"]].map(|names| [begin, names].concat());
        let told = client.done(&json!({ "op": "paths", "id": id, "paths": paths }));
        assert_eq!(told["ids"], json!(["DB10.number", "DB10.real", "DB10.motor.speed", "BadNoMatch"]), "{id}");
    }
    // Page by page, with the reference to the type besides.
    let pages = client.done(&json!({ "op": "pages", "id": "/Memory", "most": 100 }));
    assert_eq!((&pages["statuses"], &pages["count"]), (&json!(["Good", "Good", "Good"]), &json!(257)));
    for id in ["nonsense", "MW999"] {
        let none = client.done(&json!({ "op": "pages", "id": id, "most": 0 }));
        assert_eq!(none["statuses"], json!(["BadNodeIdUnknown"]), "{id}");
    }

    station.set("MW 30", 4660);
    station.set("MW 20", -5);
    let ids = [
        "MW30",
        "DB10.number",
        "DB10.real",
        "DB10.text",
        "DB10.delay",
        "DB10.ramp",
        "DB10.ramp[2]",
        "DB10.motor.speed",
        "DB10.motor.on",
        "DB10.moment",
        "DB10.DBW0",
        "\"Level\"",
        "M10.1",
        "T0",
        "/State",
        "MW999",
        "DB99.DBW0",
        "nonsense",
    ];
    let answer = client.done(&json!({ "op": "read", "ids": ids }));
    assert_eq!(
        answer["values"],
        json!([
            4660,
            -7,
            1.5,
            "hello",
            1500.0,
            [1, 2, 3],
            2,
            70000,
            true,
            "2026-01-02T03:04:05.678",
            65529,
            -5,
            false,
            0.0,
            "RUN",
            "BadNodeIdUnknown",
            "BadNotFound",
            "BadNodeIdUnknown"
        ])
    );
    assert_eq!(
        answer["types"].as_array().map(|types| types[..6].to_vec()),
        Some(["UInt16", "Int16", "Float", "String", "Double", "Int16"].map(Value::from).to_vec())
    );
    assert_eq!(client.ask(&json!({ "op": "history", "id": "MW30" }))["error"], "BadHistoryOperationUnsupported");
    let about = client.done(&json!({ "op": "attributes", "id": "DB10.ramp" }));
    assert_eq!(
        (&about["description"], &about["rank"], &about["dimensions"], &about["writable"]),
        (&json!("ARRAY [1..3] OF INT"), &json!(1), &json!([3]), &json!(false))
    );
    for (attribute, times, told) in [
        ("Value", "Both", json!(["Source", "Server"])),
        ("Value", "Source", json!(["Source"])),
        ("Value", "Server", json!(["Server"])),
        ("Value", "Neither", json!([])),
        ("DisplayName", "Both", json!(["Server"])),
        ("DisplayName", "Neither", json!([])),
    ] {
        let asked = json!({ "op": "part", "id": "MW30", "attribute": attribute, "times": times });
        assert_eq!(client.done(&asked)["times"], told, "{attribute} {times}");
    }
    drop(client);
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn writes_and_methods_go_by_the_right_of_the_user() {
    let site = Site::new();
    users(&site);
    let (station, port) = opcua(&site, "ua-write", WITH_USERS);
    let write = |id: &str, kind: &str, value: Value| json!({ "op": "write", "id": id, "type": kind, "value": value });
    let words = user("anna");
    let mut anna = connected(&site, port, &words.each_ref().map(String::as_str));
    for (id, kind, value) in [
        ("MW30", "UInt16", json!(4711)),
        ("DB10.number", "Int16", json!(-9)),
        ("DB10.text", "String", json!("bye")),
        ("DB10.delay", "Double", json!(2500.0)),
        ("DB10.ramp", "Int16", json!([7, 8, 9])),
        ("DB10.moment", "DateTime", json!("2030-12-31T23:59:59.500")),
        ("\"Start\"", "Boolean", json!(true)),
        ("DB10.axes[1].pos", "Float", json!(-0.25)),
    ] {
        anna.done(&write(id, kind, value.clone()));
        let read = anna.done(&json!({ "op": "read", "ids": [id] }))["values"][0].clone();
        assert!(read == value || read == json!(format!("{}000", value.as_str().unwrap_or("-"))), "{id}: {read}");
    }
    assert_eq!(station.cells(&["MW 30", "DB10.DBW 0", "M 10.0"]), [4711, 65527, 1]);
    for (id, kind, value, why) in [
        ("MW30", "Int16", json!(1), "BadTypeMismatch"),
        ("MW30", "UInt32", json!(1), "BadTypeMismatch"),
        ("DB10.text", "String", json!("more than twenty letters"), "BadOutOfRange"),
        ("DB10.ramp", "Int16", json!([1]), "BadTypeMismatch"),
        ("DB10", "Int16", json!(1), "BadNotWritable"),
        ("nonsense", "Int16", json!(1), "BadNodeIdUnknown"),
    ] {
        assert_eq!(anna.ask(&write(id, kind, value))["error"], why, "{id}");
    }
    anna.done(&json!({ "op": "call", "id": "/Stop" }));
    assert_eq!(station.status().state, "STOP");
    anna.done(&json!({ "op": "call", "id": "/Start" }));
    assert_eq!(station.status().state, "RUN");

    let words = user("bert");
    let mut bert = connected(&site, port, &words.each_ref().map(String::as_str));
    let mut nobody = connected(&site, port, &[]);
    // A restart clears bit memory, but not data blocks.
    for client in [&mut bert, &mut nobody] {
        assert_eq!(client.done(&json!({ "op": "read", "ids": ["DB10.number"] }))["values"], json!([-9]));
        assert_eq!(client.ask(&write("DB10.number", "Int16", json!(0)))["error"], "BadUserAccessDenied");
        assert_eq!(client.ask(&json!({ "op": "call", "id": "/Stop" }))["error"], "BadUserAccessDenied");
        assert_eq!(client.done(&json!({ "op": "attributes", "id": "DB10.number" }))["writable"], false);
    }
    assert_eq!((station.cell("DB10.DBW 0") as i16, station.status().state.as_str()), (-9, "RUN"));
    let mut wrong = asyncua(&site, port, &["--user", "anna", "--password", "guess"]);
    assert_eq!(wrong.answer()["ok"], false);
    let log = std::fs::read_to_string(site.path("ua-write.audit")).expect("an audit log");
    for what in ["\"login\"", "write MW30 = 4711", "command stop", "\"anna\"", "wrong name or password"] {
        assert!(log.contains(what), "{what}: {log}");
    }
    // Refused attempts are also logged.
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    for (user, what) in
        ["bert", "-"].into_iter().flat_map(|user| [(user, "write DB10.number = 0"), (user, "command stop")])
    {
        let told = lines
            .iter()
            .any(|line| line["user"] == user && line["what"] == what && line["outcome"] == "refused: not allowed");
        assert!(told, "{user} {what}: {log}");
    }
    drop((anna, bert, nobody, wrong));
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A second foreign client, node-opcua: browses, reads, writes, calls, subscribes, with and without security.
#[test]
fn another_client_does_the_same() {
    let site = Site::new();
    users(&site);
    let (station, port) = opcua(&site, "ua-node", WITH_USERS);
    let begin = |more: &[&str]| {
        let mut client = node_opcua(&site, port, more);
        let answer = client.answer();
        assert_eq!(answer["ok"], true, "{more:?}: {answer}");
        client
    };
    let mut nobody = begin(&[]);
    let block = nobody.done(&json!({ "op": "find", "path": ["ua-node", "DataBlocks", "DB10", "motor", "speed"] }));
    assert_eq!(block["id"], "DB10.motor.speed");
    let names = nobody.done(&json!({ "op": "children", "id": "DB10" }))["names"].clone();
    assert_eq!(names, json!(["number", "real", "text", "delay", "ramp", "motor", "moment", "axes"]));
    assert_eq!(nobody.done(&json!({ "op": "children", "id": "/Memory" }))["ids"].as_array().map(Vec::len), Some(256));
    let ids = ["DB10.number", "DB10.real", "DB10.text", "DB10.ramp", "DB10.moment", "T0", "MW999", "DB99.DBW0"];
    let read = nobody.done(&json!({ "op": "read", "ids": ids }));
    assert_eq!(
        read["values"],
        json!([-7, 1.5, "hello", [1, 2, 3], "2026-01-02T03:04:05.678", 0, "BadNodeIdUnknown", "BadNotFound"])
    );
    let write = |value: i32| json!({ "op": "write", "id": "MW20", "type": "UInt16", "value": value });
    assert_eq!(nobody.ask(&write(1))["error"], "BadUserAccessDenied");
    assert_eq!(nobody.ask(&json!({ "op": "call", "id": "/Stop" }))["error"], "BadUserAccessDenied");
    assert_eq!(station.cell("MW 20"), 0);

    let wrong = node_opcua(&site, port, &["anna", "guess"]).answer();
    assert_eq!(wrong["ok"], false, "{wrong}");
    let mut anna = begin(&["anna", "anna-secret", "Aes256_Sha256_RsaPss"]);
    nobody.done(&json!({ "op": "watch", "ids": ["MW20", "DB10.ramp"], "every": 50 }));
    let first = nobody.done(&json!({ "op": "changes", "count": 2 }))["changes"].clone();
    assert!(first.as_array().is_some_and(|all| all.contains(&json!(["DB10.ramp", [1, 2, 3]]))), "{first}");
    for value in [1, 2, 65535] {
        anna.done(&write(value));
        assert_eq!(nobody.done(&json!({ "op": "changes", "count": 1 }))["changes"], json!([["MW20", value]]));
        assert_eq!(station.cell("MW 20"), i64::from(value));
    }
    for (id, kind, value, why) in [
        ("MW20", "Int16", json!(1), "BadTypeMismatch"),
        ("DB10.ramp", "Int16", json!([1]), "BadTypeMismatch"),
        ("nonsense", "Int16", json!(1), "BadNodeIdUnknown"),
    ] {
        let ask = json!({ "op": "write", "id": id, "type": kind, "value": value });
        assert_eq!(anna.ask(&ask)["error"], why, "{id}");
    }
    anna.done(&json!({ "op": "write", "id": "DB10.ramp", "type": "Int16", "value": [7, 8, 9] }));
    assert_eq!(nobody.done(&json!({ "op": "changes", "count": 1 }))["changes"], json!([["DB10.ramp", [7, 8, 9]]]));
    anna.done(&json!({ "op": "call", "id": "/Stop" }));
    assert_eq!(station.status().state, "STOP");
    drop((nobody, anna));
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_channel_is_encrypted_with_a_key_of_its_own() {
    let site = Site::new();
    users(&site);
    let (station, port) = opcua(&site, "ua-secure", WITH_USERS);
    let mut plain = connected(&site, port, &[]);
    let endpoints = plain.done(&json!({ "op": "endpoints" }))["endpoints"].clone();
    let policies: Vec<&str> =
        endpoints.as_array().expect("a list").iter().filter_map(|one| one["policy"].as_str()).collect();
    assert!(policies.contains(&"Aes256_Sha256_RsaPss") && policies.contains(&"Basic256Sha256"), "{policies:?}");
    assert!(!policies.contains(&"Basic128Rsa15") && !policies.contains(&"Basic256"), "{policies:?}");
    for policy in ["Basic256Sha256", "Aes256Sha256RsaPss"] {
        let words = user("anna");
        let mut more: Vec<&str> = words.iter().map(String::as_str).collect();
        more.extend(["--policy", policy]);
        let mut client = connected(&site, port, &more);
        client.done(&json!({ "op": "write", "id": "MW30", "type": "UInt16", "value": 99 }));
        assert_eq!(station.cell("MW 30"), 99, "{policy}");
        station.set("MW 30", 0);
    }
    let key = site.path("ua-secure.gate/scada/pki/private/private.pem");
    let mode = std::os::unix::fs::MetadataExt::mode(&std::fs::metadata(key).expect("a key")) & 0o777;
    assert_eq!(mode, 0o600);
    drop(plain);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// node-opcua keeps five publish requests for each subscription; others keep more.
#[test]
fn requests_to_be_told_are_kept() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-publish", "");
    let address = std::net::SocketAddr::from(([127, 0, 0, 1], port));
    let mut client = OpcUa::connect(address, std::time::Duration::from_secs(60)).expect("a session");
    let subscription = client.subscribe(50.0).expect("a subscription");
    let (taken, _) = client.monitor(subscription, &["MW20".to_owned()], 50.0).expect("monitored");
    assert_eq!(taken, 1);
    for _ in 0..8 {
        client.ask_to_be_told(None).expect("connected");
    }
    let (values, _) = client.told().expect("a value, not a refusal");
    assert_eq!(values.len(), 1);
    client.told().expect("that it is alive, not a refusal");
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn changes_and_events_are_told_and_the_server_comes_back() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-watch", "");
    let mut client = connected(&site, port, &[]);
    client.done(&json!({ "op": "watch", "ids": ["MW20", "M10.0"], "every": 50 }));
    let first = client.done(&json!({ "op": "changes", "count": 2 }))["changes"].clone();
    assert!(first.as_array().is_some_and(|all| all.contains(&json!(["MW20", 0]))), "{first}");
    // Neighbouring bits and other words do not affect it.
    station.set("M 10.1", 1);
    station.set("MW 22", 7);
    for value in [1, 2, 3] {
        station.set("MW 20", value);
        assert_eq!(client.done(&json!({ "op": "changes", "count": 1 }))["changes"], json!([["MW20", value]]));
    }
    client.done(&json!({ "op": "events" }));
    assert!(site.ob1(&["ctl", "station.toml", "stop"]).code == Some(0));
    loop {
        let event = client.done(&json!({ "op": "event" }));
        if event["message"].as_str().is_some_and(|text| text.contains("STOP")) {
            break;
        }
    }
    drop(client);

    // After a kill it is restarted, and a client finds the same values.
    let (_, gate) = gate(&station);
    gate.signal(Signal::KILL);
    gate.wait("the gate has ended");
    station.until("the link answers again", |_| {
        let mut client = asyncua(&site, port, &[]);
        (client.answer()["ok"] == true).then(|| client.done(&json!({ "op": "read", "ids": ["MW20"] })))
    });
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Parts of values by index range. A part of a text is characters: one that was cut between the bytes of an umlaut once
/// ended the sampling for all clients.
#[test]
fn a_part_of_a_value_is_the_right_one_and_hurts_nobody() {
    let site = Site::new();
    users(&site);
    let (station, port) = opcua(&site, "ua-part", WITH_USERS);
    let words = user("anna");
    let mut anna = connected(&site, port, &words.each_ref().map(String::as_str));
    let mut nobody = connected(&site, port, &[]);
    anna.done(&json!({ "op": "write", "id": "DB10.text", "type": "String", "value": "öäü" }));
    for (id, range, value) in [
        ("DB10.text", "0", json!("ö")),
        ("DB10.text", "1:9", json!("äü")),
        ("DB10.ramp", "1:9", json!([2, 3])),
        ("DB10.text", "3", json!("BadIndexRangeNoData")),
        ("DB10.ramp", "0,0", json!("BadIndexRangeNoData")),
        ("DB10.number", "0", json!("BadIndexRangeNoData")),
    ] {
        let answer = nobody.ask(&json!({ "op": "part", "id": id, "range": range }));
        let told = answer.get("value").unwrap_or(&answer["error"]);
        assert_eq!(*told, value, "{id} {range}: {answer}");
    }
    let watch = |id: &str, range: &str| json!({ "op": "watch_part", "id": id, "range": range });
    assert_eq!(nobody.ask(&watch("DB10.text", "0"))["error"], "BadNotSupported");
    assert_eq!(nobody.ask(&watch("DB10.ramp", "3"))["error"], "BadIndexRangeNoData");
    nobody.done(&watch("DB10.ramp", "1:2"));
    assert_eq!(nobody.done(&json!({ "op": "changes", "count": 1 }))["changes"], json!([["DB10.ramp", [2, 3]]]));
    anna.done(&json!({ "op": "write", "id": "DB10.text", "type": "String", "value": "üöä" }));
    anna.done(&json!({ "op": "write", "id": "DB10.ramp", "type": "Int16", "value": [7, 8, 9] }));
    assert_eq!(nobody.done(&json!({ "op": "changes", "count": 1 }))["changes"], json!([["DB10.ramp", [8, 9]]]));
    drop((anna, nobody));
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The last of several changes is told, however soon it follows, to a fast and to a slow item of the same value.
#[test]
fn the_last_change_is_told() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-last", "");
    let mut clients = [connected(&site, port, &[]), connected(&site, port, &[])];
    for (client, sampling) in clients.iter_mut().zip([50, 500]) {
        client.done(&json!({ "op": "watch", "ids": ["MW20"], "every": 50, "sampling": sampling }));
    }
    for round in 1..=3 {
        let last = round * 10 + 6;
        for value in round * 10..=last {
            station.set("MW 20", value);
        }
        for client in &mut clients {
            while client.done(&json!({ "op": "changes", "count": 1 }))["changes"] != json!([["MW20", last]]) {}
        }
    }
    drop(clients);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The items of a client that is gone are free again when its subscription has expired.
#[test]
fn items_of_a_client_that_is_gone_do_not_stay() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-gone", "items = 4\n");
    let mut client = connected(&site, port, &[]);
    let gone = client.done(&json!({ "op": "vanish", "ids": ["MW20", "MW22", "MW24", "/Scan"] }));
    assert_eq!(gone["accepted"], 4);
    station.until("the items are free", |_| {
        let mut other = connected(&site, port, &[]);
        let flood = other.done(&json!({ "op": "flood", "ids": ["MW30"], "count": 4 }));
        (flood["accepted"] == 4).then_some(())
    });
    drop(client);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// One more than `clients` gets nothing until somebody leaves; who never asks has no place.
#[test]
fn places_are_for_those_who_ask() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-places", "clients = 1\n");
    let read = json!({ "op": "read", "ids": ["MW20"] });
    let silent = connected(&site, port, &[]);
    let mut first = connected(&site, port, &[]);
    assert_eq!(first.done(&read)["values"], json!([0]));
    let mut second = connected(&site, port, &[]);
    assert!(second.ask(&read).to_string().contains("BadTooManySessions"), "{}", second.ask(&read));
    drop((silent, first));
    station.until("the place is free", |_| (second.ask(&read)["values"] == json!([0])).then_some(()));
    drop(second);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Noise, incomplete messages, huge ones, and too many requests: refused, and other clients continue.
#[test]
fn hostile_input_changes_nothing() {
    let site = Site::new();
    let (station, port) = opcua(&site, "ua-hostile", "items = 2000\n");
    let mut client = connected(&site, port, &[]);
    let mut state = 4840u32;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 16
    };
    let hello = |len: u32, size: u32| {
        let url = b"opc.tcp://127.0.0.1:4840/";
        let mut bytes = b"HELF".to_vec();
        bytes.extend(len.to_le_bytes());
        [0, 65_536, 65_536, size, 0, url.len() as u32].iter().for_each(|word| bytes.extend(word.to_le_bytes()));
        bytes.extend(url);
        bytes
    };
    for round in 0..120 {
        let Ok(mut socket) = TcpStream::connect(("127.0.0.1", port)) else { continue };
        let mut bytes = match round % 4 {
            0 => Vec::new(),
            1 => hello(u32::MAX, 0),
            2 => hello(57, u32::MAX),
            _ => [hello(57, 0), b"OPNF\xFF\xFF\xFF\x7F".to_vec()].concat(),
        };
        let len = noise() % 3000;
        bytes.extend((0..len).map(|_| noise() as u8));
        let _ = socket.write_all(&bytes);
        let _ = socket.shutdown(std::net::Shutdown::Write);
        let _ = socket.read(&mut [0; 64]);
    }
    assert_eq!(client.done(&json!({ "op": "read", "ids": ["MW20"] }))["values"], json!([0]));
    let flood = client.done(&json!({ "op": "flood", "ids": ["MW20", "MW22"], "count": 5000 }));
    assert_eq!((&flood["accepted"], &flood["refused"]), (&json!(2000), &json!("BadTooManyMonitoredItems")));
    let huge: Vec<i32> = vec![0; 100_000];
    assert_eq!(client.ask(&json!({ "op": "write", "id": "MW20", "type": "Int32", "value": huge }))["ok"], false);
    let mut other = connected(&site, port, &[]);
    assert_eq!(other.done(&json!({ "op": "read", "ids": ["MW20"] }))["values"], json!([0]));
    drop((client, other));
    assert_eq!(station.interrupt().code(), Some(0));
}
