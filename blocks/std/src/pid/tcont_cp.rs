//! FB 58 TCONT_CP: temperature controller with a continuous or pulsed output, which can find its own parameters.
//! ["PID Temperature Control"]
//!
//! One instance is called at one or at two places (SELECT): the pulses every CYCLE_P, the PID algorithm every CYCLE.

use ob1_model::BlockKind::Fb;

use super::input::dead_band;
use super::tcont_parameters::{TcontCp, parameters};
use super::temperature::{limited, process_value, proportional_step, sampled};
use super::tuning;
use crate::Done;
use crate::call::Call;
use crate::row::{Origin, Row};

pub(super) const ROWS: &[Row] = &[Row::new::<TcontCp>(Origin::Pid, Fb, 58, "TCONT_CP", tcont_cp).note(
    "tuning: the tangent at the point of inflection, parameters by Chien, Hrones and Reswick; both choices are ours",
)];

fn tcont_cp(call: &mut Call<'_>) -> Done {
    if call.bool(TcontCp::COM_RST) {
        restart(call);
        return Ok(());
    }
    parameters(call);
    use TcontCp::{PER_MODE, PV_FAC, PV_IN, PV_OFFS, PV_PER, PVPER_ON};
    let input = process_value(call, [PVPER_ON, PV_PER, PER_MODE, PV_IN, PV_FAC, PV_OFFS]);
    if !call.bool(TcontCp::PULSE_ON) {
        pid(call, input);
        call.set_bool(TcontCp::QPULSE, false);
        call.set_bool(TcontCp::QC_ACT, true);
        return Ok(());
    }
    // Pulse calls for each call of the PID algorithm.
    let calls = sampled(call.real(TcontCp::CYCLE), call.real(TcontCp::CYCLE_P));
    match call.int(TcontCp::SELECT) {
        0 => {
            let value = mean(call, input);
            if call.bool(TcontCp::QC_ACT) {
                pid(call, value);
                restart_mean(call);
            }
            pulse(call);
            count(call, calls);
        }
        1 if call.bool(TcontCp::QC_ACT) => {
            let value = collected(call, input);
            pid(call, value);
            restart_mean(call);
            call.set_bool(TcontCp::QC_ACT, false);
        }
        2 => {
            mean(call, input);
            pulse(call);
            count(call, calls);
        }
        3 => {
            let value = collected(call, input);
            pid(call, value);
            restart_mean(call);
        }
        // SELECT 1 with nothing to do, or no value of SELECT.
        _ => {}
    }
    Ok(())
}

/// COM_RST: the integral action begins at I_ITLVAL, every output is 0, and the bit resets itself.
fn restart(call: &mut Call<'_>) {
    use TcontCp::{
        COM_RST, ER, LMN, LMN_D, LMN_P, LMN_PER, PHASE, PV, QLMN_HLM, QLMN_LLM, QPULSE, QTUN_RUN, TUN_ON, TUN_ST,
        sCalls, sErOld, sLmnN, sOutside, sPeriod, sPulse, sPvNum, sPvSum, sRueck, sStarted,
    };
    for p in [
        LMN, LMN_PER, PV, QPULSE, QLMN_HLM, QLMN_LLM, ER, LMN_P, LMN_D, PHASE, QTUN_RUN, TUN_ON, TUN_ST, sStarted,
        sOutside, sErOld, sRueck, sPvSum, sPvNum, sCalls, sPeriod, sPulse, sLmnN, COM_RST,
    ] {
        call.set(p, 0);
    }
    call.set_bool(TcontCp::QC_ACT, true);
    let first = call.real(TcontCp::I_ITLVAL);
    call.set_real(TcontCp::LMN_I, first);
}

/// Adds a value of a pulse call, and gives the mean since the last PID algorithm.
fn mean(call: &mut Call<'_>, value: f32) -> f32 {
    let (sum, number) = (call.real(TcontCp::sPvSum) + value, call.int(TcontCp::sPvNum).saturating_add(1));
    call.set_real(TcontCp::sPvSum, sum);
    call.set_int(TcontCp::sPvNum, number);
    sum / f32::from(number)
}

/// The mean of the pulse calls, or the value given where there was none.
fn collected(call: &mut Call<'_>, value: f32) -> f32 {
    match call.int(TcontCp::sPvNum) {
        number if number > 0 => call.real(TcontCp::sPvSum) / f32::from(number),
        _ => value,
    }
}

fn restart_mean(call: &mut Call<'_>) {
    call.set_real(TcontCp::sPvSum, 0.0);
    call.set_int(TcontCp::sPvNum, 0);
}

/// Counts pulse calls: QC_ACT says that the next one is due for the PID algorithm.
fn count(call: &mut Call<'_>, calls: i16) {
    let done = call.int(TcontCp::sCalls).saturating_add(1);
    let due = done >= calls;
    call.set_int(TcontCp::sCalls, if due { 0 } else { done });
    if due || call.int(TcontCp::SELECT) == 0 {
        call.set_bool(TcontCp::QC_ACT, due);
    }
}

/// QPULSE: of each PER_TM the part that the manipulated value says.
fn pulse(call: &mut Call<'_>) {
    let cycle = call.real(TcontCp::CYCLE_P).max(0.001);
    let (whole, mut at) = (call.real(TcontCp::PER_TM).max(cycle), call.real(TcontCp::sPeriod));
    // Half a cycle of slack: sums of a REAL do not meet the period exactly.
    if at + cycle / 2.0 >= whole || !at.is_finite() {
        at = 0.0;
    }
    if at == 0.0 {
        let shortest = call.real(TcontCp::P_B_TM).max(cycle);
        let length = whole * call.real(TcontCp::sLmnN) / 100.0;
        let length = match length {
            length if length < shortest => 0.0,
            length if length > whole - shortest => whole,
            length => length,
        };
        call.set_real(TcontCp::sPulse, length);
    }
    let on = at + cycle / 2.0 < call.real(TcontCp::sPulse);
    call.set_bool(TcontCp::QPULSE, on);
    call.set_real(TcontCp::sPeriod, at + cycle);
}

/// One cycle of the PID algorithm.
fn pid(call: &mut Call<'_>, pv: f32) {
    let cycle = call.real(TcontCp::CYCLE).max(0.001);
    let set_point = call.real(TcontCp::SP_INT);
    let started = call.bool(TcontCp::sStarted);
    if !started {
        call.set_bool(TcontCp::sStarted, true);
        call.set_real(TcontCp::sSpOld, set_point);
        call.set_real(TcontCp::sPvOld, pv);
    }
    let error = dead_band(set_point - pv, call.real(TcontCp::DEADB_W));
    let gain = call.real(TcontCp::GAIN);
    let p = gain * error;
    let (high, low) = (call.real(TcontCp::LMN_HLM), call.real(TcontCp::LMN_LLM));
    let disturbance = call.real(TcontCp::DISV);
    call.set_real(TcontCp::PV, pv);
    call.set_real(TcontCp::ER, error);
    call.set_real(TcontCp::LMN_P, p);

    let tuned = tuning::step(call, pv, cycle);
    let by_hand = call.bool(TcontCp::MAN_ON) && tuned.is_none();
    let (wanted, mut integral, d);
    if let Some(wanted_by_hand) = tuned.or_else(|| by_hand.then(|| call.real(TcontCp::MAN))) {
        // The integral action follows, so that the change to automatic gives no bump.
        wanted = wanted_by_hand;
        d = 0.0;
        call.set_real(TcontCp::sRueck, p);
        integral = limited(wanted, [low, high]) - p - disturbance;
    } else {
        integral = integral_action(call, gain, error, cycle);
        d = derivative(call, p, cycle);
        let sum = p + integral + d + disturbance;
        wanted = match zone(call, set_point - pv, gain) {
            Some(true) => high,
            Some(false) => low,
            None => sum,
        };
    }
    if call.real(TcontCp::TI) == 0.0 && !call.bool(TcontCp::I_ITL_ON) {
        integral = 0.0;
    }
    let (over, under) = (wanted >= high, wanted <= low);
    let value = limited(wanted, [low, high]);
    call.set_real(TcontCp::sLmnN, value);
    let lmn = value * call.real(TcontCp::LMN_FAC) + call.real(TcontCp::LMN_OFFS);
    call.set_real(TcontCp::LMN, lmn);
    call.set_int(TcontCp::LMN_PER, (lmn * 276.48).round_ties_even() as i16);
    call.set_bool(TcontCp::QLMN_HLM, over);
    call.set_bool(TcontCp::QLMN_LLM, under);
    call.set_real(TcontCp::LMN_I, integral);
    call.set_real(TcontCp::LMN_D, d);
    call.set_real(TcontCp::sErOld, error);
    call.set_real(TcontCp::sSpOld, set_point);
    if !by_hand {
        call.set_real(TcontCp::MAN, value);
    }
}

/// The integral action: trapezoids over TI, held at a limit, at INT_HPOS and INT_HNEG and outside the control zone. A
/// change of the set point weakens the proportional action by PFAC_SP, which the integral action makes good.
fn integral_action(call: &mut Call<'_>, gain: f32, error: f32, cycle: f32) -> f32 {
    if call.bool(TcontCp::I_ITL_ON) {
        return call.real(TcontCp::I_ITLVAL);
    }
    let time = call.real(TcontCp::TI);
    if time <= 0.0 {
        return 0.0;
    }
    let change = call.real(TcontCp::SP_INT) - call.real(TcontCp::sSpOld);
    let old = proportional_step(call.real(TcontCp::LMN_I), gain * change, call.real(TcontCp::PFAC_SP));
    let step = gain * cycle / time.max(cycle / 2.0) * (error + call.real(TcontCp::sErOld)) / 2.0;
    let held = step > 0.0 && (call.bool(TcontCp::INT_HPOS) || call.bool(TcontCp::QLMN_HLM))
        || step < 0.0 && (call.bool(TcontCp::INT_HNEG) || call.bool(TcontCp::QLMN_LLM))
        || call.bool(TcontCp::sOutside);
    if held { old } else { old + step }
}

/// A differentiator with a lag of TD / D_F.
fn derivative(call: &mut Call<'_>, signal: f32, cycle: f32) -> f32 {
    let time = call.real(TcontCp::TD);
    if time <= 0.0 {
        call.set_real(TcontCp::sRueck, signal);
        return 0.0;
    }
    let lag = (time / call.real(TcontCp::D_F).clamp(1.0, 100.0)).max(cycle / 2.0);
    let feedback = call.real(TcontCp::sRueck);
    let d = time / (lag + cycle / 2.0) * (signal - feedback);
    call.set_real(TcontCp::sRueck, feedback + cycle / time * d);
    d
}

/// The control zone: beyond it the output is at a limit, the high one (`true`) where the error asks for more. Back
/// inside there is a hysteresis of 20 %.
fn zone(call: &mut Call<'_>, error: f32, gain: f32) -> Option<bool> {
    let width = call.real(TcontCp::CON_ZONE);
    let was_outside = call.bool(TcontCp::sOutside);
    let outside = call.bool(TcontCp::CONZ_ON) && error.abs() > if was_outside { 0.8 * width } else { width };
    call.set_bool(TcontCp::sOutside, outside);
    outside.then_some((error > 0.0) == (gain >= 0.0))
}

#[cfg(test)]
mod tests;
