//! Alarms with texts: `ob1 alarms`, the control socket, the page's requests and figures.

use serde_json::{Value, json};

use super::browser::turn_to;
use crate::common::browser::Browser;
use crate::common::gate::{Visitor, add_user};
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::counting;
use crate::common::{checkout, python};

/// SFC 17 at each edge of M 0.0 with two words from MW 10 on; SFB 33 with M 0.1.
const REST: &str = "\
      U     M 0.0;
      FP    M 1.0;
      O(    ;
      U     M 0.0;
      FN    M 1.1;
      )     ;
      SPBN  same;
      CALL SFC 17 (SIG := M 0.0, ID := W#16#EEEE, EV_ID := DW#16#60000001, SD := P#M 10.0 WORD 2, RET_VAL := MW 30);
same: CALL SFB 33, DB 33 (EN_R := TRUE, SIG := M 0.1, ID := W#16#EEEE, EV_ID := DW#16#60000002, SEVERITY := W#16#40);
";
const TEXTS: &str = "number;text;info;class;priority\n\
                     16#60000001;Pump @1W%d@: @2I%4d@ bar;Close valve V3;fault;9\n\
                     16#60000002;\"Tank; empty\";;warning;1\n";

#[test]
fn alarms_are_shown_with_their_texts_and_acknowledged() {
    let site = Site::new();
    let (page, figures) = (free_port(), free_port());
    site.write("plant.awl", &counting("DATA_BLOCK DB 33 SFB 33\nBEGIN\nEND_DATA_BLOCK\n", REST));
    site.write("alarms.csv", TEXTS);
    add_user(&site, "a.users", "olga", "write", "olga-password");
    let link = |kind: &str, port, rights: &str| {
        format!("\n[[link]]\ntype = \"{kind}\"\nname = \"{kind}\"\nlisten = \"127.0.0.1:{port}\"\n{rights}")
    };
    site.write(
        "station.toml",
        &format!(
            "[station]\nname = \"alarm-texts\"\n\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\n\n[program]\n\
             sources = [\"plant.awl\"]\nalarms = \"alarms.csv\"\n{}{}",
            link("web", page, "rights = \"write\"\nusers = \"a.users\"\n"),
            link("metrics", figures, "")
        ),
    );
    let station = site.run("station.toml").until_run();
    station.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    let alarms = || site.ob1(&["alarms", "alarm-texts"]).fine();
    assert_eq!(alarms(), "no alarm is active or waits for its acknowledgement\n");
    station.set("MW 10", 3);
    station.set("MW 12", -7);
    station.set("M 0.0", 1);
    station.set("M 0.1", 1);
    // The station itself is the display: no panel is there.
    let both = station
        .until("both alarms", |_| Some(alarms()).filter(|told| told.contains("Tank; empty") && told.contains("Pump")));
    assert_eq!(station.cell("MW 30"), 0, "sent");
    let lines: Vec<&str> = both.lines().collect();
    assert!(lines[0].starts_with("active, open") && lines[0].contains("Pump 3:   -7 bar"), "{both}");
    assert!(lines[0].contains("DW#16#60000001.1  fault") && lines[1].trim() == "Close valve V3", "{both}");
    assert!(lines[2].contains("DW#16#60000002.1  warning  Tank; empty"), "{both}");
    let told: Value = serde_json::from_str(&site.ob1(&["alarms", "alarm-texts", "--json"]).fine()).expect("JSON");
    assert_eq!((&told[0]["number"], &told[1]["priority"]), (&json!(0x6000_0001), &json!(1)), "{told}");

    // The page and the figures tell the same.
    let olga = Visitor::as_user(page, "olga", "olga-password");
    assert_eq!(olga.get("/api/alarms").json(), told);
    assert_eq!(Visitor::at(page).get("/api/alarms").status, 401);
    let count =
        |what: &str| station.until(what, |_| Visitor::at(figures).get("/metrics").body.contains(what).then_some(()));
    count("\nob1_alarms_active 2\n");
    count("\nob1_alarms_unacknowledged 2\n");

    // Acknowledged over the page, then by the tool; what has gone disappears.
    let answer = olga.post("/api/acknowledge", &json!({ "numbers": [0x6000_0001] }));
    assert_eq!((answer.status, answer.json()), (200, json!({ "acknowledged": 1 })));
    let audit = std::fs::read_to_string(site.path("alarm-texts.audit")).expect("the audit log");
    assert!(
        audit.lines().any(|line| line.contains("olga") && line.contains("acknowledge alarm DW#16#60000001")),
        "{audit}"
    );
    station.until("the first is acknowledged", |_| alarms().starts_with("active  ").then_some(()));
    station.set("M 0.0", 0);
    station.until("the first has gone", |_| (!alarms().contains("Pump")).then_some(()));
    station.set("M 0.1", 0);
    station.until("the second has gone", |_| alarms().starts_with("gone, open").then_some(()));
    assert_eq!(site.ob1(&["alarms", "alarm-texts", "ack", "16#60000002"]).fine(), "1 acknowledged\n");
    station.until("nothing is left", |_| alarms().starts_with("no alarm").then_some(()));
    let refused = site.ob1(&["alarms", "alarm-texts", "ack", "99"]);
    assert!(refused.err.contains("there is no alarm DW#16#00000063"), "{}", refused.err);
    assert_eq!(olga.post("/api/acknowledge", &json!({ "numbers": [] })).status, 400);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// `examples/alarms`: its panel shows what comes, is acknowledged and goes, and acknowledges.
#[test]
fn the_panel_of_the_example_shows_and_acknowledges() {
    let site = Site::new();
    for entry in std::fs::read_dir(checkout("examples/alarms")).expect("the example") {
        let file = entry.expect("a file").path();
        std::fs::copy(&file, site.path(file.file_name().expect("a name"))).expect("room for a copy");
    }
    let (panel, page) = (free_port().to_string(), free_port().to_string());
    let text = std::fs::read_to_string(site.path("station.toml")).expect("a station");
    assert!(text.contains(":10102") && text.contains(":8080"));
    site.write("station.toml", &text.replace(":10102", &format!(":{panel}")).replace(":8080", &format!(":{page}")));
    let station = site.run("station.toml").until_run();
    let shown = std::fs::File::create(site.path("shown")).expect("room for a file");
    let mut display = site
        .command(python())
        .arg(site.path("panel.py"))
        .env("PORT", &panel)
        .stdout(shown)
        .spawn()
        .expect("Python is there");
    let told = || std::fs::read_to_string(site.path("shown")).expect("a file");
    let until = |part: &str| station.until(part, |_| told().contains(part).then_some(()));
    until("logged on");
    station.set("MW 20", 73);
    station.set("M 10.0", 1);
    until("16#60000001 came: Pump: pressure 73 x 0.1 bar");
    let ack =
        site.command(python()).arg(site.path("panel.py")).args(["ack", "16#60000001"]).env("PORT", &panel).output();
    assert_eq!(String::from_utf8_lossy(&ack.expect("Python is there").stdout), "acknowledged\n");
    until("16#60000001 acknowledged");
    station.set("M 10.0", 0);
    until("16#60000001 is over: Pump: pressure 73 x 0.1 bar");
    station.set("M 10.2", 1);
    until("16#60000002 came: Tank 2 is empty");
    assert!(!told().contains("Tank 1"), "{}", told());

    // The page: a bell, and what stands, with the time since.
    let browser = Browser::open(900);
    browser.go(&format!("http://127.0.0.1:{page}/"));
    browser.until("document.querySelector('#bell:not([hidden]).open')?.innerText.includes('1')");
    browser.click("#bell");
    browser.until(
        "location.hash === '#alarms' && document.querySelector('.alarms')?.innerText.includes('Tank 2 is empty')",
    );
    assert!(browser.text(".alarms").contains("DW#16#60000002.2"), "{}", browser.text(".alarms"));
    assert_eq!(browser.run("return document.querySelectorAll('.alarms button').length"), 0, "it may only look");
    browser.keep(&site, "web-alarms");
    turn_to(&browser, "de", "alarms");
    browser.until("document.querySelector('.alarms').innerText.includes('offen')");
    station.set("M 10.2", 0);
    let ack = ["alarms", "alarms", "ack", "all"];
    assert_eq!(site.ob1(&ack).fine(), "1 acknowledged\n");
    browser.until("document.querySelector('#bell').hidden && !document.querySelector('.alarms table')");
    let _ = display.kill();
    let _ = display.wait();
    assert_eq!(station.interrupt().code(), Some(0));
}

/// Without the right nobody acknowledges.
#[test]
fn a_page_that_may_only_read_does_not_acknowledge() {
    let site = Site::new();
    let page = free_port();
    site.write("plant.awl", &counting("", ""));
    site.write(
        "station.toml",
        &format!(
            "[station]\nname = \"alarm-rights\"\n\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\n\n[program]\n\
             sources = [\"plant.awl\"]\n\n[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:{page}\"\n"
        ),
    );
    let station = site.run("station.toml").until_run();
    station.until("the page is served", |_| Visitor::at(page).try_get("/api/session"));
    let visitor = Visitor::at(page);
    assert_eq!(visitor.get("/api/alarms").json(), json!([]));
    assert_eq!(visitor.post("/api/acknowledge", &json!({ "numbers": [1] })).status, 403);
    assert_eq!(station.interrupt().code(), Some(0));
}
