//! Where a key belongs that is in the wrong table.

use ob1_params::cp240_table::Layout;
use ob1_params::{CpKind, protocols_of};

use super::link;
use super::tables::KEYS;

/// If more tables than this have a key, it is not said where the key belongs.
const MOST: usize = 3;

/// What to do about a key that its table, which has the `known` keys, does not have; `None` if no other place of a
/// station file has it.
pub(super) fn remedy(key: &str, known: &[&str]) -> Option<String> {
    if known.contains(&"params") && is_parameter(key) {
        return Some(format!("it is a parameter of the CP: params = {{ {key} = ... }}"));
    }
    let links = link::all_keys();
    let tables = || KEYS.iter().copied().chain([("[[link]]", &*links)]);
    if let Some((header, _)) = tables().find(|(header, _)| header.trim_matches(['[', ']']) == key) {
        return Some(format!("it is a table of its own: {header}"));
    }
    let mut having: Vec<&str> = tables().filter(|(_, keys)| keys.contains(&key)).map(|(header, _)| header).collect();
    if is_parameter(key) {
        having.push("the `params` of a CP");
    }
    (1..=MOST).contains(&having.len()).then(|| format!("it belongs in {}", having.join(" or ")))
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
