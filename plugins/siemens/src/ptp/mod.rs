//! What the handling blocks of the CP 340 and the CP 341 have in common: their channels, a block that gives a job to
//! the CP (P_SEND, P_SND_RK, P_PRINT), one that receives from the CP (P_RCV, P_RCV_RK), and the accompanying signals.
//!
//! A block has a channel (`docs/cp341-channels.md`), which it reads and writes as data records, as the originals do
//! with RD_REC and WR_REC: 32 bytes of user data for each call. The state of a block between two calls is in its
//! instance; [`CpState`] stores to which start of the CPU it belongs.

pub mod channel;
pub mod print;
pub mod receive;
pub mod send;
mod state;
mod target;
pub mod v24;

pub use state::CpState;
