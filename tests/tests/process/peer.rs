//! An independent partner: the Python script in `tests/peers`, written only from the manual, uses 3964R with station B
//! of the demo, whose program sends back everything it receives.
//!
//! In each test the partner makes one error, and the test checks the results on both sides: the partner's events, the
//! station's DB 20.

use serde_json::{Value, json};

use crate::common::ledger::Ledger;
use crate::common::peer::{Events, Partner};
use crate::common::site::{Site, demo_station, replaced};
use crate::common::station::Running;

/// The pty of station B.
const LINE: &str = "line.pty";

/// Station B on a pty, synchronised with its CP.
fn echo(site: &Site, priority: &str) -> Running {
    let file = demo_station("station-b.toml", |text| {
        let text = replaced(&text, "serial:null-modem.pty", &format!("pty:{LINE}"));
        replaced(&text, "priority = \"low\"", &format!("priority = \"{priority}\""))
    });
    site.write("station-b.toml", &file);
    let b = site.run("station-b.toml").until_run();
    b.until("the CP works", |b| (b.cell("DB20.SYNCS") == 1 && b.status().modules[0].present).then_some(()));
    b.until("the pty", |_| site.path(LINE).exists().then_some(()));
    b
}

/// The priority of the other side.
fn other(priority: &str) -> &'static str {
    if priority == "high" { "low" } else { "high" }
}

/// The station's ledger after this many completed echoes, with none running.
fn done(b: &Running, echoes: i64) -> Ledger {
    b.until("the echo is done", |b| {
        let ledger = Ledger::of_b(b);
        (ledger["DONE"] >= echoes && ledger["STATE"] == 0).then_some(ledger)
    })
}

/// Ends both; returns the events of the partner.
fn end(b: Running, partner: Partner, ledger: &Ledger) -> Events {
    let events = partner.end();
    assert_eq!((ledger["PAFE_SEND"], ledger["PAFE_RECEIVE"], ledger["SYNCS"]), (0, 0, 1), "{ledger:?}");
    assert_eq!((ledger["ERROR"], ledger["ABORTED"]), (0, 0), "{ledger:?}");
    let ended = b.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
    events
}

/// Plays steps that cause this many echoes.
fn play(priority: &str, steps: &[Value], echoes: i64) -> (Events, Ledger) {
    let site = Site::two_stations();
    let b = echo(&site, other(priority));
    let mut partner = Partner::start(&site, &site.path(LINE), priority);
    for step in steps {
        partner.give(step);
    }
    let ledger = done(&b, echoes);
    let events = end(b, partner, &ledger);
    (events, ledger)
}

/// One telegram and its echo, with a fault in one of them.
fn one_with(send: &Value, receive: &Value) -> (Events, Ledger) {
    let (mut first, mut second) = (json!({"do": "send", "text": "hello"}), json!({"do": "receive"}));
    for (step, more) in [(&mut first, send), (&mut second, receive)] {
        let step = step.as_object_mut().expect("a step");
        step.extend(more.as_object().expect("what to do otherwise").clone());
    }
    let (events, ledger) = play("high", &[first, second], 1);
    let counts = ["RECEIVED", "STARTED", "DONE", "BUSY"].map(|name| ledger[name]);
    assert_eq!(counts, [1, 1, 1, 0], "once, whatever happened: {ledger:?}\n{events:#?}");
    assert_eq!(events.received(), [hex(b"hello")], "{events:#?}");
    (events, ledger)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Telegrams and echoes one after the other: each after the station's program knows that the previous echo has arrived.
fn there_and_back(payloads: &[Vec<u8>]) {
    let site = Site::two_stations();
    let b = echo(&site, "low");
    let mut partner = Partner::start(&site, &site.path(LINE), "high");
    for (payload, echoes) in payloads.iter().zip(1..) {
        partner.give(&json!({"do": "send", "data": hex(payload)}));
        partner.give(&json!({"do": "receive"}));
        done(&b, echoes);
    }
    let ledger = Ledger::of_b(&b);
    let events = end(b, partner, &ledger);
    let expected: Vec<String> = payloads.iter().map(|data| hex(data)).collect();
    assert_eq!(events.received(), expected);
    let sent: Vec<&str> = events.all("sent").iter().filter_map(|event| event["data"].as_str()).collect();
    assert_eq!(sent, expected);
    // Neither side had to repeat anything.
    assert!(events.refused().is_empty() && events.all("abandoned").is_empty(), "{events:#?}");
    let counts = ["RECEIVED", "STARTED", "DONE"].map(|name| ledger[name] as usize);
    assert_eq!(counts, [payloads.len(); 3], "{ledger:?}");
}

#[test]
fn plain_telegrams_of_all_lengths() {
    let lengths = [1, 2, 11, 12, 13, 24, 25, 100, 249, 250];
    there_and_back(&lengths.map(|length| (0..length).map(|i| (i * 7 + length) as u8).collect()));
}

#[test]
fn data_that_look_like_control_characters() {
    there_and_back(&[
        vec![0x10],
        vec![0x10; 125],
        vec![0x10, 0x03],
        vec![0x02, 0x10, 0x03, 0x15, 0x10, 0x10, 0x03, 0x10],
        vec![0x03; 30],
        vec![0x02, 0x15],
        (0..=249).collect(),
        (6..=255).rev().collect(),
    ]);
}

#[test]
fn a_wrong_bcc_is_refused_and_the_repetition_arrives_once() {
    let (events, _) = one_with(&json!({"bad_bcc": 1}), &json!({}));
    assert_eq!(events.answers(), [("block", "NAK")], "{events:#?}");
    assert_eq!(events.all("sent")[0]["blocks"], 2, "{events:#?}");
}

#[test]
fn a_request_without_an_answer_is_repeated_after_qvz() {
    let (events, _) = one_with(&json!({}), &json!({"omit_dle": 2}));
    assert_eq!(events.refused(), ["omit_dle"; 2], "{events:#?}");
}

#[test]
fn a_refused_request_is_repeated() {
    let (events, _) = one_with(&json!({}), &json!({"nak_connect": 2}));
    assert_eq!(events.refused(), ["nak_connect"; 2], "{events:#?}");
}

#[test]
fn a_block_without_an_answer_is_repeated_after_qvz() {
    let (events, _) = one_with(&json!({}), &json!({"omit_end_dle": 1}));
    assert_eq!(events.refused(), ["omit_end_dle"], "{events:#?}");
    assert_eq!(events.all("refused")[0]["data"], hex(b"hello"), "the same block twice: {events:#?}");
}

#[test]
fn a_refused_block_is_repeated() {
    let (events, _) = one_with(&json!({}), &json!({"nak_block": 2}));
    assert_eq!(events.refused(), ["nak_block"; 2], "{events:#?}");
}

/// Both start to send at the same time: the station its echo of "first", the partner "second".
fn conflict(priority: &str) -> Events {
    let mut steps = vec![json!({"do": "send", "text": "first"}), json!({"do": "conflict", "text": "second"})];
    if priority == "high" {
        steps.push(json!({"do": "receive"}));
    }
    steps.push(json!({"do": "receive"}));
    let (events, ledger) = play(priority, &steps, 2);
    let sent: Vec<&str> = events.all("sent").iter().filter_map(|event| event["data"].as_str()).collect();
    assert_eq!(sent, [hex(b"first"), hex(b"second")], "{events:#?}");
    assert_eq!(events.received(), [hex(b"first"), hex(b"second")], "both echoes get through: {events:#?}");
    // If the station gives way, the second telegram arrives before the echo of the first is sent: its echo waits.
    assert_eq!((ledger["RECEIVED"], ledger["BUSY"], ledger["STARTED"]), (2, 0, 2), "{ledger:?}");
    events
}

fn place(events: &Events, kind: &str, data: &str) -> usize {
    let is_it = |event: &Value| event["event"] == kind && event["data"] == hex(data.as_bytes());
    events.0.iter().position(is_it).unwrap_or_else(|| panic!("{kind} {data}: {events:#?}"))
}

#[test]
fn a_station_of_low_priority_gives_way() {
    let events = conflict("high");
    assert_eq!(events.all("conflict")[0]["gives_way"], "partner");
    assert!(place(&events, "sent", "second") < place(&events, "received", "first"), "{events:#?}");
}

#[test]
fn a_station_of_high_priority_insists() {
    let events = conflict("low");
    assert_eq!(events.all("conflict")[0]["gives_way"], "self");
    assert!(place(&events, "received", "first") < place(&events, "sent", "second"), "{events:#?}");
}

#[test]
fn a_character_that_is_no_stx_gets_a_nak() {
    let steps = [
        json!({"do": "character", "data": "41"}),
        json!({"do": "character", "data": "10"}),
        json!({"do": "send", "text": "hello"}),
        json!({"do": "receive"}),
    ];
    let (events, ledger) = play("high", &steps, 1);
    let idle: Vec<&Value> = events.all("idle").iter().map(|event| &event["byte"]).collect();
    assert_eq!(idle, ["NAK", "NAK"], "{events:#?}");
    assert_eq!((ledger["RECEIVED"], events.received()), (1, vec![hex(b"hello").as_str()]), "{ledger:?}\n{events:#?}");
}
