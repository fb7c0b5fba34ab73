//! Two whole stations that are connected by their Ethernet CPs, in one thread and in virtual time. All tested parts are
//! real: station files, compiler, CPU, the plugin's shared library, module adapter, back plane, supervisor, broker and
//! door, the CP and its machine. Time, the network and the life cycle of the CP's process are virtual.

mod judge;
mod net;
mod process;
mod program;
mod station;

use std::fmt::Write as _;
use std::path::Path;
use std::time;

use ob1_cpu::Command;
use ob1_line::sim::SplitMix64;
use ob1_tests::sim;
use ob1_time::{Instant, Span};

use judge::Judge;
pub(crate) use judge::Told;
use net::Net;
use program::LINES;
pub(crate) use program::STREAMS;
use station::Station;

pub(crate) use sim::{MS, SECOND};

/// Without further faults everything recovers within this time: the longest wait between two calls, and one job without
/// an answer.
const BACK: Span = Span::from_secs(20);
/// Of 20 kinds of fault, those from this number on kill a CP,
pub(crate) const KILL: u64 = 11;
/// and those from this number on stop a station.
pub(crate) const STOP: u64 = 17;
/// After this many telegrams of each stream it has recovered.
const ENOUGH: u32 = 3;

/// The faults in a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scenario {
    pub(crate) seed: u64,
    /// End of the faults.
    pub(crate) trouble: Instant,
    /// Average interval between faults; 0: no faults.
    pub(crate) every: Span,
    /// The only kind of fault: [`KILL`], [`STOP`].
    pub(crate) only: Option<u64>,
    /// One datagram in this many is lost, and one connection request in this many is refused; 0: none.
    pub(crate) loses: u64,
    /// A long scan: this time passes before and after each call of a handling block; 0: none.
    pub(crate) call: Span,
    /// A busy host: each process of a CP gets its core up to this late; 0: at once.
    pub(crate) late: Span,
}

/// The result of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Outcome {
    pub(crate) told: Told,
    pub(crate) breaks: u64,
    pub(crate) mutes: u64,
    pub(crate) kills: u64,
    pub(crate) stops: u64,
    /// Telegrams that were left out: see [`Judge::left_out`].
    pub(crate) left_out: u64,
    /// Number of processes that became ready during a scan.
    pub(crate) up_in_scans: u64,
    /// The faults, and at the end a digest of all events.
    pub(crate) log: String,
}

impl Outcome {
    /// Number of received telegrams.
    pub(crate) fn telegrams(&self) -> u64 {
        self.told.telegrams.iter().sum()
    }
}

struct World {
    scenario: Scenario,
    now: Instant,
    rng: SplitMix64,
    net: Net,
    stations: [Station; 2],
    judge: Judge,
    trouble: Instant,
    /// Time at which a stopped station starts again.
    starts: [Instant; 2],
    outcome: Outcome,
}

impl World {
    fn new(scenario: Scenario, folder: &Path) -> Self {
        let mut rng = SplitMix64::new(scenario.seed);
        let base = time::Instant::now();
        let mut net = Net::new(rng.next_u64());
        net.loses = scenario.loses;
        let stations = [0, 1].map(|me| Station::new(me, folder, rng.next_u64(), base, scenario.late));
        let mut world = Self {
            scenario,
            now: Instant::START,
            rng,
            net,
            stations,
            judge: Judge::new(scenario.seed),
            trouble: Instant::NEVER,
            starts: [Instant::NEVER; 2],
            outcome: Outcome::default(),
        };
        world.stations[1].due = Instant::START + world.rng.span_below(300 * MS);
        world.plan(Instant::START + SECOND);
        world
    }

    fn plan(&mut self, from: Instant) {
        let Scenario { every, trouble, .. } = self.scenario;
        let next = from + every / 8 + self.rng.span_below(2 * every + Span::from_nanos(1));
        self.trouble = if !every.is_zero() && next < trouble { next } else { Instant::NEVER };
    }

    fn goes_wrong(&mut self) {
        let now = self.now;
        let what = self.scenario.only.unwrap_or_else(|| self.rng.below(20));
        let (line, me) = (self.rng.below(LINES.len() as u64) as usize, self.rng.below(2) as usize);
        let text = match what {
            0..=9 if self.net.breaks(line, now) => {
                self.outcome.breaks += 1;
                format!("connection {} breaks", line + 1)
            }
            10 if now > self.net.mute_until && self.net.mutes(line, now) => {
                self.outcome.mutes += 1;
                format!("connection {} is mute", line + 1)
            }
            KILL..=16 => {
                let at = self.rng.next_u64() as usize;
                if !self.stations[me].process.kill(now, at, &mut self.net) {
                    return;
                }
                format!("the CP of station {me} is killed")
            }
            STOP..=19 if self.stations[me].runs() && self.starts[me] == Instant::NEVER => {
                self.outcome.stops += 1;
                self.stations[me].cpu.request(Command::Stop);
                self.starts[me] = now + 50 * MS + self.rng.span_below(5 * SECOND);
                format!("station {me} is stopped")
            }
            _ => return,
        };
        // Writing into a String cannot fail.
        let _ = writeln!(self.outcome.log, "{:>12} {text}", now.micros());
    }

    fn step(&mut self) {
        let Self { stations, net, now, .. } = self;
        let next = stations.iter().map(|station| station.due.min(station.process.next(*now, net)));
        let next = next.chain([self.trouble]).chain(self.starts).min().unwrap_or(Instant::NEVER);
        self.now = self.now.max(next);
        let now = self.now;
        for station in &mut self.stations {
            if station.process.next(now, &self.net) <= now {
                let Station { process, broker, .. } = station;
                process.advance(now, broker, &mut self.net);
            }
        }
        if now >= self.trouble {
            self.goes_wrong();
            self.plan(now);
        }
        for me in 0..2 {
            if now >= self.starts[me] {
                self.starts[me] = Instant::NEVER;
                self.stations[me].cpu.request(Command::Run);
            }
            if now >= self.stations[me].due {
                let ups = self.stations[me].process.ups;
                let now = self.stations[me].cycle(now, self.scenario.call, &mut self.net);
                self.now = now;
                self.outcome.up_in_scans += self.stations[me].process.ups - ups;
                // The broker's socket also wakes it.
                let heard = now + Span::from_micros(5) + self.rng.span_below(Span::from_micros(60));
                self.stations[me].process.nudge(heard);
                self.judge.look(now, me, &self.stations);
            }
        }
    }

    fn run(mut self) -> Outcome {
        while self.now < self.scenario.trouble {
            self.step();
        }
        self.net.loses = 0;
        self.trouble = Instant::NEVER;
        let before = self.judge.through();
        let until = self.now.max(self.net.mute_until) + BACK;
        let is_back = |now: [[u32; STREAMS.len()]; 2]| {
            now.iter().flatten().zip(before.iter().flatten()).all(|(now, before)| *now >= before + ENOUGH)
        };
        while !is_back(self.judge.through()) {
            assert!(
                self.now < until,
                "seed {}: not everything comes back: {before:?}, {:?}\n{}",
                self.scenario.seed,
                self.judge.through(),
                self.outcome.log
            );
            self.step();
        }
        let Self { stations, judge, mut outcome, now, .. } = self;
        outcome.kills = stations.iter().map(|station| station.process.kills).sum();
        outcome.left_out = judge.left_out(&stations);
        outcome.told = judge.told;
        let _ = writeln!(outcome.log, "{:>12} {:016x}", now.micros(), judge.digest);
        outcome
    }
}

/// Runs a scenario.
pub(crate) fn run(scenario: Scenario, folder: &Path) -> Outcome {
    World::new(scenario, folder).run()
}
