//! Names of an imported station: its files, and texts of the project as names and in comments.

use std::collections::BTreeSet;

/// The name of the station file.
pub(super) const STATION: &str = "station.toml";

/// The name of the report.
pub(super) const REPORT: &str = "report.txt";

/// The name of the symbol table.
pub(super) const SYMBOLS: &str = "symbols.sdf";

/// The folder of sources and machine code.
pub(super) const BLOCKS: &str = "blocks";

/// The folder of the project's SCL sources.
pub(super) const SCL: &str = "scl";

/// The folder of drawings.
pub(super) const DRAWINGS: &str = "drawings";

/// The folder of GSD files in an imported station.
pub(super) const GSD: &str = "gsd";

/// A comment's text in one line.
pub(super) fn line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}

/// `wanted`, or with a number where that is among `names` already; among them from then on.
pub(super) fn unique(names: &mut BTreeSet<String>, wanted: &str) -> String {
    let numbered = (2..).map(|count| format!("{wanted}-{count}"));
    let mut all = std::iter::once(wanted.to_owned()).chain(numbered);
    all.find(|name| names.insert(name.clone())).unwrap_or_default()
}

/// Letters, digits, `-` and `_`.
pub(super) fn clean(text: &str, most: usize) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            c if c.is_ascii_alphanumeric() || c == '_' => out.push(c.to_ascii_lowercase()),
            _ if !out.is_empty() && !out.ends_with('-') => out.push('-'),
            _ => {}
        }
    }
    out.truncate(most);
    out.trim_matches('-').to_owned()
}
