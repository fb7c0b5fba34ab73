//! Drawings with colours for a terminal.

use ob1_ladder::flow::{Flow, State};
use ob1_ladder::{Drawing, Place, text};

/// Back to what was before.
pub(crate) const PLAIN: &str = "\u{1b}[0m";
/// What is fulfilled; in a difference what is new.
pub(crate) const GREEN: &str = "\u{1b}[32m";
/// What is not fulfilled.
pub(crate) const BLUE: &str = "\u{1b}[34m";
/// In a difference what is gone.
pub(crate) const RED: &str = "\u{1b}[31m";

/// The lines of a drawing; `colour` gives that of a place.
pub(crate) fn lines(drawing: &Drawing, colour: &dyn Fn(Place) -> Option<&'static str>) -> Vec<String> {
    let mut out = Vec::new();
    for row in text::cells(drawing, false) {
        let used = row.iter().rposition(|cell| cell.sign != ' ').map_or(0, |last| last + 1);
        let (mut line, mut now) = (String::new(), None);
        for cell in row.iter().take(used) {
            let wanted = cell.place.and_then(colour);
            if wanted != now {
                line.push_str(wanted.unwrap_or(PLAIN));
                now = wanted;
            }
            line.push(cell.sign);
        }
        if now.is_some() {
            line.push_str(PLAIN);
        }
        out.push(line);
    }
    out
}

/// Fulfilled green, not fulfilled blue, not known as it is. Without colours a wire that is not fulfilled is dotted.
pub(crate) fn flowing(drawing: &Drawing, flow: &Flow, coloured: bool) -> Vec<String> {
    let colour = |place| match flow.of(place) {
        State::On => Some(GREEN),
        State::Off => Some(BLUE),
        State::Unknown => None,
    };
    if coloured {
        return lines(drawing, &colour);
    }
    let sign = |cell: &text::Cell| match (cell.place.map(|place| flow.of(place)), cell.sign) {
        (Some(State::On), '─') => '━',
        (Some(State::Off), '─') => '╌',
        (_, sign) => sign,
    };
    let line = |row: &Vec<text::Cell>| row.iter().map(sign).collect::<String>().trim_end().to_owned();
    text::cells(drawing, false).iter().map(line).collect()
}
