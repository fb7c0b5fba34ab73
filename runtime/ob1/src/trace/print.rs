//! Records as text: a line for each telegram and control character, and the user data below it.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_protocols::Instant;
use ob1_protocols::trace::{Unit, Way};
use ob1_serial::tap_record::{Kind, Record};
use ob1_stl::printable;
use ob1_trace::{Cp, remark, shown};

use super::s7::Link;
use super::source::News;
use crate::units::hex;

/// Bytes in a line of a dump.
const WIDTH: usize = 16;

/// Lines with their times that wait for a telegram that has begun before them.
type Held = Vec<(Instant, String)>;

/// Turns records into text. A telegram is printed when it has ended, with the time at which it began: lines from in
/// between wait, so that the times of a CP are in order.
#[derive(Debug)]
pub struct Printer {
    raw: bool,
    cps: BTreeMap<u8, Cp>,
    links: BTreeMap<u8, Link>,
    held: BTreeMap<u8, Held>,
    text: String,
}

impl Printer {
    /// Nothing printed yet. `raw`: characters as on the line, instead of user data.
    pub fn new(raw: bool) -> Self {
        Self { raw, cps: BTreeMap::new(), links: BTreeMap::new(), held: BTreeMap::new(), text: String::new() }
    }

    /// Takes a record of the CP or link with this number.
    pub fn take(&mut self, number: u8, record: &Record<'_>) {
        self.tell(number, record);
        self.release(number);
    }

    fn tell(&mut self, number: u8, record: &Record<'_>) {
        if record.kind == Kind::Hello
            && let Some((link, about)) = Link::of_hello(record.data)
        {
            line(self.held.entry(number).or_default(), record.time, &link.name, ' ', &about);
            self.links.insert(number, link);
            return;
        }
        if let Some(link) = self.links.get_mut(&number) {
            let held = self.held.entry(number).or_default();
            for told in link.read(record) {
                let arrow = if told.way == Way::Out { '>' } else { '<' };
                line(held, record.time, &link.name, arrow, &told.text);
                if self.raw
                    && let Some((_, text)) = held.last_mut()
                {
                    dump(text, &told.bytes);
                }
            }
            if let Some(what) = remark(record) {
                line(held, record.time, &link.name, '-', &what);
            }
            return;
        }
        if record.kind == Kind::Hello {
            match Cp::of_hello(record.data) {
                Some((cp, about)) => {
                    // What is open ends with the parameters it was sent with.
                    self.finish_one(number);
                    line(self.held.entry(number).or_default(), record.time, &cp.name, ' ', &about);
                    self.cps.insert(number, cp);
                }
                None => {
                    let held = self.held.entry(number).or_default();
                    line(held, record.time, "?", ' ', "a CP with invalid parameters");
                }
            }
            return;
        }
        let Self { raw, cps, held, .. } = self;
        let (Some(cp), text) = (cps.get_mut(&number), held.entry(number).or_default()) else { return };
        let name = cp.name.clone();
        cp.read(record, &mut |unit| put(text, &name, *raw, &unit));
        if let Some(words) = remark(record) {
            line(text, record.time, &name, '-', &words);
        }
    }

    /// Takes what was heard of a CP.
    pub(crate) fn hear(&mut self, news: &News<'_>) {
        match news {
            News::Record(cp, record) => self.take(*cp, record),
            News::Silence(cp, now) => self.silence(*cp, *now),
        }
    }

    /// The clock of a CP has reached `now` without a record.
    pub fn silence(&mut self, number: u8, now: Instant) {
        let Self { raw, cps, held, .. } = self;
        if let Some(cp) = cps.get_mut(&number) {
            let (name, text) = (cp.name.clone(), held.entry(number).or_default());
            cp.reader.silence(now, &mut |unit| put(text, &name, *raw, &unit));
        }
        self.release(number);
    }

    /// Prints what is still open.
    pub fn finish(&mut self) {
        for number in self.cps.keys().copied().collect::<Vec<_>>() {
            self.finish_one(number);
        }
    }

    fn finish_one(&mut self, number: u8) {
        let Self { raw, cps, held, .. } = self;
        if let Some(cp) = cps.get_mut(&number) {
            let (name, text) = (cp.name.clone(), held.entry(number).or_default());
            cp.reader.finish(&mut |unit| put(text, &name, *raw, &unit));
        }
        self.release(number);
    }

    /// Lets go, in the order of their times, of the lines no open telegram has begun before.
    fn release(&mut self, number: u8) {
        let Some(held) = self.held.get_mut(&number) else { return };
        let open = self.cps.get(&number).and_then(|cp| cp.reader.open_since()).unwrap_or(Instant::NEVER);
        held.sort_by_key(|(time, _)| *time);
        let ready = held.iter().take_while(|(time, _)| *time <= open).count();
        self.text.extend(held.drain(..ready).map(|(_, text)| text));
    }

    /// What there is to print; then there is nothing.
    pub fn text(&mut self) -> String {
        std::mem::take(&mut self.text)
    }
}

fn line(held: &mut Held, time: Instant, name: &str, arrow: char, what: &str) {
    let since = time.since_start();
    // A recording, and what a driver says, may hold anything.
    let (name, what) = (printable(name), printable(what));
    let text = format!("{:>6}.{:06}  {name} {arrow} {what}\n", since.secs(), since.micros() % 1_000_000);
    held.push((time, text));
}

fn put(held: &mut Held, name: &str, raw: bool, unit: &Unit<'_>) {
    let arrow = if unit.way == Way::Out { '>' } else { '<' };
    line(held, unit.begin, name, arrow, &unit.meaning.to_string());
    let Some((_, text)) = held.last_mut() else { return };
    if let Some(bytes) = shown(unit, raw) {
        dump(text, bytes);
    }
}

/// Hexadecimal and text, sixteen bytes a line.
fn dump(text: &mut String, bytes: &[u8]) {
    for (number, part) in bytes.chunks(WIDTH).enumerate() {
        let plain: String =
            part.iter().map(|&byte| if (0x20..0x7F).contains(&byte) { char::from(byte) } else { '.' }).collect();
        // Writing into a String cannot fail.
        let _ = writeln!(text, "                 {:04X}  {:<47}  {plain}", number * WIDTH, hex(part));
    }
}
