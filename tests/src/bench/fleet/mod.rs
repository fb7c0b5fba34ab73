//! `cargo xtask bench fleet`: what many stations send, and whether an MQTT broker and Prometheus take it.
//!
//! The stations are in this process: CPU, program, broker and control socket are the product's, and each cycle begins
//! exactly when it is due in virtual time, which passes as time does. Their links are served by `ob1-gate`, the process
//! of a station with its MQTT, its Sparkplug and its figures; here one has the doors of a hundred stations and of one
//! kind of link, so that what each kind takes is known. mosquitto and Prometheus are real.

mod heard;
mod partners;
mod station;

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{self, Duration};

use ob1_rt::MonotonicClock;
use ob1_station::program;
use ob1_time::{Instant, Span};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use super::peer::Failure;
use super::stations::pass;
use crate::sim::station::texts;
use heard::{Heard, Kind, PREFIX, Subscriber};
use partners::{Prometheus, Running, gate, mosquitto};
use station::Simulated;

/// Stations of one gate.
const GATE: usize = 100;
/// Links of the station file, in its order.
const KINDS: [&str; 3] = ["figures", "mqtt", "sparkplug"];
const CYCLE: Span = Span::from_millis(100);
/// Time between two turns of all stations, and turns between two looks at their partners.
const TURN: Duration = Duration::from_millis(10);
const LOOK: usize = 20;
/// So long a step may take that is not measured.
const PATIENCE: Duration = Duration::from_secs(300);

/// What is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Stations.
    pub stations: usize,
    /// Seconds that are measured.
    pub seconds: u64,
    /// Seconds between two scrapes of a station.
    pub scrape: u64,
}

/// Runs the fleet with the programs in this folder and prints the figures; whether the broker and Prometheus took all.
///
/// # Errors
/// If a program is missing, or something does not come up.
pub fn measure(programs: &Path, plan: Plan) -> Result<bool, Failure> {
    let count = plan.stations;
    // A station takes nine descriptors here, and two of the broker, which inherits the limit.
    let limit = getrlimit(Resource::Nofile);
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
    let site = Site::new()?;
    let port = free_port()?;
    let mosquitto = mosquitto(&site.0, port)?;
    let subscriber = Subscriber::start(port)?;
    let begun = time::Instant::now();
    let mut fleet = Fleet::build(&site.0, count, port)?;
    println!("{count} stations of one file, built in {:.1} s", begun.elapsed().as_secs_f64());
    let gates = fleet.gates(&programs.join("ob1-gate"), &site.0)?;
    fleet.until("all links to the broker are up", |_| {
        Ok(subscriber.heard(|heard| heard.plain.came.min(heard.sparkplug.came) >= count as u64).then_some(()))
    })?;
    let targets = fleet.listed(&programs.join("ob1"), &site.0)?;
    let prometheus = Prometheus::start(&site.0, &targets, free_port()?, plan.scrape)?;
    let up = || prometheus.value("count(up{job=\"ob1\"} == 1)").unwrap_or(0.0);
    fleet.until("Prometheus has scraped all", |_| Ok((up() >= count as f64).then_some(())))?;

    let look = |fleet: &Fleet| -> Result<Look, Failure> {
        let ticks = |of: &[Running]| of.iter().map(Running::ticks).sum::<Result<u64, _>>();
        let gates = [ticks(&gates[0])?, ticks(&gates[1])?, ticks(&gates[2])?];
        let others = [mosquitto.ticks()?, prometheus.running.ticks()?, super::stations::ticks(std::process::id())?];
        Ok(Look { time: fleet.now(), gates, others, kinds: subscriber.heard(|heard| [heard.plain, heard.sparkplug]) })
    };
    let before = look(&fleet)?;
    let end = before.time + Span::from_secs(plan.seconds);
    fleet.until("the time is over", |fleet| Ok((fleet.now() >= end).then_some(())))?;
    let after = look(&fleet)?;
    let figures = after.since(&before, count as f64);
    let range = format!("{{job=\"ob1\"}}[{}s]", plan.seconds);
    let asked = |query: &str| prometheus.value(query).unwrap_or(0.0);
    let always_up = asked(&format!("count(min_over_time(up{range}) == 1)"));
    let scrapes = asked(&format!("sum(count_over_time(up{range}))"));
    let bytes = asked("avg(scrape_body_size_bytes{job=\"ob1\"})");
    let samples = asked("avg(scrape_samples_scraped{job=\"ob1\"})");
    let slowest = asked(&format!("max(max_over_time(scrape_duration_seconds{range}))"));
    let in_run = asked("count(ob1_cpu_state{ob1_cpu_state=\"RUN\"} == 1)");
    let memory = |of: &[Running]| -> Result<f64, Failure> {
        Ok(of.iter().map(Running::own_kib).sum::<Result<u64, _>>()? as f64 / 1024.0)
    };
    for (index, what) in ["plain topics", "Sparkplug B"].iter().enumerate() {
        let kind = &figures.kinds[index];
        println!(
            "  {what:<12} {:>7.2} messages and {:>6.0} bytes a second and station, {:>6.0} µs of a core a second and station; \
             {:.0} KiB a station",
            kind.messages,
            kind.bytes,
            figures.gates[index + 1] * 1e6,
            memory(&gates[index + 1])? * 1024.0 / count as f64
        );
    }
    println!(
        "  figures      {samples:>7.0} samples and {bytes:>6.0} bytes a scrape, {:>6.0} µs of a core a scrape; {:.0} KiB a station",
        figures.gates[0] * 1e6 * count as f64 * plan.seconds as f64 / scrapes.max(1.0),
        memory(&gates[0])? * 1024.0 / count as f64
    );
    println!(
        "  mosquitto    {:.1} % of a core, {:.0} MiB; Prometheus, each {} s: {:.1} % of a core, {:.0} MiB, slowest scrape {slowest:.2} s; \
         the simulation {:.1} % of a core",
        figures.others[0] * 100.0,
        mosquitto.own_kib()? as f64 / 1024.0,
        plan.scrape,
        figures.others[1] * 100.0,
        prometheus.running.own_kib()? as f64 / 1024.0,
        figures.others[2] * 100.0
    );
    drop(prometheus);

    let last = fleet.stand_still(&subscriber)?;
    let taken = fleet.until("the broker's figures are those of the end", |_| {
        Ok(subscriber.heard(|heard| (received(heard) >= all(heard)).then(|| (received(heard), all(heard)))))
    })?;
    drop(fleet);
    drop(gates);
    pass(Duration::from_secs(1));
    let (plain, sparkplug, dropped) = subscriber.heard(|heard| {
        (heard.plain, heard.sparkplug, heard.broker.get("publish/messages/dropped").copied().unwrap_or(0))
    });
    println!(
        "  mosquitto received {} bytes of payload, the subscriber heard {} in {} messages; {dropped} dropped, {} lost, {} twice; \
         {} of {count} goodbyes on plain topics, {} of {count} by Sparkplug; {last} of {count} stations with their last values by both",
        taken.0,
        taken.1,
        plain.messages + sparkplug.messages,
        plain.lost + sparkplug.lost,
        plain.again + sparkplug.again,
        plain.went,
        sparkplug.went
    );
    println!("  Prometheus: {always_up} of {count} up in each of {scrapes} scrapes, {in_run} in RUN");
    let whole = count as f64;
    let is_taken = taken.0 == taken.1 && dropped + plain.lost + sparkplug.lost + plain.again == 0 && last == count;
    // Whoever could not end the connection in time has its goodbye once more, from the broker.
    let said_goodbye = plain.went.min(sparkplug.went) >= count as u64;
    Ok(is_taken && said_goodbye && (always_up, in_run) == (whole, whole))
}

/// Payload that the broker has received, in bytes, as it says itself. (Of messages mosquitto 2.0 counts some only.)
fn received(heard: &Heard) -> u64 {
    heard.broker.get("publish/bytes/received").copied().unwrap_or(0)
}

/// The payload of all stations that has come out of it.
fn all(heard: &Heard) -> u64 {
    heard.plain.payload + heard.sparkplug.payload
}

/// Figures at a time.
struct Look {
    time: Instant,
    /// Ticks of the gates of each kind of link.
    gates: [u64; KINDS.len()],
    /// Ticks of mosquitto, Prometheus and this process.
    others: [u64; 3],
    kinds: [Kind; 2],
}

/// Messages and bytes, by second and station.
struct Rate {
    messages: f64,
    bytes: f64,
}

/// What has passed, by second: of a core by station, of a core.
struct Rates {
    gates: [f64; KINDS.len()],
    others: [f64; 3],
    kinds: [Rate; 2],
}

impl Look {
    fn since(&self, before: &Self, stations: f64) -> Rates {
        let seconds = (self.time - before.time).as_secs_f64();
        // A tick is 10 ms.
        let core = |now: u64, then: u64| now.saturating_sub(then) as f64 / 100.0 / seconds;
        let rate = |kind: usize| Rate {
            messages: (self.kinds[kind].messages - before.kinds[kind].messages) as f64 / seconds / stations,
            bytes: (self.kinds[kind].bytes - before.kinds[kind].bytes) as f64 / seconds / stations,
        };
        Rates {
            gates: std::array::from_fn(|index| core(self.gates[index], before.gates[index]) / stations),
            others: std::array::from_fn(|index| core(self.others[index], before.others[index])),
            kinds: [rate(0), rate(1)],
        }
    }
}

/// All stations, and the time they are at.
struct Fleet {
    stations: Vec<Simulated>,
    begun: time::Instant,
    /// Their CPUs scan.
    scans: bool,
}

impl Fleet {
    fn build(folder: &Path, count: usize, broker: u16) -> Result<Self, Failure> {
        std::fs::write(folder.join("fleet.awl"), include_str!("fleet.awl"))?;
        let (base, listeners) = ports(count)?;
        let (file, clock, mut loaded) = (file(base, broker), MonotonicClock::start(), None);
        let mut stations = Vec::with_capacity(count);
        for (index, listener) in listeners.into_iter().enumerate() {
            // Ten halls, or one for each ten racks.
            let (hall, rack) = (index / count.div_ceil(10).max(10) + 1, index + 1);
            let own = folder.join(format!("hall{hall}-rack{rack:04}"));
            std::fs::create_dir_all(&own)?;
            std::fs::write(own.join("station.toml"), &file)?;
            let station = ob1_station_file::load(&own.join("station.toml")).map_err(|findings| texts(&findings))?;
            let loaded = match &mut loaded {
                Some(loaded) => loaded,
                none => none.insert(program::load(&station).map_err(|failure| texts(&Vec::from(failure)))?),
            };
            let begins = Instant::START + CYCLE.times(index as u64) / count as u64;
            stations.push(Simulated::new(&station, loaded, clock, listener, begins)?);
        }
        Ok(Self { stations, begun: time::Instant::now(), scans: true })
    }

    /// Virtual time passes as time does.
    fn now(&self) -> Instant {
        Instant::START + self.begun.elapsed().into()
    }

    /// The stations work until there is what is looked for.
    fn until<T>(
        &mut self,
        what: &str,
        mut look: impl FnMut(&Self) -> Result<Option<T>, Failure>,
    ) -> Result<T, Failure> {
        let begin = time::Instant::now();
        loop {
            for _ in 0..LOOK {
                let now = self.now();
                self.stations.iter_mut().for_each(|station| station.turn(now, self.scans));
                pass(TURN);
            }
            if let Some(found) = look(self)? {
                return Ok(found);
            }
            if begin.elapsed() > PATIENCE {
                return Err(format!("{what}: not after {} s", PATIENCE.as_secs()).into());
            }
        }
    }

    /// The gates of all stations, by kind of link.
    fn gates(&mut self, program: &Path, folder: &Path) -> Result<[Vec<Running>; KINDS.len()], Failure> {
        let now = self.now();
        let mut all = [const { Vec::new() }; KINDS.len()];
        for (link, (kind, gates)) in KINDS.iter().zip(&mut all).enumerate() {
            for (number, stations) in self.stations.chunks_mut(GATE).enumerate() {
                let log = folder.join(format!("{kind}-{number}.log"));
                gates.push(gate(program, (kind, link), stations, now, &log)?);
            }
        }
        Ok(all)
    }

    /// `ob1 list --prometheus`, over the control sockets of all; the file it has written.
    fn listed(&mut self, ob1: &Path, folder: &Path) -> Result<PathBuf, Failure> {
        let (run, targets, now) = (folder.join("run"), folder.join("targets.json"), self.now());
        self.stations.iter_mut().try_for_each(|station| station.listen(&run, now))?;
        let mut command = Command::new(ob1);
        command.args(["list", "--prometheus"]).arg(&targets).env("XDG_RUNTIME_DIR", &run).stdin(Stdio::null());
        let begin = time::Instant::now();
        let mut list = Running::start(&mut command, &folder.join("list.log"))?;
        self.until("ob1 list has ended", |_| Ok(list.has_ended()?.then_some(())))?;
        println!("  ob1 list --prometheus: {:.1} s", begin.elapsed().as_secs_f64());
        self.stations.iter_mut().for_each(Simulated::hush);
        Ok(targets)
    }

    /// The scans end; how many stations' last values have been heard by every kind of telegrams.
    fn stand_still(&mut self, subscriber: &Subscriber) -> Result<usize, Failure> {
        self.scans = false;
        let values: Vec<_> = self.stations.iter().map(|one| (one.name.clone(), one.values())).collect();
        let last = |heard: &Heard| {
            let is_last =
                |(name, values): &&(String, Option<_>)| values.is_some_and(|values| heard.is_last(name, values));
            values.iter().filter(is_last).count()
        };
        self.until("the last values are heard", |fleet| {
            let count = subscriber.heard(last);
            Ok((count == fleet.stations.len()).then_some(count))
        })
    }
}

/// The file of all stations: names, ports, groups and nodes are those of its patterns.
fn file(base: u16, broker: u16) -> String {
    let mqtt = |name: &str, keys: &str| {
        format!(
            "[[link]]\ntype = \"mqtt\"\nname = \"{name}\"\nbroker = \"mqtt://127.0.0.1:{broker}\"\n\
             client = \"{name}-{{station}}\"\npublish = [\"DB10\"]\nevery = \"1s\"\n{keys}\n"
        )
    };
    format!(
        "[station]\nname = \"{{folder}}\"\n\n[cpu]\nmin_cycle = \"{}ms\"\nwatchdog = \"5s\"\n\n\
         [program]\nsources = [\"../fleet.awl\"]\n\n\
         [[link]]\ntype = \"metrics\"\nname = \"figures\"\nlisten = \"127.0.0.1:{base}+{{number}}\"\n{}{}",
        CYCLE.millis(),
        mqtt(KINDS[1], &format!("prefix = \"{PREFIX}/{{1}}/{{2}}\"")),
        mqtt(KINDS[2], "sparkplug = \"{1}\"\nnode = \"{2}\"")
    )
}

/// So many ports one after the other, with what listens there; the first one is the next after the base.
fn ports(count: usize) -> Result<(u16, Vec<TcpListener>), Failure> {
    let bound = |port| {
        let listener = TcpListener::bind(("127.0.0.1", port))?;
        listener.set_nonblocking(true)?;
        Ok::<_, std::io::Error>(listener)
    };
    // Below those that the system gives to callers.
    for base in (10_000..31_000_u16).step_by(500) {
        if let Ok(listeners) = (1..=count as u16).map(|number| bound(base + number)).collect::<Result<Vec<_>, _>>() {
            return Ok((base, listeners));
        }
    }
    Err(format!("no {count} ports one after the other are free").into())
}

fn free_port() -> Result<u16, Failure> {
    Ok(TcpListener::bind(("127.0.0.1", 0))?.local_addr()?.port())
}

/// A folder for everything, removed at the end.
struct Site(PathBuf);

impl Site {
    fn new() -> Result<Self, Failure> {
        let folder = std::env::temp_dir().join(format!("ob1-bench-fleet-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        Ok(Self(folder))
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
