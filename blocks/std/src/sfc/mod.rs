//! System functions.

mod addresses;
mod alarms;
mod bits;
mod clock;
mod copying;
mod data_blocks;
mod diagnosis;
mod errors;
mod images;
mod interrupts;
mod messages;
mod modules;
mod parameters;
mod partners;
mod program;
mod schedule;

use crate::row::Row;
pub use modules::DP_DIAGNOSIS;

pub(crate) const ROWS: &[&[Row]] = &[
    clock::ROWS,
    diagnosis::ROWS,
    modules::ROWS,
    parameters::ROWS,
    addresses::ROWS,
    partners::ROWS,
    alarms::ROWS,
    messages::ROWS,
    copying::ROWS,
    data_blocks::ROWS,
    images::ROWS,
    schedule::ROWS,
    errors::ROWS,
    interrupts::ROWS,
    program::ROWS,
    bits::ROWS,
];
