//! SFC 72 I_GET, SFC 73 I_PUT, SFC 74 I_ABORT: data of a communication partner inside the station. No module of ours is
//! one. ["S7 Communication over Non-Configured Connections"]

use crate::declare::params;
use crate::row::Row;

params!(IGet {
    Input { REQ: BOOL, CONT: BOOL, IOID: BYTE, LADDR: WORD, VAR_ADDR: ANY }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL, RD: ANY }
});
params!(IPut {
    Input { REQ: BOOL, CONT: BOOL, IOID: BYTE, LADDR: WORD, VAR_ADDR: ANY, SD: ANY }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL }
});
params!(IAbort { Input { REQ: BOOL, IOID: BYTE, LADDR: WORD } Return { RET_VAL: INT } Output { BUSY: BOOL } });

pub(super) const ROWS: &[Row] = &[
    Row::asked::<IGet>(72, "I_GET", |_| Err(NO_PARTNER)).note(NOBODY),
    Row::asked::<IPut>(73, "I_PUT", |_| Err(NO_PARTNER)).note(NOBODY),
    Row::asked::<IAbort>(74, "I_ABORT", |_| Err(NO_PARTNER)).note(NOBODY),
];

const NOBODY: &str = "always 8090h: no module is a communication partner";

/// The address is that of no communication partner.
const NO_PARTNER: u16 = 0x8090;

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, any};

    #[test]
    fn nobody_answers() {
        for (key, req, code) in [("SFC72", 1, 0x8090), ("SFC73", 1, 0x8090), ("SFC74", 1, 0x8090), ("SFC74", 0, 0x7000)]
        {
            let mut fake = Fake::new(&format!("SYSTEM:{key}")).with("REQ", [req]).with("IOID", [0x54]);
            fake = fake.with("LADDR", [1, 0]).with("RET_VAL", [9; 2]).with("BUSY", [1]);
            for (block, name) in [("SFC72", "RD"), ("SFC73", "SD"), ("SFC73", "VAR_ADDR")] {
                if block == key {
                    fake = fake.with(name, any(2, 2, 10));
                }
            }
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY"), fake.br), (code, 0, code < 0x8000), "{key}");
        }
    }
}
