//! Common parts of all links into a CPU: names of cells ([`Names`]), their values as text and JSON ([`value`],
//! [`text`]), the forms people read them in ([`Form`]), the rights of clients ([`Allowed`]), what the process of a link
//! is told ([`settings`]), and why a bit has its value ([`why`]).
//!
//! It knows the program's names and the terms of an S7, but no CPU: callers that read and write cells ask it for their
//! meaning.

pub mod alarm_text;
pub mod alarms;
pub mod audit;
mod datum;
pub mod door;
mod form;
mod item;
pub mod partner;
mod rights;
pub mod settings;
mod stop;
pub mod text;
pub mod value;
pub mod why;

pub use datum::{Datum, Unfit};
pub use form::Form;
pub use item::{Item, NamedBlock, Names, Reading, Typed};
pub use ob1_model::{Cell, CellError, Piece, Put, Width};
pub use rights::{Allowed, Right};
pub use stop::{LastStop, last_stop};
