//! The handling blocks of the CP 341: FB 8 P_SND_RK, FB 7 P_RCV_RK, FC 5 V24_STAT, FC 6 V24_SET.
//!
//! P_SND_RK and P_RCV_RK have a channel each (`docs/cp341-channels.md`), which they read and write as data records, as
//! the originals do by RD_REC and WR_REC: 32 bytes of user data a call. What a block remembers between two calls lies
//! in its instance; [`state::CpState`] keeps which start of the CPU it belongs to.

mod channel;
mod receive;
mod send;
mod state;
mod target;
mod v24;

ob1_sdk::export_plugin! {
    name: "cp341",
    version: env!("CARGO_PKG_VERSION"),
    module_state: state::CpState,
    blocks: [v24::Stat, v24::Set, receive::ReceiveRk, send::SendRk],
}
