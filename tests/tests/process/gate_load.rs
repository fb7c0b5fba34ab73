//! Measures the gate under load: ten thousand items of OPC UA, pages that show two hundred variables ten times a
//! second, the first paint of the page. Here only a short functional test; `cargo xtask bench gate` checks the figures.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ob1_command::statistics::{quantile, since};
use ob1_station::access::protocol::Op;
use ob1_tests::bench::median;
use ob1_tests::opcua::OpcUa;
use ob1_tests::siege::Span;
use opcua_types::Variant;
use serde_json::json;

use crate::common::browser::Browser;
use crate::common::gate::{Stream, Visitor, gate, station as example};
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;

/// Monitored items; the second number changes in each period.
const ITEMS: usize = 10_000;
const CHANGING: usize = 1_000;
const PERIOD: Duration = Duration::from_millis(100);
/// Notifications after the first values until the rate is constant.
const SETTLED: u64 = 30;
/// Maximum share of a core for the gate.
const GATE: f64 = 0.25;
/// Variables shown by a page, and number of pages.
const VARIABLES: usize = 200;
const PAGES: usize = 5;
/// Maximum share of a core for the process of the scan.
const SCAN: f64 = 0.02;
/// Maximum ratio of the first paint to that of a static page.
const PAINT: f64 = 3.0;

/// A program that counts in a thousand words ten times a second, with nine thousand additional words.
fn program() -> String {
    let blocks: String = (1..=ITEMS / CHANGING)
        .map(|number| {
            format!(
                "DATA_BLOCK DB {number}\nSTRUCT\n  cells : ARRAY[0..{}] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\n",
                CHANGING - 1
            )
        })
        .collect();
    format!(
        "{blocks}ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n      L MW 100;\n      + 1;\n      T MW 100;\nEND_ORGANIZATION_BLOCK\n\n\
         ORGANIZATION_BLOCK OB 35\nBEGIN\nNETWORK\n      L MW 10;\n      + 1;\n      T MW 10;\n      AUF DB 1;\n      L 0;\n      \
         T MD 20;\n      L {CHANGING};\nnext: T MW 12;\n      L MW 10;\n      T DBW [MD 20];\n      L MD 20;\n      L P#2.0;\n      \
         +D;\n      T MD 20;\n      L MW 12;\n      LOOP next;\nEND_ORGANIZATION_BLOCK\n"
    )
}

fn station(site: &Site, name: &str, link: &str) -> Running {
    site.write("load.awl", &program());
    let file = format!(
        "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"10ms\"\nwatchdog = \"10s\"\n\n[program]\nsources = [\"load.awl\"]\n\n{link}"
    );
    site.write("station.toml", &file);
    site.run("station.toml").until_run()
}

/// CPU time of all threads of a process so far, in seconds.
fn cpu_time(pid: u32) -> f64 {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).expect("it lives").flatten();
    let texts = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("schedstat")).ok());
    let times = texts.filter_map(|text| text.split_whitespace().next()?.parse::<u64>().ok());
    times.sum::<u64>() as f64 / 1e9
}

/// The value that this share of all values does not exceed.
fn share_of(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0)
}

/// Ten thousand items at 100 ms, of which a thousand change each time: the CPU time of the gate, and the delay of the
/// values.
#[test]
fn gate_items() {
    let span = Span::of(30);
    let site = Site::new();
    let port = free_port();
    let link = format!("[[link]]\ntype = \"opcua\"\nname = \"scada\"\nlisten = \"127.0.0.1:{port}\"\n");
    let station = station(&site, "gl-items", &link);
    station.until("the link answers", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    let ids: Vec<String> = (1..=ITEMS / CHANGING)
        .flat_map(|block| (0..CHANGING).map(move |word| format!("DB{block}.DBW{}", 2 * word)))
        .collect();
    let mut client =
        OpcUa::connect(SocketAddr::from(([127, 0, 0, 1], port)), Duration::from_secs(60)).expect("a session");
    let (_, process) = gate(&station);
    let every = PERIOD.as_secs_f64() * 1000.0;
    let subscription = client.subscribe(every).expect("a subscription");
    let taken = client.monitor(subscription, &ids, every).expect("items");
    assert_eq!(taken, (ITEMS, None));
    for _ in 0..4 {
        client.ask_to_be_told(None).expect("a request");
    }
    // Wait for the first values of all items and the backlog before measuring.
    let (mut first, mut after) = (0, 0);
    while after < SETTLED {
        let (values, seen) = client.told().expect("first values");
        first += values.len();
        after += u64::from(first >= ITEMS);
        client.ask_to_be_told(Some(seen)).expect("a request");
    }
    let (begin, cpu) = (Instant::now(), cpu_time(process.pid));
    // Arrival time of each value: the program counts once in each period.
    let mut came: Vec<(f64, i64)> = Vec::new();
    let mut newest = vec![None; ITEMS];
    let (mut messages, mut skipped) = (0, 0);
    while span.goes_on(messages) {
        let (values, seen) = client.told().expect("values come");
        let now = begin.elapsed().as_secs_f64();
        client.ask_to_be_told(Some(seen)).expect("a request");
        messages += u64::from(!values.is_empty());
        for told in values {
            let Some(Variant::UInt16(value)) = told.value.value else { panic!("{:?}", told.value) };
            let place: &mut Option<i64> = &mut newest[told.client_handle as usize];
            // An overflowing number starts again.
            if let Some(before) = place.replace(value.into())
                && before < i64::from(value)
            {
                skipped += (i64::from(value) - before - 1) as u64;
            }
            came.push((now, value.into()));
        }
    }
    let (time, cpu) = (begin.elapsed().as_secs_f64(), cpu_time(process.pid) - cpu);
    let changed = newest.iter().flatten().count();
    assert_eq!(changed, CHANGING, "items that change");
    let due = |value: i64| value as f64 * PERIOD.as_secs_f64();
    let base = came.iter().map(|(at, value)| at - due(*value)).fold(f64::INFINITY, f64::min);
    let mut late: Vec<f64> = came.iter().map(|(at, value)| (at - due(*value) - base) * 1000.0).collect();
    let (p50, p99, most) = (share_of(&mut late, 0.5), share_of(&mut late, 0.99), share_of(&mut late, 1.0));
    println!(
        "{ITEMS} items at {} ms, {CHANGING} changing, {time:.1} s: {} values, {skipped} overtaken by newer ones; the gate takes \
         {:.1} % of a core (aim {} %); late {p50:.1} ms (median), {p99:.1} ms (p99; aim {} ms), {most:.1} ms (most)",
        PERIOD.as_millis(),
        came.len(),
        100.0 * cpu / time,
        100.0 * GATE,
        PERIOD.as_millis(),
    );
    if span.is_campaign() {
        assert!(cpu / time <= GATE, "the gate takes too much");
        assert!(p99 <= PERIOD.as_secs_f64() * 1000.0, "values are late");
        assert!((skipped as f64) < 0.01 * came.len() as f64, "values are left out");
    }
    drop(client);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// What looking at a station did to it: medians of all rounds.
struct Looked {
    /// Share of a core more in the process of the scan.
    cost: f64,
    /// p99 of the execution time, as a multiple of the quiet one.
    ratio: f64,
    /// How far quiet differs from quiet.
    spread: f64,
    round: u64,
    seconds: f64,
    /// Events that the streams were told.
    told: u64,
}

/// Quiet, quiet again, with what `open` opens: streams, of which each waits for this event. `close` ends what else
/// was opened.
fn looked_at(
    station: &Running,
    span: &Span,
    mut open: impl FnMut() -> (&'static str, Vec<Stream>),
    mut close: impl FnMut(),
) -> Looked {
    let pid = station.status().pid;
    let execution = || {
        let answer = station.ask(Op::Timing { histograms: true }).expect("the accounts");
        answer.timing.expect("the accounts").execution.buckets
    };
    let part = |seconds: f64| {
        let (begin, cpu, before) = (Instant::now(), cpu_time(pid), execution());
        while begin.elapsed().as_secs_f64() < seconds {
            assert!(!station.process.ends_within(Duration::from_millis(200)), "it has ended");
        }
        let used = (cpu_time(pid) - cpu) / begin.elapsed().as_secs_f64();
        (used, quantile(&since(&execution(), &before), 0.99) as f64 / 1000.0)
    };
    let seconds = if span.is_campaign() { 10.0 } else { 0.5 };
    let (mut cost, mut ratios, mut spreads) = (Vec::new(), Vec::new(), Vec::new());
    let (mut round, told) = (0, Arc::new(AtomicU64::new(0)));
    while span.goes_on(round) {
        close();
        let (quiet, again) = (part(seconds), part(seconds));
        let (event, streams) = open();
        let over = Arc::new(AtomicBool::new(false));
        let others: Vec<_> = streams
            .into_iter()
            .map(|mut stream| {
                let (over, told) = (Arc::clone(&over), Arc::clone(&told));
                std::thread::spawn(move || {
                    while !over.load(Ordering::Relaxed) && stream.next(event).is_some() {
                        told.fetch_add(1, Ordering::Relaxed);
                    }
                })
            })
            .collect();
        let looked = part(seconds);
        over.store(true, Ordering::Relaxed);
        others.into_iter().for_each(|other| other.join().expect("it has looked"));
        cost.push(looked.0 - f64::midpoint(quiet.0, again.0));
        ratios.push(looked.1 / f64::midpoint(quiet.1, again.1));
        spreads.push((quiet.1 / again.1).max(again.1 / quiet.1));
        round += 1;
    }
    let told = told.load(Ordering::Relaxed);
    Looked {
        cost: median(&mut cost),
        ratio: median(&mut ratios),
        spread: share_of(&mut spreads, 1.0),
        round,
        seconds,
        told,
    }
}

/// Five pages show the statements of OB 1, ten passes a second: the effect on the scan.
#[test]
fn gate_flows() {
    let span = Span::of(3);
    let site = Site::new();
    let port = free_port();
    let link = format!("[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:{port}\"\n");
    let station = station(&site, "gl-flows", &link);
    station.until("the page is served", |_| Visitor::at(port).try_get("/api/session"));
    let seen = looked_at(
        &station,
        &span,
        || {
            let stream = |_| Visitor::at(port).stream("?flows=OB%201%7C1%7Cstl%7C", "");
            ("flow", (0..PAGES).map(stream).collect())
        },
        || (),
    );
    let Looked { cost, ratio, spread, round, seconds, told } = seen;
    println!(
        "power flow at 10 Hz in {PAGES} pages, {round} rounds of three times {seconds} s: {:.2} % of a core more in the process of \
         the scan; p99 of the execution x {ratio:.3} (quiet against itself up to x {spread:.3}); {told} passes told",
        100.0 * cost,
    );
    assert!(told > 0, "nothing was told");
    assert!(!span.is_campaign() || ratio <= spread.max(1.10), "the scan takes longer when it is looked at");
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Five pages show two hundred variables ten times a second: the CPU time of the scan's process, and the effect on the
/// scan.
#[test]
fn gate_browsers() {
    let span = Span::of(3);
    let site = Site::new();
    let port = free_port();
    let link = format!("[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:{port}\"\n");
    let station = station(&site, "gl-pages", &link);
    station.until("the page is served", |_| Visitor::at(port).try_get("/api/session"));
    let names: Vec<String> = (0..VARIABLES).map(|word| format!("DB{}.DBW{}", 1 + word % 10, 2 * word)).collect();
    let items = names.join("%0A");
    let browser = Browser::open(1200);
    let seen = looked_at(
        &station,
        &span,
        || {
            browser.go(&format!("http://127.0.0.1:{port}/#variables?items={items}"));
            browser.until(&format!("document.querySelectorAll('#values td.value').length === {VARIABLES}"));
            browser.run("const period = document.querySelector('#period'); period.value = '100'; document.querySelector('#table-watch').click()");
            browser.until(&format!("document.querySelectorAll('#values td.value').length === {VARIABLES}"));
            let streams = (1..PAGES).map(|_| Visitor::at(port).stream(&format!("?period=100&items={items}"), ""));
            ("values", streams.collect())
        },
        || browser.go("about:blank"),
    );
    let Looked { cost, ratio, spread, round, seconds, told } = seen;
    println!(
        "{VARIABLES} variables at 10 Hz to {PAGES} pages, {round} rounds of three times {seconds} s: {:.2} % of a core more in the \
         process of the scan (aim {} %); p99 of the execution x {ratio:.3} (quiet against itself up to x {spread:.3}); {} tables told",
        100.0 * cost,
        100.0 * SCAN,
        told,
    );
    assert!(told > 0, "nothing was told");
    if span.is_campaign() {
        assert!(cost <= SCAN, "too much for the process of the scan");
        assert!(ratio <= spread.max(1.10), "the scan takes longer when it is looked at");
    }
    drop(browser);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// The first paint of the page compared with a static page of the same size, alternately.
#[test]
fn gate_paint() {
    let span = Span::of(2);
    let site = Site::new();
    let (_station, port, _) = example(&site, "gl-paint", "");
    let browser = Browser::open(1200);
    browser.uncached();
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('.card.run')");
    let (_, weight) = browser.traffic();
    let text = "A machine that must not stop. ".repeat(weight as usize / 30);
    let body = format!("<!doctype html><title>static</title><p>{text}</p>");
    let still = TcpListener::bind("127.0.0.1:0").expect("a port");
    let still_port = still.local_addr().expect("an address").port();
    // This thread ends with the test.
    std::thread::spawn(move || {
        for mut stream in still.incoming().flatten() {
            let _ = stream.read(&mut [0; 4096]);
            let head = format!(
                "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
                body.len()
            );
            let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body.as_bytes()));
        }
    });
    let paint = |url: &str| {
        browser.go("about:blank");
        browser.go(url);
        browser.until("performance.getEntriesByName('first-contentful-paint').length > 0");
        let at = browser.run("return performance.getEntriesByName('first-contentful-paint')[0].startTime");
        at.as_f64().expect("a time")
    };
    let (mut ours, mut others) = (Vec::new(), Vec::new());
    let mut round = 0;
    while span.goes_on(round) {
        ours.push(paint(&format!("http://127.0.0.1:{port}/")));
        others.push(paint(&format!("http://127.0.0.1:{still_port}/")));
        round += 1;
    }
    let (ours, others) = (median(&mut ours), median(&mut others));
    println!(
        "first paint of the page ({weight} bytes): {ours:.0} ms; of a static page of its size: {others:.0} ms; x {:.2} (aim x {PAINT})",
        ours / others
    );
    assert!(json!(ours / others).is_number(), "both were painted");
    assert!(!span.is_campaign() || ours <= PAINT * others, "the page is slow");
}
