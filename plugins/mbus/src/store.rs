//! Writes an answer into a data block: the header, then the records one after the other.

use crate::records::{Answer, Fault, HEADER_BYTES, Header, RECORD_BYTES};
use ob1_sdk::{Abort, Area, Cx};

use crate::status;

/// What became of an answer: STATUS, number of records written, whether records were left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Written {
    pub(crate) status: u16,
    pub(crate) count: u16,
    pub(crate) more: bool,
}

/// Writes the records of an answer (C, A, CI field, data) into this data block; DATA_AT counts from the response byte
/// before it.
pub(crate) fn write(cx: &mut Cx<'_>, db: u16, fields: &[u8]) -> Result<Written, Abort> {
    let area = Area::Db(db);
    let mut written = Written { status: status::OK, count: 0, more: false };
    let (mut header, mut code) = (Header::default(), 0);
    match Answer::parse(fields) {
        Ok(answer) => {
            header = answer.header;
            let mut records = answer.records();
            for record in &mut records {
                let record = match record {
                    Ok(record) => record,
                    Err(fault) => {
                        written.status = status::of(fault);
                        break;
                    }
                };
                let at = HEADER_BYTES + RECORD_BYTES * usize::from(written.count);
                if cx.write(area, at as u32, &record.to_bytes(1))?.is_err() {
                    written.status = status::DB_FULL;
                    break;
                }
                written.count += 1;
            }
            written.more = records.more_follow();
        }
        Err(fault) => {
            written.status = status::of(fault);
            if let Fault::Application(of_the_meter) = fault {
                code = of_the_meter;
            }
        }
    }
    let head = header.to_bytes(written.status, written.count, written.more, code);
    if cx.write(area, 0, &head)?.is_err() {
        written = Written { status: status::NO_DB, count: 0, more: false };
    }
    Ok(written)
}
