//! A station file with a PROFIBUS: what it becomes, and the finding for each mistake, with its place.

mod mistakes;

use std::path::{Path, PathBuf};

use ob1_station_file::finding::Finding;
use ob1_station_file::{ModuleKind, Station, parse};

/// With the GSD file of a simulated ET 200M.
const GOOD: &str = r#"[station]
name = "press"

[[bus]]
name = "profi"
type = "dp"
line = "serial:/dev/ttyUSB0"
baud = 500000
watchdog = "300ms"

[[module]]
type = "coupler"
bus = "profi"
name = "rack"
station = 8
gsd = "ET200M.GSD"
diagnostic = 2040
on_loss = "substitute"
slots = [
    { slot = 1, module = "DI 16 x DC 24V", inputs = "EB 0", substitute = [1, 2] },
    { slot = 3, module = "AI 2 x 12 bit", inputs = "PEW 256", params = { Range = "4..20 mA" }, substitute = [0, 0, 0, 0] },
    { slot = 2, module = "DO 16 x DC 24V", outputs = "AB 4" },
]
"#;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../driver/dp/tests")
}

fn read(text: &str) -> Result<Station, Vec<Finding>> {
    parse(text, "press.toml", &folder())
}

#[test]
fn a_slave_is_a_module_at_its_diagnostic_address_and_one_for_each_slot() {
    let station = read(GOOD).unwrap_or_else(|findings| panic!("{findings:#?}"));
    let places: Vec<_> = station
        .modules
        .iter()
        .map(|m| (m.name.as_str(), m.input_address, m.input_bytes(), m.output_address, m.output_bytes()))
        .collect();
    assert_eq!(
        places,
        [("rack", 2040, 0, 2040, 0), ("rack.1", 0, 2, 0, 0), ("rack.2", 4, 0, 4, 2), ("rack.3", 256, 4, 256, 0)]
    );
    let speaks: Vec<bool> = station
        .modules
        .iter()
        .map(|module| matches!(&module.kind, ModuleKind::Remote { module, .. } if module.speaks))
        .collect();
    assert_eq!(speaks, [true, false, false, false]);
    let bus = &station.buses[0];
    let dp = bus.config.lines[0].dp.as_ref().expect("it is a DP line");
    assert_eq!((dp.baud, dp.address, dp.hsa, dp.slot_bits, dp.retries), (500_000, 2, 126, 4000, 3));
    let slave = &dp.slaves[0];
    assert_eq!((slave.station, slave.ident), (8, 0x7F01));
    assert_eq!(slave.config, [0x42, 0x01, 0x01, 0x00, 0x82, 0x01, 0x02, 0x00, 0x51]);
    assert_eq!(slave.parameters, [0xC0, 0x00, 0x08, 0x01, 0x30, 0x00, 0x05]);
    assert_eq!((slave.inputs, slave.outputs, slave.diagnosis), ((0, 6), (0, 2), (6, 64)));
    assert_eq!((bus.config.input_bytes, bus.config.output_bytes), (6 + 65, 2));
    assert_eq!(slave.texts.get(&0).map(String::as_str), Some("Module missing"));
    assert_eq!((bus.stations[0].diagnostic, bus.stations[0].number, bus.stations[0].interrupts), (2040, 8, true));
}

/// What is changed, the line of the finding, what it says, what helps.
#[test]
fn each_mistake_has_its_place_and_its_words() {
    mistakes::check(
        GOOD,
        read,
        &[
            ("baud = 500000", "baud = 500001", 8, "no 500001 bit/s", "187500, 500000"),
            ("baud = 500000", "baud = 31250", 15, "cannot have 31250 bit/s", "another `baud`"),
            ("baud = 500000", "baud = 500000\nhsa = 2", 9, "the master has address 2", "hsa = 126"),
            ("baud = 500000", "baud = 500000\nslot_bits = 100", 9, "out of range", "200 to 16383"),
            ("baud = 500000", "baud = 500000\nparity = \"odd\"", 9, "belongs to a serial line", "leave it out"),
            ("watchdog = \"300ms\"", "watchdog = \"1ms\"", 9, "no such watchdog time", "10 ms"),
            ("line = \"serial:/dev/ttyUSB0\"", "line = \"tcp:10.0.0.1:502\"", 7, "cannot be the line", "serial:DEVICE"),
            ("station = 8\n", "", 12, "no address", "add `station`"),
            ("station = 8", "station = 126", 15, "out of range", "0 to 125"),
            ("station = 8", "station = 2", 15, "the address 2 is taken", "of its own"),
            ("ET200M.GSD", "ET200X.GSD", 16, "cannot be read", "counts from the folder"),
            ("ET200M.GSD", "dp/main.rs", 16, "is not a valid GSD file", "from the maker"),
            ("gsd = \"ET200M.GSD\"\n", "", 12, "no GSD file", "add `gsd`"),
            (
                "DI 16 x DC 24V",
                "DI 16 x DC 42V",
                20,
                "no module \"DI 16 x DC 42V\"",
                "did you mean \"DI 16 x DC 24V\"?",
            ),
            ("slot = 3", "slot = 4", 21, "slot 3 has no module", "without a gap"),
            ("slot = 2", "slot = 1", 22, "slot 1 occurs twice", "without a gap"),
            ("4..20 mA", "0..20 mA", 21, "\"0..20 mA\" is not a value of \"Range\"", "4..20 mA"),
            ("Range =", "Rnge =", 21, "no parameter \"Rnge\"", "there are: Range, Smoothing, Limit"),
            ("outputs = \"AB 4\"", "inputs = \"EB 4\"", 22, "has no inputs", "leave `inputs` out"),
            (", outputs = \"AB 4\"", "", 22, "2 bytes of outputs, and no place", "outputs = \"AB 0\""),
            ("PEW 256", "EB 1", 21, "input byte 1 belongs to rack.1 already", "occupies 0 to 1"),
            ("PEW 256", "EB 16383", 21, "reach to byte", "the last byte"),
            ("substitute = [1, 2]", "substitute = [1]", 20, "1 values for 2 bytes", "one for each"),
            ("diagnostic = 2040", "diagnostic = 256", 17, "belongs to something else", "leave it out"),
            ("diagnostic = 2040", "unit = 3", 17, "does not belong to a DP slave", "`station`"),
            ("diagnostic = 2040", "period = \"10ms\"", 17, "does not belong to a DP slave", "each round"),
        ],
    );
}

#[test]
fn keys_of_profibus_do_not_belong_elsewhere() {
    for (text, says) in [
        ("[[bus]]\nname = \"b\"\ntype = \"modbus-tcp\"\nhsa = 5\n", "`hsa` belongs to a bus of type \"dp\""),
        (
            "[[module]]\ntype = \"di\"\nname = \"d\"\naddress = 0\nbytes = 1\ngsd = \"x\"\n",
            "`gsd` belongs to a coupler",
        ),
    ] {
        let Err(findings) = read(&format!("[station]\nname = \"s\"\n{text}")) else { panic!("a mistake: {text}") };
        assert!(findings.iter().any(|f| f.message.contains(says)), "{findings:#?}");
    }
}

/// The same rack behind a CP 342-5 that comes before it or after it in the file.
fn behind_cp(text: &str, first: bool) -> String {
    let cp = "[[module]]\ntype = \"cp342-5\"\nname = \"cp\"\nbus = \"profi\"\naddress = 512\n\n";
    let text = text.replace("diagnostic = 2040\n", "").replace("PEW 256", "EB 2");
    if first { text.replacen("[[module]]", &format!("{cp}[[module]]"), 1) } else { format!("{text}\n{cp}") }
}

#[test]
fn behind_a_cp_the_slaves_have_places_in_its_areas_and_none_in_the_cpu() {
    for first in [true, false] {
        let station = read(&behind_cp(GOOD, first)).unwrap_or_else(|findings| panic!("{findings:#?}"));
        let [cp] = &station.modules[..] else { panic!("{:#?}", station.modules) };
        assert_eq!((cp.name.as_str(), cp.input_address, cp.input_bytes(), cp.output_bytes()), ("cp", 512, 16, 16));
        let ModuleKind::DpMaster { bus: 0, areas } = &cp.kind else { panic!("{:?}", cp.kind) };
        let of = |pieces: &[ob1_host::bus::DpPiece]| {
            pieces.iter().map(|p| (p.station, p.area, p.image, p.len)).collect::<Vec<_>>()
        };
        assert_eq!((of(&areas.inputs), of(&areas.outputs)), (vec![(0, 0, 0, 2), (0, 2, 2, 4)], vec![(0, 4, 0, 2)]));
        let slave = &station.buses[0].stations[0];
        assert_eq!((slave.diagnostic, slave.interrupts), (0, false));
    }
}

#[test]
fn each_mistake_at_a_cp_has_its_words() {
    let good = behind_cp(GOOD, true);
    for (from, to, says) in [
        ("address = 512", "address = 512\nline = \"sim:x\"", "a CP 342-5 has no `line`"),
        ("address = 512", "address = 512\ngsd = \"x\"", "`gsd` belongs to a coupler"),
        ("address = 512\n", "", "the module has no address"),
        ("name = \"cp\"\nbus = \"profi\"\n", "name = \"cp\"\n", "the module has no bus"),
        ("name = \"cp\"\nbus = \"profi\"", "name = \"cp\"\nbus = \"profy\"", "there is no bus \"profy\""),
        ("station = 8", "station = 8\ndiagnostic = 2040", "`diagnostic` does not belong to a slave behind a CP 342-5"),
        ("station = 8", "station = 8\ndiagnostics = true", "`diagnostics` does not belong to a slave behind"),
        ("EB 2", "EB 1", "rack.3 overlaps bytes 0 to 1 of the area"),
        ("EB 2", "EB 2158", "rack.3 reaches to byte 2161 of the area"),
        ("type = \"dp\"", "type = \"modbus-rtu\"", "the bus \"profi\" is not a PROFIBUS"),
        (
            "[[module]]\ntype = \"coupler\"",
            "[[module]]\ntype = \"cp342-5\"\nname = \"b\"\nbus = \"profi\"\naddress = 768\n[[module]]\ntype = \"coupler\"",
            "is the bus of another CP 342-5 already",
        ),
    ] {
        assert!(good.contains(from), "{from}");
        let Err(findings) = read(&good.replacen(from, to, 1)) else { panic!("{from} -> {to}: nothing is said") };
        assert!(findings.iter().any(|f| f.message.contains(says)), "{from} -> {to}: {findings:#?}");
    }
}
