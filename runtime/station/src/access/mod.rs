//! Looking into a running station: the socket protocol, its server in the runtime and its client in
//! `get`, `set`, `ctl`. The protocol is documented in `docs/access.md`, so that any program can speak it.

pub mod client;
pub(crate) mod clients;
mod commands;
mod control;
pub mod debug;
pub(crate) mod facts;
pub mod links;
pub mod pass;
pub mod protocol;
pub mod server;
pub mod stage;
pub mod why;
