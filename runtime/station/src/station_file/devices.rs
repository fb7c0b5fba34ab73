//! Warnings about serial devices that do not exist: no error, because an adapter may be plugged in later, but reported
//! before somebody waits for it.

use std::path::{Path, PathBuf};

use super::findings::LINE;
use super::line::Line;
use super::tables::StationFile;
use crate::finding::{Finding, Level, Text};

/// A warning for each module whose serial device does not exist.
pub(super) fn missing(
    file: &StationFile,
    source: Text<'_>,
    folder: &Path,
    exists: impl Fn(&Path) -> bool,
) -> Vec<Finding> {
    let lines = file.module.iter().filter_map(|module| module.get_ref().line.as_ref());
    lines
        .chain(file.bus.iter().filter_map(|bus| bus.line.as_ref()))
        .filter_map(|line| match Line::parse(line.get_ref(), folder) {
            Ok(Line::Serial(device)) if !exists(&device) => {
                let message = format!("there is no device {} now; its line is reported as gone", device.display());
                Some(source.finding(Level::Warning, LINE, line.span(), message, remedy(&present())))
            }
            _ => None,
        })
        .collect()
}

fn remedy(present: &[PathBuf]) -> String {
    let names: Vec<String> = present.iter().map(|path| path.display().to_string()).collect();
    match names.as_slice() {
        [] => "plug the adapter in (it is used as soon as it is there), or correct the name".into(),
        names => format!(
            "plug the adapter in (it is used as soon as it is there), or correct the name; there are: {}",
            names.join(", ")
        ),
    }
}

/// Names of adapters that do not depend on where they are plugged in.
fn present() -> Vec<PathBuf> {
    let entries = std::fs::read_dir("/dev/serial/by-id");
    let mut names: Vec<PathBuf> = entries.into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path())).collect();
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_serial_devices_that_are_not_there() {
        let module = |name: &str, line: &str| {
            format!("[[module]]\ntype = \"cp240\"\nname = \"{name}\"\naddress = 256\nline = \"{line}\"\n")
        };
        let text = ["serial:/dev/ttyUSB7", "serial:/dev/ttyS0", "pty:/dev/none", "tcp:nowhere:1", "serial:cable.pty"]
            .map(|line| module("cp", line))
            .concat();
        let text = format!("[station]\nname = \"a\"\n[program]\nsources = []\n{text}");
        let (file, source) = (toml::from_str(&text).expect("a station file"), Text { file: "a.toml", text: &text });
        let found = missing(&file, source, Path::new("/s"), |path| path == Path::new("/dev/ttyS0"));
        let told: Vec<_> = found.iter().map(|f| (f.level, f.code.as_str(), f.line, f.column)).collect();
        assert_eq!(told, [(Level::Warning, "C009", 9, 8), (Level::Warning, "C009", 29, 8)]);
        assert!(found[0].message.contains("/dev/ttyUSB7") && found[1].message.contains("/s/cable.pty"), "{found:?}");
        assert!(missing(&file, source, Path::new("/s"), |_| true).is_empty());
    }

    #[test]
    fn what_is_plugged_in_is_named() {
        assert!(!remedy(&[]).contains("there are"));
        assert!(remedy(&["/dev/serial/by-id/usb-x".into()]).ends_with("there are: /dev/serial/by-id/usb-x"));
    }
}
