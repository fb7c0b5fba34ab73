//! The access broker: the one door of a running CPU.
//!
//! Every reader or writer is a *link*: a process of its own ([`ob1_access::door`] is its end), or the control
//! socket of the station. Each has a share of what the scan copies, a window it looks through, and rights; a link's
//! *clients* are the connections it serves, distinguished by numbers of its own. The broker is one thread. It checks
//! rights (here and nowhere else), hands writes to the scan in groups that land whole, asks the CPU what links want to
//! know, and tells them what happens as one numbered stream. The scan sees nothing of it but the rings and windows of
//! its exchange.
//!
//! [`Broker::step`] does everything that can be done now and never waits, so that tests run it in virtual time
//! beside a CPU; [`Broker::start`] gives it its thread.

mod alarms;
mod broker;
mod client;
mod connection;
mod events;
mod facts;
mod feed;
mod joint;
mod logins;
mod rights;
mod telling;
mod thread;

pub use broker::Broker;
pub use facts::{Change, Changed, DriverState, Facts, LinkConfig, LinkState};
pub use feed::{Feed, FeedEnd, feed};
pub use joint::Beats;
pub use thread::{Handle, RunningBroker};
