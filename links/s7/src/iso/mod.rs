//! ISO transport on TCP: TPKT frames, COTP class 0, TSAPs (RFC 1006, ISO 8073).

mod cotp;
mod transport;
mod tsap;

pub use cotp::{MAX_TPDU, TpduSize};
pub use transport::{Broken, Call, Event, Refusal, Transport};
pub use tsap::{Place, Resource, Tsap};

/// The port of ISO on TCP (RFC 1006).
pub const ISO_PORT: u16 = 102;
