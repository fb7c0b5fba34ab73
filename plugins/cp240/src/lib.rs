//! The handling blocks of the CP 240: FC 0 SEND, FC 1 RECEIVE, FC 2 FETCH_RK512, FC 3 SEND_RK512, FC 4 S/R_ALL_RK512,
//! FC 8 STEUERBIT, FC 9 SYNCHRON_RESET, FC 11 ASCII_FRAGMENT.
//!
//! They do the software handshake on the module's registers, as `docs/cp240-registers.md` writes it down from the
//! manual. Each block is two things: a pure step function over (control bits, registers), and around it the reading and
//! writing of parameters. A call does one phase of the handshake; the state between two calls lies in the parameters
//! the program supplies (GESE, ANZ_INT, control bits), as on the original. Beside it [`state::CpState`] keeps per
//! module which start of the CP a job belongs to, so that a job of a CP that was reset or whose process was killed is
//! never taken for one of its successor.

mod fragment;
mod line;
mod receive;
mod registers;
mod rk512;
mod send;
mod settings;
mod state;
mod synchron;
#[cfg(test)]
mod tests;

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
