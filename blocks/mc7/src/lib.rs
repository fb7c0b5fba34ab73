//! MC7, the machine code of STEP 7, and the parts around it in a block: head, compiled interface, segment table.
//!
//! Two layers. [`Statement`] is one statement and its bytes, exactly invertible. [`decode`] makes a code block of the
//! instruction set of it: jumps become statement indices, and what STEP 7's compiler made of a `CALL` becomes the call
//! again. [`encode`] is the way back. [`BlockImage`] is a block as a CPU holds it, [`CompiledInterface`] and
//! [`Segments`] are two of its parts; the project folder keeps the same bytes.
//!
//! Everything here is pure, and none of it panics, whatever the bytes. Source of the facts: docs/mc7.md.

mod addresses;
mod block;
mod bytes;
mod compiled;
mod declared;
mod decode;
mod encode;
mod error;
mod fold;
mod head;
mod image;
mod pages;
mod parts;
mod segments;
mod statement;
mod text;

pub use addresses::addresses;
pub use block::{MachineBlock, list_order};
pub use compiled::{CompiledInterface, Entry, EntryType, InterfaceKind};
pub use declared::Blocks;
pub use decode::{Decoded, decode, notation};
pub use encode::{Encoded, Written, encode};
pub use error::{Mc7Error, Problem};
pub use head::{BlockFoot, BlockHead, BlockImage, HEAD_BYTES, Stamp};
pub use image::{code_of, declarations, image};
pub use segments::Segments;
pub use statement::{ConstForm, Mc7Op, NoStatement, Statement, Uncond};
