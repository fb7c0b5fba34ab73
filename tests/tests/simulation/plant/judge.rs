//! The rules, checked after each scan.
//!
//! - An input is the complete value of its device, never older than before, or the substitute value. From the scan in
//!   which OB 86 reports the loss of the device to that in which it reports its return it is the substitute value.
//! - OB 86 and OB 82 run once for each entry, and OB 86 gets the data of the entry.
//! - A bus has failed (39C3h) once for each process of it that died, at the next scan, and at no other time; a device
//!   is lost (39C4h) only while the process is running.
//! - A device is lost if nothing was received from it for the time in the station file; a slave also if it has
//!   restarted, even if data exchange was resumed at once.
//! - A fault is reported as incoming if there was none, and as outgoing if there was one.
//! - Outputs are off if nothing was exchanged for the watchdog time.
//! - A device gets the recent outputs of OB 1, never older ones than before, and no zeros in between.
//! - The values read from an answering device are recent.

use ob1_cpu::{Cpu, OperatingState};
use ob1_model::Event;
use ob1_tests::sim::MS;
use ob1_time::{Instant, Span};

use super::device::{BYTES, Device, sensed};
use super::{CALL, COUNT, COUNTS, DEVICES, LOST_AFTER, WATCHDOG};

/// Maximum age of outputs in scans when they are written to a device. A request is created when it is sent.
const WRITTEN_AGO: u32 = 10;
/// Maximum scans since the last write to a device that is not lost. On bad wires several requests may be lost in
/// series, until the device is lost after 400 ms.
const HEARD_AGO: u32 = 50;
/// Maximum age of inputs in reads. Answers lost on the wire count as reads.
const READ_AGO: u8 = 40;
const SUBSTITUTE: [u8; BYTES] = [0xEE; BYTES];

/// The result of a seed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Told {
    pub(crate) kills: u32,
    /// Number of calls of OB 86 and OB 82.
    pub(crate) interrupts: [u16; 2],
    /// Number of expired watchdogs.
    pub(crate) expired: u32,
}

#[derive(Clone, Copy, Default)]
struct Known {
    seen: bool,
    lost: bool,
    /// The last value read.
    last: Option<u8>,
    /// Its counting has restarted, but the image does not show this yet.
    anew: bool,
    /// The last value written to it.
    driven: u32,
    /// For a restarted slave not yet reported as lost: number of scans with data exchange.
    again: Option<u32>,
    /// Whether it has reported a fault; `None`: unknown after a loss.
    faulty: Option<bool>,
}

pub(crate) struct Judge {
    seed: u64,
    cycle: Span,
    logged: u64,
    known: [Known; COUNT],
    told: Told,
    /// The outputs of OB 1.
    driven: u32,
    /// The location of each device in OB 86: diagnostic address, bus, number on it.
    places: Vec<u32>,
    /// Buses whose process is dead, and whether this must still be reported.
    dead: [Option<bool>; DEVICES.len()],
}

impl Judge {
    pub(crate) fn new(seed: u64, cycle: Span, places: Vec<u32>) -> Self {
        let known = [Known { faulty: Some(false), ..Known::default() }; COUNT];
        Self { seed, cycle, logged: 0, known, told: Told::default(), driven: 0, places, dead: [None; _] }
    }

    /// The process of a bus was killed.
    pub(crate) fn killed(&mut self, bus: usize) {
        let is_told = self.known[devices_of(bus)].iter().all(|known| known.lost || !known.seen);
        self.dead[bus] = Some(!is_told);
    }

    /// Sets for each bus whether its process is alive after a scan.
    pub(crate) fn alive(&mut self, alive: [bool; DEVICES.len()]) {
        for (dead, _) in self.dead.iter_mut().zip(alive).filter(|(_, alive)| *alive) {
            *dead = None;
        }
    }

    pub(crate) fn look<'a>(
        &mut self,
        now: Instant,
        cpu: &Cpu,
        state: OperatingState,
        devices: impl Iterator<Item = &'a mut Device>,
    ) {
        let at = format!("seed {}, {} ms", self.seed, now.millis());
        assert!(state == OperatingState::Run || now < Instant::from_millis(50), "{at}: {state:?}");
        self.entries(&at, cpu);
        for (bus, dead) in self.dead.iter().enumerate() {
            assert_ne!(*dead, Some(true), "{at}: the process of bus {bus} is dead, and nobody has said so");
        }
        let Some(db) = cpu.data_block(1) else { panic!("DB 1") };
        let ran = [0, 2].map(|n| u16::from_be_bytes([db[COUNTS + n], db[COUNTS + n + 1]]));
        assert_eq!(ran, self.told.interrupts, "{at}: OB 86 and OB 82");
        self.driven = cpu.bit_memory().first_chunk().map_or(0, |bytes| u32::from_be_bytes(*bytes));
        for (n, device) in devices.enumerate() {
            let known = &mut self.known[n];
            if device.take_restarted() {
                known.anew = true;
                known.again = (n < DEVICES[0] && known.seen && !known.lost).then_some(0);
            }
            known.is_lost_in_time(&format!("{at}, s{n}"), now, self.cycle, device);
            known.reads(&format!("{at}, s{n}"), n, &db[BYTES * n..BYTES * (n + 1)], device.reads());
            for written in device.take_written() {
                known.is_written(&format!("{at}, s{n}"), n, &written, self.driven);
            }
            let silent = now - device.heard;
            let on = device.outputs().iter().any(|byte| *byte != 0);
            assert!(!on || silent < WATCHDOG + 15 * MS, "{at}: s{n} drives, and nobody has driven it for {silent}");
        }
    }

    fn entries(&mut self, at: &str, cpu: &Cpu) {
        let new = cpu.diagnostics().take_while(|entry| entry.number > self.logged).count();
        let entries: Vec<_> = cpu.diagnostics().take(new).collect();
        for entry in entries.into_iter().rev() {
            self.logged = entry.number;
            let text = entry.text.as_str();
            let at = format!("{at}, {text}, {:?}", entry.event);
            let of = (0..COUNT).find(|n| text.starts_with(&format!("s{n}")));
            match entry.event {
                Event::BUS_FAILED => {
                    let first = of.unwrap_or_else(|| panic!("{at}: of which bus?"));
                    let bus = bus_of(first);
                    let devices = devices_of(bus);
                    assert_eq!(devices.start, first, "{at}: not the first of a bus");
                    assert_eq!(self.dead[bus].replace(false), Some(true), "{at}: its process is alive, or it was told");
                    self.ran_86(&at, cpu, entry.event, self.places[first] & 0xFF00);
                    for known in &mut self.known[devices] {
                        known.lost |= known.seen;
                        (known.again, known.faulty) = (None, None);
                    }
                }
                Event::STATION_FAILED => {
                    let n = of.expect("of a device");
                    assert_eq!(self.dead[bus_of(n)], None, "{at}: its process is dead, so the bus has failed");
                    self.ran_86(&at, cpu, entry.event, self.places[n]);
                    let known = &mut self.known[n];
                    assert!(!std::mem::replace(&mut known.lost, true), "{at}: lost twice");
                    (known.seen, known.again, known.faulty) = (true, None, None);
                }
                Event::STATION_BACK => {
                    let n = of.expect("of a device");
                    self.ran_86(&at, cpu, entry.event, self.places[n]);
                    assert!(std::mem::replace(&mut self.known[n].lost, false), "{at}: back, and was not lost");
                }
                Event::STATION_FAULT | Event::STATION_FAULT_GONE => {
                    let comes = entry.event == Event::STATION_FAULT;
                    let was = self.known[of.expect("of a device")].faulty.replace(comes);
                    assert_ne!(was, Some(comes), "{at}: told twice");
                    self.told.interrupts[1] += 1;
                }
                Event::STATION_REFUSES => panic!("{at}: refuses"),
                _ => {}
            }
        }
    }

    /// Checks one call of OB 86 and its data.
    fn ran_86(&mut self, at: &str, cpu: &Cpu, event: Event, place: u32) {
        let calls = &mut self.told.interrupts[0];
        *calls += 1;
        let from = CALL * usize::from(*calls);
        let [bytes @ .., _, _] = cpu.data_block(2).and_then(|db| db.get(from..)?.first_chunk::<CALL>()).expect("DB 2");
        let told = [&event.0.to_be_bytes()[..], &place.to_be_bytes()].concat();
        assert_eq!(bytes[..], told, "{at}: call {calls} of OB 86 is told something else");
    }

    /// Whether the program has got reports of the return of all devices, and reads them.
    pub(crate) fn all_are_back(&self) -> bool {
        self.known.iter().all(|known| known.last.is_some())
    }

    /// Checks the end, when everything has recovered.
    pub(crate) fn end<'a>(&mut self, kills: u32, devices: impl Iterator<Item = &'a mut Device>) -> Told {
        let mut told = Told { kills, ..self.told };
        for (n, (device, known)) in devices.zip(&self.known).enumerate() {
            assert!(known.seen && !known.lost, "seed {}: s{n} has not come back", self.seed);
            assert!(device.outputs().iter().any(|byte| *byte != 0), "seed {}: s{n} is off", self.seed);
            let ago = self.driven - known.driven;
            assert!(ago <= HEARD_AGO, "seed {}: s{n} was written last {ago} scans ago", self.seed);
            told.expired += device.expired;
        }
        told
    }
}

/// The devices of a bus.
fn devices_of(bus: usize) -> std::ops::Range<usize> {
    let first = DEVICES[..bus].iter().sum();
    first..first + DEVICES[bus]
}

/// The bus a device is on.
fn bus_of(n: usize) -> usize {
    (0..DEVICES.len()).find(|bus| devices_of(*bus).contains(&n)).expect("a device")
}

impl Known {
    /// Checks that a silent or restarted device is lost in time.
    fn is_lost_in_time(&mut self, at: &str, now: Instant, cycle: Span, device: &Device) {
        let silent = now - device.heard;
        assert!(
            !self.seen || self.lost || silent < LOST_AFTER + 20 * MS + 2 * cycle,
            "{at}: not heard for {silent} ns, and not lost"
        );
        if device.reads() > 0
            && let Some(scans) = &mut self.again
        {
            *scans += 1;
            assert!(*scans < 3, "{at}: it has begun anew, and nobody has said that it was lost");
        }
    }

    fn reads(&mut self, at: &str, n: usize, bytes: &[u8], readings: u64) {
        let is_sensed = bytes == sensed(n, u64::from(bytes[0]));
        self.seen |= is_sensed;
        if self.lost || !self.seen {
            assert_eq!(bytes, SUBSTITUTE, "{at}: lost");
            self.last = None;
            return;
        }
        assert!(is_sensed, "{at} reads {bytes:02X?}");
        let older = self.last.is_some_and(|last| bytes[0].wrapping_sub(last) > 127);
        assert!(!older || std::mem::take(&mut self.anew), "{at}: {:02X} after {:02X?}", bytes[0], self.last);
        let ago = (readings as u8).wrapping_sub(bytes[0]);
        assert!(self.anew || ago <= READ_AGO, "{at} reads {:02X}, which it sensed {ago} readings ago", bytes[0]);
        self.last = Some(bytes[0]);
    }

    /// `driven`: the current outputs of OB 1.
    fn is_written(&mut self, at: &str, n: usize, bytes: &[u8], driven: u32) {
        let value = u32::from_be_bytes(bytes.try_into().expect("4 bytes"));
        let (of, value) = (value >> 24, value & 0xFF_FFFF);
        assert!(value >= self.driven, "{at}: is written {value} after {}", self.driven);
        if value == 0 {
            // OB 1 has not set outputs yet.
            return;
        }
        assert_eq!(of, n as u32, "{at}: is written what is another's");
        let ago = driven.checked_sub(value).unwrap_or_else(|| panic!("{at}: is written {value}, OB 1 is at {driven}"));
        assert!(ago <= WRITTEN_AGO, "{at}: is written what OB 1 drove {ago} scans ago");
        self.driven = value;
    }
}
