//! System status lists that only links ask for: communication, protection, process image partitions, racks.
//!
//! What belongs to a connection (its PDU, its level of protection) the link puts in; a program that asks with SFC 51
//! sees zeros there. ["System Status Lists (SSL)" of the system software reference]

use ob1_model::{CYCLIC_300, CYCLIC_400};
use ob1_std::services::StatusError;

use crate::Family;
use crate::modules::{Modules, Plugged};
use crate::szl_record::{Each, Length, Record};

/// Bytes of a record of lists xy31 and xy32.
const COMMUNICATION: u16 = 40;
/// Bytes of a record of list xy25.
const PARTITION: u16 = 4;
/// Bytes of a record of list xy92: a bit for each rack or station.
const RACKS: u16 = 16;

/// List 0131: what can be done by communication. Clients that know no index ask for 0: they mean the general record.
/// Index 8, the times of the test functions, and 7 are not there in an S7-300 either.
pub(crate) fn capabilities(family: Family, index: u16, each: Each<'_>) -> Length {
    let index = index.max(1);
    let large = family == Family::S7_400;
    let cyclic = if large { CYCLIC_400 } else { CYCLIC_300 };
    let record = Record::<40>::new().word(index);
    let record = match index {
        // PDU and connections: the link's. Data rates of MPI and K bus, as those of a 315-2 PN/DP.
        1 => record.word(0).word(0).long(12_000_000).long(187_500).long(100_000_000),
        // Test functions: which ones, is the link's. No area that only an S7-400 has; triggers at once, cycle start and
        // end, RUN to STOP, code addresses; so many bytes, items and lines in a job.
        2 => record
            .put(&[0, 0, 0, 0, 0, 0, 0, 0, 8, 0, 0, 0])
            // Triggers: at once, cycle start and end, RUN to STOP, code address area.
            .put(&[0x3C, 0x01, 0x08, 0, 0, 0, 0x5D, 0, 0, 0x05, 0x03, 0x0F, 0, 0])
            .word(0x0800)
            .word(12)
            .word(10)
            .word(0)
            .word(1),
        // Operator interface: reading once and cyclically; P, I, Q, M, DB, timers, counters; bytes of a job; cyclic
        // jobs, their shortest and longest period. An S7-400 has all bits of the first two bytes. [recorded]
        3 => {
            let functions = if large { [0xFF, 0xFF] } else { [0x7F, 0xFC] };
            let record = record.put(&functions).put(&[0x83, 0x01]).word(cyclic.bytes).word(cyclic.jobs);
            record.word(1).word(cyclic.longest)
        }
        // Diagnosis: identification, status lists, buffer, messages.
        4 => record.put(&[0xFE, 0x01, 0x62, 0x41, 0x63, 0, 0x1E, 0, 0x10, 0x10, 0x10, 0x04, 0x02, 0]).word(2).word(2),
        // Diagnostic messages: kinds, partners at one time, entries of the buffer.
        5 => record.put(&[0x3E, 0, 0, 0, 0, 0, 0, 0]).word(12).word(crate::DIAG_ENTRIES as u16).word(0),
        // Blocks of communication and of messages: SFC 17, 18, 19; of an S7-400 also SFB 31, 33 to 37, SFC 9, 10.
        6 if large => record
            .put(&[0xF3, 0, 0xE0, 0xFB, 0x01, 0xF0, 0xFF, 0x7E, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4])
            .put(&[0, 0, 0, 0x20, 1, 0, 0, 0x0A, 0, 0x4C, 0xFF, 0xFF, 0x05, 0xC0]),
        6 => record
            .put(&[0xF3, 0, 0, 0xF8, 0x01, 0xF0, 0xFF, 0x4E, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4])
            .put(&[0, 0, 0, 0x20, 1, 0, 0, 0x0A, 0, 0x4C, 0xFF, 0xFF, 0x05, 0xC0]),
        // Global data and time synchronization: not of a network.
        9 => record.put(&[1, 1, 1, 0]).word(503).word(503).word(1).word(1),
        // Messages about blocks, of an S7-400 only: kinds; areas of signals (I, Q, M, DB); areas and types of their
        // values; archives of AR_SEND. [recorded]
        0x10 if large => record.put(&[0x3F, 0, 0x0F, 0, 0x3F, 0, 0x7F, 0]).word(64),
        _ => return Err(StatusError::Index),
    };
    each(&record.bytes);
    Ok(COMMUNICATION)
}

/// Lists 0132 and 0232: the current state of communication. Of 0232 there is one record: protection. Checksums of the
/// program are the broker's.
pub(crate) fn communication(list: u16, index: u16, now: [u8; 8], each: Each<'_>) -> Length {
    let index = if (list, index) == (0x0232, 0) { 4 } else { index };
    let record = Record::<40>::new().word(index);
    let record = match index {
        _ if list == 0x0232 && index != 4 => return Err(StatusError::Index),
        // Connections kept for programming devices and for operator panels; one of a programming device in use; free
        // ones; their load.
        1 => record.word(1).word(1).word(1).word(0).word(1).word(0).word(10).word(0).word(20),
        // Test jobs and their room.
        2 => record.long(0).word(0).word(14).long(0).word(0x0601).word(0x0800),
        // The levels by the mode selector and by parameters (none), that in force; the selector at RUN-P; no switch for
        // the kind of restart; checksums are there.
        4 => record.word(1).word(0).word(1).word(2).long(0).put(&[0x56, 0x56]).long(0).long(0).put(&[2]),
        // Diagnosis, blocks of communication, time of day, data rate, global data.
        5 | 6 | 11 => record,
        8 => record.put(&[0; 20]).put(&now),
        9 => record.long(100_000_000),
        _ => return Err(StatusError::Index),
    };
    each(&record.bytes);
    Ok(COMMUNICATION)
}

/// Lists of things that a station does not have: they are empty. Any other list does not exist.
pub(crate) const fn empty(id: u16) -> Length {
    Ok(match id {
        // Expansion units; interrupts and priority classes; partial images.
        0x0002 => 2,
        0x0017 | 0x0117 | 0x0018 | 0x0118 => 8,
        0x0021 | 0x0A21 => 4,
        0x0023 => 10,
        0x0125 | 0x0225 => PARTITION,
        // Interfaces: those of the machine are not the station's. Connections of blocks.
        0x0036 | 0x0136 | 0x0038 | 0x0138 | 0x0238 | 0x0139 => 40,
        0x0037 | 0x0137 => 48,
        0x003A => 148,
        // Submodules, stations and devices of PROFINET.
        0x0591 => 16,
        0x0094 | 0x0194 | 0x0294 | 0x0694 | 0x0794 => 258,
        0x0095 | 0x0195 => 40,
        0x0696 | 0x0C96 | 0x0C97 | 0x0D97 => 48,
        0x009A | 0x019A | 0x029A | 0x009B | 0x0C9B | 0x009C | 0x019C | 0x029C | 0x039C => 24,
        // Data records of modules, by other ways of addressing them.
        0x00B4..=0x00B6 | 0x01B5..=0x01B6 | 0x02B5..=0x02B6 | 0x03B5..=0x03B6 | 0x04B5..=0x04B6 => 4,
        0x05B5 | 0x06B5 | 0x07B5 | 0x08B5 => 4,
        _ => return Err(StatusError::Id),
    })
}

/// List 0025: which organization block updates which partition of the process image. There is one image.
pub(crate) const fn partitions() -> Length {
    Ok(PARTITION)
}

/// Lists 0092, 0292, 0692: racks (index 0) or stations of a master system (its number) that are configured, there, and
/// well. There is rack 0; station n is bit n - 1.
pub(crate) fn racks(modules: &Modules, list: u16, index: u16, each: Each<'_>) -> Length {
    let mut bits = [0_u8; RACKS as usize];
    if index == 0 {
        bits[0] = 1;
        each(&bits);
        return Ok(RACKS);
    }
    let on = |plugged: &&Plugged| plugged.slot.bus.is_some_and(|place| u16::from(place.master) == index);
    let stations = modules.list.iter().filter(on);
    let mut missing = [0_u8; RACKS as usize];
    let mut any = false;
    for plugged in stations {
        let Some(bit) = plugged.slot.bus.and_then(|place| place.station.checked_sub(1)) else { continue };
        let (byte, mask) = (usize::from(bit / 8) % bits.len(), 1 << (bit % 8));
        any = true;
        bits[byte] |= mask;
        missing[byte] |= if plugged.module.status().present { 0 } else { mask };
    }
    if !any {
        return Err(StatusError::Index);
    }
    if list != 0x0092 {
        bits.iter_mut().zip(missing).for_each(|(byte, missing)| *byte &= !missing);
    }
    each(&bits);
    Ok(RACKS)
}
