//! Retentive ranges, and where they are written.

use std::ffi::OsString;
use std::ops::Range;
use std::path::{Path, PathBuf};

use ob1_access::Right;
use ob1_cpu::{CpuConfig, DataRange, Retentive, RetentiveData};
use ob1_model::{BlockId, BlockKind};
use ob1_time::Span;

use super::duration::parse_duration;
use super::findings::{CONTRADICTION, Findings, VALUE};
use super::tables::{Placed, RetentiveTable, StationTable};
use super::types::{LinkKind, StationLink};
use crate::finding::Spot;

/// Where and how often retentive memory is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RetentiveFile {
    /// The folder of the retentive files.
    pub folder: PathBuf,
    /// Time between two images in RUN.
    pub every: Span,
    /// The data blocks that the station file names, each with its place.
    pub named: Vec<(u16, Spot)>,
}

/// Time between two images, when the file does not say it.
const EVERY: Span = Span::from_secs(1);
/// Shorter than this the disk would do nothing else.
const SHORTEST: Span = Span::from_millis(100);

/// Puts the ranges into the CPU's configuration; returns the file if the table is there.
pub(super) fn retentive(
    f: &mut Findings<'_>,
    table: Option<&RetentiveTable>,
    station: &StationTable,
    folder: &Path,
    cpu: &mut CpuConfig,
) -> Option<RetentiveFile> {
    let table = table?;
    let mut named = Vec::new();
    cpu.retentive = Retentive {
        memory: ranges(f, "memory", &table.memory, cpu.memory_bytes),
        timers: ranges(f, "timers", &table.timers, u32::from(cpu.timers)).into_iter().map(narrow).collect(),
        counters: ranges(f, "counters", &table.counters, u32::from(cpu.counters)).into_iter().map(narrow).collect(),
        data: match &table.data {
            None => RetentiveData::All,
            Some(list) => {
                let mut ranges = Vec::with_capacity(list.len());
                for text in list {
                    let Some(range) = data(f, text) else { continue };
                    named.push((range.db, f.spot(text.span())));
                    ranges.push(range);
                }
                RetentiveData::Only(ranges)
            }
        },
    };
    let every = table.every.as_ref().map_or(EVERY, |text| match parse_duration(text.get_ref()) {
        Ok(every) if every >= SHORTEST => every,
        Ok(_) => {
            f.error(VALUE, text.span(), "retentive memory cannot be written so often", "\"100ms\" or more");
            EVERY
        }
        Err(message) => {
            f.error(VALUE, text.span(), message, "a number and a unit, in quotes: \"1s\"");
            EVERY
        }
    });
    Some(RetentiveFile { folder: folder_of(station, folder), every, named })
}

/// Where downloads are kept, where a link may change the program.
pub(super) fn downloads(
    f: &mut Findings<'_>,
    keeps: bool,
    links: &[StationLink],
    station: &StationTable,
    folder: &Path,
) -> Option<PathBuf> {
    let may = |link: &StationLink| link.kind == LinkKind::S7 && link.rights.max(link.password_rights) == Right::Operate;
    let downloads = links.iter().any(may).then(|| folder_of(station, folder));
    // Certificates, audit logs, values that wait.
    let gate = links.iter().any(|link| link.kind.shares_its_process());
    if let (Some(state), None, false) = (&station.state, &downloads, keeps || gate) {
        f.error(
            CONTRADICTION,
            state.span(),
            "`state` is not needed: this station keeps nothing",
            "add [retentive], [[trace]], an S7 link with rights = \"operate\" or a link of the gate, or leave `state` out",
        );
    }
    downloads
}

/// Where the station keeps what outlasts it.
pub(super) fn folder_of(station: &StationTable, folder: &Path) -> PathBuf {
    let named = station.state.as_ref().map(|state| state.get_ref().as_str());
    state_folder(named, std::env::var_os(STATE_DIRECTORY), folder)
}

/// What systemd tells a service of its `StateDirectory=`: one folder, or several with colons between them.
const STATE_DIRECTORY: &str = "STATE_DIRECTORY";

/// Where the files go: where the station file says, else where the service manager says, else beside the station file.
fn state_folder(named: Option<&str>, of_service: Option<OsString>, folder: &Path) -> PathBuf {
    let of_service = of_service.and_then(|folders| std::env::split_paths(&folders).next());
    let of_service = of_service.filter(|path| path.is_absolute());
    named.map(|state| folder.join(state)).or(of_service).unwrap_or_else(|| folder.to_owned())
}

/// They are inside an area of at most 65536.
fn narrow(range: Range<u32>) -> Range<u16> {
    range.start as u16..range.end as u16
}

fn ranges(f: &mut Findings<'_>, key: &str, list: &[Placed<String>], len: u32) -> Vec<Range<u32>> {
    let mut ranges = Vec::with_capacity(list.len());
    for text in list {
        match range(text.get_ref()).filter(|range| range.end <= len) {
            Some(range) => ranges.push(range),
            None => {
                let message = format!("{key} = \"{}\" is not a valid range", text.get_ref());
                f.error(
                    VALUE,
                    text.span(),
                    message,
                    format!("first and last, such as \"0..15\"; the last possible is {}", i64::from(len) - 1),
                );
            }
        }
    }
    ranges
}

/// `0..15`, both of them in it, or `7`.
fn range(text: &str) -> Option<Range<u32>> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let (first, last): (u32, u32) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
    (first <= last).then(|| first..last.saturating_add(1))
}

/// `DB 10`, or `DB 10: 0..19`.
fn data(f: &mut Findings<'_>, text: &Placed<String>) -> Option<DataRange> {
    let (block, bytes) = match text.get_ref().split_once(':') {
        Some((block, bytes)) => (block, Some(range(bytes))),
        None => (text.get_ref().as_str(), None),
    };
    let db = BlockId::parse(block).filter(|id| id.kind == BlockKind::Db && id.number > 0);
    match (db, bytes) {
        (Some(db), None) => Some(DataRange { db: db.number, bytes: None }),
        (Some(db), Some(Some(bytes))) => Some(DataRange { db: db.number, bytes: Some(bytes) }),
        _ => {
            let message = format!("\"{}\" is not a data block", text.get_ref());
            f.error(VALUE, text.span(), message, "\"DB 10\", or some of its bytes: \"DB 10: 0..19\"");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_station_file_comes_before_the_service() {
        let beside = Path::new("/etc/ob1/press");
        let service = |text: &str| Some(OsString::from(text));
        for (named, of_service, expected) in [
            (None, None, "/etc/ob1/press"),
            (None, service("/var/lib/ob1/press"), "/var/lib/ob1/press"),
            (Some("/data"), service("/var/lib/ob1/press"), "/data"),
            (Some("kept"), service("/var/lib/ob1/press"), "/etc/ob1/press/kept"),
            (None, service("/var/lib/ob1/press:/var/lib/more"), "/var/lib/ob1/press"),
            (None, service(""), "/etc/ob1/press"),
            (None, service("relative"), "/etc/ob1/press"),
        ] {
            assert_eq!(state_folder(named, of_service, beside), Path::new(expected));
        }
    }
}
