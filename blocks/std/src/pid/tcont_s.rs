//! FB 59 TCONT_S: temperature controller for an actuator that integrates, with pulses up and down.
//! ["PID Temperature Control"]
//!
//! A PI algorithm as in CONT_S, whose steps of the actuator it shares; times are REALs of seconds here.

use ob1_model::BlockKind::Fb;

use super::actuator::{Actuator, THRESHOLDS, Travel};
use super::input::{TRUE, dead_band, real};
use super::temperature::{process_value, proportional_step};
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::{Origin, Row};

params!(TcontS {
    Input {
        CYCLE: REAL = real(0.1), SP_INT: REAL, PV_IN: REAL, PV_PER: INT, DISV: REAL, LMNR_HS: BOOL, LMNR_LS: BOOL,
        LMNS_ON: BOOL = TRUE, LMNUP: BOOL, LMNDN: BOOL,
    }
    Output { QLMNUP: BOOL, QLMNDN: BOOL, PV: REAL, ER: REAL }
    InOut { COM_RST: BOOL }
    Static {
        PV_FAC: REAL = real(1.0), PV_OFFS: REAL, DEADB_W: REAL, PFAC_SP: REAL = real(1.0), GAIN: REAL = real(2.0),
        TI: REAL = real(40.0), MTR_TM: REAL = real(30.0), PULSE_TM: REAL, BREAK_TM: REAL, PER_MODE: INT, PVPER_ON: BOOL,
        sStarted: BOOL, sSpOld: REAL, sInvAlt: REAL, sRest: REAL, sPulseTm: TIME, sBreakTm: TIME,
    }
});

pub(super) const ROWS: &[Row] = &[Row::new::<TcontS>(Origin::Pid, Fb, 59, "TCONT_S", tcont_s).note(THRESHOLDS)];

fn tcont_s(call: &mut Call<'_>) -> Done {
    if call.bool(TcontS::COM_RST) {
        use TcontS::{COM_RST, ER, PV, QLMNDN, QLMNUP, sBreakTm, sInvAlt, sPulseTm, sRest, sStarted};
        for p in [QLMNUP, QLMNDN, PV, ER, sInvAlt, sRest, sPulseTm, sBreakTm, sStarted, COM_RST] {
            call.set(p, 0);
        }
        return Ok(());
    }
    use TcontS::{PER_MODE, PV_FAC, PV_IN, PV_OFFS, PV_PER, PVPER_ON};
    let pv = process_value(call, [PVPER_ON, PV_PER, PER_MODE, PV_IN, PV_FAC, PV_OFFS]);
    let set_point = call.real(TcontS::SP_INT);
    let error = dead_band(set_point - pv, call.real(TcontS::DEADB_W));
    let gain = call.real(TcontS::GAIN);
    let signal = gain * error + call.real(TcontS::DISV);
    if !call.bool(TcontS::sStarted) {
        call.set_bool(TcontS::sStarted, true);
        call.set_real(TcontS::sSpOld, set_point);
    }
    let change = gain * (set_point - call.real(TcontS::sSpOld));
    let rest = proportional_step(call.real(TcontS::sRest), change, call.real(TcontS::PFAC_SP));
    let travel = Travel {
        cycle: ms(call, TcontS::CYCLE).max(1),
        motor: ms(call, TcontS::MTR_TM),
        integration: ms(call, TcontS::TI),
        pulse: ms(call, TcontS::PULSE_TM),
        pause: ms(call, TcontS::BREAK_TM),
    };
    let mut actuator = Actuator {
        direction: i8::from(call.bool(TcontS::QLMNUP)) - i8::from(call.bool(TcontS::QLMNDN)),
        at_stop: [call.bool(TcontS::LMNR_HS), call.bool(TcontS::LMNR_LS)],
        by_hand: call.bool(TcontS::LMNS_ON).then(|| {
            // The integral action is 0 by hand; the change to automatic has a bump.
            (i8::from(call.bool(TcontS::LMNUP)) - i8::from(call.bool(TcontS::LMNDN)), 0.0)
        }),
        rest,
        last: call.real(TcontS::sInvAlt),
        pulse_left: call.dint(TcontS::sPulseTm),
        break_left: call.dint(TcontS::sBreakTm),
    };
    actuator.step(signal, &travel);
    call.set_bool(TcontS::QLMNUP, actuator.direction > 0);
    call.set_bool(TcontS::QLMNDN, actuator.direction < 0);
    for (p, value) in [
        (TcontS::PV, pv),
        (TcontS::ER, error),
        (TcontS::sSpOld, set_point),
        (TcontS::sInvAlt, signal),
        (TcontS::sRest, actuator.rest),
    ] {
        call.set_real(p, value);
    }
    call.set_dint(TcontS::sPulseTm, actuator.pulse_left);
    call.set_dint(TcontS::sBreakTm, actuator.break_left);
    Ok(())
}

/// A REAL of seconds in milliseconds; what is not a number is 0.
fn ms(call: &mut Call<'_>, p: TcontS) -> i32 {
    (call.real(p) * 1000.0).round_ties_even() as i32
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    /// Automatic mode without integral action, CYCLE 1 s, GAIN 1, MTR_TM 30 s, pulse 3 s, break 2 s.
    fn fake(set_point: f32) -> Fake {
        let mut fake = Fake::new("PID:FB59").with("LMNS_ON", [0]);
        for (name, value) in
            [("CYCLE", 1.0f32), ("TI", 0.0), ("GAIN", 1.0), ("PULSE_TM", 3.0), ("BREAK_TM", 2.0), ("SP_INT", set_point)]
        {
            fake.set(name, &value.to_be_bytes());
        }
        fake
    }

    fn run(fake: &mut Fake, calls: usize) -> String {
        fake.signs(calls, "QLMNUP", "QLMNDN")
    }

    #[test]
    fn the_instance_is_laid_out_as_in_step_7() {
        let fake = Fake::new("PID:FB59");
        for (name, at) in [
            ("PV_PER", "12.0"),
            ("LMNDN", "18.4"),
            ("QLMNDN", "20.1"),
            ("ER", "26.0"),
            ("COM_RST", "30.0"),
            ("PV_FAC", "32.0"),
            ("PFAC_SP", "44.0"),
            ("MTR_TM", "56.0"),
            ("PVPER_ON", "70.0"),
        ] {
            assert_eq!(fake.at(name), at, "{name}");
        }
        assert_eq!((fake.real("MTR_TM"), fake.value("LMNS_ON")), (30.0, 1));
    }

    #[test]
    fn pulses_travel_as_far_as_the_error_says() {
        assert_eq!(run(&mut fake(20.0), 9), "++++++...");
        assert_eq!(run(&mut fake(-20.0), 9), "------...");
        assert_eq!(run(&mut fake(9.0), 6), "......");
        let mut fake = fake(20.0);
        assert_eq!(run(&mut fake, 4), "++++");
        fake.set("SP_INT", &(-20f32).to_be_bytes());
        assert_eq!(run(&mut fake, 4), "..--");
    }

    #[test]
    fn a_set_point_that_counts_for_nothing_moves_nothing() {
        let mut fake = fake(0.0).with("PFAC_SP", [0; 4]);
        assert_eq!(run(&mut fake, 1), ".");
        fake.set("SP_INT", &50f32.to_be_bytes());
        assert_eq!(run(&mut fake, 3), "...");
    }

    #[test]
    fn limit_stops_hand_and_restart() {
        let mut fake = fake(20.0).with("LMNR_HS", [1]);
        assert_eq!(run(&mut fake, 2), "..");
        fake.set("LMNS_ON", &[1]);
        fake.set("LMNDN", &[1]);
        assert_eq!(run(&mut fake, 2), "--");
        fake.set("COM_RST", &[1]);
        assert_eq!(run(&mut fake, 1), ".");
        assert_eq!(fake.value("COM_RST"), 0, "takes itself back");
        assert_eq!(run(&mut fake, 1), "-");
    }
}
