//! Inputs and outputs of the modules, channel by channel, with their symbols.

use std::collections::BTreeMap;

use ob1_access::door::Document;
use ob1_stl::Mnemonics;
use serde_json::{Value, json};

use super::Page;
use super::api::{AGE, send, trouble};
use crate::http::Reply;

impl Page {
    /// The modules with process I/O, and the symbols of what they feed and drive.
    pub(super) async fn io(&self) -> Reply {
        let insight = match self.insight.get(&self.station).await {
            Ok(insight) => insight,
            Err(why) => return trouble(&why),
        };
        let status = match self.station.document(Document::Status, AGE).await {
            Ok(text) => serde_json::from_slice::<Value>(&text).unwrap_or_default(),
            Err(why) => return trouble(&why),
        };
        let areas = if insight.set == Mnemonics::International { ["I", "Q"] } else { ["E", "A"] };
        let may = |address: &str| {
            let seen = insight.names.parse(address).is_ok_and(|item| self.allowed.has(item.cell));
            self.allowed.has_program() || seen
        };
        let of_areas = |address: &str| {
            let bare = address.strip_prefix('P').unwrap_or(address);
            areas.iter().any(|area| bare.starts_with(area)) && !bare.starts_with("OB")
        };
        let symbols: BTreeMap<&str, [&str; 2]> = insight
            .symbols()
            .iter()
            .filter(|(address, _)| of_areas(address) && may(address))
            .map(|(address, name)| (address.as_str(), [name.as_str(), insight.comment(name)]))
            .collect();
        let welcome = self.station.welcome();
        let image = [welcome.inputs, welcome.outputs];
        let modules = status["modules"].as_array().map(Vec::as_slice).unwrap_or_default();
        let told = modules.iter().map(|module| {
            let range = |key: &str| [0, 1].map(|at| module[key][at].as_u64().unwrap_or(0) as u32);
            let ranges = [range("inputs"), range("outputs")];
            let analog = module["analog"].as_bool().unwrap_or_else(|| words(ranges, areas, image, &symbols));
            json!({
                "name": module["name"], "type": module["type"], "present": module["present"],
                "inputs": ranges[0], "outputs": ranges[1], "analog": analog,
            })
        });
        send(&json!({ "areas": areas, "modules": told.collect::<Vec<_>>(), "symbols": symbols }))
    }
}

/// Whether the channels of a coupler are words: only words of it have symbols, or it lies behind the process image.
fn words(ranges: [[u32; 2]; 2], areas: [&str; 2], image: [u32; 2], symbols: &BTreeMap<&str, [&str; 2]>) -> bool {
    let mut found = false;
    for ((area, [first, bytes]), image) in areas.iter().zip(ranges).zip(image) {
        found |= bytes > 0 && first >= image;
        for address in symbols.keys() {
            let bare = address.strip_prefix('P').unwrap_or(address);
            let Some((letters, number)) = bare.split_once(' ') else { continue };
            let byte = number.split('.').next().and_then(|number| number.parse::<u32>().ok());
            if letters.trim_end_matches(['B', 'W', 'D']) != *area
                || byte.is_none_or(|at| at < first || at - first >= bytes)
            {
                continue;
            }
            if number.contains('.') {
                return false;
            }
            found |= letters.ends_with(['W', 'D']);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_has_words_if_only_words_of_it_have_names() {
        let symbols = BTreeMap::from([("E 0.1", ["start", ""]), ("EW 4", ["level", ""]), ("PEW 256", ["flow", ""])]);
        let of = |inputs| words([inputs, [0, 0]], ["E", "A"], [128, 128], &symbols);
        assert_eq!([[0, 4], [4, 4], [256, 8], [300, 2], [8, 2]].map(of), [false, true, true, true, false]);
    }
}
