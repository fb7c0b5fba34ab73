//! SFC 28 to 31: time-of-day interrupts; SFC 32 to 34: time-delay interrupts.
//! ["Handling Time-of-Day Interrupts", "Handling Time-Delay Interrupts"]

use ob1_model::moment::Moment;
use ob1_time::Span;

use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;
use crate::services::{Period, Schedule};

params!(SetTint { Input { OB_NR: INT, SDT: DT, PERIOD: WORD } Return { RET_VAL: INT } });
params!(Ob { Input { OB_NR: INT } Return { RET_VAL: INT } });
params!(Query { Input { OB_NR: INT } Return { RET_VAL: INT } Output { STATUS: WORD } });
params!(SrtDint { Input { OB_NR: INT, DTIME: TIME, SIGN: WORD } Return { RET_VAL: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<SetTint>(28, "SET_TINT", set_tint)
        .note("seconds of SDT count as 0; PERIOD 1201h and 1202h: every week"),
    Row::coded::<Ob>(29, "CAN_TINT", |call| on_ob(call, can_tint)),
    Row::coded::<Ob>(30, "ACT_TINT", |call| on_ob(call, act_tint)),
    Row::coded::<Query>(31, "QRY_TINT", |call| query(call, tint_state)),
    Row::coded::<SrtDint>(32, "SRT_DINT", srt_dint).note("1 to 60000 ms; a new call starts the delay again"),
    Row::coded::<Ob>(33, "CAN_DINT", |call| on_ob(call, can_dint)),
    Row::coded::<Query>(34, "QRY_DINT", |call| query(call, dint_state)),
];

/// OB_NR names no interrupt this CPU has.
const WRONG_OB: u16 = 0x8090;
/// Nothing was set or started for the OB.
const NOT_SET: u16 = 0x80A0;
/// The start lies in the past.
const PAST: u16 = 0x80A1;

/// STATUS: SFC 39 has locked new interrupts. Bits 0 and 5, locked by the system or by a test function, are always 0.
const LOCKED: u16 = 1 << 1;
const ACTIVE: u16 = 1 << 2;
const LOADED: u16 = 1 << 4;

fn set_tint(call: &mut Call<'_>) -> Code {
    let (ob, sdt, period) = (call.word(SetTint::OB_NR), call.dt(SetTint::SDT), call.word(SetTint::PERIOD));
    let schedule = call.cx.services();
    let now = schedule.moment();
    let interrupt = schedule.time_of_day(ob).ok_or(WRONG_OB)?;
    let start = Moment::from_bytes(sdt).ok().and_then(|m| Moment::from_ms(m.ms() - m.ms() % 60_000));
    let start = start.ok_or(0x8091_u16)?;
    let period = Period::from_word(period).ok_or(0x8092_u16)?;
    if period == Period::Once && start < now {
        return Err(PAST);
    }
    interrupt.set = Some((start, period));
    (interrupt.active, interrupt.withdrawn) = (false, true);
    Ok(0)
}

/// A block whose only input is OB_NR.
fn on_ob(call: &mut Call<'_>, run: fn(&mut dyn Schedule, u16) -> Code) -> Code {
    let ob = call.word(Ob::OB_NR);
    run(call.cx.services(), ob)
}

/// What was set is forgotten.
fn can_tint(schedule: &mut dyn Schedule, ob: u16) -> Code {
    let interrupt = schedule.time_of_day(ob).ok_or(WRONG_OB)?;
    interrupt.set.take().ok_or(NOT_SET)?;
    (interrupt.active, interrupt.withdrawn) = (false, true);
    Ok(0)
}

fn act_tint(schedule: &mut dyn Schedule, ob: u16) -> Code {
    let now = schedule.moment();
    let interrupt = schedule.time_of_day(ob).ok_or(WRONG_OB)?;
    let (start, period) = interrupt.set.ok_or(NOT_SET)?;
    if period == Period::Once && start < now {
        return Err(PAST);
    }
    interrupt.active = true;
    Ok(0)
}

/// STATUS of an interrupt: activated, loaded.
type State = fn(&mut dyn Schedule, u16) -> Option<(bool, bool)>;

fn tint_state(schedule: &mut dyn Schedule, ob: u16) -> Option<(bool, bool)> {
    schedule.time_of_day(ob).map(|interrupt| (interrupt.active, interrupt.loaded))
}

fn dint_state(schedule: &mut dyn Schedule, ob: u16) -> Option<(bool, bool)> {
    schedule.delay(ob).map(|interrupt| (interrupt.due.is_some(), interrupt.loaded))
}

fn query(call: &mut Call<'_>, state: State) -> Code {
    let ob = call.word(Query::OB_NR);
    let locked = call.cx.services().interrupt_locks().is_disabled(ob);
    let state = state(call.cx.services(), ob);
    let status = state.map_or(0, |(active, loaded)| {
        let bits = [(locked, LOCKED), (active, ACTIVE), (loaded, LOADED)];
        bits.into_iter().filter(|(set, _)| *set).fold(0, |status, (_, bit)| status | bit)
    });
    call.set(Query::STATUS, u32::from(status));
    if state.is_some() { Ok(0) } else { Err(WRONG_OB) }
}

fn srt_dint(call: &mut Call<'_>) -> Code {
    let (ob, delay, sign) = (call.word(SrtDint::OB_NR), call.raw(SrtDint::DTIME), call.word(SrtDint::SIGN));
    let now = call.cx.now();
    let interrupt = call.cx.services().delay(ob).ok_or(WRONG_OB)?;
    if !(1..=60_000).contains(&delay) {
        return Err(0x8091);
    }
    interrupt.due = Some((now.saturating_add(Span::MILLISECOND * u64::from(delay)), delay, sign));
    Ok(0)
}

fn can_dint(schedule: &mut dyn Schedule, ob: u16) -> Code {
    schedule.delay(ob).ok_or(WRONG_OB)?.due.take().map(|_| 0).ok_or(NOT_SET)
}

#[cfg(test)]
mod tests {
    use ob1_time::{Instant, Span};

    use crate::services::{DelayInterrupt, Period, TimeOfDayInterrupt};
    use crate::tests::{Fake, dt, moment};

    const NOW: &str = "2024-03-01-00:00:00.000";
    const SOON: Instant = Instant::from_nanos(7);
    const LATER: &str = "2024-03-01-06:30:00.000";
    const EARLIER: &str = "2024-02-01-06:30:00.000";

    #[test]
    fn setting_a_time_of_day() {
        for (ob, sdt, period, code) in [
            (10u16, dt("2024-03-01-06:30:12.345"), 0x0000u16, 0),
            (10, dt(LATER), 0x1001, 0),
            (10, dt(EARLIER), 0x1001, 0),
            (10, dt(EARLIER), 0x1201, 0),
            (10, dt(EARLIER), 0x1202, 0),
            (10, dt(EARLIER), 0x0000, 0x80A1),
            (11, dt(LATER), 0x1001, 0x8090),
            (10, [0xFF; 8], 0x1001, 0x8091),
            (10, dt(LATER), 0x0001, 0x8092),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC28").with("OB_NR", ob.to_be_bytes()).with("SDT", sdt);
            fake = fake.with("PERIOD", period.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake.station.moment = moment(NOW);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{ob} {period:04X}");
            let set = fake.station.time_of_day.set.map(|(start, _)| start.ms() % 60_000);
            assert_eq!(set, (code == 0).then_some(0), "seconds count as 0");
        }
    }

    /// Calls a block with OB_NR; RET_VAL and the interrupt afterwards.
    fn on_ob(key: &str, ob: u16, interrupt: TimeOfDayInterrupt) -> (u32, TimeOfDayInterrupt) {
        let mut fake = Fake::new(key).with("OB_NR", ob.to_be_bytes()).with("RET_VAL", [9; 2]);
        fake.station.moment = moment(NOW);
        fake.station.time_of_day = interrupt;
        fake.run();
        (fake.value("RET_VAL"), fake.station.time_of_day)
    }

    #[test]
    fn activating_and_cancelling() {
        let unset = TimeOfDayInterrupt { loaded: true, ..TimeOfDayInterrupt::default() };
        let set = TimeOfDayInterrupt { set: Some((moment(LATER), Period::Once)), ..unset };
        let active = TimeOfDayInterrupt { active: true, ..set };
        let past = TimeOfDayInterrupt { set: Some((moment(EARLIER), Period::Once)), ..unset };
        assert_eq!(on_ob("SYSTEM:SFC30", 10, set), (0, active));
        assert_eq!(on_ob("SYSTEM:SFC30", 10, unset), (0x80A0, unset));
        assert_eq!(on_ob("SYSTEM:SFC30", 10, past), (0x80A1, past));
        assert_eq!(on_ob("SYSTEM:SFC30", 17, set), (0x8090, set));
        let withdrawn = TimeOfDayInterrupt { withdrawn: true, ..unset };
        assert_eq!(on_ob("SYSTEM:SFC29", 10, active), (0, withdrawn));
        assert_eq!(on_ob("SYSTEM:SFC29", 10, unset), (0x80A0, unset));
        assert_eq!(on_ob("SYSTEM:SFC29", 9, unset), (0x8090, unset));
    }

    #[test]
    fn queries() {
        for (key, ob, active, loaded, status, code) in [
            ("SYSTEM:SFC31", 10u16, true, true, 0x14, 0),
            ("SYSTEM:SFC31", 10, false, true, 0x10, 0),
            ("SYSTEM:SFC31", 20, true, true, 0, 0x8090),
            ("SYSTEM:SFC34", 20, true, false, 0x04, 0),
            ("SYSTEM:SFC34", 20, false, false, 0, 0),
            ("SYSTEM:SFC34", 10, true, true, 0, 0x8090),
        ] {
            let mut fake =
                Fake::new(key).with("OB_NR", ob.to_be_bytes()).with("RET_VAL", [9; 2]).with("STATUS", [9; 2]);
            fake.station.time_of_day = TimeOfDayInterrupt { active, loaded, ..TimeOfDayInterrupt::default() };
            fake.station.delay = DelayInterrupt { due: active.then_some((SOON, 1, 1)), loaded };
            fake.run();
            assert_eq!((fake.value("STATUS"), fake.value("RET_VAL")), (status, code), "{key} {ob}");
        }
    }

    #[test]
    fn a_locked_interrupt_is_shown() {
        for (key, ob) in [("SYSTEM:SFC31", 10u16), ("SYSTEM:SFC34", 20)] {
            let mut fake =
                Fake::new(key).with("OB_NR", ob.to_be_bytes()).with("RET_VAL", [9; 2]).with("STATUS", [9; 2]);
            fake.station.time_of_day = TimeOfDayInterrupt { loaded: true, ..TimeOfDayInterrupt::default() };
            fake.station.delay = DelayInterrupt { due: None, loaded: true };
            assert_eq!(fake.station.locks.disable(2, ob), Ok(()));
            fake.run();
            assert_eq!((fake.value("STATUS"), fake.value("RET_VAL")), (0x12, 0), "{key}");
            assert_eq!(fake.station.locks.enable(2, ob), Ok(()));
            fake.run();
            assert_eq!((fake.value("STATUS"), fake.value("RET_VAL")), (0x10, 0), "{key}");
        }
    }

    #[test]
    fn delays() {
        for (ob, time, code) in
            [(20u16, 1u32, 0), (20, 60_000, 0), (20, 0, 0x8091), (20, 60_001, 0x8091), (24, 5, 0x8090)]
        {
            let mut fake = Fake::new("SYSTEM:SFC32").with("OB_NR", ob.to_be_bytes()).with("DTIME", time.to_be_bytes());
            fake = fake.with("SIGN", [0x12, 0x34]).with("RET_VAL", [9; 2]);
            fake.now = SOON;
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{ob} {time}");
            let due = (code == 0).then_some((SOON + Span::from_millis(time.into()), time, 0x1234));
            assert_eq!(fake.station.delay.due, due);
        }
        for (ob, due, code) in [(20u16, Some((SOON, 1, 1)), 0), (20, None, 0x80A0), (19, None, 0x8090)] {
            let mut fake = Fake::new("SYSTEM:SFC33").with("OB_NR", ob.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake.station.delay.due = due;
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.station.delay.due), (code, None));
        }
    }
}
