//! System function blocks: IEC counters and timers, the drum, records.

mod counters;
mod drum;
mod records;
mod timers;

use crate::table::Row;

pub(crate) const ROWS: &[&[Row]] = &[counters::ROWS, timers::ROWS, drum::ROWS, records::ROWS];
