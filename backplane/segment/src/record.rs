//! The diagnostic record (SFC 51, 59) and the parameter record: longer contents under a sequence lock.

use crate::bytes::{copy_out, words_of};
use crate::cells::{PARAMS_WORDS, RECORD_WORDS, RecordCells};
use crate::fault::{Fault, TooLong};
use crate::layout::{JSON_BYTES, PARAMETER_BYTES, RECORD_BYTES};
use crate::seqlock::{Freshness, SeqCell, SeqReader};

/// A data record, copied out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Number of the record, as in `RD_REC`.
    pub number: u32,
    /// Changes with every record written (an attaching driver writes an empty one); 0 before the first.
    pub revision: u64,
    /// Whether it is the newest one.
    pub freshness: Freshness,
    len: usize,
    data: [u8; RECORD_BYTES],
}

impl Record {
    /// Its data: at most 240 bytes.
    pub fn data(&self) -> &[u8] {
        self.data.get(..self.len).unwrap_or_default()
    }
}

/// Writes a record. There is one writer at a time.
pub(crate) fn write_record(cells: &RecordCells, number: u32, data: &[u8]) -> Result<(), TooLong> {
    if data.len() > RECORD_BYTES {
        return Err(TooLong { found: data.len(), room: RECORD_BYTES });
    }
    cells.record.write([u64::from(number), data.len() as u64].into_iter().chain(words_of(data)));
    Ok(())
}

/// Replaces the record by an empty one, and completes a write that a dead writer may have left unfinished.
pub(crate) fn clear_record(cells: &RecordCells) {
    cells.record.write([0, 0].into_iter());
}

/// Reads a record; the number is cut to 32 bits, the length is checked.
pub(crate) fn read_record(reader: &mut SeqReader<RECORD_WORDS>, cells: &RecordCells) -> Result<Record, Fault> {
    let freshness = reader.read(&cells.record, RECORD_WORDS);
    let [number, claimed, words @ ..] = reader.last();
    let len = match usize::try_from(*claimed) {
        Ok(len) if len <= RECORD_BYTES => len,
        _ => return Err(Fault::RecordLength(*claimed)),
    };
    let mut data = [0; RECORD_BYTES];
    copy_out(words, &mut data);
    Ok(Record { number: *number as u32, revision: reader.sequence(), freshness, len, data })
}

/// The configuration of a CP, as the driver reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Params<'a> {
    /// Changes with every transfer (even one of the same content); 0 before the first.
    pub revision: u64,
    /// Whether it is the newest one.
    pub freshness: Freshness,
    /// The module's parameter bytes.
    pub bytes: [u8; PARAMETER_BYTES],
    /// The driver's configuration as JSON text. Nothing is checked here.
    pub json: &'a [u8],
}

/// Writes the parameter record. There is one writer at a time.
pub(crate) fn write_params(
    cells: &SeqCell<PARAMS_WORDS>,
    bytes: &[u8; PARAMETER_BYTES],
    json: &[u8],
) -> Result<(), TooLong> {
    if json.len() > JSON_BYTES {
        return Err(TooLong { found: json.len(), room: JSON_BYTES });
    }
    cells.write([json.len() as u64].into_iter().chain(words_of(bytes)).chain(words_of(json)));
    Ok(())
}

/// Reads the parameter record into `json` (made once, as large as the area) and checks its length.
pub(crate) fn read_params<'a>(
    reader: &mut SeqReader<PARAMS_WORDS>,
    cells: &SeqCell<PARAMS_WORDS>,
    json: &'a mut [u8; JSON_BYTES],
) -> Result<Params<'a>, Fault> {
    let freshness = reader.read(cells, PARAMS_WORDS);
    let [claimed, low, high, words @ ..] = reader.last();
    let text = usize::try_from(*claimed).ok().and_then(|len| json.get_mut(..len));
    let text = text.ok_or(Fault::ParameterLength(*claimed))?;
    copy_out(words, text);
    let mut bytes = [0; PARAMETER_BYTES];
    copy_out(&[*low, *high], &mut bytes);
    Ok(Params { revision: reader.sequence(), freshness, bytes, json: text })
}
