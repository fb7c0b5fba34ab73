//! System function blocks: IEC counters and timers, also with the instances of TIA Portal, the drum, records,
//! alarms.

mod alarms;
mod counters;
mod drum;
mod records;
mod tia;
mod timers;

use crate::row::Row;

pub(crate) const ROWS: &[&[Row]] = &[counters::ROWS, timers::ROWS, tia::ROWS, drum::ROWS, alarms::ROWS, records::ROWS];
