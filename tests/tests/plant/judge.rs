//! What must hold, looked at after each scan.
//!
//! - An input is what its device has sensed, whole and never older than before, or the substitute. From the scan in
//!   which OB 86 says that the device is lost to that in which it says that it is back it is the substitute.
//! - OB 86 and OB 82 run once for each entry.
//! - Outputs are off when nothing has been exchanged for as long as the watchdog says.
//! - A device is written what OB 1 drove for it a moment ago, never something older than before, and not zeros in
//!   between.
//! - What is read of a device that answers is what it sensed a moment ago.

use ob1_cpu::{Cpu, OperatingState};
use ob1_model::Event;
use ob1_tests::sim::MS;
use ob1_time::Instant;

use super::device::{BYTES, Device, sensed};
use super::{COUNT, COUNTS, DEVICES, WATCHDOG};

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
}

pub(crate) struct Judge {
    seed: u64,
    logged: u64,
    known: [Known; COUNT],
    told: Told,
    /// What OB 1 drives.
    driven: u32,
}

impl Judge {
    pub(crate) fn new(seed: u64) -> Self {
        Self { seed, logged: 0, known: [Known::default(); COUNT], told: Told::default(), driven: 0 }
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
        let Some(db) = cpu.data_block(1) else { panic!("DB 1") };
        let ran = [0, 2].map(|n| u16::from_be_bytes([db[COUNTS + n], db[COUNTS + n + 1]]));
        assert_eq!(ran, self.told.interrupts, "{at}: OB 86 and OB 82");
        self.driven = cpu.bit_memory().first_chunk().map_or(0, |bytes| u32::from_be_bytes(*bytes));
        for (n, device) in devices.enumerate() {
            let known = &mut self.known[n];
            known.anew |= device.take_restarted();
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
            let ran = &mut self.told.interrupts;
            match entry.event {
                Event::BUS_FAILED => {
                    ran[0] += 1;
                    let first = of.unwrap_or_else(|| panic!("{at}: of which bus?"));
                    for known in self.known.iter_mut().skip(first).take(devices_from(first)) {
                        known.lost |= known.seen;
                    }
                }
                Event::STATION_FAILED => {
                    ran[0] += 1;
                    let known = &mut self.known[of.expect("of a device")];
                    assert!(!std::mem::replace(&mut known.lost, true), "{at}: lost twice");
                    known.seen = true;
                }
                Event::STATION_BACK => {
                    ran[0] += 1;
                    let known = &mut self.known[of.expect("of a device")];
                    assert!(std::mem::replace(&mut known.lost, false), "{at}: back, and was not lost");
                }
                Event::STATION_FAULT | Event::STATION_FAULT_GONE => ran[1] += 1,
                Event::STATION_REFUSES => panic!("{at}: refuses"),
                _ => {}
            }
        }
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

/// How many devices a bus has whose first is this.
fn devices_from(first: usize) -> usize {
    let mut at = 0;
    for count in DEVICES {
        if at == first {
            return count;
        }
        at += count;
    }
    panic!("s{first} is not the first of a bus")
}

impl Known {
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
