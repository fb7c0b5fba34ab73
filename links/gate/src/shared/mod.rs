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
mod password_turns;
mod pump;
mod station;
#[cfg(test)]
mod tests;
mod tls;
mod trouble;
mod users;

pub(crate) use ob1_access::partner::network;

pub(crate) use audit::Audit;
pub(crate) use catalog::Catalog;
pub(crate) use clock::{iso, unix_now};
pub(crate) use hex::{hex, unhex};
pub(crate) use memory::Memory;
pub(crate) use password_turns::Source;
pub(crate) use station::{Client, Link, Station, Watch, Who};
pub(crate) use tls::Tls;
pub(crate) use trouble::Trouble;
pub(crate) use users::{LoginError, Users, hash};
