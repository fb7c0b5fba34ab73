//! `ob1 list`: the stations that run on this machine.

use clap::Args;
use serde::Serialize;

use crate::exit::Exit;
use crate::remote::print_json;
use ob1_station::access::client::Client;
use ob1_station::access::protocol::Op;
use ob1_station::rundir;

/// List the stations that run on this machine
///
/// Those of this user; root sees the installed ones, too.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  ob1 list\n  ob1 list --json")]
pub struct ListArgs {
    /// As a JSON array of {name, state, pid, running_s, folder}
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Serialize)]
struct Listed {
    name: String,
    /// Empty: it does not answer.
    state: String,
    pid: Option<u32>,
    running_s: Option<u64>,
    folder: String,
}

/// Runs `ob1 list`: prints the stations, and says how it ended.
#[must_use]
pub fn list(args: &ListArgs) -> Exit {
    let all: Vec<Listed> = rundir::running()
        .into_iter()
        .map(|(name, folder)| {
            let status =
                Client::to_socket(&folder.join(rundir::SOCKET)).ok().and_then(|mut client| client.ask(Op::Status).ok());
            let status = status.and_then(|response| response.status);
            Listed {
                name,
                state: status.as_ref().map(|status| status.state.clone()).unwrap_or_default(),
                pid: status.as_ref().map(|status| status.pid),
                running_s: status.as_ref().map(|status| status.runtime_ns / 1_000_000_000),
                folder: folder.display().to_string(),
            }
        })
        .collect();
    if args.json {
        return print_json(&all);
    }
    let width = all.iter().map(|one| one.name.chars().count()).max().unwrap_or(0);
    for Listed { name, state, pid, running_s, .. } in &all {
        match (pid, running_s) {
            (Some(pid), Some(seconds)) => say!("{name:<width$}  {state:<8}  process {pid}, for {seconds} s"),
            _ => say!("{name:<width$}  does not answer"),
        }
    }
    if all.is_empty() {
        err!("no station runs\n  = ob1 run FILE starts one; looked for in {}", rundir::listed());
    }
    Exit::Ok
}
