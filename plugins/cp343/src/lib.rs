//! The handling blocks of the CP 343: FC 5, 6, 7, 8, 10, 50, 60 (AG blocks), FC 62 C_CNTRL, and for S7 connections
//! FB 8, 9, 12 to 15 of an S7-300, SFB 8, 9, 12 to 15 and SFC 62 CONTROL of an S7-400. (docs/cp343.md)
//!
//! A block has a box at the CP (`ob1_words::boxes`), which it reads and writes as data records. The state of a block
//! between two calls is in [`state::CpState`], zeroed at every start-up of the CPU.

mod ag;
mod area;
mod condition;
mod job;
mod partner;
mod state;
mod telegrams;
mod variables;

use partner::FOUR;

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
        condition::Status,
        telegrams::Usend<false>,
        telegrams::Urcv<false>,
        telegrams::Bsend<false>,
        telegrams::Brcv<false>,
        variables::Get<false>,
        variables::Put<false>,
        telegrams::Usend<FOUR>,
        telegrams::Urcv<FOUR>,
        telegrams::Bsend<FOUR>,
        telegrams::Brcv<FOUR>,
        variables::Get<FOUR>,
        variables::Put<FOUR>,
        condition::Control,
    ],
}
