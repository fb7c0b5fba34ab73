//! The handling blocks of the CP 341: FB 8 P_SND_RK, FB 7 P_RCV_RK, FB 13 P_PRT341, FC 5 V24_STAT, FC 6 V24_SET.
//!
//! The parts they share with those of the CP 340 are in `ob1-siemens`.

mod receive;
mod send;

use ob1_siemens::ptp::print::{Name, Print};

/// FB 13 P_PRT341. [TIA help "PtP data link CP 341"]
struct Prt341;

impl Name for Prt341 {
    const NUMBER: u16 = 13;
    const NAME: &'static str = "P_PRT341";
    // (docs/cp341-events.md)
    const LENGTH_WRONG: u16 = 0x1E42;
}

ob1_sdk::export_plugin! {
    name: "cp341",
    version: env!("CARGO_PKG_VERSION"),
    module_state: ob1_siemens::ptp::CpState,
    blocks: [ob1_siemens::ptp::v24::Stat, ob1_siemens::ptp::v24::Set, receive::ReceiveRk, send::SendRk, Print<Prt341>],
}
