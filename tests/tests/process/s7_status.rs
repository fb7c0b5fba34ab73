//! Test functions of S7 communication with a running station: block status line by line beside `ob1 status`, variable
//! tables at points of the cycle. The addresses in the machine code are reckoned by hand.

use ob1_tests::s7_raw::Raw;
use serde_json::Value;

use crate::common::s7::free_port;
use crate::common::s7_tests::{enable, next, request, send, set_up, words};
use crate::common::site::Site;
use crate::common::station::Running;
use crate::common::wire::{Between, tshark};

const SOURCE: &str = "\
FUNCTION FC 5 : VOID
VAR_INPUT
  a : INT;
END_VAR
BEGIN
      L     #a;
      L     100;
      +I;
      SET;
END_FUNCTION
FUNCTION_BLOCK FB 20
VAR_INPUT
  start : BOOL;
END_VAR
BEGIN
NETWORK
      L     3;
n:    T     MW 20;
      L     MW 20;
      LOOP  n;
NETWORK
      U     #start;
      SPB   e;
      L     7;
e:    L     DB10.DBW 2;
      T     MW 22;
      CALL  FC 5 (a := MW 22);
END_FUNCTION_BLOCK
DATA_BLOCK DB 10
STRUCT
  a : INT;
  b : INT := 1234;
END_STRUCT
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 21
FB 20
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
      L     MW 40;
      T     MW 42;
      L     0;
      T     MW 40;
      SET;
      =     M 0.0;
      CALL FB 20, DB 21 (start := M 0.0);
END_ORGANIZATION_BLOCK
";

/// Address in the code of FB 20, its length left out, and the line of the source. `L 7` is jumped over.
const LINES: [(u16, usize); 11] =
    [(0, 17), (4, 18), (6, 19), (8, 20), (12, 22), (16, 23), (20, 24), (24, 0), (26, 25), (30, 26), (32, 27)];
/// All registers of the new form, and their bytes.
const ALL: u8 = 0x3F;
const ALL_BYTES: usize = 2 + 4 * 4 + 6;

fn station(site: &Site, engine: &str, rights: &str) -> (Running, u16) {
    let port = free_port();
    site.write("p.awl", SOURCE);
    site.write(
        "status.toml",
        &format!(
            "[station]\nname = \"status\"\n[cpu]\nmin_cycle = \"5ms\"\nengine = \"{engine}\"\n[program]\nsources = [\"p.awl\"]\n\
             [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"{rights}\"\n"
        ),
    );
    (site.run("status.toml").until_run(), port)
}

/// What `ob1 status` tells of a line of the source: bytes as in the telegram.
fn registers(pass: &Value, line: usize) -> Option<Vec<u8>> {
    let lines = pass["lines"].as_array().expect("lines");
    let registers = lines.iter().find(|one| one["line"] == line).expect("the line").get("registers")?;
    let number = |name: &str| registers[name].as_u64().expect("a number");
    let mut bytes = words(&[number("status") as u16]);
    for name in ["accu1", "accu2", "ar1", "ar2"] {
        bytes.extend_from_slice(&(number(name) as u32).to_be_bytes());
    }
    let blocks = ["db", "di"].map(|name| number(name) as u16);
    bytes.extend(blocks.map(|block| if block == 0 { 0 } else { 0x0A }));
    bytes.extend(words(&blocks));
    Some(bytes)
}

#[test]
fn block_status_is_what_ob1_status_tells() {
    for engine in ["reference", "native"] {
        let site = Site::new();
        let (running, port) = station(&site, engine, "read");
        let between = Between::listen(port);
        let mut raw = running.until("the link listens", |_| Raw::open(between.port).ok());
        let pass: Value =
            serde_json::from_str(&site.ob1(&["status", "status", "FB 20", "--once", "--json"]).fine()).expect("JSON");
        // In parts: a result fits a telegram.
        for lines in LINES.chunks(4) {
            let mut data = vec![0, lines.len() as u8, 0, 0];
            lines.iter().for_each(|(at, _)| data.extend_from_slice(&[0, *at as u8, 0, ALL]));
            let length = 2 + lines.len() * (2 + ALL_BYTES);
            let number = set_up(&mut raw, 0x13, &request(1, 0, length, 0x0600, &[0x0E, 20, 0, 60], &data));
            for _ in 0..2 {
                let result = enable(&mut raw, 0x13, number);
                let mut expected = Vec::new();
                for (at, line) in lines {
                    let seen = match line {
                        // `AUF DB 10` is a part of line 25: as behind line 23, with that data block.
                        0 => registers(&pass, 23).map(|mut bytes| {
                            bytes.splice(18.., [0x0A, 0x0A, 0, 10, 0, 21]);
                            bytes
                        }),
                        line => registers(&pass, *line),
                    };
                    expected.extend(seen.map(|seen| [words(&[*at]), seen].concat()));
                }
                let expected: Vec<u8> = [words(&[0]), expected.concat()].concat();
                let head = [words(&[4, expected.len() as u16]), vec![1, 0, 0, 1]].concat();
                assert_eq!(result, [head, expected].concat(), "{engine} {lines:?}");
            }
            send(&mut raw, 0x0F, &request(0, 1, 0, 0, &[], &[0, 1, 0x13, number]));
            assert_eq!(next(&mut raw).3, 0);
        }
        // No statement begins there; no such block; not called from there: it waits, and goes when it is deleted.
        let one = |at: u8| [0, 1, 0, 0, 0, at, 0, 1];
        send(&mut raw, 0x13, &request(1, 0, 6, 0x0600, &[0x0E, 20, 0, 60], &one(2)));
        assert_eq!(next(&mut raw).3, 0xD012);
        send(&mut raw, 0x13, &request(1, 0, 6, 0x0600, &[0x0E, 21, 0, 60], &one(0)));
        assert_eq!(next(&mut raw).3, 0xD011);
        let number = set_up(&mut raw, 0x13, &request(1, 0, 6, 0x0601, &[0x0E, 20, 0, 60, 2, 0x000A, 0, 22], &one(0)));
        send(&mut raw, 0x0E, &request(0, 1, 0, 0, &[], &[0x13, number]));
        assert_eq!(next(&mut raw).1, 0x0E);
        send(&mut raw, 0x0F, &request(0, 1, 0, 0, &[], &[0, 1, 0x13, number]));
        assert_eq!(next(&mut raw).1, 0x0F);
        let instance = request(0, 1, 6, 0x0601, &[0x0E, 20, 0, 60, 2, 0x000A, 0, 21], &one(0));
        assert_eq!(set_up(&mut raw, 0x13, &instance), number);
        assert_eq!(next(&mut raw).1, 0x13, "at once, and once");
        for (function, code) in [(3, 0xD081), (6, 0xD003), (8, 0xD0A1)] {
            let data = [0, 1, 1, 1, 0, 0, 0, 30, 0, 9, 0, 1, 5, 0];
            send(&mut raw, function, &request(0, 1, 4, 0, &[], &data));
            assert_eq!(next(&mut raw).3, code, "{function}");
        }
        drop(raw);
        assert_eq!(running.interrupt().code(), Some(0));
        let file = site.path("wire.pcap");
        between.write(&file);
        assert!(tshark(&file, "s7comm.param.userdata.funcgroup == 1 && tcp.srcport == 102").len() > 20);
        assert_eq!(tshark(&file, "_ws.malformed"), Vec::<String>::new());
    }
}

#[test]
fn a_variable_table_has_its_points() {
    let site = Site::new();
    let (running, port) = station(&site, "auto", "operate");
    let mut raw = running.until("the link listens", |_| Raw::open(port).ok());
    let word = |at: u8| [0x02, 1, 0, 0, 0, at];
    let values = |at: [u8; 2]| [&[0, 2][..], &word(at[0]), &word(at[1])].concat();
    let seen =
        |data: &[u8]| (data[7], [u16::from_be_bytes([data[14], data[15]]), u16::from_be_bytes([data[20], data[21]])]);
    let begin = set_up(&mut raw, 2, &request(1, 0, 14, 0x0200, &[], &values([40, 42])));
    let end = set_up(&mut raw, 2, &request(1, 0, 14, 0x0300, &[], &values([40, 42])));
    assert_eq!(seen(&enable(&mut raw, 2, begin)), (2, [0, 0]));
    // Written at the begin of each cycle: the program copies it, and clears it until the end.
    let modify = [&[0, 1][..], &word(40), &[0, 9, 0, 2, 0x12, 0x34]].concat();
    let permanent = set_up(&mut raw, 8, &request(2, 0, 4, 0x0200, &[], &modify));
    assert_eq!(next(&mut raw).4[8..], [0, 1, 0xFF, 0]);
    for _ in 0..20 {
        assert_eq!(seen(&enable(&mut raw, 2, end)), (2, [0, 0x1234]));
    }
    // The list has them all, and itself.
    send(&mut raw, 0x10, &request(0, 1, 0, 0, &[], &[0; 4]));
    let list = next(&mut raw).4;
    assert_eq!(list[8..], [2, begin, 0, 0, 2, end, 0, 0, 8, permanent, 0, 1, 0x10, permanent + 1, 0, 0]);
    // Gone with the connection.
    assert_eq!(running.cell("MW 42"), 0x1234);
    drop(raw);
    running.until("nothing is written any more", |running| (running.cell("MW 42") == 0).then_some(()));
    assert_eq!(running.interrupt().code(), Some(0));
}
