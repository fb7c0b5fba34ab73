//! The two stations of the example, each with a CP 343: PUT and GET, BSEND and BRCV, ISO on TCP and TCP; also while the
//! process of one CP is killed.

use std::io::Write as _;
use std::net::TcpStream;

use ob1_station::access::protocol::Op;
use ob1_tests::s7_raw::Raw;

use crate::common::checkout;
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;

/// The example on free ports.
fn stations(site: &Site) -> (Running, Running) {
    let ports = ["10201", "10202", "10204"].map(|port| (port, free_port().to_string()));
    for name in ["station-a.toml", "station-b.toml", "a.awl", "b.awl"] {
        let text = std::fs::read_to_string(checkout("examples/s7-pair").join(name)).expect("a file of the example");
        let text = ports.iter().fold(text, |text, (port, free)| text.replace(port, free));
        site.write(name, &text);
    }
    // B first, because A establishes the connections.
    let b = site.run("station-b.toml").until_run();
    (site.run("station-a.toml").until_run(), b)
}

/// The counters of A: PUT and GET, BSEND, ISO, TCP.
fn ledger(a: &Running) -> [i64; 4] {
    let cells = a.cells(&["DB10.DBD 0", "DB10.DBD 16", "DB10.DBD 24", "DB10.DBD 32"]);
    [cells[0], cells[1], cells[2], cells[3]]
}

fn until_more(a: &Running, what: &str, from: [i64; 4], count: i64) -> [i64; 4] {
    a.until(what, |a| {
        let now = ledger(a);
        now.iter().zip(from).all(|(now, before)| *now >= before + count).then_some(now)
    })
}

#[test]
fn everything_flows_and_survives_the_death_of_a_cp() {
    let site = Site::new();
    let (a, b) = stations(&site);
    let segment = std::fs::metadata(a.rundir.join("cp.segment")).expect("there").len();
    assert_eq!(segment, ob1_backplane::layout::SEGMENT_BYTES_BOXES as u64);
    let flowed = until_more(&a, "all four services work", [0; 4], 20);
    assert_eq!(a.cells(&["MW 34", "DB10.DBD 12"]), [2, 0], "C_STATUS, and numbers that were wrong");
    let received = b.cell("DB10.DBD 0");
    assert!(received >= 20, "BRCV has taken {received}");

    for (station, who) in [(&a, "active"), (&b, "passive")] {
        let before = ledger(&a);
        let scans = station.status().scans;
        let pid = station
            .status()
            .modules
            .into_iter()
            .find(|m| m.name == "cp")
            .and_then(|m| m.driver)
            .map(|d| d.pid)
            .expect("a process");
        rustix::process::kill_process(
            rustix::process::Pid::from_raw(pid as i32).expect("a number"),
            rustix::process::Signal::KILL,
        )
        .expect("it lives");
        until_more(&a, &format!("the {who} CP is back"), before, 20);
        assert!(station.status().scans > scans, "the scan has gone on");
    }
    let wrong = (a.cell("DB10.DBD 12"), b.cell("DB10.DBD 4"));
    assert_eq!(wrong, (0, 0), "no number was wrong, no BSEND was torn; {flowed:?}");
    assert_eq!(a.interrupt().code(), Some(0));
    assert_eq!(b.interrupt().code(), Some(0));
}

/// One side of USEND and URCV, and of UDP: sent telegrams have a rising number, received ones are counted if their last
/// word equals the first.
const BOTH_WAYS: &str = "
DATA_BLOCK DB 1
STRUCT
  D : ARRAY [0..99] OF WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 2
STRUCT
  D : ARRAY [0..99] OF WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 3
STRUCT
  D : ARRAY [0..99] OF WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 108
FB 8
BEGIN
END_DATA_BLOCK
DATA_BLOCK DB 109
FB 9
BEGIN
END_DATA_BLOCK

FUNCTION FC 20 : VOID
BEGIN
NETWORK
      L     MW 50;
      +     1;
      T     MW 50;
      T     DB1.DBW 0;
      T     DB1.DBW 198;
END_FUNCTION

ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [0..19] OF BYTE;
END_VAR
BEGIN
NETWORK
      UN    M 0.0;
      =     M 0.0;
CALL FB      8, DB 108
  REQ        :=M0.0
  ID         :=W#16#1
  R_ID       :=DW#16#ROUT
  DONE       :=M0.1
  ERROR      :=M0.2
  STATUS     :=MW2
  SD_1       :=P#DB1.DBX0.0 BYTE 200
CALL FB      9, DB 109
  EN_R       :=TRUE
  ID         :=W#16#1
  R_ID       :=DW#16#RIN
  NDR        :=M0.3
  ERROR      :=M0.4
  STATUS     :=MW4
  RD_1       :=P#DB2.DBX0.0 BYTE 200
      U     M 0.1;
      CC    FC 20;
NETWORK
      UN    M 0.3;
      SPB   UDP;
      L     DB2.DBW 0;
      L     DB2.DBW 198;
      <>I   ;
      SPB   TORN;
      L     MW 60;
      +     1;
      T     MW 60;
UDP:  CALL FC      5
  ACT        :=TRUE
  ID         :=2
  LADDR      :=W#16#100
  SEND       :=P#DB1.DBX0.0 BYTE 200
  LEN        :=200
  DONE       :=M1.1
  ERROR      :=M1.2
  STATUS     :=MW6
      CALL FC      6
  ID         :=2
  LADDR      :=W#16#100
  RECV       :=P#DB3.DBX0.0 BYTE 200
  NDR        :=M1.3
  ERROR      :=M1.4
  STATUS     :=MW8
  LEN        :=MW10
      UN    M 1.3;
      BEB   ;
      L     MW 10;
      L     200;
      <>I   ;
      SPB   TORN;
      L     DB3.DBW 0;
      L     DB3.DBW 198;
      <>I   ;
      SPB   TORN;
      L     MW 62;
      +     1;
      T     MW 62;
      BEA   ;
TORN: L     MW 64;
      +     1;
      T     MW 64;
END_ORGANIZATION_BLOCK
";

/// A station of such a pair.
fn one_of(site: &Site, name: &str, (mine, theirs): ([u16; 2], [u16; 2]), active: bool) -> Running {
    let (out, come) = if active { ("7", "8") } else { ("8", "7") };
    site.write(&format!("{name}.awl"), &BOTH_WAYS.replace("ROUT", out).replace("RIN", come));
    let (local, remote) = if active { ("10.01", "10.02") } else { ("10.02", "10.01") };
    let calls = if active { format!("active = true\npartner = \"127.0.0.1:{}\"\n", theirs[0]) } else { String::new() };
    site.write(
        &format!("{name}.toml"),
        &format!(
            "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\n\n[program]\n\
             sources = [\"{name}.awl\"]\nmnemonics = \"de\"\n\n[[plugin]]\npath = \"ob1_cp343\"\n\n\
             [[link]]\ntype = \"s7\"\nname = \"ethernet\"\nlisten = \"127.0.0.1:{}\"\n\n\
             [[module]]\ntype = \"cp343\"\nname = \"cp\"\naddress = 256\n\n\
             [[connection]]\nmodule = \"cp\"\nid = 1\ntype = \"s7\"\n{calls}local_tsap = \"{local}\"\nremote_tsap = \"{remote}\"\n\n\
             [[connection]]\nmodule = \"cp\"\nid = 2\ntype = \"udp\"\nlocal_port = {}\npartner = \"127.0.0.1:{}\"\n",
            mine[0], mine[1], theirs[1]
        ),
    );
    site.run(&format!("{name}.toml")).until_run()
}

#[test]
fn usend_and_udp_go_both_ways() {
    let site = Site::new();
    let (mine, theirs) = ([free_port(), free_port()], [free_port(), free_port()]);
    let b = one_of(&site, "both-b", (theirs, mine), false);
    let a = one_of(&site, "both-a", (mine, theirs), true);
    for station in [&a, &b] {
        station.until("USEND and UDP bring numbers", |station| {
            let cells = station.cells(&["MW 60", "MW 62"]);
            (cells[0] > 20 && cells[1] > 20).then_some(())
        });
    }
    for station in [&a, &b] {
        let connections = station.until("the connections are told", |station| {
            let links = station.ask(Op::Links).expect("never refused").links.expect("an answer to links");
            let list = links.into_iter().find(|link| link.name == "ethernet").expect("a link").connections;
            list.iter().any(|one| one.jobs > 0).then_some(list)
        });
        let told: Vec<_> = connections.iter().map(|one| (one.name.as_str(), one.state.as_str())).collect();
        assert_eq!(told, [("ID 1 s7", "up"), ("ID 2 udp", "up")]);
        assert!(connections[0].pdu >= 240, "{connections:?}");
    }
    for station in [a, b] {
        assert_eq!(station.cell("MW 64"), 0, "what came was whole");
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

/// The TSAP of a connection takes no calls of others; they are not served by the CPU instead.
#[test]
fn a_call_of_another_partner_is_refused() {
    let (site, port) = (Site::new(), free_port());
    site.write("none.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n      NOP   0;\nEND_ORGANIZATION_BLOCK\n");
    site.write(
        "waits.toml",
        &format!(
            "[station]\nname = \"waits\"\n\n[program]\nsources = [\"none.awl\"]\n\n[[link]]\ntype = \"s7\"\n\
             name = \"ethernet\"\nlisten = \"127.0.0.1:{port}\"\n\n[[module]]\ntype = \"cp343\"\nname = \"cp\"\n\
             address = 256\n\n[[connection]]\nmodule = \"cp\"\nid = 1\ntype = \"iso-on-tcp\"\n\
             local_tsap = \"ISO-B\"\nremote_tsap = \"ISO-A\"\n"
        ),
    );
    let station = site.run("waits.toml").until_run();
    let call = |calling: &[u8; 5]| {
        let stream = station.until("the CP listens", |_| TcpStream::connect(("127.0.0.1", port)).ok());
        Raw(stream).call(&[(0xC1, calling), (0xC2, b"ISO-B")]).expect("an answer")
    };
    assert_eq!([b"ISO-A", b"ISO-X"].map(call), [0xD0, 0x80]);
    assert_eq!(station.interrupt().code(), Some(0));
}

/// A partner that sends and closes relies on the delivery of what it has sent (RFC 9293, 3.6), also if the program
/// takes it slowly and the partner has called again meanwhile.
#[test]
fn what_came_before_the_partner_closed_is_received() {
    let (site, port, tcp) = (Site::new(), free_port(), free_port());
    site.write(
        "takes.awl",
        "DATA_BLOCK DB 3\nSTRUCT\n  D : ARRAY [0..49] OF WORD;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n  INFO : ARRAY [0..19] OF BYTE;\nEND_VAR\nBEGIN\nNETWORK\n\
         CALL FC 6\n  ID := 1\n  LADDR := W#16#100\n  RECV := P#DB3.DBX0.0 BYTE 100\n  NDR := M1.3\n  ERROR := M1.4\n\
         \x20 STATUS := MW8\n  LEN := MW10\n\
         \x20     UN    M 1.3;\n      BEB   ;\n      L     MW 62;\n      +     1;\n      T     MW 62;\n\
         \x20     L     MW 64;\n      L     DB3.DBW 0;\n      +I    ;\n      T     MW 64;\nEND_ORGANIZATION_BLOCK\n",
    );
    site.write(
        "takes.toml",
        &format!(
            "[station]\nname = \"takes\"\n\n[cpu]\nmin_cycle = \"20ms\"\n\n[program]\nsources = [\"takes.awl\"]\n\
             mnemonics = \"de\"\n\n[[plugin]]\npath = \"ob1_cp343\"\n\n[[link]]\ntype = \"s7\"\nname = \"ethernet\"\n\
             listen = \"127.0.0.1:{port}\"\n\n[[module]]\ntype = \"cp343\"\nname = \"cp\"\naddress = 256\n\n\
             [[connection]]\nmodule = \"cp\"\nid = 1\ntype = \"tcp\"\nlocal_port = {tcp}\n"
        ),
    );
    let station = site.run("takes.toml").until_run();
    for _ in 0..3 {
        let mut stream = station.until("the CP listens", |_| TcpStream::connect(("127.0.0.1", tcp)).ok());
        for number in 1..=5 {
            let mut telegram = [0; 100];
            telegram[1] = number;
            stream.write_all(&telegram).expect("sent");
        }
    }
    station.until("all has come", |station| (station.cells(&["MW 62", "MW 64"]) == [15, 45]).then_some(()));
    assert_eq!(station.interrupt().code(), Some(0));
}
