//! Interrupts by time: OB 10 to 17 at a time of day (SFC 28 to 31), OB 20 to 23 after a delay (SFC 32 to 34).

use ob1_model::calendar::DAY_MS;
use ob1_model::moment::{Date, Moment};
use ob1_time::Instant;

/// How often a time-of-day interrupt comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[expect(missing_docs, reason = "the values of PERIOD")]
pub enum Period {
    #[default]
    Once,
    EveryMinute,
    Hourly,
    Daily,
    Weekly,
    Monthly,
    Yearly,
    EndOfMonth,
}

impl Period {
    /// The period of a PERIOD word. Once a week has two: 1202h in the description of SFC 28, and 1201h.
    pub const fn from_word(word: u16) -> Option<Self> {
        Some(match word {
            0x0000 => Period::Once,
            0x0201 => Period::EveryMinute,
            0x0401 => Period::Hourly,
            0x1001 => Period::Daily,
            0x1201 | 0x1202 => Period::Weekly,
            0x1401 => Period::Monthly,
            0x1801 => Period::Yearly,
            0x2001 => Period::EndOfMonth,
            _ => return None,
        })
    }
}

/// A time-of-day interrupt. The CPU starts its OB at each moment [`TimeOfDayInterrupt::next`] gives while `active`, and
/// ends `active` after the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeOfDayInterrupt {
    /// First time and period, once set.
    pub set: Option<(Moment, Period)>,
    /// Activated and not yet elapsed.
    pub active: bool,
    /// The OB is loaded.
    pub loaded: bool,
    /// Cancelled or set anew: a request that waits is dropped. The CPU takes the mark away.
    pub withdrawn: bool,
}

impl TimeOfDayInterrupt {
    /// The first time after `now`, whether active or not; `None` when there is none.
    pub fn next(&self, now: Moment) -> Option<Moment> {
        let (start, period) = self.set?;
        let step = match period {
            Period::Once => return (start > now).then_some(start),
            Period::EveryMinute => 60_000,
            Period::Hourly => 3_600_000,
            Period::Daily => DAY_MS,
            Period::Weekly => 7 * DAY_MS,
            Period::Monthly | Period::Yearly | Period::EndOfMonth => return by_calendar(start, period, now),
        };
        if start > now {
            return Some(start);
        }
        let steps = (now.ms() - start.ms()) / step + 1;
        Moment::from_ms(start.ms() + steps * step)
    }
}

/// The next month or year that has the day. Months without it are left out.
fn by_calendar(start: Moment, period: Period, now: Moment) -> Option<Moment> {
    let first = Date::from_days(start.days())?;
    let from = Date::from_days(now.max(start).days())?;
    let mut month = from.year * 12 + from.month - 1;
    while month < 2090 * 12 {
        let (year, number) = (month / 12, month % 12 + 1);
        let last = Date::days_of_month(year, number);
        let day = if period == Period::EndOfMonth { last } else { first.day };
        if day <= last && (period != Period::Yearly || number == first.month) {
            let days = Date { year, month: number, day }.days()?;
            let at = Moment::from_ms(u64::from(days) * DAY_MS + u64::from(start.time_of_day()))?;
            if at > now && at >= start {
                return Some(at);
            }
        }
        month += 1;
    }
    None
}

/// A time-delay interrupt, OB 20 to 23.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DelayInterrupt {
    /// Due at this time, with DTIME in milliseconds and SIGN for the start information.
    pub due: Option<(Instant, u32, u16)>,
    /// The OB is loaded.
    pub loaded: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(year: u32, month: u32, day: u32, hour: u64) -> Moment {
        Moment::from_ms(u64::from(Date { year, month, day }.days().unwrap()) * DAY_MS + hour * 3_600_000).unwrap()
    }

    #[test]
    fn the_next_time_of_each_period() {
        let start = at(2024, 1, 31, 6);
        for (period, now, next) in [
            (Period::Once, at(2024, 1, 31, 5), Some(start)),
            (Period::Once, start, None),
            (Period::Hourly, at(2024, 1, 31, 9), Some(at(2024, 1, 31, 10))),
            (Period::Daily, at(2024, 2, 3, 7), Some(at(2024, 2, 4, 6))),
            (Period::Weekly, at(2024, 2, 1, 0), Some(at(2024, 2, 7, 6))),
            (Period::Monthly, at(2024, 2, 1, 0), Some(at(2024, 3, 31, 6))),
            (Period::EndOfMonth, start, Some(at(2024, 2, 29, 6))),
            (Period::Yearly, at(2024, 5, 1, 0), Some(at(2025, 1, 31, 6))),
            (Period::Yearly, at(2000, 5, 1, 0), Some(start)),
            (Period::Daily, Moment::MAX, None),
            (Period::Yearly, Moment::MAX, None),
        ] {
            let interrupt =
                TimeOfDayInterrupt { set: Some((start, period)), active: true, ..TimeOfDayInterrupt::default() };
            assert_eq!(interrupt.next(now), next, "{period:?} after {now:?}");
        }
        assert_eq!(TimeOfDayInterrupt::default().next(start), None);
    }
}
