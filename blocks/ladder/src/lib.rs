//! Ladder and function plan. STEP 7 keeps no picture of a network: it is made anew from the statements whenever a
//! block is opened. So does this crate.
//!
//! The way of a network: its statements with their texts ([`Network`]) -> a tree ([`read`]) -> a drawing of cells ->
//! text or SVG. Nothing is drawn that does not give back the very same statements. One pass of program status colours
//! the tree ([`flow`]).

mod check;
pub mod flow;
mod generate;
mod layout;
mod line;
mod listing;
mod merge;
mod network;
mod not_drawn;
mod number;
mod parse;
pub mod svg;
pub mod text;
pub mod tree;

pub use check::{read, read_step7};
pub use generate::{Made, carried, generate};
pub use layout::{Class, Drawing, Form, NamesShown, Options, Piece, Place, Shape, draw, is_ladder};
pub use line::line;
pub use listing::{listing, symbols};
pub use merge::{Mark, Merged, merge};
pub use network::{Actual, Network, Statement, View, title};
pub use not_drawn::Reason;
