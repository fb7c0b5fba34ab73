//! FB 43 PULSEGEN: a manipulated value as the length of a pulse. ["Pulse Generation with SFB 43/FB 43 PULSEGEN"]

use ob1_model::BlockKind::Fb;

use super::input::{TRUE, real, seconds};
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::{Origin, Row};

params!(PulseGen {
    Input {
        INV: REAL, PER_TM: TIME = seconds(1), P_B_TM: TIME = 50u32.to_be_bytes(), RATIOFAC: REAL = real(1.0),
        STEP3_ON: BOOL = TRUE, ST2BI_ON: BOOL, MAN_ON: BOOL, POS_P_ON: BOOL, NEG_P_ON: BOOL, SYN_ON: BOOL = TRUE,
        COM_RST: BOOL, CYCLE: TIME = 10u32.to_be_bytes(),
    }
    Output { QPOS_P: BOOL, QNEG_P: BOOL }
    Static { sInv: REAL, sElapsed: TIME, sPos: TIME, sNeg: TIME }
});

pub(super) const ROWS: &[Row] =
    &[Row::new::<PulseGen>(Origin::Pid, Fb, 43, "PULSEGEN", pulsegen), Row::sfb::<PulseGen>(43, "PULSEGEN", pulsegen)];

fn pulsegen(call: &mut Call<'_>) -> Done {
    let three_step = call.bool(PulseGen::STEP3_ON);
    if call.bool(PulseGen::COM_RST) {
        call.set_real(PulseGen::sInv, 0.0);
        for p in [PulseGen::sElapsed, PulseGen::sPos, PulseGen::sNeg] {
            call.set(p, 0);
        }
        return give(call, false, false);
    }
    if call.bool(PulseGen::MAN_ON) {
        let (pos, neg) = (call.bool(PulseGen::POS_P_ON), call.bool(PulseGen::NEG_P_ON));
        return if three_step { give(call, pos && !neg, neg && !pos) } else { give(call, pos, !pos) };
    }
    let (cycle, period) = (call.dint(PulseGen::CYCLE).max(1), call.dint(PulseGen::PER_TM).max(1));
    let input = call.real(PulseGen::INV);
    let mut elapsed = call.dint(PulseGen::sElapsed).max(0);
    // A new value begins a new period, but not in the first two nor in the last two calls of one.
    let changed = input != call.real(PulseGen::sInv);
    let two = cycle.saturating_mul(2);
    let inside = (two..period.saturating_sub(two)).contains(&elapsed);
    if elapsed >= period || changed && inside && call.bool(PulseGen::SYN_ON) {
        elapsed = 0;
    }
    if elapsed == 0 {
        let (pos, neg) = durations(call, input, period, three_step);
        call.set_dint(PulseGen::sPos, pos);
        call.set_dint(PulseGen::sNeg, neg);
        call.set_real(PulseGen::sInv, input);
    }
    let (pos, neg) = (elapsed < call.dint(PulseGen::sPos), elapsed < call.dint(PulseGen::sNeg));
    call.set_dint(PulseGen::sElapsed, elapsed.saturating_add(cycle));
    if three_step { give(call, pos, neg) } else { give(call, pos, !pos) }
}

fn give(call: &mut Call<'_>, pos: bool, neg: bool) -> Done {
    call.set_bool(PulseGen::QPOS_P, pos);
    call.set_bool(PulseGen::QNEG_P, neg);
    Ok(())
}

/// Milliseconds of the positive and the negative pulse of a period.
fn durations(call: &mut Call<'_>, input: f32, period: i32, three_step: bool) -> (i32, i32) {
    let shortest = call.dint(PulseGen::P_B_TM).max(0) as f32;
    let whole = period as f32;
    if !three_step {
        let part = if call.bool(PulseGen::ST2BI_ON) { (input + 100.0) / 200.0 } else { input / 100.0 };
        return (limited(part * whole, shortest, whole), 0);
    }
    // A factor below 1 shortens the negative pulses and their shortest length, one above 1 the positive ones.
    let ratio = call.real(PulseGen::RATIOFAC).clamp(0.1, 10.0);
    let factor = if input > 0.0 { 1.0 / ratio.max(1.0) } else { ratio.min(1.0) };
    let length = limited(input.abs() / 100.0 * whole * factor, shortest * factor, whole);
    if input > 0.0 { (length, 0) } else { (0, length) }
}

/// Pulses shorter than the shortest are left out, and so are breaks shorter than that.
fn limited(length: f32, shortest: f32, whole: f32) -> i32 {
    if length < shortest || length <= 0.0 {
        0
    } else if length > whole - shortest {
        whole as i32
    } else {
        length.round_ties_even() as i32
    }
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    /// Ten calls a period of 100 ms.
    fn fake(input: f32) -> Fake {
        let fake = Fake::new("PID:FB43").with("PER_TM", 100u32.to_be_bytes()).with("P_B_TM", 10u32.to_be_bytes());
        fake.with("INV", input.to_be_bytes())
    }

    fn run(fake: &mut Fake, calls: usize) -> String {
        fake.signs(calls, "QPOS_P", "QNEG_P")
    }

    #[test]
    fn the_instance_is_laid_out_as_in_step_7() {
        let fake = Fake::new("PID:FB43");
        for (name, at) in [("STEP3_ON", "16.0"), ("COM_RST", "16.6"), ("CYCLE", "18.0"), ("QNEG_P", "22.1")] {
            assert_eq!(fake.at(name), at, "{name}");
        }
    }

    #[test]
    fn three_steps() {
        for (input, signs) in [
            (30.0, "+++.......+++"),
            (-30.0, "---.......---"),
            (0.0, "............."),
            (9.0, "............."),
            (95.0, "+++++++++++++"),
            (-100.0, "-------------"),
        ] {
            assert_eq!(run(&mut fake(input), 13), signs, "{input}");
        }
    }

    #[test]
    fn ratios() {
        for (ratio, input, signs) in [
            (0.5f32, -60.0, "---......."),
            (0.5, 60.0, "++++++...."),
            (2.0, 60.0, "+++......."),
            (2.0, -60.0, "------...."),
        ] {
            let mut fake = fake(input).with("RATIOFAC", ratio.to_be_bytes());
            assert_eq!(run(&mut fake, 10), signs, "{ratio} {input}");
        }
    }

    #[test]
    fn two_steps() {
        for (bipolar, input, signs) in [
            (0, 30.0, "+++-------"),
            (0, -30.0, "----------"),
            (1, 0.0, "+++++-----"),
            (1, -100.0, "----------"),
            (1, 100.0, "++++++++++"),
        ] {
            let mut fake = fake(input).with("STEP3_ON", [0]).with("ST2BI_ON", [bipolar]);
            assert_eq!(run(&mut fake, 10), signs, "{bipolar} {input}");
        }
    }

    #[test]
    fn a_new_value_begins_a_new_period() {
        for (syn, signs) in [(1, "++++......"), (0, "......++++")] {
            let mut fake = fake(20.0).with("SYN_ON", [syn]);
            assert_eq!(run(&mut fake, 4), "++..");
            fake.set("INV", &40f32.to_be_bytes());
            assert_eq!(run(&mut fake, 10), signs, "{syn}");
        }
    }

    #[test]
    fn by_hand_and_restart() {
        for (three, pos, neg, sign) in
            [(1, 1, 0, "+"), (1, 0, 1, "-"), (1, 1, 1, "."), (1, 0, 0, "."), (0, 1, 0, "+"), (0, 0, 0, "-")]
        {
            let mut fake = fake(50.0).with("MAN_ON", [1]).with("STEP3_ON", [three]);
            fake = fake.with("POS_P_ON", [pos]).with("NEG_P_ON", [neg]);
            assert_eq!(run(&mut fake, 1), sign, "{three} {pos} {neg}");
        }
        let mut fake = fake(50.0);
        assert_eq!(run(&mut fake, 3), "+++");
        fake.set("COM_RST", &[1]);
        assert_eq!(run(&mut fake, 1), ".");
        fake.set("COM_RST", &[0]);
        assert_eq!(run(&mut fake, 10), "+++++.....");
    }
}
