//! The couplers and slaves of a bus as the program sees them: which are present, and what has been reported of them. A
//! pure machine.

use std::fmt::Write as _;

use ob1_coupler::dp::{DIAGNOSIS_BYTES, Diagnosis, DpSlave, kept_diagnosis};
use ob1_coupler::{Refusal, State, Status};
use ob1_cpu::ModuleEvent;
use ob1_model::Event;
use ob1_time::{Instant, Span};

use crate::module::messages::{self as entry, Allowance, INTERRUPTS, STATES};
use crate::supervisor::Report;

/// At most this much of the time between two looks counts as silence of the process: a scan that is late itself has not
/// seen what the process could do meanwhile.
const LOOK: Span = Span::from_millis(100);

/// A coupler, as the CPU knows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Station {
    /// Diagnostic address, by which OB 82 and OB 86 name it.
    pub diagnostic: u16,
    /// Its number on the bus.
    pub number: u8,
    /// It counts as lost when the process has published nothing for this long.
    pub lost_after: Span,
    /// What it refuses, or reports of itself, raises OB 82.
    pub interrupts: bool,
    /// What it is on PROFIBUS; none: a Modbus coupler.
    pub dp: Option<DpStation>,
}

/// A DP slave, as the CPU knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DpStation {
    /// Where its diagnosis lies among the inputs of the bus, and how long it can be.
    pub diagnosis: (usize, usize),
    /// What it must be.
    pub ident: u16,
    /// The address of its master.
    pub master: u8,
}

/// A place for the longest diagnosis.
pub(super) type DiagnosisArea = [u8; DpSlave::diagnosis_area(DIAGNOSIS_BYTES)];

impl DpStation {
    /// Its diagnosis, in `area`; `inputs` reads the bus's inputs from a place on.
    pub(super) fn diagnosis(self, area: &mut DiagnosisArea, inputs: impl FnOnce(usize, &mut [u8])) -> &[u8] {
        let (at, room) = self.diagnosis;
        let Some(area) = area.get_mut(..DpSlave::diagnosis_area(room)) else { return &[] };
        inputs(at, area);
        kept_diagnosis(area)
    }
}

/// What all stations of a bus have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationRules {
    /// The bus's diagnostic address.
    pub diagnostic: u16,
    /// The bus's number, as that of a master system.
    pub number: u8,
}

/// What has been reported of a station to the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Told {
    /// Nothing yet: it has neither come nor been missed.
    #[default]
    Nothing = 0,
    Present = 1,
    Lost = 2,
}

#[derive(Debug)]
struct Known {
    station: Station,
    present: bool,
    status: Status,
    told: Told,
    /// Lost or back, still to be reported.
    due: Option<Event>,
    /// It was not there at the start-up.
    missing: bool,
    /// The refusal that has been reported.
    refusal: Option<Refusal>,
    /// Of a DP slave: the number of the diagnosis that has been evaluated, and what has been reported of it.
    diagnosis: u64,
    faulty: bool,
    refuses: bool,
    /// Entries that may still be made of what it refuses or reports. The last word is told when there may be one more.
    words: Allowance,
}

#[derive(Debug)]
pub(super) struct Stations {
    rules: StationRules,
    list: Vec<Known>,
    /// The process has ended and was not seen at work since.
    down: bool,
    bus_failed: bool,
    report: Option<Report>,
    looked: Instant,
    silent: Span,
}

impl Stations {
    pub(super) fn new(stations: Vec<Station>, rules: StationRules) -> Self {
        let known = |station: Station| Known {
            words: Allowance::new(if station.interrupts { INTERRUPTS } else { STATES }),
            station,
            present: false,
            status: Status::default(),
            told: Told::Nothing,
            due: None,
            missing: false,
            refusal: None,
            diagnosis: 0,
            faulty: false,
            refuses: false,
        };
        let list = stations.into_iter().map(known).collect();
        Self { rules, list, down: false, bus_failed: false, report: None, looked: Instant::START, silent: Span::ZERO }
    }

    /// What the supervisor says.
    pub(super) fn process(&mut self, report: &Report) {
        match report {
            Report::Lost(_) => self.fail(),
            Report::Up(_) | Report::HeldUp(_) => self.report = Some(*report),
        }
    }

    /// The process has ended: reported once as a failure of the bus, and only if a station was there.
    fn fail(&mut self) {
        let mut had = false;
        // Each returns by itself, even if the next process is faster than the scan.
        for known in self.list.iter_mut().filter(|known| known.told == Told::Present) {
            (had, known.told, known.present) = (true, Told::Lost, false);
        }
        self.bus_failed |= had && !std::mem::replace(&mut self.down, true);
    }

    /// At the cycle control point. `running`: the process is there; `ready`: it says so itself; `fresh`: it has
    /// published an image since the last look; `status` gives what the image says of each station, `None` if invalid.
    pub(super) fn look(
        &mut self,
        now: Instant,
        (running, ready): (bool, bool),
        fresh: bool,
        status: impl Fn(usize) -> Option<Status>,
    ) {
        if !running {
            self.fail();
        }
        let alive = running && ready;
        let passed = now.since(std::mem::replace(&mut self.looked, now)).min(LOOK);
        self.silent = if fresh { Span::ZERO } else { self.silent.saturating_add(passed) };
        let silent = self.silent;
        if alive && fresh {
            self.down = false;
        }
        for (index, known) in self.list.iter_mut().enumerate() {
            let status = status(index).unwrap_or(Status { state: State::Lost, ..Status::default() });
            known.words.fill(now);
            known.look(alive && !self.down, silent, status);
        }
    }

    /// A start-up: stations that were lost before, and still are, are reported again. The starting program knows
    /// nothing.
    pub(super) fn restart(&mut self) {
        for known in &mut self.list {
            if known.told == Told::Lost && !known.present {
                (known.due, known.missing) = (Some(Event::STATION_FAILED), true);
            }
        }
    }

    /// Whether a station is missed: it is no longer, or still not, there. One that is only starting is not.
    pub(super) fn is_missed(&self, station: usize) -> bool {
        self.list.get(station).is_none_or(|known| !known.present && known.told != Told::Nothing)
    }

    /// Whether a station answers, but refuses its requests.
    pub(super) fn refuses_all(&self, station: usize) -> bool {
        self.list.get(station).is_some_and(|known| known.status.state == State::Refused)
    }

    pub(super) fn is_present(&self, station: usize) -> bool {
        self.list.get(station).is_some_and(|known| known.present)
    }

    /// Whether a station refuses a range.
    pub(super) fn refuses(&self, station: usize, range: usize) -> bool {
        self.list.get(station).is_some_and(|known| known.status.bad >> (range % 64) & 1 == 1)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    /// A station's number on the bus.
    pub(super) fn number(&self, station: usize) -> u8 {
        self.list.get(station).map_or(u8::MAX, |known| known.station.number)
    }

    /// How many diagnoses of a station differed from the one before.
    pub(super) fn diagnoses(&self, station: usize) -> u64 {
        self.list.get(station).map_or(0, |known| known.status.diagnosis)
    }

    /// What is to be reported of the bus as a whole.
    pub(super) fn bus_event(&mut self) -> Option<ModuleEvent> {
        if std::mem::take(&mut self.bus_failed) {
            return Some(self.about(Event::BUS_FAILED, 0, 0));
        }
        self.report.take().map(entry::of_report)
    }

    /// What a station is on PROFIBUS, if it is.
    pub(super) fn dp(&self, station: usize) -> Option<DpStation> {
        self.list.get(station)?.station.dp
    }

    /// What is to be reported of a station. `inputs` reads the bus's inputs from a place on. A diagnosis is long, and
    /// this is called at every scan, so the diagnosis is read only if there is something new in it.
    pub(super) fn event(&mut self, station: usize, inputs: impl FnOnce(usize, &mut [u8])) -> Option<ModuleEvent> {
        let known = self.list.get_mut(station)?;
        if let Some(event) = known.due.take() {
            let (diagnostic, number) = (known.station.diagnostic, known.station.number);
            let missing = std::mem::take(&mut known.missing);
            let mut event = self.about(event, diagnostic, number);
            event.data[6] = u8::from(missing);
            return Some(event);
        }
        if let Some(dp) = known.station.dp {
            return known.slave_event(dp, inputs);
        }
        let refusal = known.status.refusal.filter(|_| known.present || known.status.state == State::Refused);
        if refusal == known.refusal || !known.words.take() {
            return None;
        }
        known.refusal = refusal;
        Some(of_refusal(refusal, known.station.interrupts))
    }

    fn about(&self, event: Event, diagnostic: u16, number: u8) -> ModuleEvent {
        let ([s0, s1], [b0, b1]) = (diagnostic.to_be_bytes(), self.rules.diagnostic.to_be_bytes());
        let mut data = [0; 16];
        data[..6].copy_from_slice(&[s0, s1, b0, b1, self.rules.number, number]);
        ModuleEvent { event, diagnostic_interrupt: false, data, len: 0 }
    }
}

impl Known {
    /// What a DP slave says of itself: why it refuses, which faults it has.
    fn slave_event(&mut self, dp: DpStation, inputs: impl FnOnce(usize, &mut [u8])) -> Option<ModuleEvent> {
        let refuses = self.status.state == State::Refused && !self.refuses;
        let fresh = self.present && self.status.diagnosis != self.diagnosis;
        if self.present {
            self.refuses = false;
        }
        if !refuses && !fresh || !self.words.is_left() {
            return None;
        }
        let mut area = [0; _];
        let diagnosis = Diagnosis::new(dp.diagnosis(&mut area, inputs));
        if refuses {
            self.refuses = self.words.take();
            let why = diagnosis.and_then(|diagnosis| diagnosis.refusal(dp.master, dp.ident));
            return Some(match why {
                Some(why) => entry::text(Event::STATION_REFUSES, format_args!("{why}")),
                None => entry::text(Event::STATION_REFUSES, format_args!("not ready")),
            });
        }
        self.diagnosis = self.status.diagnosis;
        let diagnosis = diagnosis?;
        let was = std::mem::replace(&mut self.faulty, diagnosis.has_faults());
        if !was && !self.faulty || !self.words.take() {
            return None;
        }
        Some(of_faults(diagnosis, self.station.interrupts))
    }

    fn look(&mut self, alive: bool, silent: Span, status: Status) {
        // Lost and back between two scans: the program gets both events, one cycle control point after the other.
        let was_lost = self.told == Told::Present && status.losses != self.status.losses;
        self.present = alive && status.state == State::Running && silent < self.station.lost_after && !was_lost;
        self.status = status;
        let gone = match self.told {
            Told::Present => !self.present,
            // Only a process that is there and not silent knows how long it has waited for the station.
            Told::Nothing => alive && matches!(status.state, State::Lost | State::Refused),
            Told::Lost => false,
        };
        if self.present {
            // The first time does not count as a return.
            if self.told == Told::Lost {
                self.due = Some(Event::STATION_BACK);
            }
            self.told = Told::Present;
        } else if gone {
            self.due = Some(Event::STATION_FAILED);
            self.missing = self.told == Told::Nothing;
            self.told = Told::Lost;
        }
    }
}

/// Twelve characters of an entry.
#[derive(Default)]
struct Words([u8; ob1_coupler::dp::SHORT], usize);

impl std::fmt::Write for Words {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        for byte in text.bytes() {
            let Some(place) = self.0.get_mut(self.1) else { break };
            (*place, self.1) = (byte, self.1 + 1);
        }
        Ok(())
    }
}

/// Faults that a slave reports, or no longer: module fault, external, of a channel, of a station of class 3.
fn of_faults(diagnosis: Diagnosis<'_>, interrupts: bool) -> ModuleEvent {
    let faulty = diagnosis.has_faults();
    let event = if faulty { Event::STATION_FAULT } else { Event::STATION_FAULT_GONE };
    let mut words = Words::default();
    let _ = diagnosis.short(&mut words);
    let text = words.0.get(..words.1).unwrap_or_default();
    if !interrupts {
        return entry::text(event, format_args!("{}", std::str::from_utf8(text).unwrap_or("")));
    }
    let mut data = [0; 16];
    data[..2].copy_from_slice(&[if faulty { 0x0D } else { 0 }, 0x13]);
    data[4..4 + text.len()].copy_from_slice(text);
    ModuleEvent { event, diagnostic_interrupt: true, data, len: 4 + text.len() as u8 }
}

/// A request that is refused, or no longer: module fault, external, of a channel, of a station of class 3.
fn of_refusal(refusal: Option<Refusal>, interrupts: bool) -> ModuleEvent {
    let event = if refusal.is_some() { Event::STATION_REFUSES } else { Event::STATION_ACCEPTS };
    if interrupts {
        let mut data = [0; 16];
        data[..2].copy_from_slice(&[if refusal.is_some() { 0x0D } else { 0 }, 0x13]);
        let mut words = Words::default();
        if let Some(Refusal { function, exception, first, .. }) = refusal {
            let _ = write!(words, "{function:02X}h {first}:{exception}");
        }
        let text = words.0.get(..words.1).unwrap_or_default();
        data[4..4 + text.len()].copy_from_slice(text);
        return ModuleEvent { event, diagnostic_interrupt: true, data, len: 4 + text.len() as u8 };
    }
    match refusal {
        Some(Refusal { function, exception, first, .. }) => {
            entry::text(event, format_args!("{function:02X}h {first}: {exception:02X}h"))
        }
        None => entry::text(event, format_args!("")),
    }
}
