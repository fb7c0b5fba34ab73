//! RK 512: jobs of P_SND_RK as headers of telegrams, and headers of the partner as offers to P_RCV_RK.
//! [TIA help "PtP data link CP 341"]

use ob1_protocols::rk512::{Area, Command, Coordination, Flag, Request};

use super::receive::Offer;
use ob1_words::channels::{Job, NO_FLAG, Offered as Kind};

/// STATUS numbers of impossible parameters. (docs/cp341-events.md)
const TYPE: u16 = 0x0301;
const ADDRESS: u16 = 0x0514;
const FLAG_BIT: u16 = 0x0515;
const CPU: u16 = 0x0516;
const LENGTH: u16 = 0x0518;

/// The header of its telegram.
///
/// # Errors
/// STATUS: 0301h type or SF, 0514h start address or number, 0515h flag bit, 0516h CPU number, 0518h length.
pub(crate) fn request(job: &Job) -> Result<Request, u16> {
    let command = match job.sf {
        b'S' => Command::Send,
        b'F' => Command::Fetch,
        _ => return Err(TYPE),
    };
    let area = area(job.r_typ).ok_or(TYPE)?;
    let is_block = matches!(area, Area::Db | Area::Dx);
    if command == Command::Send && !is_block {
        return Err(TYPE);
    }
    let (db, start) = if is_block {
        // Words; an odd byte is rounded down: 7 is 6.
        let db = u8::try_from(job.r_no).ok().filter(|db| *db > 0);
        (db.ok_or(ADDRESS)?, (0..=510).contains(&job.r_offset).then_some(job.r_offset / 2).ok_or(ADDRESS)?)
    } else {
        (0, (0..=255).contains(&job.r_offset).then_some(job.r_offset).ok_or(ADDRESS)?)
    };
    let units = usize::try_from(job.len).unwrap_or(0).div_ceil(area.unit());
    let length = u16::try_from(units).map_err(|_| LENGTH)?;
    let coordination = Coordination::new(flag(job)?, cpu(job)?);
    Ok(Request { command, area, db, start: start as u8, length, coordination })
}

fn flag(job: &Job) -> Result<Option<Flag>, u16> {
    if job.r_cf_byt as u16 == NO_FLAG {
        return Ok(None);
    }
    let byte = u8::try_from(job.r_cf_byt).map_err(|_| TYPE)?;
    let bit = u8::try_from(job.r_cf_bit).ok().filter(|bit| *bit <= 7).ok_or(FLAG_BIT)?;
    Ok(Some(Flag { byte, bit }))
}

/// "Without coordination flag and R_CPU_NO <= 1" FFh is sent: the default of R_CPU_NO is 1. (docs/cp341.md)
fn cpu(job: &Job) -> Result<Option<u8>, u16> {
    match job.r_cpu_no {
        0 | 1 => Ok(None),
        number @ 2..=4 => Ok(Some(number as u8)),
        _ => Err(CPU),
    }
}

/// The area of a letter at R_TYP: the German ones, and the English tools' for E, A and Z. Upper case only.
/// [TIA help "PtP data link CP 341"]
fn area(letter: u8) -> Option<Area> {
    match letter {
        b'I' => Some(Area::Inputs),
        b'O' | b'Q' => Some(Area::Outputs),
        b'C' => Some(Area::Counters),
        letter => Area::of(letter),
    }
}

/// A job of the partner as P_RCV_RK sees it.
pub(crate) fn offer(request: &Request) -> Offer {
    let is_block = matches!(request.area, Area::Db | Area::Dx);
    let l_offset = u16::from(request.start) * if is_block { 2 } else { 1 };
    // The machine has checked the flag: only a valid flag or none gets here.
    let flag = request.coordination.flag(u8::MAX - 1).ok().flatten();
    Offer {
        kind: if request.command == Command::Send { Kind::Receive } else { Kind::Provide },
        len: request.bytes(),
        l_typ: request.area.letter(),
        l_no: request.db,
        l_offset,
        flag: flag.map_or((0xFF, 0), |flag| (flag.byte, flag.bit)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOB: Job =
        Job { sf: b'S', r_typ: b'D', len: 10, r_cpu_no: 1, r_no: 5, r_offset: 7, r_cf_byt: 255, r_cf_bit: 0 };

    #[test]
    fn headers_are_those_of_the_tables() {
        let fetch = Job { sf: b'F', ..JOB };
        for (job, header) in [
            (JOB, *b"\0\0AD\x05\x03\0\x05\xFF\xFF"),
            (Job { r_typ: b'X', len: 11, ..JOB }, *b"\0\0OD\x05\x03\0\x06\xFF\xFF"),
            (Job { r_cf_byt: 6, r_cf_bit: 4, ..JOB }, *b"\0\0AD\x05\x03\0\x05\x06\x04"),
            (Job { r_cf_byt: 6, r_cf_bit: 4, r_cpu_no: 3, ..JOB }, *b"\0\0AD\x05\x03\0\x05\x06\x34"),
            (Job { r_cpu_no: 4, ..JOB }, *b"\0\0AD\x05\x03\0\x05\xFF\x4F"),
            (Job { r_typ: b'M', len: 32, r_offset: 16, r_no: 99, ..fetch }, *b"\0\0EM\0\x10\0\x20\xFF\xFF"),
            (Job { r_typ: b'I', ..fetch }, *b"\0\0EE\0\x07\0\x0A\xFF\xFF"),
            (Job { r_typ: b'O', ..fetch }, *b"\0\0EA\0\x07\0\x0A\xFF\xFF"),
            (Job { r_typ: b'C', len: 20, ..fetch }, *b"\0\0EZ\0\x07\0\x0A\xFF\xFF"),
            (Job { r_typ: b'T', len: 20, ..fetch }, *b"\0\0ET\0\x07\0\x0A\xFF\xFF"),
            (Job { len: 4096, r_offset: 510, r_no: 255, ..JOB }, *b"\0\0AD\xFF\xFF\x08\0\xFF\xFF"),
        ] {
            assert_eq!(request(&job).map(|request| request.header()), Ok(header), "{job:?}");
        }
    }

    #[test]
    fn what_cannot_be_has_its_status() {
        for (job, status) in [
            (Job { sf: b's', ..JOB }, 0x0301),
            (Job { r_typ: b'd', ..JOB }, 0x0301),
            (Job { r_typ: b'M', ..JOB }, 0x0301),
            (Job { sf: b'F', r_typ: b'B', ..JOB }, 0x0301),
            (Job { r_no: 0, ..JOB }, 0x0514),
            (Job { r_no: 256, ..JOB }, 0x0514),
            (Job { r_offset: -1, ..JOB }, 0x0514),
            (Job { r_offset: 511, ..JOB }, 0x0514),
            (Job { sf: b'F', r_typ: b'M', r_offset: 256, ..JOB }, 0x0514),
            (Job { r_cf_byt: 256, ..JOB }, 0x0301),
            (Job { r_cf_byt: 6, r_cf_bit: 8, ..JOB }, 0x0515),
            (Job { r_cpu_no: 5, ..JOB }, 0x0516),
        ] {
            assert_eq!(request(&job).map(|_| ()), Err(status), "{job:?}");
        }
    }
}
