//! SFC 13 DPNRM_DG, SFC 14 DPRD_DAT, SFC 15 DPWR_DAT, SFC 58 WR_REC, SFC 59 RD_REC: data and records of modules.
//! Modules answer in the same call, so that BUSY stays 0. ["Transferring Data Records", "Distributed I/Os"]

use crate::Refused;
use crate::call::{Call, Code, read_error, write_error};
use crate::declare::{Params, params};
use crate::row::Row;

params!(DpNrmDg { Input { REQ: BOOL, LADDR: WORD } Return { RET_VAL: INT } Output { RECORD: ANY, BUSY: BOOL } });
params!(DpRdDat { Input { LADDR: WORD } Return { RET_VAL: INT } Output { RECORD: ANY } });
params!(DpWrDat { Input { LADDR: WORD, RECORD: ANY } Return { RET_VAL: INT } });
params!(WrRec {
    Input { REQ: BOOL, IOID: BYTE, LADDR: WORD, RECNUM: BYTE, RECORD: ANY }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL }
});
params!(RdRec {
    Input { REQ: BOOL, IOID: BYTE, LADDR: WORD, RECNUM: BYTE }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL, RECORD: ANY }
});

pub(super) const ROWS: &[Row] = &[
    Row::asked::<DpNrmDg>(13, "DPNRM_DG", dpnrm_dg).note("answers in the same call"),
    Row::coded::<DpRdDat>(14, "DPRD_DAT", dprd_dat).note("the whole inputs of a module"),
    Row::coded::<DpWrDat>(15, "DPWR_DAT", dpwr_dat).note("the whole outputs of a module"),
    Row::asked::<WrRec>(58, "WR_REC", |call| {
        let to = (call.byte(WrRec::IOID), call.word(WrRec::LADDR), call.byte(WrRec::RECNUM));
        send_record(call, to, WrRec::RECORD)
    })
    .note("answers in the same call"),
    Row::asked::<RdRec>(59, "RD_REC", rd_rec).note("answers in the same call"),
];

/// No module has this logical address.
pub(super) const NO_MODULE: u16 = 0x8090;

/// The record of a module that is the diagnosis of a DP slave: beyond those that SFC 59 reads.
pub const DP_DIAGNOSIS: u8 = 255;
/// Bytes of the smallest RECORD: a diagnosis has at least these.
const DIAGNOSIS_HEAD: usize = 6;
/// Bytes that SFC 13 hands over, at most.
const DIAGNOSIS_BYTES: usize = 240;

/// RET_VAL: how many bytes were handed over.
fn dpnrm_dg(call: &mut Call<'_>) -> Code {
    let address = u32::from(call.word(DpNrmDg::LADDR));
    call.cx.module(address).map_err(|_| NO_MODULE)?;
    let mut buffer = [0; 256];
    let len = call.cx.record_read(address, DP_DIAGNOSIS, &mut buffer).map_err(|refused| match refused {
        // It is no DP slave.
        Refused::NoModule | Refused::NoRecord => NO_MODULE,
        _ => 0x80A2,
    })?;
    let (target, bytes) = call.record(DpNrmDg::RECORD)?;
    if !(DIAGNOSIS_HEAD..=DIAGNOSIS_BYTES).contains(&bytes) {
        return Err(0x80B1);
    }
    let len = len.min(bytes);
    call.write_at(&target, 0, &buffer[..len]).map_err(|e| write_error(4, e))?;
    Ok(len as u16)
}

fn dprd_dat(call: &mut Call<'_>) -> Code {
    let address = u32::from(call.word(DpRdDat::LADDR));
    let size = call.cx.module(address).map_err(|_| NO_MODULE)?;
    if size.inputs == 0 {
        return Err(0x8093);
    }
    let (target, bytes) = call.record(DpRdDat::RECORD)?;
    if bytes != usize::from(size.inputs) {
        return Err(0x80B1);
    }
    let mut buffer = [0; 256];
    let buffer = &mut buffer[..bytes];
    call.cx.io_read(address, buffer).map_err(|_| 0x80A0u16)?;
    call.write_at(&target, 0, buffer).map_err(|e| write_error(3, e))?;
    Ok(0)
}

fn dpwr_dat(call: &mut Call<'_>) -> Code {
    let address = u32::from(call.word(DpWrDat::LADDR));
    let size = call.cx.module(address).map_err(|_| NO_MODULE)?;
    if size.outputs == 0 {
        return Err(0x8093);
    }
    let (source, bytes) = call.record(DpWrDat::RECORD)?;
    if bytes != usize::from(size.outputs) {
        return Err(0x80B1);
    }
    let mut buffer = [0; 256];
    let buffer = &mut buffer[..bytes];
    call.read_at(&source, 0, buffer).map_err(|e| read_error(2, e))?;
    call.cx.io_write(address, buffer).map_err(|_| 0x80A1u16)?;
    Ok(0)
}

/// The code of a module's refusal; `access` is that of one that does not answer.
const fn refusal(refused: Refused, access: u16) -> u16 {
    match refused {
        Refused::NoModule => NO_MODULE,
        Refused::NoRecord => 0x80B0,
        Refused::Outside => 0x80B1,
        Refused::Busy => 0x80C0,
        _ => access,
    }
}

/// IOID: 54h for inputs, 55h for outputs.
pub(super) const fn is_io(id: u8) -> bool {
    matches!(id, 0x54 | 0x55)
}

/// Sends what RECORD names to a module as the record (IOID, LADDR, RECNUM). SFC 58 and SFC 55 do the same here: a
/// module has no parameters that are static.
pub(super) fn send_record(call: &mut Call<'_>, to: (u8, u16, u8), record: impl Params) -> Code {
    let (area, address, number) = to;
    if !is_io(area) {
        return Err(NO_MODULE);
    }
    // Records 0 and 1 are the system's own.
    if !(2..=240).contains(&number) {
        return Err(0x80B0);
    }
    let (source, bytes) = call.record(record)?;
    let mut buffer = [0; 256];
    let buffer = &mut buffer[..bytes];
    call.read_at(&source, 0, buffer).map_err(|e| read_error(record.index() + 1, e))?;
    call.cx.record_write(u32::from(address), number, buffer).map_err(|e| refusal(e, 0x80A1))?;
    Ok(0)
}

/// RET_VAL: 0 when the record fills RECORD, else the record's length.
fn rd_rec(call: &mut Call<'_>) -> Code {
    let (address, number) = (u32::from(call.word(RdRec::LADDR)), call.byte(RdRec::RECNUM));
    if !is_io(call.byte(RdRec::IOID)) {
        return Err(NO_MODULE);
    }
    if number > 240 {
        return Err(0x80B0);
    }
    let (target, bytes) = call.record(RdRec::RECORD)?;
    let mut buffer = [0; 256];
    let len = call.cx.record_read(address, number, &mut buffer[..bytes]).map_err(|e| refusal(e, 0x80A0))?;
    call.write_at(&target, 0, &buffer[..len]).map_err(|e| write_error(7, e))?;
    Ok(if len == bytes { 0 } else { len as u16 })
}

#[cfg(test)]
mod tests {
    use crate::ModuleSize;
    use crate::tests::{Fake, any};

    fn with_module(key: &str) -> Fake {
        let mut fake = Fake::new(key).with("RET_VAL", [9; 2]);
        fake.modules.insert(256, ModuleSize { inputs: 4, outputs: 2 });
        fake.modules.insert(300, ModuleSize { inputs: 0, outputs: 0 });
        fake.modules.insert(511, ModuleSize { inputs: 4, outputs: 4 });
        fake
    }

    #[test]
    fn whole_data_of_a_module() {
        for (address, record, code) in [
            (256u16, any(2, 4, 10), 0),
            (257, any(2, 4, 10), 0x8090),
            (300, any(2, 4, 10), 0x8093),
            (256, any(4, 2, 10), 0x8092),
            (256, any(2, 3, 10), 0x80B1),
            (511, any(2, 4, 10), 0x80A0),
            (256, any(2, 4, 254), 0x8323),
        ] {
            let mut fake = with_module("SYSTEM:SFC14").with("LADDR", address.to_be_bytes()).with("RECORD", record);
            fake.io[0][256..260].copy_from_slice(&[1, 2, 3, 4]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{address}");
            assert_eq!(fake.memory_at(10, 4) == [1, 2, 3, 4], code == 0);
        }
        for (address, record, code) in [
            (256u16, any(2, 2, 10), 0),
            (255, any(2, 2, 10), 0x8090),
            (256, any(2, 4, 10), 0x80B1),
            (511, any(2, 4, 10), 0x80A1),
        ] {
            let mut fake = with_module("SYSTEM:SFC15").with("LADDR", address.to_be_bytes()).with("RECORD", record);
            fake.memory(10, &[7, 8]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{address}");
            assert_eq!(fake.io[1][256..258] == [7, 8], code == 0);
        }
    }

    #[test]
    fn records() {
        for (req, io, address, number, room, code) in [
            (1, 0x54, 256u16, 5, 4, 0),
            (1, 0x55, 256, 5, 10, 4),
            (0, 0x54, 256, 5, 4, 0x7000),
            (1, 0x56, 256, 5, 4, 0x8090),
            (1, 0x54, 300, 5, 4, 0x8090),
            (1, 0x54, 256, 6, 4, 0x80B0),
            (1, 0x54, 256, 241, 4, 0x80B0),
            (1, 0x54, 256, 5, 3, 0x80B1),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC59").with("REQ", [req]).with("IOID", [io]).with("RECNUM", [number]);
            fake.records.insert((256, 5), vec![1, 2, 3, 4]);
            fake = fake.with("LADDR", address.to_be_bytes()).with("RECORD", any(2, room, 10));
            fake = fake.with("RET_VAL", [9; 2]).with("BUSY", [1]);
            fake.run();
            assert_eq!(
                (fake.value("RET_VAL"), fake.value("BUSY"), fake.br),
                (code, 0, code < 0x8000),
                "{address} {number}"
            );
        }
        for (number, code) in [(2, 0), (1, 0x80B0), (3, 0x80B0)] {
            let mut fake = Fake::new("SYSTEM:SFC58").with("REQ", [1]).with("IOID", [0x54]).with("RECNUM", [number]);
            fake.records.insert((256, 2), vec![]);
            fake.memory(10, &[5, 6]);
            fake = fake.with("LADDR", [1, 0]).with("RECORD", any(2, 2, 10)).with("RET_VAL", [9; 2]).with("BUSY", [1]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY")), (code, 0));
            assert_eq!(fake.records[&(256, 2)] == [5, 6], code == 0);
        }
    }

    #[test]
    fn the_diagnosis_of_a_slave() {
        let whole = [8, 12, 0, 2, 0x80, 0x1D, 0x42, 1];
        for (req, address, record, code) in [
            (1, 256u16, any(2, 8, 10), 8),
            (1, 256, any(2, 20, 10), 8),
            (1, 256, any(2, 6, 10), 6),
            (0, 256, any(2, 8, 10), 0x7000),
            (1, 511, any(2, 8, 10), 0x8090),
            (1, 257, any(2, 8, 10), 0x8090),
            (1, 256, any(2, 5, 10), 0x80B1),
            (1, 256, any(2, 241, 10), 0x80B1),
        ] {
            let mut fake = with_module("SYSTEM:SFC13").with("REQ", [req]).with("BUSY", [1]).with("RECORD", record);
            fake.records.insert((256, super::DP_DIAGNOSIS), whole.to_vec());
            fake = fake.with("LADDR", address.to_be_bytes());
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY"), fake.br), (code, 0, code < 0x8000), "{address}");
            if (6..0x7000).contains(&code) {
                assert_eq!(fake.memory_at(10, code as usize), &whole[..code as usize]);
            }
        }
    }
}
