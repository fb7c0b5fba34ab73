//! The data blocks of handling blocks: whether they are there, and long enough for what is known of the order.

use ob1_ir::{Program, Target};
use ob1_model::BlockKind;
use ob1_params::CpKind;

use super::sites::{Site, calls};
use super::{DATA, Told, module_at};
use ob1_station_file::{AbdUnit, ModuleKind, Station};

/// Where an order has its data: names of the parameters.
struct Data {
    /// The parameter that names the data block.
    db: &'static str,
    /// Where the data begin in it.
    begin: &'static str,
    /// How long they are; empty: known in the run only.
    length: &'static str,
    /// Bytes of a unit of `begin`, and of a unit of `length`; 0: the station file says it (`abd`).
    units: (u32, u32),
}

/// The data of a call in this CPU.
fn data_of(site: &Site<'_>) -> &'static [Data] {
    const fn bytes(db: &'static str, begin: &'static str, length: &'static str) -> Data {
        Data { db, begin, length, units: (1, 1) }
    }
    const fn words(db: &'static str, begin: &'static str) -> Data {
        Data { db, begin, length: "LANG", units: (2, 2) }
    }
    const SEND_240: &[Data] = &[Data { db: "_DB", begin: "ABD", length: "ANZ", units: (0, 1) }];
    const RECEIVE_240: &[Data] = &[Data { db: "_DB", begin: "ABD", length: "", units: (0, 1) }];
    const SEND_RK: &[Data] = &[words("QDB", "QBDW")];
    const FETCH_RK: &[Data] = &[words("ZDB", "ZBDW")];
    const SEND: &[Data] = &[bytes("DB_NO", "DBB_NO", "LEN")];
    const RECEIVE: &[Data] = &[bytes("DB_NO", "DBB_NO", "")];
    const BOTH: &[Data] = &[bytes("DB_NO_SEND", "DBB_NO_SEND", "LEN_SEND"), bytes("DB_NO_RECV", "DBB_NO_RECV", "")];
    match (site.block.cp, site.block.original.number) {
        (CpKind::Cp240, 0) => SEND_240,
        (CpKind::Cp240, 1 | 11) => RECEIVE_240,
        (CpKind::Cp240, 2) => FETCH_RK,
        (CpKind::Cp240, 3) => SEND_RK,
        (CpKind::Cp341, 8) | (CpKind::Cp340, 3) | (CpKind::Cp040, 60) => SEND,
        (CpKind::Cp340, 2) | (CpKind::Cp040, 61) => RECEIVE,
        (CpKind::Cp040, 65) => BOTH,
        _ => &[],
    }
}

/// A data block of this call that is missing or too short.
pub(super) fn of(program: &Program, station: &Station, site: &Site<'_>) -> Option<Told> {
    data_of(site).iter().find_map(|data| wrong(program, station, site, data))
}

fn wrong(program: &Program, station: &Station, site: &Site<'_>, data: &Data) -> Option<Told> {
    let number = site.fixed(data.db).or_else(|| u16::try_from(site.constant(data.db)?).ok()).filter(|db| *db > 0)?;
    let id = site.id;
    let (missing, short) = match site.block.cp {
        CpKind::Cp240 => ("PAFE 1", "PAFE 2"),
        _ => ("ERROR", "ERROR"),
    };
    let Some(db) = program.data.iter().find(|db| db.number == number) else {
        if makes_data_blocks(program) {
            return None;
        }
        let message = format!("{id} works with DB {number}, which the program does not have");
        let remedy =
            format!("the call ends with {missing}; add DATA_BLOCK DB {number}, or name the source that has it");
        return Some((DATA, message, remedy));
    };
    let unit = |given: u32| if given == 0 { abd_bytes(station, site) } else { given };
    let begin = site.constant(data.begin)? * unit(data.units.0);
    // 4000h is the output area of a Modbus slave. [S0 L2311]
    let length = site.constant(data.length).map(|length| if data.db == "_DB" { length & 0x3FFF } else { length });
    // At least a byte has to find room.
    let end = begin + length.filter(|length| *length > 0).map_or(1, |length| length * unit(data.units.1));
    let has = db.bytes.len() as u32;
    (end > has).then(|| {
        let what = match length {
            Some(_) => format!("bytes {begin} to {}", end - 1),
            None => format!("the bytes from {begin} on"),
        };
        let message = format!("{id} needs {what} of DB {number}, which has {has} bytes");
        let remedy = format!("the call ends with {short}; make the data block longer, or correct {}", data.begin);
        (DATA, message, remedy)
    })
}

/// What a unit of ABD is at the CP of this call. If the CP is not known: a byte, which needs the least.
fn abd_bytes(station: &Station, site: &Site<'_>) -> u32 {
    let module = site.address().and_then(|address| module_at(station, address));
    match module.map(|module| &module.kind) {
        Some(ModuleKind::Cp240 { abd: AbdUnit::Word, .. }) => 2,
        _ => 1,
    }
}

/// Whether the program can make data blocks in the run: SFC 22, SFC 82, SFC 85.
fn makes_data_blocks(program: &Program) -> bool {
    program.blocks.iter().flat_map(calls).any(|(_, call)| match call.target {
        Target::Block(id) => id.kind == BlockKind::Sfc && matches!(id.number, 22 | 82 | 85),
        _ => false,
    })
}
