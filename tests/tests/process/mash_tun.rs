//! `examples/mash-tun`: the machine runs as its README says, behind the coupler that its plant plays.

use std::fs;

use serde_json::{Value, json};

use super::browser::turn_to;
use crate::common::browser::Browser;
use crate::common::gate::Visitor;
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::{checkout, python};

/// The plant; it ends with the test.
struct Plant {
    process: std::process::Child,
    page: u16,
}

impl Plant {
    fn start(site: &Site, coupler: u16) -> Self {
        let page = free_port();
        let ports = [coupler.to_string(), page.to_string()];
        let process = site.command(python()).arg(site.path("plant.py")).args(ports).spawn().expect("Python is there");
        Self { process, page }
    }

    fn hand(&self, name: &str, on: bool) {
        let answer = Visitor::at(self.page).post("/hand", &json!([name, on]));
        assert_eq!(answer.status, 200);
    }

    fn now(&self) -> Option<Value> {
        Some(Visitor::at(self.page).try_get("/now")?.json())
    }

    /// Presses a push button until the station shows that it has seen it.
    fn press(&self, name: &str, station: &Running, seen: &str, value: i64) {
        self.hand(name, true);
        station.until(seen, |station| (station.cell(seen) == value).then_some(()));
        self.hand(name, false);
    }
}

impl Drop for Plant {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The machine with ports of its own, filling.
fn filling(site: &Site) -> (Running, Plant, u16) {
    for entry in fs::read_dir(checkout("examples/mash-tun")).expect("the example") {
        let file = entry.expect("a file").path();
        fs::copy(&file, site.path(file.file_name().expect("a name"))).expect("room for a copy");
    }
    let [coupler, page, panel] = [free_port(), free_port(), free_port()];
    let mut text = fs::read_to_string(site.path("station.toml")).expect("a station");
    for (from, to) in [(":1503", coupler), (":8080", page), (":1102", panel)] {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, &format!(":{to}"));
    }
    site.write("station.toml", &text);
    let plant = Plant::start(site, coupler);
    let station = site.run("station.toml").until_run();
    station.until("the coupler", |station| (station.cell("E 0.4") == 1).then_some(()));
    plant.press("quit", &station, "A 4.4", 0);
    plant.press("start", &station, "DB11.SCHRITT", 1);
    station.until("the tun fills", |_| (plant.now()?["level"].as_f64()? > 20.0).then_some(()));
    (station, plant, page)
}

#[test]
fn the_mash_tun_brews_and_tells_which_contact() {
    let site = Site::new();
    let (station, plant, page) = filling(&site);

    // The pump stands: which contact?
    station.set("DB11.SCHRITT", 5);
    station.until("it pumps", |station| (station.cell("A 4.2") == 1).then_some(()));
    plant.hand("pumpe", true);
    station.until("the pump stands", |station| (station.cell("A 4.2") == 0).then_some(()));
    let why = site.ob1(&["why", "mash-tun", "A 4.2"]).fine();
    assert!(why.contains("0 E 0.4 \"Motorschutz_Pumpe\""), "{why}");
    assert!(why.contains("DB12.DBX 0.1 is 1"), "what holds the alarm\n{why}");
    let drawn = site.ob1(&["status", "station.toml", "FC 10", "--network", "1", "--lad", "--once"]).fine();
    assert!(drawn.contains("Motorschutz_Pumpe") && drawn.contains("A 4.2"), "{drawn}");
    let io = Visitor::at(page).get("/api/io").body;
    assert!(io.contains("Überfüllsicherung hat angesprochen") && io.contains("\"A 4.2\""), "{io}");
    plant.hand("pumpe", false);
    plant.press("quit", &station, "A 4.2", 1);

    // The coupler goes: the CPU stays in RUN, the alarm stands.
    drop(plant);
    station.until("the alarm", |station| (station.cell("DB12.KOPPLER") == 1).then_some(()));
    assert_eq!((station.status().state.as_str(), station.cell("A 4.2")), ("RUN", 0));
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A table of its values with comments and trends, as the book shows it.
#[test]
fn pictures_of_the_machine() {
    let site = Site::new();
    let (station, plant, page) = filling(&site);
    let browser = Browser::open(900);
    browser.go(&format!("http://127.0.0.1:{page}/"));
    turn_to(&browser, "de", "variables");
    browser.fill("#names", "DB13.FUELLSTAND // Liter\nDB13.TEMPERATUR\nAW 16\nA 4.0\nDB10.SORTE");
    browser.click("#table-watch");
    browser.until("document.querySelectorAll('#values svg.spark').length === 4");
    browser.click("#values tr:nth-child(1) button.plain");
    browser.click("#values tr:nth-child(4) button.plain");
    station.until("it heats", |station| (station.cell("DB11.SCHRITT") == 2).then_some(()));
    browser.until("document.querySelectorAll('#trends .legend li').length === 2");
    browser.until("document.querySelectorAll('#values td.comment')[2].innerText.startsWith('Stellgröße')");
    browser.keep(&site, "web-variables");
    drop(plant);
    assert_eq!(station.interrupt().code(), Some(0));
}
