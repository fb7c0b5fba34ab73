//! SFC 0 SET_CLK, SFC 1 READ_CLK, SFC 100 SET_CLKS, SFC 2 to 4 and SFC 101: run-time meters, SFC 64 TIME_TCK.
//! ["Handling the System Clock", "Handling Run-Time Meters"]

use ob1_model::moment::{Moment, MomentError};

use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;
use crate::services::RunTimeMeter;
use crate::ticks::time_tick;

params!(SetClk { Input { PDT: DT } Return { RET_VAL: INT } });
params!(ReadClk { Return { RET_VAL: INT } Output { CDT: DT } });
params!(SetRtm { Input { NR: BYTE, PV: INT } Return { RET_VAL: INT } });
params!(CtrlRtm { Input { NR: BYTE, S: BOOL } Return { RET_VAL: INT } });
params!(ReadRtm { Input { NR: BYTE } Return { RET_VAL: INT } Output { CQ: BOOL, CV: INT } });
params!(SetClkS { Input { MODE: BYTE, PDT: DT, CORR: INT, SUMMER: BOOL, ANN_1: BOOL } Return { RET_VAL: INT } });
params!(Rtm { Input { NR: BYTE, MODE: BYTE, PV: DINT } Return { RET_VAL: INT } Output { CQ: BOOL, CV: DINT } });
params!(TimeTick { Return { RET_VAL: TIME } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<SetClk>(0, "SET_CLK", set_clk),
    Row::coded::<ReadClk>(1, "READ_CLK", |call| {
        let moment = call.cx.services().moment();
        call.set_dt(ReadClk::CDT, moment);
        Ok(0)
    }),
    Row::coded::<SetRtm>(2, "SET_RTM", set_rtm).note("stands still in STOP; SFC 3 starts it after a restart"),
    Row::coded::<CtrlRtm>(3, "CTRL_RTM", ctrl_rtm),
    Row::coded::<ReadRtm>(4, "READ_RTM", read_rtm),
    Row::coded::<SetClkS>(100, "SET_CLKS", set_clks).note("CORR, SUMMER and ANN_1 are checked and not kept"),
    Row::coded::<Rtm>(101, "RTM", rtm),
    Row::sfc::<TimeTick>(64, "TIME_TCK", |call| {
        let now = time_tick(call.cx.now());
        call.set(TimeTick::RET_VAL, now);
        Ok(())
    }),
];

/// No meter of this number.
const NO_METER: u16 = 0x8080;

fn set_clk(call: &mut Call<'_>) -> Code {
    let moment = Moment::from_bytes(call.dt(SetClk::PDT)).map_err(|error| match error {
        MomentError::Date => 0x8080_u16,
        MomentError::Time => 0x8081,
    })?;
    call.cx.services().set_moment(moment);
    Ok(0)
}

fn set_rtm(call: &mut Call<'_>) -> Code {
    let (number, hours) = (call.byte(SetRtm::NR), u16::try_from(call.int(SetRtm::PV)));
    let meter = call.cx.services().meter(number).ok_or(NO_METER)?;
    meter.set(u32::from(hours.map_err(|_| 0x8081_u16)?));
    Ok(0)
}

fn ctrl_rtm(call: &mut Call<'_>) -> Code {
    let (number, run, now) = (call.byte(CtrlRtm::NR), call.bool(CtrlRtm::S), call.cx.now());
    call.cx.services().meter(number).ok_or(NO_METER)?.control(run, now);
    Ok(0)
}

fn read_rtm(call: &mut Call<'_>) -> Code {
    let (number, now) = (call.byte(ReadRtm::NR), call.cx.now());
    let meter = *call.cx.services().meter(number).ok_or(NO_METER)?;
    let hours = meter.hours(now);
    call.set_bool(ReadRtm::CQ, meter.is_running());
    call.set_int(ReadRtm::CV, hours.unwrap_or(RunTimeMeter::MAX_HOURS) as i16);
    if hours.is_some() { Ok(0) } else { Err(0x8081) }
}

/// Clock and status of the clock. MODE: bit 0 sets the clock, bit 1 the status.
fn set_clks(call: &mut Call<'_>) -> Code {
    let (mode, corr) = (call.byte(SetClkS::MODE), call.int(SetClkS::CORR));
    let (sets_clock, sets_status) = (mode & 1 != 0, mode & 2 != 0);
    if !(1..=3).contains(&mode) {
        return Err(0x8080);
    }
    // Half hours.
    if sets_status && !(-24..=26).contains(&corr) {
        return Err(0x8081);
    }
    if sets_clock {
        let moment = Moment::from_bytes(call.dt(SetClkS::PDT)).map_err(|_| 0x8082_u16)?;
        call.cx.services().set_moment(moment);
    }
    Ok(0)
}

/// MODE: 0 only reads, 1 starts, 2 stops, 4 sets, 5 sets and starts, 6 sets and stops, 7 saves all meters (which are
/// retentive here). The outputs show the meter after the job.
fn rtm(call: &mut Call<'_>) -> Code {
    let (number, mode, now) = (call.byte(Rtm::NR), call.byte(Rtm::MODE), call.cx.now());
    let preset = u32::try_from(call.dint(Rtm::PV));
    let meter = call.cx.services().meter(number).ok_or(NO_METER)?;
    let mut code = 0;
    match (mode, preset) {
        (0 | 7, _) => {}
        (1 | 2, _) => meter.control(mode == 1, now),
        (4..=6, Ok(hours)) => {
            // Setting alone leaves it running or standing as it was.
            let runs = if mode == 4 { meter.is_running() } else { mode == 5 };
            meter.set(hours);
            meter.control(runs, now);
        }
        (4..=6, Err(_)) => code = 0x8081,
        _ => code = 0x8091,
    }
    let (running, hours) = (meter.is_running(), meter.long_hours(now));
    call.set_bool(Rtm::CQ, running);
    call.set_dint(Rtm::CV, hours.unwrap_or(RunTimeMeter::MAX_LONG_HOURS) as i32);
    match code {
        0 if hours.is_none() => Err(0x8082),
        0 => Ok(0),
        error => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use ob1_time::{Instant, Span};

    use crate::tests::{Fake, dt, moment};

    #[test]
    fn the_clock() {
        let text = "2024-02-29-12:34:56.789";
        for (bytes, code) in
            [(dt(text), 0), ([0x24, 0x02, 0x30, 0, 0, 0, 0, 0], 0x8080), ([0x24, 0x02, 0x29, 0x25, 0, 0, 0, 0], 0x8081)]
        {
            let mut fake = Fake::new("SYSTEM:SFC0").with("PDT", bytes).with("RET_VAL", [9; 2]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0));
            assert_eq!(fake.station.moment == moment(text), code == 0);
        }
        let mut fake = Fake::new("SYSTEM:SFC1").with("CDT", [0; 8]).with("RET_VAL", [9; 2]);
        fake.station.moment = moment(text);
        fake.run();
        assert_eq!((fake.bytes("CDT"), fake.value("RET_VAL")), (&dt(text)[..], 0));
    }

    #[test]
    fn meters() {
        const HOUR: Span = Span::from_secs(3600);
        for (number, hours, code) in [(1, 100i16, 0), (2, 100, 0x8080), (1, -1, 0x8081)] {
            let mut fake = Fake::new("SYSTEM:SFC2").with("NR", [number]).with("PV", hours.to_be_bytes());
            fake = fake.with("RET_VAL", [0; 2]);
            fake.run();
            assert_eq!(fake.value("RET_VAL"), code);
            assert_eq!(fake.station.meters[1].hours(Instant::START), Some(if code == 0 { 100 } else { 0 }));
        }
        let mut fake = Fake::new("SYSTEM:SFC3").with("NR", [0]).with("S", [1]).with("RET_VAL", [0; 2]);
        fake.station.meters[0].set(32_767);
        fake.run();
        let running = fake.station.meters[0];
        for (now, hours, code) in [(HOUR - Span::from_nanos(1), 32_767, 0), (HOUR, 32_767, 0x8081)] {
            let mut fake = Fake::new("SYSTEM:SFC4").with("NR", [0]).with("RET_VAL", [0; 2]);
            fake = fake.with("CQ", [0]).with("CV", [0; 2]);
            fake.now = Instant::START + now;
            fake.station.meters[0] = running;
            fake.run();
            assert_eq!((fake.value("CQ"), fake.value("CV"), fake.value("RET_VAL")), (1, hours, code));
        }
        let mut stopped = running;
        stopped.set(1);
        let started = Instant::from_nanos(5);
        stopped.control(true, started);
        stopped.control(false, started + 2 * HOUR);
        assert_eq!((stopped.hours(started + 9 * HOUR), stopped.is_running()), (Some(3), false));
        for (continues, hours) in [(true, 3), (false, 2)] {
            let mut meter = stopped;
            meter.set(1);
            meter.control(true, started);
            meter.stood(started + HOUR, started + 5 * HOUR, continues);
            assert_eq!((meter.hours(started + 6 * HOUR), meter.is_running()), (Some(hours), continues));
        }
        for key in ["SYSTEM:SFC3", "SYSTEM:SFC4"] {
            let mut fake = Fake::new(key).with("NR", [9]).with("RET_VAL", [0; 2]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (0x8080, false));
        }
    }

    #[test]
    fn the_clock_with_its_status() {
        let text = "2024-02-29-12:34:56.789";
        let bad = [0x24, 0x02, 0x30, 0, 0, 0, 0, 0];
        for (mode, bytes, corr, code, set) in [
            (1u8, dt(text), 99i16, 0, true),
            (2, bad, 26, 0, false),
            (3, dt(text), -24, 0, true),
            (3, dt(text), 27, 0x8081, false),
            (2, bad, -25, 0x8081, false),
            (1, bad, 0, 0x8082, false),
            (0, dt(text), 0, 0x8080, false),
            (4, dt(text), 0, 0x8080, false),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC100").with("MODE", [mode]).with("PDT", bytes);
            fake = fake.with("CORR", corr.to_be_bytes()).with("SUMMER", [1]).with("ANN_1", [0]).with("RET_VAL", [9; 2]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{mode} {corr}");
            assert_eq!(fake.station.moment == moment(text), set, "{mode} {corr}");
        }
    }

    #[test]
    fn long_meters() {
        const HOUR: Span = Span::from_secs(3600);
        let mut fake = Fake::new("SYSTEM:SFC101").with("NR", [1]).with("MODE", [0]).with("PV", [0; 4]);
        fake = fake.with("RET_VAL", [9; 2]).with("CQ", [9]).with("CV", [9; 4]);
        for (now, mode, pv, code, running, hours) in [
            (Span::ZERO, 5u8, 40_000i32, 0, 1, 40_000),
            (2 * HOUR, 0, 0, 0, 1, 40_002),
            (2 * HOUR, 2, 0, 0, 0, 40_002),
            (9 * HOUR, 7, 0, 0, 0, 40_002),
            (9 * HOUR, 4, -1, 0x8081, 0, 40_002),
            (9 * HOUR, 3, 0, 0x8091, 0, 40_002),
            (9 * HOUR, 4, 7, 0, 0, 7),
            (9 * HOUR, 1, 0, 0, 1, 7),
            (10 * HOUR, 4, i32::MAX, 0, 1, i32::MAX),
            (11 * HOUR, 0, 0, 0x8082, 1, i32::MAX),
            (11 * HOUR, 6, 1, 0, 0, 1),
        ] {
            fake.now = Instant::START + now;
            fake.set("MODE", &[mode]);
            fake.set("PV", &pv.to_be_bytes());
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("CQ"), fake.dint("CV"));
            assert_eq!(result, (code, running, hours), "{mode} {pv}");
        }
        fake.set("NR", &[9]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.br), (0x8080, false));
    }

    #[test]
    fn ticks() {
        let mut fake = Fake::new("SYSTEM:SFC64").with("RET_VAL", [9; 4]);
        fake.now = Instant::from_nanos(1_999_999);
        fake.run();
        assert_eq!(fake.value("RET_VAL"), 1);
    }
}
