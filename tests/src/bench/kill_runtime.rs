//! How long the outputs keep their values after the runtime was killed: from SIGKILL to the safe state in the image.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ob1_backplane::{IoField, Owner};
use ob1_command::statistics::quantile;

use super::peer::Failure;

/// Kills in a campaign.
pub const KILLS: usize = 200;
/// Maximum time for 99 of 100 kills.
pub const LIMIT: Duration = Duration::from_millis(100);
/// Maximum wait for a station.
const GUARD: Duration = Duration::from_secs(60);

const TOML: &str = "[station]\nname = \"kill-runtime\"\n[cpu]\nmin_cycle = \"1ms\"\n[program]\nsources = [\"kill.awl\"]\n\
    [[module]]\ntype = \"do\"\nname = \"lamps\"\naddress = 0\nbytes = 2\n";
const AWL: &str = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL W#16#A55A;\nT AW 0;\nEND_ORGANIZATION_BLOCK\n";

/// The result of a campaign.
#[derive(Clone, Debug)]
pub struct Kills {
    /// Nanoseconds from each kill to the safe state, in rising order.
    pub times: Vec<u64>,
}

impl Kills {
    /// The time that this share of the kills did not exceed.
    #[must_use]
    pub fn quantile(&self, part: f64) -> Duration {
        let buckets: Vec<(u64, u64)> = self.times.iter().map(|time| (*time, 1)).collect();
        Duration::from_nanos(quantile(&buckets, part))
    }

    /// Whether the limit was kept.
    #[must_use]
    pub fn is_kept(&self) -> bool {
        self.quantile(0.99) <= LIMIT
    }

    /// The line of output.
    #[must_use]
    pub fn line(&self) -> String {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        format!(
            "kill-runtime: {} kills; outputs safe after p50 {:.1} ms, p99 {:.1} ms, at most {:.1} ms; limit of p99 {} ms: {}",
            self.times.len(),
            ms(self.quantile(0.5)),
            ms(self.quantile(0.99)),
            ms(self.times.last().map_or(Duration::ZERO, |time| Duration::from_nanos(*time))),
            LIMIT.as_millis(),
            if self.is_kept() { "kept" } else { "BROKEN" }
        )
    }
}

/// Runs stations of this `ob1` and kills each while its outputs are on.
///
/// # Errors
/// If a station cannot be run, or its outputs stay on.
pub fn campaign(ob1: &Path, kills: usize) -> Result<Kills, Failure> {
    let folder = std::env::temp_dir().join(format!("ob1-kill-runtime-{}", std::process::id()));
    let run = folder.join("run");
    std::fs::create_dir_all(&run)?;
    std::fs::write(folder.join("kill.toml"), TOML)?;
    std::fs::write(folder.join("kill.awl"), AWL)?;
    let times = (0..kills).map(|_| one(ob1, &folder, &run)).collect::<Result<Vec<u64>, Failure>>();
    let _ = std::fs::remove_dir_all(&folder);
    let mut times = times?;
    times.sort_unstable();
    Ok(Kills { times })
}

/// A station, ended when the handle is dropped.
struct Station(Child);

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn one(ob1: &Path, folder: &Path, run: &Path) -> Result<u64, Failure> {
    let mut command = Command::new(ob1);
    command.args(["run", "kill.toml", "--quiet"]).current_dir(folder).env("XDG_RUNTIME_DIR", run);
    let mut station = Station(command.stdin(Stdio::null()).stdout(Stdio::null()).spawn()?);
    let begun = Instant::now();
    let image = run.join("ob1/kill-runtime/io");
    let pid = station.0.id();
    let field = loop {
        // The link of the previous station may still exist.
        let ours = std::fs::read_link(&image).is_ok_and(|link| link.starts_with(format!("/proc/{pid}")));
        if ours && let Ok(field) = IoField::open(&image) {
            break field;
        }
        patience(begun, "no station")?;
    };
    let outputs = || {
        let mut bytes = [0; 2];
        field.read_outputs(0, &mut bytes);
        bytes
    };
    while outputs() != [0xA5, 0x5A] {
        patience(begun, "no outputs")?;
    }
    let killed = Instant::now();
    station.0.kill()?;
    while (outputs(), field.owner()) != ([0, 0], Some(Owner::Guardian)) {
        patience(killed, "the outputs stay on")?;
    }
    let time = killed.elapsed();
    station.0.wait()?;
    Ok(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
}

/// Yields to other processes, until the time limit is exceeded.
fn patience(begun: Instant, what: &str) -> Result<(), Failure> {
    if begun.elapsed() > GUARD {
        return Err(what.into());
    }
    std::thread::yield_now();
    Ok(())
}
