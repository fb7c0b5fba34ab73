//! What the driver's configuration says of the module itself: its type, and the parameters of a CP 341:
//! `"module": "cp341", "params": { "protocol": "3964r", "baud": 9600 }`.

use ob1_params::{Cp341, ParamError, Value};
use serde_json::{Map, Value as Json};

/// The parameters of a CP 341, or what is wrong with them.
pub type Parameters341 = Result<Cp341, ParamError>;

/// The type of the module, as the configuration says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CpType {
    /// Its parameters are 16 bytes.
    Cp240,
    /// Its parameters are 16 bytes.
    Cp040,
    /// Its parameters are keys.
    Cp341(Parameters341),
}

impl CpType {
    /// The names of all.
    pub const NAMES: [&str; 3] = ["cp240", "cp341", "cp040"];

    /// The type of this name, with the keys that stand under `params`.
    #[must_use]
    pub fn of(name: &str, params: &Map<String, Json>) -> Option<Self> {
        match name {
            "cp240" => Some(Self::Cp240),
            "cp341" => Some(Self::Cp341(parameters_341(params))),
            "cp040" => Some(Self::Cp040),
            _ => None,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Cp240 => "cp240",
            Self::Cp341(_) => "cp341",
            Self::Cp040 => "cp040",
        }
    }
}

/// Reads them; what is wrong is said in the words of the station file.
fn parameters_341(keys: &Map<String, Json>) -> Parameters341 {
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
    Cp341::from_keys(keys.iter().map(|(key, value)| (key.as_str(), value.clone())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_its_type() {
        let none = Map::new();
        for name in CpType::NAMES {
            assert_eq!(CpType::of(name, &none).map(|kind| kind.name()), Some(name));
        }
        assert_eq!(CpType::of("cp999", &none), None);
        assert!(matches!(CpType::of("cp341", &none), Some(CpType::Cp341(Err(_)))), "a CP 341 has no defaults");
    }
}
