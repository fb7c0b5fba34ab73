//! A CP 342-5: a PROFIBUS whose slaves are not in the address space of the CPU. The program moves their data with FC 1
//! and FC 2, reads their state with FC 3, and sets the mode with FC 4; the codes of these are in `ob1_words::cp342`.
//! (docs/cp342.md)
//!
//! A slave that is lost, refuses or reports a fault concerns the program, not the CPU: it gives an entry of the
//! diagnostic buffer, but neither OB 82 nor OB 86.

use std::sync::{Arc, Mutex};

use ob1_coupler::dp::{DIAGNOSIS_BYTES, Diagnosis};
use ob1_cpu::{Module, ModuleError, ModuleEvent, ModuleStatus};
use ob1_model::Event;
use ob1_time::Instant;
use ob1_words::cp342::{
    ALL_STATIONS, AREA_BYTES, FIELD_BYTES, HEAD_BYTES, JOB, JOB_CONTROL, JOB_DIAG, LIST_BYTES, RECEIVE, SEND,
    STATUS_BYTES, ctype, dp_status, dtype, mode, status,
};

use super::stations::Stations;
use super::{OnLoss, Shared};
use crate::module::messages as entry;

/// Registers of the module in the address space of the CPU: nothing is in them.
const REGISTERS: u16 = 16;
/// Older diagnoses that are kept of all slaves together.
const OLDER: usize = 32;
/// The highest address of a slave.
const LAST_STATION: u8 = 125;
/// Station status 1 of a diagnosis that the master makes itself: there is no such station.
const NON_EXISTENT: u8 = 0x01;
/// Number of a master that is none: no master has parametrised the slave.
const NO_MASTER: u8 = 0xFF;

/// A piece of the send area or of the receive area: the data of one slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DpPiece {
    /// Whose it is, in the order of the bus.
    pub station: usize,
    /// First byte in the area.
    pub area: usize,
    /// First byte in the image of the bus.
    pub image: usize,
    /// How many bytes it has.
    pub len: usize,
    /// What the receive area holds while the slave is not exchanged with.
    pub on_loss: OnLoss,
}

/// The slaves behind a CP 342-5.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DpAreas {
    /// Pieces of the receive area.
    pub inputs: Vec<DpPiece>,
    /// Pieces of the send area.
    pub outputs: Vec<DpPiece>,
}

/// Bytes up to the end of the last piece.
pub fn area_bytes(pieces: &[DpPiece]) -> usize {
    pieces.iter().map(|piece| piece.area + piece.len).max().unwrap_or(0)
}

/// A diagnosis with its length.
#[derive(Clone, Copy)]
struct Kept(u8, [u8; DIAGNOSIS_BYTES]);

impl Kept {
    const NONE: Self = Self(0, [0; DIAGNOSIS_BYTES]);

    fn of(bytes: &[u8]) -> Self {
        let mut kept = Self::NONE;
        let len = bytes.len().min(DIAGNOSIS_BYTES);
        kept.1[..len].copy_from_slice(&bytes[..len]);
        kept.0 = len as u8;
        kept
    }

    fn bytes(&self) -> &[u8] {
        self.1.get(..usize::from(self.0)).unwrap_or_default()
    }
}

/// What the CP knows of a slave.
#[derive(Clone, Copy)]
struct Slave {
    present: bool,
    /// The number of the diagnosis that has been evaluated.
    looked: u64,
    newest: Kept,
    /// Nobody has read [`Self::newest`].
    fresh: bool,
    faulty: bool,
}

pub(super) struct DpCp {
    shared: Arc<Mutex<Shared>>,
    areas: DpAreas,
    receive: Box<[u8]>,
    send: Box<[u8]>,
    slaves: Box<[Slave]>,
    /// Older diagnoses, the newest last.
    older: Vec<(u8, Kept)>,
    /// The process has published an image since it started.
    exchanging: bool,
    /// Mode of the master: RUN or CLEAR.
    mode: u8,
    answer: ([u8; STATUS_BYTES + FIELD_BYTES], usize),
}

impl DpCp {
    pub(super) fn new(shared: Arc<Mutex<Shared>>, areas: DpAreas) -> Self {
        let stations = shared.lock().map_or(0, |shared| shared.stations.len());
        let slave = Slave { present: false, looked: 0, newest: Kept::NONE, fresh: false, faulty: false };
        Self {
            shared,
            receive: vec![0; area_bytes(&areas.inputs).min(AREA_BYTES)].into_boxed_slice(),
            send: vec![0; area_bytes(&areas.outputs).min(AREA_BYTES)].into_boxed_slice(),
            areas,
            slaves: vec![slave; stations].into_boxed_slice(),
            older: Vec::with_capacity(OLDER),
            exchanging: false,
            mode: mode::RUN,
            answer: ([0; _], 0),
        }
    }

    /// Takes a slave's diagnosis, if it is another one than before, which is kept.
    fn learn(older: &mut Vec<(u8, Kept)>, number: u8, slave: &mut Slave, newest: Kept, fresh: bool) {
        if slave.newest.bytes() == newest.bytes() {
            return;
        }
        if slave.newest.0 > 0 {
            if older.len() == OLDER {
                older.remove(0);
            }
            older.push((number, slave.newest));
        }
        (slave.newest, slave.fresh) = (newest, fresh);
    }

    /// Once a scan: notes which slaves came, went, or have a new diagnosis.
    fn look(&mut self, shared: &Shared) {
        let Self { slaves, older, areas, receive, .. } = self;
        let stations = &shared.stations;
        for (n, slave) in slaves.iter_mut().enumerate() {
            let number = stations.number(n);
            let (present, refuses) = (stations.is_present(n), stations.refuses_all(n));
            let lost = !present && (slave.present || stations.is_missed(n));
            slave.present = present;
            if lost && !refuses {
                // The master says so itself, as the standard has it.
                let [high, low] = stations.dp(n).map_or(0, |dp| dp.ident).to_be_bytes();
                let newest = Kept::of(&[NON_EXISTENT, 0, 0, NO_MASTER, high, low]);
                Self::learn(older, number, slave, newest, true);
                slave.faulty = true;
                continue;
            }
            let counted = stations.diagnoses(n);
            // It is back: its own diagnosis is newer than the one that says it is not there.
            let back = present && slave.newest.1[0] & NON_EXISTENT != 0;
            if (present || refuses) && (counted != slave.looked || back) {
                slave.looked = counted;
                let mut area = [0; _];
                let inputs = |at: usize, into: &mut [u8]| shared.image.inputs(at, into);
                let Some(bytes) = stations.dp(n).map(|dp| Kept::of(dp.diagnosis(&mut area, inputs))) else { continue };
                let faulty = refuses || Diagnosis::new(bytes.bytes()).is_some_and(Diagnosis::has_faults);
                let fresh = faulty || std::mem::replace(&mut slave.faulty, faulty);
                slave.faulty = faulty;
                Self::learn(older, number, slave, bytes, fresh);
            }
        }
        for piece in &areas.inputs {
            let Some(place) = receive.get_mut(piece.area..piece.area + piece.len) else { continue };
            match &piece.on_loss {
                _ if stations.is_present(piece.station) => shared.image.inputs(piece.image, place),
                OnLoss::Zero => place.fill(0),
                OnLoss::Hold => {}
                OnLoss::Substitute(bytes) => place.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from),
            }
        }
    }

    /// Copies the send area into the outputs of the slaves.
    fn drive(&self, shared: &mut Shared) {
        for piece in &self.areas.outputs {
            let places = shared.outputs.get_mut(piece.image..piece.image + piece.len);
            if let (Some(to), Some(from)) = (places, self.send.get(piece.area..piece.area + piece.len)) {
                if self.mode == mode::RUN { to.copy_from_slice(from) } else { to.fill(0) }
            }
        }
    }

    fn dp_status(&self) -> u8 {
        let missing = self.slaves.iter().any(|slave| !slave.present);
        let fresh = self.slaves.iter().any(|slave| slave.fresh);
        self.mode << dp_status::MODE_AT
            | if missing { dp_status::STATIONS } else { 0 }
            | if fresh { dp_status::DIAGNOSIS } else { 0 }
    }

    fn list(&self, stations: &Stations, of: impl Fn(&Slave) -> bool) -> [u8; LIST_BYTES] {
        let mut list = [0; LIST_BYTES];
        for (n, _) in self.slaves.iter().enumerate().filter(|(_, slave)| of(slave)) {
            let number = stations.number(n);
            if let Some(byte) = list.get_mut(usize::from(number / 8)) {
                *byte |= 1 << (number % 8);
            }
        }
        list
    }

    fn answer(&mut self, status: u16, bytes: &[u8]) {
        let (answer, len) = &mut self.answer;
        answer[..STATUS_BYTES].copy_from_slice(&status.to_be_bytes());
        let place = &mut answer[STATUS_BYTES..];
        let fits = bytes.len().min(place.len());
        place[..fits].copy_from_slice(&bytes[..fits]);
        *len = STATUS_BYTES + fits;
    }

    /// DP_DIAG: makes the answer for DTYPE `wanted`.
    fn diagnose(&mut self, stations: &Stations, wanted: u8, station: u8) {
        match wanted {
            dtype::STATIONS => self.answer(0, &self.list(stations, |slave| !slave.present)),
            dtype::DIAGNOSES if self.slaves.iter().any(|slave| slave.fresh) => {
                self.answer(0, &self.list(stations, |slave| slave.fresh));
            }
            dtype::DIAGNOSES => self.answer(status::NOTHING, &[]),
            dtype::CURRENT | dtype::OLDER if station > LAST_STATION => self.answer(status::STATION, &[]),
            dtype::CURRENT | dtype::OLDER => {
                let found = (0..self.slaves.len()).find(|n| stations.number(*n) == station);
                let Some(slave) = found.and_then(|n| self.slaves.get_mut(n)) else {
                    return self.answer(status::NOT_CONFIGURED, &[]);
                };
                let kept = if wanted == dtype::CURRENT {
                    slave.fresh = false;
                    Some(slave.newest)
                } else {
                    let last = self.older.iter().rposition(|(of, _)| *of == station);
                    last.map(|at| self.older.remove(at).1)
                };
                match kept.filter(|kept| kept.0 > 0) {
                    Some(kept) => self.answer(0, kept.bytes()),
                    None => self.answer(status::NOTHING, &[]),
                }
            }
            dtype::MODE => self.answer(0, &[self.mode]),
            dtype::MODE_CPU_STOP => self.answer(0, &[mode::CLEAR]),
            dtype::MODE_CP_STOP => self.answer(0, &[mode::OFFLINE]),
            dtype::INPUTS | dtype::OUTPUTS | dtype::SLAVE => self.answer(status::UNKNOWN, &[]),
            _ => self.answer(status::TYPE, &[]),
        }
    }

    /// DP_CTRL: carries out the job field.
    fn control(&mut self, shared: &mut Shared, field: &[u8]) {
        let (ty, first) = (field.first().copied(), field.get(1).copied());
        let code = match (ty, first) {
            (None, _) => status::SHORT,
            (Some(ctype::FORGET | ctype::MODE | ctype::MODE_CPU_STOP | ctype::MODE_CP_STOP), None) => status::SHORT,
            (Some(ctype::FORGET), Some(ALL_STATIONS)) => {
                self.older.clear();
                0
            }
            (Some(ctype::FORGET), Some(station)) if station > LAST_STATION => status::STATION,
            (Some(ctype::FORGET), Some(station)) => {
                let known = (0..self.slaves.len()).any(|n| shared.stations.number(n) == station);
                self.older.retain(|(of, _)| *of != station);
                if known { 0 } else { status::NOT_CONFIGURED }
            }
            (Some(ctype::MODE), Some(mode @ (mode::RUN | mode::CLEAR))) => {
                self.mode = mode;
                self.drive(shared);
                0
            }
            // These hold already: the master below has neither STOP nor OFFLINE.
            (Some(ctype::MODE_CPU_STOP), Some(mode::CLEAR)) | (Some(ctype::MODE_CP_STOP), Some(mode::OFFLINE)) => 0,
            (Some(ctype::MODE | ctype::MODE_CPU_STOP | ctype::MODE_CP_STOP), Some(mode)) if mode > mode::OFFLINE => {
                status::PARAMETER
            }
            (Some(ctype::MODE | ctype::MODE_CPU_STOP | ctype::MODE_CP_STOP), Some(_)) => status::UNKNOWN,
            (Some(ctype::GLOBAL | ctype::CYCLIC_GLOBAL), _) => status::UNKNOWN,
            (Some(ctype::INPUTS | ctype::OUTPUTS | ctype::END | ctype::SLAVE), _) => status::UNKNOWN,
            (Some(_), _) => status::TYPE,
        };
        self.answer(code, &[]);
    }
}

/// An event of the bus as an entry of its CP: none of them concerns the CPU.
fn of_slave(event: ModuleEvent, number: u8) -> ModuleEvent {
    let said = event.data.get(..usize::from(event.len)).and_then(|text| std::str::from_utf8(text).ok()).unwrap_or("");
    match event.event {
        Event::STATION_FAILED => entry::text(Event::SLAVE_LOST, format_args!("station {number}")),
        Event::STATION_BACK => entry::text(Event::SLAVE_BACK, format_args!("station {number}")),
        other => entry::text(other, format_args!("{number}: {said}")),
    }
}

impl Module for DpCp {
    fn input_bytes(&self) -> u16 {
        REGISTERS
    }

    fn output_bytes(&self) -> u16 {
        REGISTERS
    }

    fn begin_scan(&mut self, now: Instant) {
        let shared = Arc::clone(&self.shared);
        let Ok(mut shared) = shared.try_lock() else { return };
        let fresh = shared.begin(now);
        self.exchanging = shared.is_ready() && (self.exchanging || fresh);
        self.look(&shared);
    }

    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        into.fill(0);
        if usize::from(at) + into.len() <= usize::from(REGISTERS) { Ok(()) } else { Err(ModuleError::Outside) }
    }

    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        if usize::from(at) + from.len() <= usize::from(REGISTERS) { Ok(()) } else { Err(ModuleError::Outside) }
    }

    fn end_scan(&mut self, now: Instant) {
        if let Ok(mut shared) = self.shared.try_lock() {
            shared.end(now);
        }
    }

    fn output_disable(&mut self, on: bool) {
        if let Ok(mut shared) = self.shared.try_lock() {
            shared.output_disable(on);
        }
    }

    fn cpu_state(&mut self, run: bool) {
        // A program that starts has not sent anything yet, and is in charge of the mode again.
        self.send.fill(0);
        self.mode = mode::RUN;
        if let Ok(mut shared) = self.shared.try_lock() {
            shared.cpu_state(run);
        }
    }

    fn poll_event(&mut self) -> Option<ModuleEvent> {
        let mut shared = self.shared.try_lock().ok()?;
        let Shared { stations, image, .. } = &mut *shared;
        if let Some(event) = stations.bus_event() {
            return Some(match event.event {
                Event::BUS_FAILED => entry::text(Event::DRIVER_LOST, format_args!("")),
                _ => event,
            });
        }
        (0..stations.len()).find_map(|n| {
            let event = stations.event(n, |at, into| image.inputs(at, into))?;
            Some(of_slave(event, stations.number(n)))
        })
    }

    fn status(&self) -> ModuleStatus {
        let Ok(shared) = self.shared.try_lock() else { return ModuleStatus::default() };
        let generation = shared.side.monitor().generation() as u32;
        ModuleStatus { present: shared.is_ready(), generation }
    }

    fn record_read(&mut self, record: u8, into: &mut [u8]) -> Result<usize, ModuleError> {
        match record {
            RECEIVE => {
                if !self.shared.try_lock().is_ok_and(|shared| shared.is_ready()) {
                    return Err(ModuleError::Absent);
                }
                let head = [u8::from(self.exchanging), self.dp_status()];
                let all = head.iter().chain(&self.receive);
                into.iter_mut().zip(all).for_each(|(to, from)| *to = *from);
                Ok(into.len().min(HEAD_BYTES + self.receive.len()))
            }
            JOB => {
                let (answer, len) = &self.answer;
                into.iter_mut().zip(answer.iter().take(*len)).for_each(|(to, from)| *to = *from);
                Ok(into.len().min(*len))
            }
            _ => Err(ModuleError::NoRecord),
        }
    }

    fn is_of_blocks(&self, record: u8) -> bool {
        matches!(record, SEND | RECEIVE | JOB)
    }

    fn record_write(&mut self, record: u8, from: &[u8]) -> Result<(), ModuleError> {
        let shared = Arc::clone(&self.shared);
        let Ok(mut shared) = shared.try_lock() else { return Err(ModuleError::Busy) };
        if !shared.is_ready() {
            return Err(ModuleError::Absent);
        }
        match (record, from) {
            (SEND, bytes) => {
                self.send.get_mut(..bytes.len()).ok_or(ModuleError::Outside)?.copy_from_slice(bytes);
                self.drive(&mut shared);
            }
            (JOB, &[JOB_DIAG, wanted, station]) => self.diagnose(&shared.stations, wanted, station),
            (JOB, [JOB_CONTROL, field @ ..]) => self.control(&mut shared, field),
            _ => return Err(ModuleError::NoRecord),
        }
        Ok(())
    }
}
