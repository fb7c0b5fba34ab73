//! What must hold, looked at after each scan.
//!
//! - An input is what its device has sensed, whole and never older than before, or the substitute. From the scan in
//!   which OB 86 says that the device is lost to that in which it says that it is back it is the substitute.
//! - OB 86 and OB 82 run once for each entry, and OB 86 is told of what the entry is.
//! - A bus has failed (39C3h) once for each process of it that died, at the next scan, and at no other time; a device
//!   is lost (39C4h) only while the process is there.
//! - A device that has not been heard for as long as the station file says is lost; so is a slave that has begun anew,
//!   however soon it was exchanged with again.
//! - A fault is reported when there was none, and is gone when there was one.
//! - Outputs are off when nothing has been exchanged for as long as the watchdog says.
//! - A device is written what OB 1 drove for it a moment ago, never something older than before, and not zeros in
//!   between.
//! - What is read of a device that answers is what it sensed a moment ago.

use ob1_cpu::{Cpu, OperatingState};
use ob1_model::Event;
use ob1_tests::sim::MS;
use ob1_time::{Instant, Span};

use super::device::{BYTES, Device, sensed};
use super::{CALL, COUNT, COUNTS, DEVICES, LOST_AFTER, WATCHDOG};

/// Scans ago: what a device is written at the most. A request is made when it goes out, and is not kept.
const WRITTEN_AGO: u32 = 10;
/// Scans ago: when a device was written at the latest that is not lost. On bad wires requests are lost one after the
/// other, for as long as it takes to be lost: 400 ms.
const HEARD_AGO: u32 = 50;
/// Readings ago: what the program reads at the most. Answers that are lost on the wire are readings too.
const READ_AGO: u8 = 40;
const SUBSTITUTE: [u8; BYTES] = [0xEE; BYTES];

/// What a seed comes to.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Told {
    pub(crate) kills: u32,
    /// Times that OB 86 and OB 82 ran.
    pub(crate) interrupts: [u16; 2],
    /// Times that a watchdog has switched off.
    pub(crate) expired: u32,
}

#[derive(Clone, Copy, Default)]
struct Known {
    seen: bool,
    lost: bool,
    /// What was read last.
    last: Option<u8>,
    /// It has begun to count anew, which the image does not show yet.
    anew: bool,
    /// What it was written last.
    driven: u32,
    /// A slave that began anew, and of which nobody has said that it was lost: scans in which it was exchanged with.
    again: Option<u32>,
    /// It has reported a fault; none: nobody can know after a loss.
    faulty: Option<bool>,
}

pub(crate) struct Judge {
    seed: u64,
    cycle: Span,
    logged: u64,
    known: [Known; COUNT],
    told: Told,
    /// What OB 1 drives.
    driven: u32,
    /// What OB 86 is told of where each device is: diagnostic address, bus, number on it.
    places: Vec<u32>,
    /// Buses whose process is dead, and whether that is still to be told.
    dead: [Option<bool>; DEVICES.len()],
}

impl Judge {
    pub(crate) fn new(seed: u64, cycle: Span, places: Vec<u32>) -> Self {
        let known = [Known { faulty: Some(false), ..Known::default() }; COUNT];
        Self { seed, cycle, logged: 0, known, told: Told::default(), driven: 0, places, dead: [None; _] }
    }

    /// The process of a bus is dead.
    pub(crate) fn killed(&mut self, bus: usize) {
        let is_told = self.known[devices_of(bus)].iter().all(|known| known.lost || !known.seen);
        self.dead[bus] = Some(!is_told);
    }

    /// Whether the process of each bus is alive: what is so after a scan.
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

    /// OB 86 has run once more, and was told this.
    fn ran_86(&mut self, at: &str, cpu: &Cpu, event: Event, place: u32) {
        let calls = &mut self.told.interrupts[0];
        *calls += 1;
        let from = CALL * usize::from(*calls);
        let [bytes @ .., _, _] = cpu.data_block(2).and_then(|db| db.get(from..)?.first_chunk::<CALL>()).expect("DB 2");
        let told = [&event.0.to_be_bytes()[..], &place.to_be_bytes()].concat();
        assert_eq!(bytes[..], told, "{at}: call {calls} of OB 86 is told something else");
    }

    /// The program has been told of all that they are there, and reads them.
    pub(crate) fn all_are_back(&self) -> bool {
        self.known.iter().all(|known| known.last.is_some())
    }

    /// Everything has come back.
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
    /// One that is not heard, or has begun anew, is lost.
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

    /// `driven`: what OB 1 drives by now.
    fn is_written(&mut self, at: &str, n: usize, bytes: &[u8], driven: u32) {
        let value = u32::from_be_bytes(bytes.try_into().expect("4 bytes"));
        let (of, value) = (value >> 24, value & 0xFF_FFFF);
        assert!(value >= self.driven, "{at}: is written {value} after {}", self.driven);
        if value == 0 {
            // Before OB 1 has driven anything.
            return;
        }
        assert_eq!(of, n as u32, "{at}: is written what is another's");
        let ago = driven.checked_sub(value).unwrap_or_else(|| panic!("{at}: is written {value}, OB 1 is at {driven}"));
        assert!(ago <= WRITTEN_AGO, "{at}: is written what OB 1 drove {ago} scans ago");
        self.driven = value;
    }
}
