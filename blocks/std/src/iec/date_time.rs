//! Date and time: sums, differences, parts, comparisons, S5TIME.
//!
//! A DATE_AND_TIME with digits that are no date is not checked for on the original; here the result is left alone and
//! BR is 0.

use std::cmp::Ordering;

use ob1_model::calendar::DAY_MS;
use ob1_model::moment::Moment;
use ob1_model::{BlockKind::Fc, S5Time};

use crate::Done;
use crate::call::Call;
use crate::declare::{Params, params};
use crate::row::{Origin, Row};

params!(AddSub { Input { T: DT, D: TIME } Return { RET_VAL: DT } });
params!(Difference { Input { DT1: DT, DT2: DT } Return { RET_VAL: TIME } });
params!(Combine { Input { IN1: DATE, IN2: TOD } Return { RET_VAL: DT } });
params!(DatePart { Input { IN: DT } Return { RET_VAL: DATE } });
params!(DayPart { Input { IN: DT } Return { RET_VAL: INT } });
params!(TodPart { Input { IN: DT } Return { RET_VAL: TOD } });
params!(Compare { Input { DT1: DT, DT2: DT } Return { RET_VAL: BOOL } });
params!(FromS5 { Input { IN: S5TIME } Return { RET_VAL: TIME } });
params!(ToS5 { Input { IN: TIME } Return { RET_VAL: S5TIME } });

pub(super) const ROWS: &[Row] = &[
    Row::new::<AddSub>(Origin::Iec, Fc, 1, "AD_DT_TM", |call| shift(call, 1)),
    Row::new::<Combine>(Origin::Iec, Fc, 3, "D_TOD_DT", combine),
    Row::new::<DatePart>(Origin::Iec, Fc, 6, "DT_DATE", |call| {
        part(call, DatePart::IN, DatePart::RET_VAL, Moment::days)
    }),
    Row::new::<DayPart>(Origin::Iec, Fc, 7, "DT_DAY", |call| {
        part(call, DayPart::IN, DayPart::RET_VAL, Moment::weekday)
    })
    .note("1 = Sunday"),
    Row::new::<TodPart>(Origin::Iec, Fc, 8, "DT_TOD", |call| {
        part(call, TodPart::IN, TodPart::RET_VAL, Moment::time_of_day)
    }),
    Row::new::<Compare>(Origin::Iec, Fc, 9, "EQ_DT", |call| compare(call, Ordering::is_eq)),
    Row::new::<Compare>(Origin::Iec, Fc, 12, "GE_DT", |call| compare(call, Ordering::is_ge)),
    Row::new::<Compare>(Origin::Iec, Fc, 14, "GT_DT", |call| compare(call, Ordering::is_gt)),
    Row::new::<Compare>(Origin::Iec, Fc, 18, "LE_DT", |call| compare(call, Ordering::is_le)),
    Row::new::<Compare>(Origin::Iec, Fc, 23, "LT_DT", |call| compare(call, Ordering::is_lt)),
    Row::new::<Compare>(Origin::Iec, Fc, 28, "NE_DT", |call| compare(call, Ordering::is_ne)),
    Row::new::<FromS5>(Origin::Iec, Fc, 33, "S5TI_TIM", from_s5).note("digits above 9: 0 and BR 0"),
    Row::new::<Difference>(Origin::Iec, Fc, 34, "SB_DT_DT", difference),
    Row::new::<AddSub>(Origin::Iec, Fc, 35, "SB_DT_TM", |call| shift(call, -1)),
    Row::new::<ToS5>(Origin::Iec, Fc, 40, "TIM_S5TI", to_s5).note("a negative time: 0 and BR 0"),
];

/// The sum or difference, limited to the range of DATE_AND_TIME with BR 0.
fn shift(call: &mut Call<'_>, sign: i64) -> Done {
    let Ok(moment) = Moment::from_bytes(call.dt(AddSub::T)) else { return call.br(false) };
    let (sum, inside) = moment.plus(sign * i64::from(call.dint(AddSub::D)));
    call.set_dt(AddSub::RET_VAL, sum);
    call.br(inside)
}

/// Limited to the range of TIME with BR 0.
fn difference(call: &mut Call<'_>) -> Done {
    let moments = (Moment::from_bytes(call.dt(Difference::DT1)), Moment::from_bytes(call.dt(Difference::DT2)));
    let (Ok(one), Ok(other)) = moments else { return call.br(false) };
    let difference = one.ms() as i64 - other.ms() as i64;
    let limited = difference.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
    call.set_dint(Difference::RET_VAL, limited as i32);
    call.br(limited == difference)
}

fn combine(call: &mut Call<'_>) -> Done {
    let ms = u64::from(call.raw(Combine::IN1)) * DAY_MS + u64::from(call.raw(Combine::IN2));
    let Some(moment) = Moment::from_ms(ms) else { return call.br(false) };
    call.set_dt(Combine::RET_VAL, moment);
    Ok(())
}

fn part(call: &mut Call<'_>, input: impl Params, ret_val: impl Params, part: fn(Moment) -> u32) -> Done {
    let Ok(moment) = Moment::from_bytes(call.dt(input)) else { return call.br(false) };
    call.set(ret_val, part(moment));
    Ok(())
}

/// The bytes in the order of time: 1990 before 2089, the day of the week left out. Nothing is checked, as on the
/// original.
fn order(mut bytes: [u8; 8]) -> [u8; 8] {
    bytes[0] = if bytes[0] >= 0x90 { bytes[0] - 0x90 } else { bytes[0].saturating_add(0x10) };
    bytes[7] &= 0xF0;
    bytes
}

fn compare(call: &mut Call<'_>, holds: fn(Ordering) -> bool) -> Done {
    let ordering = order(call.dt(Compare::DT1)).cmp(&order(call.dt(Compare::DT2)));
    call.set_bool(Compare::RET_VAL, holds(ordering));
    Ok(())
}

fn from_s5(call: &mut Call<'_>) -> Done {
    let ms = S5Time(call.word(FromS5::IN)).to_ms();
    call.set(FromS5::RET_VAL, ms.unwrap_or(0));
    call.br(ms.is_some())
}

/// Rounded down to the time base. Above 2 h 46 min 30 s: 999.3 and BR 0.
fn to_s5(call: &mut Call<'_>) -> Done {
    let ms = call.dint(ToS5::IN);
    let time = u32::try_from(ms).ok().and_then(S5Time::from_ms);
    call.set(ToS5::RET_VAL, u32::from(time.map_or(if ms < 0 { 0 } else { 0x3999 }, |t| t.0)));
    call.br(time.is_some())
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, dt};

    #[test]
    fn sums_and_differences() {
        for (key, t, d, result, br) in [
            ("IEC:FC1", "1999-12-31-23:59:59.999", 1, "2000-01-01-00:00:00.000", true),
            ("IEC:FC1", "2024-02-28-12:00:00.000", 86_400_000, "2024-02-29-12:00:00.000", true),
            ("IEC:FC1", "1990-01-01-00:00:00.005", -6, "1990-01-01-00:00:00.000", false),
            ("IEC:FC1", "2089-12-31-23:59:59.000", 1000, "2089-12-31-23:59:59.999", false),
            ("IEC:FC35", "2000-03-01-00:00:00.000", 1, "2000-02-29-23:59:59.999", true),
            ("IEC:FC35", "2089-12-31-23:59:59.999", i32::MIN, "2089-12-31-23:59:59.999", false),
            ("IEC:FC35", "1990-01-01-00:00:00.000", 1, "1990-01-01-00:00:00.000", false),
        ] {
            let mut fake = Fake::new(key).with("T", dt(t)).with("D", d.to_be_bytes()).with("RET_VAL", [0; 8]);
            fake.run();
            assert_eq!((fake.bytes("RET_VAL"), fake.br), (&dt(result)[..], br), "{key} {t} {d}");
        }
        for (t1, t2, result, br) in [
            ("2000-01-01-00:00:00.000", "1999-12-31-23:59:59.000", 1000, true),
            ("1999-12-31-23:59:59.000", "2000-01-01-00:00:00.000", -1000, true),
            ("2000-01-01-00:00:00.000", "1999-01-01-00:00:00.000", i32::MAX, false),
            ("1990-01-01-00:00:00.000", "2089-12-31-00:00:00.000", i32::MIN, false),
        ] {
            let mut fake = Fake::new("IEC:FC34").with("DT1", dt(t1)).with("DT2", dt(t2)).with("RET_VAL", [0; 4]);
            fake.run();
            assert_eq!((fake.dint("RET_VAL"), fake.br), (result, br), "{t1} {t2}");
        }
    }

    #[test]
    fn a_date_that_is_none_leaves_the_result_alone() {
        for (key, len) in [("IEC:FC6", 2), ("IEC:FC7", 2), ("IEC:FC8", 4)] {
            let bad = [0x99, 0x13, 1, 0, 0, 0, 0, 0];
            let mut fake = Fake::new(key).with("IN", bad).with("RET_VAL", vec![0x55; len]);
            fake.run();
            assert_eq!((fake.bytes("RET_VAL"), fake.br), (&vec![0x55; len][..], false), "{key}");
        }
    }

    #[test]
    fn parts_and_their_combination() {
        for (text, date, day, tod) in [
            ("1990-01-01-00:00:00.000", 0, 2, 0),
            ("2024-02-29-23:59:59.999", 12_477, 5, 86_399_999),
            ("2089-12-31-12:00:00.001", 36_524, 7, 43_200_001),
        ] {
            for (key, len, value) in [("IEC:FC6", 2, date), ("IEC:FC7", 2, day), ("IEC:FC8", 4, tod)] {
                let mut fake = Fake::new(key).with("IN", dt(text)).with("RET_VAL", vec![0; len]);
                fake.run();
                assert_eq!((fake.value("RET_VAL"), fake.br), (value, true), "{key} {text}");
            }
            let date = (date as u16).to_be_bytes();
            let mut fake =
                Fake::new("IEC:FC3").with("IN1", date).with("IN2", tod.to_be_bytes()).with("RET_VAL", [0; 8]);
            fake.run();
            assert_eq!((fake.bytes("RET_VAL"), fake.br), (&dt(text)[..], true), "{text}");
        }
    }

    #[test]
    fn comparisons_know_the_century_and_leave_the_weekday_out() {
        let (older, newer) = (dt("1999-12-31-23:59:59.999"), dt("2000-01-01-00:00:00.000"));
        let mut same = newer;
        same[7] |= 5;
        for (key, results) in [
            ("IEC:FC9", [0, 0, 1]),
            ("IEC:FC28", [1, 1, 0]),
            ("IEC:FC12", [0, 1, 1]),
            ("IEC:FC14", [0, 1, 0]),
            ("IEC:FC18", [1, 0, 1]),
            ("IEC:FC23", [1, 0, 0]),
        ] {
            for ((one, other), result) in [(older, newer), (newer, older), (newer, same)].into_iter().zip(results) {
                let mut fake = Fake::new(key).with("DT1", one).with("DT2", other).with("RET_VAL", [0]);
                fake.run();
                assert_eq!((fake.value("RET_VAL"), fake.br), (result, true), "{key} {one:02X?} {other:02X?}");
            }
        }
    }

    #[test]
    fn s5time_and_back() {
        for (s5, ms, br) in [(0x3999u16, 9_990_000, true), (0x0127, 1270, true), (0x10A0, 0, false)] {
            let mut fake = Fake::new("IEC:FC33").with("IN", s5.to_be_bytes()).with("RET_VAL", [9; 4]);
            fake.run();
            assert_eq!((fake.dint("RET_VAL"), fake.br), (ms, br), "{s5:04X}");
        }
        for (ms, s5, br) in [
            (1279, 0x0127, true),
            (10_050, 0x1100, true),
            (9_990_000, 0x3999, true),
            (9_990_001, 0x3999, false),
            (9_999_999, 0x3999, false),
            (10_000_000, 0x3999, false),
            (-1, 0, false),
        ] {
            let mut fake = Fake::new("IEC:FC40").with("IN", i32::to_be_bytes(ms)).with("RET_VAL", [9; 2]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (s5, br), "{ms}");
        }
    }
}
