//! Looking into a running station: names of cells, the socket protocol, its server in the runtime and its client in
//! `get`, `set`, `ctl`. The protocol is documented in `docs/access.md`, so that any program can speak it.

pub mod client;
mod clients;
pub mod item;
pub mod protocol;
pub mod server;
pub(crate) mod value;

use ob1_cpu::PortError;

/// Why the CPU refuses a cell, in words.
pub(crate) const fn reason(error: PortError) -> &'static str {
    match error {
        PortError::Outside => "outside the area",
        PortError::NoDb => "the data block is not loaded",
        PortError::ReadOnly => "cannot be written",
        PortError::NoTimer => "no such timer or counter",
        PortError::NoModule => "no module answers there",
        PortError::NoEntry => "no such entry",
        PortError::Value => "the value does not fit",
    }
}
