//! "IEC Function Blocks" of the standard library: FC 1 to 40. ["IEC Functions"]

mod convert;
mod date_time;
mod select;
mod strings;

use crate::row::Row;

pub(crate) const ROWS: &[&[Row]] = &[date_time::ROWS, strings::ROWS, convert::ROWS, select::ROWS];
