//! Converts a GSD file, and the modules in the slots of a slave, to the slave's configuration and user parameters.

use std::collections::BTreeMap;

use gsd_parser::{
    GenericStationDescription, PrmValueConstraint, SupportedSpeeds, UserPrmData, UserPrmDataDefinition, UserPrmDataType,
};
use ob1_coupler::dp::DiagnosisField;
use ob1_protocols::profibus::DATA_BYTES;
use ob1_protocols::profibus::diagnosis::{DIAGNOSIS_BYTES, STANDARD_BYTES};

/// Maximum of user parameters of a slave: the telegram has seven bytes of its own.
const PARAMETER_BYTES: usize = DATA_BYTES - 7;
/// Maximum number of slots in a diagnosis.
const SLOTS: usize = 244;
/// The first line of the description.
const START: &str = "#Profibus_DP";
/// Keywords in the spelling of older files, and as the reader knows them.
const SPELLINGS: [(&str, &str); 2] = [("Unit_Diag_!Bit", "Unit_Diag_Not_Bit"), ("24V Pins", "24V_Pins")];
/// The parameter with this name gets the number of its slot.
const SLOT_NUMBER: &str = "[SlotNumber]";
/// Maximum number of bits of a field of the device diagnosis.
const FIELD_BITS: u16 = 16;

/// The content of a GSD file.
pub struct Gsd(Box<GenericStationDescription>);

/// A parameter given by the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Value {
    /// A number; for a text of the GSD file its value.
    Number(i64),
    /// One of the texts of the GSD file.
    Text(String),
}

/// Parameters given by the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Parameters {
    /// By name; the others have the values of the GSD file.
    Named(Vec<(String, Value)>),
    /// All user parameters as bytes; nothing comes from the GSD file.
    Raw(Vec<u8>),
}

impl Default for Parameters {
    fn default() -> Self {
        Self::Named(Vec::new())
    }
}

/// A wanted module of a slot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Its name in the GSD file.
    pub module: String,
    /// User parameters of the module.
    pub parameters: Parameters,
}

/// A module in its slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placed {
    /// Input bytes that the module has.
    pub inputs: usize,
    /// Output bytes that the module has.
    pub outputs: usize,
}

/// The configuration of a slave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Made {
    /// Its modules, in the order of their slots.
    pub slots: Vec<Placed>,
    /// Configuration: the identifiers of the modules.
    pub config: Vec<u8>,
    /// User parameters of the slave and its modules, as Set_Prm carries them.
    pub parameters: Vec<u8>,
}

/// A mistake and its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// Index of the wanted slot, from 0; `None`: the slave as a whole.
    pub slot: Option<usize>,
    /// The parameter; `None`: the module.
    pub parameter: Option<String>,
    /// What is wrong, in words.
    pub message: String,
    /// What to write instead, in words.
    pub remedy: String,
}

impl Gsd {
    /// Reads a file in either code page: UTF-8, or Latin 1 as in the standard.
    ///
    /// # Errors
    /// Why and where it cannot be read, in words.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut text = match std::str::from_utf8(bytes) {
            Ok(text) => text.trim_start_matches('\u{FEFF}').to_owned(),
            Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect(),
        };
        // Old editors ended files with a control character.
        text.truncate(text.trim_end_matches(['\u{1A}', '\0', ' ', '\t']).len());
        text.push('\n');
        let text = respelled(&text);
        // The reader panics at dangling references.
        let read = std::panic::catch_unwind(|| gsd_parser::parser::parse(std::path::Path::new("GSD"), &text));
        match read {
            Ok(Ok(gsd)) => Ok(Self(Box::new(gsd))),
            Ok(Err(error)) => Err(where_and_what(&error.to_string())),
            Err(_) => Err("a reference in it leads nowhere, or a data type is unknown".into()),
        }
    }

    /// Maker and model of the slave, as the GSD file names them.
    pub fn name(&self) -> String {
        format!("{} {}", self.0.vendor, self.0.model).trim().to_owned()
    }

    /// Ident number: the slave reports it, and the master compares it.
    pub fn ident(&self) -> u16 {
        self.0.ident_number
    }

    /// The names of its modules.
    pub fn modules(&self) -> impl Iterator<Item = &str> + Clone {
        self.0.available_modules.iter().map(|module| module.name.as_str())
    }

    /// Bytes of its longest diagnosis.
    pub fn diagnosis_bytes(&self) -> usize {
        usize::from(self.0.max_diag_data_length).clamp(STANDARD_BYTES, DIAGNOSIS_BYTES)
    }

    /// The meanings of the bits of its device diagnosis.
    pub fn texts(&self) -> BTreeMap<u32, String> {
        self.0.unit_diag.bits.iter().map(|(bit, info)| (*bit, info.text.clone())).collect()
    }

    /// The meanings of the values of fields of its device diagnosis.
    pub fn fields(&self) -> Vec<DiagnosisField> {
        let areas = self.0.unit_diag.areas.iter();
        areas
            .filter(|area| area.first <= area.last && area.last - area.first < FIELD_BITS)
            .map(|area| DiagnosisField { first: area.first, last: area.last, texts: area.values.clone() })
            .collect()
    }

    /// The longest time to its answer at a baud rate, in bits; `None`: it does not support that baud rate.
    pub fn answer_bits(&self, baud: u32) -> Option<u16> {
        let (speed, times) = (self.0.supported_speeds, &self.0.max_tsdr);
        let (supported, answer) = match baud {
            9600 => (SupportedSpeeds::B9600, times.b9600),
            19_200 => (SupportedSpeeds::B19200, times.b19200),
            31_250 => (SupportedSpeeds::B31250, times.b31250),
            45_450 => (SupportedSpeeds::B45450, times.b45450),
            93_750 => (SupportedSpeeds::B93750, times.b93750),
            187_500 => (SupportedSpeeds::B187500, times.b187500),
            500_000 => (SupportedSpeeds::B500000, times.b500000),
            1_500_000 => (SupportedSpeeds::B1500000, times.b1500000),
            _ => return None,
        };
        speed.contains(supported).then_some(answer)
    }

    /// A slave with these modules in its slots, from slot 1 on.
    ///
    /// # Errors
    /// Anything missing or not allowed in the GSD file.
    pub fn slave(&self, slots: &[Wanted], parameters: &Parameters) -> Result<Made, Mistake> {
        let gsd = &self.0;
        let mut made = Made { slots: Vec::new(), config: Vec::new(), parameters: Vec::new() };
        made.parameters = bytes_of(&gsd.user_prm_data, parameters, None).map_err(|wrong| wrong.at(None))?;
        let most = if gsd.modular_station { usize::from(gsd.max_modules).max(1) } else { 1 };
        if slots.len() > most.min(SLOTS) {
            let remedy = "leave the others out, or take another GSD file".to_owned();
            let message = format!("{} has at most {most} modules", self.name());
            return Err(Mistake { slot: Some(most), parameter: None, message, remedy });
        }
        for (n, wanted) in slots.iter().enumerate() {
            let (placed, config, parameters) = self.module(n, wanted)?;
            made.slots.push(placed);
            made.config.extend(config);
            made.parameters.extend(parameters);
        }
        let sum = |of: fn(&Placed) -> usize| made.slots.iter().map(of).sum::<usize>();
        let limit = |most: u8| if most == 0 { DATA_BYTES } else { usize::from(most).min(DATA_BYTES) };
        for (what, bytes, most) in [
            ("input bytes", sum(|slot| slot.inputs), limit(gsd.max_input_length)),
            ("output bytes", sum(|slot| slot.outputs), limit(gsd.max_output_length)),
            ("bytes of configuration", made.config.len(), DATA_BYTES),
            ("bytes of user parameters", made.parameters.len(), PARAMETER_BYTES),
        ] {
            if bytes > most {
                let remedy = "remove modules, or use a second station".to_owned();
                let message = format!("the modules have {bytes} {what}; the station takes {most}");
                return Err(Mistake { slot: None, parameter: None, message, remedy });
            }
        }
        Ok(made)
    }

    fn module(&self, n: usize, wanted: &Wanted) -> Result<(Placed, Vec<u8>, Vec<u8>), Mistake> {
        let wrong = |message: String, remedy: String| Mistake { slot: Some(n), parameter: None, message, remedy };
        let tidy = |name: &str| spaced(name).to_lowercase();
        let named = |name: &str| name == wanted.module || tidy(name) == tidy(&wanted.module);
        let Some(module) = self.0.available_modules.iter().find(|module| named(&module.name)) else {
            let message = format!("the GSD file of {} has no module \"{}\"", self.name(), wanted.module);
            return Err(wrong(message, String::new()));
        };
        let slot = self.0.slots.iter().find(|slot| usize::from(slot.number) == n + 1);
        if let Some(slot) = slot
            && !slot.allowed_modules.is_empty()
            && slot.default.name != module.name
            && !slot.allowed_modules.iter().any(|allowed| allowed.name == module.name)
        {
            let allowed: Vec<&str> = slot.allowed_modules.iter().map(|allowed| allowed.name.as_str()).collect();
            let message = format!("\"{}\" cannot be in slot {}", module.name, n + 1);
            return Err(wrong(message, format!("there can be: {}", allowed.join(", "))));
        }
        let Some((inputs, outputs)) = lengths(&module.config) else {
            let message = format!("the configuration of \"{}\" cannot be read: {:02X?}", module.name, module.config);
            return Err(wrong(message, "ask the maker for another GSD file".to_owned()));
        };
        let parameters =
            bytes_of(&module.module_prm_data, &wanted.parameters, Some(n + 1)).map_err(|wrong| wrong.at(Some(n)))?;
        Ok((Placed { inputs, outputs }, module.config.clone(), parameters))
    }
}

/// A name without the blanks that makers fill it up with.
fn spaced(name: &str) -> String {
    name.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The text with the keywords that the reader knows. Each line stays in its place.
fn respelled(text: &str) -> String {
    let respell = |line: &str| -> String {
        let bare = line.trim_start();
        let behind = |word: &str| {
            let (begin, rest) = bare.split_at_checked(word.len())?;
            begin.eq_ignore_ascii_case(word).then_some(rest)
        };
        // The reader wants the first line without blanks and comments.
        if let Some(rest) = behind(START).map(str::trim)
            && (rest.is_empty() || rest.starts_with(';'))
            && !rest.contains('\r')
        {
            return format!("{START}\n");
        }
        let known = SPELLINGS.iter().find_map(|(theirs, ours)| behind(theirs).map(|rest| format!("{ours}{rest}")));
        known.unwrap_or_else(|| line.to_owned())
    };
    text.split_inclusive('\n').map(respell).collect()
}

/// Extracts place and reason from the reader's multi-line error text.
fn where_and_what(picture: &str) -> String {
    let place = picture.lines().find_map(|line| line.split_once("--> GSD:")).map(|(_, place)| place.trim());
    let what = picture.lines().filter_map(|line| line.trim().strip_prefix("= ")).next_back();
    match (place.and_then(|place| place.split_once(':')), what) {
        (_, Some("expected start")) => "the line #Profibus_DP is missing".to_owned(),
        (Some((line, column)), Some(what)) => format!("line {line}, column {column}: {what}"),
        _ => "it is not a GSD file".to_owned(),
    }
}

/// Input and output bytes of the identifiers of a module; `None`: they are incomplete.
pub fn lengths(config: &[u8]) -> Option<(usize, usize)> {
    // Bits 0 to 5 or 0 to 3: the number minus one; bit 6: words.
    let bytes = |count: u8, words: bool| (usize::from(count) + 1) * if words { 2 } else { 1 };
    let (mut inputs, mut outputs, mut rest) = (0, 0, config);
    while let [first, behind @ ..] = rest {
        let (kind, count) = (first >> 4 & 3, first & 0x0F);
        rest = behind;
        if kind != 0 {
            let bytes = bytes(count, first & 0x40 != 0);
            inputs += if kind & 1 != 0 { bytes } else { 0 };
            outputs += if kind & 2 != 0 { bytes } else { 0 };
            continue;
        }
        // The special form: bit 7 outputs, bit 6 inputs, a byte of length for each, outputs first; then the
        // manufacturer's data.
        for (bit, sum) in [(0x80, &mut outputs), (0x40, &mut inputs)] {
            if first & bit != 0 {
                let [length, behind @ ..] = rest else { return None };
                *sum += bytes(length & 0x3F, length & 0x40 != 0);
                rest = behind;
            }
        }
        // 15 means: no manufacturer's data, and the master may not compare.
        rest = rest.get(if count == 15 { 0 } else { usize::from(count) }..)?;
    }
    Some((inputs, outputs))
}

struct Wrong {
    parameter: Option<String>,
    message: String,
    remedy: String,
}

impl Wrong {
    fn at(self, slot: Option<usize>) -> Mistake {
        Mistake { slot, parameter: self.parameter, message: self.message, remedy: self.remedy }
    }
}

/// The names of parameters for the user: a number is behind those that occur more than once.
fn names(description: &UserPrmData) -> Vec<String> {
    let plain: Vec<String> = description.data_ref.iter().map(|(_, known)| spaced(&known.name)).collect();
    let named = |(n, name): (usize, &String)| {
        let before = plain.iter().take(n).filter(|other| *other == name).count();
        let is_single = plain.iter().filter(|other| *other == name).count() == 1;
        if is_single { name.clone() } else { format!("{name} #{}", before + 1) }
    };
    plain.iter().enumerate().map(named).collect()
}

/// The value of a parameter that the user does not set, in the slot with this number.
fn preset(known: &UserPrmDataDefinition, slot: Option<usize>) -> i64 {
    match slot.and_then(|slot| i64::try_from(slot).ok()) {
        Some(slot) if spaced(&known.name).eq_ignore_ascii_case(SLOT_NUMBER) => slot,
        _ => known.default_value,
    }
}

/// Bytes of parameters: constants, defaults, then the user's values. `slot`: the number of the slot, from 1.
fn bytes_of(description: &UserPrmData, wanted: &Parameters, slot: Option<usize>) -> Result<Vec<u8>, Wrong> {
    let wanted = match wanted {
        Parameters::Raw(bytes) => return Ok(bytes.clone()),
        Parameters::Named(wanted) => wanted,
    };
    let of_constants = description.data_const.iter().map(|(at, bytes)| at + bytes.len());
    let of_values = description.data_ref.iter().map(|(at, value)| at + value.data_type.size());
    let len = of_constants.chain(of_values).fold(usize::from(description.length), usize::max);
    if len > DATA_BYTES {
        let message = format!("the GSD file needs {len} bytes of parameters");
        return Err(Wrong { parameter: None, message, remedy: "ask the maker for another GSD file".into() });
    }
    let mut bytes = vec![0; len];
    for (at, constant) in &description.data_const {
        bytes[*at..at + constant.len()].copy_from_slice(constant);
    }
    for (at, value) in &description.data_ref {
        put(&mut bytes[*at..], value.data_type, preset(value, slot));
    }
    let names = names(description);
    for (name, given) in wanted {
        let wrong = |message: String, remedy: String| Wrong { parameter: Some(name.clone()), message, remedy };
        let position = names.iter().position(|known| *known == spaced(name));
        let Some((at, known)) = position.and_then(|position| description.data_ref.get(position)) else {
            let remedy =
                if names.is_empty() { "it has none".into() } else { format!("there are: {}", names.join(", ")) };
            let first = format!("{} #1", spaced(name));
            let number = if names.contains(&first) { "more than one" } else { "no" };
            return Err(wrong(format!("there is {number} parameter \"{name}\""), remedy));
        };
        let number = match given {
            Value::Number(number) => *number,
            Value::Text(text) => {
                let texts = known.text_ref.as_deref().cloned().unwrap_or_default();
                let Some((_, number)) = texts.iter().find(|(known, _)| spaced(known) == spaced(text)) else {
                    let names: Vec<String> = texts.keys().map(|name| format!("\"{}\"", spaced(name))).collect();
                    let remedy = if names.is_empty() { "a number".into() } else { names.join(", ") };
                    return Err(wrong(format!("\"{text}\" is not a value of \"{name}\""), remedy));
                };
                *number
            }
        };
        let (least, most) = range(known.data_type);
        if !known.constraint.is_valid(number) || !(least..=most).contains(&number) {
            let remedy = match &known.constraint {
                PrmValueConstraint::MinMax(least, most) => format!("{least} to {most}"),
                PrmValueConstraint::Enum(values) => values.iter().map(i64::to_string).collect::<Vec<_>>().join(", "),
                PrmValueConstraint::Unconstrained => format!("{least} to {most}"),
            };
            return Err(wrong(format!("\"{name}\" cannot be {number}"), remedy));
        }
        put(&mut bytes[*at..], known.data_type, number);
    }
    Ok(bytes)
}

/// First and last bit of a field within a byte.
fn field(kind: UserPrmDataType) -> Option<(u8, u8)> {
    match kind {
        UserPrmDataType::Bit(bit) => Some((bit.min(7), bit.min(7))),
        UserPrmDataType::BitArea(first, last) => Some((first.min(last).min(7), last.max(first).min(7))),
        _ => None,
    }
}

fn range(kind: UserPrmDataType) -> (i64, i64) {
    match kind {
        UserPrmDataType::Unsigned8 => (0, 0xFF),
        UserPrmDataType::Unsigned16 => (0, 0xFFFF),
        UserPrmDataType::Unsigned32 => (0, 0xFFFF_FFFF),
        UserPrmDataType::Signed8 => (-0x80, 0x7F),
        UserPrmDataType::Signed16 => (-0x8000, 0x7FFF),
        UserPrmDataType::Signed32 => (-0x8000_0000, 0x7FFF_FFFF),
        UserPrmDataType::Bit(_) | UserPrmDataType::BitArea(..) => {
            let (first, last) = field(kind).unwrap_or((0, 0));
            (0, (1 << (last - first + 1)) - 1)
        }
    }
}

/// Writes a value at the beginning of `bytes`; a bit field leaves the other bits unchanged.
fn put(bytes: &mut [u8], kind: UserPrmDataType, value: i64) {
    if let Some((first, last)) = field(kind) {
        let mask = (0xFF_u8 >> (7 - (last - first))) << first;
        if let Some(byte) = bytes.first_mut() {
            *byte = *byte & !mask | (value as u8) << first & mask;
        }
        return;
    }
    let big_endian = value.to_be_bytes();
    let size = kind.size();
    if let Some(place) = bytes.get_mut(..size) {
        place.copy_from_slice(&big_endian[8 - size..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = include_str!("../tests/ET200M.GSD");
    const SLOT_PARAMETER: &str = "ExtUserPrmData = 9 \"[SlotNumber]       \"\nUnsigned8 1 1-11\nEndExtUserPrmData\n\
                                  ExtUserPrmData = 1 \"Range\"";

    fn wanted(module: &str) -> Wanted {
        Wanted { module: module.into(), parameters: Parameters::default() }
    }

    #[test]
    fn a_modular_slave() {
        let gsd = Gsd::read(TEXT.as_bytes()).expect("it can be read");
        assert_eq!((gsd.name().as_str(), gsd.ident()), ("ob1 Simulated ET 200M", 0x7F01));
        let slots = [wanted("DI 16 x DC 24V"), wanted("do 16 x  dc 24v"), wanted("AI 2 x 12 bit")];
        let made = gsd.slave(&slots, &Parameters::default()).expect("it can be made");
        assert_eq!(made.config, [0x42, 0x01, 0x01, 0x00, 0x82, 0x01, 0x02, 0x00, 0x51]);
        let bytes: Vec<(usize, usize)> = made.slots.iter().map(|slot| (slot.inputs, slot.outputs)).collect();
        assert_eq!(bytes, [(2, 0), (0, 2), (4, 0)]);
        assert_eq!(made.parameters, [0xC0, 0x00, 0x08, 0x01, 0x20, 0x00, 0x05]);
        assert_eq!(gsd.answer_bits(500_000), Some(100));
        assert_eq!(gsd.answer_bits(31_250), None);
    }

    #[test]
    fn parameters_by_name_number_and_text() {
        let gsd = Gsd::read(TEXT.as_bytes()).expect("it can be read");
        let named = |list: &[(&str, Value)]| {
            Parameters::Named(list.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect())
        };
        let analogue =
            |parameters| gsd.slave(&[Wanted { module: "AI 2 x 12 bit".into(), parameters }], &Parameters::default());
        let made = analogue(named(&[("Range", Value::Text("4..20 mA".into())), ("Smoothing", Value::Number(3))]));
        assert_eq!(made.expect("it can be made").parameters[3..], [0x01, 0x33, 0x00, 0x05]);
        for (parameters, says, remedy) in [
            (named(&[("Rnge", Value::Number(1))]), "no parameter \"Rnge\"", "there are: Range, Smoothing, Limit"),
            (named(&[("Range", Value::Text("5 V".into()))]), "\"5 V\" is not a value", "4..20 mA"),
            (named(&[("Smoothing", Value::Number(9))]), "\"Smoothing\" cannot be 9", "0 to 3"),
            (named(&[("Limit", Value::Number(40_000))]), "\"Limit\" cannot be 40000", "-32768 to 32767"),
        ] {
            let mistake = analogue(parameters).expect_err("it cannot be");
            assert!(mistake.message.contains(says) && mistake.remedy.contains(remedy), "{mistake:?}");
            assert_eq!(mistake.slot, Some(0));
        }
        let made = analogue(named(&[("Limit", Value::Number(-2))])).expect("it can be made");
        assert_eq!(made.parameters[5..], [0xFF, 0xFE]);
        let raw = gsd.slave(&[wanted("DI 16 x DC 24V")], &Parameters::Raw(vec![1, 2])).expect("it can be made");
        assert_eq!(raw.parameters, [1, 2]);
    }

    /// As in the GSD files of an ET 200M: the second byte of the parameters of a module is its slot.
    #[test]
    fn a_parameter_for_the_slot_gets_its_number() {
        let text = TEXT
            .replace("ExtUserPrmData = 1 \"Range\"", SLOT_PARAMETER)
            .replace("Ext_User_Prm_Data_Const(0) = 0x01\n", "Ext_User_Prm_Data_Ref(0) = 9\n");
        let gsd = Gsd::read(text.as_bytes()).expect("it can be read");
        let slots = [wanted("AI 2 x 12 bit"), wanted("DI 16 x DC 24V"), wanted("AI 2 x 12 bit")];
        let made = gsd.slave(&slots, &Parameters::default()).expect("it can be made");
        assert_eq!(made.parameters[3..], [1, 0x20, 0, 5, 3, 0x20, 0, 5]);
        let parameters = Parameters::Named(vec![("[SlotNumber]".into(), Value::Number(7))]);
        let made = gsd.slave(&[Wanted { module: "AI 2 x 12 bit".into(), parameters }], &Parameters::default());
        assert_eq!(made.expect("it can be made").parameters[3..], [7, 0x20, 0, 5]);
    }

    /// One parameter a channel, all of one name, and blanks behind names and texts.
    #[test]
    fn a_name_that_occurs_twice_has_a_number() {
        let text = TEXT
            .replace("\"Range\"", "\"Range     \"")
            .replace("\"4..20 mA\"", "\"4..20 mA  \"")
            .replace("Ext_User_Prm_Data_Ref(1) = 2\n", "Ext_User_Prm_Data_Ref(0) = 1\n");
        let gsd = Gsd::read(text.as_bytes()).expect("it can be read");
        let analogue = |name: &str| {
            let parameters = Parameters::Named(vec![(name.into(), Value::Text("4..20 mA".into()))]);
            gsd.slave(&[Wanted { module: "AI 2 x 12 bit".into(), parameters }], &Parameters::default())
        };
        for (name, bytes) in [("Range #1", [0x21_u8, 0x30, 0, 5]), ("Range #2", [0x31, 0x20, 0, 5])] {
            assert_eq!(analogue(name).expect("it can be made").parameters[3..], bytes, "{name}");
        }
        let mistake = analogue("Range").expect_err("which one");
        assert_eq!(mistake.message, "there is more than one parameter \"Range\"");
        assert_eq!(mistake.remedy, "there are: Range #1, Range #2, Limit");
    }

    #[test]
    fn older_files_are_read() {
        let diagnoses = "Unit_Diag_!Bit(1) = \"No\"\r\n24V Pins = 0\nUnit_Diag_Area = 24-25\nValue(2) = \"Slot 1\"\n\
                         Unit_Diag_Area_End\nUnit_Diag_Bit(1)";
        let text = TEXT
            .replace("#Profibus_DP\n", "\t#PROFIBUS_DP      ; it begins\r\n")
            .replace("Unit_Diag_Bit(1)", diagnoses);
        let gsd = Gsd::read(text.as_bytes()).expect("it can be read");
        assert_eq!(gsd.texts().into_values().collect::<Vec<_>>(), ["Module missing", "Wrong module"]);
        let fields = gsd.fields();
        assert_eq!((fields.len(), fields[0].first, fields[0].last), (1, 24, 25));
        assert_eq!(fields[0].texts[&2], "Slot 1");
    }

    #[test]
    fn what_the_file_does_not_have() {
        let gsd = Gsd::read(TEXT.as_bytes()).expect("it can be read");
        let mistake = gsd.slave(&[wanted("DI 32")], &Parameters::default()).expect_err("no such module");
        assert_eq!(mistake.message, "the GSD file of ob1 Simulated ET 200M has no module \"DI 32\"");
        let nine: Vec<Wanted> = (0..9).map(|_| wanted("DI 16 x DC 24V")).collect();
        let mistake = gsd.slave(&nine, &Parameters::default()).expect_err("too many");
        assert_eq!(mistake.slot, Some(8));
        for (text, says) in [
            ("", "the line #Profibus_DP is missing"),
            ("nothing", "the line #Profibus_DP is missing"),
            ("#Profibus_DP\nGSD_Revision = banana\n", "line 2"),
            ("#Profibus_DP\nExt_User_Prm_Data_Ref(0) = 17\n", "leads nowhere"),
        ] {
            let error = Gsd::read(text.as_bytes()).err().expect("it cannot be read");
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }

    #[test]
    fn files_are_latin_1_too() {
        let mut bytes = TEXT.replace("Simulated", "G?rat").into_bytes();
        let at = bytes.iter().position(|byte| *byte == b'?').expect("it is there");
        bytes[at] = 0xE4;
        bytes.push(0x1A);
        assert_eq!(Gsd::read(&bytes).expect("it can be read").name(), "ob1 G\u{E4}rat ET 200M");
    }

    #[test]
    fn lengths_of_identifiers() {
        for (config, expected) in [
            (&[0x10][..], Some((1, 0))),
            (&[0x2F], Some((0, 16))),
            (&[0x71], Some((4, 4))),
            (&[0x30, 0x00, 0x51], Some((5, 1))),
            (&[0xC0, 0x43, 0x03], Some((4, 8))),
            (&[0x42, 0x01, 7, 8, 0x10], Some((3, 0))),
            (&[0x40], None),
            (&[0x41, 0x01], None),
            (&[], Some((0, 0))),
        ] {
            assert_eq!(lengths(config), expected, "{config:X?}");
        }
    }

    proptest::proptest! {
        #[test]
        fn noise_is_no_panic(bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..64)) {
            let _ = lengths(&bytes);
            let _ = Gsd::read(&bytes);
        }
    }
}
