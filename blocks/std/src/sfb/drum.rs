//! SFB 32 DRUM: a sequencer of up to 16 steps, which the TI-S7 converting blocks have as FB 85.
//! ["Implementing a Sequencer with SFB 32 DRUM"]

use ob1_model::BlockKind;

use crate::call::{Call, Code};
use crate::declare::{At, params};
use crate::row::{Origin, Row};
use crate::ticks::time_tick;

params!(Drum {
    Input {
        RESET: BOOL, JOG: BOOL, DRUM_EN: BOOL, LST_STEP: BYTE,
        EVENT1: BOOL, EVENT2: BOOL, EVENT3: BOOL, EVENT4: BOOL, EVENT5: BOOL, EVENT6: BOOL, EVENT7: BOOL, EVENT8: BOOL,
        EVENT9: BOOL, EVENT10: BOOL, EVENT11: BOOL, EVENT12: BOOL, EVENT13: BOOL, EVENT14: BOOL, EVENT15: BOOL,
        EVENT16: BOOL,
    }
    Output {
        OUT0: BOOL, OUT1: BOOL, OUT2: BOOL, OUT3: BOOL, OUT4: BOOL, OUT5: BOOL, OUT6: BOOL, OUT7: BOOL,
        OUT8: BOOL, OUT9: BOOL, OUT10: BOOL, OUT11: BOOL, OUT12: BOOL, OUT13: BOOL, OUT14: BOOL, OUT15: BOOL,
        Q: BOOL, OUT_WORD: WORD, ERR_CODE: WORD,
    }
    Static {
        JOG_HIS: BOOL, EOD: BOOL, DSP: BYTE, DSC: BYTE, DCC: DWORD, DTBP: WORD, PREV_TIME: TIME,
        S_PRESET: WORDS16, OUT_VAL: BITS16X16, S_MASK: BITS16X16,
    }
});

pub(super) const ROWS: &[Row] = &[
    Row::ti::<Drum>(BlockKind::Fb, 85, "DRUM", |call| {
        // The same errors as 000Bh to 000Eh.
        drum(call).map_err(|code| code - WRONG_LAST_STEP + 0x000B)
    })
    .note(NOTE),
    Row::with_code::<Drum>(Origin::System, BlockKind::Sfb, 32, "DRUM", drum).note(NOTE),
];

const NOTE: &str = "DTBP in ms; DCC counts down in ms while the step's event is 1; PREV_TIME is ours";

/// What is wrong with the parameters, as ERR_CODE says it.
const WRONG_LAST_STEP: u16 = 0x8081;
const WRONG_CURRENT_STEP: u16 = 0x8082;
const WRONG_PRESET_STEP: u16 = 0x8083;
const WRONG_TIME: u16 = 0x8084;

/// Time of a step in ms, or the error of a product that is out of range.
fn preset(call: &mut Call<'_>, step: u8) -> Result<u32, u16> {
    let mut factor = [0; 2];
    let at = call.instance_byte(Drum::S_PRESET) + 2 * (u32::from(step) - 1);
    let _ = call.cx.instance_read(at, &mut factor);
    let time = u32::from(call.word(Drum::DTBP)) * u32::from(u16::from_be_bytes(factor));
    if time > 0x7FFF_FFFF { Err(WRONG_TIME) } else { Ok(time) }
}

fn drum(call: &mut Call<'_>) -> Code {
    let now = time_tick(call.cx.now());
    let passed = now.wrapping_sub(call.raw(Drum::PREV_TIME)) & 0x7FFF_FFFF;
    let (jog, jogged) = (call.bool(Drum::JOG), call.bool(Drum::JOG_HIS));
    call.set(Drum::PREV_TIME, now);
    call.set_bool(Drum::JOG_HIS, jog);

    let last = call.byte(Drum::LST_STEP);
    if !(1..=16).contains(&last) {
        return Err(WRONG_LAST_STEP);
    }
    let mut current = call.byte(Drum::DSC);
    if call.bool(Drum::RESET) {
        current = call.byte(Drum::DSP);
        if !(1..=last).contains(&current) {
            return Err(WRONG_PRESET_STEP);
        }
        let time = preset(call, current)?;
        call.set(Drum::DCC, time);
        call.set_bool(Drum::EOD, false);
    } else {
        if !(1..=last).contains(&current) {
            return Err(WRONG_CURRENT_STEP);
        }
        let advance = if jog && !jogged {
            true
        } else if call.bool(Drum::DRUM_EN) && call.bool(At(Drum::EVENT1 as u32 + u32::from(current) - 1)) {
            let left = call.raw(Drum::DCC).saturating_sub(passed);
            call.set(Drum::DCC, left);
            left == 0
        } else {
            false
        };
        if advance && current < last {
            let time = preset(call, current + 1)?;
            current += 1;
            call.set(Drum::DCC, time);
        } else if advance {
            call.set(Drum::DCC, 0);
            call.set_bool(Drum::EOD, true);
        }
    }
    call.set(Drum::DSC, u32::from(current));
    let over = call.bool(Drum::EOD);
    call.set_bool(Drum::Q, over);
    outputs(call, current);
    Ok(0)
}

/// Each output takes the step's bit where the step's mask is 1, and stays where it is 0.
fn outputs(call: &mut Call<'_>, step: u8) {
    let row = 2 * (u32::from(step) - 1);
    let mut bits = |p| {
        let mut row_bits = [0; 2];
        let at = call.instance_byte(p) + row;
        let _ = call.cx.instance_read(at, &mut row_bits);
        // Element 0 is the lowest bit of the first byte.
        u16::from_le_bytes(row_bits)
    };
    let (values, mask) = (bits(Drum::OUT_VAL), bits(Drum::S_MASK));
    let word = call.word(Drum::OUT_WORD) & !mask | values & mask;
    call.set(Drum::OUT_WORD, u32::from(word));
    for bit in 0..16 {
        call.set_bool(At(Drum::OUT0 as u32 + bit), word >> bit & 1 == 1);
    }
}

#[cfg(test)]
mod tests {
    use ob1_time::Instant;

    use crate::tests::Fake;

    /// Three steps of 20, 30 and 10 ms; outputs 1, 2 and 4, of which the third is masked except bit 2.
    fn fake() -> Fake {
        let mut fake = Fake::new("SYSTEM:DRUM").with("LST_STEP", [3]).with("DSP", [1]).with("DTBP", [0, 10]);
        let words = |values: [u16; 3]| {
            let mut bytes = [0; 32];
            for (i, value) in values.into_iter().enumerate() {
                bytes[2 * i..2 * i + 2].copy_from_slice(&value.to_be_bytes());
            }
            bytes
        };
        fake = fake.with("S_PRESET", words([2, 3, 1])).with("OUT_VAL", words([0x0100, 0x0280, 0x0400]));
        fake = fake.with("S_MASK", words([0xFFFF, 0xFFFF, 0x0400]));
        for i in 1..=16 {
            fake = fake.with(&format!("EVENT{i}"), [1]);
        }
        fake
    }

    #[test]
    fn steps_by_time_and_event() {
        let mut fake = fake().with("RESET", [1]).with("DRUM_EN", [1]);
        fake.run();
        assert_eq!((fake.value("DSC"), fake.value("OUT_WORD"), fake.value("DCC")), (1, 1, 20));
        fake = fake.with("RESET", [0]);
        let mut at = |ms: u64, event2: u8| {
            fake.now = Instant::from_millis(ms);
            fake.set("EVENT2", &[event2]);
            fake.run();
            (fake.value("DSC"), fake.value("OUT_WORD"), fake.value("DCC"), fake.value("Q"))
        };
        assert_eq!(at(19, 1), (1, 1, 1, 0));
        assert_eq!(at(20, 0), (2, 0x8002, 30, 0));
        assert_eq!(at(60, 0), (2, 0x8002, 30, 0), "waits for its event");
        assert_eq!(at(80, 1), (2, 0x8002, 10, 0));
        assert_eq!(at(90, 1), (3, 0x8006, 10, 0), "masked bits stay");
        assert_eq!(at(100, 1), (3, 0x8006, 0, 1));
        assert_eq!(at(500, 1), (3, 0x8006, 0, 1));
        assert_eq!((fake.value("OUT15"), fake.value("OUT2"), fake.value("OUT0"), fake.br), (1, 1, 0, true));
    }

    #[test]
    fn jogging() {
        let mut fake = fake().with("RESET", [1]);
        fake.run();
        fake = fake.with("RESET", [0]);
        for (jog, step, q) in [(1, 2, 0), (1, 2, 0), (0, 2, 0), (1, 3, 0), (0, 3, 0), (1, 3, 1)] {
            fake.set("JOG", &[jog]);
            fake.run();
            assert_eq!((fake.value("DSC"), fake.value("Q")), (step, q));
        }
    }

    #[test]
    fn wrong_parameters() {
        for (name, value, code) in
            [("LST_STEP", 0, 0x8081), ("LST_STEP", 17, 0x8081), ("DSC", 9, 0x8082), ("DSP", 4, 0x8083)]
        {
            let reset = u8::from(name == "DSP");
            let mut fake = fake().with("RESET", [reset]).with("DSC", [1]).with(name, [value]);
            fake.run();
            assert_eq!((fake.value("ERR_CODE"), fake.br), (code, false), "{name} {value}");
        }
        let mut fake = fake().with("RESET", [1]).with("DTBP", [0xFF; 2]).with("S_PRESET", [0xFF; 32]);
        fake.run();
        assert_eq!(fake.value("ERR_CODE"), 0x8084);
    }
}
