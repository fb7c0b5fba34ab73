//! MQTT of a running station: mosquitto as the broker, paho and Eclipse Tahu's Sparkplug B as the partner.

use std::collections::BTreeSet;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::{Value, json};

use crate::common::fleet::{Broker, Listener, station};
use crate::common::site::Site;
use crate::common::station::counting;

fn link(port: u16, keys: &str) -> String {
    format!(
        "[[link]]\ntype = \"mqtt\"\nname = \"cloud\"\nbroker = \"mqtt://127.0.0.1:{port}\"\nevery = \"50ms\"\n{keys}"
    )
}

#[test]
fn values_are_told_when_they_change() {
    let site = Site::new();
    let broker = Broker::start(&site);
    let listener = Listener::start(&site, broker.port, "ob1/#");
    let keys = "publish = [\"MW20\", \"\\\"Start\\\"\", \"DB10\"]\n";
    let station = station(&site, "mq-values", &link(broker.port, keys));
    let mut first = std::collections::BTreeMap::new();
    listener.until("all values", |said| {
        first.insert(said["topic"].as_str()?.to_owned(), said["payload"].clone());
        (first.len() == 13).then_some(())
    });
    for (name, value) in [
        ("DB10.number", json!(-7)),
        ("DB10.text", json!("hello")),
        ("DB10.ramp", json!([1, 2, 3])),
        ("DB10.motor.on", json!(true)),
        ("DB10.moment", json!("2026-01-02T03:04:05.678")),
        ("Start", json!(false)),
    ] {
        assert_eq!(first[&format!("ob1/mq-values/{name}")]["value"], value, "{name}");
    }
    assert_eq!(first["ob1/mq-values/online"], json!(true));
    station.set("MW 20", 321);
    let told = listener.until("the change", |said| (said["payload"]["value"] == 321).then(|| said.clone()));
    assert_eq!(told["topic"], "ob1/mq-values/MW20");
    // A late subscriber gets the last values.
    let late = Listener::start(&site, broker.port, "ob1/mq-values/MW20");
    assert!(
        late.until("kept", |said| (said["payload"]["value"] == 321).then(|| said["retain"].as_bool())).unwrap_or(false)
    );
    assert_eq!(station.interrupt().code(), Some(0));
    listener.until("the last word", |said| {
        (said["topic"] == "ob1/mq-values/online" && said["payload"] == false).then_some(())
    });
}

/// Alarms with their texts, when they come, are acknowledged and go; a late subscriber gets what stands.
#[test]
fn alarms_are_told() {
    let site = Site::new();
    let broker = Broker::start(&site);
    let listener = Listener::start(&site, broker.port, "ob1/mq-alarms/alarms");
    site.write("alarms.csv", "number;text\n16#60000002;Tank @1W%d@ is empty\n");
    let rest = "CALL SFB 33, DB 33 (EN_R := TRUE, SIG := M 90.1, ID := W#16#EEEE, EV_ID := DW#16#60000002, \
                SEVERITY := W#16#40, SD_1 := MW 20);\n";
    site.write("plant.awl", &counting("DATA_BLOCK DB 33 SFB 33\nBEGIN\nEND_DATA_BLOCK\n", rest));
    site.write(
        "station.toml",
        &format!(
            "[station]\nname = \"mq-alarms\"\n\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\n\n[program]\n\
             sources = [\"plant.awl\"]\nalarms = \"alarms.csv\"\n\n{}",
            link(broker.port, "alarms = true\n")
        ),
    );
    let station = site.run("station.toml").until_run();
    let until = |what: &str, standing: u64, open: u64| {
        listener.until(what, |said| {
            let told = &said["payload"];
            (told["standing"] == standing && told["unacknowledged"] == open).then(|| told["alarms"].clone())
        })
    };
    until("none", 0, 0);
    station.set("MW 20", 7);
    station.set("M 90.1", 1);
    let list = until("it has come", 1, 1);
    assert_eq!((&list[0]["text"], &list[0]["active"]), (&json!("Tank 7 is empty"), &json!(true)), "{list}");
    let late = Listener::start(&site, broker.port, "ob1/mq-alarms/alarms");
    late.until("kept", |said| (said["payload"]["standing"] == 1 && said["retain"] == true).then_some(()));
    assert_eq!(site.ob1(&["alarms", "mq-alarms", "ack", "all"]).fine(), "1 acknowledged\n");
    until("it is acknowledged", 1, 0);
    station.set("M 90.1", 0);
    until("it has gone", 1, 1);
    assert_eq!(site.ob1(&["alarms", "mq-alarms", "ack", "16#60000002"]).fine(), "1 acknowledged\n");
    until("nothing is left", 0, 0);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The broker is stopped repeatedly while values change: each has a number, and none is missing.
#[test]
fn a_broker_that_comes_and_goes_loses_nothing() {
    let site = Site::new();
    let mut broker = Broker::start(&site);
    let listener = Listener::start(&site, broker.port, "ob1/mq-kill/MW100");
    let station = station(&site, "mq-kill", &link(broker.port, "publish = [\"MW100\"]\n"));
    let mut numbers = BTreeSet::new();
    let mut hear = |count: u64, what: &str| {
        let mut left = count;
        listener.until(what, |said| {
            let number = said["payload"]["number"].as_u64()?;
            left -= u64::from(numbers.insert(number) && left > 0);
            (left == 0).then_some(number)
        })
    };
    hear(10, "the first values");
    for round in 0..5 {
        broker.end();
        // Values continue to change without a broker.
        station.scans(100);
        broker.begin();
        hear(20, &format!("after the broker was gone {round} times"));
    }
    let last = *numbers.last().expect("some");
    listener.until("up to the last", |said| {
        numbers.extend(said["payload"]["number"].as_u64());
        (numbers.range(..=last).count() as u64 == last).then_some(())
    });
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A station that ends while the broker is away keeps what it has not sent, and its next run sends that first.
#[test]
fn the_next_run_sends_what_was_left() {
    let site = Site::new();
    let mut broker = Broker::start(&site);
    let listener = Listener::start(&site, broker.port, "ob1/mq-left/MW20");
    let first = station(&site, "mq-left", &link(broker.port, "publish = [\"MW20\"]\n"));
    listener.until("the first value", |said| (said["payload"]["value"] == 0).then_some(()));
    broker.end();
    for value in [501, 502, 503] {
        first.set("MW 20", value);
        // Longer than the sampling interval of the link.
        first.scans(100);
    }
    assert_eq!(first.interrupt().code(), Some(0));
    let files = std::fs::read_dir(site.path("mq-left.gate/cloud/store")).expect("a folder").count();
    assert!(files > 0, "nothing is on the disk");
    broker.begin();
    let second = site.run("station.toml").until_run();
    let mut left = BTreeSet::new();
    listener.until("what was left", |said| {
        left.extend(said["payload"]["value"].as_u64().filter(|value| (501..=503).contains(value)));
        (left.len() == 3).then_some(())
    });
    assert_eq!(second.interrupt().code(), Some(0));
}

/// A broker that accepts a connection and drops it at the first message, as some do with clients that may not publish.
#[test]
fn a_broker_that_drops_us_is_left_alone_longer_each_time() {
    let site = Site::new();
    let broker = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = broker.local_addr().expect("bound").port();
    let connections = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&connections);
    // It ends with the process.
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        let mut heard = |stream: &mut TcpStream| stream.read(&mut bytes).is_ok_and(|count| count > 0);
        for mut stream in broker.incoming().flatten() {
            counted.fetch_add(1, Ordering::Relaxed);
            // CONNECT, CONNACK, and whatever comes next.
            if heard(&mut stream) && stream.write_all(&[0x20, 2, 0, 0]).is_ok() {
                heard(&mut stream);
            }
        }
    });
    let station = station(&site, "mq-dropped", &link(port, "publish = [\"MW20\"]\n"));
    station.scans(1000);
    assert_eq!(station.interrupt().code(), Some(0));
    let connections = connections.load(Ordering::Relaxed);
    assert!((1..12).contains(&connections), "{connections}");
}

#[test]
fn commands_are_written_by_right_alone() {
    let site = Site::new();
    let broker = Broker::start(&site);
    let mut listener = Listener::start(&site, broker.port, "ob1/mq-set/#");
    // A retained command from before the connection: it must not be executed.
    listener.say(&json!({ "topic": "ob1/mq-set/MW20/set", "payload": 666, "retain": true }));
    let keys = "rights = \"write\"\npublish = [\"MW20\"]\ncommands = [\"MW20\", \"DB10.text\"]\n";
    let station = station(&site, "mq-set", &link(broker.port, keys));
    listener.until("online", |said| (said["topic"] == "ob1/mq-set/online" && said["payload"] == true).then_some(()));
    for (name, value, ok) in [
        ("MW20", json!(17), true),
        ("DB10.text", json!("bye"), true),
        ("MW20", json!("x"), false),
        ("MW20", json!(70_000), false),
        ("MW22", json!(1), false),
    ] {
        listener.say(&json!({ "topic": format!("ob1/mq-set/{name}/set"), "payload": value }));
        if name == "MW22" {
            continue;
        }
        let topic = format!("ob1/mq-set/{name}/result");
        let result = listener.until("the result", |said| (said["topic"] == topic).then(|| said["payload"].clone()));
        assert_eq!(result["ok"], ok, "{name}: {result}");
    }
    assert_eq!(station.cells(&["MW 20", "MW 22"]), [17, 0]);
    let log = std::fs::read_to_string(site.path("mq-set.audit")).expect("an audit log");
    assert!(log.contains("write MW20 = 17") && !log.contains("666"), "{log}");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Births, deaths, sequence numbers, and after an interruption the missed values as historical ones.
#[test]
fn sparkplug_is_whole_after_a_break() {
    let site = Site::new();
    let mut broker = Broker::start(&site);
    let mut listener = Listener::start(&site, broker.port, "spBv1.0/plant/#");
    let keys = "rights = \"write\"\nsparkplug = \"plant\"\n\
                commands = [\"MW20\", \"DB10.number\", \"DB10.moment\"]\n\
                publish = [\"MW20\", \"DB10.ramp\", \"DB10.number\"]\n";
    let station = station(&site, "mq-spb", &link(broker.port, keys));
    let kind = |said: &Value, kind: &str| said["topic"] == format!("spBv1.0/plant/{kind}/mq-spb");
    let birth = listener.until("a birth", |said| kind(said, "NBIRTH").then(|| said["payload"].clone()));
    assert_eq!(birth["seq"], 0);
    let metric = |name: &str| {
        let all = birth["metrics"].as_array().expect("metrics");
        all.iter().find(|metric| metric["name"] == name).unwrap_or_else(|| panic!("{name}: {birth}")).clone()
    };
    assert_eq!((&metric("DB10.number")["value"], &metric("DB10.ramp[2]")["value"]), (&json!(-7), &json!(2)));
    assert_eq!(metric("Node Control/Rebirth")["value"], false);
    let alias = metric("MW20")["alias"].clone();
    let bd_seq = metric("bdSeq")["value"].clone();
    assert_eq!(bd_seq, 0, "the first connection");

    let mut seq = 0;
    for value in 1..=5 {
        station.set("MW 20", value);
        let data = listener.until("data", |said| kind(said, "NDATA").then(|| said["payload"].clone()));
        assert_eq!((&data["metrics"][0]["alias"], &data["metrics"][0]["value"]), (&alias, &json!(value)));
        seq += 1;
        assert_eq!(data["seq"], seq);
    }
    let command =
        json!({ "topic": "spBv1.0/plant/NCMD/mq-spb", "metrics": [{ "name": "MW20", "type": 6, "value": 77 }] });
    listener.say(&command);
    station.until("the command", |station| (station.cell("MW 20") == 77).then_some(()));
    // Without a data type it is that of the birth; a date is milliseconds since 1970.
    listener.say(&json!({ "topic": "spBv1.0/plant/NCMD/mq-spb", "metrics": [
        { "name": "DB10.number", "type": 0, "value": -5 },
        { "name": "DB10.moment", "type": 13, "value": 1_767_225_600_000_u64 },
    ] }));
    station.until("2026-01-01", |station| (station.cells(&["DB10.DBW 0", "DB10.DBB 46"]) == [65531, 1]).then_some(()));
    let rebirth = |value: bool| {
        let metric = json!({ "name": "Node Control/Rebirth", "type": 11, "value": value });
        json!({ "topic": "spBv1.0/plant/NCMD/mq-spb", "metrics": [metric] })
    };
    // Switched off it asks for nothing: the next data come without a birth.
    listener.say(&rebirth(false));
    station.set("MW 20", 78);
    let next = listener.until("data without a birth", |said| {
        let told = said["payload"]["metrics"].as_array().is_some_and(|all| all.iter().any(|one| one["value"] == 78));
        (kind(said, "NBIRTH") || kind(said, "NDATA") && told).then(|| said["topic"].clone())
    });
    assert_eq!(next, "spBv1.0/plant/NDATA/mq-spb");
    listener.say(&rebirth(true));
    listener.until("another birth", |said| (kind(said, "NBIRTH") && said["payload"]["seq"] == 0).then_some(()));

    broker.end();
    for value in [1001, 1002, 1003] {
        station.set("MW 20", value);
        // Longer than the sampling interval of the link, in scans of the CPU.
        station.scans(200);
    }
    broker.begin();
    let birth = listener.until("a birth after the break", |said| kind(said, "NBIRTH").then(|| said["payload"].clone()));
    let again = birth["metrics"].as_array().and_then(|all| all.iter().find(|one| one["name"] == "bdSeq").cloned());
    assert_ne!(again.map(|one| one["value"].clone()), Some(bd_seq));
    let mut missed = BTreeSet::new();
    listener.until("what was missed", |said| {
        for metric in said["payload"]["metrics"].as_array()? {
            if metric["historical"] == true && metric["alias"] == alias {
                assert_eq!(metric["name"], "", "names stand in births alone: {metric}");
                missed.extend(metric["value"].as_i64());
            }
        }
        missed.contains(&1003).then_some(())
    });
    assert_eq!(station.interrupt().code(), Some(0));
    listener.until("a death", |said| kind(said, "NDEATH").then_some(()));
}
