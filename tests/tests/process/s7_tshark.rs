//! Wireshark's dissectors can read all telegrams of the S7 link.

use serde_json::json;

use crate::common;
use crate::common::s7::{Client, station};
use crate::common::site::Site;
use crate::common::wire::{Between, tshark};

#[test]
fn no_answer_is_malformed() {
    let site = Site::new();
    let (station, port) =
        station(&site, "s7-tshark", "rights = \"operate\"\npassword = \"secret\"\npassword_rights = \"operate\"");
    let between = Between::listen(port);
    for name in ["native", "pure"] {
        let mut client = Client::start(&site, name, between.port);
        for (area, at, bytes) in [("DB", 0, 30), ("M", 20, 3), ("PE", 0, 4), ("PA", 0, 1), ("T", 3, 1), ("C", 4, 1)] {
            client.done(&json!({ "op": "read", "area": area, "db": 10, "at": at, "bytes": bytes }));
        }
        client.done(&json!({ "op": "write", "db": 10, "at": 41, "hex": "010203" }));
        client.done(&json!({ "op": "bit", "area": "M", "at": 30, "bit": 5, "value": true }));
        client.done(&json!({ "op": "multi", "items": [["DB", 10, 0, 2], ["DB", 10, 3, 1], ["M", 0, 20, 5]] }));
        // Refusals are also well-formed.
        assert_eq!(client.ask(&json!({ "op": "read", "db": 99, "at": 0, "bytes": 2 }))["ok"], false);
        for (id, index) in [(0x0000, 0), (0x0011, 0), (0x001C, 0), (0x0131, 1), (0x0232, 4), (0x0424, 0), (0x00A0, 0)] {
            client.done(&json!({ "op": "szl", "id": id, "index": index }));
        }
        assert_eq!(client.ask(&json!({ "op": "szl", "id": 0x0999, "index": 0 }))["ok"], false);
        client.done(&json!({ "op": "counts" }));
        client.done(&json!({ "op": "list", "type": "DB" }));
        client.done(&json!({ "op": "clock", "value": "2030-01-02T03:04:05" }));
        let block = client.done(&json!({ "op": "upload", "type": "OB", "number": 1 }))["hex"].clone();
        client.done(&json!({ "op": "login", "password": "secret" }));
        client.done(&json!({ "op": "stop" }));
        if name == "native" {
            client.done(&json!({ "op": "download", "hex": block }));
        }
        assert_eq!(client.ask(&json!({ "op": "delete", "type": "FC", "number": 999 }))["ok"], false);
        client.done(&json!({ "op": "warm" }));
    }
    let mut nodes7 = Client::start(&site, "nodes7", between.port);
    nodes7.done(&json!({ "op": "read", "items": { "n": "DB10,INT0", "t": "DB10,S8.20" } }));
    drop(nodes7);
    let file = site.path("wire.pcap");
    assert_eq!(station.interrupt().code(), Some(0));
    between.write(&file);
    let answers = tshark(&file, "s7comm && tcp.srcport == 102");
    assert!(answers.len() > 50, "{} answers were found", answers.len());
    let malformed = tshark(&file, "tcp.srcport == 102 && _ws.malformed");
    assert!(malformed.is_empty(), "{malformed:#?}");
    // Every packet of ours is completely ISO on TCP.
    let strange = tshark(&file, "tcp.srcport == 102 && !tpkt");
    assert!(strange.is_empty(), "{strange:#?}");
}

/// tshark detects errors.
#[test]
fn a_damaged_answer_is_found_malformed() {
    use std::io::{Read as _, Write as _};
    let site = Site::new();
    let server = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let between = Between::listen(server.local_addr().expect("an address").port());
    let mut client = std::net::TcpStream::connect(("127.0.0.1", between.port)).expect("a connection");
    let (mut accepted, _) = server.accept().expect("a connection");
    // A read, and an answer that claims more data than it contains.
    let job = ob1_tests::s7_raw::read_job(1, 0, 2);
    client.write_all(&job).expect("sent");
    accepted.read_exact(&mut vec![0; job.len()]).expect("it comes");
    let answer = [3, 0, 0, 27, 2, 0xF0, 0x80, 0x32, 3, 0, 0, 0, 1, 0, 2, 0, 6, 0, 0, 4, 1, 0xFF, 4, 0, 0x80, 1, 2];
    accepted.write_all(&answer).expect("sent");
    drop(accepted);
    client.read_to_end(&mut Vec::new()).expect("its end");
    drop(client);
    let file = site.path("wire.pcap");
    between.write(&file);
    assert_eq!(tshark(&file, "_ws.malformed").len(), 1);
}

/// The output of `ob1 trace` for a link, as text and for Wireshark.
#[test]
fn a_trace_shows_telegrams() {
    let site = Site::new();
    let (station, port) = station(&site, "s7-traced", "rights = \"read\"");
    let mut command = site.command(common::program("ob1"));
    command.args(["trace", "s7-traced", "panel", "--pcapng", "s7.pcapng", "--record", "s7.trace"]);
    let output = std::fs::File::create(site.path("trace.txt")).expect("a file");
    let mut tracing = command.stdout(output).spawn().expect("ob1 starts");
    let mut client = Client::start(&site, "native", port);
    // The tap accepts listeners after a short time.
    station.until("telegrams are told", |_| {
        client.done(&json!({ "op": "read", "db": 10, "at": 0, "bytes": 2 }));
        let text = std::fs::read_to_string(site.path("trace.txt")).ok()?;
        (text.contains("panel < 127.0.0.1:") && text.contains("read, 1 items") && text.matches("panel > ").count() > 3)
            .then_some(())
    });
    drop(client);
    assert_eq!(station.interrupt().code(), Some(0));
    assert!(tracing.wait().expect("it ends with the link").success());
    let file = site.path("s7.pcapng");
    assert!(!tshark(&file, "s7comm && tcp.srcport == 102").is_empty());
    assert!(tshark(&file, "_ws.malformed").is_empty());
    let again = site.ob1(&["trace", "--from", "s7.trace"]);
    assert_eq!(again.out, std::fs::read_to_string(site.path("trace.txt")).expect("a file"));
}
