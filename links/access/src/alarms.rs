//! Alarms in words: the texts of a station by message number, and the alarms that stand as people and programs are told
//! them.

use std::collections::BTreeMap;

use ob1_model::moment::Moment;
use ob1_model::{AlarmAck, AlarmNow, AlarmTime, AlarmTurn, alarm_number};
use serde::{Deserialize, Serialize};

use crate::alarm_text::Template;

/// What a message number, or one signal of it, means.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AlarmText {
    /// The text, with its places for values.
    pub text: Template,
    /// What the operator should know besides.
    pub info: Template,
    /// The class of the alarm, in the words of the plant; may be empty.
    pub class: String,
    /// From 0; higher is more urgent.
    pub priority: u8,
}

/// The texts of all alarms.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AlarmTexts {
    rows: BTreeMap<(u32, u8), AlarmText>,
}

impl AlarmTexts {
    /// By number and signal; signal 0 means every signal that has no text of its own.
    #[must_use]
    pub const fn new(rows: BTreeMap<(u32, u8), AlarmText>) -> Self {
        Self { rows }
    }

    /// The text of a signal, from 1.
    #[must_use]
    pub fn of(&self, number: u32, signal: u8) -> Option<&AlarmText> {
        self.rows.get(&(number, signal)).or_else(|| self.rows.get(&(number, 0)))
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no text.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// As a document for other processes.
    #[must_use]
    pub fn write(&self) -> String {
        let rows: Vec<_> = self.rows.iter().collect();
        serde_json::to_string(&rows).unwrap_or_default()
    }

    /// Of such a document; `None`: it is none.
    #[must_use]
    pub fn read(document: &[u8]) -> Option<Self> {
        let rows: Vec<((u32, u8), AlarmText)> = serde_json::from_slice(document).ok()?;
        Some(Self { rows: rows.into_iter().collect() })
    }
}

/// A signal of an alarm that is active or not acknowledged.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StandingAlarm {
    /// Message number.
    pub number: u32,
    /// Which signal, from 1.
    pub signal: u8,
    /// The block that makes it.
    pub block: String,
    /// The text with its values; without a table the number.
    pub text: String,
    /// What the operator should know besides; may be empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub info: String,
    /// Its class; may be empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub class: String,
    /// From 0; higher is more urgent.
    pub priority: u8,
    /// The signal is 1.
    pub active: bool,
    /// Nothing of it waits for an acknowledgement.
    pub acknowledged: bool,
    /// No messages of it are sent.
    pub locked: bool,
    /// When it came last, by the CPU's clock; empty: not known.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub came: String,
    /// When it went since; empty: it is active.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub went: String,
    /// The coming in nanoseconds of the runtime, for "since".
    pub came_ns: u64,
}

/// Date and time of day.
fn date(time: AlarmTime) -> String {
    Moment::from_bytes(time.wall).map(|moment| moment.to_string()).unwrap_or_default()
}

fn values(turn: &AlarmTurn) -> Vec<&[u8]> {
    turn.values.iter().map(|(_, bytes)| bytes).collect()
}

/// The signals of these alarms, the most urgent first, and of those the newest.
#[must_use]
pub fn standing(alarms: &[AlarmNow], texts: &AlarmTexts) -> Vec<StandingAlarm> {
    let mut all: Vec<_> = alarms.iter().flat_map(|alarm| signals(alarm, texts)).collect();
    all.sort_by_key(|one| std::cmp::Reverse((one.priority, one.active, one.came_ns)));
    all
}

fn signals(alarm: &AlarmNow, texts: &AlarmTexts) -> Vec<StandingAlarm> {
    let state = &alarm.state;
    let turn = alarm.went.as_ref().or(alarm.came.as_ref());
    let values = turn.map(values).unwrap_or_default();
    let one = |bit: u8| {
        let mask = 1_u8 << bit;
        let active = state.signals & mask != 0;
        let acknowledged = state.coming & state.going & mask != 0;
        if state.kind.signals() & mask == 0 || !active && acknowledged {
            return None;
        }
        let text = texts.of(state.id, bit + 1);
        let number = || format!("{} {}, signal {}", state.kind.name(), alarm_number(state.id), bit + 1);
        Some(StandingAlarm {
            number: state.id,
            signal: bit + 1,
            block: state.kind.name().to_owned(),
            text: text.map_or_else(number, |text| text.text.with(&values)),
            info: text.map(|text| text.info.with(&values)).unwrap_or_default(),
            class: text.map(|text| text.class.clone()).unwrap_or_default(),
            priority: text.map_or(0, |text| text.priority),
            active,
            acknowledged,
            locked: state.locked,
            came: alarm.came.as_ref().map(|turn| date(turn.time)).unwrap_or_default(),
            went: alarm.went.as_ref().filter(|_| !active).map(|turn| date(turn.time)).unwrap_or_default(),
            came_ns: alarm.came.as_ref().map_or(0, |turn| turn.time.nanos),
        })
    };
    (0..8).filter_map(one).collect()
}

/// Everything of these message numbers is acknowledged.
#[must_use]
pub fn acknowledging(numbers: &[u32]) -> Vec<AlarmAck> {
    numbers.iter().map(|id| AlarmAck { id: *id, coming: 0xFF, going: 0xFF }).collect()
}

#[cfg(test)]
mod tests {
    use ob1_model::{AlarmKind, AlarmState, AlarmValues};

    use super::*;

    fn texts() -> AlarmTexts {
        let row = |text: &str, priority| {
            let text = Template::parse(text).expect("it can be understood");
            AlarmText { text, info: Template::default(), class: "fault".into(), priority }
        };
        AlarmTexts::new(BTreeMap::from([((7, 0), row("any @1I%d@", 1)), ((7, 2), row("second", 9))]))
    }

    #[test]
    fn the_document_says_the_same() {
        assert_eq!(AlarmTexts::read(texts().write().as_bytes()), Some(texts()));
        assert_eq!(AlarmTexts::read(b"[[[1,0],{}]]"), None);
        assert_eq!(AlarmTexts::read(br#"[[[1,0],{"text":"@1Z%d@","info":"","class":"","priority":1}]]"#), None);
    }

    #[test]
    fn every_signal_that_stands_is_told() {
        let mut values = AlarmValues::default();
        assert!(values.push(5, &[0, 42]));
        let time = AlarmTime { nanos: 5_000, wall: [0x26, 0x11, 0x29, 0x16, 0x20, 0x01, 0x12, 0x31] };
        let came = Some(AlarmTurn { time, values });
        // Signal 1 is active and open, 2 has gone and is open, 3 is active and acknowledged, 4 is at rest.
        let state = AlarmState {
            kind: AlarmKind::Alarm8p,
            id: 7,
            signals: 0b101,
            coming: 0b1111_1110,
            going: 0b1111_1101,
            ..AlarmState::default()
        };
        let told = standing(&[AlarmNow { state, came, went: None }], &texts());
        let short: Vec<_> =
            told.iter().map(|one| (one.signal, one.text.as_str(), one.active, one.acknowledged)).collect();
        assert_eq!(short, [(2, "second", false, false), (1, "any 42", true, false), (3, "any 42", true, true)]);
        assert!(told[1].came.starts_with("2026-11-29") && told[1].went.is_empty(), "{}", told[1].came);
        // One signal, without a text; at rest it is not told.
        let state = AlarmState { kind: AlarmKind::AlarmS, id: 1, signals: 1, coming: 1, going: 1, ..state };
        assert_eq!(
            standing(&[AlarmNow { state, ..AlarmNow::default() }], &texts())[0].text,
            "ALARM_S DW#16#00000001, signal 1"
        );
        let state = AlarmState { signals: 0, ..state };
        assert_eq!(standing(&[AlarmNow { state, ..AlarmNow::default() }], &texts()), []);
    }
}
