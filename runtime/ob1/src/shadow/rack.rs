//! What is read from a rack, and how: by an S7 client that cannot write.

use ob1_cpu::{Cell, Width};
use ob1_model::Area;
use ob1_model::bcd::from_bcd;
use ob1_model::calendar::{DAYS_TO_1990, days_of};
use ob1_s7::client::Observer;
use ob1_s7::wire::{self, Address, DataType};
use ob1_time::Instant;

use super::subject::Subject;
use crate::import::{CpuArgs, Socket, observe};

/// One reading: what comes in, and what the rack makes of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Look {
    pub(crate) at: Instant,
    /// The inputs of all modules, in their order.
    pub(crate) inputs: Vec<u8>,
    /// The byte with the clock pulses.
    pub(crate) clock: Option<u8>,
    /// Values of the cells that were asked for; `None`: the rack has no such cell.
    pub(crate) values: Vec<Option<u32>>,
}

/// Everything that can be read.
#[derive(Clone, Debug, Default)]
pub(crate) struct Whole {
    pub(crate) at: Instant,
    pub(crate) inputs: Vec<u8>,
    /// Values of all cells, in their order.
    pub(crate) values: Vec<Option<u32>>,
    pub(crate) memory: Vec<u8>,
    pub(crate) data: Vec<(u16, Vec<u8>)>,
    /// S5TIME of each timer.
    pub(crate) timers: Vec<(u16, u16)>,
    pub(crate) counters: Vec<(u16, u16)>,
}

/// A rack that is looked at.
pub(crate) trait Rack {
    /// A reading with the values of these cells; `None`: it is not in RUN.
    ///
    /// # Errors
    /// It does not answer. The next call tries again.
    fn look(&mut self, cells: &[usize]) -> Result<Option<Look>, String>;
    /// Everything.
    ///
    /// # Errors
    /// As [`Rack::look`].
    fn whole(&mut self) -> Result<Whole, String>;
}

/// Bytes of an area.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Piece {
    area: wire::Area,
    db: u16,
    first: u32,
    /// Bytes; of timers and counters how many.
    len: u32,
}

/// A piece with its bytes; none: the rack does not have it.
type Fetched = (Piece, Option<Vec<u8>>);

/// Bytes around an item in a request and its answer, and of the telegrams themselves.
const ITEM: usize = 12;
const ANSWERED: usize = 5;
const HEADS: usize = 14;
/// Bytes between two pieces that are read rather than named in an item of their own.
const HOLE: u32 = 12;
/// The state of the CPU in list 0424, and what RUN is there.
const STATE_LIST: u16 = 0x0424;
const STATE_AT: usize = 3;
const RUN: u8 = 8;

impl Piece {
    /// The one that holds just this cell.
    fn of(cell: Cell, width: Width) -> Option<Self> {
        let (area, db, first) = match cell {
            Cell::Area(Area::Input, bit) => (wire::Area::Inputs, 0, bit / 8),
            Cell::Area(Area::Output, bit) => (wire::Area::Outputs, 0, bit / 8),
            Cell::Area(Area::Memory, bit) => (wire::Area::Memory, 0, bit / 8),
            Cell::Db(db, bit) => (wire::Area::Db, db, bit / 8),
            Cell::Timer(n) => (wire::Area::Timers, 0, n.into()),
            Cell::Counter(n) => (wire::Area::Counters, 0, n.into()),
            Cell::Peripheral(_) | Cell::Area(..) => return None,
        };
        let piece = Self { area, db, first, len: 1 };
        Some(if piece.is_counted() { piece } else { Self { len: u32::from(width.bits().div_ceil(8)), ..piece } })
    }

    /// How many bytes into it another one begins that it holds.
    fn at(&self, other: &Self) -> Option<usize> {
        let skip = other.first.checked_sub(self.first).filter(|skip| skip + other.len <= self.len)?;
        let size = if self.is_counted() { 2 } else { 1 };
        (self.area == other.area && self.db == other.db).then_some((skip * size) as usize)
    }

    fn is_counted(&self) -> bool {
        matches!(self.area, wire::Area::Timers | wire::Area::Counters)
    }

    fn bytes(&self) -> usize {
        self.len as usize * if self.is_counted() { 2 } else { 1 }
    }

    fn address(&self) -> Address {
        let (start, ty) = match self.area {
            wire::Area::Timers => (self.first, DataType::Timer),
            wire::Area::Counters => (self.first, DataType::Counter),
            _ => (self.first * 8, DataType::Byte),
        };
        Address { area: self.area, db: self.db, start, ty, count: self.len as u16 }
    }
}

/// The pieces that cover these cells, as few as is reasonable.
fn covering(cells: impl Iterator<Item = (Cell, Width)>) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = cells.filter_map(|(cell, width)| Piece::of(cell, width)).collect();
    pieces.sort_by_key(|piece| (piece.area, piece.db, piece.first));
    let mut covering: Vec<Piece> = Vec::new();
    for piece in pieces {
        match covering.last_mut() {
            Some(last)
                if (last.area, last.db) == (piece.area, piece.db) && piece.first <= last.first + last.len + HOLE =>
            {
                last.len = last.len.max(piece.first + piece.len - last.first);
            }
            _ => covering.push(piece),
        }
    }
    covering
}

/// The value of a cell in what was read.
fn value(read: &[Fetched], cell: Cell, width: Width) -> Option<u32> {
    let wanted = Piece::of(cell, width)?;
    read.iter().find_map(|(piece, bytes)| {
        let skip = piece.at(&wanted)?;
        let bytes = bytes.as_ref()?.get(skip..)?;
        let number = |len: usize| bytes.get(..len).map(|b| b.iter().fold(0, |n, byte| n << 8 | u32::from(*byte)));
        match (piece.area, width) {
            (wire::Area::Timers, _) => number(2),
            (wire::Area::Counters, _) => number(2).and_then(from_bcd),
            (_, Width::Bit) => {
                let (Cell::Area(_, bit) | Cell::Db(_, bit)) = cell else { return None };
                Some(u32::from(bytes.first()? >> (bit % 8) & 1))
            }
            _ => number(usize::from(width.bits() / 8)),
        }
    })
}

/// A CPU on the network.
pub(crate) struct S7Rack<'s> {
    cpu: CpuArgs,
    subject: &'s Subject,
    device: Option<Observer<Socket>>,
    began: std::time::Instant,
    /// The cells of a reading, and the pieces with the inputs and them.
    cells: Vec<usize>,
    fast: Vec<Piece>,
    all: Vec<Piece>,
    memory: u32,
}

impl<'s> S7Rack<'s> {
    pub(crate) fn new(cpu: CpuArgs, subject: &'s Subject) -> Self {
        let image = subject.image_bytes();
        let inputs = subject.inputs.iter().map(|inputs| Piece {
            area: if inputs.first < image { wire::Area::Inputs } else { wire::Area::Peripheral },
            db: 0,
            first: inputs.first,
            len: inputs.bytes,
        });
        let inputs: Vec<Piece> = inputs.collect();
        let used = |watched: &super::subject::Watched| match watched.item.cell {
            Cell::Area(Area::Memory, bit) => bit / 8 + u32::from(watched.item.width.bits().div_ceil(8)),
            _ => 0,
        };
        // Where an address is known at run time only, it may be any.
        let anywhere = subject.xref.all.iter().any(|reference| reference.indirect);
        let memory = if anywhere { subject.memory_bytes() } else { subject.cells.iter().map(used).max().unwrap_or(0) };
        let mut all = inputs.clone();
        all.extend((memory > 0).then_some(Piece { area: wire::Area::Memory, db: 0, first: 0, len: memory }));
        let data = subject.data_blocks().filter(|(_, len)| *len > 0);
        all.extend(data.map(|(db, len)| Piece { area: wire::Area::Db, db, first: 0, len }));
        let others = subject.cells.iter().map(|watched| (watched.item.cell, watched.item.width));
        let others = others.filter(|(cell, _)| !matches!(cell, Cell::Area(Area::Memory, _) | Cell::Db(..)));
        all.extend(covering(others));
        Self {
            cpu,
            subject,
            device: None,
            began: std::time::Instant::now(),
            cells: Vec::new(),
            fast: inputs,
            all,
            memory,
        }
    }

    /// Nanoseconds since 1990 by the clock of the rack, at its time 0.
    pub(crate) fn date(&mut self) -> Result<u64, String> {
        let time = self.with(|device| device.clock().map_err(|error| error.0))?.map_err(|why| why.to_string())?;
        let day = days_of(time.year.into(), time.month.into(), time.day.into()).unwrap_or(DAYS_TO_1990);
        let seconds = (u64::from(time.hour) * 60 + u64::from(time.minute)) * 60 + u64::from(time.second);
        Ok((u64::from(day.saturating_sub(DAYS_TO_1990)) * 86_400 + seconds) * 1_000_000_000)
    }

    /// What a reading has to bring besides the inputs.
    fn want(&mut self, cells: &[usize]) {
        if self.cells == cells {
            return;
        }
        self.cells = cells.to_vec();
        let of = |cell: &usize| self.subject.cells.get(*cell).map(|watched| (watched.item.cell, watched.item.width));
        let clock = self.subject.clock_memory.map(|byte| (Cell::Area(Area::Memory, u32::from(byte) * 8), Width::Byte));
        self.fast.truncate(self.subject.inputs.len());
        self.fast.extend(covering(cells.iter().filter_map(of).chain(clock)));
    }

    /// Bytes and telegrams of a reading.
    pub(crate) fn cost(&mut self, cells: &[usize]) -> Result<(usize, usize), String> {
        self.want(cells);
        let pieces = self.fast.clone();
        let pdu = self.with(|device| Ok(device.pdu()))?;
        Ok((pieces.iter().map(Piece::bytes).sum(), telegrams(&pieces, pdu).len()))
    }

    /// Time since the beginning.
    pub(crate) fn now(&self) -> Instant {
        let passed = self.began.elapsed();
        Instant::START.saturating_add(ob1_time::Span::from_nanos(passed.as_nanos() as u64))
    }

    fn with<T>(&mut self, job: impl FnOnce(&mut Observer<Socket>) -> Result<T, String>) -> Result<T, String> {
        if self.device.is_none() {
            self.device = Some(observe(&self.cpu)?);
        }
        let Some(device) = &mut self.device else { return Err(String::new()) };
        // What has failed once is of no use: the answer may still come.
        let done = job(device);
        if done.is_err() {
            self.device = None;
        }
        done
    }

    fn fetch(&mut self, pieces: &[Piece]) -> Result<Vec<Fetched>, String> {
        let mut read: Vec<Fetched> = pieces.iter().map(|piece| (*piece, Some(Vec::new()))).collect();
        let pdu = self.with(|device| Ok(device.pdu()))?;
        for telegram in telegrams(pieces, pdu) {
            let addresses: Vec<Address> = telegram.iter().map(|(_, piece)| piece.address()).collect();
            let values = self.with(|device| device.read(&addresses).map_err(|error| error.0))?;
            let values = values.map_err(|why| format!("the rack refuses to be read: {why}"))?;
            for ((index, _), value) in telegram.iter().zip(values) {
                let Some((_, bytes)) = read.get_mut(*index) else { continue };
                match value {
                    Ok(value) => bytes.iter_mut().for_each(|bytes| bytes.extend_from_slice(&value)),
                    Err(_) => *bytes = None,
                }
            }
        }
        Ok(read)
    }

    fn runs(&mut self) -> Result<bool, String> {
        let list = self.with(|device| device.szl(STATE_LIST, 0).map_err(|error| error.0))?;
        Ok(list.is_ok_and(|(_, records)| records.get(STATE_AT) == Some(&RUN)))
    }

    fn inputs(&self, read: &[Fetched]) -> Vec<u8> {
        let of = |(piece, bytes): &Fetched| match bytes {
            Some(bytes) => bytes.clone(),
            None => vec![0; piece.bytes()],
        };
        read.iter().take(self.subject.inputs.len()).flat_map(of).collect()
    }
}

/// Pieces in as few telegrams as they need, each with its index in the list; long ones in parts.
fn telegrams(pieces: &[Piece], pdu: usize) -> Vec<Vec<(usize, Piece)>> {
    let mut telegrams: Vec<Vec<(usize, Piece)>> = Vec::new();
    let (mut asked, mut answered) = (pdu, pdu);
    for (index, piece) in pieces.iter().enumerate() {
        let size = piece.bytes() / piece.len.max(1) as usize;
        let most = (pdu.saturating_sub(HEADS + ANSWERED) / size.max(1)) as u32;
        let mut rest = *piece;
        while rest.len > 0 {
            let part = Piece { len: rest.len.min(most.max(1)), ..rest };
            rest = Piece { first: rest.first + part.len, len: rest.len - part.len, ..rest };
            (asked, answered) = (asked + ITEM, answered + ANSWERED + part.bytes());
            if asked > pdu || answered > pdu {
                telegrams.push(Vec::new());
                (asked, answered) = (HEADS + ITEM, HEADS + ANSWERED + part.bytes());
            }
            if let Some(last) = telegrams.last_mut() {
                last.push((index, part));
            }
        }
    }
    telegrams
}

impl Rack for S7Rack<'_> {
    fn look(&mut self, cells: &[usize]) -> Result<Option<Look>, String> {
        self.want(cells);
        if !self.runs()? {
            return Ok(None);
        }
        let before = self.now();
        let read = self.fetch(&self.fast.clone())?;
        let after = self.now();
        let at = before.saturating_add(ob1_time::Span::from_nanos(after.since(before).nanos() / 2));
        let of = |cell: &usize| self.subject.cells.get(*cell);
        let values = cells.iter().map(|cell| of(cell).and_then(|w| value(&read, w.item.cell, w.item.width))).collect();
        let clock = self.subject.clock_memory.and_then(|byte| {
            value(&read, Cell::Area(Area::Memory, u32::from(byte) * 8), Width::Byte).map(|value| value as u8)
        });
        Ok(Some(Look { at, inputs: self.inputs(&read), clock, values }))
    }

    fn whole(&mut self) -> Result<Whole, String> {
        let read = self.fetch(&self.all.clone())?;
        let at = self.now();
        let values = self.subject.cells.iter().map(|watched| value(&read, watched.item.cell, watched.item.width));
        let find = |area, db, len: u32| {
            let found = read.iter().find(|(piece, _)| (piece.area, piece.db, piece.len) == (area, db, len));
            found.and_then(|(_, bytes)| bytes.clone()).unwrap_or_default()
        };
        let data = self.subject.data_blocks().map(|(db, len)| (db, find(wire::Area::Db, db, len))).collect();
        let counted = |timers: bool| {
            let cell = |n| if timers { Cell::Timer(n) } else { Cell::Counter(n) };
            let numbers = self.subject.counted(timers).into_iter();
            numbers.filter_map(|n| Some((n, value(&read, cell(n), Width::Word)? as u16))).collect::<Vec<_>>()
        };
        Ok(Whole {
            at,
            inputs: self.inputs(&read),
            values: values.collect(),
            memory: find(wire::Area::Memory, 0, self.memory),
            data,
            timers: counted(true),
            counters: counted(false),
        })
    }
}
