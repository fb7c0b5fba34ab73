//! S7 communication over ISO on TCP (RFC 1006): the protocol between an S7-300 or S7-400 and HMI panels, SCADA systems,
//! programming devices and other PLCs.
//!
//! Everything here is a machine: bytes in, requests to the CPU out, bytes back. It has no socket and no clock, knows no
//! CPU, never panics on received bytes, and uses a bounded amount of memory.
//!
//! - [`iso`]: TPKT, COTP with its fragments, TSAPs. Both roles.
//! - [`wire`]: the telegrams of S7 itself, as a codec that both roles share.
//! - [`server`]: a connection as the CPU sees it.
//! - [`client`]: a connection as a programming device sees it.
//! - [`coupling`]: an Ethernet CP: the connections of handling blocks to other PLCs.
//! - [`tap`]: the records for `ob1 trace`.
//! - [`codes`]: every code that says why something was refused.

pub mod client;
pub mod codes;
pub mod coupling;
pub mod iso;
mod limits;
pub mod server;
pub mod tap;
pub mod wire;

pub use limits::{MAX_JOBS, MAX_PDU, MIN_PDU};

/// What a connection may do. Each includes the previous ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rights {
    /// Read values, blocks and lists.
    #[default]
    Read,
    /// Change values of variables.
    Write,
    /// Change the operating state, the clock and the program.
    Operate,
}
