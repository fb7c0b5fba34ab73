//! SFC 36 MSK_FLT, SFC 37 DMSK_FLT, SFC 38 READ_ERR, SFC 44 REPL_VAL. ["Handling Synchronous Errors"]

use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;

params!(MskFlt {
    Input { PRGFLT_SET_MASK: DWORD, ACCFLT_SET_MASK: DWORD }
    Return { RET_VAL: INT }
    Output { PRGFLT_MASKED: DWORD, ACCFLT_MASKED: DWORD }
});
params!(DmskFlt {
    Input { PRGFLT_RESET_MASK: DWORD, ACCFLT_RESET_MASK: DWORD }
    Return { RET_VAL: INT }
    Output { PRGFLT_MASKED: DWORD, ACCFLT_MASKED: DWORD }
});
params!(ReadErr {
    Input { PRGFLT_QUERY: DWORD, ACCFLT_QUERY: DWORD }
    Return { RET_VAL: INT }
    Output { PRGFLT_CLR: DWORD, ACCFLT_CLR: DWORD }
});
params!(ReplVal { Input { VAL: DWORD } Return { RET_VAL: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<MskFlt>(36, "MSK_FLT", msk_flt),
    Row::coded::<DmskFlt>(37, "DMSK_FLT", dmsk_flt),
    Row::coded::<ReadErr>(38, "READ_ERR", read_err),
    Row::coded::<ReplVal>(44, "REPL_VAL", |call| {
        let value = call.raw(ReplVal::VAL);
        if call.cx.services().replace_value(value) { Ok(0) } else { Err(0x8080) }
    }),
];

fn msk_flt(call: &mut Call<'_>) -> Code {
    let errors = [call.raw(MskFlt::PRGFLT_SET_MASK), call.raw(MskFlt::ACCFLT_SET_MASK)];
    let filter = call.cx.services().error_filter();
    let already = filter.mask(errors);
    let [programming, access] = filter.masked();
    call.set(MskFlt::PRGFLT_MASKED, programming);
    call.set(MskFlt::ACCFLT_MASKED, access);
    Ok(u16::from(already))
}

fn dmsk_flt(call: &mut Call<'_>) -> Code {
    let errors = [call.raw(DmskFlt::PRGFLT_RESET_MASK), call.raw(DmskFlt::ACCFLT_RESET_MASK)];
    let filter = call.cx.services().error_filter();
    let not_masked = filter.unmask(errors);
    let [programming, access] = filter.masked();
    call.set(DmskFlt::PRGFLT_MASKED, programming);
    call.set(DmskFlt::ACCFLT_MASKED, access);
    Ok(u16::from(not_masked))
}

fn read_err(call: &mut Call<'_>) -> Code {
    let errors = [call.raw(ReadErr::PRGFLT_QUERY), call.raw(ReadErr::ACCFLT_QUERY)];
    let filter = call.cx.services().error_filter();
    let ([programming, access], not_masked) = filter.query(errors);
    call.set(ReadErr::PRGFLT_CLR, programming);
    call.set(ReadErr::ACCFLT_CLR, access);
    Ok(u16::from(not_masked))
}

#[cfg(test)]
mod tests {
    use ob1_model::FaultKind;

    use crate::services::ErrorFilter;
    use crate::tests::Fake;

    /// Calls a block with two masks; RET_VAL and the two outputs.
    fn call(filter: &mut ErrorFilter, key: &str, names: [&str; 4], masks: [u32; 2]) -> (u32, [u32; 2]) {
        let mut fake = Fake::new(key).with(names[0], masks[0].to_be_bytes()).with(names[1], masks[1].to_be_bytes());
        fake = fake.with(names[2], [0; 4]).with(names[3], [0; 4]).with("RET_VAL", [9; 2]);
        fake.station.filter = *filter;
        fake.run();
        *filter = fake.station.filter;
        assert!(fake.br);
        (fake.value("RET_VAL"), [fake.value(names[2]), fake.value(names[3])])
    }

    #[test]
    fn masks() {
        let set = ["PRGFLT_SET_MASK", "ACCFLT_SET_MASK", "PRGFLT_MASKED", "ACCFLT_MASKED"];
        let reset = ["PRGFLT_RESET_MASK", "ACCFLT_RESET_MASK", "PRGFLT_MASKED", "ACCFLT_MASKED"];
        let query = ["PRGFLT_QUERY", "ACCFLT_QUERY", "PRGFLT_CLR", "ACCFLT_CLR"];
        let mut filter = ErrorFilter::default();
        assert_eq!(call(&mut filter, "SYSTEM:SFC36", set, [0x1000_0000, 0xC]), (0, [0x1000_0000, 0xC]));
        assert_eq!(call(&mut filter, "SYSTEM:SFC36", set, [0x1000_0002, 0]), (1, [0x1000_0002, 0xC]));
        assert!(filter.absorbs(FaultKind::PeripheralRead));
        assert_eq!(call(&mut filter, "SYSTEM:SFC38", query, [0x1000_0000, 0xC]), (0, [0, 4]));
        assert_eq!(call(&mut filter, "SYSTEM:SFC38", query, [4, 0xC]), (1, [0, 0]));
        assert_eq!(call(&mut filter, "SYSTEM:SFC37", reset, [0x1000_0000, 4]), (0, [2, 8]));
        assert_eq!(call(&mut filter, "SYSTEM:SFC37", reset, [0x1000_0000, 0]), (1, [2, 8]));
    }

    #[test]
    fn a_replacement() {
        for (in_error_ob, code) in [(true, 0), (false, 0x8080)] {
            let mut fake = Fake::new("SYSTEM:SFC44").with("VAL", [1, 2, 3, 4]).with("RET_VAL", [9; 2]);
            fake.station.in_error_ob = in_error_ob;
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, in_error_ob));
            assert_eq!(fake.station.replaced, in_error_ob.then_some(0x0102_0304));
        }
    }
}
