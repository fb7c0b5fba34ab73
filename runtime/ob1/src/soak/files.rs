//! The files of a soak: where they are, and how each name always stands for a whole file.

use std::io;
use std::path::{Path, PathBuf};

use ob1_process::files::replace;

use super::report::Report;
use super::{html, text};

/// The files of one soak: `BASE.json`, `BASE.txt`, `BASE.html`, and `BASE.log` with what the station has said.
#[derive(Clone, Debug)]
pub(super) struct Files {
    base: PathBuf,
}

impl Files {
    /// With the requested name (an ending `.json` is not part of it), or one made of the station and the date.
    pub(super) fn new(wanted: Option<&Path>, station: &str) -> Self {
        let base = match wanted {
            Some(path) if path.extension().is_some_and(|ending| ending == "json") => path.with_extension(""),
            Some(path) => path.to_owned(),
            None => PathBuf::from(format!("{station}-soak-{}", stamp(ob1_station::wall_clock::date_now()))),
        };
        Self { base }
    }

    pub(super) fn path(&self, ending: &str) -> PathBuf {
        let mut name = self.base.as_os_str().to_owned();
        name.push(".");
        name.push(ending);
        name.into()
    }

    /// The folder they are in.
    pub(super) fn folder(&self) -> PathBuf {
        let parent = self.base.parent().filter(|folder| !folder.as_os_str().is_empty());
        parent.map_or_else(|| PathBuf::from("."), Path::to_owned)
    }

    /// Writes all forms of the report.
    pub(super) fn write(&self, report: &Report) -> io::Result<()> {
        let mut json = serde_json::to_string(report)?;
        json.push('\n');
        replace(&self.path("json"), json.as_bytes())?;
        replace(&self.path("txt"), text::report(report).as_bytes())?;
        replace(&self.path("html"), html::page(report).as_bytes())
    }
}

/// Date and time, for a name: `20261121-081500`, UTC.
fn stamp(nanos_since_1990: u64) -> String {
    let [year, month, day, hour, minute, second, ..] = ob1_cpu::date_and_time(nanos_since_1990);
    format!("20{year:02X}{month:02X}{day:02X}-{hour:02X}{minute:02X}{second:02X}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names() {
        assert_eq!(Files::new(Some(Path::new("out/a.json")), "x").path("html"), Path::new("out/a.html"));
        assert_eq!(Files::new(Some(Path::new("out/v1.2")), "x").path("json"), Path::new("out/v1.2.json"));
        assert_eq!(Files::new(Some(Path::new("a")), "x").folder(), Path::new("."));
        let of_station = Files::new(None, "press").path("json");
        assert!(of_station.display().to_string().starts_with("press-soak-20"), "{of_station:?}");
        // 1990-01-01 is the beginning of time there; years before 2000 do not occur.
        assert_eq!(stamp(3653 * 86_400_000_000_000 + 3_661_000_000_000), "20000102-010101");
    }
}
