//! One station file for many stations: `{folder}` in the station's name, `{station}`, `{number}` and `{1}` to `{9}` in
//! its links.
//!
//! Forty racks have one file, in forty folders: a folder gives its station the name, and the name gives its links their
//! ports and names. (docs/fleet.md)

use std::ops::Range;
use std::path::Path;

use toml::Value;

use super::findings::VALUE;
use super::tables::StationFile;
use crate::finding::{Finding, Level, Text};

/// The keys of a link with patterns.
const PATTERNED: [&str; 11] = [
    "listen",
    "client",
    "prefix",
    "sparkplug",
    "node",
    "user",
    "users",
    "certificate",
    "key",
    "audit",
    "password_file",
];

/// Replaces the patterns of a file in this folder.
pub(super) fn expand(file: &mut StationFile, source: Text<'_>, folder: &Path) -> Result<(), Vec<Finding>> {
    let mut findings = Vec::new();
    let mut put = |at: Range<usize>, text: &mut String, known: &[(&str, String)], is_address: bool| match replaced(
        text, known, is_address,
    ) {
        Ok(new) => *text = new,
        Err(message) => {
            let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
            let remedy = format!("there are {} (docs/fleet.md)", names.join(" "));
            findings.push(source.finding(Level::Error, VALUE, at, message, remedy));
        }
    };
    let folder = std::path::absolute(folder).unwrap_or_default();
    let folder = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    put(file.station.name.span(), file.station.name.get_mut(), &[("{folder}", folder)], false);
    let station = file.station.name.get_ref().clone();
    let digits = station.len() - station.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let number = station.get(station.len() - digits..).unwrap_or_default().trim_start_matches('0');
    let number = if digits > 0 && number.is_empty() { "0" } else { number };
    let mut known = vec![("{station}", station.clone()), ("{number}", number.to_owned())];
    known.retain(|(_, value)| !value.is_empty());
    let pieces = ["{1}", "{2}", "{3}", "{4}", "{5}", "{6}", "{7}", "{8}", "{9}"];
    known.extend(pieces.into_iter().zip(station.split('-').map(str::to_owned)));
    for (key, value) in file.link.iter_mut().flat_map(|link| link.get_mut()) {
        let key = key.get_ref().as_str();
        let at = value.span();
        if let (true, Value::String(text)) = (PATTERNED.contains(&key), value.get_mut()) {
            put(at, text, &known, key == "listen");
        }
    }
    if findings.is_empty() { Ok(()) } else { Err(findings) }
}

/// The text with its patterns replaced, and the sum of a port such as `9400+7`.
fn replaced(text: &str, known: &[(&str, String)], is_address: bool) -> Result<String, String> {
    let mut new = text.to_owned();
    for (name, value) in known {
        new = new.replace(name, value);
    }
    if let Some(open) = new.find('{')
        && let Some(close) = new.get(open..).and_then(|rest| rest.find('}'))
    {
        let unknown = new.get(open..=open + close).unwrap_or_default();
        return Err(format!("\"{text}\": {unknown} stands for nothing with this name of the station"));
    }
    if is_address
        && let Some((before, port)) = new.rsplit_once(':')
        && let Some((base, more)) = port.split_once('+')
    {
        let sum = base.parse::<u16>().ok().zip(more.parse().ok()).and_then(|(base, more)| base.checked_add(more));
        return sum.map(|port| format!("{before}:{port}")).ok_or_else(|| format!("\"{text}\": {port} is no port"));
    }
    Ok(new)
}

#[cfg(test)]
mod tests {
    use ob1_access::settings::GateKind;

    use super::*;
    use crate::{LinkSettings, parse};

    fn station(name: &str, keys: &str) -> String {
        format!(
            "[station]\nname = \"{name}\"\n[[link]]\ntype = \"mqtt\"\nname = \"plant\"\nbroker = \"mqtt://127.0.0.1\"\n{keys}\n"
        )
    }

    #[test]
    fn the_folder_names_the_station_and_the_name_its_links() {
        let text = station(
            "{folder}",
            "sparkplug = \"{1}\"\nnode = \"{2}\"\nclient = \"ob1-{station}\"\npublish = [\"M1.0\"]",
        ) + "[[link]]\ntype = \"metrics\"\nname = \"figures\"\nlisten = \"127.0.0.1:9400+{number}\"\n";
        let found = parse(&text, "station.toml", Path::new("/etc/ob1/hall3-press017")).expect("a station");
        assert_eq!(found.name, "hall3-press017");
        let LinkSettings::Gate(told) = &found.links[0].settings else { panic!("{found:?}") };
        let GateKind::Mqtt(told) = &told.own else { panic!("{told:?}") };
        assert_eq!(told.sparkplug, Some(("hall3".into(), "press017".into())));
        assert_eq!(told.client, "ob1-hall3-press017");
        assert_eq!(found.links[1].listen.map(|at| at.port()), Some(9417));
    }

    #[test]
    fn a_pattern_that_stands_for_nothing_is_told_at_its_place() {
        let wrong = |name: &str, keys: &str| {
            let text = station(name, keys);
            parse(&text, "station.toml", Path::new("/etc/ob1/press")).expect_err("refused")[0].to_string()
        };
        let told = wrong("press", "client = \"{number}\"\npublish = [\"M1.0\"]");
        assert!(told.contains("station.toml:7:10") && told.contains("{number} stands for nothing"), "{told}");
        assert!(wrong("press", "client = \"{4}\"").contains("there are {station} {1}"));
        assert!(wrong("{station}", "").contains("{station} stands for nothing"));
        for (port, told) in [("65000+{number}", "65000+999 is no port"), ("x+1", "x+1 is no port")] {
            let text = format!(
                "[station]\nname = \"p999\"\n[[link]]\ntype = \"s7\"\nname = \"s\"\nlisten = \"127.0.0.1:{port}\"\n"
            );
            let found = parse(&text, "station.toml", Path::new("")).expect_err("refused");
            assert!(found[0].to_string().contains(told), "{}", found[0]);
        }
    }
}
