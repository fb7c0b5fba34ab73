//! The printer driver of a CP 340 and a CP 341 in virtual time: STL program with P_PRINT (P_PRT341), the CP, and a
//! printer on its line that records every byte. [TIA help "PtP data link CP 341"], `docs/cp340-printer.md`

use std::fs;

use ob1_cpu::{Cell, Width};
use ob1_tests::sim::device::{Bench, Device};
use ob1_tests::sim::{MS, SECOND};
use ob1_time::{Instant, Span};

use crate::common;
use crate::common::cp341::data_block;

const XON: u8 = 0x11;
const XOFF: u8 = 0x13;

const KINDS: [&str; 2] = ["cp340", "cp341"];

/// Format string, variables, printed text, STATUS.
type Misprint<'a> = (&'a [u8], &'a [&'a [u8]], &'a [u8], u16);

/// A printer that records its data; with XON/XOFF it stops the CP after a number of bytes.
#[derive(Default)]
struct Paper {
    bytes: Vec<u8>,
    stops_after: Option<usize>,
}

impl Device for Paper {
    fn hear(&mut self, _: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        for byte in bytes.iter().filter(|byte| ![XON, XOFF].contains(*byte)) {
            self.bytes.push(*byte);
            if self.stops_after == Some(self.bytes.len()) {
                out.push(XOFF);
            }
        }
        None
    }
}

/// DB 50: pointers from byte 2 on; DB 51: variables; DB 52: format string. DB 60: parameters of the block.
fn program(block: u16) -> String {
    let code = format!(
        "ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n  INFO : ARRAY [1..20] OF BYTE;\nEND_VAR\nBEGIN\n\
         CALL FB {block}, DB 8\n  REQ := DB60.DBX 0.0\n  R := DB60.DBX 0.1\n  LADDR := 256\n  DB_NO := DB60.DBW 6\n  \
         DBB_NO := DB60.DBW 2\n  DONE := DB60.DBX 1.0\n  ERROR := DB60.DBX 1.1\n  STATUS := DB60.DBW 4\n\
         END_ORGANIZATION_BLOCK\n\n\
         ORGANIZATION_BLOCK OB 121\nVAR_TEMP\n  INFO : ARRAY [1..20] OF BYTE;\nEND_VAR\nBEGIN\nEND_ORGANIZATION_BLOCK\n\n\
         DATA_BLOCK DB 8\nFB {block}\nBEGIN\nEND_DATA_BLOCK\n"
    );
    code + &[(50, 32), (51, 200), (52, 200), (60, 8)].map(|(db, bytes)| data_block(db, bytes)).concat()
}

struct Site {
    bench: Bench<Paper>,
    ends: Vec<u16>,
}

impl Site {
    fn new(kind: &str, params: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let block = if kind == "cp340" { 4 } else { 13 };
        fs::write(folder.path().join("print.awl"), program(block)).expect("the program");
        let file = format!(
            "[station]\nname = \"print\"\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"500ms\"\n\
             [program]\nsources = [\"print.awl\"]\nmnemonics = \"de\"\n[[plugin]]\npath = \"ob1_{kind}\"\n\
             [[module]]\ntype = \"{kind}\"\nname = \"cp\"\naddress = 256\nline = \"pty:printer\"\n[module.params]\n{params}\n"
        );
        let path = folder.path().join("station.toml");
        fs::write(&path, file).expect("the station file");
        let bench = Bench::build(&path, Paper::default(), 1);
        let bench = bench.unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"));
        let mut site = Self { bench, ends: Vec::new() };
        site.word(60, 6, 50);
        site.word(60, 2, 2);
        site.pass(SECOND);
        site
    }

    fn printer(kind: &str, more: &str) -> Self {
        Self::new(kind, &format!("protocol = \"printer\"\nleft_margin = 0\n{more}"))
    }

    fn put(&mut self, db: u16, at: u32, bytes: &[u8]) {
        for (at, byte) in (at..).zip(bytes) {
            self.bench.station.cpu.write(Cell::Db(db, 8 * at), Width::Byte, u32::from(*byte)).expect("a cell");
        }
    }

    fn word(&mut self, db: u16, at: u32, word: u16) {
        self.put(db, at, &word.to_be_bytes());
    }

    /// Writes pointers, variables and format string.
    fn prepare(&mut self, format: &[u8], variables: &[&[u8]]) {
        let mut at = 1;
        for place in 0..4 {
            let variable = variables.get(place).copied().unwrap_or_default();
            self.put(51, at, variable);
            let pointer = 2 + 6 * place as u32;
            self.word(50, pointer, if variable.is_empty() { 0 } else { 51 });
            self.word(50, pointer + 2, at as u16);
            self.word(50, pointer + 4, variable.len() as u16);
            at += variable.len() as u32;
        }
        self.put(52, 3, format);
        self.word(50, 26, 52);
        self.word(50, 28, 3);
        self.word(50, 30, format.len() as u16);
    }

    fn pass(&mut self, time: Span) {
        let Self { bench, ends } = self;
        bench.until(time, |station| {
            let block = station.cpu.data_block(60).expect("DB 60");
            let status = u16::from_be_bytes([block[4], block[5]]);
            assert_eq!(status != 0, block[1] & 2 != 0, "STATUS goes with ERROR");
            if block[1] & 3 != 0 {
                ends.push(status);
            }
            false
        });
    }

    /// Gives an edge of REQ and waits for the end of the job.
    fn run(&mut self) -> u16 {
        self.put(60, 0, &[1]);
        self.pass(2 * MS);
        self.put(60, 0, &[0]);
        self.pass(2 * MS);
        for _ in 0..3000 {
            if let Some(status) = self.ends.pop() {
                assert!(self.ends.is_empty(), "one end");
                return status;
            }
            self.pass(10 * MS);
        }
        panic!("it does not end\n{}", self.bench.log());
    }

    /// Executes a job; returns the printed bytes and STATUS.
    fn print(&mut self, format: &[u8], variables: &[&[u8]]) -> (Vec<u8>, u16) {
        self.prepare(format, variables);
        let status = self.run();
        (std::mem::take(&mut self.bench.device.bytes), status)
    }
}

/// The manual's examples. [CP 341 manual 09/2008, p. 76]
#[test]
fn message_texts_variables_and_control_characters() {
    for kind in KINDS {
        let texts = "emulation = \"ibm\"\ntexts = '''\n17 \\BThe pressure in the chamber\\b\n'''\n";
        let mut site = Site::printer(kind, texts);
        let time = 63_000_000_u32.to_be_bytes();
        let printed = site.print(b"The level %i l was reached at %Z hours.", &[&200_i16.to_be_bytes(), &time]);
        assert_eq!(printed, (b"The level 200 l was reached at 17:30:00.000 hours.\r\n".to_vec(), 0), "{kind}");
        let printed = site.print(b"%N %S", &[&17_u16.to_be_bytes(), b"\x0A\x0Ais falling"]);
        assert_eq!(printed, (b"\x1BEThe pressure in the chamber\x1BF is falling\r\n".to_vec(), 0), "{kind}");
        assert_eq!(site.print(b"%P", &[&10_u16.to_be_bytes()]), (vec![], 0), "{kind}");
        assert_eq!(site.print(b"\\x", &[]), (vec![], 0), "{kind}");
        // DONE comes with the last bit, when everything is printed.
        let longest = [b'#'; 150];
        let four: [&[u8]; 4] = [&[b'1'; 25]; 4];
        let printed = site.print(&[&longest[..142], b"%C%C%C%C"].concat(), &four);
        assert_eq!(printed, ([&longest[..142], &[b'1'; 100], b"\r\n"].concat(), 0), "{kind}");
    }
}

/// Errors are printed as asterisks and reported in STATUS and in the diagnostic buffer.
#[test]
fn a_misprint_is_printed_and_told() {
    for kind in KINDS {
        let mut site = Site::printer(kind, "texts = '1 a'\n");
        let two = &10_i16.to_be_bytes()[..];
        let table: [Misprint<'_>; 10] = [
            (b"%N", &[&9_u16.to_be_bytes()], b"******\r\n", 0x0506),
            (b"%I %I", &[two], b"10 \r\n", 0x0508),
            (b"a", &[two], b"a\r\n", 0x0509),
            (b"%Qb", &[two], b"******b\r\n", 0x050A),
            (b"a\\Q", &[], b"a\r\n", 0x050B),
            (b"%Z", &[&[0xFF; 4]], b"************\r\n", 0x050C),
            (b"%1I", &[two], b"*\r\n", 0x050D),
            (b"%.3D", &[two], b"**********\r\n", 0x051B),
            (b"%F", &[two], b"********\r\n", 0x051C),
            (&[b'\n'; 51], &[], b"", 0x051E),
        ];
        for (format, variables, paper, status) in table {
            assert_eq!(site.print(format, variables), (paper.to_vec(), status), "{kind} {format:02X?}");
            assert_eq!(site.bench.entries().last(), Some(&status), "{kind}");
        }
        assert_eq!(site.print(b"%200C%60C", &[two, two]), (vec![], 0x0507), "{kind}");
        assert_eq!(site.print(b"good", &[]), (b"good\r\n".to_vec(), 0), "{kind}");
        let mut site = Site::printer(kind, "");
        assert_eq!(site.print(b"%N", &[two]), (b"******\r\n".to_vec(), 0x0505), "{kind}");
    }
}

/// Invalid pointers: nothing is printed. (docs/cp341-events.md)
#[test]
fn wrong_pointers() {
    for kind in KINDS {
        let mut site = Site::printer(kind, "");
        let length = if kind == "cp340" { 0x1E41 } else { 0x1E42 };
        let variable: &[u8] = b"0123456789012345678901234567890123";
        for (at, value, status) in [
            (26, 0, 0x1E43),
            (30, 151, length),
            (30, 0, length),
            (6, 33, length),
            (6, 0, length),
            // The program continues after OB 121.
            (26, 99, 0x0301),
            (28, 190, 0x0301),
            (2, 99, 0x0301),
        ] {
            site.prepare(b"%C and so on", &[&variable[..32]]);
            site.word(50, at, value);
            assert_eq!(site.run(), status, "{kind} {at} {value}");
            assert!(site.bench.device.bytes.is_empty(), "{kind} {at} {value}");
        }
        for (db, at) in [(99, 2), (50, 3), (50, 8163), (50, 0xFFFF)] {
            site.prepare(b"x", &[]);
            site.word(60, 6, db);
            site.word(60, 2, at);
            assert_eq!(site.run(), 0x0301, "{kind} DB {db} byte {at}");
            site.word(60, 6, 50);
            site.word(60, 2, 2);
        }
        assert_eq!(site.print(b"%C", &[&variable[..32]]), ([&variable[..32], b"\r\n"].concat(), 0));
    }
}

/// P_PRINT works only with the printer driver. (0502h)
#[test]
fn other_protocols_do_not_print() {
    for kind in KINDS {
        let mut site = Site::new(kind, "protocol = \"ascii\"");
        assert_eq!(site.print(b"x", &[]), (vec![], 0x0502), "{kind}");
    }
}

/// XOFF stops the data, XON continues them; a wait that is too long ends with 0708h.
#[test]
fn flow_control() {
    for kind in KINDS {
        let mut site = Site::printer(kind, "flow = \"xon-xoff\"\nflow_wait_ms = 2000\n");
        site.bench.device.stops_after = Some(20);
        site.prepare(&[b'x'; 150], &[]);
        site.put(60, 0, &[1]);
        site.pass(SECOND);
        let held = site.bench.device.bytes.len();
        assert!((20..60).contains(&held), "{kind}: {held} bytes, some were on their way");
        assert!(site.ends.is_empty(), "{kind}");
        site.bench.device.stops_after = None;
        site.bench.meanwhile(|_, _, out| {
            out.extend(b"ignored\x11");
            None
        });
        site.put(60, 0, &[0]);
        site.pass(SECOND);
        assert_eq!((site.bench.device.bytes.len(), std::mem::take(&mut site.ends)), (152, vec![0]), "{kind}");
        site.bench.device.bytes.clear();
        site.bench.device.stops_after = Some(20);
        assert_eq!(site.run(), 0x0708, "{kind}");
        // Other characters of a printer are ignored.
        assert!(!site.bench.entries().iter().any(|entry| entry >> 8 == 8), "{:04X?}", site.bench.entries());
    }
}

/// R = 1 ends the job of the block; data already in the CP are printed nevertheless.
#[test]
fn a_reset_ends_the_job() {
    let mut site = Site::printer("cp340", "");
    site.prepare(&[b'y'; 100], &[]);
    site.put(60, 0, &[1]);
    site.pass(20 * MS);
    site.put(60, 0, &[2]);
    site.pass(10 * MS);
    assert_eq!(std::mem::take(&mut site.ends), [0x1E0D]);
    site.put(60, 0, &[0]);
    site.pass(SECOND);
    assert_eq!((site.bench.device.bytes.len(), site.ends.len()), (102, 0));
}

/// A page with margin, header, footer and form feed.
#[test]
fn a_page() {
    let layout = "lines_per_page = 4\nheader_1 = 'page %P'\nfooter_1 = 'shift 1'\nleft_margin = 1\n";
    let mut site = Site::new("cp340", &format!("protocol = \"printer\"\n{layout}"));
    assert_eq!(site.print(b"one", &[]).0, b" page 1\r\n one\r\n");
    assert_eq!(site.print(b"two", &[]).0, b" two\r\n shift 1\r\n\x0C");
    assert_eq!(site.print(b"three", &[]).0, b" page 2\r\n three\r\n");
    assert_eq!(site.print(b"\\F", &[]).0, b"\r\n shift 1\r\n\x0C");
}

/// The line fails while printing: the job ends with an error.
#[test]
fn a_line_that_goes() {
    let mut site = Site::printer("cp340", "");
    site.prepare(&[b'z'; 150], &[]);
    site.put(60, 0, &[1]);
    site.pass(60 * MS);
    site.bench.fault(ob1_firmware::LineFault::Gone);
    site.pass(SECOND);
    assert_eq!(site.ends, [0x0708]);
}

/// `examples/cp340-printer`: the output is exactly that in its README.
#[test]
fn the_example_prints_its_log() {
    let station = common::pair::example("cp340-printer").join("station.toml");
    let bench = Bench::build(&station, Paper::default(), 1);
    let mut bench = bench.unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"));
    bench.pass(SECOND);
    let header = b"    Boiler house, log                                        page 1\r\n";
    let first = b"    17:30:00.000  \x1BEStart of the shift\x1BF all is well \r\n";
    assert_eq!(bench.device.bytes, [&header[..], first].concat());
    bench.device.bytes.clear();
    for (message, text) in [(17, &b"\x14\x0Ais falling"[..]), (18, b"\x14\x04full"), (19, b"\x14\x00")] {
        let cpu = &mut bench.station.cpu;
        cpu.write(Cell::Db(51, 0), Width::Word, message).expect("DB 51");
        for (at, byte) in (2..).zip(text) {
            cpu.write(Cell::Db(51, 8 * at), Width::Byte, u32::from(*byte)).expect("DB 51");
        }
        cpu.write(Cell::Area(ob1_model::Area::Memory, 80), Width::Bit, 1).expect("M 10.0");
        bench.pass(SECOND);
    }
    let lines = [
        &b"    17:30:00.000  The pressure in the chamber is falling  \r\n"[..],
        // Message text 18 has its own conversion statement, for which no variable is left.
        b"    17:30:00.000  The level is  l full        \r\n",
        b"    17:30:00.000  ******             \r\n",
    ];
    assert_eq!(String::from_utf8_lossy(&bench.device.bytes), String::from_utf8_lossy(&lines.concat()));
    let ledger = [0, 4].map(|byte| bench.station.ledger(20, byte));
    assert_eq!(ledger, [2, 2], "printed and told: 0508h and 0506h");
}
