//! Records for the listeners of a CP's line, besides the characters.

use std::time::SystemTime;

use ob1_backplane::OrderTimes;
use ob1_cp::CpType;
use ob1_firmware::{CpEvent, Instant, LONG_BIT};
use ob1_params::Protocol341;
use ob1_process::tap::Tap;
use ob1_serial::tap_record::Kind;
use ob1_words::cp341_events;
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
pub(crate) fn note(tap: &mut Tap, now: Instant, event: &CpEvent<'_>, cp: Option<&CpType>) {
    if !tap.is_alone() {
        let mut words = words(event);
        if let (&CpEvent::Order(&[_, code, ..]), Some(cp)) = (event, cp)
            && code & LONG_BIT != 0
            && has_long_registers(cp)
        {
            // The line does not show it: the request has the code without the bit.
            words += &format!(", {code:02X}h: 32-bit registers");
        }
        tap.tell(now, Kind::Note, words.as_bytes());
    }
}

/// Whether a job of the CP may ask for registers of 32 bits. [S4 "32-Bit Mode"]
fn has_long_registers(cp: &CpType) -> bool {
    let Some(Ok(keys)) = &cp.keys else { return false };
    matches!(&keys.protocol, Protocol341::ModbusMaster32(driver) if driver.long_registers)
}

/// An event of the CP in words, for listeners and the log.
pub(crate) fn words(event: &CpEvent<'_>) -> String {
    match event {
        // The characters have their own records.
        CpEvent::Order(telegram) => format!("order of {}", bytes(telegram.len())),
        CpEvent::Received(telegram) => format!("telegram of {} received", bytes(telegram.len())),
        CpEvent::SendFailed(code) => format!("order failed, {code:02X}h"),
        CpEvent::Sent => "order done".to_owned(),
        CpEvent::Delivered(length) => format!("telegram of {} handed to the CPU", bytes(*length)),
        CpEvent::Startup { number, .. } => format!("start-up {number}"),
        CpEvent::Working => "start-up acknowledged".to_owned(),
        CpEvent::NoParameters(why) => format!("parameters refused: {why}"),
        CpEvent::OrderDiscarded { code: Some(code) } => format!("order refused, {code:02X}h"),
        CpEvent::OrderDiscarded { code: None } => "order given up by the CPU before it was complete".to_owned(),
        CpEvent::JobFailed(status) => format!("job ended with STATUS {status:04X}h: {}", meaning(*status)),
        CpEvent::Entry(number) => format!("diagnostic entry {number:04X}h: {}", meaning(*number)),
        CpEvent::EntryGone(number) => format!("diagnostic entry {number:04X}h is gone: {}", meaning(*number)),
        CpEvent::Changed(count) => format!("the master has changed {}", bytes(*count)),
        CpEvent::Protocol(event) => event.to_string(),
        CpEvent::Rk512(event) => event.to_string(),
        CpEvent::Asked(request, data) => {
            format!(
                "order of the partner for {}, {} of them here, handed to the CPU",
                bytes(request.bytes()),
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

/// How long each stage of an order or telegram took.
pub(crate) fn stages(times: &OrderTimes) -> String {
    let what = if times.is_order { "order" } else { "telegram" };
    let stages = times.stages().map(|(stage, took)| {
        format!("{} after {}.{:03} ms", stage.name().replace('_', " "), took / 1_000_000, took / 1000 % 1000)
    });
    format!("times of the {what}: {}", stages.collect::<Vec<_>>().join(", "))
}

/// `1 byte`, `2 bytes`.
fn bytes(count: usize) -> String {
    if count == 1 { "1 byte".to_owned() } else { format!("{count} bytes") }
}

/// The meaning of an event number of the CP 341.
fn meaning(number: u16) -> &'static str {
    cp341_events::row(number).map_or("no event of the CP 341", |row| row.text)
}

#[cfg(test)]
mod tests {
    use ob1_backplane::Stage;
    use serde_json::json;

    use super::*;

    #[test]
    fn each_stage_is_told_that_is_known() {
        let mut times = OrderTimes::new(true, 30);
        for (stage, at) in [(Stage::Posted, 1_000_000), (Stage::Taken, 1_400_500), (Stage::LastOut, 13_400_500)] {
            times.say(stage, at);
        }
        assert_eq!(stages(&times), "times of the order: taken after 0.400 ms, last out after 12.000 ms");
    }

    #[test]
    fn one_byte_is_not_bytes() {
        assert_eq!(words(&CpEvent::Order(b"a")), "order of 1 byte");
        assert_eq!(words(&CpEvent::Received(b"a")), "telegram of 1 byte received");
        assert_eq!(words(&CpEvent::Delivered(2)), "telegram of 2 bytes handed to the CPU");
    }

    #[test]
    fn only_the_loadable_driver_with_its_parameter_has_long_registers() {
        let cp = |keys: serde_json::Value| CpType::of("cp341", keys.as_object().expect("keys")).expect("a type");
        for (keys, long) in [
            (json!({"protocol": "modbus-ascii-master-32", "registers_32_bit": "yes"}), true),
            (json!({"protocol": "modbus-ascii-master-32"}), false),
            (json!({"protocol": "3964r"}), false),
        ] {
            assert_eq!(has_long_registers(&cp(keys.clone())), long, "{keys}");
        }
        assert!(!has_long_registers(&CpType::CP240));
    }
}
