//! The JSON text that the runtime transfers with the parameters: configuration for the driver, not for the CP.

use std::path::PathBuf;

use ob1_cp::{CpType, Refused};
use ob1_line::LineSpec;
use ob1_params::CpKind;
use serde::Deserialize;

/// Keys of the JSON text. Unknown ones are for later drivers, and are ignored.
#[derive(Debug, Deserialize)]
struct Keys {
    module: String,
    #[serde(default)]
    station: String,
    #[serde(default)]
    name: String,
    line: String,
    #[serde(default)]
    diagnostics: bool,
    trace: Option<PathBuf>,
    #[serde(default)]
    params: serde_json::Map<String, serde_json::Value>,
}

/// The configuration with every part parsed and checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Config {
    pub(crate) station: String,
    pub(crate) name: String,
    pub(crate) line: LineSpec,
    /// Errors raise diagnostic interrupts.
    pub(crate) diagnostics: bool,
    /// The socket of the tap.
    pub(crate) trace: Option<PathBuf>,
    pub(crate) cp_type: CpType,
}

impl Config {
    pub(crate) fn parse(json: &[u8]) -> Result<Self, Refused> {
        let keys: Keys =
            serde_json::from_slice(json).map_err(|e| Refused(format!("the driver's configuration: {e}")))?;
        let Some(cp_type) = CpType::of(&keys.module, &keys.params) else {
            let known = CpKind::TABLE
                .iter()
                .filter(|row| !row.has_boxes)
                .map(|row| row.name)
                .collect::<Vec<_>>()
                .join(" or a ");
            return Err(Refused(format!("module \"{}\": this driver is a {known}", keys.module)));
        };
        let line = keys.line.parse().map_err(|e| Refused(format!("{e}")))?;
        let Keys { station, name, diagnostics, trace, .. } = keys;
        Ok(Self { station, name, line, diagnostics, trace, cp_type })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_runtimes_text_is_understood() {
        let json = br#"{"module":"cp240","station":"a","name":"cp1","line":"pty:/tmp/x","diagnostics":true,"later":1}"#;
        let config = Config::parse(json).unwrap();
        assert_eq!((config.station.as_str(), config.name.as_str()), ("a", "cp1"));
        assert_eq!(config.line.to_string(), "pty:/tmp/x");
        assert!(config.diagnostics);
        assert!(!Config::parse(br#"{"module":"cp240","line":"pty:/tmp/x"}"#).unwrap().diagnostics);
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (json, says) in [
            (&b""[..], "configuration"),
            (br#"{"module":"cp240"}"#, "line"),
            (br#"{"module":"cp999","line":"pty:/x"}"#, "this driver is a cp240 or a cp341 or a cp340 or a cp040"),
            (br#"{"module":"cp240","line":"pty:x"}"#, "absolute"),
        ] {
            let refused = Config::parse(json).unwrap_err().to_string();
            assert!(refused.contains(says), "{refused}");
        }
    }
}
