//! A timed stimulus: process inputs set at given times, from a TOML file. Times count from the start of the runtime, so
//! the same file does the same in a simulation.

use std::path::Path;

use ob1_backplane::{IoField, IoImage};
use ob1_cpu::Cell;
use ob1_model::Area;
use ob1_time::{Instant, Span};
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Spanned;

use super::panel;
use ob1_access::Names;
use ob1_access::value;
use ob1_station_file::finding::{Finding, Level, Spot, Text};
use ob1_station_file::findings::{STIMULUS, unreadable};
use ob1_station_file::{ModuleConfig, parse_duration};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    repeat: Option<Spanned<String>>,
    #[serde(default)]
    at: Vec<At>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct At {
    time: Spanned<String>,
    set: BTreeMap<Spanned<String>, Spanned<toml::Value>>,
}

/// One change of inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Change {
    /// Since the list began.
    time: Span,
    bit: u32,
    bits: u8,
    value: u32,
}

/// A list of timed changes, and how far it has been played.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stimulus {
    changes: Vec<Change>,
    /// The list starts again after this time.
    repeat: Option<Span>,
    next: usize,
    /// When the current round of the list began.
    round: Instant,
}

impl Stimulus {
    /// Reads a stimulus file. `place` names it.
    ///
    /// # Errors
    /// All findings: an unreadable file, or every mistake in it.
    pub fn load(path: &Path, place: &Spot) -> Result<Self, Vec<Finding>> {
        match ob1_process::files::read_text(path) {
            Ok(text) => Self::parse(&text, &path.display().to_string()),
            Err(error) => Err(vec![unreadable(place, path, &error)]),
        }
    }

    /// Reads the text of a stimulus file.
    ///
    /// # Errors
    /// All findings: every mistake in the text.
    pub fn parse(text: &str, name: &str) -> Result<Self, Vec<Finding>> {
        let source = Text { file: name, text };
        let error = |at, message, remedy: &str| source.finding(Level::Error, STIMULUS, at, message, remedy.to_owned());
        let file: File = toml::from_str(text).map_err(|e| {
            let remedy = "a stimulus file has `repeat` and tables [[at]] with `time` and `set`; see docs/process-io.md";
            vec![error(e.span().unwrap_or(0..0), e.message().replace('\n', ", "), remedy)]
        })?;
        let mut found = Vec::new();
        let mut time_of = |text: &Spanned<String>| match parse_duration(text.get_ref()) {
            Ok(time) => time,
            Err(message) => {
                found.push(error(text.span(), message, "a number and a unit, in quotes: \"250ms\""));
                Span::ZERO
            }
        };
        let repeat = file.repeat.as_ref().map(&mut time_of);
        let times: Vec<Span> = file.at.iter().map(|at| time_of(&at.time)).collect();
        let mut changes = Vec::new();
        for (at, &time) in file.at.iter().zip(&times) {
            if repeat.is_some_and(|repeat| time >= repeat) {
                let message = "this time is never reached: the list begins again before it".to_owned();
                found.push(error(at.time.span(), message, "make it earlier than `repeat`"));
            }
            for (cell, value) in &at.set {
                match change(time, cell.get_ref(), value.get_ref()) {
                    Ok(change) => changes.push(change),
                    Err(message) => found.push(error(
                        cell.span().start..value.span().end,
                        message,
                        "inputs are named as in STL, such as \"E 0.0\" = true or \"EW 4\" = 1234",
                    )),
                }
            }
        }
        if repeat == Some(Span::ZERO) {
            found.push(error(
                0..0,
                "repeat must be longer than 0".to_owned(),
                "one round of a repeated stimulus must take time",
            ));
        }
        changes.sort_by_key(|change| change.time);
        if found.is_empty() { Ok(Self { changes, repeat, next: 0, round: Instant::START }) } else { Err(found) }
    }

    /// A warning for each cell of a stimulus file with a byte in no module of type `di` or `ai`: nothing reads that
    /// byte. A file with mistakes gets no warnings: the mistakes are reported when it is loaded.
    #[must_use]
    pub fn unread(path: &Path, modules: &[ModuleConfig]) -> Vec<Finding> {
        let (name, inputs) = (path.display().to_string(), panel::inputs(modules));
        let text = ob1_process::files::read_text(path).unwrap_or_default();
        let source = Text { file: &name, text: &text };
        let Ok(file) = toml::from_str::<File>(&text) else { return Vec::new() };
        let mut found = Vec::new();
        for (cell, value) in file.at.iter().flat_map(|at| &at.set) {
            let Ok(change) = change(Span::ZERO, cell.get_ref(), value.get_ref()) else { continue };
            let last = change.bit + u32::from(change.bits) - 1;
            if (change.bit / 8..=last / 8).all(|byte| inputs.iter().any(|module| module.contains(&byte))) {
                continue;
            }
            let message = format!("{} is in no module of type di or ai: nothing reads it", cell.get_ref());
            let remedy = "correct the address, or add [[module]] with type = \"di\" there".to_owned();
            found.push(source.finding(Level::Warning, STIMULUS, cell.span(), message, remedy));
        }
        found
    }

    /// Does what is due.
    pub(super) fn play(&mut self, now: Instant, image: &IoImage, field: &IoField) {
        if self.changes.is_empty() {
            return;
        }
        // After a long pause whole rounds are left out: only the last one could still be seen.
        if let Some(repeat) = self.repeat
            && now.since(self.round) >= repeat.times(2)
        {
            self.round += repeat * ((now - self.round) / repeat);
            self.next = 0;
        }
        loop {
            while let Some(change) = self.changes.get(self.next) {
                if self.round + change.time > now {
                    return;
                }
                apply(change, image, field);
                self.next += 1;
            }
            match self.repeat {
                Some(repeat) if self.round + repeat <= now => (self.round, self.next) = (self.round + repeat, 0),
                _ => return,
            }
        }
    }
}

fn apply(change: &Change, image: &IoImage, field: &IoField) {
    let byte = (change.bit / 8) as usize;
    if change.bits == 1 {
        let mut cell = [0];
        image.read_inputs(byte, &mut cell);
        let mask = 1u8 << (change.bit % 8);
        let [old] = cell;
        field.write_inputs(byte, &[if change.value != 0 { old | mask } else { old & !mask }]);
    } else {
        let bytes = change.value.to_be_bytes();
        field.write_inputs(byte, &bytes[bytes.len() - usize::from(change.bits / 8)..]);
    }
}

fn change(time: Span, cell: &str, value: &toml::Value) -> Result<Change, String> {
    let item = Names::default().parse(cell)?;
    let (Cell::Area(Area::Input, bit) | Cell::Peripheral(bit)) = item.cell else {
        return Err(format!("{cell} is not an input"));
    };
    let json = match value {
        toml::Value::Boolean(bit) => serde_json::Value::from(*bit),
        toml::Value::Integer(number) => serde_json::Value::from(*number),
        toml::Value::String(text) => serde_json::Value::from(text.as_str()),
        other => return Err(format!("a {} is not a value for {cell}", other.type_str())),
    };
    Ok(Change { time, bit, bits: item.width.bits(), value: value::from_json(&item, &json)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Span = Span::MILLISECOND;

    fn inputs(stimulus: &mut Stimulus, image: &IoImage, now: Span) -> [u8; 8] {
        stimulus.play(Instant::START + now, image, &image.field());
        let mut bytes = [0; 8];
        image.read_inputs(0, &mut bytes);
        bytes
    }

    #[test]
    fn changes_come_when_they_are_due() {
        let text = "[[at]]\ntime = \"20ms\"\nset = { \"E 0.0\" = false, \"EW 2\" = -2 }\n\
                    [[at]]\ntime = \"10ms\"\nset = { \"E 0.0\" = true, \"I 0.7\" = 1, \"EB 1\" = \"16#5A\" }\n";
        let mut stimulus = Stimulus::parse(text, "s.toml").expect("good");
        let image = IoImage::heap();
        assert_eq!(inputs(&mut stimulus, &image, 9 * MS), [0; 8]);
        assert_eq!(inputs(&mut stimulus, &image, 10 * MS), [0x81, 0x5A, 0, 0, 0, 0, 0, 0]);
        assert_eq!(inputs(&mut stimulus, &image, 500 * MS), [0x80, 0x5A, 0xFF, 0xFE, 0, 0, 0, 0]);
    }

    #[test]
    fn a_list_repeats_and_skips_what_nobody_saw() {
        let text = "repeat = \"100ms\"\n[[at]]\ntime = \"0ms\"\nset = { \"EB 0\" = 1 }\n[[at]]\ntime = \"50ms\"\nset = { \"EB 0\" = 2 }\n";
        let mut stimulus = Stimulus::parse(text, "s.toml").expect("good");
        let image = IoImage::heap();
        for (now, value) in
            [(0, 1), (49, 1), (50, 2), (99, 2), (100, 1), (149, 1), (150, 2), (1_000_020, 1), (1_000_050, 2)]
        {
            assert_eq!(inputs(&mut stimulus, &image, now * MS)[0], value, "{now} ms");
        }
    }

    #[test]
    fn a_cell_that_no_module_reads_is_told() {
        let station = "[station]\nname = \"x\"\n[[module]]\ntype = \"di\"\nname = \"a\"\naddress = 4\nbytes = 2\n\
                       [[module]]\ntype = \"ai\"\nname = \"b\"\naddress = 6\nchannels = 1\n\
                       [[module]]\ntype = \"do\"\nname = \"c\"\naddress = 8\nbytes = 2\n";
        let station = ob1_station_file::parse(station, "x.toml", Path::new("")).expect("good");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("s.toml");
        // The first line has what is read: also over the border of two modules.
        let text = "[[at]]\ntime = \"0ms\"\nset = { \"E 4.0\" = 1, \"EW 5\" = 1, \"PEW 6\" = 1 }\n\
                    [[at]]\ntime = \"1ms\"\nset = { \"E 3.7\" = 1 }\n\
                    [[at]]\ntime = \"1ms\"\nset = { \"EW 7\" = 1 }\n\
                    [[at]]\ntime = \"1ms\"\nset = { \"EB 8\" = 1 }\n";
        std::fs::write(&path, text).expect("room");
        let found = Stimulus::unread(&path, &station.modules);
        let told: Vec<_> = found.iter().map(|f| (f.level, f.code.as_str(), f.line, f.column)).collect();
        assert_eq!(told, [6, 9, 12].map(|line| (Level::Warning, STIMULUS, line, 9)));
        assert!(found[1].message.starts_with("EW 7 is in no module"), "{found:?}");
        std::fs::write(&path, "[[at]]\ntime = 5\n").expect("room");
        assert!(Stimulus::unread(&path, &station.modules).is_empty());
    }

    #[test]
    fn mistakes_are_named() {
        let text = "repeat = \"1s\"\n[[at]]\ntime = \"2s\"\nset = { \"A 0.0\" = 1, \"EB 0\" = 256, \"EX\" = 1 }\n[[at]]\ntime = \"soon\"\nset = {}\n";
        let found = Stimulus::parse(text, "s.toml").expect_err("bad");
        let text: String = found.iter().map(ToString::to_string).collect();
        for part in [
            "never reached",
            "A 0.0 is not an input",
            "256 does not fit",
            "\"EX\" is not the name of a cell",
            "\"soon\" is not a unit",
        ] {
            assert!(text.contains(part), "{part} is missing in\n{text}");
        }
        assert!(text.contains("s.toml:6:8"), "{text}");
        assert!(Stimulus::parse("[[on]]\n", "s.toml").is_err());
    }
}
