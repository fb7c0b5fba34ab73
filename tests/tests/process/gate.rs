//! The web page and the metrics of a running station: what is shown, who may change what, and hostile requests.

use std::io::Write as _;
use std::net::{Ipv4Addr, TcpStream};
use std::os::unix::fs::PermissionsExt as _;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::common;
use crate::common::gate::{Stream, Visitor, add_user, gate, station};
use crate::common::s7::free_port;
use crate::common::site::Site;

const USERS: &str = "rights = \"operate\"\nusers = \"a.users\"";

fn users(site: &Site) {
    for (name, rights) in [("anna", "operate"), ("willi", "write"), ("rita", "read")] {
        add_user(site, "a.users", name, rights, &format!("{name}-password"));
    }
}

#[test]
fn the_page_shows_the_station() {
    let site = Site::new();
    let (station, page, figures) = station(&site, "gate-page", "");
    let visitor = Visitor::at(page);
    let front = visitor.get("/");
    assert_eq!(front.status, 200);
    assert!(front.head("content-security-policy").is_some_and(|policy| policy.starts_with("default-src 'none'")));
    let is_file = |part: &&str| ["icon.svg", "style.css", "app.js"].contains(part);
    let files: Vec<String> = front.body.split('"').filter(is_file).map(|part| format!("/{part}")).collect();
    assert_eq!(files.len(), 3, "{}", front.body);
    for file in &files {
        let got = visitor.get(file);
        assert_eq!(got.status, 200, "{file}");
        let tag = got.head("etag").expect("a tag").to_owned();
        assert_eq!(visitor.get_with(file, &format!("If-None-Match: {tag}\r\n")).status, 304, "{file}");
    }
    let session = visitor.get("/api/session").json();
    assert_eq!((&session["station"], &session["right"]), (&json!("gate-page"), &json!("read")));
    assert_eq!(visitor.get("/api/status").json()["state"], "RUN");
    assert_eq!(visitor.get("/api/why").json()["stop"], Value::Null, "it has not stopped");
    let links = visitor.get("/api/links").json();
    assert_eq!(links, json!([{ "name": "web", "up": true }, { "name": "metrics", "up": true }]));
    assert!(visitor.get("/api/timing").json()["execution"]["buckets"].as_array().is_some_and(|all| !all.is_empty()));
    assert!(visitor.get("/api/diagnostics").json()[0]["text"].as_str().is_some_and(|text| text.contains("RUN")));

    let program = visitor.get("/api/program").json();
    assert!(program["blocks"].as_array().is_some_and(|all| all.iter().any(|block| block["id"] == "FC 1")), "{program}");
    let code = visitor.get("/api/block?id=FC%201").json();
    let lines = code["lines"].as_array().expect("the lines of the source");
    assert!(lines.len() > 10 && code["source"].as_str().is_some_and(|file| file.ends_with("plant.awl")), "{code}");
    assert!(lines[0][2].as_str().is_some_and(|line| line.starts_with("FUNCTION FC 1")), "{code}");
    let data = visitor.get("/api/block?id=DB%2010").json();
    let rows = data["components"].as_array().expect("declarations");
    assert!(rows.contains(&json!(["motor.running", "BOOL", "34.0", "DB10.motor.running"])), "{data}");
    let uses = visitor.get("/api/xref?operand=mistake").json();
    assert!(uses["uses"].as_array().is_some_and(|all| !all.is_empty()), "{uses}");
    let unknown = visitor.get("/api/xref?operand=mistak");
    assert!(unknown.status == 404 && unknown.body.contains("Did you mean \"mistake\"?"), "{}", unknown.body);
    assert_eq!(visitor.get("/api/block?id=FC%2099").status, 404);
    assert_eq!(visitor.get("/../../etc/passwd").status, 404);

    let mut stream = visitor.stream("?period=100&items=DB10.recipe%0ADB10.target:hex%0Amistake%0AX1", "");
    let heads = stream.next("table").expect("heads").1;
    assert_eq!((&heads[0]["type"], heads[3]["error"].is_string()), (&json!("STRING"), true));
    let values = stream.next("values").expect("values").1;
    assert_eq!(values["values"], json!(["'lemonade'", "16#0384", "0", null]), "{values}");
    station.set("DB10.DBW 2", 5);
    stream.until("values", |told| told["values"][1] == "16#0005");

    let open = "Accept: application/openmetrics-text;version=1.0.0,text/plain;q=0.5\r\n";
    let text = Visitor::at(figures).get_with("/metrics", open);
    assert!(text.head("content-type").is_some_and(|kind| kind.starts_with("application/openmetrics-text")));
    assert!(text.body.contains("ob1_cpu_state{ob1_cpu_state=\"RUN\"} 1"), "{}", text.body);
    assert!(text.body.ends_with("# EOF\n"));
    let old = Visitor::at(figures).get_with("/metrics", "Accept: */*\r\n");
    assert_eq!(old.head("content-type"), Some("text/plain; version=0.0.4; charset=utf-8"));
    assert!(old.body.contains("# TYPE ob1_scans_total counter") && !old.body.contains("# EOF"), "{}", old.body);
    let scans = |text: &str| -> f64 {
        let line = text.lines().find_map(|line| line.strip_prefix("ob1_scans_total ")).expect("the scans");
        line.parse().expect("a number")
    };
    let before = scans(&text.body);
    station.until("more scans", |_| (scans(&Visitor::at(figures).get("/metrics").body) > before).then_some(()));
    assert_eq!(Visitor::at(figures).get("/").status, 404);
    let ended = station.interrupt();
    assert_eq!(ended.code(), Some(0), "{ended:?}");
}

/// The information for a technician when the machine stops: state, cause, place, remedy, sent without reloading.
#[test]
fn a_station_that_stops_says_why() {
    let site = Site::new();
    let (station, page, figures) = station(&site, "gate-stop", "");
    let visitor = Visitor::at(page);
    let mut stream = visitor.stream("", "");
    stream.until("status", |status| status["state"] == "RUN");
    station.set("M 9.0", 1);
    stream.until("event", |event| event["state"] == "STOP");
    stream.until("status", |status| status["state"] == "STOP");
    let why = visitor.get("/api/why").json();
    assert_eq!((&why["over"], &why["stop"]["change"]), (&json!(false), &json!("fault")), "{why}");
    let cause = &why["cause"];
    assert!(cause["text"].as_str().is_some_and(|text| text.contains("data block not loaded")), "{why}");
    assert!(cause["place"].as_str().is_some_and(|place| place.starts_with("plant.awl:")), "{why}");
    assert!(cause["remedy"].as_str().is_some_and(|remedy| !remedy.is_empty()), "{why}");
    let text = Visitor::at(figures).get("/metrics").body;
    assert!(text.contains("ob1_cpu_state{ob1_cpu_state=\"STOP\"} 1"), "{text}");
    assert!(text.contains("change=\"fault\"} 1"), "{text}");
    station.set("M 9.0", 0);
}

/// Each user with each right: forbidden actions change nothing, and attempts are in the audit log.
#[test]
fn without_rights_nothing_changes() {
    let site = Site::new();
    users(&site);
    let (station, page, figures) = station(&site, "gate-rights", USERS);
    let write = |visitor: &Visitor, value: u16| visitor.post("/api/write", &json!({ "item": "MW 20", "value": value }));
    let command = |visitor: &Visitor, name: &str| visitor.post("/api/command", &json!({ "command": name })).status;
    let stranger = Visitor::at(page);
    for path in ["status", "why", "diagnostics", "timing", "buffers", "links", "program", "reports", "stream", "xref"] {
        assert_eq!(stranger.get(&format!("/api/{path}")).status, 401, "{path}");
    }
    assert_eq!((write(&stranger, 1).status, command(&stranger, "stop")), (401, 401));
    let session = stranger.get("/api/session").json();
    assert_eq!((&session["user"], &session["users"]), (&Value::Null, &json!(true)));
    for token in ["", "0", &"0".repeat(64), &"ä".repeat(32)] {
        let forged = Visitor { cookie: Some(format!("ob1-gate-rights-web={token}")), ..stranger.clone() };
        assert_eq!((forged.get("/api/status").status, write(&forged, 1).status), (401, 401), "{token}");
    }
    let [rita, willi, anna] =
        ["rita", "willi", "anna"].map(|name| Visitor::as_user(page, name, &format!("{name}-password")));
    assert_eq!(rita.get("/api/status").status, 200);
    assert_eq!((write(&rita, 1).status, command(&rita, "stop")), (403, 403));
    assert_eq!(command(&willi, "stop"), 403);
    assert_eq!(station.cell("MW 20"), 0, "nothing has changed");

    // Refused from another page, under another host name, and as a form.
    let own = format!("Origin: http://127.0.0.1:{page}\r\n");
    let body = json!({ "item": "MW 20", "value": 2 });
    let kind = "Content-Type: application/json\r\n";
    for more in [
        kind.to_owned(),
        format!("{kind}Origin: http://evil.example\r\n"),
        format!("{kind}Origin: null\r\n"),
        format!("{kind}{own}Sec-Fetch-Site: cross-site\r\n"),
    ] {
        assert_eq!(willi.post_with("/api/write", &more, &body).status, 403, "{more}");
    }
    let rebound = willi.get_with("/api/status", "Host: evil.example\r\n");
    assert_eq!(rebound.status, 403, "two hosts");
    let cookie = willi.cookie.clone().expect("a cookie");
    let rebound = format!(
        "GET /api/status HTTP/1.1\r\nHost: evil.example:{page}\r\nCookie: {cookie}\r\nConnection: close\r\n\r\n"
    );
    assert_eq!(willi.raw(rebound.as_bytes()).expect("an answer").status, 403);
    assert_eq!(willi.get("/api/write").status, 405);
    // Only a POST changes something; each refusal says what is allowed.
    for (method, path, allowed) in [
        ("PUT", "/api/write", "POST"),
        ("DELETE", "/api/write", "POST"),
        ("PATCH", "/api/command", "POST"),
        ("OPTIONS", "/api/write", "POST"),
        ("PUT", "/api/status", "GET, HEAD"),
        ("POST", "/api/status", "GET, HEAD"),
        ("POST", "/", "GET, HEAD"),
    ] {
        let refused = willi.send(method, path, &format!("{kind}{own}"), &body);
        assert_eq!((refused.status, refused.head("allow")), (405, Some(allowed)), "{method} {path}: {refused:?}");
    }
    let figures = Visitor::at(figures);
    let refused = figures.post("/metrics", &json!({}));
    assert_eq!((refused.status, refused.head("allow")), (405, Some("GET, HEAD")), "{refused:?}");
    assert_eq!(station.cell("MW 20"), 0, "still nothing");

    assert_eq!(write(&willi, 7).status, 200);
    assert_eq!(station.cell("MW 20"), 7);
    for (item, value) in
        [("MW 20", json!("16#FFFFF")), ("X 1", json!(1)), ("DB99.DBW0", json!(1)), ("MW 20", json!([]))]
    {
        let refused = willi.post("/api/write", &json!({ "item": item, "value": value }));
        assert!(matches!(refused.status, 409 | 422), "{item} {value}: {refused:?}");
    }
    let text = willi.post("/api/write", &json!({ "item": "DB10.recipe", "value": "cola" }));
    assert_eq!(text.status, 200, "{text:?}");
    assert_eq!(station.cell("DB10.DBB 9"), 4, "the length of a STRING");
    assert_eq!(command(&anna, "stop"), 200);
    station.until("STOP", |s| (s.status().state == "STOP").then_some(()));
    assert_eq!(command(&anna, "run"), 200);
    station.until("RUN", |s| (s.status().state == "RUN").then_some(()));

    let mut stream = anna.stream("", "");
    assert!(stream.next("status").is_some());
    assert_eq!(anna.post("/api/logout", &json!({})).status, 200);
    assert_eq!(command(&anna, "stop"), 401, "logged out");
    assert!((0..20).any(|_| stream.next("status").is_none()), "the stream ends with the session");
    let audit = std::fs::read_to_string(site.path("gate-rights.audit")).expect("the audit log");
    let lines: Vec<Value> = audit.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    for (user, what, outcome) in [
        ("rita", "write MW 20 = 1", "refused: not allowed"),
        ("rita", "command stop", "refused: not allowed"),
        ("willi", "write MW 20 = 7", "done, scan"),
        ("willi", "command stop", "refused"),
        ("anna", "command stop", "done"),
        ("anna", "login", "done"),
        ("anna", "logout", "done"),
    ] {
        let told = lines.iter().any(|line| {
            line["user"] == user
                && line["what"] == what
                && line["outcome"].as_str().is_some_and(|o| o.starts_with(outcome))
        });
        assert!(told, "{user} {what} {outcome}: {audit}");
    }
    assert!(
        lines.iter().all(|line| line["link"] == "web" && line["time"].is_string() && line["client"] == "127.0.0.1")
    );
    // Wrong passwords keep nobody out.
    let guess = |password: &str| stranger.post("/api/login", &json!({ "user": "anna", "password": password })).status;
    assert_eq!((guess("wrong"), guess("anna-password")), (401, 200));
    // A new password ends the sessions of the old one.
    let mut stream = rita.stream("", "");
    assert!(stream.next("status").is_some());
    add_user(&site, "a.users", "rita", "read", "another-password");
    assert!((0..20).any(|_| stream.next("status").is_none()), "so does its stream");
    station.until("another login is needed", |_| (rita.get("/api/status").status == 401).then_some(()));
}

/// Statements tell of all cells: a link that is limited to some does not show them.
#[test]
fn a_limited_page_does_not_show_the_program() {
    let site = Site::new();
    let (station, page, _) = station(&site, "gate-limited", "areas = [\"DB\"]\nblocks = [\"DB10\"]");
    let visitor = Visitor::at(page);
    let program = visitor.get("/api/program").json();
    assert_eq!(program["blocks"], json!([]), "{program}");
    assert_eq!(program["data"].as_array().map(Vec::len), Some(1), "{program}");
    for (path, status) in [
        ("/api/block?id=DB%2010", 200),
        ("/api/block?id=OB%201", 403),
        ("/api/block?id=DB%2020", 404),
        ("/api/xref?operand=M", 403),
    ] {
        assert_eq!(visitor.get(path).status, status, "{path}");
    }
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A killed gate is restarted: the page is available again, a resumed stream has missed nothing, and the scan has
/// continued.
#[test]
fn a_killed_gate_comes_back() {
    let site = Site::new();
    let (station, page, _) = station(&site, "gate-killed", "");
    let visitor = Visitor::at(page);
    let mut stream = visitor.stream("", "Last-Event-ID: 0\r\n");
    let (id, _) = stream.until("event", |event| event["state"] == "RUN");
    let scans = station.status().scans;
    let (pid, process) = gate(&station);
    // The runtime decides.
    process.signal(Signal::INT);
    process.signal(Signal::HUP);
    assert_eq!((visitor.get("/api/status").status, gate(&station).0), (200, pid));
    process.signal(Signal::KILL);
    process.wait("the gate");
    assert_eq!(stream.next("never"), None, "the stream has ended");
    station.until("the page is back", |_| visitor.try_get("/api/status").filter(|answer| answer.status == 200));
    assert_ne!(gate(&station).0, pid);
    station.set("M 9.0", 1);
    let mut stream: Stream = visitor.stream("", &format!("Last-Event-ID: {}\r\n", id.expect("a number")));
    let (first, event) = stream.next("event").expect("an event");
    assert_eq!(first, id.map(|id| id + 1), "{event}");
    stream.until("event", |event| event["state"] == "STOP");
    assert!(station.status().scans > scans);
    // The end of the station is not reported as the end of a link.
    let ended = station.interrupt();
    assert_eq!(ended.err.matches("it is started again").count(), 1, "{ended:?}");
}

/// A FIFO in the folder of reports is not waited for; a link whose folder is in the way is not served, and the page is.
#[test]
fn a_fifo_and_a_link_that_lacks_its_folder_leave_the_page_alone() {
    let site = Site::new();
    std::fs::create_dir(site.path("reports")).expect("a folder");
    let made = std::process::Command::new("mkfifo").arg(site.path("reports/a.json")).status().expect("mkfifo is there");
    assert!(made.success());
    site.write("gate-beside.gate", "no folder");
    let port = free_port();
    let keys =
        format!("reports = \"reports\"\n\n[[link]]\ntype = \"opcua\"\nname = \"ua\"\nlisten = \"127.0.0.1:{port}\"\n");
    let (station, page, _) = station(&site, "gate-beside", &keys);
    let visitor = Visitor::at(page);
    let (pid, _) = gate(&station);
    assert_eq!(visitor.get("/api/reports?name=a.json").status, 409);
    assert_eq!((visitor.get("/api/status").status, gate(&station).0), (200, pid));
    let ended = station.interrupt();
    assert!(ended.err.contains("this link is not served, the others are"), "{ended:?}");
}

/// Incomplete requests, huge ones, noise: each is refused or closed, other clients are served meanwhile, and the gate
/// survives.
#[test]
fn what_strangers_send_hurts_nobody() {
    let site = Site::new();
    users(&site);
    let (station, page, _) = station(&site, "gate-hostile", USERS);
    let visitor = Visitor::at(page);
    let (pid, _) = gate(&station);
    // Uses all connections of one address without completing a request.
    let elsewhere = Visitor::at(page);
    let slow: Vec<TcpStream> = (0..40).filter_map(|_| from_elsewhere(page)).collect();
    assert!(!slow.is_empty());
    for mut stream in &slow {
        let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ");
    }
    assert_eq!(visitor.get("/").status, 200, "others are served");
    drop(slow);
    let host = format!("Host: 127.0.0.1:{page}\r\n");
    let own = format!("{host}Origin: http://127.0.0.1:{page}\r\n");
    let giant = "a".repeat(200_000);
    let requests = [
        format!("GET / HTTP/1.1\r\n{host}X: {giant}\r\n\r\n"),
        format!("GET /{giant} HTTP/1.1\r\n{host}\r\n"),
        format!("GET / HTTP/1.1\r\n{host}{}\r\n", "A: b\r\n".repeat(5000)),
        format!("GET / HTTP/1.1\r\n{host}Cookie: ob1={giant}\r\n\r\n"),
        format!("POST /api/login HTTP/1.1\r\n{own}Content-Length: 99999999999\r\n\r\n{giant}"),
        format!("POST /api/login HTTP/1.1\r\n{own}Content-Length: -1\r\n\r\n"),
        format!("POST /api/login HTTP/1.1\r\n{own}Content-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef"),
        format!("POST /api/login HTTP/1.1\r\n{own}Transfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\n"),
        format!(
            "POST /api/login HTTP/1.1\r\n{own}Content-Type: application/json\r\nContent-Length: 2\r\nConnection: close\r\n\r\n[["
        ),
        format!("TRACE / HTTP/1.1\r\n{host}Origin: http://127.0.0.1:{page}\r\nConnection: close\r\n\r\n"),
        "GET / HTTP/1.1\r\nConnection: close\r\n\r\n".to_owned(),
        "GET / HTTP/9.9\r\n\r\n".to_owned(),
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_owned(),
        "\u{16}\u{3}\u{1}\u{2}\0\u{1}\0\u{1}\u{FC}".to_owned(),
        format!("{}\r\n\r\n", "[".repeat(50_000)),
    ];
    for request in &requests {
        let status = visitor.raw(request.as_bytes()).map(|answer| answer.status);
        assert!(status.is_none_or(|status| (400..500).contains(&status)), "{status:?}: {:.80}", request);
    }
    // A body that is too long is another mistake than one that is broken.
    let chunked = |body: &str| {
        let request = format!("POST /api/login HTTP/1.1\r\n{own}Transfer-Encoding: chunked\r\n\r\n{body}");
        visitor.raw(request.as_bytes()).expect("an answer").status
    };
    assert_eq!((chunked("zz\r\nabc\r\n"), chunked(&format!("10001\r\n{}", &giant[..65_537]))), (400, 413));
    let deep = "[".repeat(60_000);
    let nested = elsewhere.post_with("/api/login", &own.replace(&host, ""), &json!(deep));
    assert!((400..500).contains(&nested.status));
    assert_eq!(visitor.get("/").status, 200);
    assert_eq!(gate(&station).0, pid, "it has not died");
    assert_eq!(station.status().state, "RUN");
}

/// Scrapes without a password, thousands of them, and with names of any length: the audit log stays small.
#[test]
fn strangers_do_not_fill_the_audit_log() {
    const SCRAPES: usize = 1000;
    let site = Site::new();
    users(&site);
    let port = common::s7::free_port();
    let keys = format!(
        "[[link]]\ntype = \"metrics\"\nname = \"closed\"\nlisten = \"127.0.0.1:{port}\"\nusers = \"a.users\"\n"
    );
    let (station, _, _) = station(&site, "gate-scrapes", &keys);
    let visitor = Visitor::at(port);
    station.until("the metrics are served", |_| visitor.try_get("/metrics"));
    // 20,000 bytes of a name, a colon and a password, in base 64.
    let long = format!("Authorization: Basic {}Onh4\r\n", "eHh4".repeat(6000));
    for _ in 0..SCRAPES {
        assert_eq!(visitor.get_with("/metrics", &long).status, 401);
    }
    let audit = std::fs::read_to_string(site.path("gate-scrapes.audit")).expect("the audit log");
    assert!(audit.lines().count() < SCRAPES, "{}", audit.lines().count());
    assert!(audit.lines().all(|line| line.len() < 1000), "a long line");
}

/// Connects from another address of this machine.
fn from_elsewhere(port: u16) -> Option<TcpStream> {
    Visitor { from: Some(Ipv4Addr::new(127, 0, 0, 2)), ..Visitor::at(port) }.connect()
}

/// It is confined: no privileges, and only the system calls it needs.
#[test]
fn the_gate_is_confined() {
    let site = Site::new();
    let (station, _, _) = station(&site, "gate-confined", "");
    let (pid, _) = gate(&station);
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it lives");
    for line in ["NoNewPrivs:\t1", "Seccomp:\t2", "CapEff:\t0000000000000000", "CapBnd:\t0000000000000000"] {
        assert!(status.contains(line), "{line}: {status}");
    }
    let limits = std::fs::read_to_string(format!("/proc/{pid}/limits")).expect("it lives");
    assert!(limits.lines().any(|line| line.starts_with("Max data size") && line.contains("1073741824")), "{limits}");
}

/// An unprotected page is refused before the start.
#[test]
fn an_unprotected_page_is_refused() {
    let site = Site::new();
    site.write("plant.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n");
    let run = |keys: &str| {
        let file = format!(
            "[station]\nname = \"gate-refused\"\n[program]\nsources = [\"plant.awl\"]\n[[link]]\ntype = \"web\"\nname = \"page\"\n{keys}\n"
        );
        site.write("station.toml", &file);
        site.ob1(&["run", "station.toml"])
    };
    let open = run("listen = \"0.0.0.0:0\"");
    assert!(open.code != Some(0) && open.err.contains("C017") && open.err.contains("certificate ="), "{open:?}");
    let everybody = run("listen = \"127.0.0.1:0\"\nrights = \"operate\"");
    assert!(everybody.err.contains("C017") && everybody.err.contains("ob1-gate user add"), "{everybody:?}");
    let missing = run("listen = \"127.0.0.1:0\"\nrights = \"write\"\nusers = \"a.users\"");
    assert!(missing.code == Some(6) && missing.err.contains("a.users cannot be read"), "{missing:?}");
    assert!(missing.err.contains("ob1-gate user add"), "{missing:?}");
    let checked = site.ob1(&["check", "station.toml"]);
    let told = "station.toml:10:9: warning C001: there is no file a.users now";
    assert!(checked.code == Some(0) && checked.err.contains(told), "{checked:?}");
    let no_key = run("listen = \"127.0.0.1:0\"\ncertificate = \"a.crt\"\nkey = \"a.key\"");
    assert!(no_key.code == Some(6) && no_key.err.contains("a.key cannot be read"), "{no_key:?}");
    assert!(!no_key.err.contains("ob1-gate user add"), "{no_key:?}");
    let users = site.write("a.users", "");
    std::fs::set_permissions(&users, std::fs::Permissions::from_mode(0o644)).expect("a mode");
    let public = run("listen = \"127.0.0.1:0\"\nrights = \"write\"\nusers = \"a.users\"");
    assert!(public.code == Some(6) && public.err.contains("chmod 600"), "{public:?}");
}

/// Over TLS: a client that trusts only this certificate gets the page and a cookie for this host only; plain
/// connections get nothing.
#[test]
fn a_page_over_tls() {
    const CLIENT: &str = "
import json, ssl, sys, urllib.request
context = ssl.create_default_context(cafile=sys.argv[2])
base = 'https://localhost:' + sys.argv[1]
def ask(path, body=None):
    heads = {'Origin': base, 'Content-Type': 'application/json'}
    data = None if body is None else json.dumps(body).encode()
    answer = urllib.request.urlopen(urllib.request.Request(base + path, data, heads), context=context, timeout=60)
    return answer.headers, answer.read()
heads, page = ask('/')
heads, _ = ask('/api/login', {'user': 'anna', 'password': 'anna-password'})
print(json.dumps({'page': len(page), 'cookie': heads['Set-Cookie']}))
";
    let site = Site::new();
    users(&site);
    for (file, mode) in [("test.crt", 0o644), ("test.key", 0o600)] {
        let copy = site.path(file);
        std::fs::copy(common::checkout("tests/fixtures/tls").join(file), &copy).expect("a fixture");
        std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(mode)).expect("a mode");
    }
    let port = common::s7::free_port();
    let keys = format!(
        "[[link]]\ntype = \"web\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nusers = \"a.users\"\n\
         certificate = \"test.crt\"\nkey = \"test.key\"\n"
    );
    let (_station, _, _) = station(&site, "gate-tls", &keys);
    let mut client = site.command(common::python());
    client.args(["-c", CLIENT, &port.to_string()]).arg(site.path("test.crt"));
    let output = client.output().expect("Python starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let cookie = told["cookie"].as_str().expect("a cookie");
    assert!(cookie.starts_with("__Host-ob1-gate-tls-panel=") && cookie.contains("; Secure"), "{cookie}");
    assert!(Visitor::at(port).try_get("/").is_none_or(|answer| answer.status >= 400), "plain");
}

/// Behind a proxy with TLS, which names us or itself as the host: the browser's Origin is that of the proxy.
#[test]
fn a_page_behind_a_proxy() {
    let site = Site::new();
    users(&site);
    let keys = format!("{USERS}\norigins = [\"https://press.example\"]");
    let (_station, page, _) = station(&site, "gate-proxy", &keys);
    let visitor = Visitor::at(page);
    let login = |host: &str, origin: &str| {
        let body = json!({ "user": "anna", "password": "anna-password" }).to_string();
        let request = format!(
            "POST /api/login HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nContent-Type: application/json\r\n\
             Sec-Fetch-Site: same-origin\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        visitor.raw(request.as_bytes()).expect("an answer")
    };
    let own = format!("127.0.0.1:{page}");
    for host in ["press.example", own.as_str()] {
        let answer = login(host, "https://press.example");
        let cookie = answer.head("set-cookie").unwrap_or_default();
        let name = "__Host-ob1-gate-proxy-web=";
        assert!(answer.status == 200 && cookie.starts_with(name) && cookie.contains("; Secure"), "{answer:?}");
        let cookie = cookie.split(';').next().map(str::to_owned);
        let stream = Visitor { cookie, ..visitor.clone() }.get_head("/api/stream");
        assert!(stream.contains("x-accel-buffering: no"), "a proxy must not hold events back: {stream}");
    }
    let plain = login(&own, &format!("http://{own}"));
    assert!(plain.head("set-cookie").is_some_and(|cookie| cookie.starts_with("ob1-gate-proxy-web=")), "{plain:?}");
    for (host, origin) in [
        (own.as_str(), "http://press.example"),
        (own.as_str(), "https://press.example.evil"),
        (own.as_str(), "https://press.example:8443"),
        ("press.example.evil", "https://press.example"),
    ] {
        assert_eq!(login(host, origin).status, 403, "{host} {origin}");
    }
}

/// A real Prometheus reads the metrics: their values match the station, their types match the document, and the rules
/// of the example are valid.
#[test]
fn prometheus_scrapes_it() {
    let site = Site::new();
    let (station, _, figures) = station(&site, "gate-prometheus", "");
    std::fs::copy(common::checkout("examples/web/alerts.yml"), site.path("alerts.yml")).expect("a file of the example");
    let port = common::s7::free_port();
    let config = std::fs::read_to_string(common::checkout("examples/web/prometheus.yml")).expect("a file");
    let config =
        config.replace("127.0.0.1:9464", &format!("127.0.0.1:{figures}")).replace("interval: 5s", "interval: 1s");
    site.write("prometheus.yml", &config);
    let mut prometheus = site.command("prometheus");
    prometheus
        .args(["--config.file=prometheus.yml", "--storage.tsdb.path=tsdb"])
        .arg(format!("--web.listen-address=127.0.0.1:{port}"))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null());
    // Ended by the cleanup of the site.
    let mut prometheus = prometheus.spawn().expect("prometheus, which `cargo xtask test` installs");
    let api =
        |path: &str| Visitor::at(port).try_get(path).filter(|a| a.status == 200).map(|a| a.json()["data"].clone());
    let value = |query: &str| -> Option<f64> {
        let found = api(&format!("/api/v1/query?query={query}"))?;
        found["result"][0]["value"][1].as_str()?.parse().ok()
    };
    station.until("it is scraped", |_| value("ob1_scans_total").filter(|scans| *scans > 0.0));
    let scans = value("ob1_scans_total").expect("scraped");
    assert!(scans <= station.status().scans as f64);
    assert_eq!(value("ob1_cpu_state%7Bob1_cpu_state=%22RUN%22%7D"), Some(1.0));
    station.until("buckets", |_| {
        let count = value("ob1_scan_execution_seconds_count")?;
        let infinite = value("ob1_scan_execution_seconds_bucket%7Ble=%22%2BInf%22%7D")?;
        (count > 0.0 && count == infinite).then_some(())
    });
    let kind = |name: &str| {
        let told = api(&format!("/api/v1/metadata?metric={name}")).expect("metadata");
        told[name][0]["type"].as_str().map(str::to_owned)
    };
    for (name, wanted) in [
        ("ob1_scans", "counter"),
        ("ob1_scan_execution_seconds", "histogram"),
        ("ob1_link_up", "gauge"),
        ("ob1_cpu_state", "stateset"),
        ("ob1_station", "info"),
    ] {
        assert_eq!(kind(name).as_deref(), Some(wanted), "{name}");
    }
    station.set("M 9.0", 1);
    station.until("STOP", |_| value("ob1_cpu_state%7Bob1_cpu_state=%22STOP%22%7D").filter(|is| *is == 1.0));
    let rules = api("/api/v1/rules").expect("rules");
    let names: Vec<&str> = rules["groups"][0]["rules"]
        .as_array()
        .map_or_else(Vec::new, |all| all.iter().filter_map(|rule| rule["name"].as_str()).collect());
    assert!(names.contains(&"CpuInStop") && names.len() >= 7, "{names:?}");
    let _ = prometheus.kill();
    let _ = prometheus.wait();
}

/// Telegrams on the lines of the CPs are shown at once; a link without the right to show everything shows none of them.
#[test]
fn telegrams_are_shown() {
    let site = Site::two_stations_on_a_cable();
    let port = common::s7::free_port();
    let limited = common::s7::free_port();
    let text = std::fs::read_to_string(site.path("station-a.toml")).expect("a station");
    let link = |name: &str, port: u16, keys: &str| {
        format!("\n[[link]]\ntype = \"web\"\nname = \"{name}\"\nlisten = \"127.0.0.1:{port}\"\n{keys}\n")
    };
    site.write("station-a.toml", &(text + &link("page", port, "") + &link("limited", limited, "areas = [\"M\"]")));
    let a = site.run("station-a.toml").until_run();
    let _b = site.run("station-b.toml").until_run();
    a.until("the page is served", |_| Visitor::at(port).try_get("/api/session"));
    let mut stream = Visitor::at(port).stream("?telegrams=1", "");
    // As in `ob1 trace`: control characters by their names, blocks with their user data.
    let (_, call) = stream.until("telegram", |told| told["what"] == "STX: connection request");
    assert!(call["ms"].as_u64().is_some_and(|ms| ms > 1 << 40) && call["hex"] == "", "{call}");
    for way in ["out", "in"] {
        let block =
            |told: &Value| told["way"] == way && told["what"].as_str().is_some_and(|w| w.starts_with("block, "));
        let (_, told) = stream.until("telegram", block);
        assert!(told["hex"].as_str().is_some_and(|hex| hex.len() > 2 && hex.len().is_multiple_of(2)), "{told}");
    }
    let mut stream = Visitor::at(limited).stream("?telegrams=1", "");
    let (_, none) = stream.next("telegram").expect("an answer");
    assert_eq!(none, json!({ "none": true }));
}
