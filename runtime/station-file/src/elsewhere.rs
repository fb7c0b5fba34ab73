//! Where a key belongs that is in the wrong table. The reader of the station file says which keys a table has: its
//! message about an unknown key lists them.

use ob1_params::table::Layout;
use ob1_params::{CpKind, protocols_of};

use super::tables::StationFile;

/// A key that no table has.
const NO_KEY: &str = "no-such-key";
/// If more tables than this have a key, it is not said where the key belongs.
const MOST: usize = 3;

/// What to do about a key that its table, which has the `known` keys, does not have; `None` if no other place of a
/// station file has it.
pub(super) fn remedy(key: &str, known: &[&str]) -> Option<String> {
    if known.contains(&"params") && is_parameter(key) {
        return Some(format!("it is a parameter of the CP: params = {{ {key} = ... }}"));
    }
    let tables = tables();
    if let Some((header, _)) = tables.iter().find(|(header, _)| header.trim_matches(['[', ']']) == key) {
        return Some(format!("it is a table of its own: {header}"));
    }
    let has = |keys: &[String]| keys.iter().any(|one| one == key);
    let mut having: Vec<&str> =
        tables.iter().filter(|(_, keys)| has(keys)).map(|(header, _)| header.as_str()).collect();
    if is_parameter(key) {
        having.push("the `params` of a CP");
    }
    (1..=MOST).contains(&having.len()).then(|| format!("it belongs in {}", having.join(" or ")))
}

/// The headers of all tables, with their keys.
fn tables() -> Vec<(String, Vec<String>)> {
    let mut tables = Vec::new();
    for name in keys_of("") {
        for header in both(&name) {
            let keys = keys_of(&header);
            let parts = keys.iter().flat_map(|key| both(&format!("{name}.{key}")));
            let parts: Vec<(String, Vec<String>)> = parts.map(|part| (part.clone(), keys_of(&part))).collect();
            tables.push((header, keys));
            tables.extend(parts);
        }
    }
    tables.retain(|(_, keys)| !keys.is_empty());
    tables
}

/// A table that is there once, and one that may be there several times.
fn both(name: &str) -> [String; 2] {
    [format!("[{name}]"), format!("[[{name}]]")]
}

/// The keys of a table, from what is said about a wrong one; none if it is no such table, or takes every key.
fn keys_of(header: &str) -> Vec<String> {
    let Err(error) = toml::from_str::<StationFile>(&format!("{header}\n{NO_KEY} = 0\n")) else { return Vec::new() };
    let message = error.message();
    if !message.starts_with("unknown field") {
        return Vec::new();
    }
    message.split('`').skip(1).step_by(2).filter(|key| *key != NO_KEY).map(str::to_owned).collect()
}

/// Whether a CP with parameters as keys has this one.
fn is_parameter(key: &str) -> bool {
    let of_bytes = || Layout::ALL.iter().flat_map(|layout| layout.fields()).any(|field| field.key == key);
    let of_keys =
        |kind| protocols_of(kind).iter().flat_map(|(_, tables)| *tables).flat_map(|t| *t).any(|row| row.key == key);
    key == "protocol" || of_bytes() || CpKind::TABLE.iter().any(|row| of_keys(row.kind))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_of_another_table_is_told_where_it_belongs() {
        let cpu = ["min_cycle", "watchdog"];
        for (key, known, says) in [
            ("min_cycle", &["name", "user"][..], Some("it belongs in [cpu]")),
            ("priority", &cpu, Some("it belongs in [cpu.realtime] or the `params` of a CP")),
            ("period", &cpu, Some("it belongs in [[cpu.cyclic]] or [[module]]")),
            ("retentive", &cpu, Some("it is a table of its own: [retentive]")),
            ("simulated_line", &cpu, Some("it is a table of its own: [[simulated_line]]")),
            ("parity", &["type", "params"], Some("it is a parameter of the CP: params = { parity = ... }")),
            ("protocol", &["type", "params"], Some("it is a parameter of the CP: params = { protocol = ... }")),
            ("name", &cpu, None),
            ("colour", &cpu, None),
        ] {
            assert_eq!(remedy(key, known).as_deref(), says, "{key}");
        }
    }
}
