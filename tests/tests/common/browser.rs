//! Debian's Chromium, controlled over WebDriver: one JSON request, one answer. The tests only do what a user can do.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use base64ct::{Base64, Encoding as _};
use serde_json::{Value, json};

use super::gate::Visitor;
use super::processes::Watched;
use super::s7::free_port;
use super::site::Site;
use super::{Guard, told};

/// The key by which WebDriver identifies an element. [W3C WebDriver, 12.1]
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";
const PAUSE: Duration = Duration::from_millis(20);

/// A browser with one window.
pub(crate) struct Browser {
    driver: Child,
    address: SocketAddr,
    session: String,
}

impl Browser {
    /// Opens a browser with a window of this width.
    pub(crate) fn open(width: u32) -> Self {
        let port = free_port();
        let driver = Command::new("chromedriver")
            .arg(format!("--port={port}"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver, which `cargo xtask test` installs");
        let mut browser = Self { driver, address: SocketAddr::from(([127, 0, 0, 1], port)), session: String::new() };
        let guard = Guard::begin();
        while !browser.try_call("GET", "/status", &Value::Null).is_some_and(|status| status["ready"] == true) {
            assert!(!guard.is_over(), "chromedriver does not come up");
            assert!(!browser.ended(), "chromedriver has ended");
        }
        // The container of a test has no user namespaces for the sandbox, and a small /dev/shm.
        let args = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-proxy-server"];
        let wanted = json!({ "capabilities": { "alwaysMatch": {
            "goog:loggingPrefs": { "browser": "ALL", "performance": "ALL" },
            "goog:chromeOptions": { "args": args, "mobileEmulation": {
                "deviceMetrics": { "width": width, "height": 640, "pixelRatio": 1, "touch": false },
            } },
        } } });
        let made = browser.call("POST", "/session", &wanted);
        browser.session = format!("/session/{}", made["sessionId"].as_str().expect("a session"));
        browser
    }

    /// Back, and forward.
    pub(crate) fn there_and_back(&self) {
        self.call("POST", "/back", &json!({}));
        self.call("POST", "/forward", &json!({}));
    }

    /// Whether it has ended, or ends within a short time.
    fn ended(&self) -> bool {
        Watched::find(self.driver.id()).is_none_or(|process| process.ends_within(PAUSE))
    }

    fn try_call(&self, method: &str, path: &str, body: &Value) -> Option<Value> {
        let visitor = Visitor { address: self.address, cookie: None, from: None };
        let mut stream = visitor.connect()?;
        let text = if body.is_null() { String::new() } else { body.to_string() };
        let host = self.address;
        let request = format!(
            "{method} {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{text}",
            text.len()
        );
        stream.write_all(request.as_bytes()).ok()?;
        Some(super::gate::answer(stream)?.json()["value"].clone())
    }

    fn call(&self, method: &str, path: &str, body: &Value) -> Value {
        let value = self.try_call(method, &format!("{}{path}", self.session), body).expect("the driver answers");
        assert!(value["error"].is_null(), "{path}: {}", value["message"]);
        value
    }

    pub(crate) fn go(&self, url: &str) {
        self.call("POST", "/url", &json!({ "url": url }));
    }

    /// Opens one more tab and turns to it; its name.
    pub(crate) fn tab(&self) -> String {
        let made = self.call("POST", "/window/new", &json!({ "type": "tab" }));
        let name = made["handle"].as_str().expect("a tab").to_owned();
        self.to_tab(&name);
        name
    }

    /// Turns to a tab.
    pub(crate) fn to_tab(&self, name: &str) {
        self.call("POST", "/window", &json!({ "handle": name }));
    }

    /// Runs a script in the page and returns its result.
    pub(crate) fn run(&self, script: &str) -> Value {
        self.call("POST", "/execute/sync", &json!({ "script": script, "args": [] }))
    }

    /// Waits until an expression is true.
    pub(crate) fn until(&self, expression: &str) {
        let guard = Guard::begin();
        while self.run(&format!("return Boolean({expression})")) != true {
            assert!(!guard.is_over(), "never true: {expression}\n{}", self.text("body"));
            assert!(!self.ended(), "chromedriver has ended");
        }
    }

    /// The visible text of an element.
    pub(crate) fn text(&self, selector: &str) -> String {
        let script = format!("return document.querySelector({})?.innerText ?? ''", json!(selector));
        self.run(&script).as_str().unwrap_or_default().to_owned()
    }

    fn element(&self, selector: &str) -> String {
        let script = json!({ "using": "css selector", "value": selector });
        let found = self.call("POST", "/element", &script);
        found[ELEMENT].as_str().unwrap_or_else(|| panic!("no {selector}")).to_owned()
    }

    /// Does something with an element once it is there. A page may replace an element between the moment it is found
    /// and the moment it is used: then its successor is used.
    fn with(&self, selector: &str, what: &str, body: &Value) {
        self.until(&format!("document.querySelector({})", json!(selector)));
        let guard = Guard::begin();
        loop {
            let path = format!("{}/element/{}/{what}", self.session, self.element(selector));
            let value = self.try_call("POST", &path, body).expect("the driver answers");
            if value["error"].is_null() {
                return;
            }
            let replaced = value["error"] == "stale element reference" && !guard.is_over();
            assert!(replaced, "{selector}, {what}: {}", value["message"]);
        }
    }

    /// Clicks an element; only visible elements can be clicked.
    pub(crate) fn click(&self, selector: &str) {
        self.with(selector, "click", &json!({}));
    }

    /// Types text into an element.
    pub(crate) fn fill(&self, selector: &str, text: &str) {
        self.with(selector, "clear", &json!({}));
        self.with(selector, "value", &json!({ "text": text }));
    }

    /// Runs a command of Chromium.
    fn devtools(&self, command: &str, params: &Value) -> Value {
        self.call("POST", "/goog/cdp/execute", &json!({ "cmd": command, "params": params }))
    }

    /// Sets the colour scheme of the system: `light` or `dark`.
    pub(crate) fn scheme(&self, scheme: &str) {
        let features = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        self.devtools("Emulation.setEmulatedMedia", &features);
        self.until(&format!("matchMedia('(prefers-color-scheme: {scheme})').matches"));
    }

    /// Disables the cache.
    pub(crate) fn uncached(&self) {
        self.devtools("Network.setCacheDisabled", &json!({ "cacheDisabled": true }));
    }

    /// Presses keys one after the other, at the current focus.
    pub(crate) fn press(&self, keys: &[Key]) {
        let press = |key: &Key| ["keyDown", "keyUp"].map(|kind| json!({ "type": kind, "value": key.code() }));
        let actions: Vec<Value> = keys.iter().flat_map(press).collect();
        self.call("POST", "/actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": actions }] }));
    }

    /// The serious or critical violations of rules of axe-core in the page: rule and place.
    pub(crate) fn barriers(&self) -> Vec<String> {
        if self.run("return typeof axe") != "object" {
            let path = Path::new(&told("NODE_PATH")).join("axe-core/axe.min.js");
            let axe = std::fs::read_to_string(&path).unwrap_or_else(|why| panic!("{}: {why}", path.display()));
            self.run(&format!("{axe}; window.axe = axe;"));
        }
        let found = self.run(
            "return axe.run(document, { resultTypes: ['violations'] }).then((told) => told.violations
                 .filter((rule) => ['serious', 'critical'].includes(rule.impact))
                 .map((rule) => `${rule.id}: ${rule.nodes.slice(0, 3).map((node) => `${node.target} ${node.failureSummary}`).join('; ')}`))",
        );
        let found = found.as_array().expect("a list");
        found.iter().map(|rule| rule.as_str().unwrap_or_default().to_owned()).collect()
    }

    /// The network requests since the last call: the hosts, and the bytes received.
    pub(crate) fn traffic(&self) -> (Vec<String>, u64) {
        let log = self.call("POST", "/se/log", &json!({ "type": "performance" }));
        let (mut hosts, mut bytes) = (Vec::new(), 0);
        for line in log.as_array().expect("a list") {
            let line: Value = serde_json::from_str(line["message"].as_str().unwrap_or_default()).unwrap_or_default();
            let (what, about) = (&line["message"]["method"], &line["message"]["params"]);
            if what == "Network.requestWillBeSent" {
                let url = about["request"]["url"].as_str().unwrap_or_default();
                if let Some((_, rest)) = url.split_once("://") {
                    hosts.push(rest.split('/').next().unwrap_or_default().to_owned());
                }
            } else if what == "Network.loadingFinished" {
                bytes += about["encodedDataLength"].as_f64().unwrap_or(0.0) as u64;
            }
        }
        (hosts, bytes)
    }

    /// Keeps a picture of the page for the book in the folder that OB1_PICTURES names; in that of the test without it.
    pub(crate) fn keep(&self, site: &Site, name: &str) {
        let folder = std::env::var_os("OB1_PICTURES").map_or_else(|| site.path("."), std::path::PathBuf::from);
        let picture = self.picture();
        assert!(picture.starts_with(b"\x89PNG\r\n\x1A\n") && picture.len() > 5000, "{name}: {}", picture.len());
        std::fs::write(folder.join(format!("{name}.png")), picture).expect("room for a picture");
    }

    /// A screenshot as a PNG.
    fn picture(&self) -> Vec<u8> {
        let text = self.call("GET", "/screenshot", &Value::Null);
        Base64::decode_vec(text.as_str().expect("a text")).expect("base64")
    }

    /// The error messages of the page since the last call.
    pub(crate) fn complaints(&self) -> Vec<String> {
        let log = self.call("POST", "/se/log", &json!({ "type": "browser" }));
        let lines = log.as_array().expect("a list");
        lines.iter().map(|line| line["message"].as_str().unwrap_or_default().to_owned()).collect()
    }
}

/// Keys that are not characters.
#[derive(Clone, Copy)]
pub(crate) enum Key {
    Tab,
    Enter,
    Escape,
}

impl Key {
    /// [W3C WebDriver, 17.4.2]
    const fn code(self) -> &'static str {
        match self {
            Self::Tab => "\u{E004}",
            Self::Enter => "\u{E007}",
            Self::Escape => "\u{E00C}",
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.try_call("DELETE", &self.session, &Value::Null);
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
