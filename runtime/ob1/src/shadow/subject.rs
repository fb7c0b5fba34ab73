//! What is compared: the station's program, the cells that it uses, and who writes them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use ob1_access::{Item, Names};
use ob1_cpu::{Cell, CpuConfig, DiagEntry, Width};
use ob1_ir::{Number, Op, Program};
use ob1_model::{Area, TimerKind};
use ob1_station::program::{self, Loaded};
use ob1_station::program_facts::Places;
use ob1_station_file::finding::Finding;
use ob1_station_file::{ModuleConfig, ModuleKind};
use ob1_stl::{CrossReference, Library};
use ob1_time::Span;

use super::place::Wiring;
use crate::testing::bench::Bench;

/// Time between two scans of the shadow, if its station goes faster or says nothing.
const SHORTEST_CYCLE: Span = Span::from_millis(1);

/// Inputs of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Inputs {
    pub(crate) first: u32,
    pub(crate) bytes: u32,
    /// Words that change as a whole.
    pub(crate) analog: bool,
}

/// A cell of the program.
#[derive(Clone, Debug)]
pub(crate) struct Watched {
    pub(crate) item: Item,
    /// Its value is compared in each reading; of the others only where something differs.
    pub(crate) compared: bool,
}

impl Watched {
    pub(crate) const fn is_timer(&self) -> bool {
        matches!(self.item.cell, Cell::Timer(_))
    }
}

/// A station's program as it is compared.
pub(crate) struct Subject {
    pub(crate) name: String,
    config: CpuConfig,
    modules: Vec<ModuleConfig>,
    loaded: Loaded,
    pub(crate) inputs: Vec<Inputs>,
    pub(crate) cells: Vec<Watched>,
    pub(crate) kinds: BTreeMap<u16, TimerKind>,
    /// The byte of bit memory with the clock pulses: the rack's, since its phase is its own.
    pub(crate) clock_memory: Option<u16>,
    pub(crate) xref: CrossReference<Arc<Program>>,
    /// The blocks that the program calls.
    pub(crate) library: Library,
    pub(crate) wiring: Wiring,
    /// What cannot be compared, and why.
    pub(crate) left_out: Vec<String>,
}

impl Subject {
    /// The program of a station file. `wanted`: names that are compared besides the outputs.
    ///
    /// # Errors
    /// What is wrong with the station, its program or a name.
    pub(crate) fn load(path: &Path, wanted: &[String]) -> Result<Self, String> {
        let told = |findings: Vec<Finding>| findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        let station = ob1_station_file::load(path).map_err(told)?;
        let loaded = program::load(&station).map_err(|failure| told(failure.into()))?;
        let library = program::library(&loaded.plugins, &loaded.standard).map_err(told)?;
        let xref = CrossReference::new(Arc::clone(&loaded.program), &library);
        let (mut config, name) = (station.cpu, station.name);
        let clock_memory = config.clock_memory.take();
        config.min_cycle = config.min_cycle.max(SHORTEST_CYCLE);
        let mut left_out = Vec::new();
        let inputs = station.modules.iter().filter_map(|module| match module.kind {
            ModuleKind::Inputs { bytes, analog } => {
                Some(Inputs { first: module.input_address, bytes: u32::from(bytes), analog })
            }
            ModuleKind::Outputs { .. } => None,
            _ => {
                left_out
                    .push(format!("module {}: what comes from its partners is not read from the rack", module.name));
                None
            }
        });
        let inputs = inputs.collect();
        let cells = cells(&xref, wanted, &mut left_out)?;
        let kinds = kinds(&loaded.program);
        let wiring = Wiring::new(&xref, &cells);
        let modules = station.modules;
        Ok(Self { name, config, modules, loaded, inputs, cells, kinds, clock_memory, xref, library, wiring, left_out })
    }

    /// Time between two scans of the shadow.
    pub(crate) fn cycle(&self) -> Span {
        self.config.min_cycle
    }

    /// A CPU with the program. `date`: nanoseconds since 1990 at its time 0.
    pub(crate) fn bench(&self, date: u64) -> Result<Bench, String> {
        let config = CpuConfig { date_at_start: date, ..self.config.clone() };
        let told = |findings: Vec<Finding>| findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        Bench::new(&self.name, config, &self.modules, &self.loaded).map_err(told)
    }

    /// An entry of the diagnostic buffer of a CPU with the program, with its place.
    pub(crate) fn told(&self, entry: &DiagEntry) -> String {
        Places::new(&self.loaded.program).told(entry)
    }

    /// Data blocks of the program: number and length.
    pub(crate) fn data_blocks(&self) -> impl Iterator<Item = (u16, u32)> {
        self.loaded.program.data.iter().map(|db| (db.number, db.bytes.len() as u32))
    }

    /// Bytes of bit memory.
    pub(crate) fn memory_bytes(&self) -> u32 {
        self.config.memory_bytes
    }

    /// Those of the process image of the inputs.
    pub(crate) fn image_bytes(&self) -> u32 {
        self.config.input_bytes
    }

    /// Numbers of the timers that the program uses, or of the counters.
    pub(crate) fn counted(&self, timers: bool) -> BTreeSet<u16> {
        let number = |watched: &Watched| match watched.item.cell {
            Cell::Timer(n) if timers => Some(n),
            Cell::Counter(n) if !timers => Some(n),
            _ => None,
        };
        self.cells.iter().filter_map(number).collect()
    }
}

/// The cells with an address that the program names, the outputs that it writes and `wanted` as those to compare.
fn cells(
    xref: &CrossReference<Arc<Program>>,
    wanted: &[String],
    left_out: &mut Vec<String>,
) -> Result<Vec<Watched>, String> {
    let names = Names::new(xref.program());
    let mut cells: Vec<Watched> = Vec::new();
    let mut peripheral = BTreeSet::new();
    for reference in xref.all.iter().filter(|reference| !reference.indirect) {
        let Ok(mut item) = names.parse(&reference.operand) else { continue };
        if let Cell::Peripheral(_) = item.cell {
            peripheral.extend(reference.writes().then(|| reference.operand.clone()));
            continue;
        }
        if matches!(item.cell, Cell::Timer(_) | Cell::Counter(_)) {
            item.width = Width::Word;
        }
        let compared = matches!(item.cell, Cell::Area(Area::Output, _)) && reference.writes();
        if matches!(item.cell, Cell::Area(Area::Input, _)) {
            continue;
        }
        match cells.iter_mut().find(|known| (known.item.cell, known.item.width) == (item.cell, item.width)) {
            Some(known) => known.compared |= compared,
            None => cells.push(Watched { item, compared }),
        }
    }
    if !peripheral.is_empty() {
        let list: Vec<_> = peripheral.into_iter().collect();
        left_out.push(format!("{}: outputs of the periphery cannot be read from a rack", list.join(", ")));
    }
    for name in wanted {
        let item = names.parse(name)?;
        match cells.iter_mut().find(|known| (known.item.cell, known.item.width) == (item.cell, item.width)) {
            Some(known) => known.compared = true,
            None => cells.push(Watched { item, compared: true }),
        }
    }
    Ok(cells)
}

/// How each timer is started.
fn kinds(program: &Program) -> BTreeMap<u16, TimerKind> {
    let code = program.blocks.iter().flat_map(|block| &block.code);
    let started = code.filter_map(|stmt| match &stmt.op {
        Op::StartTimer(kind, Number::Fixed(number)) => Some((*number, *kind)),
        _ => None,
    });
    started.collect()
}
