//! The page of a station in a real browser.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use ob1_tests::siege::rounds;
use rustix::process::Signal;
use serde_json::Value;

use crate::common;
use crate::common::browser::{Browser, Key};
use crate::common::gate::{Visitor, add_user, gate, station};
use crate::common::site::Site;

pub(crate) const PAGES: [&str; 8] =
    ["station", "alarms", "io", "program", "variables", "diagnostics", "scan", "telegrams"];
/// Wide and narrow.
const WIDTHS: [u32; 2] = [320, 1200];
/// All widths that a page must fit.
const ALL_WIDTHS: [u32; 4] = [320, 375, 768, 1280];
/// Streams that one address may have.
const STREAMS: usize = 16;
/// Maximum size of a page including all its requests, in bytes.
const WEIGHT: u64 = 250_000;

/// Selects the language and the page.
pub(crate) fn turn_to(browser: &Browser, language: &str, page: &str) {
    if browser.run("return document.documentElement.lang") != language {
        browser.click("#language");
    }
    browser.until(&format!("document.documentElement.lang === '{language}'"));
    // On a phone the pages are behind a button.
    if browser.run("return document.querySelector('#menu').checkVisibility()") == true {
        browser.click("#menu");
    }
    browser.click(&format!("nav a[href='#{page}']"));
    let there = "document.querySelector('main').innerText.length > 20";
    browser.until(&format!("location.hash === '#{page}' && {there}"));
}

/// Every page, in both languages, narrow and wide: it has content, nothing exceeds the width, there are no error
/// messages, requests go only to the station, and its size is within the limit.
#[test]
fn every_page_is_there() {
    let site = Site::new();
    let (_station, port, _) = station(&site, "browser-pages", "");
    for width in ALL_WIDTHS {
        let browser = Browser::open(width);
        browser.go(&format!("http://127.0.0.1:{port}/"));
        browser.until("document.querySelector('#mode').innerText === 'RUN'");
        let (mut hosts, weight) = browser.traffic();
        assert!((1..=WEIGHT).contains(&weight), "{weight} bytes");
        for (scheme, language) in [("light", "en"), ("dark", "de")] {
            browser.scheme(scheme);
            for page in PAGES {
                turn_to(&browser, language, page);
                assert_eq!(
                    browser.run("return document.documentElement.scrollWidth <= innerWidth"),
                    true,
                    "{page} {width}"
                );
            }
        }
        hosts.extend(browser.traffic().0);
        let own = format!("127.0.0.1:{port}");
        assert!(hosts.len() > 5 && hosts.iter().all(|host| *host == own), "asked elsewhere: {hosts:?}");
        assert_eq!(browser.complaints(), Vec::<String>::new());
    }
    let words = Browser::open(1200);
    words.go(&format!("http://127.0.0.1:{port}/"));
    // Each word is there twice; where both are the same, it is a name or a form.
    let one_sided = "return import('/words.js').then((m) => Object.entries(m.all()).filter(([, texts]) =>
        texts.length !== 2 || texts.some((text) => text.trim() === '')).map(([key]) => key))";
    assert_eq!(words.run(one_sided), serde_json::json!([]));
}

/// axe-core finds no serious violation on any page, light and dark, in English and German, also in STOP and in a
/// dialog.
#[test]
fn nothing_bars_anybodys_way() {
    let site = Site::new();
    add_user(&site, "a.users", "anna", "operate", "anna-password");
    let (station, port, _) = station(&site, "browser-axe", "rights = \"operate\"\nusers = \"a.users\"");
    let judge = |browser: &Browser, place: &str| {
        let found = browser.barriers();
        assert!(found.is_empty(), "{place}: {found:#?}");
    };
    for (width, schemes, languages) in [(1200, &["light", "dark"][..], &["en", "de"][..]), (320, &["light"], &["en"])] {
        let browser = Browser::open(width);
        browser.go(&format!("http://127.0.0.1:{port}/"));
        browser.until("document.querySelector('form.login')?.innerText.includes('Log in to this station')");
        judge(&browser, "before one is logged in");
        log_in(&browser, "anna");
        for (scheme, language) in schemes.iter().flat_map(|scheme| languages.iter().map(move |word| (scheme, word))) {
            browser.scheme(scheme);
            for page in PAGES {
                turn_to(&browser, language, page);
                if page == "variables" {
                    watch(&browser);
                }
                judge(&browser, &format!("{page} {width} {scheme} {language}"));
            }
        }
        turn_to(&browser, "en", "station");
        browser.click("main button.danger");
        judge(&browser, "a question");
        browser.press(&[Key::Escape]);
    }
    let browser = Browser::open(320);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    // A violation is found.
    browser.run("document.body.append(document.createElement('button'))");
    assert!(browser.barriers().iter().any(|found| found.starts_with("button-name")));
    browser.run("document.body.lastElementChild.remove()");
    log_in(&browser, "anna");
    station.set("M 9.0", 1);
    browser.until("document.querySelector('.card.stop')?.innerText.includes('Remedy')");
    for scheme in ["light", "dark"] {
        browser.scheme(scheme);
        judge(&browser, scheme);
    }
    station.set("M 9.0", 0);
}

/// Without a mouse: the tabulator key reaches all controls, the focus is visible, and the controls work.
#[test]
fn the_keyboard_is_enough() {
    /// All controls, with the name that a user would give them.
    const ALL: &str = "const name = (of) => `${of.tagName} ${of.id} ${of.getAttribute('aria-label') ?? of.getAttribute('href') ?? of.innerText.slice(0, 40)}`;
        const all = [...document.querySelectorAll('a[href], button:not(:disabled), input, select, textarea, [tabindex=\"0\"]')]
            .filter((of) => of.checkVisibility());";
    let site = Site::new();
    let (_station, port, _) = station(&site, "browser-keys", "");
    let browser = Browser::open(1200);
    for page in PAGES {
        browser.go("about:blank");
        browser.go(&format!("http://127.0.0.1:{port}/#{page}"));
        browser.until("document.querySelector('main').innerText.length > 20 && document.querySelector('#mode').innerText === 'RUN'");
        let mut walked = Vec::new();
        for _ in 0..300 {
            browser.press(&[Key::Tab]);
            let at = browser.run(&format!(
                "{ALL} const at = document.activeElement; const style = getComputedStyle(at);
                 return [name(at), at === document.body || style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) > 0];"
            ));
            let name = at[0].as_str().unwrap_or_default().to_owned();
            assert_eq!(at[1], true, "{page}: nobody sees that one is at {name}");
            if name.starts_with("BODY") {
                break;
            }
            walked.push(name);
        }
        let wanted = browser.run(&format!("{ALL} return all.map(name)"));
        for wanted in wanted.as_array().expect("a list").iter().filter_map(Value::as_str) {
            assert!(walked.iter().any(|name| name == wanted), "{page}: no way to {wanted}: {walked:#?}");
        }
        assert!(walked.len() > 8 && walked[0].contains("#main"), "{page}: {walked:?}");
    }
    // The focused control can be used.
    browser.run("document.querySelector(\"nav a[href='#variables']\").focus()");
    browser.press(&[Key::Enter]);
    // A page that is turned to takes the focus.
    browser.until("location.hash === '#variables' && document.activeElement.id === 'main'");
    browser.run("document.querySelector('#language').focus()");
    browser.press(&[Key::Enter]);
    browser.until("document.documentElement.lang === 'de'");
    browser.run("document.querySelector('#table-save').focus()");
    browser.press(&[Key::Enter]);
    browser.until("document.querySelector('dialog[open]')?.contains(document.activeElement)");
    browser.press(&[Key::Escape]);
    browser.until("!document.querySelector('dialog[open]') && document.activeElement.id === 'table-save'");
}

fn log_in(browser: &Browser, user: &str) {
    browser.fill("#field-user", user);
    browser.fill("#field-password", &format!("{user}-password"));
    browser.click("form.login button[type=submit]");
    browser.until(&format!("document.querySelector('#account').innerText.includes('{user}')"));
}

/// The table of two variables of the example.
fn watch(browser: &Browser) {
    if browser.run("return location.hash") != "#variables" {
        let language = browser.run("return document.documentElement.lang");
        turn_to(browser, language.as_str().unwrap_or_default(), "variables");
    }
    browser.fill("#names", "MW 20\nDB10.recipe");
    browser.click("#table-watch");
    browser.until("document.querySelectorAll('#values td.value').length === 2");
    browser.until("document.querySelectorAll('#values td.value')[1].innerText === \"'lemonade'\"");
}

/// The machine stops while a technician watches: the front page shows state, cause, place and remedy as text.
#[test]
fn a_technician_sees_why_the_machine_stands() {
    let site = Site::new();
    let (station, port, _) = station(&site, "browser-stop", "");
    let browser = Browser::open(320);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('.card.run')");
    station.set("M 9.0", 1);
    browser.until("document.querySelector('.card.stop')?.innerText.includes('Remedy')");
    let card = browser.text(".card");
    for part in ["The station is in STOP.", "data block not loaded", "Place: plant.awl:", "Remedy: Load the data block"]
    {
        assert!(card.contains(part), "{part}: {card}");
    }
    assert_eq!(browser.text("#mode"), "STOP");
    let seen = browser.run("return document.querySelector('.card').getBoundingClientRect().bottom <= innerHeight");
    assert_eq!(seen, true, "without scrolling, on a phone");
    station.set("M 9.0", 0);
}

/// Reading, writing and operating, each within the rights of the user.
#[test]
fn variables_and_operating_state_are_changed_with_right_only() {
    let site = Site::new();
    add_user(&site, "a.users", "anna", "operate", "anna-password");
    add_user(&site, "a.users", "rita", "read", "rita-password");
    let (station, port, _) = station(&site, "browser-rights", "rights = \"operate\"\nusers = \"a.users\"");
    let browser = Browser::open(1200);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('form.login')?.innerText.includes('Log in to this station')");
    log_in(&browser, "rita");
    watch(&browser);
    assert_eq!(browser.run("return document.querySelector('#values tbody button:not(.plain)').disabled"), true);
    browser.click("nav a[href='#station']");
    browser.until("document.querySelector('button.danger')?.disabled");
    browser.click("#account");
    // The form stands on the page, and keeps what was typed.
    browser.fill("#field-user", "anna");
    browser.fill("#field-password", "wrong");
    browser.click("form.login button[type=submit]");
    browser.until("document.querySelector('#login-error').innerText !== ''");
    assert_eq!(browser.run("return document.querySelector('#field-user').value"), "anna");

    log_in(&browser, "anna");
    watch(&browser);
    browser.click("#values tbody button:not(.plain)");
    browser.until("document.querySelector('dialog').innerText.includes('Present value')");
    // What does not fit is told at the field, and stays there.
    browser.fill("#field-value", "many");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('#dialog-error')?.innerText !== ''");
    assert_eq!(browser.run("return document.querySelector('#field-value').value"), "many");
    browser.fill("#field-value", "16#1F");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('#values td.value').innerText === '31'");
    assert_eq!(station.cell("MW 20"), 31);
    browser.click("nav a[href='#station']");
    browser.click("main button.danger");
    browser.until("document.querySelector('dialog[open]')?.innerText.includes('all outputs are switched off')");
    browser.click("dialog button[type=button]");
    assert_eq!(station.status().state, "RUN", "cancelled");
    browser.click("main button.danger");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('.card.stop')");
    assert_eq!(station.status().state, "STOP");
}

/// The gate is killed: the page shows that it has no connection, and continues automatically afterwards.
#[test]
fn the_page_comes_back_with_the_gate() {
    let site = Site::new();
    let (station, port, _) = station(&site, "browser-killed", "");
    let browser = Browser::open(1200);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('.card.run')");
    // Recorded, so that it is seen even if the connection returns at once.
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

/// All streams of this address are in use: the page retries, and text typed meanwhile is kept.
#[test]
fn what_is_typed_stays_while_a_stream_is_refused() {
    let site = Site::new();
    let (_station, port, _) = station(&site, "browser-refused", "");
    let request = format!("GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n");
    let taken: Vec<TcpStream> = (0..STREAMS)
        .map(|_| {
            let mut stream = TcpStream::connect(("127.0.0.1", port)).expect("the page is served");
            stream.write_all(request.as_bytes()).expect("it listens");
            assert!(stream.read(&mut [0; 64]).expect("an answer") > 0);
            stream
        })
        .collect();
    let browser = Browser::open(1200);
    browser.go(&format!("http://127.0.0.1:{port}/#variables"));
    browser.fill("#names", "MW 20");
    let asked = "performance.getEntriesByType('resource').filter((one) => one.name.endsWith('/api/session')).length";
    browser.until(&format!("{asked} > 2"));
    assert_eq!(browser.run("return document.querySelector('#names').value"), "MW 20");
    drop(taken);
    browser.click("#table-watch");
    browser.until("document.querySelectorAll('#values td.value').length === 1");
}

/// The station keeps tables under a name, for every browser; comments, completion and trends are there; they can be
/// loaded by another browser, and deleted.
#[test]
fn tables_of_variables_are_kept() {
    let site = Site::new();
    let (_station, port, _) = station(&site, "browser-tables", "");
    let browser = Browser::open(1200);
    let page = format!("http://127.0.0.1:{port}/#variables");
    browser.go(&page);
    watch(&browser);
    browser.click("#table-save");
    browser.fill("#field-name", "recipe");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('#tables').value === 'recipe'");
    // A name is completed from the components of its data block; a comment stands beside it, and a curve.
    browser.fill("#names", "MW 22 // speed");
    browser.click("#table-watch");
    browser.until("document.querySelector('#values td.comment')?.innerText === 'speed'");
    browser.until("document.querySelector('#values svg.spark path')");
    browser.click("#values button.plain");
    browser.until("document.querySelector('#trends .legend')?.innerText.includes('MW 22: ')");
    browser.fill("#add-name", "DB10.rec");
    browser.until("[...document.querySelectorAll('#offered option')].some((one) => one.value === 'DB10.recipe')");
    browser.fill("#add-name", "DB10.recipe");
    browser.click("#table-add");
    browser.until("document.querySelectorAll('#values td.value').length === 2");
    browser.fill("#names", "MW 22");
    browser.click("#table-watch");
    browser.until("document.querySelectorAll('#values td.value').length === 1");
    let other = Browser::open(375);
    other.go(&page);
    other.until("document.querySelector('#tables')?.value === 'recipe'");
    other.click("#table-load");
    other.until("document.querySelector('#names').value === 'MW 20\\nDB10.recipe'");
    drop(other);
    // After leaving and reopening the page, the table and the last names are still there.
    browser.go("about:blank");
    browser.go(&page);
    browser.until("document.querySelector('#names')?.value === 'MW 22'");
    browser.until("document.querySelectorAll('#values td.value').length === 1");
    browser.click("#table-load");
    browser.until("document.querySelector('#names').value === 'MW 20\\nDB10.recipe'");
    browser.until("document.querySelectorAll('#values td.value')[1]?.innerText === \"'lemonade'\"");
    // A format is selected in the row.
    browser.run(
        "const form = document.querySelector('#values select'); form.value = ':hex'; form.dispatchEvent(new Event('change'))",
    );
    browser.until("document.querySelector('#values td.value')?.innerText === '16#0000'");
    browser.click("#table-remove");
    browser.click("dialog button[type=submit]");
    browser.until("document.querySelector('#tables').value === ''");
    browser.go("about:blank");
    browser.go(&page);
    browser.until("document.querySelector('#tables')?.innerText.includes('no saved table')");
}

/// A driver is killed while the page is shown: the front page shows this for its CP and then its return; the telegrams
/// on its line are shown with their meaning.
#[test]
fn a_driver_that_is_killed_is_seen_to_come_back() {
    let site = Site::two_stations_on_a_cable();
    let port = common::s7::free_port();
    let text = std::fs::read_to_string(site.path("station-a.toml")).expect("a station");
    let link = format!("\n[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:{port}\"\n");
    site.write("station-a.toml", &(text + &link));
    let a = site.run("station-a.toml").until_run();
    let _b = site.run("station-b.toml").until_run();
    a.until("the page is served", |_| Visitor::at(port).try_get("/api/session"));
    let browser = Browser::open(1200);
    browser.go(&format!("http://127.0.0.1:{port}/#telegrams"));
    browser.until("document.querySelector('#telegrams')?.innerText.includes('STX: connection request')");
    browser.until("/block, [0-9]+ bytes, BCC/.test(document.querySelector('#telegrams').innerText)");
    browser.keep(&site, "web-telegrams");
    browser.click("nav a[href='#station']");
    browser.until("document.querySelectorAll('.rack .module').length === 2");
    browser.keep(&site, "web-station");
    // The number of restarts is shown, even if it returns at once.
    let told = "document.querySelectorAll('.rack .module')[1].innerText";
    assert_eq!(browser.run(&format!("return {told}.includes('restarted')")), false);
    a.driver_process().signal(Signal::KILL);
    browser.until(&format!("{told}.includes('1 × restarted')"));
    browser.until(&format!("{told}.includes('driver: ready') && {told}.includes('answers')"));
    assert_eq!(a.status().state, "RUN");
}

/// Reports of soak runs: the verdict, and each budget with the measured value.
#[test]
fn soak_reports_are_shown() {
    let site = Site::new();
    let folder = site.path("soak");
    std::fs::create_dir(&folder).expect("room for a folder");
    let (station, port, _) = station(&site, "browser-soak", "reports = \"soak\"\n");
    assert_eq!(station.interrupt().code(), Some(0));
    let soak = ["soak", "station.toml", "--for", "1s", "--warm-up", "0ms", "--budget", "late=100000000", "--report"];
    let said = site.ob1(&[&soak[..], &["soak/first"]].concat());
    assert!(folder.join("first.json").is_file(), "{said:?}");
    let station = site.run("station.toml").until_run();
    station.until("the page is served", |_| Visitor::at(port).try_get("/api/session"));
    std::fs::write(folder.join("broken.json"), "{").expect("room for a file");
    let browser = Browser::open(320);
    browser.go(&format!("http://127.0.0.1:{port}/#reports"));
    browser.until("document.querySelectorAll('main li button').length === 2");
    browser.click("main li:nth-child(1) button");
    browser.until("document.querySelector('#report')?.innerText.includes('stays in RUN')");
    let shown = browser.text("#report");
    assert!(shown.contains("browser-soak") && shown.contains("Verdict"), "{shown}");
    assert!(shown.contains("Execution") && shown.contains("From cycle to cycle"), "its histograms\n{shown}");
    assert_eq!(browser.run("return document.documentElement.scrollWidth <= innerWidth"), true);
    browser.run("document.querySelector('#report').scrollIntoView()");
    browser.keep(&site, "web-reports");
    browser.run("scrollTo(0, 0)");
    browser.click("main li:nth-child(2) button");
    browser.until("document.querySelector('#said').innerText !== ''");
}

/// Repeats the actions of a user on the page, each time with a new browser. A campaign has 50 rounds.
#[test]
fn browsers() {
    let site = Site::new();
    let (station, port, _) = station(&site, "browser-again", "");
    for round in 0..rounds(1) {
        let browser = Browser::open(WIDTHS[round as usize % 2]);
        browser.go(&format!("http://127.0.0.1:{port}/"));
        browser.until("document.querySelector('.card.run')");
        for page in PAGES {
            turn_to(&browser, ["en", "de"][round as usize / 2 % 2], page);
        }
        watch(&browser);
        station.set("MW 20", 4711);
        browser.until("document.querySelector('#values td.value').innerText === '4711'");
        station.set("MW 20", 0);
        if round % 5 == 4 {
            gate(&station).1.signal(Signal::KILL);
        }
        browser.until("document.querySelector('#values td.value').innerText === '0'");
        assert_eq!(station.status().state, "RUN");
        println!("round {round}: fine");
    }
}

/// An answer that comes when the visitor has already turned to another page does not paint over that page.
#[test]
fn a_late_answer_leaves_the_next_page_alone() {
    let site = Site::new();
    let (_station, port, _) = station(&site, "filling", "");
    let browser = Browser::open(900);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.until("document.querySelector('.card.run')");
    browser.run(
        "const real = window.fetch; window.asked = 0; window.told = 0;
         window.fetch = async (...words) => {
             const answer = await real(...words);
             if (!String(words[0]).includes('timing')) return answer;
             window.asked += 1;
             await new Promise((go) => { window.release = go; });
             setTimeout(() => { window.told += 1; }, 100);
             return answer;
         };",
    );
    browser.click("nav a[href='#scan']");
    browser.until("window.asked === 1");
    browser.click("nav a[href='#variables']");
    browser.until("document.querySelector('#names')");
    browser.run("window.release()");
    browser.until("window.told === 1");
    assert_eq!(browser.run("return Boolean(document.querySelector('#names'))"), true, "{}", browser.text("main"));
}

/// Screenshots of the pages for the book: written to the folder in OB1_PICTURES.
#[test]
fn pictures() {
    let site = Site::new();
    let (station, port, _) = station(&site, "filling", "");
    let keep = |browser: &Browser, name: &str| browser.keep(&site, name);
    let wide = Browser::open(900);
    wide.go(&format!("http://127.0.0.1:{port}/"));
    wide.until("document.querySelector('.card.run')");
    turn_to(&wide, "en", "scan");
    wide.until("document.querySelectorAll('.fill').length > 3");
    keep(&wide, "web-scan");
    turn_to(&wide, "en", "diagnostics");
    wide.until("document.querySelectorAll('ol.buffer li').length > 1");
    keep(&wide, "web-diagnostics");
    let phone = Browser::open(360);
    phone.go(&format!("http://127.0.0.1:{port}/"));
    phone.until("document.querySelector('.card.run')");
    station.set("M 9.0", 1);
    phone.until("document.querySelector('.card.stop')?.innerText.includes('Remedy')");
    keep(&phone, "web-stop");
    phone.scheme("dark");
    keep(&phone, "web-stop-dark");
    station.set("M 9.0", 0);
}
