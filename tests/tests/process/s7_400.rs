//! A station of family 400 with the SFB of S7 communication and SFC 62, with one of family 300: four areas in one job,
//! a BSEND with a length only possible on an S7-400, and the limits of AG_SEND and AG_RECV there.

use crate::common::checkout;
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;

/// A connection; passive without a partner.
fn connection(id: u16, kind: &str, partner: Option<u16>, local: &str, remote: &str) -> String {
    let active = partner.map_or(String::new(), |port| format!("active = true\npartner = \"127.0.0.1:{port}\"\n"));
    format!(
        "\n[[connection]]\nmodule = \"cp\"\nid = {id}\ntype = \"{kind}\"\n{active}local_tsap = \"{local}\"\nremote_tsap = \"{remote}\"\n"
    )
}

fn station(site: &Site, name: &str, family: u16, port: u16, connections: &[String]) -> Running {
    let source = std::fs::read_to_string(checkout("tests/fixtures/s7-400").join(format!("{name}.awl")));
    site.write(&format!("{name}.awl"), &source.expect("a fixture"));
    site.write(
        &format!("{name}.toml"),
        &format!(
            "[station]\nname = \"s7-400-{name}\"\n\n[cpu]\nfamily = {family}\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\n\n\
             [program]\nsources = [\"{name}.awl\"]\nmnemonics = \"de\"\n\n[[plugin]]\npath = \"ob1_cp343\"\n\n\
             [[link]]\ntype = \"s7\"\nname = \"ethernet\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"write\"\npdu = 240\n\n\
             [[module]]\ntype = \"cp343\"\nname = \"cp\"\naddress = 256\n{}",
            connections.concat()
        ),
    );
    site.run(&format!("{name}.toml")).until_run()
}

/// Station A of family 400, B of family 300.
fn pair(site: &Site) -> (Running, Running) {
    let (of_a, of_b) = (free_port(), free_port());
    let b = station(
        site,
        "b",
        300,
        of_b,
        &[
            connection(1, "s7", None, "10.02", "10.01"),
            connection(4, "iso-on-tcp", None, "SHORT-B", "SHORT-A"),
            connection(5, "iso-on-tcp", None, "LONG-B", "LONG-A"),
        ],
    );
    let a = station(
        site,
        "a",
        400,
        of_a,
        &[
            connection(1, "s7", Some(of_b), "10.01", "10.02"),
            connection(2, "s7", Some(of_a), "20.01", "20.02"),
            connection(3, "s7", None, "20.02", "20.01"),
            connection(4, "iso-on-tcp", Some(of_b), "SHORT-A", "SHORT-B"),
            connection(5, "iso-on-tcp", Some(of_b), "LONG-A", "LONG-B"),
        ],
    );
    (a, b)
}

/// Gives edges at this bit until the cells have the wanted values.
fn until_cells(station: &Running, (of, bit): (&Running, &str), cells: &[&str], wanted: &[i64]) {
    let what = format!("{bit} makes {cells:?} {wanted:?}");
    let mut on = false;
    station.until(&what, |station| {
        on = !on;
        of.set(bit, i64::from(on));
        (station.cells(cells) == wanted).then_some(())
    });
    of.set(bit, 0);
}

#[test]
fn four_areas_go_there_and_back() {
    let site = Site::new();
    let (a, b) = pair(&site);
    let source = ["DB1.DBW 0", "DB1.DBW 8", "MW 200", "DB1.DBW 20", "DB1.DBW 48", "DB1.DBW 60"];
    let values = [0x1111, 0x2222, 0x3333, 0x4444, 0x5555, 0x6666];
    source.iter().zip(values).for_each(|(cell, value)| a.set(cell, value));

    let there = ["DB20.DBW 0", "DB20.DBW 8", "MW 100", "DB20.DBW 20", "DB20.DBW 48", "DB20.DBW 60"];
    until_cells(&b, (&a, "M 10.0"), &there, &values);
    assert_eq!(b.cell("DB20.DBW 50"), 0, "behind the third area nothing was written");

    let back = |db: u16| [0, 8, 10, 20, 48, 60].map(|byte| format!("DB{db}.DBW {byte}"));
    let fetched = back(3);
    until_cells(&a, (&a, "M 11.0"), &fetched.each_ref().map(String::as_str), &values);

    let received = back(2);
    until_cells(&a, (&a, "M 10.1"), &received.each_ref().map(String::as_str), &values);

    // SFC 62: SFB 8 by its instance, SFB 14 as a multi-instance, a shared data block, an offset after the end, an
    // instance that was never called.
    a.until("CONTROL has asked", |a| (a.cells(&["M 42.1", "M 52.1"]) == [1, 1]).then_some(()));
    assert_eq!(a.cells(&["MW 40", "M 42.0", "MW 44", "MB 46", "MB 47"]), [0, 0, 0, 0x00, 1]);
    assert_eq!(a.cells(&["MW 50", "M 52.0", "MW 54", "MB 56", "MB 57"]), [0, 0, 0, 0x06, 1]);
    assert_eq!(a.cells(&["MW 60", "M 62.0", "MW 64", "MB 66", "M 62.1"]), [12, 1, 12, 0xFF, 0]);
    assert_eq!(a.cells(&["MW 70", "M 72.0", "MW 74", "MB 76", "M 72.1"]), [10, 1, 10, 0xFF, 0]);
    assert_eq!(a.cells(&["MW 110", "M 112.0", "MW 114", "MB 116", "MB 117"]), [0, 0, 0, 0x07, 0]);
    for station in [a, b] {
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

#[test]
fn a_long_bsend_and_the_limits_of_both_families() {
    let site = Site::new();
    let (a, b) = pair(&site);
    for (cell, value) in [("DB4.DBW 0", 0x1234), ("DB4.DBW 32768", 0x4321), ("DB4.DBW 65532", 0x7788)] {
        a.set(cell, value);
    }
    // LEN = 0: all 65534 bytes, which are more than 255 parts with this PDU and more than an S7-300 can send.
    until_cells(&b, (&a, "M 10.2"), &["DB5.DBW 0", "DB5.DBW 32768", "DB5.DBW 65532"], &[0x1234, 0x4321, 0x7788]);
    assert_eq!(b.cells(&["MW 16"]), [0xFFFE]);
    until_cells(&b, (&b, "M 10.0"), &["MW 32"], &[4]);
    b.set("MW 30", 1000);
    until_cells(&a, (&b, "M 10.0"), &["MW 34"], &[1000]);

    // AG_SEND sends 240 bytes on an S7-400, AG_LSEND more.
    a.set("MW 80", 241);
    until_cells(&a, (&a, "M 10.3"), &["MW 84"], &[0x8185]);
    a.set("MW 80", 240);
    until_cells(&b, (&a, "M 10.3"), &["MW 50"], &[240]);
    a.set("MW 86", 1000);
    until_cells(&b, (&a, "M 10.4"), &["MW 56"], &[1000]);
    // AG_RECV receives the same number there, AG_LRECV more.
    b.set("MW 40", 240);
    until_cells(&a, (&b, "M 10.1"), &["MW 94"], &[240]);
    b.set("MW 40", 241);
    until_cells(&a, (&b, "M 10.1"), &["MW 96"], &[0x8185]);
    until_cells(&a, (&b, "M 10.2"), &["MW 108"], &[1000]);
    for station in [a, b] {
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

/// An S7-300 does not have these blocks, although the plugin contains them.
#[test]
fn an_s7_300_does_not_have_them() {
    let site = Site::new();
    site.write(
        "p.awl",
        "DATA_BLOCK DB 1\nSTRUCT\n W : WORD;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nCALL SFC 62 (EN_R := TRUE, I_DB := DB 1, OFFSET := W#16#0, \
         RET_VAL := MW 0, ERROR := M 2.0, STATUS := MW 4, I_TYP := MB 6, I_STATE := MB 7, I_CONN := M 2.1, \
         I_STATUS := MW 8);\nEND_ORGANIZATION_BLOCK\n",
    );
    let check = |family: u16, library: &str, plugin: &str| {
        site.write(
            "p.toml",
            &format!("[station]\nname = \"p\"\n\n[cpu]\nfamily = {family}\n\n[program]\nsources = [\"p.awl\"]\n{library}\n{plugin}"),
        );
        let said = site.ob1(&["check", "p.toml"]);
        (said.code, said.err)
    };
    const PLUGIN: &str = "[[plugin]]\npath = \"ob1_cp343\"\n";
    let (code, told) = check(300, "", PLUGIN);
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("SFC 62 CONTROL is a block of an S7-400") && told.contains("FC 62 C_CNTRL"), "{told}");
    assert_eq!(check(400, "", PLUGIN).0, Some(0));
    // With the library they are available.
    assert_eq!(check(300, "libraries = [\"S7-400\"]", PLUGIN).0, Some(0));
    let (code, told) = check(400, "", "");
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("L020") && told.contains("CONTROL (S7-400:SFC62)"), "{told}");
}
