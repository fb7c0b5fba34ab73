//! "PID Control Blocks": FB 41 CONT_C, FB 42 CONT_S, FB 43 PULSEGEN; the compact CPUs have the same three as SFB 41 to
//! 43. ["Integrated Control"] FB 58 TCONT_CP, FB 59 TCONT_S: the temperature controllers of the same library.
//!
//! They count in CYCLE, the interval at which the program calls them, and read no clock. The equations are the sampled
//! form of the manual's block diagrams; statics whose names the manual does not give are ours.

mod actuator;
mod cont_c;
mod cont_s;
mod input;
mod pulsegen;
mod tcont_cp;
mod tcont_parameters;
mod tcont_s;
mod temperature;
mod tuning;

use crate::row::Row;

pub(crate) const ROWS: &[&[Row]] = &[cont_c::ROWS, cont_s::ROWS, pulsegen::ROWS, tcont_cp::ROWS, tcont_s::ROWS];
