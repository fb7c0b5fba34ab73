//! "TI-S7 Converting Blocks". ["Standard Functions for S7-300/400, Part 2"]
//!
//! A POINTER names where a table or a row of bits begins; without a data block number it is in the block that is open
//! in the caller. FB 85 DRUM is with SFB 32.

mod alarms;
mod bits;
mod convert;
mod lead_lag;
mod masks;
mod pack;
mod place;
mod scale;
mod statistics;
mod table;

use crate::row::Row;

pub(crate) const ROWS: &[&[Row]] = &[
    table::ROWS,
    statistics::ROWS,
    convert::ROWS,
    bits::ROWS,
    lead_lag::ROWS,
    alarms::ROWS,
    masks::ROWS,
    pack::ROWS,
    scale::ROWS,
];
