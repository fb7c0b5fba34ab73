//! Modbus with foreign programs, on a pty: pymodbus (RTU and ASCII, both roles), minimalmodbus (RTU and ASCII, master),
//! libmodbus (RTU, slave) and mbpoll, which is libmodbus as a master; the loadable driver of the CP 341 with pymodbus
//! as slave. The scripts are in `tests/peers/modbus.py`.

use std::fs::{self, File};
use std::process::{Child, ChildStdin, Stdio};

use serde_json::Value;

use crate::common::processes::Watched;
use crate::common::site::{Site, replaced};
use crate::common::station::Running;
use crate::common::{checkout, python};

const LINE: &str = "modbus.pty";
const SCRIPT: &str = "tests/peers/modbus.py";

/// The stations of the manual's example; the tested one creates the pty.
fn station(site: &Site, role: &str, ascii: bool) -> Running {
    let folder = checkout("examples/modbus-manual");
    let (awl, toml) = (format!("{role}.awl"), format!("station-{role}.toml"));
    fs::copy(folder.join(&awl), site.path(&awl)).expect("a file of the example");
    let text = fs::read_to_string(folder.join(&toml)).expect("a file of the example");
    let text = replaced(&text, "watchdog = \"150ms\"", "watchdog = \"500ms\"").replace("serial:", "pty:");
    // A delay time long enough for a partner on a busy machine.
    let text = text.replace("wait_ms = 500", "wait_ms = 3000");
    site.write(&toml, &if ascii { replaced(&text, "-rtu", "-ascii") } else { text });
    let station = site.run(&toml).until_run();
    station.until("the pty", |_| site.path(LINE).exists().then_some(()));
    station
}

fn lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|why| panic!("{why}: {line}"))).collect()
}

/// A library's master reads everything from our slave.
fn slave_of(library: &str, ascii: bool) {
    let site = Site::new();
    let slave = station(&site, "slave", ascii);
    let inputs: [u32; 4] = [0x0123_4567, 0x89AB_CDEF, 0x5A5A_A5A5, 0x00FF_0F3C];
    for (n, word) in inputs.iter().enumerate() {
        slave.set(&format!("AD{}", 4 * n), i64::from(*word));
    }
    slave.scans(20);
    let mut command = site.command(python());
    command.arg(checkout(SCRIPT)).args(["master", library]).arg(site.path(LINE));
    command.args([
        "--mode",
        if ascii { "ascii" } else { "rtu" },
        "--timeout",
        if library == "minimalmodbus" { "1" } else { "3" },
    ]);
    command.args(["--inputs", &inputs.map(|word| format!("{word:08x}")).concat()]);
    let said = command.output().expect("the interpreter starts");
    let text = String::from_utf8_lossy(&said.stdout);
    assert!(said.status.success(), "{text}{}", String::from_utf8_lossy(&said.stderr));
    let steps = lines(&text);
    assert_eq!(steps.last().expect("steps")["done"], Value::from(steps.len() - 1), "{text}");
    // The CPU's values at the last complete read.
    let first = if library == "pymodbus" { 0xBEEF_A2A3 } else { 0xA0A1_8223 };
    let cells = slave.cells(&["ED0", "EW6"]);
    assert_eq!(cells[1], 0x1234);
    assert!(library != "pymodbus" || cells[0] == first, "{cells:X?}");
    assert_eq!(slave.interrupt().code(), Some(0));
}

#[test]
fn pymodbus_asks_our_slave_in_rtu() {
    slave_of("pymodbus", false);
}

#[test]
fn pymodbus_asks_our_slave_in_ascii() {
    slave_of("pymodbus", true);
}

#[test]
fn minimalmodbus_asks_our_slave_in_rtu() {
    slave_of("minimalmodbus", false);
}

#[test]
fn minimalmodbus_asks_our_slave_in_ascii() {
    slave_of("minimalmodbus", true);
}

/// mbpoll (libmodbus): checks its output.
#[test]
fn mbpoll_asks_our_slave() {
    let site = Site::new();
    let slave = station(&site, "slave", false);
    slave.set("AW2", 0x1234);
    slave.scans(20);
    let tty = site.path(LINE);
    let mbpoll = |args: &[&str], values: &[&str]| {
        let mut command = site.command("mbpoll");
        command.args(["-m", "rtu", "-a", "5", "-b", "19200", "-P", "none", "-o", "3", "-1", "-0"]);
        command.args(args).arg(&tty).args(values);
        let said = command.output().unwrap_or_else(|why| panic!("mbpoll: {why} (apt install mbpoll)"));
        let text = String::from_utf8_lossy(&said.stdout) + String::from_utf8_lossy(&said.stderr);
        (said.status.success(), text.into_owned())
    };
    let (good, text) = mbpoll(&["-t", "4", "-r", "0"], &["4660", "22136"]);
    assert!(good && text.contains("Written 2 references"), "{text}");
    let (good, text) = mbpoll(&["-t", "4:hex", "-r", "0", "-c", "8"], &[]);
    assert!(good && text.contains("[0]: \t0x1234") && text.contains("[1]: \t0x5678"), "{text}");
    let (good, text) = mbpoll(&["-t", "3:hex", "-r", "1", "-c", "1"], &[]);
    assert!(good && text.contains("[1]: \t0x1234"), "{text}");
    let (good, text) = mbpoll(&["-t", "0", "-r", "5"], &["1"]);
    assert!(good && text.contains("Written 1 references"), "{text}");
    let (good, text) = mbpoll(&["-t", "0", "-r", "5", "-c", "1"], &[]);
    assert!(good && text.contains("[5]: \t1"), "{text}");
    let (_, text) = mbpoll(&["-t", "4", "-r", "8", "-c", "1"], &[]);
    assert!(text.contains("Illegal data address"), "{text}");
    slave.until("the process image", |s| (s.cells(&["EW0", "EW2"]) == [0x1234 | 0x2000, 0x5678]).then_some(()));
    assert_eq!(slave.interrupt().code(), Some(0));
}

/// A library's slave.
struct Partner {
    process: Watched,
    child: Child,
    input: Option<ChildStdin>,
    out: std::path::PathBuf,
}

impl Partner {
    fn start(site: &Site, library: &str, ascii: bool) -> Self {
        let out = site.path("peer.out");
        let mut command = site.command(python());
        command.arg(checkout(SCRIPT)).args(["slave", library]).arg(site.path(LINE));
        command.args(["--mode", if ascii { "ascii" } else { "rtu" }]);
        command.stdin(Stdio::piped()).stdout(File::create(&out).expect("room for a file"));
        let mut child = command.spawn().expect("the interpreter starts");
        let process = Watched::find(child.id()).expect("a child, living or dead, is there until it is waited for");
        let input = child.stdin.take();
        Self { process, child, input, out }
    }

    fn is_ready(&self) -> bool {
        assert!(!self.process.has_ended(), "the partner has ended");
        fs::read_to_string(&self.out).unwrap_or_default().contains("ready")
    }

    /// Ends it; returns the values written to it.
    fn end(mut self) -> Value {
        drop(self.input.take());
        self.process.wait("the partner");
        assert!(self.child.wait().expect("a child that has ended").success());
        lines(&fs::read_to_string(&self.out).expect("its output")).pop().expect("what was written")
    }
}

/// One order of FC 0; returns the data of FC 1.
fn transact(master: &Running, request: &[u8]) -> Vec<u8> {
    for (n, byte) in request.iter().enumerate() {
        master.set(&format!("DB10.DBB{n}"), i64::from(*byte));
    }
    for (name, value) in [("MW12", request.len() as i64), ("MW22", 0), ("M1.0", 1)] {
        master.set(name, value);
    }
    let is_over = |m: &Running| m.cells(&["M1.0", "M3.0"]) == [0, 0] && (request[0] == 0 || m.cell("MW22") > 0);
    master.until("the answer", |m| is_over(m).then_some(()));
    let length = master.cell("MW22");
    (0..length).map(|n| master.cell(&format!("DB11.DBB{n}")) as u8).collect()
}

/// Our master reads from and writes to a library's slave.
fn master_of(library: &str, ascii: bool) {
    let site = Site::new();
    let master = station(&site, "master", ascii);
    let partner = Partner::start(&site, library, ascii);
    master.until("the partner", |_| partner.is_ready().then_some(()));
    let table: [(&[u8], &[u8]); 13] = [
        (&[5, 16, 0, 0, 0, 2, 4, 0xA0, 0xA1, 0xA2, 0xA3], &[5, 16, 0, 0, 0, 2]),
        (&[5, 6, 0, 2, 0x12, 0x34], &[5, 6, 0, 2, 0x12, 0x34]),
        (&[5, 3, 0, 0, 0, 3], &[5, 3, 6, 0xA0, 0xA1, 0xA2, 0xA3, 0x12, 0x34]),
        (&[5, 4, 0, 7, 0, 2], &[5, 4, 4, 0x10, 7, 0x10, 8]),
        (&[5, 5, 0, 3, 0xFF, 0], &[5, 5, 0, 3, 0xFF, 0]),
        (&[5, 15, 0, 8, 0, 10, 2, 0x55, 0x03], &[5, 15, 0, 8, 0, 10]),
        (&[5, 1, 0, 0, 0, 20], &[5, 1, 3, 0x08, 0x55, 0x03]),
        (&[5, 5, 0, 3, 0, 0], &[5, 5, 0, 3, 0, 0]),
        (&[5, 2, 0, 0, 0, 9], &[5, 2, 2, 0x49, 0]),
        (&[5, 3, 1, 0xFF, 0, 2], &[5, 0x83, 2]),
        (&[5, 5, 0, 3, 0xFF, 0], &[5, 5, 0, 3, 0xFF, 0]),
        // "Only write commands may be sent as broadcast", without waiting for an answer.
        (&[0, 6, 0, 4, 0xBE, 0xEF], &[]),
        (&[5, 3, 0, 4, 0, 1], &[5, 3, 2, 0xBE, 0xEF]),
    ];
    for (request, answer) in table {
        assert_eq!(transact(&master, request), answer, "{request:02X?}");
    }
    let written = partner.end();
    let words = |n: usize| written["words"][n].as_u64().expect("a word");
    assert_eq!([0, 1, 2, 3, 4].map(words), [0xA0A1, 0xA2A3, 0x1234, 0, 0xBEEF], "{written}");
    let bits: Vec<usize> = (0..64).filter(|n| written["bits"][*n] == true).collect();
    assert_eq!(bits, [3, 8, 10, 12, 14, 16, 17], "{written}");
    assert_eq!(master.interrupt().code(), Some(0));
}

#[test]
fn our_master_asks_pymodbus_in_rtu() {
    master_of("pymodbus", false);
}

#[test]
fn our_master_asks_pymodbus_in_ascii() {
    master_of("pymodbus", true);
}

#[test]
fn our_master_asks_libmodbus() {
    master_of("libmodbus", false);
}

/// The CP 341's example: the manual's program with its variable M 120.7. [S4 "8 Application Example"]
struct Cp341 {
    station: Running,
}

impl Cp341 {
    fn start(site: &Site) -> Self {
        let folder = checkout("examples/cp341-modbus-ascii");
        fs::copy(folder.join("modbus-ascii.awl"), site.path("modbus-ascii.awl")).expect("a file of the example");
        let text = fs::read_to_string(folder.join("station.toml")).expect("a file of the example");
        let text = replaced(&text, "watchdog = \"150ms\"", "watchdog = \"500ms\"");
        let text = replaced(&text, "pty:modbus-ascii.pty", &format!("pty:{LINE}"));
        // A time long enough for a partner on a busy machine.
        site.write("station.toml", &replaced(&text, "response_timeout_ms = 2000", "response_timeout_ms = 10000"));
        let station = site.run("station.toml").until_run();
        station.until("the pty", |_| site.path(LINE).exists().then_some(()));
        Self { station }
    }

    /// One job: returns the destination block, or the STATUS saved by the program.
    fn job(&self, source: &[u8]) -> Result<Vec<u8>, i64> {
        for (at, byte) in (10..).zip(source) {
            self.station.set(&format!("DB42.DBB{at}"), i64::from(*byte));
        }
        let counters = ["DB40.DBW6", "DB40.DBW8", "DB41.DBW6"];
        let before = self.station.cells(&counters);
        self.station.set("M120.7", 1);
        let done = |s: &Running| (s.cells(&counters)[..2] != before[..2]).then_some(());
        self.station.until("the end of the job", done);
        let after = self.station.cells(&counters);
        if after[1] != before[1] {
            return Err(self.station.cell("DB40.DBW14"));
        }
        let length = if after[2] == before[2] { 0 } else { self.station.cell("DB41.DBW4") };
        Ok((0..length).map(|n| self.station.cell(&format!("DB43.DBB{n}")) as u8).collect())
    }
}

/// The result of a job: the data in the receive block, or STATUS.
type Answer<'a> = Result<&'a [u8], i64>;

/// Every function code of pymodbus, through P_SND_RK and P_RCV_RK of the manual's program.
#[test]
fn the_cp_341_asks_pymodbus() {
    let site = Site::new();
    let cp = Cp341::start(&site);
    let partner = Partner::start(&site, "pymodbus", true);
    cp.station.until("the partner", |_| partner.is_ready().then_some(()));
    let table: [(&[u8], Answer<'_>); 18] = [
        (&[5, 16, 0, 0, 0, 2, 0xA0, 0xA1, 0xA2, 0xA3], Ok(&[])),
        (&[5, 6, 0, 2, 0x12, 0x34], Ok(&[])),
        (&[5, 3, 0, 0, 0, 3], Ok(&[0xA0, 0xA1, 0xA2, 0xA3, 0x12, 0x34])),
        (&[5, 4, 0, 7, 0, 2], Ok(&[0x10, 7, 0x10, 8])),
        (&[5, 5, 0, 3, 0xFF, 0], Ok(&[])),
        // The first eight coils are the low byte of the first word.
        (&[5, 15, 0, 8, 0, 10, 0x03, 0x55], Ok(&[])),
        (&[5, 1, 0, 0, 0, 20], Ok(&[0x55, 0x08, 0x00, 0x03])),
        (&[5, 2, 0, 0, 0, 9], Ok(&[0x00, 0x49])),
        (&[5, 8, 0, 0, 0xA5, 0xC3], Ok(&[])),
        (&[5, 7], Ok(&[0])),
        (&[5, 5, 0, 3, 0, 0], Ok(&[])),
        (&[5, 5, 0, 3, 0xFF, 0], Ok(&[])),
        // "Illegal data address"
        (&[5, 3, 1, 0xFF, 0, 2], Err(0x0E62)),
        // pymodbus has only 16-bit registers. [S4 L844]
        (&[5, 0x43, 0, 0, 0, 2], Err(0x0E52)),
        (&[0, 6, 0, 4, 0xBE, 0xEF], Ok(&[])),
        (&[5, 3, 0, 4, 0, 1], Ok(&[0xBE, 0xEF])),
        (&[5, 9], Err(0x0E42)),
        (&[0, 3, 0, 0, 0, 1], Err(0x0E43)),
    ];
    for (source, expected) in table {
        assert_eq!(cp.job(source), expected.map(<[u8]>::to_vec), "{source:02X?}");
    }
    let counter = cp.job(&[5, 11]).expect("status word and event counter");
    assert_eq!(counter.len(), 4, "{counter:02X?}");
    let log = cp.job(&[5, 12]).expect("three words and the events");
    assert!((6..=70).contains(&log.len()), "{log:02X?}");
    let written = partner.end();
    let words = |n: usize| written["words"][n].as_u64().expect("a word");
    assert_eq!([0, 1, 2, 3, 4].map(words), [0xA0A1, 0xA2A3, 0x1234, 0, 0xBEEF], "{written}");
    let bits: Vec<usize> = (0..64).filter(|n| written["bits"][*n] == true).collect();
    assert_eq!(bits, [3, 8, 10, 12, 14, 16, 17], "{written}");
    assert_eq!(cp.station.interrupt().code(), Some(0));
}
