//! SFC 6 RD_SINFO, SFC 51 RDSYSST, SFC 78 OB_RT. ["Diagnostics"]

use crate::Refused;
use crate::call::{Call, Code, write_error};
use crate::declare::params;
use crate::row::Row;
use crate::services::StatusError;

params!(RdSinfo { Return { RET_VAL: INT } Output { TOP_SI: START_INFO, START_UP_SI: START_INFO } });
params!(RdSysSt {
    Input { REQ: BOOL, SZL_ID: WORD, INDEX: WORD }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL, SZL_HEADER: SZL_HEADER, DR: ANY }
});
params!(ObRt {
    Input { OB_NR: INT }
    Return { RET_VAL: INT }
    Output { PRIO: INT, LAST_RT: DINT, LAST_ET: DINT, CUR_T: DINT, CUR_RT: DINT, CUR_ET: DINT, NEXT_ET: DINT }
});

pub(super) const ROWS: &[Row] = &[
    Row::coded::<RdSinfo>(6, "RD_SINFO", rd_sinfo),
    Row::asked::<RdSysSt>(51, "RDSYSST", rdsysst).note("answers in the same call"),
    Row::coded::<ObRt>(78, "OB_RT", ob_rt),
];

fn rd_sinfo(call: &mut Call<'_>) -> Code {
    let info = call.cx.services();
    let (top, start_up) = (info.current(), info.start_up());
    // Structures of twelve bytes, both outputs.
    let _ = call.cx.write(RdSinfo::TOP_SI as u32, 0, &top);
    let _ = call.cx.write(RdSinfo::START_UP_SI as u32, 0, &start_up);
    Ok(0)
}

/// The extract of an SZL-ID that stands for "header information only".
const HEADER_ONLY: u16 = 0x0F00;
/// Bytes of a system status list: the most that reaches DR.
const LIST: usize = 2048;

/// DR takes as many whole records as it has room for, RET_VAL is 0081h when some are missing, and 8081h when there is
/// no room for one. SZL_HEADER tells the length of a record and how many are in DR; of an extract "header information
/// only" (xFyz), how many there are.
fn rdsysst(call: &mut Call<'_>) -> Code {
    let (id, index) = (call.word(RdSysSt::SZL_ID), call.word(RdSysSt::INDEX));
    let target = call.any(RdSysSt::DR);
    let room = target.and_then(|any| any.bytes()).unwrap_or(0).min(LIST as u32) as usize;
    let mut buffer = [0; LIST];
    let (mut records, mut kept, mut used) = (0u16, 0u16, 0usize);
    let header_only = id & HEADER_ONLY == HEADER_ONLY;
    let list = if header_only { id & !HEADER_ONLY } else { id };
    let listed = call.cx.services().list(list, index, &mut |record| {
        records = records.saturating_add(1);
        let end = used + record.len();
        if records == kept + 1 && end <= room {
            buffer[used..end].copy_from_slice(record);
            (kept, used) = (records, end);
        }
    });
    let length = listed.map_err(StatusError::code)?;
    if !header_only {
        target.ok_or(write_error(7, Refused::NoParam))?;
        if kept == 0 && records > 0 {
            return Err(0x8081);
        }
    }
    let [[a, b], [c, d]] = [length, if header_only { records } else { kept }].map(u16::to_be_bytes);
    let _ = call.cx.write(RdSysSt::SZL_HEADER as u32, 0, &[a, b, c, d]);
    if let Some(any) = target.filter(|_| !header_only) {
        call.write_at(&any, 0, &buffer[..used]).map_err(|e| write_error(7, e))?;
    }
    Ok(if !header_only && kept < records { 0x0081 } else { 0 })
}

/// RET_VAL is the OB's number. The general code of a wrong first parameter for an OB that has no run times.
fn ob_rt(call: &mut Call<'_>) -> Code {
    let ob = call.word(ObRt::OB_NR);
    let times = if matches!(ob, 121 | 122) { None } else { call.cx.services().run_times(ob) };
    let times = times.ok_or(0x8080_u16)?;
    call.set(ObRt::PRIO, u32::from(times.priority));
    call.set(ObRt::LAST_RT, times.last_run);
    call.set(ObRt::LAST_ET, times.last_whole);
    call.set(ObRt::CUR_T, times.request);
    call.set(ObRt::CUR_RT, times.current_run);
    call.set(ObRt::CUR_ET, times.current_whole);
    call.set(ObRt::NEXT_ET, times.next);
    Ok(times.ob)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, any};

    #[test]
    fn start_information() {
        let mut fake = Fake::new("SYSTEM:SFC6").with("RET_VAL", [9; 2]);
        fake = fake.with("TOP_SI", [0; 12]).with("START_UP_SI", [0; 12]);
        fake.run();
        let result = (fake.bytes("TOP_SI"), fake.bytes("START_UP_SI"), fake.value("RET_VAL"));
        assert_eq!(result, (&[1; 12][..], &[2; 12][..], 0));
    }

    #[test]
    fn status_lists() {
        for (req, id, index, room, code, header, data) in [
            (1, 0x0011u16, 0u16, 8, 0, [0, 3, 0, 2], [1, 2, 3, 4, 5, 6]),
            (1, 0x0011, 0, 5, 0x0081, [0, 3, 0, 1], [1, 2, 3, 0, 0, 0]),
            (1, 0x0011, 0, 2, 0x8081, [0; 4], [0; 6]),
            (1, 0x0011, 1, 8, 0x8083, [0; 4], [0; 6]),
            (1, 0x0012, 0, 8, 0x8085, [0; 4], [0; 6]),
            (1, 0x0F11, 0, 8, 0, [0, 3, 0, 2], [0; 6]),
            (1, 0x0F13, 0, 8, 0x8082, [0; 4], [0; 6]),
            (0, 0x0011, 0, 8, 0x7000, [0; 4], [0; 6]),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC51").with("REQ", [req]).with("SZL_ID", id.to_be_bytes());
            fake = fake.with("INDEX", index.to_be_bytes()).with("RET_VAL", [9; 2]).with("BUSY", [1]);
            fake = fake.with("SZL_HEADER", [0; 4]).with("DR", any(2, room, 20));
            fake.station.status = vec![vec![1, 2, 3], vec![4, 5, 6]];
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("BUSY"), fake.bytes("SZL_HEADER"), fake.memory_at(20, 6));
            assert_eq!(result, (code, 0, &header[..], &data[..]), "{id:04X} {index} {room}");
        }
    }

    #[test]
    fn run_times() {
        let names = ["PRIO", "LAST_RT", "LAST_ET", "CUR_T", "CUR_RT", "CUR_ET", "NEXT_ET"];
        for (ob, code) in [(0u16, 1), (1, 1), (35, 0x8080), (121, 0x8080)] {
            let mut fake = Fake::new("SYSTEM:SFC78").with("OB_NR", ob.to_be_bytes()).with("RET_VAL", [9; 2]);
            for name in names {
                fake = fake.with(name, if name == "PRIO" { vec![0; 2] } else { vec![0; 4] });
            }
            fake.run();
            let values = names.map(|name| fake.value(name));
            let good = code == 1;
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, good), "OB {ob}");
            assert_eq!(values, if good { [1, 2, 3, 4, 5, 6, 7] } else { [0; 7] }, "OB {ob}");
        }
    }
}
