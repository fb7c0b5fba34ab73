//! FB 41 CONT_C: PID controller with a continuous output. ["Continuous Control with SFB 41/FB 41 CONT_C"]

use ob1_model::BlockKind::Fb;

use super::input::{TRUE, dead_band, process_variable, real, seconds};
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::{Origin, Row};

params!(ContC {
    Input {
        COM_RST: BOOL, MAN_ON: BOOL = TRUE, PVPER_ON: BOOL, P_SEL: BOOL = TRUE, I_SEL: BOOL = TRUE, INT_HOLD: BOOL,
        I_ITL_ON: BOOL, D_SEL: BOOL, CYCLE: TIME = seconds(1), SP_INT: REAL, PV_IN: REAL, PV_PER: WORD, MAN: REAL,
        GAIN: REAL = real(2.0), TI: TIME = seconds(20), TD: TIME = seconds(10), TM_LAG: TIME = seconds(2),
        DEADB_W: REAL, LMN_HLM: REAL = real(100.0), LMN_LLM: REAL, PV_FAC: REAL = real(1.0), PV_OFF: REAL,
        LMN_FAC: REAL = real(1.0), LMN_OFF: REAL, I_ITLVAL: REAL, DISV: REAL,
    }
    Output {
        LMN: REAL, LMN_PER: WORD, QLMN_HLM: BOOL, QLMN_LLM: BOOL, LMN_P: REAL, LMN_I: REAL, LMN_D: REAL, PV: REAL,
        ER: REAL,
    }
    Static {
        sInvAlt: REAL, sIanteilAlt: REAL, sRestInt: REAL, sRestDif: REAL, sRueck: REAL, sLmn: REAL, sbArwHLmOn: BOOL,
        sbArwLLmOn: BOOL, sbILimOn: BOOL,
    }
});

pub(super) const ROWS: &[Row] =
    &[Row::new::<ContC>(Origin::Pid, Fb, 41, "CONT_C", cont_c), Row::sfb::<ContC>(41, "CONT_C", cont_c)];

/// The limits of LMN_PER: the ends of an analog module's overrange.
const PER_HIGH: f32 = 32511.0;
const PER_LOW: f32 = -32512.0;

fn cont_c(call: &mut Call<'_>) -> Done {
    if call.bool(ContC::COM_RST) {
        return restart(call);
    }
    let cycle = ms(call, ContC::CYCLE).max(1.0);
    let (analog, word) = (call.bool(ContC::PVPER_ON), call.word(ContC::PV_PER));
    let input = [call.real(ContC::PV_IN), call.real(ContC::PV_FAC), call.real(ContC::PV_OFF)];
    let pv = process_variable(analog, word, input);
    let error = dead_band(call.real(ContC::SP_INT) - pv, call.real(ContC::DEADB_W));
    let signal = call.real(ContC::GAIN) * error;
    let manual = call.bool(ContC::MAN_ON);
    let disturbance = call.real(ContC::DISV);

    let p = if call.bool(ContC::P_SEL) { signal } else { 0.0 };
    let d = differential(call, signal, cycle, manual);
    let mut i = integral(call, signal, cycle, manual);
    let wanted = if manual { call.real(ContC::MAN) } else { p + i + d + disturbance };
    let (high, low) = (call.real(ContC::LMN_HLM), call.real(ContC::LMN_LLM));
    let (over, under) = (wanted >= high, wanted <= low);
    let value = if over {
        high
    } else if under {
        low
    } else {
        wanted
    };
    if manual && call.bool(ContC::I_SEL) && !call.bool(ContC::I_ITL_ON) {
        // The integrator follows what the call before has put out, so that switching to automatic gives no bump.
        i = call.real(ContC::sLmn) - p - disturbance;
    }
    let out = value * call.real(ContC::LMN_FAC) + call.real(ContC::LMN_OFF);
    call.set_real(ContC::LMN, out);
    let per = (out * 276.48).clamp(PER_LOW, PER_HIGH).round_ties_even();
    call.set(ContC::LMN_PER, u32::from(per as i16 as u16));
    call.set_bool(ContC::QLMN_HLM, over);
    call.set_bool(ContC::QLMN_LLM, under);
    for (p, value) in [
        (ContC::LMN_P, p),
        (ContC::LMN_I, i),
        (ContC::LMN_D, d),
        (ContC::PV, pv),
        (ContC::ER, error),
        (ContC::sInvAlt, signal),
        (ContC::sIanteilAlt, i),
        (ContC::sLmn, value),
    ] {
        call.set_real(p, value);
    }
    call.set_bool(ContC::sbArwHLmOn, over);
    call.set_bool(ContC::sbArwLLmOn, under);
    Ok(())
}

/// A TIME in milliseconds.
fn ms(call: &mut Call<'_>, p: ContC) -> f32 {
    call.dint(p).max(0) as f32
}

/// The integrator begins at I_ITLVAL; every output is 0.
fn restart(call: &mut Call<'_>) -> Done {
    use ContC::{
        ER, LMN, LMN_D, LMN_I, LMN_P, LMN_PER, PV, QLMN_HLM, QLMN_LLM, sInvAlt, sLmn, sRestDif, sRestInt, sRueck,
    };
    for p in [LMN, LMN_PER, QLMN_HLM, QLMN_LLM, LMN_P, LMN_I, LMN_D, PV, ER, sInvAlt, sRestInt, sRestDif, sRueck, sLmn]
    {
        call.set(p, 0);
    }
    for p in [ContC::sbArwHLmOn, ContC::sbArwLLmOn, ContC::sbILimOn] {
        call.set_bool(p, false);
    }
    let first = call.real(ContC::I_ITLVAL);
    call.set_real(ContC::sIanteilAlt, first);
    Ok(())
}

/// Trapezoids of the signal over TI. It stands still while the output is at a limit the signal pushes it against.
fn integral(call: &mut Call<'_>, signal: f32, cycle: f32, manual: bool) -> f32 {
    if !call.bool(ContC::I_SEL) {
        return 0.0;
    }
    if call.bool(ContC::I_ITL_ON) {
        call.set_real(ContC::sRestInt, 0.0);
        return call.real(ContC::I_ITLVAL);
    }
    let old = call.real(ContC::sIanteilAlt);
    let time = ms(call, ContC::TI).max(cycle / 2.0);
    let step = cycle / time * (signal + call.real(ContC::sInvAlt)) / 2.0;
    let against = step > 0.0 && call.bool(ContC::sbArwHLmOn) || step < 0.0 && call.bool(ContC::sbArwLLmOn);
    if manual || against || call.bool(ContC::INT_HOLD) {
        return old;
    }
    // What a REAL is too coarse to add is kept for the next time.
    let step = step + call.real(ContC::sRestInt);
    let new = old + step;
    call.set_real(ContC::sRestInt, step - (new - old));
    new
}

/// A differentiator with a lag of the first order.
fn differential(call: &mut Call<'_>, signal: f32, cycle: f32, manual: bool) -> f32 {
    let time = ms(call, ContC::TD);
    if manual || !call.bool(ContC::D_SEL) {
        call.set_real(ContC::sRueck, signal);
        call.set_real(ContC::sRestDif, 0.0);
        return 0.0;
    }
    let (time, lag) = (time.max(cycle), ms(call, ContC::TM_LAG).max(cycle / 2.0));
    let feedback = call.real(ContC::sRueck);
    let d = time / (lag + cycle / 2.0) * (signal - feedback);
    let step = cycle / time * d + call.real(ContC::sRestDif);
    let new = feedback + step;
    call.set_real(ContC::sRueck, new);
    call.set_real(ContC::sRestDif, step - (new - feedback));
    d
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    fn fake() -> Fake {
        Fake::new("PID:FB41").with("MAN_ON", [0]).with("SP_INT", 10f32.to_be_bytes())
    }

    #[test]
    fn the_instance_is_laid_out_as_in_step_7() {
        let fake = Fake::new("PID:FB41");
        for (name, at) in [
            ("D_SEL", "0.7"),
            ("CYCLE", "2.0"),
            ("PV_PER", "14.0"),
            ("LMN", "72.0"),
            ("QLMN_LLM", "78.1"),
            ("sLmn", "120.0"),
        ] {
            assert_eq!(fake.at(name), at, "{name}");
        }
        assert_eq!((fake.value("MAN_ON"), fake.real("GAIN"), fake.dint("TI")), (1, 2.0, 20_000));
    }

    #[test]
    fn proportional_and_integral() {
        // GAIN 2, TI 20 s, CYCLE 1 s: the signal is 20, and the integrator gains 1 a second (half of it in the first).
        let mut fake = fake();
        for (i, lmn) in [(0.5f32, 20.5f32), (1.5, 21.5), (2.5, 22.5)] {
            fake.run();
            let result = (fake.real("LMN_P"), fake.real("LMN_I"), fake.real("LMN"), fake.real("ER"));
            assert_eq!(result, (20.0, i, lmn, 10.0));
        }
        assert_eq!(fake.value("LMN_PER"), 6221);
        let mut fake = fake.with("INT_HOLD", [1]);
        fake.run();
        assert_eq!(fake.real("LMN_I"), 2.5);
        let mut fake =
            fake.with("I_ITL_ON", [1]).with("I_ITLVAL", 40f32.to_be_bytes()).with("DISV", 5f32.to_be_bytes());
        fake.run();
        assert_eq!((fake.real("LMN_I"), fake.real("LMN")), (40.0, 65.0));
    }

    #[test]
    fn limits_stop_the_integrator() {
        let mut fake = fake().with("LMN_HLM", 21f32.to_be_bytes());
        for (i, lmn, high) in [(0.5f32, 20.5f32, 0), (1.5, 21.0, 1), (1.5, 21.0, 1)] {
            fake.run();
            assert_eq!((fake.real("LMN_I"), fake.real("LMN"), fake.value("QLMN_HLM")), (i, lmn, high));
        }
        // The other way it moves at once; the low limit is 0.
        let mut fake = fake.with("SP_INT", (-50f32).to_be_bytes());
        fake.run();
        assert_eq!((fake.real("LMN"), fake.value("QLMN_HLM"), fake.value("QLMN_LLM")), (0.0, 0, 1));
    }

    #[test]
    fn manual_to_automatic_without_a_bump() {
        let mut fake = fake().with("MAN_ON", [1]).with("MAN", 50f32.to_be_bytes());
        for i in [-20.0, 30.0] {
            fake.run();
            assert_eq!((fake.real("LMN"), fake.real("LMN_I")), (50.0, i), "the integrator is a call behind");
        }
        let mut fake = fake.with("MAN_ON", [0]);
        fake.run();
        assert_eq!(fake.real("LMN"), 51.0, "one second of integration on");
        let mut fake = fake.with("MAN_ON", [1]).with("MAN", 120f32.to_be_bytes());
        fake.run();
        assert_eq!((fake.real("LMN"), fake.value("QLMN_HLM")), (100.0, 1), "limited in manual mode too");
    }

    #[test]
    fn the_differential_part_fades() {
        // TD 10 s, TM_LAG 2 s: 10 / 2.5 * 20 in the first second, then 0.6 times as much each second.
        let mut fake = fake().with("D_SEL", [1]).with("I_SEL", [0]).with("LMN_HLM", 1000f32.to_be_bytes());
        for d in [80f32, 48.0, 28.8] {
            fake.run();
            assert!((fake.real("LMN_D") - d).abs() < 0.001, "{} {d}", fake.real("LMN_D"));
            assert_eq!(fake.real("LMN_I"), 0.0);
        }
    }

    #[test]
    fn a_derivative_time_below_the_cycle_counts_as_the_cycle() {
        for td in [0i32, 999, 1000] {
            let mut fake =
                fake().with("D_SEL", [1]).with("TD", td.to_be_bytes()).with("LMN_HLM", 1000f32.to_be_bytes());
            fake.run();
            assert_eq!(fake.real("LMN_D"), 8.0, "1 / 2.5 * 20");
        }
    }

    #[test]
    fn lmn_per_ends_with_the_overrange() {
        for (man, per) in [(200f32, 32_511), (-200.0, -32_512i16 as u16)] {
            let mut fake = fake().with("MAN_ON", [1]).with("MAN", man.to_be_bytes());
            fake = fake.with("LMN_HLM", 200f32.to_be_bytes()).with("LMN_LLM", (-200f32).to_be_bytes());
            fake.run();
            assert_eq!(fake.value("LMN_PER"), u32::from(per), "{man}");
        }
    }

    #[test]
    fn a_restart_clears() {
        let mut fake = fake().with("I_ITLVAL", 7f32.to_be_bytes());
        fake.run();
        let mut fake = fake.with("COM_RST", [1]);
        fake.run();
        assert_eq!(
            (fake.real("LMN"), fake.real("PV"), fake.real("ER"), fake.real("sIanteilAlt")),
            (0.0, 0.0, 0.0, 7.0)
        );
        let mut fake = fake.with("COM_RST", [0]);
        fake.run();
        assert_eq!(fake.real("LMN_I"), 7.5);
    }
}
