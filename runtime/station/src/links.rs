//! The processes of links: starts them, hands each its end of the broker's socket, and starts one again that is gone or
//! silent. The scan knows nothing of it.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use ob1_access::door::Door;
use ob1_broker::{Beats, Handle};
use ob1_host::driver::kept_environment;
use ob1_host::supervisor::{Exit, Report, Times};
use ob1_rt::SideThread;
use ob1_socket::handover;

use crate::kept_process::{Charge, Kept, keep};

/// The longest wait between two looks: a link beats every 200 ms.
const LOOK: Duration = Duration::from_millis(250);
/// How long a process gets to end once its door is closed.
const END: Duration = Duration::from_secs(2);

/// A process that serves a link, or several.
#[derive(Clone, Debug)]
pub struct LinkSpec {
    /// The name of the link, for the log; of several links that of the process.
    pub name: String,
    /// Path of the program, `ob1-s7` or `ob1-gate`.
    pub program: PathBuf,
    /// Its links: the number of each at the broker, and its signs of life.
    pub doors: Vec<(usize, Beats)>,
    /// It may have several links: its standard input is a socket over which the doors come. Otherwise it is the door.
    pub several: bool,
}

impl LinkSpec {
    /// Signs of life of all its links.
    fn count(&self) -> u64 {
        self.doors.iter().map(|(_, beats)| beats.count()).fold(0, u64::wrapping_add)
    }
}

/// The processes of all links. Dropping it ends them: drop the broker first, so that they find their doors closed.
#[derive(Debug)]
pub struct Links {
    watch: SideThread<OwnedFd>,
}

impl Links {
    /// Starts the thread that starts them. `broker` learns of each new process.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn start(specs: Vec<LinkSpec>, broker: &Handle) -> io::Result<Self> {
        let watched = specs.into_iter().map(|spec| Watched { spec, broker: broker.clone() });
        let kept = watched.map(|link| Kept::new(link, Times::DEFAULT)).collect();
        Ok(Self { watch: keep("ob1-links", kept, LOOK, END)? })
    }

    /// The doors are about to close: a process that ends because of it is neither reported nor started again.
    pub fn expect_the_end(&mut self) {
        self.watch.ask_to_end();
    }
}

/// A link, and the broker it is a client of.
struct Watched {
    spec: LinkSpec,
    broker: Handle,
}

impl Charge for Watched {
    /// Our ends of its doors, until the broker has them: the broker closes them.
    type Held = Vec<OwnedFd>;

    fn command(&mut self) -> io::Result<(Command, Self::Held)> {
        let pairs = self.spec.doors.iter().map(|_| handover::pair()).collect::<io::Result<Vec<_>>>()?;
        let (ours, mut theirs): (Vec<OwnedFd>, Vec<OwnedFd>) = pairs.into_iter().unzip();
        let input = if self.spec.several {
            let (over, input) = handover::pair()?;
            Door::hand_over(&over, &theirs)?;
            Some(input)
        } else {
            theirs.pop()
        };
        let input = input.ok_or_else(|| io::Error::other("a process without a link"))?;
        let mut command = Command::new(&self.spec.program);
        command
            .args(["--name", &self.spec.name])
            .env_clear()
            .envs(kept_environment())
            .stdin(Stdio::from(input))
            .stdout(Stdio::null())
            // Out of reach of Ctrl-C: it ends when its door is closed.
            .process_group(0)
            .current_dir("/");
        Ok((command, ours))
    }

    fn begun(&mut self, held: &mut Self::Held) {
        for ((link, _), door) in self.spec.doors.iter().zip(held.drain(..)) {
            self.broker.connect(*link, door);
        }
    }

    fn beats(&self) -> u64 {
        self.spec.count()
    }

    fn tell(&self, report: Report) {
        let name = &self.spec.name;
        match report {
            Report::Up(1) => tracing::info!("link \"{name}\" is up"),
            Report::Up(starts) => tracing::info!("link \"{name}\" is up again, start {starts}"),
            Report::Lost(Exit::NotStarted(_)) => {}
            Report::Lost(exit) => tracing::warn!("link \"{name}\" is gone ({exit}); it is started again"),
            Report::HeldUp(_) => {}
        }
    }

    fn cannot_start(&self, why: &io::Error) {
        let (name, program) = (&self.spec.name, self.spec.program.display());
        let missing = why.kind() == io::ErrorKind::NotFound;
        let remedy = if missing { "; it is usually beside ob1" } else { ob1_rt::remedy(why) };
        tracing::error!("link \"{name}\": {program} cannot be started, it is tried again: {why}{remedy}");
    }
}
