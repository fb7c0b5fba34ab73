//! What every protocol of `ob1-gate` shares and none of them owns: the door to the broker for tasks ([`Station`],
//! [`Client`]), the users and their passwords ([`Users`]), the log of what they did ([`Audit`]), and TLS ([`Tls`]).
//!
//! Rights have two owners, and neither trusts the other's guess: the broker holds the ceiling of the link, whatever is
//! asked; below it a [`Client`] holds the right of its user. Every write and every change goes through a client, and
//! a client writes its line of the audit log itself: no protocol can forget it.

mod audit;
mod back_off;
mod catalog;
mod clock;
mod memory;
mod pump;
mod station;
mod tls;
mod trouble;
mod users;

pub use audit::Audit;
pub use back_off::BackOff;
pub use catalog::Catalog;
pub use clock::{iso, unix_now};
pub use memory::Memory;
pub use station::{Client, Link, Station, Watch, Who};
pub use tls::Tls;
pub use trouble::Trouble;
pub use users::{Login, LoginError, Users, UsersError, hash};
