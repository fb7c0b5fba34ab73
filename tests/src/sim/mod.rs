//! The whole-station simulation: both demo stations in one thread, in virtual time.
//!
//! All tested parts are real: station files, compiler, CPU, the plugin's shared library, module adapter, segments,
//! supervisor machine, driver pump, firmware, protocol machines. Time, the life cycle of the driver processes and the
//! line are virtual. The same scenario gives exactly the same log.

pub mod cable;
pub mod clock;
pub mod device;
pub mod driver;
pub mod facts;
pub mod life;
pub mod meters;
pub mod station;
pub mod tap;
pub mod verdict;

use ob1_fakes::sim_line::End;
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_time::{Instant, Span};
use std::fmt::Write as _;
use std::path::PathBuf;

use cable::Cable;
use clock::{LongScan, VirtualClock};
use driver::Driver;
use station::SimStation;

/// A millisecond.
pub const MS: Span = Span::MILLISECOND;
/// A second.
pub const SECOND: Span = Span::SECOND;
/// There are no faults in the last part of a run: everything must recover without help.
const CALM: Span = Span::from_secs(15);

/// What is simulated.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Station files.
    pub stations: Vec<PathBuf>,
    /// Seed of all random decisions.
    pub seed: u64,
    /// Virtual time simulated.
    pub duration: Span,
    /// Faults of the line.
    pub faults: FaultRates,
    /// Consecutive characters are delivered together, delayed by at most this time, like by a tty; 0: each at its own
    /// time.
    pub coalesce: Span,
    /// Mean time between two `kill -9` of drivers; 0: none.
    pub kill_every: Span,
    /// A long scan: this time passes before and after each call of a handling block, while lines and drivers continue.
    /// 0: a scan takes no time.
    pub call: Span,
    /// Also logs every received character.
    pub wire: bool,
}

impl Scenario {
    /// The two stations of the demo for a minute, with a bad line and killed drivers. The kind and number of faults
    /// depend on the seed.
    #[must_use]
    pub fn demo(folder: &std::path::Path, seed: u64) -> Self {
        let mut rng = SplitMix64::new(seed);
        let rate = [0, 20, 100, 400][rng.below(4) as usize];
        let faults = FaultRates { flip: rate / 4, ..FaultRates::all(rate) };
        Self {
            stations: ["station-a.toml", "station-b.toml"].map(|name| folder.join(name)).to_vec(),
            seed,
            duration: 60 * SECOND,
            faults,
            kill_every: [Span::ZERO, 5 * SECOND, 12 * SECOND][rng.below(3) as usize],
            coalesce: [Span::ZERO, MS / 5, 2 * MS][rng.below(3) as usize],
            call: Span::ZERO,
            wire: false,
        }
    }
}

impl Scenario {
    /// The same for so long on a good line, and nobody is killed.
    #[must_use]
    pub fn undisturbed(self, duration: Span) -> Self {
        Self { faults: FaultRates::NONE, kill_every: Span::ZERO, duration, ..self }
    }

    /// Time after which there are no more faults.
    fn calm(&self) -> Instant {
        Instant::START + self.duration.saturating_sub(CALM)
    }
}

/// The result of a run.
#[derive(Debug)]
pub struct Outcome {
    /// All events, one line each: microseconds, source, event.
    pub log: String,
    /// The stations at the end.
    pub stations: Vec<SimStation>,
    /// The ledger of both ends and the violated rules.
    pub verdict: verdict::Verdict,
    /// Number of killed drivers.
    pub kills: u64,
    /// Number of drivers that started during a scan.
    pub up_in_scans: u64,
}

/// Runs a scenario.
///
/// # Errors
/// If the stations cannot be built.
pub fn run(scenario: &Scenario) -> Result<Outcome, String> {
    run_with(scenario, |_, _| true)
}

/// Runs a scenario with an operator: it is called for each station (by its index in the scenario) after each of its
/// cycles, can read and write everything, and ends the run with `false`.
///
/// # Errors
/// If the stations cannot be built.
pub fn run_with(
    scenario: &Scenario,
    mut operator: impl FnMut(usize, &mut SimStation) -> bool,
) -> Result<Outcome, String> {
    let mut world = World::build(scenario)?;
    while world.step(scenario, &mut operator) {}
    Ok(world.finish())
}

type Operator<'a> = dyn FnMut(usize, &mut SimStation) -> bool + 'a;

struct World {
    now: Instant,
    rng: SplitMix64,
    plant: Plant,
    stations: Vec<SimStation>,
    kill_at: Instant,
    watch: verdict::Watch,
}

/// The part that continues while a CPU works.
struct Plant {
    cables: Vec<Cable>,
    drivers: Vec<Driver>,
    log: String,
    wire: bool,
    up_in_scans: u64,
}

impl World {
    fn build(scenario: &Scenario) -> Result<Self, String> {
        let mut rng = SplitMix64::new(scenario.seed ^ 0x6f62_3131);
        let calm = scenario.calm();
        let mut cables: Vec<Cable> = Vec::new();
        let mut ends: Vec<usize> = Vec::new();
        let mut drivers = Vec::new();
        let mut stations = Vec::new();
        let cable_seed = rng.next_u64();
        for path in &scenario.stations {
            let mut plug = |line: &str| {
                // `pty:.../null-modem.pty` and `serial:.../null-modem.pty` are the two ends of one cable.
                let name = line.split_once(':').map_or(line, |(_, rest)| rest);
                let at = cables.iter().position(|c| c.name == name).unwrap_or_else(|| {
                    cables.push(Cable::new(name, cable_seed.wrapping_add(cables.len() as u64), scenario, calm));
                    ends.push(0);
                    cables.len() - 1
                });
                ends[at] += 1;
                match ends[at] {
                    1 => Ok((at, End::A)),
                    2 => Ok((at, End::B)),
                    _ => Err(format!("{line}: a cable has two ends")),
                }
            };
            stations.push(SimStation::build(path, &mut plug, &mut drivers, &mut rng)?);
        }
        let mut world = Self {
            now: Instant::START,
            rng,
            plant: Plant { cables, drivers, log: String::new(), wire: scenario.wire, up_in_scans: 0 },
            stations,
            kill_at: Instant::NEVER,
            watch: verdict::Watch::default(),
        };
        world.plan_kill(scenario);
        // The second station is switched on a little later.
        for station in world.stations.iter_mut().skip(1) {
            station.due = Instant::START + world.rng.span_below(300 * MS);
        }
        Ok(world)
    }

    fn plan_kill(&mut self, scenario: &Scenario) {
        if !scenario.kill_every.is_zero() {
            self.kill_at = self.now + scenario.kill_every / 2 + self.rng.span_below(scenario.kill_every);
            if self.kill_at >= scenario.calm() {
                self.kill_at = Instant::NEVER;
            }
        }
    }

    /// Handles everything at one instant in a fixed order: line, drivers, kills, CPUs. False at the end.
    fn step(&mut self, scenario: &Scenario, operator: &mut Operator<'_>) -> bool {
        let next = self.stations.iter().fold(self.plant.next_event().min(self.kill_at), |next, s| next.min(s.due));
        self.now = self.now.max(next);
        if self.now.since_start() >= scenario.duration {
            return false;
        }
        self.plant.advance(self.now);
        if self.now >= self.kill_at {
            self.kill();
            self.plan_kill(scenario);
        }
        let mut goes_on = true;
        for (place, station) in self.stations.iter_mut().enumerate() {
            if station.due <= self.now {
                self.now = cycle(station, self.now, scenario.call, &mut self.plant);
                station.tell(self.now, &mut self.plant.log);
                for driver in &station.drivers {
                    self.plant.drivers[*driver].listen(self.now);
                }
                self.watch.look(self.now, station, &mut self.plant.log);
                goes_on &= operator(place, station);
            }
        }
        goes_on
    }

    fn kill(&mut self) {
        let Plant { cables, drivers, log, .. } = &mut self.plant;
        let victim = self.rng.below(drivers.len() as u64) as usize;
        let driver = &mut drivers[victim];
        if driver.kill(self.now, &mut cables[driver.cable]) {
            // Writing into a String cannot fail.
            let _ = writeln!(log, "{:>12} driver {victim} killed", self.now.micros());
        }
    }

    fn finish(mut self) -> Outcome {
        let Plant { cables, drivers, log, .. } = &mut self.plant;
        let undetectable = cables.iter().map(|cable| cable.undetectable(End::A)).sum();
        let kills = drivers.iter().map(Driver::kills).sum();
        let verdict = verdict::judge(&self.stations, drivers, undetectable, kills, &self.watch);
        let _ = write!(log, "{verdict}");
        let Plant { log, up_in_scans, .. } = self.plant;
        Outcome { log, stations: self.stations, verdict, kills, up_in_scans }
    }
}

/// One cycle of a station; returns the time of its end for the plant.
fn cycle(station: &mut SimStation, now: Instant, call: Span, plant: &mut Plant) -> Instant {
    let clock = VirtualClock(now);
    if call.is_zero() {
        station.cycle(now, &mut { clock });
        return now;
    }
    let meanwhile = |_, until| {
        let were_up = plant.up();
        plant.advance(until);
        plant.up_in_scans += plant.up() - were_up;
    };
    let mut scan = LongScan { clock, call, meanwhile };
    station.cycle(now, &mut scan);
    let end = scan.clock.0;
    plant.advance(end);
    end
}

impl Plant {
    fn next_event(&self) -> Instant {
        let drivers = self.drivers.iter().fold(Instant::NEVER, |next, driver| next.min(driver.next_event()));
        self.cables.iter().filter_map(Cable::next_event).fold(drivers, Instant::min)
    }

    /// Handles everything that is due by `until`, in its order.
    fn advance(&mut self, until: Instant) {
        loop {
            let now = self.next_event().min(until);
            self.lines(now);
            for driver in &mut self.drivers {
                if driver.next_event() <= now {
                    driver.advance(now, &mut self.cables[driver.cable]);
                }
            }
            if now >= until {
                return;
            }
        }
    }

    /// Number of drivers started so far.
    fn up(&self) -> u64 {
        self.drivers.iter().map(Driver::ups).sum()
    }

    fn lines(&mut self, now: Instant) {
        let mut buffer = cable::buffer();
        for index in 0..self.cables.len() {
            while self.cables[index].next_event().is_some_and(|at| at <= now) {
                let cable = &mut self.cables[index];
                let Some((end, input)) = cable.pop(now, &mut buffer) else { break };
                let Some(input) = input else { continue };
                if self.wire {
                    // Writing into a String cannot fail.
                    let _ = writeln!(self.log, "{:>12} line {index} at {end:?}: {input:02X?}", now.micros());
                }
                if let Some(driver) = self.drivers.iter_mut().find(|d| d.cable == index && d.end == end) {
                    driver.line_event(now, input, cable);
                }
            }
        }
    }
}
