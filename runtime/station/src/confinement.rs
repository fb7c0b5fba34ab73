//! What each driver may do: the smallest that its line needs, passed in `OB1_FENCE` (docs/security.md).

use std::ffi::OsString;
use std::net::IpAddr;
use std::path::Path;

use serde_json::json;

use ob1_station_file::Line;

/// The variable for a process that makes things in these folders, only links in those others, and speaks over these
/// lines.
#[must_use]
pub fn variable<'a>(
    folders: impl IntoIterator<Item = &'a Path>,
    links: impl IntoIterator<Item = &'a Path>,
    lines: impl IntoIterator<Item = &'a Line> + Clone,
) -> (OsString, OsString) {
    let folders: Vec<&Path> = folders.into_iter().collect();
    let links: Vec<&Path> = links.into_iter().chain(lines.clone().into_iter().filter_map(folder_of)).collect();
    // The widest of what they need.
    let needs: Vec<&str> = lines.into_iter().map(network).collect();
    let network = ["name", "address"].into_iter().find(|network| needs.contains(network)).unwrap_or("none");
    let text = json!({ "folders": folders, "links": links, "network": network });
    ("OB1_FENCE".into(), text.to_string().into())
}

/// Where the link of a pty is made.
fn folder_of(line: &Line) -> Option<&Path> {
    if let Line::Pty(path) = line { path.parent() } else { None }
}

fn network(line: &Line) -> &'static str {
    match line {
        Line::Tcp(place) => {
            let host = place.rsplit_once(':').map_or(place.as_str(), |(host, _)| host);
            let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
            if bare.parse::<IpAddr>().is_ok() { "address" } else { "name" }
        }
        Line::Listen(_) => "address",
        Line::Serial(_) | Line::Pty(_) | Line::Sim(_) => "none",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_gets_what_its_line_needs() {
        let line = |text: &str| Line::parse(text, Path::new("/s")).expect("a line");
        for (text, fence) in [
            ("serial:/dev/ttyS0", r#"{"folders":["/run/x"],"links":[],"network":"none"}"#),
            ("pty:a/b.pty", r#"{"folders":["/run/x"],"links":["/s/a"],"network":"none"}"#),
            ("tcp:10.0.0.1:4001", r#"{"folders":["/run/x"],"links":[],"network":"address"}"#),
            ("tcp:[::1]:4001", r#"{"folders":["/run/x"],"links":[],"network":"address"}"#),
            ("tcp:press.local:4001", r#"{"folders":["/run/x"],"links":[],"network":"name"}"#),
            ("tcp-listen:4001", r#"{"folders":["/run/x"],"links":[],"network":"address"}"#),
            ("sim:cable", r#"{"folders":["/run/x"],"links":[],"network":"none"}"#),
        ] {
            let (_, told) = variable([Path::new("/run/x")], None, Some(&line(text)));
            assert_eq!(told.to_str(), Some(fence), "{text}");
        }
    }
}
