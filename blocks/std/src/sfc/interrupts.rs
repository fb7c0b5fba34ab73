//! SFC 39 DIS_IRT, SFC 40 EN_IRT, SFC 41 DIS_AIRT, SFC 42 EN_AIRT. ["Handling Interrupts and Asynchronous Errors"]

use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;
use crate::services::LockError;

params!(Irt { Input { MODE: BYTE, OB_NR: INT } Return { RET_VAL: INT } });
params!(Airt { Return { RET_VAL: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<Irt>(39, "DIS_IRT", |call| irt(call, true)),
    Row::coded::<Irt>(40, "EN_IRT", |call| irt(call, false)),
    Row::coded::<Airt>(41, "DIS_AIRT", |call| {
        // Fewer than 32768 delays in one OB: a nesting depth that no program reaches.
        Ok(call.cx.services().interrupt_locks().delay().min(0x7FFF))
    })
    .note("RET_VAL: the number of delays"),
    Row::coded::<Airt>(42, "EN_AIRT", |call| {
        call.cx.services().interrupt_locks().undelay().map(|delays| delays.min(0x7FFF)).ok_or(0x8080)
    })
    .note("RET_VAL: the number of delays left"),
];

fn irt(call: &mut Call<'_>, disable: bool) -> Code {
    let (mode, ob) = (call.byte(Irt::MODE), call.word(Irt::OB_NR));
    let locks = call.cx.services().interrupt_locks();
    match if disable { locks.disable(mode, ob) } else { locks.enable(mode, ob) } {
        Ok(()) => Ok(0),
        Err(LockError::Ob) => Err(0x8090),
        Err(LockError::Mode) => Err(0x8091),
    }
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    #[test]
    fn locks() {
        for (key, mode, ob, code, locked) in [
            ("SYSTEM:SFC39", 2, 35u16, 0, true),
            ("SYSTEM:SFC39", 1, 30, 0, true),
            ("SYSTEM:SFC39", 0x80, 0, 0, true),
            ("SYSTEM:SFC39", 2, 1, 0x8090, false),
            ("SYSTEM:SFC39", 7, 35, 0x8091, false),
            ("SYSTEM:SFC40", 0x82, 35, 0x8091, false),
            ("SYSTEM:SFC40", 2, 35, 0, false),
        ] {
            let mut fake = Fake::new(key).with("MODE", [mode]).with("OB_NR", ob.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{key} {mode} {ob}");
            assert_eq!(fake.station.locks.is_disabled(35), locked, "{key} {mode} {ob}");
        }
    }

    #[test]
    fn delays_count() {
        let mut delay = Fake::new("SYSTEM:SFC41").with("RET_VAL", [0; 2]);
        for n in 1..=2 {
            delay.run();
            assert_eq!((delay.value("RET_VAL"), delay.station.locks.is_delayed()), (n, true));
        }
        let mut undelay = Fake::new("SYSTEM:SFC42").with("RET_VAL", [0; 2]);
        undelay.station.locks = delay.station.locks;
        for n in [1, 0, 0x8080] {
            undelay.run();
            assert_eq!((undelay.value("RET_VAL"), undelay.br), (n, n != 0x8080));
        }
    }
}
