//! IEC counters: SFB 0 CTU, SFB 1 CTD, SFB 2 CTUD. ["IEC Timers and IEC Counters"]

use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::Row;

params!(Ctu { Input { CU: BOOL, R: BOOL, PV: INT } Output { Q: BOOL, CV: INT } Static { CUO: BOOL } });
params!(Ctd { Input { CD: BOOL, LOAD: BOOL, PV: INT } Output { Q: BOOL, CV: INT } Static { CDO: BOOL } });
params!(Ctud {
    Input { CU: BOOL, CD: BOOL, R: BOOL, LOAD: BOOL, PV: INT }
    Output { QU: BOOL, QD: BOOL, CV: INT }
    Static { CUO: BOOL, CDO: BOOL }
});

pub(super) const ROWS: &[Row] =
    &[Row::sfb::<Ctu>(0, "CTU", ctu), Row::sfb::<Ctd>(1, "CTD", ctd), Row::sfb::<Ctud>(2, "CTUD", ctud)];

/// Counts rising edges at CU up to 32767.
pub(super) fn ctu(call: &mut Call<'_>) -> Done {
    let (signal, last, count) = (call.bool(Ctu::CU), call.bool(Ctu::CUO), call.int(Ctu::CV));
    let count = match (call.bool(Ctu::R), signal && !last) {
        (true, _) => 0,
        (false, true) => count.saturating_add(1),
        (false, false) => count,
    };
    let reached = count >= call.int(Ctu::PV);
    call.set_bool(Ctu::CUO, signal);
    call.set_int(Ctu::CV, count);
    call.set_bool(Ctu::Q, reached);
    Ok(())
}

/// Counts rising edges at CD down to -32768.
pub(super) fn ctd(call: &mut Call<'_>) -> Done {
    let (signal, last, count) = (call.bool(Ctd::CD), call.bool(Ctd::CDO), call.int(Ctd::CV));
    let count = match (call.bool(Ctd::LOAD), signal && !last) {
        (true, _) => call.int(Ctd::PV),
        (false, true) => count.saturating_sub(1),
        (false, false) => count,
    };
    call.set_bool(Ctd::CDO, signal);
    call.set_int(Ctd::CV, count);
    call.set_bool(Ctd::Q, count <= 0);
    Ok(())
}

/// Counts both ways; edges at CU and CD together change nothing. R goes before LOAD.
pub(super) fn ctud(call: &mut Call<'_>) -> Done {
    let (up, down, preset) = (call.bool(Ctud::CU), call.bool(Ctud::CD), call.int(Ctud::PV));
    let (rises, falls) = (up && !call.bool(Ctud::CUO), down && !call.bool(Ctud::CDO));
    let count = call.int(Ctud::CV);
    let count = match (call.bool(Ctud::R), call.bool(Ctud::LOAD), rises, falls) {
        (true, ..) => 0,
        (_, true, ..) => preset,
        (_, _, true, false) => count.saturating_add(1),
        (_, _, false, true) => count.saturating_sub(1),
        _ => count,
    };
    call.set_bool(Ctud::CUO, up);
    call.set_bool(Ctud::CDO, down);
    call.set_int(Ctud::CV, count);
    call.set_bool(Ctud::QU, count >= preset);
    call.set_bool(Ctud::QD, count <= 0);
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::tests::Fake;

    #[test]
    fn up_and_reset() {
        let mut fake = Fake::new("SYSTEM:SFB0").with("PV", [0, 2]);
        for (cu, r, cv, q) in
            [(0, 0, 0, 0), (1, 0, 1, 0), (1, 0, 1, 0), (0, 0, 1, 0), (1, 0, 2, 1), (0, 1, 0, 0), (1, 1, 0, 0)]
        {
            fake = fake.with("CU", [cu]).with("R", [r]);
            fake.run();
            assert_eq!((fake.value("CV"), fake.value("Q"), fake.br), (cv, q, true), "{cu} {r}");
        }
        let mut fake = fake.with("CV", 32_767i16.to_be_bytes()).with("R", [0]).with("CU", [0]);
        fake.run();
        fake = fake.with("CU", [1]);
        fake.run();
        assert_eq!(fake.value("CV"), 32_767, "no overflow");
    }

    #[test]
    fn down_and_load() {
        let mut fake = Fake::new("SYSTEM:SFB1").with("PV", [0, 2]);
        for (cd, load, cv, q) in
            [(0, 1, 2, 0), (1, 0, 1, 0), (0, 0, 1, 0), (1, 0, 0, 1), (0, 0, 0, 1), (1, 0, -1i16, 1)]
        {
            fake = fake.with("CD", [cd]).with("LOAD", [load]);
            fake.run();
            assert_eq!((fake.value("CV") as i16, fake.value("Q")), (cv, q), "{cd} {load}");
        }
    }

    #[test]
    fn both_ways() {
        let mut fake = Fake::new("SYSTEM:SFB2").with("PV", [0, 1]);
        for (cu, cd, r, load, cv, qu, qd) in [
            (1, 0, 0, 0, 1, 1, 0),
            (0, 0, 0, 0, 1, 1, 0),
            (1, 1, 0, 0, 1, 1, 0),
            (0, 0, 0, 0, 1, 1, 0),
            (0, 1, 0, 0, 0, 0, 1),
            (0, 0, 0, 1, 1, 1, 0),
            (0, 0, 1, 1, 0, 0, 1),
        ] {
            fake = fake.with("CU", [cu]).with("CD", [cd]).with("R", [r]).with("LOAD", [load]);
            fake.run();
            assert_eq!((fake.value("CV"), fake.value("QU"), fake.value("QD")), (cv, qu, qd), "{cu} {cd} {r} {load}");
        }
    }
}
