//! The handling blocks of the CP 240: FC 0 SEND, FC 1 RECEIVE, FC 2 FETCH_RK512, FC 3 SEND_RK512, FC 4 S/R_ALL_RK512,
//! FC 8 STEUERBIT, FC 9 SYNCHRON_RESET, FC 11 ASCII_FRAGMENT.
//!
//! They perform the software handshake on the registers of the module, described in `docs/cp240-registers.md`. Each
//! block has two parts: a pure step function of control bits and registers, and around it the code that reads and
//! writes the parameters. A call performs one phase of the handshake; the state between two calls is in the parameters
//! that the program supplies (GESE, ANZ_INT, control bits), as on the original. In addition [`state::CpState`] stores
//! for each module to which start of the CP a job belongs, so that a job from before a reset or restart of the CP is
//! never continued after it.

mod fragment;
mod line;
mod module;
mod pafe;
mod receive;
mod reception;
mod registers;
mod rk512;
mod send;
mod settings;
mod state;
mod synchron;
#[cfg(test)]
mod tests;
mod turn;
mod tx;

ob1_sdk::export_plugin! {
    name: "cp240",
    version: env!("CARGO_PKG_VERSION"),
    module_state: state::CpState,
    blocks: [
        send::Send,
        receive::Receive,
        rk512::Fetch,
        rk512::SendRk,
        rk512::All,
        line::Line,
        synchron::SynchronReset,
        fragment::Fragment,
    ],
}
