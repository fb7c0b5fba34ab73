//! System status lists that only links ask for: communication, protection, process image partitions, racks.
//!
//! What belongs to a connection (its PDU, its level of protection) the link puts in; a program that asks with SFC 51
//! sees zeros there. ["System Status Lists (SSL)" of the system software reference]

use ob1_std::services::StatusError;

use crate::modules::{Modules, Plugged};
use crate::szl_record::{Each, Length, Record};

/// Bytes of a record of lists xy31 and xy32.
const COMMUNICATION: u16 = 40;
/// Bytes of a record of list xy25.
const PARTITION: u16 = 4;
/// Bytes of a record of list xy92: a bit for each rack or station.
const RACKS: u16 = 16;

/// List 0131: what can be done by communication. Clients that know no index ask for 0: they mean the general record.
pub(crate) fn capabilities(index: u16, each: Each<'_>) -> Length {
    let index = index.max(1);
    let record = Record::<40>::new().word(index);
    let record = match index {
        // PDU and connections: the link's. Data rates of MPI and K bus: there are none.
        1 => record.word(0).word(0).long(0).long(0),
        // Test functions: status and modify of variables; so many addresses in a job.
        2 => record.put(&[0b0000_0100, 0b0000_0001, 0, 0, 0, 0]).word(64).word(64),
        // Operator interface: reading once and cyclically; so many words at once and jobs, from 100 ms to 10 s * 255.
        3 => record.put(&[0b0001_1111, 0, 0, 0]).word(480).word(8).word(1).word(25_500),
        // Diagnosis: identification, status lists, buffer, messages.
        4 => record.put(&[0b0001_1111, 0b0000_0011, 0, 0, 0, 0]).word(128).word(128).word(8),
        _ => return Err(StatusError::Index),
    };
    each(&record.bytes);
    Ok(COMMUNICATION)
}

/// Lists 0132 and 0232: the current state of communication. Of 0232 there is one record: protection.
pub(crate) fn communication(list: u16, index: u16, each: Each<'_>) -> Length {
    let index = if (list, index) == (0x0232, 0) { 4 } else { index };
    let record = Record::<40>::new().word(index);
    let record = match index {
        // Connections kept for programming devices; the others are taken as they come.
        1 => record.word(1).word(0),
        // The levels by the mode selector and by parameters (none), that in force; the selector at RUN-P; no switch for
        // the kind of restart.
        4 => record.word(1).word(0).word(1).word(2).word(0),
        _ => return Err(StatusError::Index),
    };
    each(&record.bytes);
    Ok(COMMUNICATION)
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
