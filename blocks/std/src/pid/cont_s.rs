//! FB 42 CONT_S: PI controller for an actuator that integrates, with pulses up and down.
//! ["Step Control with SFB 42/FB 42 CONT_S"]

use ob1_model::BlockKind::Fb;

use super::actuator::{Actuator, THRESHOLDS, Travel};
use super::input::{TRUE, dead_band, process_variable, real, seconds};
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::{Origin, Row};

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

pub(super) const ROWS: &[Row] = &[
    Row::new::<ContS>(Origin::Pid, Fb, 42, "CONT_S", cont_s).note(THRESHOLDS),
    Row::sfb::<ContS>(42, "CONT_S", cont_s).note(THRESHOLDS),
];

fn cont_s(call: &mut Call<'_>) -> Done {
    if call.bool(ContS::COM_RST) {
        use ContS::{ER, PV, QLMNDN, QLMNUP, sBreakTm, sInvAlt, sPulseTm, sRest};
        for p in [QLMNUP, QLMNDN, PV, ER, sInvAlt, sRest, sPulseTm, sBreakTm] {
            call.set(p, 0);
        }
        return Ok(());
    }
    let (analog, word) = (call.bool(ContS::PVPER_ON), call.word(ContS::PV_PER));
    let input = [call.real(ContS::PV_IN), call.real(ContS::PV_FAC), call.real(ContS::PV_OFF)];
    let pv = process_variable(analog, word, input);
    let error = dead_band(call.real(ContS::SP_INT) - pv, call.real(ContS::DEADB_W));
    let signal = call.real(ContS::GAIN) * error + call.real(ContS::DISV);
    let travel = Travel {
        cycle: call.dint(ContS::CYCLE).max(1),
        motor: call.dint(ContS::MTR_TM),
        integration: call.dint(ContS::TI),
        pulse: call.dint(ContS::PULSE_TM),
        pause: call.dint(ContS::BREAK_TM),
    };
    let mut actuator = Actuator {
        direction: i8::from(call.bool(ContS::QLMNUP)) - i8::from(call.bool(ContS::QLMNDN)),
        at_stop: [call.bool(ContS::LMNR_HS), call.bool(ContS::LMNR_LS)],
        by_hand: call.bool(ContS::LMNS_ON).then(|| {
            // By hand nothing is left to do for the controller.
            (i8::from(call.bool(ContS::LMNUP)) - i8::from(call.bool(ContS::LMNDN)), -signal)
        }),
        rest: call.real(ContS::sRest),
        last: call.real(ContS::sInvAlt),
        pulse_left: call.dint(ContS::sPulseTm),
        break_left: call.dint(ContS::sBreakTm),
    };
    actuator.step(signal, &travel);
    call.set_bool(ContS::QLMNUP, actuator.direction > 0);
    call.set_bool(ContS::QLMNDN, actuator.direction < 0);
    for (p, value) in [(ContS::PV, pv), (ContS::ER, error), (ContS::sInvAlt, signal), (ContS::sRest, actuator.rest)] {
        call.set_real(p, value);
    }
    call.set_dint(ContS::sPulseTm, actuator.pulse_left);
    call.set_dint(ContS::sBreakTm, actuator.break_left);
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

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
        // 10 % is the shortest pulse; less gives none.
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
