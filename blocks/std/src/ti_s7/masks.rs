//! FB 83 IMC, FB 84 SMC: sixteen bits against masks. ["Index Matrix Compare", "Scan Matrix Compare"]

use ob1_model::BlockKind::Fb;

use crate::call::{Call, Code};
use crate::declare::{At, Params, params};
use crate::row::Row;

params!(Imc {
    Input {
        IN_BIT0: BOOL, IN_BIT1: BOOL, IN_BIT2: BOOL, IN_BIT3: BOOL, IN_BIT4: BOOL, IN_BIT5: BOOL, IN_BIT6: BOOL,
        IN_BIT7: BOOL, IN_BIT8: BOOL, IN_BIT9: BOOL, IN_BIT10: BOOL, IN_BIT11: BOOL, IN_BIT12: BOOL, IN_BIT13: BOOL,
        IN_BIT14: BOOL, IN_BIT15: BOOL, CMP_STEP: BYTE,
    }
    Output { OUT: BOOL, ERR_CODE: WORD }
    Static { CMP_VAL: MASKS16 }
});
params!(Smc {
    Input {
        IN_BIT0: BOOL, IN_BIT1: BOOL, IN_BIT2: BOOL, IN_BIT3: BOOL, IN_BIT4: BOOL, IN_BIT5: BOOL, IN_BIT6: BOOL,
        IN_BIT7: BOOL, IN_BIT8: BOOL, IN_BIT9: BOOL, IN_BIT10: BOOL, IN_BIT11: BOOL, IN_BIT12: BOOL, IN_BIT13: BOOL,
        IN_BIT14: BOOL, IN_BIT15: BOOL,
    }
    Output { OUT: BOOL, OUT_STEP: BYTE, ERR_CODE: WORD }
    Static { LAST: BYTE, CMP_VAL: MASKS16 }
});

pub(super) const ROWS: &[Row] =
    &[Row::ti::<Imc>(Fb, 83, "IMC", imc), Row::ti::<Smc>(Fb, 84, "SMC", smc).note("begins with mask 0")];

/// CMP_STEP is above 15.
const BAD_STEP: u16 = 0x000A;
/// LAST is above 15.
const BAD_LAST: u16 = 0x000E;

/// The sixteen inputs, which come first in both blocks.
fn inputs(call: &mut Call<'_>) -> u16 {
    (0..16).fold(0, |bits, bit| bits | u16::from(call.bool(At(bit))) << bit)
}

/// The mask of a step; element 0 is the lowest bit of the first byte.
fn mask(call: &mut Call<'_>, masks: impl Params, step: u8) -> u16 {
    let mut bytes = [0; 2];
    let at = call.instance_byte(masks) + 2 * u32::from(step);
    // Inside the instance.
    let _ = call.cx.instance_read(at, &mut bytes);
    u16::from_le_bytes(bytes)
}

fn imc(call: &mut Call<'_>) -> Code {
    let step = call.byte(Imc::CMP_STEP);
    if step > 15 {
        return Err(BAD_STEP);
    }
    let equal = inputs(call) == mask(call, Imc::CMP_VAL, step);
    call.set_bool(Imc::OUT, equal);
    Ok(0)
}

fn smc(call: &mut Call<'_>) -> Code {
    let last = call.byte(Smc::LAST);
    if last > 15 {
        return Err(BAD_LAST);
    }
    let bits = inputs(call);
    let found = (0..=last).find(|step| mask(call, Smc::CMP_VAL, *step) == bits);
    call.set_bool(Smc::OUT, found.is_some());
    call.set(Smc::OUT_STEP, u32::from(found.unwrap_or(last + 1)));
    Ok(0)
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    /// Masks 0 to 3: nothing, bit 0, bits 0 and 9, bit 15.
    fn masks() -> Vec<u8> {
        let mut bytes = vec![0, 0, 1, 0, 1, 2, 0, 0x80];
        bytes.resize(32, 0xFF);
        bytes
    }

    #[test]
    fn one_mask() {
        for (step, bits, out, code) in
            [(0u8, vec![], 1, 0), (1, vec![0], 1, 0), (2, vec![0, 9], 1, 0), (2, vec![0], 0, 0), (16, vec![], 0, 0x0A)]
        {
            let mut fake = Fake::new("TI-S7:IMC").with("CMP_STEP", [step]).with("CMP_VAL", masks());
            for bit in bits {
                fake.set(&format!("IN_BIT{bit}"), &[1]);
            }
            fake.run();
            assert_eq!((fake.value("OUT"), fake.value("ERR_CODE"), fake.br), (out, code, code == 0), "{step}");
        }
    }

    #[test]
    fn the_first_mask_that_fits() {
        for (last, bits, out, step, code) in [
            (3u8, vec![15], 1, 3, 0),
            (3, vec![], 1, 0, 0),
            (2, vec![15], 0, 3, 0),
            (15, vec![3], 0, 16, 0),
            (16, vec![], 0, 0, 0x0E),
        ] {
            let mut fake = Fake::new("TI-S7:SMC").with("LAST", [last]).with("CMP_VAL", masks());
            for bit in bits {
                fake.set(&format!("IN_BIT{bit}"), &[1]);
            }
            fake.run();
            let result = (fake.value("OUT"), fake.value("OUT_STEP"), fake.value("ERR_CODE"));
            assert_eq!(result, (out, step, code), "{last}");
        }
    }
}
