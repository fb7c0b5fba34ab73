//! Common parts of all protocols of `ob1-gate`: the door to the broker for tasks ([`Station`], [`Client`]), the users
//! and their passwords ([`Users`]), the log of what they did ([`Audit`]), and TLS ([`Tls`]).
//!
//! Rights are checked twice, independently: the broker enforces the maximum rights of the link; below that a [`Client`]
//! enforces the right of its user. Every write and every change goes through a client, and a client writes its line of
//! the audit log itself, so that no protocol can forget it.

mod audit;
mod catalog;
mod clock;
mod hex;
mod memory;
mod pump;
mod station;
mod tls;
mod trouble;
mod turns;
mod users;

pub use ob1_access::partner::network;

pub use audit::Audit;
pub use catalog::Catalog;
pub use clock::{iso, unix_now};
pub use hex::{hex, unhex};
pub use memory::Memory;
pub use station::{Client, Link, Station, Watch, Who};
pub use tls::Tls;
pub use trouble::Trouble;
pub use turns::Source;
pub use users::{Login, LoginError, Users, UsersError, hash};
