//! The program in a real browser: ladder with power flow, why a bit is off, inputs and outputs, many tabs.

use std::cell::Cell;
use std::collections::BTreeSet;

use rustix::process::Signal;

use super::browser::turn_to;
use crate::common::browser::Browser;
use crate::common::gate::{Visitor, add_user, gate, press};
use crate::common::site::Site;

/// Opens a block.
fn show(browser: &Browser, port: u16, block: &str) {
    browser.go("about:blank");
    browser.go(&format!("http://127.0.0.1:{port}/#program?block={}", block.replace(' ', "%20")));
    browser.until("document.querySelector('.network svg')");
}

/// The class of a part of a drawing: `on`, `off` or neither.
fn state(network: u16, node: &str) -> String {
    format!(
        "[...document.querySelectorAll('[data-network=\"{network}\"] g[data-operand=\"{node}\"]')].map((part) =>
         part.classList.contains('on') ? 'on' : part.classList.contains('off') ? 'off' : '-')[0]"
    )
}

/// A ladder shows which contacts have power, changes with the inputs, and shows what did not run as not run. So does a
/// function plan, and the statements have their registers.
#[test]
fn a_ladder_has_power() {
    let site = Site::new();
    let (station, port) = press(&site, "browser-ladder", "");
    let browser = Browser::open(1280);
    show(&browser, port, "FB 20");
    browser.until(&format!("{} === 'off'", state(2, "#guard")));
    browser.until(&format!("{} === 'on'", state(1, "#off")));
    station.set("E 0.2", 1);
    station.set("E 0.0", 1);
    for operand in ["#held", "#guard", "#run"] {
        browser.until(&format!("{} === 'on'", state(2, operand)));
    }
    // One of the instances alone: the conveyor has not been started.
    browser.run(
        "const one = document.querySelector('#instance'); one.value = '21'; one.dispatchEvent(new Event('change'))",
    );
    browser.until(&format!("{} === 'off' && {} === 'on'", state(2, "#held"), state(2, "#guard")));
    browser.click("#view-fbd");
    browser.until("document.querySelector('[data-network=\"2\"] svg g.box')");
    browser.until(&format!("{} === 'off'", state(2, "#held")));
    browser.click("#view-stl");
    browser.until("document.querySelector('#line-19 .register')?.innerText.startsWith('0 0 ')");
    browser.until("document.querySelector('#line-21 .register').innerText.startsWith('0 1 ')");
    // What is out of view is not watched, and not said to be anything.
    browser.run("scrollTo(0, 0); document.querySelector('#live-says').scrollIntoView()");
    browser.run("document.querySelector('#line-27').scrollIntoView()");
    browser.until("document.querySelector('#line-27 .register').innerText.startsWith('0 1 ')");
    browser.run("scrollTo(0, 0)");
    browser.click("#live");
    browser.until("document.querySelector('#line-21 .register').innerText === ''");

    // A jump leads over the last network of FC 5: it is shown as not run.
    show(&browser, port, "FC 5");
    browser.click("#view-stl");
    browser.until("document.querySelector('#line-44 .register')?.innerText.startsWith('1 1 ')");
    browser.run("document.querySelector('#line-66').scrollIntoView()");
    browser.until("document.querySelector('#line-66 .register').innerText === '– –'");
    assert_eq!(station.status().state, "RUN");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// On a small screen only the networks in view are drawn and watched; when the page goes, the job ends.
#[test]
fn only_what_is_in_view_is_drawn_and_jobs_end_with_the_page() {
    let site = Site::new();
    let (station, port) = press(&site, "browser-view", "");
    let browser = Browser::open(320);
    show(&browser, port, "OB 1");
    // Room between the first network and the others: they are far out of view.
    browser.run("document.querySelector('[data-network=\"1\"]').style.marginBottom = '3000px'");
    browser.until("!document.querySelector('[data-network=\"3\"] svg')");
    browser.until("document.querySelector('[data-network=\"1\"] svg')");
    browser.run("scrollTo(0, document.body.scrollHeight)");
    browser.until("!document.querySelector('[data-network=\"1\"] svg')");
    browser.until("/^Live/.test(document.querySelector('#live-says').innerText)");
    browser.go("about:blank");
    // Both places for jobs are free again, at once and for good.
    for _ in 0..10 {
        for _ in 0..2 {
            let told = site.ob1(&["status", "station.toml", "FB 20", "--once", "--json"]);
            assert_eq!(told.code, Some(0), "{told:?}");
        }
    }
    assert_eq!(station.status().state, "RUN");
}

/// Why is the motor off? A tap in the I/O page, in the ladder and in the source gives the answer; one more tap goes
/// deeper, to the contact that decides.
#[test]
fn a_tap_tells_why() {
    let site = Site::new();
    let (station, port) = press(&site, "browser-why", "");
    station.set("E 0.0", 1);
    let browser = Browser::open(375);
    browser.go(&format!("http://127.0.0.1:{port}/#io"));
    let channel = |name: &str| {
        format!("[...document.querySelectorAll('.channel')].find((one) => one.innerText.includes('{name}'))")
    };
    browser.until(&channel("Motor"));
    browser.until(&format!("{}.querySelector('.dot.on')", channel("Start")));
    browser.until(&format!("!{}.querySelector('.dot.on')", channel("Motor")));
    browser.run(&format!("{}.click()", channel("Motor")));
    let answer = "document.querySelector('dialog[open] .answer')?.innerText";
    browser.until(&format!("{answer}?.includes('A 4.0 \"Motor\"') && {answer}.includes('FB 20 #run')"));
    browser.until("document.querySelector('#dialog-title').innerText === 'Why is A 4.0 \"Motor\" off?'");
    // What the called block does there: the guard decides.
    browser.click(".answer > button");
    browser.until("document.querySelector('li.decides')?.innerText.includes('E 0.2 \"Guard\"')");
    assert!(browser.text("li.decides").contains("guard closed"), "with its comment");
    assert_eq!(browser.run("return document.querySelectorAll('li.decides').length"), 1, "{}", browser.text("dialog"));
    // One level deeper: what holds it on.
    browser.click("button.term");
    browser.until(&format!("{answer}.includes('#on') && {answer}.includes('Network 1')"));
    browser.click("dialog .row button:first-child");
    browser.until(&format!("{answer}?.includes('Guard')"));

    // With the guard closed it is on, and the page says why.
    station.set("E 0.2", 1);
    browser.until(&format!("{}.querySelector('.dot.on')", channel("Motor")));
    show(&browser, port, "OB 1");
    browser.run("document.querySelector('g[data-operand=\"A 4.0\"]').dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter', bubbles: true }))");
    browser.until("document.querySelector('#dialog-title')?.innerText === 'Why is A 4.0 \"Motor\" on?'");
    // In German, from the source.
    browser.run("document.querySelector('dialog').close(); document.querySelector('#language').click()");
    browser.until("document.querySelector('#view-stl')");
    browser.click("#view-stl");
    browser.until("document.querySelector('.operand')");
    browser.run("[...document.querySelectorAll('.operand')].find((one) => one.innerText === '\"Lamp\"').click()");
    browser.until("document.querySelector('#dialog-title')?.innerText === 'Warum ist A 4.2 \"Lamp\" aus?'");
    browser.until("document.querySelectorAll('li.decides').length > 0");
    assert_eq!(browser.run("return document.documentElement.scrollWidth <= innerWidth"), true);
    // In STOP its cause is the answer.
    browser.run("document.querySelector('dialog').close()");
    assert_eq!(site.ob1(&["ctl", "station.toml", "stop"]).code, Some(0));
    browser.until("document.querySelector('#mode').innerText === 'STOP'");
    browser.run("[...document.querySelectorAll('.operand')].find((one) => one.innerText === '\"Lamp\"').click()");
    browser.until(&format!("{answer}?.includes('kein Programm') && {answer}.includes('STOP durch Bedienung')"));
    browser.keep(&site, "web-why-stop");
}

/// What is forced is marked at its channel.
#[test]
fn what_is_forced_is_marked() {
    let site = Site::new();
    let (_station, port) = press(&site, "browser-force", "");
    let told = site.ob1(&["force", "station.toml", "A 4.2=1"]);
    assert_eq!(told.code, Some(0), "{told:?}");
    let browser = Browser::open(768);
    browser.go(&format!("http://127.0.0.1:{port}/#io"));
    let marked = "[...document.querySelectorAll('.channel')].filter((one) => one.querySelector('.force:not([hidden])')).map((one) => one.innerText)";
    browser.until(&format!("{marked}.length === 1 && {marked}[0].includes('A 4.2') && {marked}[0].includes('forced')"));
    // A byte is forced with all its bits.
    site.ob1(&["force", "station.toml", "EB 0=16#81"]).fine();
    browser.until(&format!("{marked}.filter((text) => text.includes('E 0.')).length === 8 && {marked}.length === 9"));
}

/// Twelve tabs of one browser, each with another page: all of them live, with one stream together. Back and forward
/// fifty times; then the page still works.
#[test]
fn twelve_tabs_and_fifty_times_back_and_forward() {
    let site = Site::new();
    let (station, port) = press(&site, "browser-tabs", "");
    let browser = Browser::open(1280);
    let pages = ["station", "io", "program?block=OB%201", "program?block=FB%2020", "variables?items=MW%2020", "scan"];
    let mut tabs = BTreeSet::new();
    for page in pages.iter().cycle().take(12) {
        tabs.insert(browser.tab());
        browser.go(&format!("http://127.0.0.1:{port}/#{page}"));
        browser.until("document.querySelector('#mode').innerText === 'RUN'");
    }
    assert_eq!(tabs.len(), 12);
    station.set("M 9.0", 1);
    for tab in &tabs {
        browser.to_tab(tab);
        browser.until("document.querySelector('#mode').innerText === 'STOP'");
    }
    let streams =
        "return performance.getEntriesByType('resource').filter((one) => one.name.includes('api/stream')).length";
    assert_eq!(browser.run(streams), 0, "the worker has the stream, not the tab");
    station.set("M 9.0", 0);
    for page in pages.iter().cycle().take(12) {
        browser.run(&format!("location.hash = '{page}'"));
    }
    for _ in 0..50 {
        browser.there_and_back();
    }
    turn_to(&browser, "en", "station");
    browser.until("document.querySelector('.card.stop')");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// The gate does not answer: everything is grey, and the page says as of when. When the gate is back, it is not.
#[test]
fn a_lost_connection_greys_everything() {
    let site = Site::new();
    let (station, port) = press(&site, "browser-grey", "");
    let browser = Browser::open(375);
    browser.go(&format!("http://127.0.0.1:{port}/#io"));
    browser.until(
        "document.querySelectorAll('.channel').length > 10 && document.querySelector('#mode').innerText === 'RUN'",
    );
    let (_, process) = gate(&station);
    process.signal(Signal::STOP);
    browser.until("document.body.classList.contains('stale')");
    browser.until(r"/as of \d\d:\d\d:\d\d/.test(document.querySelector('#connection').innerText)");
    process.signal(Signal::CONT);
    browser
        .until("!document.body.classList.contains('stale') && document.querySelector('#connection').innerText === ''");
}

/// What somebody does, clicking.
type Steps<'s> = &'s dyn Fn(&dyn Fn(&str));

/// Ten tasks of a person at the machine, each in at most four clicks from the first page.
#[test]
fn ten_tasks_take_four_clicks_at_most() {
    let site = Site::new();
    add_user(&site, "a.users", "anna", "operate", "anna-password");
    let (station, port) = press(&site, "browser-tasks", "rights = \"operate\"\nusers = \"a.users\"");
    let browser = Browser::open(1280);
    browser.go(&format!("http://127.0.0.1:{port}/"));
    browser.fill("#field-user", "anna");
    browser.fill("#field-password", "anna-password");
    browser.click("form.login button");
    browser.until("document.querySelector('.card.run')");
    let clicks = Cell::new(0);
    let task = |name: &str, steps: Steps<'_>| {
        browser.go("about:blank");
        browser.go(&format!("http://127.0.0.1:{port}/"));
        browser.until("document.querySelector('.card')");
        clicks.set(0);
        steps(&|selector| {
            clicks.set(clicks.get() + 1);
            browser.click(selector);
        });
        println!("{name}: {} clicks", clicks.get());
        assert!(clicks.get() <= 4, "{name}: {} clicks", clicks.get());
        browser.run("document.querySelector('dialog').close()");
    };
    task("find the output's writer", &|click| {
        click("nav a[href='#io']");
        browser.until("document.querySelectorAll('.strip').length === 3");
        click(".strip:nth-child(3) li:nth-child(3) button");
        browser.until("document.querySelector('.answer a')?.innerText.includes('OB 1, Network 3')");
        click(".answer a");
        browser.until("document.querySelector('[data-network=\"3\"]')?.classList.contains('found') || document.querySelector('tr.found')");
    });
    task("watch ten values", &|click| {
        click("nav a[href='#variables']");
        browser.fill("#names", "MW 20\nMW 22\nMW 24\nM 0.0\nM 0.1\nE 0.0\nE 0.1\nA 4.0\nT 1\nZ 1");
        click("#table-watch");
        browser.until("[...document.querySelectorAll('td.value')].filter((cell) => /\\d|S5T|FALSE|TRUE/.test(cell.innerText)).length === 10");
    });
    task("write one", &|click| {
        click("nav a[href='#variables']");
        browser.fill("#names", "MW 30");
        click("#table-watch");
        click("#values tbody button:not(.plain)");
        browser.fill("#field-value", "7");
        click("dialog button[type=submit]");
        browser.until("document.querySelector('td.value').innerText === '7'");
    });
    task("find a late scan's cause", &|click| {
        click("nav a[href='#scan']");
        browser.until("document.querySelector('.chart') && document.querySelectorAll('.fill').length > 0");
    });
    task("see a block's power flow", &|click| {
        click("nav a[href='#program']");
        click("[data-id='FB 20']");
        browser.until("document.querySelector('.network svg g.off, .network svg g.on')");
    });
    task("print a block", &|click| {
        browser.run("window.print = () => { window.printed = true; }");
        click("nav a[href='#program']");
        click("[data-id='FB 20']");
        click("#print");
        browser.until("window.printed");
    });
    task("find the uses of an input", &|click| {
        click("nav a[href='#program']");
        browser.fill("#operand", "Guard");
        click("form[role=search] button");
        browser.until("document.querySelectorAll('.found tbody tr').length >= 4");
    });
    task("keep the diagnostic buffer", &|click| {
        browser.run("HTMLAnchorElement.prototype.click = function () { window.kept = this.download; }");
        click("nav a[href='#diagnostics']");
        click("#csv");
        browser.until("window.kept === 'browser-tasks-diagnostics.csv'");
    });
    station.set("M 9.0", 1);
    task("find why STOP", &|_| {
        browser.until("document.querySelector('.card.stop')?.innerText.includes('Remedy')");
        browser.until("document.querySelector('.card a')?.innerText === 'press.awl:94'");
    });
    station.set("M 9.0", 0);
    task("acknowledge, and start again", &|click| {
        click("#command-warm");
        click("dialog button[type=submit]");
        browser.until("document.querySelector('.card.run')");
    });
    assert_eq!(Visitor::at(port).get("/api/session").status, 200);
}

/// Screenshots for the book: written to the folder in OB1_PICTURES.
#[test]
fn pictures_of_the_program() {
    let site = Site::new();
    let (station, port) = press(&site, "press", "");
    let keep = |browser: &Browser, name: &str| browser.keep(&site, name);
    station.set("E 0.0", 1);
    let wide = Browser::open(1000);
    show(&wide, port, "OB 1");
    wide.until(&format!("{} === 'on'", state(3, "E 0.2")));
    keep(&wide, "web-ladder");
    show(&wide, port, "FC 5");
    wide.click("#view-stl");
    wide.until("document.querySelector('#line-44')");
    wide.run("document.querySelector('#line-44').scrollIntoView()");
    wide.until("document.querySelector('#line-44 .register').innerText !== ''");
    keep(&wide, "web-source");
    let phone = Browser::open(360);
    phone.go(&format!("http://127.0.0.1:{port}/#io"));
    phone.until("document.querySelectorAll('.channel').length > 10");
    keep(&phone, "web-io");
    phone.run("[...document.querySelectorAll('.channel')].find((one) => one.innerText.includes('Motor')).click()");
    phone.click(".answer > button");
    phone.until("document.querySelector('li.decides')");
    keep(&phone, "web-why");
}
