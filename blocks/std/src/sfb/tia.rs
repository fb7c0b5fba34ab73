//! IEC timers and counters with the instances of an S7-1500: the types TP_TIME, TON_TIME, TOF_TIME and IEC_TIMER of 16
//! bytes, CTU_INT, CTD_INT, CTUD_INT and IEC_COUNTER of 6. They have no numbers there; here they are SFB 1000 to 1005,
//! each 1000 beyond that of an S7-300. R_TRIG and F_TRIG are SFB 1006 and 1007.
//!
//! The declarations are those of a call, in the order of SFB 0 to 5; the addresses are TIA Portal's. Bytes and bits
//! that no name of TIA Portal has keep the timer's state and the counter's last signals.

use super::counters::{ctd, ctu, ctud};
use super::timers::{State, Step, off_delay, on_delay, pulse, turn};
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::Row;
use crate::ticks::time_tick;

// The parameters are those of `timers`, whose step runs here too.
params!(Timer {
    Input { IN: BOOL, PT: TIME }
    Output { Q: BOOL, ET: TIME }
    Static { ST: TIME, RU: BOOL, STATE: BYTE, PAD: WORD }
});

const TIMER: &[(u32, u8)] = &[(12, 1), (4, 0), (12, 2), (8, 0), (0, 0), (12, 0), (13, 0), (14, 0)];
const TIMER_BYTES: u32 = 16;

// The parameters up to the last signals are those of `counters`, whose functions run here too.
params!(Ctu {
    Input { CU: BOOL, R: BOOL, PV: INT }
    Output { QU | Q: BOOL, CV: INT }
    Static { CUO: BOOL, CD: BOOL, LD: BOOL, QD: BOOL, CDO: BOOL, PAD: BYTE }
});
params!(Ctd {
    Input { CD: BOOL, LD | LOAD: BOOL, PV: INT }
    Output { QD | Q: BOOL, CV: INT }
    Static { CDO: BOOL, CU: BOOL, R: BOOL, QU: BOOL, CUO: BOOL, PAD: BYTE }
});
params!(Ctud {
    Input { CU: BOOL, CD: BOOL, R: BOOL, LD | LOAD: BOOL, PV: INT }
    Output { QU: BOOL, QD: BOOL, CV: INT }
    Static { CUO: BOOL, CDO: BOOL, PAD: BYTE }
});

params!(Edge { Input { CLK: BOOL } Output { Q: BOOL } Static { Stat_Bit: BOOL } });

const CU: (u32, u8) = (0, 0);
const CD: (u32, u8) = (0, 1);
const R: (u32, u8) = (0, 2);
const LD: (u32, u8) = (0, 3);
const QU: (u32, u8) = (0, 4);
const QD: (u32, u8) = (0, 5);
const CUO: (u32, u8) = (0, 6);
const CDO: (u32, u8) = (0, 7);
const PAD: (u32, u8) = (1, 0);
const PV: (u32, u8) = (2, 0);
const CV: (u32, u8) = (4, 0);
const COUNTER_BYTES: u32 = 6;

/// What the documentation says of each of them.
const NOTE: &str = "a system type of TIA Portal, with the instance of an S7-1500";

pub(super) const ROWS: &[Row] = &[
    Row::sfb::<Ctu>(1000, "CTU_INT", ctu)
        .places(&[CU, R, PV, QU, CV, CUO, CD, LD, QD, CDO, PAD], COUNTER_BYTES)
        .note(NOTE),
    Row::sfb::<Ctd>(1001, "CTD_INT", ctd)
        .places(&[CD, LD, PV, QD, CV, CDO, CU, R, QU, CUO, PAD], COUNTER_BYTES)
        .note(NOTE),
    Row::sfb::<Ctud>(1002, "CTUD_INT", ctud)
        .places(&[CU, CD, R, LD, PV, QU, QD, CV, CUO, CDO, PAD], COUNTER_BYTES)
        .note(NOTE),
    Row::sfb::<Timer>(1003, "TP_TIME", |call| run(call, pulse, State::runs)).places(TIMER, TIMER_BYTES).note(NOTE),
    Row::sfb::<Timer>(1004, "TON_TIME", |call| run(call, on_delay, State::is_over))
        .places(TIMER, TIMER_BYTES)
        .note(NOTE),
    Row::sfb::<Timer>(1005, "TOF_TIME", |call| run(call, off_delay, State::holds))
        .places(TIMER, TIMER_BYTES)
        .note(NOTE),
    Row::sfb::<Edge>(1006, "R_TRIG", |call| edge(call, true)).note(NOTE),
    Row::sfb::<Edge>(1007, "F_TRIG", |call| edge(call, false)).note(NOTE),
];

/// Q for one call, when CLK has risen or fallen since the last.
fn edge(call: &mut Call<'_>, rising: bool) -> Done {
    let (now, before) = (call.bool(Edge::CLK), call.bool(Edge::Stat_Bit));
    call.set_bool(Edge::Q, now != before && now == rising);
    call.set_bool(Edge::Stat_Bit, now);
    Ok(())
}

fn run(call: &mut Call<'_>, step: Step, output: fn(State) -> bool) -> Done {
    let now = time_tick(call.cx.now());
    let kept = turn(call, now, [Timer::STATE, Timer::ST], step, output);
    call.set_bool(Timer::RU, kept.runs());
    Ok(())
}

#[cfg(test)]
mod tests {
    use ob1_model::{DataType, Layout};
    use ob1_time::Instant;

    use crate::standard_block;
    use crate::tests::Fake;

    #[test]
    fn instances_have_the_sizes_and_addresses_of_an_s7_1500() {
        let timer = ["ST 0.0", "PT 4.0", "ET 8.0", "RU 12.0", "IN 12.1", "Q 12.2", "STATE 13.0", "PAD 14.0"];
        let counter = ["CU 0.0", "CD 0.1", "R 0.2", "LD 0.3", "QU 0.4", "QD 0.5", "CUO 0.6", "CDO 0.7", "PAD 1.0"];
        let counter = [&counter[..], &["PV 2.0", "CV 4.0"]].concat();
        for number in 1000..1006 {
            let (bytes, expected) = if number < 1003 { (6, &counter[..]) } else { (16, &timer[..]) };
            let interface = standard_block(&format!("SYSTEM:SFB{number}")).expect("a block").interface;
            assert_eq!(interface.instance_bytes, bytes, "{number}");
            let DataType::Struct(fields) = interface.instance_type() else { panic!("{number}") };
            let mut layout = Layout::new();
            let mut found = Vec::new();
            for field in &fields {
                let at = layout.place(&field.ty);
                let param = interface.params.iter().find(|p| p.name == field.name).expect("a parameter");
                assert_eq!(param.at, at, "SFB {number}: {}", field.name);
                found.push(format!("{} {}.{}", field.name, at.byte(), at.bit()));
            }
            assert_eq!(layout.bytes(), bytes, "{number}");
            assert_eq!(found, expected, "SFB {number}");
        }
    }

    #[test]
    fn an_on_delay_runs_and_says_so() {
        let mut fake = Fake::new("SYSTEM:SFB1004").with("PT", 100i32.to_be_bytes());
        for (ms, input, running, q, et) in
            [(0, 0, 0, 0, 0), (10, 1, 1, 0, 0), (60, 1, 1, 0, 50), (110, 1, 0, 1, 100), (120, 0, 0, 0, 0)]
        {
            fake.now = Instant::from_millis(ms);
            fake = fake.with("IN", [input]);
            fake.run();
            assert_eq!((fake.value("RU"), fake.value("Q"), fake.dint("ET")), (running, q, et), "{ms} ms");
        }
    }

    #[test]
    fn edges() {
        for (key, expected) in [("SYSTEM:SFB1006", [0, 1, 0, 0, 0, 1]), ("SYSTEM:SFB1007", [0, 0, 0, 1, 0, 0])] {
            let mut fake = Fake::new(key);
            let mut found = Vec::new();
            for signal in [0, 1, 1, 0, 0, 1] {
                fake = fake.with("CLK", [signal]);
                fake.run();
                found.push(fake.value("Q"));
            }
            assert_eq!(found, expected, "{key}");
        }
    }

    #[test]
    fn a_counter_counts_edges() {
        let mut fake = Fake::new("SYSTEM:SFB1002").with("PV", [0, 2]);
        let mut counts = Vec::new();
        for (up, down, load) in [(1, 0, 0), (1, 0, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)] {
            fake = fake.with("CU", [up]).with("CD", [down]).with("LD", [load]);
            fake.run();
            counts.push((fake.value("CV"), fake.value("QU")));
        }
        assert_eq!(counts, [(1, 0), (1, 0), (1, 0), (2, 1), (1, 0), (2, 1)]);
    }
}
