//! Interrupts by time: `[[cpu.cyclic]]`, `[[cpu.time_of_day]]`.

use std::collections::BTreeSet;

use ob1_cpu::{CyclicInterrupt, Missed, TimeOfDay};
use ob1_model::calendar::DAY_MS;
use ob1_model::moment::{Date, Moment};
use ob1_std::services::Period;
use ob1_time::Span;

use super::findings::{Findings, TWICE, VALUE};
use super::tables::{CyclicTable, Placed, TimeOfDayTable};
use super::values::{choice, number, time};

/// The organization blocks of cyclic interrupts.
const CYCLIC: std::ops::RangeInclusive<i64> = 30..=38;
/// Those of time-of-day interrupts.
const TIME_OF_DAY: std::ops::RangeInclusive<i64> = 10..=17;
/// The longest interval, one minute.
const LONGEST: Span = Span::from_secs(60);

/// The cyclic interrupts whose interval is not the default.
pub(super) fn cyclic(f: &mut Findings<'_>, tables: &[CyclicTable]) -> Vec<CyclicInterrupt> {
    let mut seen = BTreeSet::new();
    let mut list = Vec::with_capacity(tables.len());
    for table in tables {
        let ob = number(f, "ob", Some(&table.ob), CYCLIC, 0);
        if !seen.insert(*table.ob.get_ref()) {
            let message = format!("OB {} has its interval twice", table.ob.get_ref());
            f.error(TWICE, table.ob.span(), message, "one [[cpu.cyclic]] for each of OB 30 to OB 38");
        }
        let period = interval(f, &table.period);
        let phase = time(f, table.phase.as_ref(), Span::ZERO);
        if let Some(at) = table.phase.as_ref().filter(|_| phase > LONGEST) {
            f.error(VALUE, at.span(), "the phase offset is out of range", "0 to \"60s\"");
        }
        let words = [("catch-up", Missed::CatchUp), ("skip", Missed::Skip)];
        let missed = choice(f, "missed", table.missed.as_ref(), &words).unwrap_or_default();
        list.push(CyclicInterrupt { ob, period, phase, missed });
    }
    list
}

fn interval(f: &mut Findings<'_>, text: &Placed<String>) -> Span {
    let period = time(f, Some(text), LONGEST);
    if period.is_zero() || period > LONGEST {
        let message = format!("period = \"{}\" is out of range", text.get_ref());
        f.error(VALUE, text.span(), message, "more than 0, at most \"60s\"");
        return LONGEST;
    }
    period
}

/// The time-of-day interrupts that are set without the program.
pub(super) fn time_of_day(f: &mut Findings<'_>, tables: &[TimeOfDayTable]) -> Vec<TimeOfDay> {
    const EVERY: [(&str, Period); 8] = [
        ("once", Period::Once),
        ("minute", Period::EveryMinute),
        ("hour", Period::Hourly),
        ("day", Period::Daily),
        ("week", Period::Weekly),
        ("month", Period::Monthly),
        ("end-of-month", Period::EndOfMonth),
        ("year", Period::Yearly),
    ];
    let mut seen = BTreeSet::new();
    let mut list = Vec::with_capacity(tables.len());
    for table in tables {
        let ob = number(f, "ob", Some(&table.ob), TIME_OF_DAY, 0);
        if !seen.insert(*table.ob.get_ref()) {
            let message = format!("OB {} has its time twice", table.ob.get_ref());
            f.error(TWICE, table.ob.span(), message, "one [[cpu.time_of_day]] for each of OB 10 to OB 17");
        }
        let period = choice(f, "every", table.every.as_ref(), &EVERY).unwrap_or_default();
        match moment(table.start.get_ref()) {
            Some(start) => list.push(TimeOfDay { ob, start, period }),
            None => {
                let message = format!("start = \"{}\" is not a date with a time", table.start.get_ref());
                f.error(VALUE, table.start.span(), message, "write \"2026-01-31 06:00\", years 1990 to 2089");
            }
        }
    }
    list
}

/// `2026-01-31 06:00`, or with seconds.
fn moment(text: &str) -> Option<Moment> {
    let (date, time) = text.trim().split_once([' ', 'T'])?;
    let numbers = |text: &str, separator: char| -> Option<Vec<u32>> {
        text.trim().split(separator).map(|part| part.parse().ok()).collect()
    };
    let [year, month, day] = numbers(date, '-')?[..] else { return None };
    let (hour, minute, second) = match numbers(time, ':')?[..] {
        [hour, minute] => (hour, minute, 0),
        [hour, minute, second] => (hour, minute, second),
        _ => return None,
    };
    if hour > 23 || minute > 59 || second > 59 {
        return None;
    }
    let days = Date { year, month, day }.days()?;
    Moment::from_ms(u64::from(days) * DAY_MS + u64::from((hour * 60 + minute) * 60 + second) * 1000)
}
