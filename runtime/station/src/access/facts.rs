//! What the broker needs to know of the station.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use ob1_access::audit;
use ob1_access::door::{Addresses, BlockFact, Diagnosis, Document, State};
use ob1_access::{Cell, Put, Width};
use ob1_broker::{Change, Changed, DriverState, Facts, LinkState};
use ob1_cpu::{DIAG_ENTRIES, DiagEntry, Family};
use ob1_host::driver;
use ob1_ir::{CodeBlock, Op, Program, Target};
use ob1_mc7::{BlockImage, MachineBlock, Segments, addresses, decode};
use ob1_model::{BlockId, CodeAddress, Forced};
use ob1_time::{Instant, Span};

use crate::access::pass;
use crate::access::protocol::LinkStatus;
use crate::download::Loader;
use crate::program_facts::KnownProgram;
use crate::source_view::{self, SourceView};
use crate::view::StationView;
use crate::wall_clock::unix_now;
use ob1_station_file::Station;

/// What the broker asks of the station; see [the module](self).
pub(crate) struct StationFacts {
    view: StationView,
    areas: [u32; 3],
    timers_and_counters: [u16; 2],
    min_cycle: Span,
    drivers: Vec<(String, Arc<driver::DriverStatus>)>,
    loader: Loader,
    /// Links can download blocks.
    downloads: bool,
    /// Links, and the audit log of each.
    audits: Vec<(String, PathBuf)>,
    /// It could not be written last time.
    audit_fails: bool,
    /// The machine code of blocks that are watched, newest last.
    codes: RefCell<Vec<Code>>,
}

/// Blocks whose machine code is remembered: as many as can be watched.
const CODES: usize = ob1_model::PASS_JOBS;

/// The machine code of a block.
struct Code {
    id: BlockId,
    /// The program that it belongs to: another program needs other code.
    known: Arc<KnownProgram>,
    checksum: u64,
    statements: u32,
    addresses: Vec<CodeAddress>,
}

impl Code {
    /// As an upload gives it.
    fn of(known: Arc<KnownProgram>, id: BlockId) -> Option<Self> {
        let block = known.program.blocks.iter().find(|block| block.id == id)?;
        let of_program = |id| known.program.blocks.iter().find(|block| block.id == id).map(|block| &block.interface);
        let callee = |id| of_program(id).or_else(|| known.library.get(id).map(|block| &block.interface));
        let (code, offsets) = match known.images.get(&id) {
            None => ob1_mc7::code_of(&known.program, id, &callee)?,
            Some(image) => {
                let (image, _) = BlockImage::read(image).ok()?;
                let machine = MachineBlock {
                    id,
                    name: None,
                    interface: &block.interface,
                    code: &image.code,
                    segments: &Segments::read(&image.segments).ok()?,
                    multi_instance: image.head.version != 0,
                    local_bytes: image.head.local_bytes.into(),
                };
                let decoded = decode(&machine, &callee).ok()?;
                // Other statements than those that run would be told wrong.
                let same = decoded.block.code.len() == block.code.len();
                (image.code.clone(), same.then_some(decoded.offsets)?)
            }
        };
        let (checksum, statements) = (ob1_process::files::checksum(code.iter().copied()), block.code.len() as u32 + 1);
        let addresses = addresses(&code, &offsets);
        Some(Self { id, known, checksum, statements, addresses })
    }

    fn find(&self, wanted: &[u16]) -> Addresses {
        let one = |at: &u16| {
            let found = self.addresses.binary_search_by_key(&u32::from(*at), |address| address.at);
            found.ok().and_then(|index| self.addresses.get(index)).copied()
        };
        Addresses { code: self.checksum, statements: self.statements, found: wanted.iter().map(one).collect() }
    }

    /// Where a statement begins.
    fn address(&self, statement: u32) -> Option<u16> {
        let found = self.addresses.iter().find(|address| address.statement == statement);
        found.and_then(|address| u16::try_from(address.at).ok())
    }
}

impl StationFacts {
    /// Looks into the machine code of a block.
    fn code<T>(&self, id: BlockId, look: impl FnOnce(&Code) -> T) -> Option<T> {
        let known = self.view.known.get();
        let mut codes = self.codes.borrow_mut();
        if !codes.iter().any(|code| code.id == id && Arc::ptr_eq(&code.known, &known)) {
            let code = Code::of(Arc::clone(&known), id)?;
            if codes.len() == CODES {
                codes.remove(0);
            }
            codes.push(code);
        }
        codes.iter().find(|code| code.id == id).map(look)
    }

    pub(crate) fn new(view: StationView, station: &Station, loader: Loader) -> Self {
        let cpu = &station.cpu;
        let driver = |module: &crate::view::ModuleView| Some((module.name.clone(), module.driver.clone()?));
        Self {
            drivers: view.modules.iter().filter_map(driver).collect(),
            view,
            areas: [cpu.input_bytes, cpu.output_bytes, cpu.memory_bytes],
            timers_and_counters: [cpu.timers, cpu.counters],
            min_cycle: cpu.min_cycle,
            loader,
            downloads: station.downloads.is_some(),
            audits: station.links.iter().filter_map(|link| Some((link.name.clone(), link.audit.clone()?))).collect(),
            audit_fails: false,
            codes: RefCell::default(),
        }
    }
}

/// The program as a person reads it, and what its drawings need.
#[derive(serde::Serialize)]
struct Read {
    #[serde(flatten)]
    view: SourceView,
    /// Checksum of the program: another one has another.
    sum: u32,
    /// The blocks it calls that are not its own, in the file form of `ob1_ir::file`.
    library: String,
}

fn callees(block: &CodeBlock) -> impl Iterator<Item = BlockId> {
    block.code.iter().filter_map(|stmt| match &stmt.op {
        Op::Call(call) => match call.target {
            Target::Block(id) | Target::Local(id, _) => Some(id),
            Target::Indirect(..) => None,
        },
        _ => None,
    })
}

fn json(what: &impl serde::Serialize) -> serde_json::Result<Option<String>> {
    serde_json::to_string(what).map(Some)
}

impl StationView {
    /// A document as links get it.
    #[must_use]
    pub fn document(&self, which: Document, state: State, present: &[bool], links: &[LinkState]) -> Box<[u8]> {
        let text = match which {
            Document::Program => Ok(Some(ob1_ir::write(&self.known.get().program))),
            Document::Sources => Ok(Some(self.sources())),
            Document::Status => json(&self.status(state, present)),
            Document::Timing => json(&self.timings.snapshot(true)),
            Document::Buffers => json(&self.buffers(DIAG_ENTRIES as u32)),
            Document::AlarmTexts => Ok(Some(self.alarm_texts.write())),
            Document::Links => json(&links.iter().map(LinkStatus::from).collect::<Vec<_>>()),
        };
        // What we tell can be serialized.
        text.ok().flatten().unwrap_or_default().into_bytes().into()
    }

    /// An entry of the CPU's diagnostic buffer as links get it.
    #[must_use]
    pub fn diagnosis(&self, entry: &DiagEntry) -> Diagnosis {
        let unix = self.unix_at(entry.time);
        Diagnosis {
            number: entry.number,
            time: entry.time.nanos(),
            wall: ob1_cpu::date_and_time(crate::wall_clock::date_of(unix)),
            event: entry.event.0,
            block: entry.site.map(|site| site.block),
            line: entry.site.map_or(0, |site| site.line),
            data: entry.data,
            text: entry.to_string(),
            place: self.known.get().places.of(entry).unwrap_or_default(),
            because: self.stood_in_the_way(entry).unwrap_or_default(),
            remedy: self.remedy(entry).to_owned(),
        }
    }

    /// As JSON; empty while it is being made: a large program takes a while, and the broker waits for nothing.
    fn sources(&self) -> String {
        let known = self.known.get();
        if let Some(text) = known.sources.get() {
            return text.clone();
        }
        let started = self.unix_at(Instant::START);
        if !known.is_read.swap(true, Ordering::Relaxed) {
            let of = Arc::clone(&known);
            let make = move || drop(of.sources.set(serde_json::to_string(&Read::of(&of, started)).unwrap_or_default()));
            if std::thread::Builder::new().name("sources".into()).spawn(make).is_err() {
                // Asked for again, it is tried again.
                known.is_read.store(false, Ordering::Relaxed);
            }
        }
        String::new()
    }
}

impl Read {
    fn of(known: &KnownProgram, started: u64) -> Self {
        let read = |file: &str| pass::source(file, started);
        // Of the library only what the program calls: names and parameters.
        let called: BTreeSet<BlockId> = known.program.blocks.iter().flat_map(callees).collect();
        let head = |id: BlockId| {
            let block = known.library.get(id)?;
            let (name, interface) = (Some(block.name.clone()), block.interface.clone());
            Some(CodeBlock { id, name, interface, code: Vec::new(), source: 0 })
        };
        let library = Program { blocks: called.into_iter().filter_map(head).collect(), ..Program::default() };
        Self {
            view: source_view::view(known.cross_reference(), &known.library, &read, None),
            sum: known.sums()[1],
            library: ob1_ir::write(&library),
        }
    }
}

impl Facts for StationFacts {
    fn name(&self) -> &str {
        &self.view.name
    }

    fn family(&self) -> u16 {
        match self.view.family {
            Family::S7_300 => 300,
            Family::S7_400 => 400,
        }
    }

    fn areas(&self) -> [u32; 3] {
        self.areas
    }

    fn timers_and_counters(&self) -> [u16; 2] {
        self.timers_and_counters
    }

    fn min_cycle(&self) -> Span {
        self.min_cycle
    }

    fn modules(&self) -> u32 {
        self.view.modules.len() as u32
    }

    fn drivers(&self) -> Vec<DriverState> {
        let state = |(name, status): &(String, Arc<driver::DriverStatus>)| DriverState {
            name: name.clone(),
            up: status.pid() != 0,
        };
        self.drivers.iter().map(state).collect()
    }

    fn diagnosis(&self, entry: &DiagEntry) -> Diagnosis {
        self.view.diagnosis(entry)
    }

    fn blocks(&self) -> Vec<BlockFact> {
        self.view.known.get().blocks.clone()
    }

    fn block(&self, id: BlockId) -> Option<Box<[u8]>> {
        let known = self.view.known.get();
        if let Some(image) = known.images.get(&id) {
            return Some(image.as_slice().into());
        }
        let callee = |id| known.library.get(id).map(|block| &block.interface);
        let image = ob1_mc7::image(&known.program, id, &callee)?;
        image.bytes().ok().map(Into::into)
    }

    fn checksums(&self) -> [u32; 2] {
        self.view.known.get().sums()
    }

    fn addresses(&self, id: BlockId, wanted: &[u16]) -> Option<Addresses> {
        self.code(id, |code| code.find(wanted))
    }

    fn address(&self, id: BlockId, statement: u32) -> Option<u16> {
        self.code(id, |code| code.address(statement)).flatten()
    }

    fn document(&self, which: Document, state: State, present: &[bool], links: &[LinkState]) -> Box<[u8]> {
        self.view.document(which, state, present, links)
    }

    fn change(&mut self, number: u64, change: Change) -> bool {
        self.downloads && self.loader.change(number, change)
    }

    fn record(&mut self, link: &str, partner: &str, what: &str, outcome: &str) {
        let Some((_, path)) = self.audits.iter().find(|(name, _)| name == link) else { return };
        let line = audit::line(unix_now() / 1_000_000, [link, "-", partner, what, outcome]);
        // Opened for each line: there are few, and whoever rotates the file need not tell us.
        let file = OpenOptions::new().append(true).create(true).mode(0o600).open(path);
        let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
        if let Err(why) = &written
            && !self.audit_fails
        {
            tracing::error!("the audit log {} cannot be written: {why}", path.display());
        }
        self.audit_fails = written.is_err();
    }

    fn changed(&mut self) -> Option<Changed> {
        self.loader.changed()
    }

    fn force(&mut self, cells: Vec<Forced>) {
        self.view.forces.set(cells);
    }

    fn forced(&self) -> Vec<Forced> {
        self.view.forces.now()
    }

    fn take_input(&self, put: &Put) -> bool {
        let Some(panel) = &self.view.panel else { return false };
        match put {
            Put::Value(cell, width, value) => panel.write(*cell, *width, *value),
            Put::Bytes(cell @ Cell::Area(..), bytes) => {
                let mut all = true;
                for (offset, byte) in (0..).zip(bytes) {
                    let cell = cell.at_bit(cell.bit().saturating_add(offset * 8));
                    all &= panel.write(cell, Width::Byte, u32::from(*byte));
                }
                all
            }
            Put::Bytes(..) => false,
        }
    }
}
