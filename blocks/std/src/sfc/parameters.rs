//! SFC 55 WR_PARM, SFC 56 WR_DPARM, SFC 57 PARM_MOD: parameter records of modules; SFC 11 DPSYC_FR and SFC 12 D_ACT_DP,
//! which need a DP master system. ["Transferring Data Records", "Distributed I/Os"]

use super::modules::{NO_MODULE, is_io, send_record};
use crate::call::{Call, Code};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::services::Placed;

params!(WrParm {
    Input { REQ: BOOL, IOID: BYTE, LADDR: WORD, RECNUM: BYTE, RECORD: ANY }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL }
});
params!(WrDparm {
    Input { REQ: BOOL, IOID: BYTE, LADDR: WORD, RECNUM: BYTE }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL }
});
params!(ParmMod { Input { REQ: BOOL, IOID: BYTE, LADDR: WORD } Return { RET_VAL: INT } Output { BUSY: BOOL } });
params!(DpSycFr { Input { REQ: BOOL, LADDR: WORD, GROUP: BYTE, MODE: BYTE } Return { RET_VAL: INT } Output { BUSY: BOOL } });
params!(DActDp { Input { REQ: BOOL, MODE: BYTE, LADDR: WORD } Return { RET_VAL: INT } Output { BUSY: BOOL } });

pub(super) const ROWS: &[Row] = &[
    Row::asked::<DpSycFr>(11, "DPSYC_FR", |call| {
        let address = call.word(DpSycFr::LADDR);
        Err(if station_at(call, address).is_some() { NOT_PERMITTED } else { NO_MODULE })
    })
    .note("8093h: the masters of buses have neither SYNC nor FREEZE"),
    Row::asked::<DActDp>(12, "D_ACT_DP", d_act_dp).note("slaves are always active"),
    Row::asked::<WrParm>(55, "WR_PARM", |call| {
        let to = (call.byte(WrParm::IOID), call.word(WrParm::LADDR), call.byte(WrParm::RECNUM));
        send_record(call, to, WrParm::RECORD)
    })
    .note("answers in the same call"),
    Row::asked::<WrDparm>(56, "WR_DPARM", |call| configured(call, WrDparm::IOID, WrDparm::LADDR, NOT_CONFIGURED))
        .note("80D1h: a station file configures no records by number"),
    Row::asked::<ParmMod>(57, "PARM_MOD", |call| configured(call, ParmMod::IOID, ParmMod::LADDR, NO_PARAMETERS))
        .note("80D2h: a module has its parameters from the station file"),
];

/// The master has no such function, or there is no such mode.
const NOT_PERMITTED: u16 = 0x8093;
/// The record is not in the configuration.
const NOT_CONFIGURED: u16 = 0x80D1;
/// The module cannot be given parameters.
const NO_PARAMETERS: u16 = 0x80D2;

/// The distributed module at an address.
fn station_at(call: &mut Call<'_>, address: u16) -> Option<Placed> {
    call.cx.services().module_with(address, false).filter(|placed| placed.master != 0)
}

fn d_act_dp(call: &mut Call<'_>) -> Code {
    let (address, mode) = (call.word(DActDp::LADDR), call.byte(DActDp::MODE));
    match (station_at(call, address), mode) {
        (None, _) => Err(NO_MODULE),
        // Is it active? It is.
        (Some(_), 0) => Ok(0x0001),
        (Some(_), 1) => Ok(0),
        (Some(_), _) => Err(NOT_PERMITTED),
    }
}

/// NO_MODULE for an address without a module, else the module's answer.
fn configured(call: &mut Call<'_>, area: impl Params, address: impl Params, there: u16) -> Code {
    let address = u32::from(call.word(address));
    Err(if is_io(call.byte(area)) && call.cx.module(address).is_ok() { there } else { NO_MODULE })
}

#[cfg(test)]
mod tests {
    use super::Placed;
    use crate::ModuleSize;
    use crate::tests::{Fake, any};

    fn fake(key: &str, req: u8, address: u16) -> Fake {
        let mut fake = Fake::new(key).with("REQ", [req]).with("LADDR", address.to_be_bytes());
        fake.modules.insert(256, ModuleSize { inputs: 4, outputs: 2 });
        fake.records.insert((256, 2), vec![]);
        fake.memory(10, &[5, 6]);
        fake.with("RET_VAL", [9; 2]).with("BUSY", [1])
    }

    #[test]
    fn a_record_of_the_program_reaches_the_module() {
        for (req, area, address, number, code) in [
            (1, 0x54, 256, 2, 0),
            (0, 0x54, 256, 2, 0x7000),
            (1, 0x53, 256, 2, 0x8090),
            (1, 0x54, 300, 2, 0x8090),
            (1, 0x54, 256, 1, 0x80B0),
            (1, 0x54, 256, 3, 0x80B0),
        ] {
            let mut fake = fake("SYSTEM:SFC55", req, address).with("IOID", [area]).with("RECNUM", [number]);
            fake = fake.with("RECORD", any(2, 2, 10));
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY")), (code, 0), "{area:X} {address} {number}");
            assert_eq!(fake.records[&(256, 2)] == [5, 6], code == 0);
        }
    }

    #[test]
    fn what_is_not_configured() {
        for (key, req, area, address, code) in [
            ("SYSTEM:SFC56", 1, 0x54, 256, 0x80D1),
            ("SYSTEM:SFC56", 1, 0x54, 257, 0x8090),
            ("SYSTEM:SFC56", 0, 0x54, 256, 0x7000),
            ("SYSTEM:SFC57", 1, 0x55, 256, 0x80D2),
            ("SYSTEM:SFC57", 1, 0x50, 256, 0x8090),
        ] {
            let mut fake = fake(key, req, address).with("IOID", [area]);
            if key == "SYSTEM:SFC56" {
                fake = fake.with("RECNUM", [2]);
            }
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY"), fake.br), (code, 0, code < 0x8000), "{key}");
        }
        for (key, req, address, mode, code) in [
            ("SYSTEM:SFC11", 1, 256, 0, 0x8090),
            ("SYSTEM:SFC11", 0, 256, 0, 0x7000),
            ("SYSTEM:SFC11", 1, 2046, 0, 0x8093),
            ("SYSTEM:SFC12", 1, 256, 0, 0x8090),
            ("SYSTEM:SFC12", 0, 2046, 0, 0x7000),
            ("SYSTEM:SFC12", 1, 2046, 0, 1),
            ("SYSTEM:SFC12", 1, 2046, 1, 0),
            ("SYSTEM:SFC12", 1, 2046, 2, 0x8093),
        ] {
            let mut fake = fake(key, req, address).with("MODE", [mode]);
            let itself = Placed { master: 1, rack: 8, slot: 0, inputs: (2046, 0), outputs: (2046, 0) };
            fake.station.placed.push(itself);
            if key == "SYSTEM:SFC11" {
                fake = fake.with("GROUP", [0]);
            }
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY")), (code, 0), "{key}");
        }
    }
}
