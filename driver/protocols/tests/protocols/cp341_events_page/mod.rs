//! `docs/cp341-events.md`, rendered from the table.

use std::fmt::Write as _;

use ob1_words::cp341_events::{CLASSES, Row, rows};

const HEAD: &str = "\
# Event numbers of the CP 341 and the CP 340

STATUS of P_SND_RK, P_RCV_RK and P_PRT341, of P_SEND, P_RCV and P_PRINT, and the entries of the CP's diagnostic buffer:
class (high byte) and number (low byte). STATUS is not 0 in the one call in which ERROR is 1. The numbers mean the same
in every block.

The last column tells why a number does not occur here: *fact only* (the state cannot arise in this CP), *other
module* (CP 440, CP 441, Modbus slave), *hardware fault* (of the module or its firmware). It is empty for those that do.

This page is printed by `cargo run -p ob1-protocols --example cp341_events` from the table in
`backplane/words/src/cp341_events`; a test holds the two together.
";

/// The page.
pub(crate) fn page() -> String {
    let mut page = HEAD.to_owned();
    for (class, name) in CLASSES {
        page += &format!("\n## {class:02X}h: {name}\n\n| STATUS | event | remedy | not here |\n|---|---|---|---|\n");
        for Row { number, text, remedy, origin } in rows().filter(|row| row.number >> 8 == u16::from(class)) {
            writeln!(page, "| {number:04X} | {text} | {remedy} | {} |", origin.reason()).expect("a string takes all");
        }
    }
    page
}
