//! The page of a station as a person sees it, in a browser nobody here wrote.

mod common;

use common::browser::Browser;
use common::gate::{add_user, gate, station};
use common::site::Site;
use rustix::process::Signal;
use serde_json::json;

const PAGES: [&str; 7] = ["station", "scan", "diagnostics", "variables", "program", "telegrams", "reports"];
/// Wide and narrow.
const WIDTHS: [u32; 2] = [320, 1200];

/// Every page, in both languages, narrow and wide: it says something, nothing sticks out, nothing is complained of, and
/// nobody but the station is asked.
#[test]
fn every_page_is_there() {
    let site = Site::new();
    let (_station, port, _) = station(&site, "browser-pages", "");
    for width in WIDTHS {
        let browser = Browser::open(width);
        browser.go(&format!("http://127.0.0.1:{port}/"));
        browser.until("document.querySelector('#mode').innerText === 'RUN'");
        for language in ["en", "de"] {
            if browser.run("return document.documentElement.lang") != language {
                browser.click("#language");
            }
            browser.until(&format!("document.documentElement.lang === '{language}'"));
            for page in PAGES {
                browser.click(&format!("nav a[href='#{page}']"));
                let there = "document.querySelector('main').innerText.length > 20";
                browser.until(&format!("location.hash === '#{page}' && {there}"));
                assert_eq!(
                    browser.run("return document.documentElement.scrollWidth <= innerWidth"),
                    true,
                    "{page} {width}"
                );
            }
        }
        let far = browser.run(
            "return performance.getEntriesByType('resource').map((e) => new URL(e.name).host).filter((h) => h !== location.host)",
        );
        assert_eq!(far, json!([]), "asked elsewhere");
        assert_eq!(browser.complaints(), Vec::<String>::new());
    }
    let words = Browser::open(1200);
    words.go(&format!("http://127.0.0.1:{port}/"));
    let both = words.run("return import('/words.js').then((m) => m.keys().map((all) => all.sort().join()))");
    assert_eq!(both[0], both[1], "each word in both languages");
}

/// The machine stops while a technician looks: state, cause, place and remedy stand on the front page, in words.
#[test]
fn a_technician_sees_why_the_machine_stands() {
    let site = Site::new();
    let (station, port, _) = station(&site, "browser-stop", "");
    let browser = Browser::open(320);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('.card.run')");
    station.set("M 9.0", 1);
    browser.until("document.querySelector('.card.stop')?.innerText.includes('What helps')");
    let card = browser.text(".card");
    for part in
        ["The station is in STOP.", "data block not loaded", "Place: plant.awl:", "What helps: Load the data block"]
    {
        assert!(card.contains(part), "{part}: {card}");
    }
    assert_eq!(browser.text("#mode"), "STOP");
    let seen = browser.run("return document.querySelector('.card').getBoundingClientRect().bottom <= innerHeight");
    assert_eq!(seen, true, "without scrolling, on a phone");
    station.set("M 9.0", 0);
}

/// Looking, writing and operating, each as far as the user's right goes.
#[test]
fn variables_and_operating_state_are_changed_with_right_only() {
    let site = Site::new();
    add_user(&site, "a.users", "anna", "operate", "anna-password");
    add_user(&site, "a.users", "rita", "read", "rita-password");
    let (station, port, _) = station(&site, "browser-rights", "rights = \"operate\"\nusers = \"a.users\"");
    let browser = Browser::open(1200);
    let log_in = |user: &str| {
        browser.click("#account");
        browser.fill("#field-user", user);
        browser.fill("#field-password", &format!("{user}-password"));
        browser.click("dialog button[type=submit]");
        browser.until(&format!("document.querySelector('#account').innerText.includes('{user}')"));
    };
    let watch = || {
        browser.click("nav a[href='#variables']");
        browser.fill("#names", "MW 20\nDB10.recipe");
        browser.click("#table-watch");
        browser.until("document.querySelectorAll('#values td.value').length === 2");
        browser.until("document.querySelectorAll('#values td.value')[1].innerText === \"'lemonade'\"");
    };
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('main').innerText.includes('who you are')");
    log_in("rita");
    watch();
    assert_eq!(browser.run("return document.querySelector('#values tbody button').disabled"), true);
    browser.click("nav a[href='#station']");
    browser.until("document.querySelector('button.danger')?.disabled");
    browser.click("#account");
    browser.until("document.querySelector('#account').innerText === 'Log in'");

    log_in("anna");
    watch();
    browser.click("#values tbody button");
    browser.fill("#field-value", "16#1F");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('#values td.value').innerText === '31'");
    assert_eq!(station.cell("MW 20"), 31);
    browser.click("nav a[href='#station']");
    browser.click("main button.danger");
    browser.until("document.querySelector('dialog[open]')?.innerText.includes('The machine may move')");
    browser.click("dialog button[type=button]");
    assert_eq!(station.status().state, "RUN", "cancelled");
    browser.click("main button.danger");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('.card.stop')");
    assert_eq!(station.status().state, "STOP");
}

/// The gate is killed: the page says that it has no connection, and goes on by itself when it is back.
#[test]
fn the_page_comes_back_with_the_gate() {
    let site = Site::new();
    let (station, port, _) = station(&site, "browser-killed", "");
    let browser = Browser::open(1200);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('.card.run')");
    // It is seen even if it is back at once.
    browser.run(
        "window.lost = false; new MutationObserver(() => { window.lost ||= document.querySelector('#connection').innerText !== ''; })
         .observe(document.querySelector('#connection'), { childList: true, characterData: true, subtree: true });",
    );
    let (_, process) = gate(&station);
    process.signal(Signal::KILL);
    browser.until("window.lost && document.querySelector('#connection').innerText === ''");
    station.set("M 9.0", 1);
    browser.until("document.querySelector('.card.stop')");
    station.set("M 9.0", 0);
}
