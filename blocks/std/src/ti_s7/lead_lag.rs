//! FB 80 LEAD_LAG: an analog value ahead and behind. ["Lead/Lag Algorithm"]

use ob1_model::BlockKind::Fb;

use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;

params!(LeadLag {
    Input { IN: REAL, SAMPLE_T: INT }
    Output { OUT: REAL, ERR_CODE: WORD }
    Static { LD_TIME: REAL, LG_TIME: REAL, GAIN: REAL, PREV_IN: REAL, PREV_OUT: REAL }
});

pub(super) const ROWS: &[Row] = &[Row::ti::<LeadLag>(Fb, 80, "LEAD_LAG", lead_lag)];

/// `OUT = (LG * PREV_OUT + GAIN * ((LD + T) * IN - LD * PREV_IN)) / (LG + T)`.
fn lead_lag(call: &mut Call<'_>) -> Code {
    let gain = call.real(LeadLag::GAIN);
    // A gain that is not a number is not above 0 either.
    if gain.is_nan() || gain <= 0.0 {
        return Err(0x0009);
    }
    let (input, time) = (call.real(LeadLag::IN), f32::from(call.int(LeadLag::SAMPLE_T)));
    let (lead, lag) = (call.real(LeadLag::LD_TIME), call.real(LeadLag::LG_TIME));
    let (last, old) = (call.real(LeadLag::PREV_IN), call.real(LeadLag::PREV_OUT));
    let out = (lag * old + gain * ((lead + time) * input - lead * last)) / (lag + time);
    for (p, value) in [(LeadLag::OUT, out), (LeadLag::PREV_IN, input), (LeadLag::PREV_OUT, out)] {
        call.set_real(p, value);
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    #[test]
    fn the_example_of_the_manual() {
        let mut fake = Fake::new("TI-S7:LEAD_LAG").with("IN", 2f32.to_be_bytes()).with("SAMPLE_T", [0, 10]);
        assert_eq!((fake.at("LD_TIME"), fake.at("PREV_OUT")), ("12.0".into(), "28.0".into()));
        for (name, value) in [("LD_TIME", 2f32), ("LG_TIME", 2.0), ("GAIN", 1.0), ("PREV_IN", 6.0), ("PREV_OUT", 6.0)] {
            fake.set(name, &value.to_be_bytes());
        }
        fake.run();
        assert_eq!((fake.real("OUT"), fake.real("PREV_IN"), fake.real("PREV_OUT")), (2.0, 2.0, 2.0));
        fake.set("GAIN", &0f32.to_be_bytes());
        fake.run();
        assert_eq!((fake.value("ERR_CODE"), fake.br), (9, false));
    }

    #[test]
    fn a_lag_follows_a_step() {
        let mut fake = Fake::new("TI-S7:LEAD_LAG").with("IN", 100f32.to_be_bytes()).with("SAMPLE_T", [0, 1]);
        for (name, value) in [("LG_TIME", 9f32), ("GAIN", 2.0)] {
            fake.set(name, &value.to_be_bytes());
        }
        fake.run();
        assert_eq!(fake.real("OUT"), 20.0);
        (0..200).for_each(|_| fake.run());
        assert!((fake.real("OUT") - 200.0).abs() < 0.01);
    }
}
