//! Warnings about serial devices that do not exist or that this user may not open: no error, because an adapter may be
//! plugged in later, and rights may be given, but reported before somebody waits for it.

use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};
use rustix::io::Errno;

use super::findings::LINE;
use super::line::Line;
use super::tables::StationFile;
use crate::finding::{Finding, Level, Text};

/// Whether this user can open a device.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Device {
    /// It can be opened.
    Open,
    /// This user may not read and write it.
    Locked,
    /// It is not there.
    Missing,
}

/// The state of this device now.
pub(super) fn state(device: &Path) -> Device {
    match access(device, Access::READ_OK | Access::WRITE_OK) {
        Err(Errno::ACCESS | Errno::PERM) => Device::Locked,
        _ if device.exists() => Device::Open,
        _ => Device::Missing,
    }
}

/// A warning for each module whose serial device does not exist, or may not be opened.
pub(super) fn not_ready(
    file: &StationFile,
    source: Text<'_>,
    folder: &Path,
    state: impl Fn(&Path) -> Device,
) -> Vec<Finding> {
    let lines = file.module.iter().filter_map(|module| module.get_ref().line.as_ref());
    lines
        .chain(file.bus.iter().filter_map(|bus| bus.line.as_ref()))
        .filter_map(|line| {
            let Ok(Line::Serial(device)) = Line::parse(line.get_ref(), folder) else { return None };
            let (message, remedy) = match state(&device) {
                Device::Open => return None,
                Device::Locked => (
                    format!("this user may not read and write {}; its line is reported as gone", device.display()),
                    format!("make the user a member of its group, mostly dialout (ls -l {})", device.display()),
                ),
                Device::Missing => (
                    format!("there is no device {} now; its line is reported as gone", device.display()),
                    remedy(&present()),
                ),
            };
            Some(source.finding(Level::Warning, LINE, line.span(), message, remedy))
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
    fn only_serial_devices_that_are_not_there_or_may_not_be_opened() {
        let module = |name: &str, line: &str| {
            format!("[[module]]\ntype = \"cp240\"\nname = \"{name}\"\naddress = 256\nline = \"{line}\"\n")
        };
        let text = ["serial:/dev/ttyUSB7", "serial:/dev/ttyS0", "pty:/dev/none", "tcp:nowhere:1", "serial:cable.pty"]
            .map(|line| module("cp", line))
            .concat();
        let text = format!("[station]\nname = \"a\"\n[program]\nsources = []\n{text}");
        let (file, source) = (toml::from_str(&text).expect("a station file"), Text { file: "a.toml", text: &text });
        let state = |path: &Path| if path == Path::new("/dev/ttyS0") { Device::Open } else { Device::Missing };
        let found = not_ready(&file, source, Path::new("/s"), state);
        let told: Vec<_> = found.iter().map(|f| (f.level, f.code.as_str(), f.line, f.column)).collect();
        assert_eq!(told, [(Level::Warning, "C009", 9, 8), (Level::Warning, "C009", 29, 8)]);
        assert!(found[0].message.contains("/dev/ttyUSB7") && found[1].message.contains("/s/cable.pty"), "{found:?}");
        assert!(not_ready(&file, source, Path::new("/s"), |_| Device::Open).is_empty());
        let state = |path: &Path| if path == Path::new("/dev/ttyS0") { Device::Locked } else { Device::Open };
        let found = not_ready(&file, source, Path::new("/s"), state);
        let [locked] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!((locked.level, locked.line), (Level::Warning, 14));
        assert!(locked.message.starts_with("this user may not read and write /dev/ttyS0"), "{locked:?}");
        assert!(locked.remedy.contains("dialout"), "{locked:?}");
    }

    #[test]
    fn what_is_plugged_in_is_named() {
        assert!(!remedy(&[]).contains("there are"));
        assert!(remedy(&["/dev/serial/by-id/usb-x".into()]).ends_with("there are: /dev/serial/by-id/usb-x"));
    }
}
