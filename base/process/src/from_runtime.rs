//! The driver's confinement before it begins, as set by the runtime (`OB1_FENCE`), and a self-test of it.

use std::fs::{self, File};
use std::net::{TcpListener, UdpSocket};
use std::path::PathBuf;
use std::process::Command;

use crate::log::Severity;
use rustix::net::{AddressFamily, SocketType, socket};
use rustix::process::{Resource, Rlimit, Signal, getppid, kill_process, setrlimit};
use rustix::thread::{CapabilitySet, capabilities, no_new_privs};
use serde::Deserialize;
use tracing::{error, warn};

use crate::{Confinement, Network, Refusal};

/// The variable with the confinement, as JSON. Without it the driver was started by hand and is not confined.
const VARIABLE: &str = "OB1_FENCE";
/// Maximum data of a driver, in bytes: about ten times what it needs.
const MEMORY: u64 = 64 << 20;
/// A driver is restarted by itself, the runtime is not: when memory runs out, the driver is killed first.
const OOM_SCORE: i16 = 500;

/// What the runtime has written there.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Asked {
    /// The folders of its sockets and its locks.
    folders: Vec<PathBuf>,
    /// The folders of its links.
    links: Vec<PathBuf>,
    /// `none`, `address` or `name`.
    network: String,
}

/// Confines the process as set in `OB1_FENCE`; call it before anything else, and before there is a thread. Returns what
/// the kernel refused.
///
/// # Errors
/// The variable is not UTF-8, not JSON of a confinement, or names a network that does not exist; in words.
pub fn confine() -> Result<Vec<Refusal>, String> {
    let Some(text) = std::env::var_os(VARIABLE) else { return Ok(Vec::new()) };
    let asked: Asked = text
        .to_str()
        .ok_or_else(|| "not UTF-8".to_owned())
        .and_then(|text| serde_json::from_str(text).map_err(|error| error.to_string()))
        .map_err(|why| format!("{VARIABLE}: {why}"))?;
    let network = match asked.network.as_str() {
        "" | "none" => Network::None,
        "address" => Network::Address,
        "name" => Network::Name,
        other => return Err(format!("{VARIABLE}: there is no network \"{other}\"")),
    };
    crate::close_inherited();
    let Asked { folders, links, .. } = asked;
    let wanted = Confinement {
        folders,
        links,
        devices: true,
        network,
        memory: MEMORY,
        oom_score: OOM_SCORE,
        ..Confinement::default()
    };
    Ok(crate::confine(&wanted))
}

/// Says in the log what the kernel refused, or why the process is not confined; false: then the process must end.
pub fn tell(raised: &Result<Vec<Refusal>, String>) -> bool {
    match raised {
        Ok(refused) => refused.iter().for_each(|(what, why)| warn!("not confined, {what}: {why}")),
        Err(why) => error!("{why}"),
    }
    raised.is_ok()
}

/// Tries forbidden actions, and logs for each whether it was refused. True if all were refused and allowed actions
/// still work.
pub fn self_test() -> bool {
    let parent = getppid();
    let tries: [(&str, bool); 14] = [
        ("open a file of the system", File::open("/etc/passwd").is_ok()),
        (
            "open another process",
            parent.is_some_and(|pid| fs::read(format!("/proc/{}/environ", pid.as_raw_nonzero())).is_ok()),
        ),
        ("make a file", File::create(std::env::temp_dir().join(format!("ob1-cp-{}", std::process::id()))).is_ok()),
        ("list a folder", fs::read_dir("/").is_ok()),
        ("start a program", Command::new("/bin/true").status().is_ok()),
        ("listen on TCP", TcpListener::bind("127.0.0.1:0").is_ok()),
        ("speak UDP", UdpSocket::bind("127.0.0.1:0").is_ok()),
        ("have a stream to a socket of this machine", socket(AddressFamily::UNIX, SocketType::STREAM, None).is_ok()),
        ("signal another process", parent.is_some_and(|pid| kill_process(pid, Signal::CONT).is_ok())),
        ("raise its limits", setrlimit(Resource::Data, Rlimit { current: None, maximum: None }).is_ok()),
        ("take 256 MiB", Vec::<u8>::new().try_reserve_exact(256 << 20).is_ok()),
        ("get privileges by a program", !no_new_privs().unwrap_or(false)),
        ("keep a capability", !capabilities(None).is_ok_and(|sets| sets.permitted == CapabilitySet::empty())),
        ("be without a device", File::open("/dev/null").is_err()),
    ];
    for (what, done) in tries {
        // Through the log too, because standard output is for the reader of the result.
        let text = format!("{} {what}\n", if done { "DONE   " } else { "refused" });
        crate::log::write(Severity::Info, text.as_bytes());
    }
    tries.iter().all(|(_, done)| !done)
}
