//! How TCONT_CP finds its parameters: a step of the output, the tangent at the point of inflection of the answer, a
//! model of equal lags (PTn) through it, and parameters for that. ["Controller Tuning in FB 58 TCONT_CP"]
//!
//! Phases, status numbers and statics are the manual's. The rule of Chien, Hrones and Reswick for an answer without
//! overshoot takes the place of the manual's design, which is not public.

use super::tcont_parameters::{TcontCp, load, save, set_member};
use super::temperature::limited;
use crate::call::Call;

/// PHASE: no tuning is under way.
const OFF: i16 = 0;
/// PHASE: ready, waiting for the step.
const READY: i16 = 1;
/// PHASE: the step is out, the search for the point of inflection runs.
const SEARCH: i16 = 2;
/// PHASE: parameters are found; the output is held until TUN_KEEP releases it.
const FOLLOW: i16 = 5;

/// STATUS_H: the parameters found are good.
const GOOD: i16 = 10_000;
/// STATUS_H: the step would be less than 5 %.
const STEP_TOO_SMALL: i16 = 30_002;
/// The least step, in percent.
const LEAST_STEP: f32 = 5.0;

/// One cycle of the tuning; the manipulated value while it decides on that.
pub(super) fn step(call: &mut Call<'_>, pv: f32, cycle: f32) -> Option<f32> {
    let phase = call.int(TcontCp::PHASE);
    let slope = (pv - call.real(TcontCp::sPvOld)) / cycle;
    call.set_real(TcontCp::sPvOld, pv);
    let wanted = call.bool(TcontCp::TUN_ON);
    match phase {
        OFF if wanted => {
            begin(call, pv);
            None
        }
        OFF => None,
        FOLLOW if call.bool(TcontCp::TUN_KEEP) => Some(call.real(TcontCp::sLmnN)),
        FOLLOW => {
            call.set_int(TcontCp::PHASE, OFF);
            call.set_bool(TcontCp::MAN_ON, false);
            None
        }
        _ if !wanted => {
            call.set_int(TcontCp::STATUS_H, 0);
            end(call, OFF);
            None
        }
        READY => wait(call, pv, slope),
        SEARCH => Some(search(call, pv, slope, cycle)),
        _ => {
            end(call, OFF);
            None
        }
    }
}

fn begin(call: &mut Call<'_>, pv: f32) {
    call.set_int(TcontCp::PHASE, READY);
    call.set_int(TcontCp::STATUS_H, 0);
    for p in [TcontCp::sLmnSum, TcontCp::PVDT0, TcontCp::NOISE_PV] {
        call.set_real(p, 0.0);
    }
    call.set_dint(TcontCp::sTunNum, 0);
    call.set_real(TcontCp::sPvMin, pv);
    call.set_real(TcontCp::sPvMax, pv);
}

/// Back to no tuning, or on to the end of a good one.
fn end(call: &mut Call<'_>, phase: i16) {
    call.set_int(TcontCp::PHASE, phase);
    for p in [TcontCp::QTUN_RUN, TcontCp::TUN_ON, TcontCp::TUN_ST] {
        call.set_bool(p, false);
    }
}

/// Phase 1: output and process value at rest; the step comes with TUN_ST or with a change of the set point.
fn wait(call: &mut Call<'_>, pv: f32, slope: f32) -> Option<f32> {
    let number = call.dint(TcontCp::sTunNum).saturating_add(1);
    let sum = call.real(TcontCp::sLmnSum) + call.real(TcontCp::sLmnN);
    call.set_dint(TcontCp::sTunNum, number);
    call.set_real(TcontCp::sLmnSum, sum);
    let (least, most) = (call.real(TcontCp::sPvMin).min(pv), call.real(TcontCp::sPvMax).max(pv));
    call.set_real(TcontCp::sPvMin, least);
    call.set_real(TcontCp::sPvMax, most);
    call.set_real(TcontCp::NOISE_PV, most - least);
    let old = call.real(TcontCp::PVDT0);
    call.set_real(TcontCp::PVDT0, old + (slope - old) / number as f32);
    let by_set_point = call.real(TcontCp::SP_INT) != call.real(TcontCp::sSpOld);
    if !by_set_point && !call.bool(TcontCp::TUN_ST) {
        return None;
    }
    let before = sum / number as f32;
    let (high, low) = (call.real(TcontCp::LMN_HLM), call.real(TcontCp::LMN_LLM));
    let after = limited(before + call.real(TcontCp::TUN_DLMN), [low, high]);
    let step = (after - before).abs();
    if step.is_nan() || step < LEAST_STEP {
        call.set_int(TcontCp::STATUS_H, STEP_TOO_SMALL);
        end(call, OFF);
        return None;
    }
    call.set_int(TcontCp::PHASE, SEARCH);
    call.set_bool(TcontCp::QTUN_RUN, true);
    // With a step of the set point the search ends at 70 % of the way at the latest; 0 stands for no such step.
    let way = if by_set_point { call.real(TcontCp::SP_INT) - pv } else { 0.0 };
    for (p, value) in [
        (TcontCp::LMN0, before),
        (TcontCp::PV0, pv),
        (TcontCp::PVDT, 0.0),
        (TcontCp::PVDT_MAX, 0.0),
        (TcontCp::T_P_INF, 0.0),
        (TcontCp::P_INF, 0.0),
        (TcontCp::sTime, 0.0),
        (TcontCp::sSpStart, way),
        (TcontCp::sLmnN, after),
    ] {
        call.set_real(p, value);
    }
    call.set_int(TcontCp::POI_CYCL, 0);
    Some(after)
}

/// Phase 2: the steepest rise. It is found when POI_CMAX cycles after it were flatter.
fn search(call: &mut Call<'_>, pv: f32, slope: f32, cycle: f32) -> f32 {
    let output = call.real(TcontCp::sLmnN);
    let delta = output - call.real(TcontCp::LMN0);
    // The process value goes the way of the output, or against it with a controller that cools.
    let sign = if (delta > 0.0) == (call.real(TcontCp::GAIN) >= 0.0) { 1.0 } else { -1.0 };
    let time = call.real(TcontCp::sTime) + cycle;
    call.set_real(TcontCp::sTime, time);
    let smooth = f32::from(call.int(TcontCp::FIL_CYC).clamp(1, 1024));
    let old = call.real(TcontCp::PVDT);
    let rise = old + (sign * (slope - call.real(TcontCp::PVDT0)) - old) / smooth;
    call.set_real(TcontCp::PVDT, rise);
    let moved = sign * (pv - call.real(TcontCp::PV0) - call.real(TcontCp::PVDT0) * time);
    if rise > call.real(TcontCp::PVDT_MAX) {
        for (p, value) in [(TcontCp::PVDT_MAX, rise), (TcontCp::T_P_INF, time - cycle / 2.0)] {
            call.set_real(p, value);
        }
        // The rise is that of the middle of the cycle.
        call.set_real(TcontCp::P_INF, (moved - rise * cycle / 2.0).max(0.0));
        call.set_int(TcontCp::POI_CYCL, 0);
        let way = call.real(TcontCp::sSpStart).abs();
        if way > 0.0 && moved >= 0.7 * way {
            conclude(call, delta, sign, cycle, false);
        }
    } else if call.real(TcontCp::PVDT_MAX) > 0.0 {
        let cycles = call.int(TcontCp::POI_CYCL).saturating_add(1);
        call.set_int(TcontCp::POI_CYCL, cycles);
        if cycles >= call.int(TcontCp::POI_CMAX).max(1) {
            conclude(call, delta, sign, cycle, true);
        }
    }
    output
}

/// Phases 3 and 4: the model, the parameters, the status; then phase 5.
fn conclude(call: &mut Call<'_>, delta: f32, sign: f32, cycle: f32, inflected: bool) {
    save(call);
    let (rise, time, moved) = (call.real(TcontCp::PVDT_MAX), call.real(TcontCp::T_P_INF), call.real(TcontCp::P_INF));
    let model = Model::through(f64::from(rise), f64::from(time), f64::from(moved));
    let mut status = if inflected { 0 } else { 20 };
    let (mut lag, recovery) = (model.dead as f32, model.recovery as f32);
    if lag < 3.0 * cycle {
        status += 100;
        lag = 3.0 * cycle;
    } else if lag > recovery {
        status += 300;
    }
    status += match model.raw_order {
        order if order < 1.0 => 1000,
        order if order > 10.0 => 2000,
        _ => 0,
    };
    let gain = (model.end as f32 / delta.abs()).max(f32::MIN_POSITIVE);
    let order = model.order as f32;
    for (p, value) in [
        (TcontCp::N_PTN, order),
        (TcontCp::TU, lag),
        (TcontCp::TA, recovery),
        (TcontCp::TM_LAG_P, model.lag as f32),
        (TcontCp::KIG, 100.0 * rise / delta.abs()),
        (TcontCp::GAIN_P, gain),
        (TcontCp::NOI_PVDT, 100.0 * call.real(TcontCp::NOISE_PV) / (rise * recovery).max(f32::MIN_POSITIVE)),
        (TcontCp::PFAC_SP, 0.8),
        (TcontCp::D_F, 5.0),
    ] {
        call.set_real(p, value);
    }
    // A controller that cools has a negative gain: the sign of the answer is the sign of the gain it needs.
    let direction = if (delta > 0.0) == (sign > 0.0) { 1.0 } else { -1.0 };
    let base = direction * recovery / (gain * lag);
    for (p, at, value) in [
        (TcontCp::PI_CON, 0, 0.35 * base),
        (TcontCp::PI_CON, 4, 1.2 * recovery),
        (TcontCp::PID_CON, 0, 0.6 * base),
        (TcontCp::PID_CON, 4, recovery),
        (TcontCp::PID_CON, 8, 0.5 * lag),
    ] {
        set_member(call, p, at, value);
    }
    load(call);
    call.set_int(TcontCp::STATUS_H, if status == 0 { GOOD } else { 20_000 + status });
    call.set_int(
        TcontCp::STATUS_D,
        match order {
            order if order <= 1.5 => 110,
            order if order <= 1.9 => 121,
            order if order < 2.1 => 200,
            order if order <= 2.6 => 310,
            _ => 320,
        },
    );
    end(call, FOLLOW);
}

/// A chain of equal lags whose step response has its point of inflection where the process had it.
struct Model {
    /// The order before it was limited; infinite or below 1 where no chain fits.
    raw_order: f64,
    /// From 1.01 to 10.
    order: f64,
    /// Time constant of one lag.
    lag: f64,
    /// TU: where the tangent meets the start.
    dead: f64,
    /// TA: from there to where it meets the end.
    recovery: f64,
    /// How far the process value goes in the end.
    end: f64,
}

impl Model {
    const ORDERS: [f64; 2] = [1.01, 10.0];

    /// Through a point of inflection `time` after the step, `moved` beyond the start, with this rise.
    fn through(rise: f64, time: f64, moved: f64) -> Self {
        let time = time.max(f64::MIN_POSITIVE);
        let part = moved / (rise * time).max(f64::MIN_POSITIVE);
        let [mut low, mut high] = Self::ORDERS;
        let raw_order = if part > Self::part(low) {
            if part > 1.0 { 0.0 } else { low }
        } else if part < Self::part(high) {
            f64::INFINITY
        } else {
            // The part falls with the order.
            for _ in 0..60 {
                let middle = (low + high) / 2.0;
                if Self::part(middle) > part { low = middle } else { high = middle }
            }
            low
        };
        let order = raw_order.clamp(Self::ORDERS[0], Self::ORDERS[1]);
        let x = order - 1.0;
        let lag = time / x;
        // The highest rise of a chain that ends at 1 is x^(n-1) e^-x / Gamma(n), in parts of 1 / lag.
        let recovery = lag * (ln_gamma(order) + x - x * x.ln()).exp();
        Self { raw_order, order, lag, dead: (time - moved / rise).max(0.0), recovery, end: rise * recovery }
    }

    /// Value at the point of inflection in parts of rise times time: the sum of x^k / (n (n+1) ... (n+k)), x = n - 1.
    fn part(order: f64) -> f64 {
        let mut term = 1.0 / order;
        let mut sum = term;
        for k in 1..200 {
            term *= (order - 1.0) / (order + f64::from(k));
            sum += term;
        }
        sum
    }
}

/// Logarithm of the gamma function above 0: Stirling's series above 8, shifted there by the recursion.
fn ln_gamma(z: f64) -> f64 {
    let (mut z, mut shift) = (z, 0.0);
    while z < 8.0 {
        shift += z.ln();
        z += 1.0;
    }
    let series = 1.0 / (12.0 * z) - 1.0 / (360.0 * z.powi(3)) + 1.0 / (1260.0 * z.powi(5));
    (z - 0.5) * z.ln() - z + 0.5 * std::f64::consts::TAU.ln() + series - shift
}

#[cfg(test)]
mod tests {
    use super::{Model, ln_gamma};

    #[test]
    fn gamma() {
        for (z, value) in [(1.0, 1.0f64), (2.0, 1.0), (5.0, 24.0), (10.0, 362_880.0), (1.5, 0.886_226_925)] {
            assert!((ln_gamma(z) - value.ln()).abs() < 1e-8, "{z}");
        }
    }

    /// The chain of order n with lag 10 s and end 80: its point of inflection leads back to it.
    #[test]
    fn a_chain_is_found_again() {
        for (order, at_inflection, rise) in [
            // 1 - 2/e and 1/e; 1 - 5/e^2 and 2/e^2; 1 - 13/e^3 and 9/(2 e^3).
            (2.0f64, 0.264_241_118, 0.367_879_441),
            (3.0, 0.323_323_584, 0.270_670_566),
            (4.0, 0.352_768_111, 0.224_041_808),
        ] {
            let model = Model::through(80.0 * rise / 10.0, (order - 1.0) * 10.0, 80.0 * at_inflection);
            assert!((model.order - order).abs() < 1e-3, "{}", model.order);
            assert!((model.lag - 10.0).abs() < 0.01 && (model.end - 80.0).abs() < 0.1, "{} {}", model.lag, model.end);
            assert!((model.recovery - 10.0 / rise).abs() < 0.05);
        }
        assert_eq!(Model::through(1.0, 1.0, 1.5).raw_order, 0.0);
        assert!(Model::through(1.0, 1.0, 0.1).raw_order.is_infinite());
    }
}
