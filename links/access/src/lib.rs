//! What every link that looks into a CPU from outside shares: names of cells ([`Names`]), their values as text and JSON
//! ([`value`]), the forms people read them in ([`Form`]), and who may do what ([`Allowed`]).
//!
//! It knows the program's names and the vocabulary of an S7, no CPU: whoever reads and writes cells asks it what they
//! mean.

mod datum;
pub mod door;
mod form;
mod item;
mod near;
mod rights;
pub mod value;

pub use datum::{Datum, Unfit};
pub use form::Form;
pub use item::{Item, NamedBlock, Names, Reading, Typed};
pub use near::nearest;
pub use ob1_model::{Cell, CellError, CellWidth, Piece, Put};
pub use rights::{Allowed, Right};
