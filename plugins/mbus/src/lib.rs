//! Blocks that read meters over M-Bus, on top of the handling blocks of the CP 240: FB 250 MBUS_READ reads a meter into
//! typed records, FB 251 MBUS_SEARCH finds meters by their secondary addresses, FC 250 MBUS_DECODE decodes an answer
//! that the program already has.
//!
//! The FBs send their orders with FC 0 and receive the responses with FC 1, like a user program. The user program must
//! call FC 9 first, and may use only one of the FBs at a time on a CP. Parameters, layouts and STATUS: docs/mbus.md.
#![no_std]

#[cfg(test)]
extern crate std;

mod decode;
mod exchange;
mod job;
mod read;
pub mod records;
mod response;
mod search;
mod status;
mod store;
mod walk;

ob1_sdk::export_plugin! {
    name: "mbus",
    version: env!("CARGO_PKG_VERSION"),
    module_state: (),
    blocks: [read::Read, search::Search, decode::Decode],
}
