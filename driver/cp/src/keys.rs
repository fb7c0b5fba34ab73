//! The parameters of a CP 341 in the driver's configuration: `"params": { "protocol": "3964r", "baud": 9600 }`.

use ob1_params::{Cp341, ParamError, Value};
use serde_json::{Map, Value as Json};

use crate::pump::Parameters341;

/// Reads them.
///
/// # Errors
/// What is wrong with the keys, in the words of the station file.
pub fn parameters_341(keys: &Map<String, Json>) -> Parameters341 {
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
