//! A station file with a GPIO chip: what it becomes, and the finding for each mistake, with its place.

mod mistakes;

use std::path::Path;

use ob1_coupler::config::Span;
use ob1_coupler::gpio::{Bias, Drive, GpioLine};
use ob1_station_file::finding::Finding;
use ob1_station_file::{Station, parse};

const GOOD: &str = r#"[station]
name = "press"

[[bus]]
name = "board"
type = "gpio"
chip = "gpiochip0"

[[module]]
type = "coupler"
bus = "board"
name = "panel"
period = "5ms"
on_loss = "substitute"
inputs = [
    { at = "EB 0", lines = [17, 27, 4, 5, 6, 7, 8, 9, 10], bias = "pull-up", active_low = true, debounce = "5ms", substitute = [1, 0] },
]
outputs = [{ at = "AB 4", lines = [22], drive = "open-drain" }]
"#;

fn read(text: &str) -> Result<Station, Vec<Finding>> {
    parse(text, "press.toml", Path::new("."))
}

#[test]
fn lines_become_bits_in_the_order_of_the_file() {
    let station = read(GOOD).unwrap_or_else(|findings| panic!("{findings:#?}"));
    let bus = &station.buses[0];
    assert_eq!((bus.config.input_bytes, bus.config.output_bytes), (2, 1));
    let gpio = bus.config.lines[0].gpio.as_ref().expect("a chip");
    assert_eq!((gpio.chip.as_str(), gpio.period), ("/dev/gpiochip0", Span::from_millis(5)));
    let last = GpioLine {
        line: 10,
        at: 1,
        bit: 0,
        active_low: true,
        bias: Bias::PullUp,
        debounce: Span::from_millis(5),
        drive: Drive::PushPull,
    };
    assert_eq!((gpio.inputs.len(), gpio.inputs[8]), (9, last));
    assert_eq!((gpio.inputs[1].line, gpio.inputs[1].at, gpio.inputs[1].bit), (27, 0, 1));
    assert_eq!(gpio.outputs, [GpioLine { line: 22, drive: Drive::OpenDrain, ..GpioLine::default() }]);
    let places: Vec<_> = station
        .modules
        .iter()
        .map(|m| (m.name.as_str(), m.input_address, m.input_bytes(), m.output_address, m.output_bytes()))
        .collect();
    assert_eq!(places, [("panel", 0, 2, 0, 0), ("panel.2", 4, 0, 4, 1)]);
}

/// What is changed, the line of the finding, what it says, what helps.
#[test]
fn each_mistake_has_its_place_and_its_words() {
    mistakes::check(
        GOOD,
        read,
        &[
            ("chip = \"gpiochip0\"\n", "", 6, "no chip", "gpiochip0"),
            ("gpiochip0", "a/b", 7, "is not a chip", "gpiochip0"),
            (
                "chip = \"gpiochip0\"",
                "chip = \"gpiochip0\"\nline = \"sim:x\"",
                8,
                "a GPIO chip has no `line`",
                "chip =",
            ),
            (
                "chip = \"gpiochip0\"",
                "chip = \"gpiochip0\"\nbaud = 9600",
                8,
                "belongs to a serial line",
                "leave it out",
            ),
            ("period = \"5ms\"", "period = \"2s\"", 13, "cannot be read in this period", "\"1s\""),
            ("period = \"5ms\"", "unit = 1", 13, "`unit` does not belong to a GPIO chip", "leave it out"),
            ("pull-up", "pullup", 16, "bias cannot be", "pull-up"),
            ("debounce = \"5ms\"", "debounce = \"11s\"", 16, "`debounce` is too long", "10s"),
            ("lines = [22]", "lines = [17]", 18, "line 17 occurs twice", "one bit"),
            ("lines = [22], ", "", 18, "`lines` is missing", "numbers on the chip"),
            ("drive = \"open-drain\"", "bias = \"pull-up\"", 18, "does not belong to outputs", "leave it out"),
            ("lines = [22]", "lines = [22], to = \"coil:0\"", 18, "`to` does not belong to outputs", "leave it out"),
            ("AB 4", "EB 4", 18, "is not an address for outputs", "AB 0"),
            ("AB 4", "AB 16384", 18, "is not an address for outputs", "AB 0"),
            (", substitute = [1, 0]", "", 16, "no substitute values", "add `substitute`"),
            (
                "type = \"gpio\"\nchip = \"gpiochip0\"",
                "type = \"modbus-tcp\"\nline = \"tcp:x:502\"",
                16,
                "`lines` belongs to the lines of a GPIO chip",
                "leave",
            ),
            ("type = \"gpio\"", "type = \"dp\"", 7, "`chip` belongs to a bus of type \"gpio\"", "leave it out"),
        ],
    );
    let twice = format!(
        "{GOOD}\n[[module]]\ntype = \"coupler\"\nbus = \"board\"\nname = \"b\"\ninputs = [{{ at = \"EB 8\", lines = [40] }}]\n"
    );
    let Err(findings) = read(&twice) else { panic!("two modules") };
    assert!(findings.iter().any(|f| f.message.contains("the chip has a module already")), "{findings:#?}");
}
