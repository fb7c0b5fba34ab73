//! The handling blocks of the CP 240 in a whole station, in virtual time, with a partner controlled by the test: the
//! error reports for the program.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};

use ob1_cpu::{Cell, Width};
use ob1_firmware::LineFault;
use ob1_model::Area;
use ob1_tests::sim::device::{Bench, Device};
use ob1_tests::sim::{MS, SECOND};
use ob1_time::Instant;

const STX: u8 = 0x02;
const ETX: u8 = 0x03;
const DLE: u8 = 0x10;

/// A partner on the line: with 3964R it acknowledges received blocks and sends its own; with other protocols it only
/// receives.
#[derive(Default)]
pub(crate) struct Partner {
    is_3964r: bool,
    /// All received characters.
    pub(crate) heard: Vec<u8>,
    /// 3964R: start of the telegram being received.
    pub(crate) from: Option<usize>,
    pub(crate) telegrams: Vec<Vec<u8>>,
    blocks: VecDeque<Vec<u8>>,
    connects: bool,
}

/// A telegram as transmitted on the line.
fn block(telegram: &[u8]) -> Vec<u8> {
    ob1_protocols::s3964::codec::block(telegram, true).collect()
}

/// A Modbus RTU telegram with its check.
pub(crate) fn rtu(telegram: &[u8]) -> Vec<u8> {
    let mut frame = [0; 300];
    let len = ob1_protocols::modbus::rtu::encode(telegram, &mut frame).expect("it fits");
    frame[..len].to_vec()
}

impl Device for Partner {
    fn hear(&mut self, _now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        for byte in bytes {
            self.heard.push(*byte);
            match self.from {
                _ if !self.is_3964r => {}
                None if *byte == STX => {
                    self.from = Some(self.heard.len());
                    out.push(DLE);
                }
                None if *byte == DLE && self.connects => {
                    self.connects = false;
                    out.extend(self.blocks.pop_front().unwrap_or_default());
                }
                None => {}
                Some(from) => {
                    let coming = &self.heard[from..];
                    if coming.len() > 2 && coming[coming.len() - 3..coming.len() - 1] == [DLE, ETX] {
                        let undoubled = coming[..coming.len() - 3].chunk_by(|a, b| *a == DLE && *b == DLE);
                        self.telegrams.push(
                            undoubled.flat_map(|run| if run.len() > 1 { &run[1..] } else { run }.to_vec()).collect(),
                        );
                        self.from = None;
                        out.push(DLE);
                    }
                }
            }
        }
        None
    }
}

pub(crate) struct Site {
    pub(crate) bench: Bench<Partner>,
}

/// A station with one CP 240 with these parameters, and this program in its cycle.
fn station(folder: &Path, params: &str, cycle: &str, blocks: &str) -> PathBuf {
    timed_station(folder, 2, params, cycle, blocks)
}

/// The same with this cycle time in ms; OB 35 comes every 10 ms.
fn timed_station(folder: &Path, min_cycle: u32, params: &str, cycle: &str, blocks: &str) -> PathBuf {
    let parameters = if params.starts_with('"') { format!("raw = {params}") } else { format!("params = {params}") };
    let program = format!(
        "{blocks}\nORGANIZATION_BLOCK OB 100\nBEGIN\nSET;\n=M 1.0;\nEND_ORGANIZATION_BLOCK\n\
             ORGANIZATION_BLOCK OB 1\nBEGIN\n{cycle}\nEND_ORGANIZATION_BLOCK\n"
    );
    fs::write(folder.join("program.awl"), program).expect("the program");
    let has_ob_35 = blocks.contains("OB 35");
    let cyclic = if has_ob_35 { "[[cpu.cyclic]]\nob = 35\nperiod = \"10ms\"\n" } else { "" };
    let file = format!(
        "[station]\nname = \"blocks\"\n[cpu]\nmin_cycle = \"{min_cycle}ms\"\nwatchdog = \"500ms\"\n\
             {cyclic}[program]\nsources = [\"program.awl\"]\nmnemonics = \"de\"\n[[plugin]]\npath = \"ob1_cp240\"\n\
             [[module]]\ntype = \"cp240\"\nname = \"cp\"\naddress = 256\nline = \"pty:partner\"\n{parameters}\n"
    );
    let path = folder.join("station.toml");
    fs::write(&path, file).expect("the station file");
    path
}

impl Site {
    pub(crate) fn new(params: &str, cycle: &str, blocks: &str) -> Self {
        Self::timed(2, params, cycle, blocks)
    }

    pub(crate) fn timed(min_cycle: u32, params: &str, cycle: &str, blocks: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let path = timed_station(folder.path(), min_cycle, params, cycle, blocks);
        let partner = Partner { is_3964r: params.contains("3964r"), ..Partner::default() };
        let bench = Bench::build(&path, partner, 1).unwrap_or_else(|message| {
            panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
        });
        Self { bench }
    }

    pub(crate) fn bit(&mut self, byte: u32, bit: u32, on: bool) {
        let cell = Cell::Area(Area::Memory, 8 * byte + bit);
        self.bench.station.cpu.write(cell, Width::Bit, u32::from(on)).expect("bit memory");
    }

    pub(crate) fn is_set(&self, byte: usize, bit: u32) -> bool {
        self.bench.station.cpu.bit_memory()[byte] >> bit & 1 == 1
    }

    pub(crate) fn word(&self, at: usize) -> u16 {
        let memory = self.bench.station.cpu.bit_memory();
        u16::from_be_bytes([memory[at], memory[at + 1]])
    }

    pub(crate) fn until(&mut self, what: impl Fn(&Self) -> bool) {
        for _ in 0..20_000 {
            if what(self) {
                return;
            }
            self.bench.pass(MS);
        }
        panic!("it does not come\n{}", self.bench.log());
    }

    /// The partner sends a telegram of 3964R.
    pub(crate) fn partner_sends(&mut self, telegram: &[u8]) {
        let block = block(telegram);
        self.bench.meanwhile(|partner, _, out| {
            partner.blocks.push_back(block);
            partner.connects = true;
            out.push(STX);
            None
        });
    }
}

pub(crate) const SYNCHRON: &str = "CALL FC 9 (ADR := 256, TIMER_NR := T 2, ANL := M 1.0, NULL := M 1.1, \
     RESET := M 1.2, STEUERB_S := MB 2, STEUERB_R := MB 3);\n";

/// FC 4 as long as M 4.0 is 0; `ANZW` MW 40.
pub(crate) const SERVES: &str = "U M 1.0;\nBEB;\nU M 4.0;\nBEB;\nCALL FC 4 (ADR := 256, ANZW := MW 40, PAFE := MB 42, \
     GESE := MW 44, ANZ := MW 46, DB_KOPF := MW 48, ABF_KOPF := MW 50, KOPF_AUSGEW := M 52.0, \
     LETZTER_BLOCK := M 52.1, SENDE_LAEUFT := M 52.2, EMPF_LAEUFT := M 52.3, ENDE_KOM := M 52.4, SEND_ALL := M 52.5, \
     RECEIV_ALL := M 52.6, FEHLER := M 52.7);\n";
pub(crate) const DB_10: &str =
    "DATA_BLOCK DB 10\nSTRUCT\nD : ARRAY [1..1100] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";
pub(crate) const SENDE_LAEUFT: u32 = 2;
const EMPF_LAEUFT: u32 = 3;
pub(crate) const FEHLER: u32 = 7;
pub(crate) const RK512: &str = "{ protocol = \"3964r-rk512\", baud = 115200, priority = \"high\" }";

fn serving() -> Site {
    let mut site = Site::new(RK512, &[SYNCHRON, SERVES].concat(), DB_10);
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(100 * MS);
    site
}

/// [S0 "Error message CP Byte 0"], 17h: "Maximally 1024byte user data may be transferred." The serving program gets
/// this limit as its own error number, and not as a data block that is too short.
#[test]
fn an_order_of_the_partner_above_512_words() {
    let mut site = serving();
    for (command, data) in [(b'E', 0), (b'A', 128)] {
        let header = [0, 0, command, b'D', 10, 0, 2, 1, 0xFF, 0xFF];
        site.partner_sends(&[&header[..], &vec![7; data]].concat());
        site.until(|site| site.word(40) == 0x1708);
        assert!(site.is_set(52, FEHLER));
        site.until(|site| !site.bench.device.telegrams.is_empty());
        assert_eq!(site.bench.device.telegrams, [[0, 0, 0, 0x14]]);
        // 512 words are served, and the indicator word is that of this order.
        site.bench.device.telegrams.clear();
        site.partner_sends(&[0, 0, b'E', b'D', 10, 0, 2, 0, 0xFF, 0xFF]);
        site.until(|site| site.word(40) == 0x0004);
        site.until(|site| !site.bench.device.telegrams.is_empty());
        assert_eq!(site.bench.device.telegrams[0].len(), 4 + 128);
        assert!(!site.is_set(52, FEHLER));
        site.bench.pass(10 * SECOND);
        site.bench.device.telegrams.clear();
    }
}

/// The program was too slow for the CP: the partner got 2Ah, so the program does not get "done".
#[test]
fn an_answer_that_comes_too_late() {
    for stage in [EMPF_LAEUFT, SENDE_LAEUFT] {
        let mut site = serving();
        site.partner_sends(&[
            0, 0, b'A', b'D', 10, 0, 0, 10, 0xFF, 0xFF, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18,
            19, 20,
        ]);
        site.until(|site| site.is_set(52, stage));
        site.bit(4, 0, true);
        site.bench.pass(5 * SECOND);
        assert_eq!(site.bench.device.telegrams, [[0, 0, 0, 0x2A]]);
        site.bit(4, 0, false);
        site.until(|site| !site.is_set(52, EMPF_LAEUFT) && !site.is_set(52, SENDE_LAEUFT));
        assert_eq!((site.word(40), site.is_set(52, FEHLER)), (0x0C08, true), "bit {stage}");
        // It serves the next order.
        site.partner_sends(&[0, 0, b'A', b'D', 10, 0, 0, 1, 0xFF, 0xFF, 1, 2]);
        site.until(|site| site.word(40) == 0x0004);
        site.until(|site| site.bench.device.telegrams.len() == 2);
        assert_eq!(site.bench.device.telegrams[1], [0, 0, 0, 0]);
    }
}

/// FC 11; `EMFR` M 3.0, `ANZ` MW 40. It counts telegrams in MW 54, and errors in MW 56.
pub(crate) const FRAGMENTS: &str = "U M 1.0;\nBEB;\nCALL FC 11 (ADR := 256, _DB := DB 10, ABD := W#16#0, ANZ := MW 40, \
     EMFR := M 5.0, GEEM := MW 44, ANZ_INT := MW 46, EMPF_LAEUFT := M 3.0, LETZTER_BLOCK := M 3.1, \
     FEHLER_EMPF := M 3.2, PAFE := MB 42);\n";

/// [S0 L1099], [S0 "ASCII-fragmented"]: the blocks are stored in the data block as received, EMFR shows that the
/// telegram is complete, ANZ is its length. Also with 24 bytes, a multiple of 12.
#[test]
fn fragments_of_a_telegram_and_its_end() {
    let params = "{ protocol = \"ascii-fragmented\", baud = 9600, zvz_ms = 100 }";
    let mut site = Site::new(params, &[SYNCHRON, FRAGMENTS].concat(), DB_10);
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(100 * MS);
    for len in [30, 24, 12, 5, 1, 1080] {
        let telegram: Vec<u8> = (0..len).map(|at| (at % 251) as u8).collect();
        let sent = telegram.clone();
        site.bench.meanwhile(|_, _, out| {
            out.extend(sent);
            None
        });
        if len > 12 {
            // The first blocks are stored long before the end.
            site.until(|site| site.word(44) == 12);
            assert!(!site.is_set(5, 0));
        }
        site.until(|site| site.is_set(5, 0));
        assert_eq!((site.word(40), site.word(44), site.is_set(3, 1)), (len, len, true));
        let data = site.bench.station.cpu.data_block(10).expect("it is there");
        assert!(data[..usize::from(len)] == telegram, "{len} bytes");
        // Nothing more is accepted until the program has reset EMFR.
        site.bench.meanwhile(|_, _, out| {
            out.extend(b"next");
            None
        });
        site.bench.pass(500 * MS);
        assert_eq!(site.word(40), len);
        site.bit(5, 0, false);
        site.until(|site| site.is_set(5, 0));
        assert_eq!(site.word(40), 4);
        site.bit(5, 0, false);
        site.bench.pass(50 * MS);
    }
    // A character error after the first block: no telegram, and the program gets an error.
    site.bench.meanwhile(|_, _, out| {
        out.extend(b"twelve bytes, ");
        None
    });
    site.until(|site| site.word(44) == 12);
    site.bench.fault(LineFault::Parity);
    site.until(|site| site.is_set(3, 2));
    site.bench.pass(500 * MS);
    assert_eq!((site.is_set(5, 0), site.is_set(3, 0)), (false, false));
    site.bench.meanwhile(|_, _, out| {
        out.extend(b"well again");
        None
    });
    site.until(|site| site.is_set(5, 0));
    assert_eq!((site.word(40), site.is_set(3, 2)), (10, false));
}

/// The manual names no FC 9 for Modbus: a program that waits for ANL continues, the registers (for a slave "short" the
/// data that the master reads) are not changed, and the diagnostic buffer has an entry.
#[test]
fn fc_9_with_a_modbus_protocol() {
    for protocol in ["modbus-slave-rtu-short", "modbus-slave-rtu-long", "modbus-master-rtu"] {
        let cycle = [SYNCHRON, "U M 1.0;\nBEB;\nL MW 40;\n+ 1;\nT MW 40;\n"].concat();
        let mut site = Site::new(&format!("{{ protocol = \"{protocol}\", baud = 9600 }}"), &cycle, DB_10);
        site.bench.pass(100 * MS);
        assert!(!site.is_set(1, 0) && site.word(40) > 5, "{protocol}: past BEB");
        site.bit(1, 2, true);
        site.bench.pass(100 * MS);
        assert!(!site.is_set(1, 2), "{protocol}: RESET is taken back");
        assert_eq!(site.bench.log().matches("FC 9 was called").count(), 1, "{protocol}\n{}", site.bench.log());
        if protocol.ends_with("short") {
            // The master reads EW 0 to 7 of the slave: all 0.
            let request = rtu(&[1, 4, 0, 0, 0, 8]);
            site.bench.meanwhile(|_, _, out| {
                out.extend(request);
                None
            });
            site.bench.pass(SECOND);
            assert_eq!(site.bench.device.heard, rtu(&[&[1, 4, 16][..], &[0; 16]].concat()));
        }
    }
}

/// No handling block takes the data of the master for count words, or overwrites the data that the master reads.
#[test]
fn the_registers_of_a_slave_short_are_its_data() {
    let program = "L 42;\nT PAW 256;\nU M 5.0;\nCALL FC 1 (ADR := 256, _DB := DB 10, ABD := W#16#0, ANZ := MW 40, \
        EMFR := M 5.0, GEEM := MW 44, ANZ_INT := MW 46, EMPF_LAEUFT := M 3.0, LETZTER_BLOCK := M 3.1, \
        FEHLER_EMPF := M 3.2, PAFE := MB 42);\n\
        CALL FC 0 (ADR := 256, _DB := DB 10, ABD := W#16#0, ANZ := W#16#5, FRG := M 5.1, GESE := MW 48, \
        ANZ_INT := MW 50, ENDE_KOMM := M 2.0, LETZTER_BLOCK := M 2.1, SENDEN_LAEUFT := M 2.2, FEHLER_KOM := M 2.3, \
        PAFE := MB 43);\n";
    let params = "{ protocol = \"modbus-slave-rtu-short\", baud = 9600 }";
    let mut site = Site::new(params, program, DB_10);
    site.bit(5, 1, true);
    let write = rtu(&[1, 6, 0, 0, 0, 9]);
    site.bench.pass(100 * MS);
    site.bench.meanwhile(|_, _, out| {
        out.extend(write);
        None
    });
    site.bench.pass(SECOND);
    assert!(!site.is_set(5, 0), "no telegram of 9 bytes");
    assert!(site.bench.station.cpu.data_block(10).expect("it is there").iter().all(|byte| *byte == 0));
    site.bench.device.heard.clear();
    let read = rtu(&[1, 4, 0, 0, 0, 2]);
    site.bench.meanwhile(|_, _, out| {
        out.extend(read);
        None
    });
    site.bench.pass(SECOND);
    assert_eq!(site.bench.device.heard, rtu(&[1, 4, 4, 0, 42, 0, 0]));
}

/// `ob1 check` reports it before the station runs.
#[test]
fn a_call_for_nothing_is_found_before() {
    let warnings = |protocol: &str, cycle: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = station(folder.path(), &format!("{{ protocol = \"{protocol}\" }}"), cycle, DB_10);
        let station = ob1_station_file::load(&path).expect("a station");
        let loaded = ob1_station::program::load(&station).expect("a program");
        loaded.findings.iter().map(|f| (f.code.clone(), f.line)).collect::<Vec<_>>()
    };
    let line = 15;
    for (protocol, cycle, expected) in [
        ("modbus-master-rtu", SYNCHRON, vec![("L022".to_owned(), line)]),
        ("modbus-slave-ascii-short", SYNCHRON, vec![("L022".to_owned(), line)]),
        ("modbus-slave-ascii-short", FRAGMENTS, vec![("L022".to_owned(), line + 2)]),
        ("modbus-master-rtu", FRAGMENTS, vec![]),
        ("ascii", SYNCHRON, vec![]),
        ("3964r-rk512", FRAGMENTS, vec![("L024".to_owned(), line + 2), ("L025".to_owned(), line + 2)]),
    ] {
        assert_eq!(warnings(protocol, cycle), expected, "{protocol}");
    }
}

/// [S0 L2118]: a CP 240 without parameters works with 9600 baud, ASCII, even parity, ZVZ 200 ms.
#[test]
fn a_cp_without_parameters() {
    let raw = format!("\"{}\"", ["00"; 16].join(" "));
    let mut site = Site::new(&raw, &[SYNCHRON, FRAGMENTS].concat(), DB_10);
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(100 * MS);
    site.bench.meanwhile(|_, _, out| {
        out.extend(b"hello");
        None
    });
    // Five characters of 11 bits, then the silence.
    site.bench.pass(200 * MS);
    assert!(!site.is_set(5, 0), "ZVZ has not run out");
    site.until(|site| site.is_set(5, 0));
    assert_eq!(site.word(40), 5);
}

/// [S0 L1504]: of all lines the plug of RS 485 has RTS alone. FC 8 shows it, and `ob1 check` says it before.
#[test]
fn fc_8_on_two_wires_has_rts_alone() {
    let lines = "CALL FC 8 (ADR := 256, RTS := M 110.0, DTR := M 110.1, MASKE_RTS := M 110.2, MASKE_DTR := M 110.3, \
        STATUS := MB 111, DELTA_STATUS := MB 112, START := M 110.4, AUFTRAG_LAEU := M 110.5, RET_VAL := MW 114);\n";
    for (interface, status) in [("rs232", 0x30), ("rs422", 0x20), ("rs485", 0x20)] {
        let params = format!("{{ protocol = \"ascii\" }}\ninterface = \"{interface}\"");
        let mut site = Site::new(&params, &[SYNCHRON, lines].concat(), DB_10);
        site.bench.pass(SECOND);
        assert_eq!(site.word(110) & 0x30, status, "{interface}: RTS and DTR are ON where they are");
    }
}
