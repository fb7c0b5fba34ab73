//! The handling blocks of the CP 040: FB 60 SEND, FB 61 RECEIVE, FB 65 SEND_RECV.
//! [S3 "Communication via handling blocks"]
//!
//! The blocks connect their parameters with the two state machines of `ob1-slio`, which implement the byte protocol of
//! `docs/cp040-registers.md`. The jobs are in the plugin's memory of the module, together with the start of the CP they
//! belong to: SEND and RECEIVE both write byte 0, each its own nibble.

mod com;
mod module;
mod order;
mod receive;
mod send;
mod state;
mod status;

ob1_sdk::export_plugin! {
    name: "cp040",
    version: env!("CARGO_PKG_VERSION"),
    module_state: state::CpState,
    blocks: [send::Send, receive::Receive, com::Com],
}
