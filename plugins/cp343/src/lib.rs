//! The handling blocks of the CP 343: FC 5, 6, 7, 8, 10, 50, 60 (AG blocks), FC 62 C_CNTRL, and FB 8, 9, 12 to 15 for
//! S7 connections. (docs/cp343.md)
//!
//! A block has a box at the CP (`ob1_words::boxes`), which it reads and writes as data records. What a block remembers
//! between two calls lies in [`state::CpState`], zeroed at every start-up of the CPU.

mod ag;
mod area;
mod job;
mod partner;
mod state;

ob1_sdk::export_plugin! {
    name: "cp343",
    version: env!("CARGO_PKG_VERSION"),
    module_state: state::CpState,
    blocks: [
        ag::Send<5>,
        ag::Receive<6>,
        ag::Lock<7>,
        ag::Lock<8>,
        ag::Control,
        ag::Send<50>,
        ag::Receive<60>,
        partner::Status,
        partner::Usend,
        partner::Urcv,
        partner::Bsend,
        partner::Brcv,
        partner::Get,
        partner::Put,
    ],
}
