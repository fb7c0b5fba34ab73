//! A station file with Modbus couplers: the finding for each mistake, with its place.

mod mistakes;

use std::path::Path;

use ob1_station_file::finding::Finding;
use ob1_station_file::{Station, parse};

const GOOD: &str = r#"[station]
name = "press"

[[bus]]
name = "field"
type = "modbus-tcp"

[[module]]
type = "di"
name = "panel"
address = 20
bytes = 2

[[module]]
type = "coupler"
bus = "field"
name = "north"
line = "tcp:10.0.0.11:502"
inputs = [{ at = "EB 0", from = "holding:0", registers = 4, substitute = [1, 2, 3, 4, 5, 6, 7, 8] }]
outputs = [{ at = "AB 0", to = "coil:16", bits = 12 }]
on_loss = "substitute"
profile = "wago-750"
watchdog = "500ms"
lost_after = "1s"
diagnostic = 2040

[[module]]
type = "coupler"
bus = "field"
name = "south"
line = "tcp:10.0.0.12:502"
inputs = [{ at = "EB 8", from = "discrete:0", bits = 16 }]
"#;

fn read(text: &str) -> Result<Station, Vec<Finding>> {
    parse(text, "press.toml", Path::new("."))
}

#[test]
fn the_watchdog_is_set_where_it_does_not_run() {
    let station = read(GOOD).unwrap_or_else(|findings| panic!("{findings:#?}"));
    let north = &station.buses[0].config.lines[0].couplers[0];
    let registers: Vec<u16> = north.setup.iter().map(|setup| setup.at).collect();
    assert_eq!(registers, [0x1008, 0x1000, 0x100A]);
    let proof = north.proof.as_ref().expect("a WAGO coupler says so");
    assert_eq!((proof.skips, &proof.expected[..]), (3, &[(0, 5), (6, 1)][..]));
}

/// The only module of a bus has a mistake: the bus has a module, so that is the only finding.
#[test]
fn a_mistake_in_the_only_module_of_a_bus_is_one_finding() {
    let text = "[station]\nname = \"x\"\n[[bus]]\nname = \"field\"\ntype = \"modbus-tcp\"\n[[module]]\ntype = \"coupler\"\n\
                bus = \"field\"\nname = \"north\"\nline = \"tcp:10.0.0.11:502\"\nunit = 700\n\
                inputs = [{ at = \"EB 0\", from = \"holdin:0\", registers = 4 }]\n";
    let findings = read(text).expect_err("a mistake");
    assert!(findings.iter().all(|finding| finding.code == "C005"), "{findings:#?}");
    let nothing = read(text.split("[[module]]").next().unwrap_or_default()).expect_err("no module");
    assert_eq!(nothing.iter().map(|finding| finding.code.as_str()).collect::<Vec<_>>(), ["C010"]);
}

#[test]
fn each_mistake_has_its_place_and_its_words() {
    mistakes::check(
        GOOD,
        read,
        &[
            ("EB 8", "EB 7", 32, "input byte 7 belongs to north already", "north occupies 0 to 7"),
            ("EB 8", "EB 19", 32, "input byte 20 belongs to panel already", "panel occupies 20 to 21"),
            ("EB 8", "EB 16383", 32, "the range reaches to byte 16384", "the last byte is 16383"),
            ("EB 8", "AB 8", 32, "\"AB 8\" is not an address for", "the first byte"),
            (
                "bus = \"field\"\nname = \"south\"",
                "bus = \"feld\"\nname = \"south\"",
                29,
                "no bus \"feld\"",
                "\"field\"?",
            ),
            ("bus = \"field\"\nname = \"south\"", "name = \"south\"", 28, "the module has no bus", "add `bus`"),
            ("line = \"tcp:10.0.0.12:502\"\n", "", 28, "the coupler has no line", "tcp:"),
            ("tcp:10.0.0.12:502", "serial:/dev/ttyS0", 31, "cannot be the line of such a bus", "tcp:"),
            ("name = \"south\"", "name = \"north\"", 30, "north", "name"),
            ("discrete:0", "discreet:0", 32, "is not a register or bit of a coupler", "holding:N, input:N"),
            ("discrete:0", "discrete:40001x", 32, "is not a register or bit of a coupler", "counted from 0"),
            ("bits = 16", "registers = 1", 32, "`discrete` is counted in `bits`", "`bits` for coil"),
            (", bits = 16", "", 32, "`bits` is missing", "how many"),
            ("coil:16", "discrete:16", 20, "`discrete` cannot be written", "holding:N or coil:N"),
            ("to = \"coil:16\"", "from = \"coil:16\"", 20, "outputs go `to`", "write `to`"),
            ("registers = 4,", "registers = 70000,", 19, "out of range", "65535"),
            ("7, 8]", "7]", 19, "7 values for 8 bytes", "one for each"),
            (", substitute = [1, 2, 3, 4, 5, 6, 7, 8]", "", 19, "no substitute values", "add `substitute`"),
            ("on_loss = \"substitute\"", "on_loss = \"substitut\"", 21, "substitut", "substitute"),
            ("profile = \"wago-750\"\n", "", 22, "unknown coupler", "`profile` says"),
            ("wago-750", "moxa-iologik", 23, "cannot be set over Modbus", "on the coupler itself"),
            ("watchdog = \"500ms\"", "watchdog = \"50ms\"", 23, "no such watchdog time", "100 ms to"),
            ("lost_after = \"1s\"", "lost_after = \"10ms\"", 24, "would be reported lost", "100ms"),
            ("lost_after = \"1s\"", "lost_after = \"2ms\"", 24, "would be reported lost", "100ms"),
            (
                "lost_after = \"1s\"",
                "lost_after = \"1s\"\nperiod = \"2s\"",
                25,
                "cannot be read in this period",
                "half",
            ),
            (
                "lost_after = \"1s\"",
                "lost_after = \"1s\"\nrefresh = \"400ms\"",
                25,
                "`refresh` is out of range",
                "half",
            ),
            ("diagnostic = 2040", "station = 3", 25, "`station` does not belong to a coupler", "`unit`"),
            ("diagnostic = 2040", "diagnostic = 20", 25, "belongs to something else", "leave it out"),
        ],
    );
}
