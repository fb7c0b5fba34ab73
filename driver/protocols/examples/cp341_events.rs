//! Prints `docs/cp341-events.md`.

#[path = "../tests/protocols/cp341_events_page/mod.rs"]
mod cp341_events_page;

fn main() {
    print!("{}", cp341_events_page::page());
}
