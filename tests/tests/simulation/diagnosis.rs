//! Faults of a CP through all layers, in virtual time: station file with `diagnostics = true`, a line that fails and
//! recovers, wrong parameters; driver, back plane, CPU, OB 82 with the four bytes, SFC 59 and SFC 51.
//! [CP 341 manual 09/2008, p. 204]

use std::fs;

use ob1_cpu::OperatingState;
use ob1_firmware::LineFault;
use ob1_host::module::CpSettings;
use ob1_line::sim::FaultRates;
use ob1_tests::sim::device::{Bench, Device};
use ob1_tests::sim::{MS, SECOND};
use ob1_time::Instant;

use crate::common::diagnosis::{OB_1, OB_82, cell, station};

/// A line without a partner.
struct Silent;

impl Device for Silent {
    fn hear(&mut self, _now: Instant, _bytes: &[u8], _out: &mut Vec<u8>) -> Option<Instant> {
        None
    }
}

const CP_341: &str = "type = \"cp341\"\nparams = { protocol = \"3964r\", baud = 9600 }";
const CP_341_MODBUS: &str = "type = \"cp341\"\nparams = { protocol = \"modbus-ascii-master-32\", baud = 9600 }";
const CP_040: &str = "type = \"cp040\"\nbytes = 16\nparams = { protocol = \"3964r\", baud = 9600, data_bits = 8, parity = \"none\", \
    stop_bits = 1, priority = \"high\", duplex = \"full\", preset = \"break\" }";
const CP_240: &str =
    "type = \"cp240\"\nparams = { protocol = \"3964r\", baud = 9600, parity = \"even\", priority = \"high\" }";
const CP_240_MBUS: &str = "type = \"cp240\"\nparams = { protocol = \"mbus\" }";
const CP_240_ENOCEAN: &str = "type = \"cp240\"\nparams = { protocol = \"enocean\" }";

/// A station with this module, diagnostics enabled or not, with or without OB 82.
fn house(module: &str, diagnostics: bool, ob_82: bool, spoil: &dyn Fn(&mut CpSettings)) -> Bench<Silent> {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    write("ob1.awl", OB_1);
    write("ob82.awl", OB_82);
    let module = format!("line = \"pty:cp.pty\"\ndiagnostics = {diagnostics}\n{module}");
    let sources = if ob_82 { "\"ob1.awl\", \"ob82.awl\"" } else { "\"ob1.awl\"" };
    write("station.toml", &station("diagnosis", sources, &module));
    let mut bench = Bench::build_with(&folder.path().join("station.toml"), Silent, FaultRates::NONE, 5, spoil)
        .unwrap_or_else(|message| panic!("{message}"));
    // The driver starts, gets its parameters, and ER of a CP 240 is switched off.
    bench.pass(5 * SECOND);
    bench
}

fn at(bench: &Bench<Silent>, (db, byte): (u16, usize)) -> u32 {
    bench.station.ledger(db, byte)
}

/// OB 82: number of incoming and outgoing interrupts, the four bytes of the last one.
fn interrupts(bench: &Bench<Silent>) -> (u32, u32, u32) {
    (at(bench, cell::COMES), at(bench, cell::GOES), at(bench, cell::BYTES))
}

#[test]
fn a_wire_break_comes_and_goes_as_ob_82() {
    for (name, module, comes, goes) in [
        ("CP 341", CP_341, 0x250C_0200, 0x000C_0000),
        ("CP 341, loadable driver", CP_341_MODBUS, 0x250C_0200, 0x000C_0000),
        // ERR_A: fault, external; class 1Ch: with channel information.
        ("CP 040", CP_040, 0x051C_0000, 0x001C_0000),
        ("CP 240", CP_240, 0x250C_0200, 0x000C_0000),
    ] {
        let mut bench = house(module, true, true, &|_| {});
        assert_eq!(interrupts(&bench), (0, 0, 0), "{name}: {}", bench.log());
        bench.fault(LineFault::Gone);
        bench.pass(SECOND);
        assert_eq!(interrupts(&bench), (1, 0, comes), "{name}: {}", bench.log());
        assert_eq!(at(&bench, cell::ADDRESS) >> 16, 256, "{name}");
        bench.fault(LineFault::Back);
        // ER of a CP 240 is switched off 4 s after the last error.
        bench.pass(5 * SECOND);
        assert_eq!(interrupts(&bench), (1, 1, goes), "{name}: {}", bench.log());
    }
}

#[test]
fn enocean_shows_and_tells_a_full_buffer_alone() {
    let mut bench = house(CP_240_ENOCEAN, true, true, &|_| {});
    bench.fault(LineFault::Gone);
    bench.pass(SECOND);
    bench.fault(LineFault::Back);
    bench.pass(5 * SECOND);
    assert_eq!(interrupts(&bench), (0, 0, 0), "{}", bench.log());
}

/// "Diagnosis data -" [S0 L4717]: no interrupt, and no STOP where there is no OB 82.
#[test]
fn m_bus_has_no_diagnostic_interrupt() {
    for ob_82 in [true, false] {
        let mut bench = house(CP_240_MBUS, true, ob_82, &|_| {});
        bench.fault(LineFault::Gone);
        bench.pass(SECOND);
        bench.fault(LineFault::Back);
        bench.pass(5 * SECOND);
        assert_eq!(interrupts(&bench), (0, 0, 0), "{}", bench.log());
        assert_eq!(bench.station.cpu.state(), OperatingState::Run, "{}", bench.log());
    }
}

#[test]
fn a_program_reads_diagnostic_data_and_the_buffer_of_a_cp_341() {
    let mut bench = house(CP_341, false, true, &|_| {});
    let seen = |bench: &Bench<Silent>| {
        let records = [cell::RETURNS, cell::RECORD_0, cell::RECORD_1].map(|place| at(bench, place));
        (records, at(bench, cell::LIST) >> 16, at(bench, cell::NEWEST), at(bench, cell::NEWEST_STATUS) & 0xFFFF)
    };
    // Parameters accepted, or the CPU went to RUN, whichever came last.
    let (records, result, event, status) = seen(&bench);
    assert_eq!((records, result, event), ([0, 0x000C_0000, 0x000C_0000], 0, 0xF900_0000), "{}", bench.log());
    assert!(matches!(status, 0x0003 | 0x0008), "{status:04X}");
    bench.fault(LineFault::Gone);
    bench.pass(100 * MS);
    let broken = [0, 0x250C_0200, 0x250C_0200];
    assert_eq!(seen(&bench), (broken, 0, 0xF908_0000, 0x080D));
    bench.fault(LineFault::Back);
    bench.pass(100 * MS);
    let whole = [0, 0x000C_0000, 0x000C_0000];
    assert_eq!(seen(&bench), (whole, 0, 0xF808_0000, 0x080D), "gone");
    // The driver dies: the buffer belongs to the module, and the next driver appends to it.
    let before = at(&bench, (92, 4)) >> 16;
    bench.kill_driver();
    bench.pass(SECOND);
    assert_eq!(at(&bench, (92, 4)) >> 16, before + 2, "parameters and RUN once more\n{}", bench.log());
    assert_eq!(interrupts(&bench), (0, 0, 0), "no interrupt unless enabled");
}

#[test]
fn a_cp_040_has_records_0_and_1_and_no_buffer() {
    let mut bench = house(CP_040, false, true, &|_| {});
    bench.fault(LineFault::Gone);
    bench.pass(100 * MS);
    // Record 1 has 20 bytes, but there is only room for 16.
    let records = [cell::RETURNS, cell::RECORD_0, cell::RECORD_1].map(|place| at(&bench, place));
    assert_eq!(records, [0, 0x051C_0000, 0x051C_0000], "{}", bench.log());
    assert_eq!(at(&bench, cell::LIST) >> 16, 0x8083);
}

#[test]
fn wrong_parameters_raise_ob_82() {
    let spoiled = |from: &'static str, to: &'static str| {
        move |settings: &mut CpSettings| {
            let json = String::from_utf8(settings.json.clone()).expect("JSON is UTF-8");
            assert!(json.contains(from), "{json}");
            settings.json = json.replace(from, to).into();
        }
    };
    let bench = house(CP_341, true, true, &spoiled("9600", "4711"));
    assert_eq!(interrupts(&bench), (1, 0, 0x830C_0000), "{}", bench.log());
    assert_eq!(at(&bench, cell::RECORD_1), 0x830C_0000);
    assert!(bench.entries().contains(&0x020F), "{:04X?}", bench.entries());
    let bench = house(CP_040, true, true, &|settings| settings.parameters = [0xEE; 16]);
    assert_eq!(interrupts(&bench), (1, 0, 0x811C_0000), "{}", bench.log());
}

#[test]
fn without_ob_82_the_cpu_stops() {
    for module in [CP_341, CP_040, CP_240] {
        let mut bench = house(module, true, false, &|_| {});
        assert!(!bench.log().contains("456A"), "{}", bench.log());
        bench.fault(LineFault::Gone);
        bench.pass(SECOND);
        assert!(bench.log().contains("456Ah STOP by diagnostic interrupt"), "{module}: {}", bench.log());
        // Diagnostics disabled: an interrupted cable does not stop the CPU.
        let mut bench = house(module, false, false, &|_| {});
        bench.fault(LineFault::Gone);
        bench.pass(SECOND);
        assert!(!bench.log().contains("STOP by"), "{module}: {}", bench.log());
    }
}
