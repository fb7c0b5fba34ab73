//! The library decodes the answers of real meters to the published values.

use ob1_mbus::records::{Answer, Quantity, Record, Unit, Value};
use ob1_tests::meters::{Said, fields, fixtures, values};

/// Published names of the functions of a record.
const FUNCTIONS: [&str; 4] = ["Instantaneous value", "Maximum value", "Minimum value", "Value during error state"];

/// The value in the published format: in the unit without a prefix, times in seconds, text in reading order, bytes in
/// hexadecimal.
fn printed(record: &Record<'_>) -> String {
    let factor = match record.unit {
        Unit::Minute => 60.0,
        Unit::Hour => 3600.0,
        Unit::Day => 86_400.0,
        _ => 1.0,
    };
    match record.value {
        Value::Whole(_) | Value::Big(_) | Value::Real(_) => format!("{:.6}", record.scaled() * factor),
        Value::Date([day, month, year]) => format!("20{year:02}-{month:02}-{day:02}"),
        Value::DateTime([day, month, year, hour, minute, second]) => {
            format!("20{year:02}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
        }
        Value::Text(text) => text.iter().rev().map(|byte| char::from(*byte)).collect(),
        Value::Bytes(bytes) => bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" "),
        Value::Time(_) | Value::None | Value::Invalid => String::new(),
    }
}

/// Compares our number with the published one, to six decimals and six digits.
fn is_equal(ours: &str, theirs: &str) -> bool {
    match (ours.parse::<f64>(), theirs.parse::<f64>()) {
        (Ok(ours), Ok(theirs)) => (ours - theirs).abs() <= 1.5e-6 + 1e-6 * theirs.abs(),
        _ => ours == theirs,
    }
}

/// Partly invalid dates: of meters without a clock, or for every month or year.
const UNREAL: [&str; 3] = ["-00-00", "-01-00", "2127-"];

/// The units of the fixed data structure; the second counter of one answer has that of the first.
fn prefix(unit: &str) -> f64 {
    match unit {
        "kWh" => 1e3,
        _ => 1e-3,
    }
}

/// Published names of our quantities.
const QUANTITIES: [(&str, Quantity); 14] = [
    ("Energy", Quantity::Energy),
    ("Volume", Quantity::Volume),
    ("Power", Quantity::Power),
    ("Volume flow", Quantity::VolumeFlow),
    ("Flow temperature", Quantity::FlowTemperature),
    ("Return temperature", Quantity::ReturnTemperature),
    ("Temperature difference", Quantity::TemperatureDifference),
    ("External temperature", Quantity::ExternalTemperature),
    ("Voltage", Quantity::Voltage),
    ("Current", Quantity::Current),
    ("Fabrication No", Quantity::FabricationNumber),
    ("Operating time", Quantity::OperatingTime),
    ("On time", Quantity::OnTime),
    ("Error flags", Quantity::ErrorFlags),
];

/// Published names of the units.
const UNITS: [(&str, Unit); 10] = [
    ("Wh", Unit::WattHour),
    ("J", Unit::Joule),
    ("m^3", Unit::CubicMetre),
    ("W", Unit::Watt),
    ("m^3/h", Unit::CubicMetrePerHour),
    ("°C", Unit::Celsius),
    ("K", Unit::Kelvin),
    ("V", Unit::Volt),
    ("A", Unit::Ampere),
    ("bar", Unit::Bar),
];

/// Whether quantity and unit match the published ones, if we have a name.
fn is_called(ours: &Record<'_>, quantity: &str, unit: &str) -> bool {
    let quantity = QUANTITIES.iter().find(|(name, _)| *name == quantity);
    let unit = UNITS.iter().find(|(name, _)| *name == unit);
    // VIFE 28h: a volume per revolution, published as a volume.
    let is_per_revolution = ours.vif[1] & 0x7F == 0x28 && ours.unit == Unit::None;
    quantity.is_none_or(|(_, quantity)| *quantity == ours.quantity)
        && (is_per_revolution || unit.is_none_or(|(_, unit)| *unit == ours.unit))
}

/// Compares an answer; adds the differences to `wrong`.
fn compare(said: &Said, fields: &[u8], wrong: &mut Vec<String>) -> usize {
    let Said { name, header: [identification, manufacturer, version, _], records } = said;
    let answer = match Answer::parse(fields) {
        Ok(answer) => answer,
        Err(fault) => {
            wrong.push(format!("{name}: {fault:?}"));
            return 0;
        }
    };
    let letters = String::from_utf8_lossy(&answer.header.manufacturer_letters()).into_owned();
    let own = (format!("{:X}", answer.header.identification), answer.header.version.to_string());
    if fields[2] == 0x72 && (&own.0, &letters, &own.1) != (identification, manufacturer, version) {
        wrong.push(format!("{name}: {own:?} {letters}, not {:?}", said.header));
    }
    let ours: Vec<_> = answer.records().collect();
    if ours.len() != records.len() {
        wrong.push(format!("{name}: {} records, not {}", ours.len(), records.len()));
    }
    let mut equal = 0;
    for (ours, [function, storage, quantity, unit, value]) in ours.iter().zip(records) {
        let Ok(ours) = ours else {
            wrong.push(format!("{name}: {ours:?}, not {quantity} {value} {unit}"));
            continue;
        };
        let (own_function, own) = (FUNCTIONS[usize::from(ours.function)], printed(ours));
        let is_same = match ours.value {
            Value::Bytes(_) => is_equal(&own, value),
            // Digits above 9, and impossible dates: published as they are, invalid for us.
            Value::Invalid => function == FUNCTIONS[3] || UNREAL.iter().any(|unreal| value.contains(unreal)),
            // Two counters in units with prefixes.
            _ if function == "Actual value" => is_equal(&(ours.scaled() / prefix(unit)).to_string(), value),
            // A quantity without a published name.
            _ if quantity.is_empty() => ours.quantity == Quantity::Other,
            _ => own_function == function && ours.storage.to_string() == *storage && is_equal(own.trim(), value),
        };
        if !is_same || !is_called(ours, quantity, unit) {
            wrong.push(format!("{name}: {ours:?} {own}, not {function} {storage} {quantity} {value} {unit}"));
        } else {
            equal += 1;
        }
    }
    equal
}

#[test]
fn the_records_of_real_meters() {
    let frames = fixtures();
    let (mut wrong, mut equal) = (Vec::new(), 0);
    for said in values() {
        let frame = frames.iter().find(|frame| frame.name == said.name).expect("a frame for each that says something");
        equal += compare(&said, &fields(&frame.bytes).expect("a whole frame"), &mut wrong);
    }
    assert_eq!(wrong, Vec::<String>::new(), "{} differ", wrong.len());
    assert_eq!(equal, 901, "all of them");
}

/// Invalid answers: each is reported, and the records before the fault are read.
#[test]
fn malformed_answers() {
    let mut found = Vec::new();
    for frame in fixtures().iter().filter(|frame| frame.name.starts_with("error-frames/")) {
        let Some(fields) = fields(&frame.bytes) else { continue };
        let said = match Answer::parse(&fields) {
            Err(fault) => format!("{fault:?}"),
            Ok(answer) => {
                let good = answer.records().filter(Result::is_ok).count();
                format!("{good} records, {:?}", answer.records().find_map(Result::err))
            }
        };
        found.push(format!("{} {said}", frame.name.trim_start_matches("error-frames/")));
    }
    let expected = [
        "application_busy Application(8)",
        "buffer_too_long Application(2)",
        "error Application(255)",
        "premature_end_of_data1 2 records, Some(Malformed)",
        "premature_end_of_data2 2 records, Some(Malformed)",
        "premature_end_of_dif1 2 records, Some(Malformed)",
        "premature_end_of_dif2 2 records, Some(Malformed)",
        "premature_end_of_record Application(4)",
        "premature_end_of_var_vif1 3 records, Some(Malformed)",
        "premature_end_of_vif1 2 records, Some(Malformed)",
        "too_long_var_vif 3 records, Some(Malformed)",
        "too_many_dife 2 records, Some(Malformed)",
        "too_many_difes Application(5)",
        "too_many_readouts Application(9)",
        "too_many_records Application(3)",
        "too_many_vife 2 records, Some(Malformed)",
        "too_many_vifes Application(6)",
        "too_short_header Malformed",
        "unimplemented_ci Application(1)",
        "unspecified_error Application(0)",
    ];
    assert_eq!(found, expected);
}

/// docs/mbus.md names every number in a record.
#[test]
fn the_document_names_every_number() {
    let text = include_str!("../../../docs/mbus.md");
    for (head, count) in [("\nQUANTITY: ", Quantity::ALL.len()), ("\nUNIT: ", Unit::ALL.len())] {
        let paragraph = text.split(head).nth(1).and_then(|rest| rest.split("\n\n").next()).expect("a paragraph");
        let number = |item: &str| item.split_whitespace().next().and_then(|word| word.parse::<usize>().ok());
        let numbers: Vec<usize> = paragraph.split(',').filter_map(number).collect();
        assert!(numbers.iter().copied().eq(1..count), "{head}{numbers:?}");
    }
    let size = format!("{} + {} x n bytes", ob1_mbus::records::HEADER_BYTES, ob1_mbus::records::RECORD_BYTES);
    assert!(text.contains(&size), "{size}");
}
