//! Records for the listeners of a CP's line, besides the characters.

use std::time::SystemTime;

use ob1_child::tap::Tap;
use ob1_firmware::trace::record::Kind;
use ob1_firmware::{CpEvent, Instant, cp341_events};
use serde_json::json;

use crate::config::Config;

/// Reports the identity of the CP when it has got parameters.
pub(crate) fn introduce(tap: &mut Tap, now: Instant, config: &Config, parameters: &[u8; 16]) {
    let mut text = json!({
        "station": config.station, "name": config.name, "line": config.line.to_string(),
        "parameters": parameters, "module": config.cp_type.kind.name(),
    });
    if let Some(Ok(keyed)) = &config.cp_type.keys {
        // Its parameters are keys, not bytes.
        for (key, value) in keyed.to_keys() {
            text["params"][*key] = match value {
                ob1_params::Value::Int(number) => json!(number),
                ob1_params::Value::Str(word) => json!(word),
            };
        }
    }
    tap.introduce(now, SystemTime::now(), text);
}

/// Reports an event of the CP.
pub(crate) fn note(tap: &mut Tap, now: Instant, event: &CpEvent<'_>) {
    if !tap.is_alone() {
        tap.tell(now, Kind::Note, words(event).as_bytes());
    }
}

/// An event of the CP in words, for listeners and the log.
pub(crate) fn words(event: &CpEvent<'_>) -> String {
    match event {
        // The characters have their own records.
        CpEvent::Order(telegram) => format!("order of {} bytes", telegram.len()),
        CpEvent::Received(telegram) => format!("telegram of {} bytes received", telegram.len()),
        CpEvent::SendFailed(code) => format!("order failed, {code:02X}h"),
        CpEvent::Sent => "order done".to_owned(),
        CpEvent::Delivered(length) => format!("telegram of {length} bytes handed to the CPU"),
        CpEvent::Startup { number, .. } => format!("start-up {number}"),
        CpEvent::Working => "start-up acknowledged".to_owned(),
        CpEvent::NoParameters(why) => format!("parameters refused: {why}"),
        CpEvent::OrderDiscarded { code: Some(code) } => format!("order refused, {code:02X}h"),
        CpEvent::OrderDiscarded { code: None } => "order given up by the CPU before it was complete".to_owned(),
        CpEvent::JobFailed(status) => format!("job ended with STATUS {status:04X}h: {}", meaning(*status)),
        CpEvent::Entry(number) => format!("diagnostic entry {number:04X}h: {}", meaning(*number)),
        CpEvent::EntryGone(number) => format!("diagnostic entry {number:04X}h is gone: {}", meaning(*number)),
        CpEvent::Changed(count) => format!("the master has changed {count} bytes"),
        CpEvent::Protocol(event) => event.to_string(),
        CpEvent::Rk512(event) => event.to_string(),
        CpEvent::Asked(request, data) => {
            format!(
                "order of the partner for {} bytes, {} of them here, handed to the CPU",
                request.bytes(),
                data.len()
            )
        }
        CpEvent::Answered(Ok(())) => "order of the partner done".to_owned(),
        CpEvent::Answered(Err(_)) => "order of the partner failed".to_owned(),
        CpEvent::Diagnosis { incoming: true, .. } | CpEvent::Record { incoming: true, .. } => {
            "diagnostic interrupt: an error comes".to_owned()
        }
        CpEvent::Diagnosis { incoming: false, .. } | CpEvent::Record { incoming: false, .. } => {
            "diagnostic interrupt: all errors are gone".to_owned()
        }
    }
}

/// The meaning of an event number of the CP 341.
fn meaning(number: u16) -> &'static str {
    cp341_events::row(number).map_or("no event of the CP 341", |row| row.text)
}
