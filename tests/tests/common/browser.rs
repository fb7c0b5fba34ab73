//! Debian's Chromium, steered over WebDriver: one JSON request, one answer. What a test does here a person could do.

use std::io::Write as _;
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use super::Guard;
use super::gate::Visitor;
use super::processes::Watched;
use super::s7::free_port;

/// The key under which WebDriver names an element. [W3C WebDriver, 12.1]
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";
const PAUSE: Duration = Duration::from_millis(20);

/// A browser with one window.
pub(crate) struct Browser {
    driver: Child,
    address: SocketAddr,
    session: String,
}

impl Browser {
    /// With a window of this width.
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
            "goog:loggingPrefs": { "browser": "ALL" },
            "goog:chromeOptions": { "args": args, "mobileEmulation": {
                "deviceMetrics": { "width": width, "height": 640, "pixelRatio": 1, "touch": false },
            } },
        } } });
        let made = browser.call("POST", "/session", &wanted);
        browser.session = format!("/session/{}", made["sessionId"].as_str().expect("a session"));
        browser
    }

    /// Waits a moment for its end, which is none as a rule.
    fn ended(&self) -> bool {
        Watched::find(self.driver.id()).is_none_or(|process| process.ends_within(PAUSE))
    }

    fn try_call(&self, method: &str, path: &str, body: &Value) -> Option<Value> {
        let visitor = Visitor { address: self.address, cookie: None };
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

    /// What a script of the page's world returns.
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

    /// The text that a person reads there.
    pub(crate) fn text(&self, selector: &str) -> String {
        let script = format!("return document.querySelector({})?.innerText ?? ''", json!(selector));
        self.run(&script).as_str().unwrap_or_default().to_owned()
    }

    fn element(&self, selector: &str) -> String {
        let script = json!({ "using": "css selector", "value": selector });
        let found = self.call("POST", "/element", &script);
        found[ELEMENT].as_str().unwrap_or_else(|| panic!("no {selector}")).to_owned()
    }

    /// Clicks, as a person does: only what is there to be seen can be clicked.
    pub(crate) fn click(&self, selector: &str) {
        self.until(&format!("document.querySelector({})", json!(selector)));
        let element = self.element(selector);
        self.call("POST", &format!("/element/{element}/click"), &json!({}));
    }

    /// Types.
    pub(crate) fn fill(&self, selector: &str, text: &str) {
        self.until(&format!("document.querySelector({})", json!(selector)));
        let element = self.element(selector);
        self.call("POST", &format!("/element/{element}/clear"), &json!({}));
        self.call("POST", &format!("/element/{element}/value"), &json!({ "text": text }));
    }

    /// What the page has complained of since one asked last.
    pub(crate) fn complaints(&self) -> Vec<String> {
        let log = self.call("POST", "/se/log", &json!({ "type": "browser" }));
        let lines = log.as_array().expect("a list");
        lines.iter().map(|line| line["message"].as_str().unwrap_or_default().to_owned()).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.try_call("DELETE", &self.session, &Value::Null);
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
