//! FB 81 DCAT, FB 82 MCAT: is a valve or a motor where it was sent, in time? ["Timer Functions"]

use ob1_model::BlockKind::Fb;

use crate::Done;
use crate::call::Call;
use crate::declare::{Params, params};
use crate::row::{Origin, Row};
use crate::ticks::time_tick;

params!(Dcat {
    Input { CMD: BOOL, O_FB: BOOL, C_FB: BOOL }
    Output { Q: BOOL, OA: BOOL, CA: BOOL }
    Static { ET: DINT, PT: DINT, PREV_TIME: DWORD, CMD_HIS: BOOL }
});
params!(Mcat {
    Input { O_CMD: BOOL, C_CMD: BOOL, S_CMD: BOOL, O_FB: BOOL, C_FB: BOOL }
    Output { OO: BOOL, CO: BOOL, OA: BOOL, CA: BOOL, Q: BOOL }
    Static { ET: DINT, PT: DINT, PREV_TIME: DWORD, O_HIS: BOOL, C_HIS: BOOL }
});

pub(super) const ROWS: &[Row] =
    &[Row::new::<Dcat>(Origin::TiS7, Fb, 81, "DCAT", dcat), Row::new::<Mcat>(Origin::TiS7, Fb, 82, "MCAT", mcat)];

/// Milliseconds since the last call.
fn passed(call: &mut Call<'_>, previous: impl Params) -> i32 {
    let now = time_tick(call.cx.now());
    let passed = now.wrapping_sub(call.raw(previous)) & 0x7FFF_FFFF;
    call.set(previous, now);
    passed as i32
}

fn dcat(call: &mut Call<'_>) -> Done {
    let passed = passed(call, Dcat::PREV_TIME);
    let (command, history) = (call.bool(Dcat::CMD), call.bool(Dcat::CMD_HIS));
    let (opened, closed) = (call.bool(Dcat::O_FB), call.bool(Dcat::C_FB));
    let preset = call.dint(Dcat::PT);
    let (mut alarm, mut elapsed) = (false, call.dint(Dcat::ET));
    if command != history {
        elapsed = 0;
    } else {
        // There, and not at the other end: the time is at its end, so that leaving is reported at once.
        let (there, away) = if command { (opened, closed) } else { (closed, opened) };
        if there && !away {
            elapsed = preset;
        } else if !there {
            elapsed = elapsed.saturating_add(passed);
            alarm = elapsed > preset;
        }
    }
    let both = opened && closed;
    call.set_bool(Dcat::Q, command);
    call.set_bool(Dcat::OA, both || alarm && command);
    call.set_bool(Dcat::CA, both || alarm && !command);
    call.set_dint(Dcat::ET, elapsed);
    call.set_bool(Dcat::CMD_HIS, command);
    call.br(true)
}

/// What MCAT gives: OO, CO, OA, CA, the elapsed time, O_HIS, C_HIS, Q.
struct Answer {
    outputs: [bool; 4],
    elapsed: i32,
    histories: [bool; 2],
    good: bool,
}

/// The manual's table, its rows from above; the first that fits counts.
fn answer(
    [o_his, c_his]: [bool; 2],
    [open, close, stop]: [bool; 3],
    [opened, closed]: [bool; 2],
    (elapsed, preset, passed): (i32, i32, i32),
) -> Answer {
    let quiet = |elapsed, good| Answer { outputs: [false; 4], elapsed, histories: [false; 2], good };
    let late = elapsed >= preset;
    if o_his && c_his {
        return quiet(preset, true);
    }
    if opened && closed {
        return Answer { outputs: [false, false, true, true], ..quiet(preset, false) };
    }
    if stop || open && close {
        return quiet(elapsed, true);
    }
    if open && !o_his {
        return Answer { outputs: [true, false, false, false], elapsed: 0, histories: [true, false], good: true };
    }
    if close && !c_his {
        return Answer { outputs: [false, true, false, false], elapsed: 0, histories: [false, true], good: true };
    }
    if !o_his && !c_his {
        return quiet(elapsed, true);
    }
    // Under way: opening with O_HIS, closing with C_HIS.
    let (there, histories) = if o_his { (opened, [true, false]) } else { (closed, [false, true]) };
    if there {
        return Answer { histories, ..quiet(preset, true) };
    }
    if late {
        return Answer { outputs: [false, false, o_his, c_his], elapsed: preset, histories, good: false };
    }
    Answer { outputs: [o_his, c_his, false, false], elapsed: elapsed.saturating_add(passed), histories, good: true }
}

fn mcat(call: &mut Call<'_>) -> Done {
    let passed = passed(call, Mcat::PREV_TIME);
    let answer = answer(
        [call.bool(Mcat::O_HIS), call.bool(Mcat::C_HIS)],
        [call.bool(Mcat::O_CMD), call.bool(Mcat::C_CMD), call.bool(Mcat::S_CMD)],
        [call.bool(Mcat::O_FB), call.bool(Mcat::C_FB)],
        (call.dint(Mcat::ET), call.dint(Mcat::PT), passed),
    );
    let [oo, co, oa, ca] = answer.outputs;
    let [o_his, c_his] = answer.histories;
    for (p, value) in [
        (Mcat::OO, oo),
        (Mcat::CO, co),
        (Mcat::OA, oa),
        (Mcat::CA, ca),
        (Mcat::Q, answer.good),
        (Mcat::O_HIS, o_his),
        (Mcat::C_HIS, c_his),
    ] {
        call.set_bool(p, value);
    }
    call.set_dint(Mcat::ET, answer.elapsed);
    call.br(true)
}

#[cfg(test)]
mod tests {
    use ob1_time::Span;

    use crate::tests::Fake;

    /// One call after so many milliseconds.
    fn after(fake: &mut Fake, ms: u64, inputs: &[(&str, u8)]) {
        fake.now += Span::from_millis(ms);
        for (name, value) in inputs {
            fake.set(name, &[*value]);
        }
        fake.run();
    }

    #[test]
    fn a_valve_that_comes_late() {
        let mut fake = Fake::new("TI-S7:DCAT").with("PT", 100u32.to_be_bytes());
        assert_eq!((fake.at("ET"), fake.at("CMD_HIS")), ("4.0".into(), "16.0".into()));
        let outputs = |fake: &Fake| (fake.value("Q"), fake.value("OA"), fake.value("CA"), fake.dint("ET"));
        after(&mut fake, 10, &[("C_FB", 1)]);
        assert_eq!(outputs(&fake), (0, 0, 0, 100), "closed, as it should be");
        after(&mut fake, 10, &[("CMD", 1)]);
        assert_eq!(outputs(&fake), (1, 0, 0, 0));
        after(&mut fake, 60, &[("C_FB", 0)]);
        assert_eq!(outputs(&fake), (1, 0, 0, 60));
        after(&mut fake, 60, &[]);
        assert_eq!(outputs(&fake), (1, 1, 0, 120), "too late");
        after(&mut fake, 10, &[("O_FB", 1)]);
        assert_eq!(outputs(&fake), (1, 0, 0, 100), "there");
        after(&mut fake, 10, &[("O_FB", 0)]);
        assert_eq!(outputs(&fake), (1, 1, 0, 110), "left without a command: told at once");
        after(&mut fake, 10, &[("O_FB", 1), ("C_FB", 1)]);
        assert_eq!((fake.value("OA"), fake.value("CA")), (1, 1), "at both ends");
    }

    #[test]
    fn a_motor_valve_by_the_table_of_the_manual() {
        let mut fake = Fake::new("TI-S7:MCAT").with("PT", 100u32.to_be_bytes());
        assert_eq!((fake.at("ET"), fake.at("O_HIS")), ("4.0".into(), "16.0".into()));
        let outputs = |fake: &Fake| ["OO", "CO", "OA", "CA", "Q"].map(|name| fake.value(name));
        for (inputs, ms, expected, what) in [
            (vec![("O_CMD", 1)], 10, [1, 0, 0, 0, 1], "start opening"),
            (vec![("O_CMD", 0)], 60, [1, 0, 0, 0, 1], "opening"),
            (vec![("O_FB", 1)], 10, [0, 0, 0, 0, 1], "opened"),
            (vec![("O_FB", 0)], 10, [0, 0, 1, 0, 0], "left: late at once"),
            (vec![("S_CMD", 1)], 10, [0, 0, 0, 0, 1], "stop"),
            (vec![("S_CMD", 0)], 10, [0, 0, 0, 0, 1], "stopped"),
            (vec![("C_CMD", 1)], 10, [0, 1, 0, 0, 1], "start closing"),
            (vec![], 60, [0, 1, 0, 0, 1], "closing"),
            (vec![], 60, [0, 1, 0, 0, 1], "closing, the time runs out"),
            (vec![], 1, [0, 0, 0, 1, 0], "closing alarm"),
            (vec![("O_FB", 1), ("C_FB", 1)], 1, [0, 0, 1, 1, 0], "at both ends"),
        ] {
            after(&mut fake, ms, &inputs);
            assert_eq!(outputs(&fake), expected, "{what}");
        }
    }
}
