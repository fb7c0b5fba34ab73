//! What links ask the scan for: groups of writes, system status lists, commands and questions.

use ob1_model::{Cell, CellError, Event, GROUP_ENTRIES, Put, WRITE_BYTES};
use ob1_std::services::{StatusError, SystemStatus as _};

use crate::machine::Machine;
use crate::{Command, DiagEntry, ForceStep, InterruptError, ModuleStatus, OperatingState, ShortText, cells};

/// Where the record of the protection (list 0132 index 4) has its two checksums.
pub const SUMS_AT: usize = 16;
/// Bytes of a system status list that a link can be given.
pub const LIST_BYTES: usize = 8 * 1024;

/// Writes that land together, or not at all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    id: u64,
    puts: Box<[Put]>,
    pub(crate) bytes: usize,
    pub(crate) scan: u64,
    /// The first entry that could not be written, and why.
    refused: Option<(usize, CellError)>,
}

/// Why a group or a watch is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TooMuch {
    /// More than [`GROUP_ENTRIES`] or [`WRITE_BYTES`].
    Group,
    /// More than a link's share: [`ob1_model::WATCH_BYTES`] or [`ob1_model::WATCH_LINES`].
    Watch,
    /// Too many are under way already.
    UnderWay,
}

impl Group {
    /// A group of these writes, with the link's own number.
    ///
    /// # Errors
    /// [`TooMuch::Group`]: more writes or more bytes than a group may have.
    pub fn new(id: u64, puts: Vec<Put>) -> Result<Self, TooMuch> {
        let bytes = puts.iter().map(Put::bytes).sum();
        if puts.len() > GROUP_ENTRIES || bytes > WRITE_BYTES {
            return Err(TooMuch::Group);
        }
        Ok(Self { id, puts: puts.into(), bytes, scan: 0, refused: None })
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// The cycle control point at which it landed; the snapshot of that number contains it.
    #[must_use]
    pub const fn scan(&self) -> u64 {
        self.scan
    }

    /// What became of it. `Err` names the first entry that could not be written; no entry was written then. Only if a
    /// module did not take its bytes, modules before it have taken theirs.
    ///
    /// # Errors
    /// The first entry that was refused, and why.
    pub const fn outcome(&self) -> Result<(), (usize, CellError)> {
        match self.refused {
            None => Ok(()),
            Some(refused) => Err(refused),
        }
    }

    /// All or nothing, except for what modules take before one refuses.
    pub(crate) fn land(&mut self, m: &mut Machine) {
        let check = |put: &Put| match put {
            Put::Value(cell, width, value) => cells::check(m, *cell, *width, *value),
            Put::Bytes(cell, bytes) => cells::place(m, *cell, bytes.len() as u32, true).map(|_| ()),
        };
        self.refused = self.puts.iter().enumerate().find_map(|(index, put)| Some((index, check(put).err()?)));
        if self.refused.is_some() {
            return;
        }
        // Modules first: whether one takes a value shows only at the write, and nothing else is written if it does not.
        for modules in [true, false] {
            for (index, put) in self.puts.iter().enumerate() {
                if matches!(put.cell(), Cell::Peripheral(_)) != modules {
                    continue;
                }
                if let Err(error) = cells::put(m, put) {
                    self.refused = Some((index, error));
                    return;
                }
            }
        }
    }
}

/// A system status list that a link asks for, as SFC 51 reads it.
#[derive(Debug)]
pub struct Listing {
    id: u64,
    list: u16,
    index: u16,
    bytes: Vec<u8>,
    found: Result<u16, StatusError>,
    whole: bool,
}

impl Listing {
    /// A request for a list and index, with the link's own number.
    #[must_use]
    pub fn new(id: u64, list: u16, index: u16) -> Self {
        Self { id, list, index, bytes: Vec::with_capacity(LIST_BYTES), found: Err(StatusError::NotNow), whole: true }
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// Length of a record, and the records; or why there are none.
    ///
    /// # Errors
    /// [`StatusError`]: SZL_ID or INDEX is wrong, or the list is not available, as SFC 51 says it.
    pub fn found(&self) -> Result<(u16, &[u8]), StatusError> {
        self.found.map(|record| (record, self.bytes.as_slice()))
    }

    /// Whether it is the record of the protection, which has room for checksums at [`SUMS_AT`].
    #[must_use]
    pub const fn tells_protection(&self) -> bool {
        matches!((self.list, self.index), (0x0132 | 0x0232, 4) | (0x0232, 0))
    }

    /// Whether all of it is there; otherwise it is cut after [`LIST_BYTES`].
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.whole
    }

    pub(crate) fn ask(&mut self, m: &mut Machine, state: OperatingState) {
        let (bytes, whole) = (&mut self.bytes, &mut self.whole);
        // Lists are made for a running program; a link sees STOP too.
        m.seen_from_outside = Some(state);
        self.found = m.list(self.list, self.index, &mut |record| {
            if *whole && bytes.len() + record.len() <= bytes.capacity() {
                bytes.extend_from_slice(record);
            } else {
                *whole = false;
            }
        });
        m.seen_from_outside = None;
    }
}

/// A command, or a question about the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// A change of the operating state.
    Command(Command),
    /// Asks for the operating state.
    State,
    /// A diagnostic entry, counted back from the newest (0).
    Diag(u32),
    /// A hardware interrupt, see [`crate::Cpu::fire_hardware_interrupt`].
    HardwareInterrupt {
        /// The organization block, 40 to 47.
        ob: u16,
        /// Logical base address of the module, for the start information.
        address: u16,
        /// What the module reports, for the start information.
        point: u32,
    },
    /// The module with this index, in the order in which the modules were given to the CPU.
    Module(u32),
    /// Date and time of day of the CPU.
    Clock,
    /// Sets them, as SFC 0 does: the eight bytes of a DATE_AND_TIME.
    SetClock([u8; 8]),
    /// An entry for the diagnostic buffer about what a partner does.
    Note(Event, ShortText),
    /// A step of setting what is forced.
    Force(ForceStep),
}

/// What the CPU answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// The command is under way.
    Done,
    /// The operating state at the cycle control point.
    State(OperatingState),
    /// The diagnostic entry asked for.
    Diag(DiagEntry),
    /// Whether a hardware interrupt was taken.
    Interrupt(Result<(), InterruptError>),
    /// Presence and starts of a module.
    Module(ModuleStatus),
    /// The eight bytes of a DATE_AND_TIME.
    Clock([u8; 8]),
    /// Refused, for this reason; nothing was changed.
    Refused(CellError),
}

/// What a link asks together; the answers come together, in this order.
#[derive(Debug)]
pub struct Question {
    id: u64,
    asks: Box<[Ask]>,
    answers: Vec<Answer>,
}

impl Question {
    /// These commands and questions, with the link's own number.
    #[must_use]
    pub fn new(id: u64, asks: Vec<Ask>) -> Self {
        Self { id, answers: Vec::with_capacity(asks.len()), asks: asks.into() }
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// An answer for each, when it has come back.
    #[must_use]
    pub fn answers(&self) -> &[Answer] {
        &self.answers
    }

    /// The next one that has no answer yet.
    pub(crate) fn next(&self) -> Option<Ask> {
        self.asks.get(self.answers.len()).copied()
    }

    /// Its answer, for which [`Question::new`] has made room.
    pub(crate) fn answer(&mut self, answer: Answer) {
        self.answers.push(answer);
    }

    /// None of it is answered.
    pub(crate) fn begin(&mut self) {
        self.answers.clear();
    }
}
