//! The module in the driver's configuration: its type, and the parameters of a type that has keys: `"module": "cp341",
//! "params": { "protocol": "3964r", "baud": 9600 }`. Of a CP 240, whose parameters are bytes, its `interface`.

use ob1_params::{Cp341, CpKind, Interface, ParamError, Value};
use serde_json::{Map, Value as Json};

/// Parameters that are keys, or the error in them.
pub type KeyedParameters = Result<Cp341, ParamError>;

/// The type of the module in the configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CpType {
    /// Which CP the process is.
    pub kind: CpKind,
    /// Its parameters, if they are keys; otherwise they are 16 bytes.
    pub keys: Option<KeyedParameters>,
    /// Its interface, where no parameter names it: a CP 240.
    pub interface: Interface,
}

impl CpType {
    /// A type whose parameters are 16 bytes.
    pub const CP240: Self = Self { kind: CpKind::Cp240, keys: None, interface: Interface::Rs232 };

    /// The type of this name, with the keys under `params`.
    pub fn of(name: &str, params: &Map<String, Json>) -> Option<Self> {
        // A CP with boxes is not a serial one.
        let kind = CpKind::of_name(name).filter(|kind| !kind.row().has_boxes)?;
        let keys = kind.row().has_channels.then(|| keyed(kind, params));
        let given = params.get("interface").and_then(Json::as_str);
        let interface = Interface::NAMES.iter().find(|(name, _)| given == Some(*name));
        Some(Self { kind, keys, interface: interface.map(|(_, interface)| *interface).unwrap_or_default() })
    }
}

/// Reads the keys; errors use the words of the station file.
fn keyed(kind: CpKind, keys: &Map<String, Json>) -> KeyedParameters {
    let value = |(key, json): (&String, &Json)| match json {
        Json::String(text) => Ok((key.clone(), Value::Str(text.clone()))),
        Json::Number(number) if number.is_i64() => Ok((key.clone(), Value::Int(number.as_i64().unwrap_or_default()))),
        other => Err(ParamError {
            byte: None,
            key: key.clone(),
            value: other.to_string(),
            allowed: "a number or a text".into(),
            remedy: "the runtime writes no other".into(),
        }),
    };
    let keys: Vec<(String, Value)> = keys.iter().map(value).collect::<Result<_, _>>()?;
    Cp341::of_kind(kind, keys.iter().map(|(key, value)| (key.as_str(), value.clone())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_its_type() {
        let none = Map::new();
        for row in CpKind::TABLE.iter().filter(|row| !row.has_boxes) {
            assert_eq!(CpType::of(row.name, &none).map(|cp| cp.kind), Some(row.kind));
        }
        assert_eq!((CpType::of("cp999", &none), CpType::of("cp343", &none)), (None, None));
        let Json::Object(two_wires) = serde_json::json!({ "interface": "rs485" }) else { panic!() };
        let of = |params: &Map<String, Json>| CpType::of("cp240", params).map(|cp| cp.interface);
        assert_eq!((of(&none), of(&two_wires)), (Some(Interface::Rs232), Some(Interface::Rs485)));
        for name in ["cp341", "cp340"] {
            let refused = CpType::of(name, &none).and_then(|cp| cp.keys);
            assert!(matches!(refused, Some(Err(_))), "a {name} has no defaults");
        }
    }
}
