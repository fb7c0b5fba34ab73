//! An independent RK 512 partner: `tests/peers/rk512.py`, written from the manual, on the pty of station B of
//! `examples/rk512-pair`, in both roles.

use serde_json::json;

use crate::common::checkout;
use crate::common::peer::{Events, Partner};
use crate::common::site::{Site, example_station, replaced};
use crate::common::station::Running;

const LINE: &str = "line.pty";

/// Station B on a pty, synchronised with its CP, without own orders.
fn station_b(site: &Site) -> Running {
    let file = example_station("examples/rk512-pair", "station-b.toml", |text| {
        replaced(&text, "serial:null-modem.pty", &format!("pty:{LINE}"))
    });
    site.write("station-b.toml", &file);
    // It waits before its first order, because no partner is connected yet.
    let program = std::fs::read_to_string(checkout("examples/rk512-pair/b.awl")).expect("the program");
    site.write("b.awl", &replaced(&program, "PAUSE : BOOL; ", "PAUSE : BOOL := TRUE; "));
    let b = site.run("station-b.toml").until_run();
    b.until("the CP works", |b| (b.cell("DB20.SYNCS") == 1 && b.status().modules[0].present).then_some(()));
    b.until("the pty", |_| site.path(LINE).exists().then_some(()));
    b
}

/// Error number and data of the reactions to the partner's orders.
fn reactions(events: &Events) -> Vec<(String, String)> {
    let text = |value: &serde_json::Value| value.as_str().expect("text").to_owned();
    events.all("reaction").iter().map(|event| (text(&event["code"]), text(&event["data"]))).collect()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// FC 4 serves SEND and FETCH, in one telegram and in several, sets and respects the coordination flag, and refuses
/// invalid orders.
#[test]
fn the_station_serves_the_partner() {
    let site = Site::new();
    let b = station_b(&site);
    let mut partner = Partner::start_script(&site, &site.path(LINE), "high", "tests/peers/rk512.py");
    let block: Vec<u8> = (0..200).map(|i| (i * 7 + 3) as u8).collect();
    partner.give(&json!({"do": "put", "db": 21, "dw": 0, "data": hex(&block), "flag": "0604"}));
    b.until("the block is handed on", |b| (b.cell("DB20.RECEIVED") == 1).then_some(()));
    partner.give(&json!({"do": "fetch", "area": "D", "db": 22, "dw": 0, "length": 100}));
    partner.give(&json!({"do": "fetch", "area": "D", "db": 22, "dw": 99, "length": 1}));
    // Bit memory: M 6.4 is 0 again.
    partner.give(&json!({"do": "fetch", "area": "M", "dw": 6, "length": 1}));
    b.set("DB20.HOLD", 1);
    partner.give(&json!({"do": "put", "db": 21, "dw": 0, "data": "0102", "flag": "0604"}));
    partner.give(&json!({"do": "put", "db": 21, "dw": 0, "data": "0304", "flag": "0604"}));
    partner.give(&json!({"do": "fetch", "area": "D", "db": 21, "dw": 0, "length": 1}));
    // Unknown data block, too long, unknown area, unknown command, invalid flag.
    partner.give(&json!({"do": "put", "db": 99, "dw": 0, "data": "0102"}));
    partner.give(&json!({"do": "put", "db": 21, "dw": 99, "data": "01020304"}));
    partner.give(&json!({"do": "fetch", "area": "X", "db": 21, "dw": 0, "length": 1}));
    partner.give(&json!({"do": "raw", "data": "00004244150000010000"}));
    partner.give(&json!({"do": "put", "db": 21, "dw": 0, "data": "0102", "flag": "0608"}));
    let events = partner.end();
    let seen = reactions(&events);
    let expected = [
        ("00", String::new()),
        ("00", hex(&block)),
        ("00", hex(&block[198..])),
        ("00", "00".into()),
        ("00", String::new()),
        ("32", String::new()),
        ("00", "0102".into()),
        ("14", String::new()),
        ("14", String::new()),
        ("10", String::new()),
        ("16", String::new()),
        ("0c", String::new()),
    ];
    let expected: Vec<_> = expected.into_iter().map(|(code, data)| (code.to_owned(), data)).collect();
    assert_eq!(seen, expected, "{events:#?}");
    assert_eq!(b.cell("DB20.ERROR") + b.cell("DB20.ABORTED"), 0);
    let ended = b.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
}

/// FC 3 gives orders, and gets the partner's error number; FC 4 serves at the same time.
#[test]
fn the_station_gives_orders_while_it_serves() {
    let site = Site::new();
    let b = station_b(&site);
    let mut partner = Partner::start_script(&site, &site.path(LINE), "high", "tests/peers/rk512.py");
    b.set("DB20.PAUSE", 0);
    partner.give(&json!({"do": "serve", "count": 3}));
    partner.give(&json!({"do": "serve", "refuse": "32"}));
    b.until("it knows why", |b| (b.cell("DB20.ERROR") == 1 && b.cell("DB20.LAST_ERROR") == 0x32).then_some(()));
    // Its next order is being sent: the partner gets it while waiting for the reactions to its own.
    b.until("the next order", |b| (b.cell("DB20.STARTED") == 5).then_some(()));
    b.set("DB20.PAUSE", 1);
    let block: Vec<u8> = (0..200).map(|i| (i * 5 + 1) as u8).collect();
    partner.give(&json!({"do": "put", "db": 21, "dw": 0, "data": hex(&block), "flag": "0604"}));
    partner.give(&json!({"do": "fetch", "area": "D", "db": 21, "dw": 0, "length": 100}));
    b.until("the last order is done", |b| (b.cell("DB20.STATE") == 0).then_some(()));
    let (done, started) = (b.cell("DB20.DONE"), b.cell("DB20.STARTED"));
    let events = partner.end();
    assert_eq!(reactions(&events), [("00".to_owned(), String::new()), ("00".to_owned(), hex(&block))], "{events:#?}");
    let orders = events.all("order");
    assert_eq!((orders.len(), done, started), (5, 4, 5), "{events:#?}");
    for (order, number) in orders.iter().zip(1..) {
        let expected = hex(&[(number >> 8) as u8, number as u8].repeat(20));
        assert_eq!((order["db"].as_i64(), order["data"].as_str()), (Some(30), Some(&*expected)), "{order}");
        assert_eq!(order["flag"], "ffff");
    }
    let ended = b.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
}

/// The unchanged example: two processes, each in both roles.
#[test]
fn the_pair_of_the_example() {
    let site = Site::new();
    for name in ["a.awl", "b.awl"] {
        std::fs::copy(checkout("examples/rk512-pair").join(name), site.path(name)).expect("a file of the example");
    }
    for name in ["station-a.toml", "station-b.toml"] {
        site.write(name, &example_station("examples/rk512-pair", name, |text| text));
    }
    let a = site.run("station-a.toml").until_run();
    let b = site.run("station-b.toml").until_run();
    a.until("blocks come back", |a| (a.cell("DB20.GOOD") >= 20).then_some(()));
    b.until("the counter arrives", |b| (b.cell("DB20.DONE") >= 20).then_some(()));
    b.set("DB20.HOLD", 1);
    a.until("the coordination flag locks", |a| (a.cell("DB20.LOCKED") >= 3).then_some(()));
    b.set("DB20.HOLD", 0);
    let good = a.cell("DB20.GOOD");
    a.until("it goes on", |a| (a.cell("DB20.GOOD") > good + 3).then_some(()));
    // One wrong block: it was accepted when B was paused, so A fetched the previous one.
    assert_eq!((a.cell("DB20.WRONG"), a.cell("DB20.PAFE_ACTIVE"), a.cell("DB20.PAFE_PASSIVE")), (1, 0, 0));
    assert_eq!(a.cell("DB20.LAST_ERROR"), 0x32);
    for station in [a, b] {
        let ended = station.interrupt();
        assert_eq!(ended.code(), Some(0), "{ended:?}");
    }
}
