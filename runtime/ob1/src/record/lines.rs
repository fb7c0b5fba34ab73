//! What was on the lines, by the clock of a recording.

use std::collections::BTreeMap;

use ob1_protocols::trace::{Meaning, Unit, Way};
use ob1_serial::tap_record::{Kind, Record};
use ob1_time::{Instant, Span};
use ob1_trace::{Cp, OrderStep, order_step, remark, shown};

use crate::trace::Link;
use crate::units;

/// Bytes of a telegram that are shown.
const SHOWN: usize = 64;

/// Something on a line.
pub(super) struct Told {
    /// Name of the CP, bus or link.
    pub(super) line: String,
    /// `out`, `in`, `line` for what has no direction, [`ORDERS`] for an order of its CP.
    pub(super) way: &'static str,
    pub(super) begin: Instant,
    pub(super) end: Instant,
    pub(super) text: String,
    /// Its bytes in hexadecimal, the first of them.
    pub(super) bytes: String,
    pub(super) is_telegram: bool,
}

/// The way of an order: from when the CP has it whole until it has ended.
pub(super) const ORDERS: &str = "orders";

enum Line {
    Cp(Box<Cp>),
    Link(Link),
}

/// The lines that are listened to, by the number of their taps.
pub(super) struct Lines {
    unix: u64,
    lines: BTreeMap<u8, Line>,
    /// The order of each that is under way, and what its CP says of it.
    orders: BTreeMap<u8, (Instant, String)>,
}

/// The time of a driver by the clock of the recording: both say what the date was at their 0.
fn shifted(time: Instant, driver: u64, unix: u64) -> Instant {
    Instant::from_nanos((driver.saturating_add(time.nanos())).saturating_sub(unix))
}

fn hex(bytes: &[u8]) -> String {
    let more = if bytes.len() > SHOWN { " ..." } else { "" };
    units::hex(&bytes[..bytes.len().min(SHOWN)]) + more
}

const fn way(way: Way) -> &'static str {
    match way {
        Way::Out => "out",
        Way::In => "in",
    }
}

impl Lines {
    /// `unix`: nanoseconds since 1970 when the clock of the recording showed 0.
    pub(super) const fn new(unix: u64) -> Self {
        Self { unix, lines: BTreeMap::new(), orders: BTreeMap::new() }
    }

    /// Reads the record of a tap.
    pub(super) fn read(&mut self, number: u8, record: &[u8]) -> Vec<Told> {
        let Some(record) = Record::read(record) else { return Vec::new() };
        if record.kind == Kind::Hello {
            let told = self.finish_one(number);
            let link = Link::of_hello(record.data).map(|(link, _)| Line::Link(link));
            let line = link.or_else(|| Cp::of_hello(record.data).map(|(cp, _)| Line::Cp(Box::new(cp))));
            if let Some(line) = line {
                self.lines.insert(number, line);
            }
            return told;
        }
        let unix = self.unix;
        let Some(line) = self.lines.get_mut(&number) else { return Vec::new() };
        let mut all = Vec::new();
        let (name, zero) = match line {
            Line::Link(link) => {
                let at = shifted(record.time, link.unix, unix);
                let name = link.name.clone();
                all.extend(link.read(&record).into_iter().map(|told| Told {
                    line: name.clone(),
                    way: way(told.way),
                    begin: at,
                    end: at,
                    text: told.text,
                    bytes: hex(&told.bytes),
                    is_telegram: false,
                }));
                (name, link.unix)
            }
            Line::Cp(cp) => {
                let (name, zero) = (cp.name.clone(), cp.unix);
                cp.read(&record, &mut |unit| all.push(of_unit(&name, zero, unix, &unit)));
                (name, zero)
            }
        };
        if let Some(text) = remark(&record) {
            let at = shifted(record.time, zero, unix);
            let bytes = String::new();
            all.extend(self.order(number, &name, &record, at, &text));
            all.push(Told { line: name, way: "line", begin: at, end: at, text, bytes, is_telegram: false });
        }
        all
    }

    /// An order that ends with this note.
    fn order(&mut self, number: u8, name: &str, record: &Record<'_>, at: Instant, text: &str) -> Option<Told> {
        let step = order_step(record)?;
        let before = match step {
            // Another one, and no end of the one before: its end was lost.
            OrderStep::Begun => self.orders.insert(number, (at, text.to_owned())),
            OrderStep::Done | OrderStep::Failed => self.orders.remove(&number),
        };
        let end = if step == OrderStep::Begun { "no end was heard" } else { text };
        let (begin, order) = match (before, step) {
            (Some(before), _) => before,
            // Refused as it came.
            (None, OrderStep::Failed) => (at, "order".to_owned()),
            (None, _) => return None,
        };
        Some(Told {
            line: name.to_owned(),
            way: ORDERS,
            begin,
            end: at.max(begin),
            text: format!("{order}: {end}"),
            bytes: String::new(),
            is_telegram: true,
        })
    }

    /// What is still open.
    pub(super) fn finish(&mut self) -> Vec<Told> {
        self.lines.keys().copied().collect::<Vec<_>>().into_iter().flat_map(|number| self.finish_one(number)).collect()
    }

    fn finish_one(&mut self, number: u8) -> Vec<Told> {
        let (mut all, unix) = (Vec::new(), self.unix);
        if let Some(Line::Cp(cp)) = self.lines.get_mut(&number) {
            let (name, zero) = (cp.name.clone(), cp.unix);
            cp.reader.finish(&mut |unit| all.push(of_unit(&name, zero, unix, &unit)));
        }
        all
    }
}

fn of_unit(name: &str, zero: u64, unix: u64, unit: &Unit<'_>) -> Told {
    let is_telegram = !matches!(unit.meaning, Meaning::Control(..) | Meaning::Fault(_));
    // The end of the last character is that of its time on the line, which nobody measures.
    let (begin, end) = (shifted(unit.begin, zero, unix), shifted(unit.end, zero, unix));
    Told {
        line: name.to_owned(),
        way: way(unit.way),
        begin,
        end: if is_telegram { end.max(begin + Span::from_nanos(1)) } else { end },
        text: unit.meaning.to_string(),
        bytes: shown(unit, false).map(hex).unwrap_or_default(),
        is_telegram,
    }
}
