//! Blocks that read meters over M-Bus, on top of the handling blocks of the CP 240: FB 250 MBUS_READ reads a meter into
//! typed records, FB 251 MBUS_SEARCH finds meters by their secondary addresses, FC 250 MBUS_DECODE makes records out of
//! an answer that the program has already.
//!
//! The FBs give their orders with FC 0 and take the responses with FC 1, like a program. The program calls FC 9 before
//! them, and lets one of them work at a time on a CP. docs/mbus.md has parameters, layouts and STATUS.

mod decode;
mod exchange;
mod job;
mod read;
mod records;
mod response;
mod search;
mod status;
mod walk;

ob1_sdk::export_plugin! {
    name: "mbus",
    version: env!("CARGO_PKG_VERSION"),
    module_state: (),
    blocks: [read::Read, search::Search, decode::Decode],
}
