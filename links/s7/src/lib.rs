//! S7 communication over ISO on TCP (RFC 1006): what HMI panels, SCADA systems, programming devices and other PLCs
//! speak with an S7-300 or S7-400.
//!
//! Everything here is a machine: bytes in, requests to the CPU out, bytes back. It has no socket and no clock, knows no
//! CPU, panics at nothing that comes over the wire, and holds a bounded amount of memory.
//!
//! - [`iso`]: TPKT, COTP with its fragments, TSAPs. Both roles.
//! - [`wire`]: the telegrams of S7 itself, as a codec that both roles share.
//! - [`server`]: a connection as the CPU sees it.
//! - [`client`]: a connection as a programming device sees it.
//! - [`coupling`]: an Ethernet CP: the connections of handling blocks to other PLCs.
//! - [`tap`]: what is told to those who listen.
//! - [`codes`]: every code that says why something was refused.

pub mod client;
pub mod codes;
pub mod coupling;
pub mod iso;
pub mod server;
pub mod tap;
pub mod wire;

/// Jobs a connection may have outstanding, at most.
pub const MAX_JOBS: u16 = 8;
/// Largest PDU we agree to. An S7-300 has 240, an S7-400 480; what clients ask for is up to 1024.
pub const MAX_PDU: u16 = 1024;
/// Smallest PDU that is of use: a head, an upload's answer.
pub const MIN_PDU: u16 = 64;

/// What a connection may do. Each includes those before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rights {
    /// Look.
    #[default]
    Read,
    /// Change values.
    Write,
    /// Change the operating state, the clock and the program.
    Operate,
}
