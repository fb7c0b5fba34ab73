//! The handling blocks of the CP 342-5 as a DP master: FC 1 DP_SEND, FC 2 DP_RECV, FC 3 DP_DIAG, FC 4 DP_CTRL.
//! (docs/cp342.md)
//!
//! They transfer their data as data records (`ob1_words::cp342`), and every job has ended when its call returns.

mod data;
mod jobs;
mod outcome;

ob1_sdk::export_plugin! {
    name: "cp342",
    version: env!("CARGO_PKG_VERSION"),
    module_state: (),
    blocks: [data::Send, data::Receive, jobs::Diagnose, jobs::Control],
}
