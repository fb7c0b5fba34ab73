//! FB 42 CONT_S: PI controller for an actuator that integrates, with pulses up and down.
//! ["Step Control with SFB 42/FB 42 CONT_S"]
//!
//! One integrator holds how far the actuator still has to go, in percent of its travel: the integral of the error
//! signal, less what the pulses have moved it (100 % in MTR_TM). A pulse begins when that and the proportional part
//! make up the travel of a shortest pulse, and ends when less than the travel of half a cycle is left; this choice of
//! thresholds is ours.

use ob1_model::BlockKind::Fb;

use super::{TRUE, dead_band, process_variable, real, seconds};
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::table::{Origin, Row};

params!(ContS {
    Input {
        COM_RST: BOOL, LMNR_HS: BOOL, LMNR_LS: BOOL, LMNS_ON: BOOL = TRUE, LMNUP: BOOL, LMNDN: BOOL, PVPER_ON: BOOL,
        CYCLE: TIME = seconds(1), SP_INT: REAL, PV_IN: REAL, PV_PER: WORD, GAIN: REAL = real(2.0),
        TI: TIME = seconds(20), DEADB_W: REAL = real(1.0), PV_FAC: REAL = real(1.0), PV_OFF: REAL,
        PULSE_TM: TIME = seconds(3), BREAK_TM: TIME = seconds(3), MTR_TM: TIME = seconds(30), DISV: REAL,
    }
    Output { QLMNUP: BOOL, QLMNDN: BOOL, PV: REAL, ER: REAL }
    Static { sInvAlt: REAL, sRest: REAL, sPulseTm: TIME, sBreakTm: TIME }
});

pub(super) const ROWS: &[Row] = &[Row::new::<ContS>(Origin::Pid, Fb, 42, "CONT_S", cont_s)
    .note("thresholds of the three-step element are ours: the travel of a shortest pulse, and of half a cycle")];

fn cont_s(call: &mut Call<'_>) -> Done {
    if call.bool(ContS::COM_RST) {
        use ContS::{ER, PV, QLMNDN, QLMNUP, sBreakTm, sInvAlt, sPulseTm, sRest};
        for p in [QLMNUP, QLMNDN, PV, ER, sInvAlt, sRest, sPulseTm, sBreakTm] {
            call.set(p, 0);
        }
        return Ok(());
    }
    let cycle = call.dint(ContS::CYCLE).max(1);
    let (analog, word) = (call.bool(ContS::PVPER_ON), call.word(ContS::PV_PER));
    let input = [call.real(ContS::PV_IN), call.real(ContS::PV_FAC), call.real(ContS::PV_OFF)];
    let pv = process_variable(analog, word, input);
    let error = dead_band(call.real(ContS::SP_INT) - pv, call.real(ContS::DEADB_W));
    let signal = call.real(ContS::GAIN) * error + call.real(ContS::DISV);
    let travel = 100.0 * cycle as f32 / call.dint(ContS::MTR_TM).max(cycle) as f32;

    let direction = i8::from(call.bool(ContS::QLMNUP)) - i8::from(call.bool(ContS::QLMNDN));
    let direction = if call.bool(ContS::LMNS_ON) {
        // By hand: nothing is left to do for the controller.
        call.set_real(ContS::sRest, -signal);
        call.set(ContS::sPulseTm, 0);
        call.set(ContS::sBreakTm, 0);
        i8::from(call.bool(ContS::LMNUP)) - i8::from(call.bool(ContS::LMNDN))
    } else {
        let ti = call.dint(ContS::TI);
        // TI 0 switches the integral part off.
        let step = if ti <= 0 { 0.0 } else { cycle as f32 / ti.max(cycle / 2) as f32 };
        let integral = step * (signal + call.real(ContS::sInvAlt)) / 2.0;
        // The last output has moved the actuator for a cycle, unless it stands at its end.
        let moved = f32::from(stopped(call, direction)) * travel;
        let rest = call.real(ContS::sRest) + integral - moved;
        call.set_real(ContS::sRest, rest);
        automatic(call, direction, rest + signal, travel, cycle)
    };
    let direction = stopped(call, direction);
    call.set_bool(ContS::QLMNUP, direction > 0);
    call.set_bool(ContS::QLMNDN, direction < 0);
    call.set_real(ContS::PV, pv);
    call.set_real(ContS::ER, error);
    call.set_real(ContS::sInvAlt, signal);
    Ok(())
}

/// No pulse against the limit stop that is reported.
fn stopped(call: &mut Call<'_>, direction: i8) -> i8 {
    let at_stop = direction > 0 && call.bool(ContS::LMNR_HS) || direction < 0 && call.bool(ContS::LMNR_LS);
    if at_stop { 0 } else { direction }
}

/// The pulse: at least PULSE_TM long, at least BREAK_TM after the last.
fn automatic(call: &mut Call<'_>, direction: i8, open: f32, travel: f32, cycle: i32) -> i8 {
    let pulse = call.dint(ContS::PULSE_TM).max(cycle);
    let wanted = if open > 0.0 { 1 } else { -1 };
    if direction != 0 {
        let left = call.dint(ContS::sPulseTm).saturating_sub(cycle);
        call.set_dint(ContS::sPulseTm, left.max(0));
        if left > 0 || wanted == direction && open.abs() >= travel / 2.0 {
            return direction;
        }
        let pause = call.dint(ContS::BREAK_TM).max(0);
        call.set_dint(ContS::sBreakTm, pause);
        if pause > 0 {
            return 0;
        }
    } else {
        let left = call.dint(ContS::sBreakTm).saturating_sub(cycle).max(0);
        call.set_dint(ContS::sBreakTm, left);
        if left > 0 {
            return 0;
        }
    }
    if open.abs() < travel * pulse as f32 / cycle as f32 {
        return 0;
    }
    call.set_dint(ContS::sPulseTm, pulse);
    wanted
}

#[cfg(test)]
mod tests {
    use crate::testing::Fake;

    /// A controller in automatic mode without integral part: MTR_TM 30 s, pulse 3 s, break 2 s.
    fn fake(set_point: f32) -> Fake {
        let fake = Fake::new("PID:FB42").with("LMNS_ON", [0]).with("TI", [0; 4]).with("DEADB_W", [0; 4]);
        fake.with("GAIN", 1f32.to_be_bytes())
            .with("BREAK_TM", 2000u32.to_be_bytes())
            .with("SP_INT", set_point.to_be_bytes())
    }

    fn run(fake: &mut Fake, calls: usize) -> String {
        fake.signs(calls, "QLMNUP", "QLMNDN")
    }

    #[test]
    fn the_instance_is_laid_out_as_in_step_7() {
        let fake = Fake::new("PID:FB42");
        for (name, at) in
            [("PVPER_ON", "0.6"), ("GAIN", "16.0"), ("MTR_TM", "44.0"), ("QLMNDN", "52.1"), ("ER", "58.0")]
        {
            assert_eq!(fake.at(name), at, "{name}");
        }
    }

    #[test]
    fn pulses_travel_as_far_as_the_error_says() {
        // 20 % of 30 s are 6 s.
        assert_eq!(run(&mut fake(20.0), 9), "++++++...");
        assert_eq!(run(&mut fake(-20.0), 9), "------...");
        // 10 % is the shortest pulse; less is none.
        assert_eq!(run(&mut fake(10.5), 6), "+++...");
        assert_eq!(run(&mut fake(9.0), 6), "......");
    }

    #[test]
    fn a_break_between_pulses() {
        let mut fake = fake(20.0);
        assert_eq!(run(&mut fake, 4), "++++");
        fake.set("SP_INT", &(-20f32).to_be_bytes());
        assert_eq!(run(&mut fake, 4), "..--");
    }

    #[test]
    fn limit_stops_and_hand() {
        let mut fake = fake(20.0).with("LMNR_HS", [1]);
        assert_eq!(run(&mut fake, 2), "..");
        fake.set("LMNS_ON", &[1]);
        fake.set("LMNDN", &[1]);
        assert_eq!(run(&mut fake, 2), "--");
        fake.set("LMNUP", &[1]);
        assert_eq!(run(&mut fake, 1), ".", "both at once");
        fake.set("COM_RST", &[1]);
        fake.set("LMNUP", &[0]);
        assert_eq!(run(&mut fake, 1), ".");
        assert_eq!(fake.real("ER"), 0.0);
    }

    #[test]
    fn the_integral_part_goes_on() {
        // An error of 5 with TI 10 s: 0.5 % a second on the 5 % of the proportional part; a pulse at 10 %.
        let mut fake = fake(5.0).with("TI", 10_000u32.to_be_bytes());
        let signs = run(&mut fake, 14);
        assert_eq!(signs.find('+'), Some(10), "{signs}");
    }
}
