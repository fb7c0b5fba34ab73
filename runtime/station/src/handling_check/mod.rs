//! Calls of handling blocks held against the station file: what cannot work is found before the station runs.
//!
//! Only what is certain from constants is told: a call whose address comes from a variable is nobody's.

mod data;
mod paths;
mod sites;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{Op, Place, Program};
use ob1_model::{Area, BlockId};
use ob1_params::{Cp240, CpKind, ModbusKind, Protocol};

use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::{ModuleConfig, ModuleKind, Station};
use sites::{Handling, Site};

pub(crate) use sites::blocks_of;

/// A handling block that does nothing at this CP.
const NO_USE: &str = "L022";
/// A handling block that does not fit the protocol or the interface of its CP.
const DOES_NOT_FIT: &str = "L024";
/// A CP that waits for FC 9 for ever.
const NO_SYNCHRONISATION: &str = "L025";
/// No such CP at the address.
const NO_CP: &str = "L026";
/// A data block that is missing or too short.
const DATA: &str = "L027";
/// A timer that the CPU does not have.
const TIMER: &str = "L028";
/// Two instances of a block that may have one for each CP.
const INSTANCES: &str = "L029";
/// FC 0 twice in one scan.
const TWICE: &str = "L030";

/// What is wrong with a call, and what helps.
type Told = (&'static str, String, String);

/// Everything that the calls of handling blocks have wrong.
pub(crate) fn findings(program: &Program, blocks: &BTreeMap<BlockId, Handling<'_>>, station: &Station) -> Vec<Finding> {
    let sites = sites::sites(program, blocks);
    let mut told: Vec<(Site<'_>, Told)> = Vec::new();
    for site in &sites {
        told.extend(data::of(program, station, site).map(|data| (*site, data)));
        told.extend(timer(station, site).map(|timer| (*site, timer)));
        let Some(address) = site.address() else { continue };
        let module = module_at(station, address);
        let found = match module.filter(|module| module.kind.cp() == Some(site.block.cp)) {
            Some(module) => misfit(module, site),
            None => Some(no_cp(module, site, address)),
        };
        told.extend(found.map(|found| (*site, found)));
    }
    for module in &station.modules {
        let own: Vec<Site<'_>> = sites.iter().filter(|site| is_for(station, site, module)).copied().collect();
        told.extend(unsynchronised(program, &sites, module, &own));
        told.extend(instances(program, module, &own));
        let sends: Vec<Site<'_>> = own.into_iter().filter(|site| site.number(CpKind::Cp240) == Some(0)).collect();
        told.extend(paths::twice(program, &sends).into_iter().map(|pair| sent_twice(program, module, pair)));
    }
    told.into_iter().map(|(site, told)| finding(program, &site, told)).collect()
}

fn finding(program: &Program, site: &Site<'_>, (number, message, remedy): Told) -> Finding {
    Finding::in_line(Level::Warning, number, file_of(program, site), site.line(), message, &remedy)
}

fn file_of<'a>(program: &'a Program, site: &Site<'_>) -> &'a str {
    program.sources.get(site.caller.source as usize).map_or("program", String::as_str)
}

fn module_at(station: &Station, address: u32) -> Option<&ModuleConfig> {
    station.modules.iter().find(|module| module.input_address == address || module.output_address == address)
}

/// Whether a call is for this module.
fn is_for(station: &Station, site: &Site<'_>, module: &ModuleConfig) -> bool {
    let at = site.address().and_then(|address| module_at(station, address));
    module.kind.cp() == Some(site.block.cp) && at.is_some_and(|at| at.name == module.name)
}

fn no_cp(module: Option<&ModuleConfig>, site: &Site<'_>, address: u32) -> Told {
    let (id, cp) = (site.id, site.block.cp.row().text);
    let message = match module.map(|module| (module.name.as_str(), module.kind.cp())) {
        Some((name, Some(other))) => {
            format!("{id} is for a {cp}, and \"{name}\" at {address} is a {}", other.row().text)
        }
        Some((name, None)) => format!("{id} is for a {cp}, and \"{name}\" at {address} is none"),
        None => format!("{id} is called for address {address}, where no module begins"),
    };
    let remedy = match site.block.cp {
        CpKind::Cp240 => {
            "its access to the registers is a fault: OB 122, STOP without it; write the `address` of a cp240"
        }
        _ => "each of its jobs ends with an error; write the `address` of its module",
    };
    (NO_CP, message, remedy.to_owned())
}

/// A call that does not fit the CP at its address.
fn misfit(module: &ModuleConfig, site: &Site<'_>) -> Option<Told> {
    let ModuleKind::Cp240 { params, .. } = &module.kind else { return None };
    let (number, id, name) = (site.number(CpKind::Cp240)?, site.id, &module.name);
    let protocol = params.protocol_name();
    let told = |code, message: String, remedy: &str| Some((code, message, remedy.to_owned()));
    match (&params.protocol, number) {
        // Its registers are the master's data, and no block may write there. [S0 "Modbus Slave Short"]
        (Protocol::Modbus(p), _) if matches!(p.kind, ModbusKind::SlaveAsciiShort | ModbusKind::SlaveRtuShort) => told(
            NO_USE,
            format!("{id} is called for \"{name}\": the registers of a Modbus slave \"short\" are its data"),
            "read and write the data with L PEW and T PAW; the block touches nothing there",
        ),
        // No start-up identifier. [S0 L1409 ff.]
        (Protocol::Modbus(_), 9) => told(
            NO_USE,
            format!("{id} is called for \"{name}\": a CP with a Modbus protocol has nothing to synchronise"),
            "leave the call out; it takes ANL back at once and does nothing else",
        ),
        // FC 0 and FC 1 are not for RK 512, FC 2 to FC 4 for nothing else; FC 11 is for ASCII. [S0 L1409 ff.]
        (Protocol::S3964(p), 0 | 1 | 11) if p.rk512 => told(
            DOES_NOT_FIT,
            format!("{id} is called for \"{name}\" with \"{protocol}\": its telegrams are orders of RK 512"),
            "nothing is sent and nothing comes; FC 3 sends, FC 2 fetches, FC 4 serves the partner",
        ),
        (Protocol::S3964(p), 2..=4) if p.rk512 => None,
        (_, 2 | 3) => told(
            DOES_NOT_FIT,
            format!("{id} is called for \"{name}\" with \"{protocol}\": it is for RK 512"),
            "each order ends with error 0Ch in ANZW; FC 0 sends, or `protocol = \"3964r-rk512\"`",
        ),
        (_, 4) => told(
            DOES_NOT_FIT,
            format!("{id} is called for \"{name}\" with \"{protocol}\": it serves orders of RK 512"),
            "no order comes; FC 1 receives, or `protocol = \"3964r-rk512\"`",
        ),
        (Protocol::Ascii(p), 1) if p.fragmented => told(
            DOES_NOT_FIT,
            format!("{id} is called for \"{name}\" with \"{protocol}\": each block of 12 bytes is a telegram to it"),
            "FC 11 puts the blocks together and tells the end of a telegram",
        ),
        (_, 8) => misfit_of_lines(params, site, name),
        _ => None,
    }
}

fn misfit_of_lines(params: &Cp240, site: &Site<'_>, name: &str) -> Option<Told> {
    let (id, interface) = (site.id, params.interface);
    let message = match &params.protocol {
        // Their connectors are two pins, and an antenna. [S0 L4711], [S1 L781 ff.]
        protocol if !protocol.has_diagnostics() => {
            format!("{id} is called for \"{name}\": a CP with \"{}\" has no modem lines", params.protocol_name())
        }
        // [S0 L1504], [S0 L1526]
        _ if !interface.has_modem_lines() => {
            format!("{id} is called for \"{name}\": with `interface = \"{}\"` it has RTS alone", interface.name())
        }
        _ => return None,
    };
    let remedy = "the lines it does not have read 0, and DTR cannot be set; leave the call out";
    Some((DOES_NOT_FIT, message, remedy.to_owned()))
}

fn timer(station: &Station, site: &Site<'_>) -> Option<Told> {
    let timer = site.fixed("TIMER_NR").filter(|timer| u32::from(*timer) >= station.cpu.timers as u32)?;
    let message = format!("{} has TIMER_NR := T {timer}, and the CPU has {} timers", site.id, station.cpu.timers);
    let remedy = "the call is a fault: OB 121, STOP without it; use a timer that exists, or raise `timers` in [cpu]";
    Some((TIMER, message, remedy.to_owned()))
}

/// A CP 240 whose blocks are called, but not FC 9. `all`: the sites of the program, `own`: those for this module.
fn unsynchronised<'a>(
    program: &Program,
    all: &[Site<'a>],
    module: &ModuleConfig,
    own: &[Site<'a>],
) -> Option<(Site<'a>, Told)> {
    let ModuleKind::Cp240 { params, .. } = &module.kind else { return None };
    let is_synchron = |site: &Site<'_>| site.number(CpKind::Cp240) == Some(9);
    // One whose address is not known may be for this module; so may one that writes the words itself.
    let somebody = own.iter().any(is_synchron)
        || all.iter().any(|site| is_synchron(site) && site.address().is_none())
        || writes_registers(program, module.output_address);
    let first = own.iter().find(|site| site.number(CpKind::Cp240) != Some(8))?;
    if somebody || !params.protocol.has_identifier() {
        return None;
    }
    let message =
        format!("nothing calls FC 9 for \"{}\": it shows its start-up (8001h) and waits for ever", module.name);
    let remedy = "call FC 9 with its ADR in OB 1 in each cycle, and set its ANL in OB 100";
    Some((*first, (NO_SYNCHRONISATION, message, remedy.to_owned())))
}

/// Whether the program writes the first words of a module without a handling block.
fn writes_registers(program: &Program, address: u32) -> bool {
    let words = address..address + 4;
    program.blocks.iter().flat_map(|block| &block.code).any(|stmt| match &stmt.op {
        Op::Transfer(operand) => match operand.place {
            Place::Fixed(Area::Peripheral | Area::Output, at) => words.contains(&at.byte()),
            _ => false,
        },
        _ => false,
    })
}

/// Blocks with an instance of which there may be one for each CP.
fn is_alone(cp: CpKind, number: u16) -> bool {
    match cp {
        // "only one P_SND_RK ... for each CP 341" [S4 L1584]
        CpKind::Cp341 => matches!(number, 7 | 8 | 13),
        CpKind::Cp340 => matches!(number, 2..=4),
        // One byte of the registers is theirs. (ours)
        CpKind::Cp040 => matches!(number, 60 | 61 | 65),
        CpKind::Cp240 | CpKind::Cp343 => false,
    }
}

fn instances<'a>(program: &Program, module: &ModuleConfig, own: &[Site<'a>]) -> Vec<(Site<'a>, Told)> {
    let mut told = Vec::new();
    let mut known: BTreeMap<BlockId, BTreeSet<Vec<u32>>> = BTreeMap::new();
    for site in own.iter().filter(|site| is_alone(site.block.cp, site.block.original.number)) {
        let known = known.entry(site.id).or_default();
        let before = known.len();
        known.extend(site.instances(program));
        if known.len() > before.max(1) {
            let (id, cp) = (site.id, site.block.cp.row().text);
            let message = format!("{id} works for \"{}\" with more than one instance", module.name);
            let remedy = format!(
                "a {cp} does one such job at a time, and answers one instance: use one for each CP, and give it the jobs \
                 one after the other"
            );
            told.push((*site, (INSTANCES, message, remedy)));
        }
    }
    told
}

fn sent_twice<'a>(
    program: &Program,
    module: &ModuleConfig,
    (earlier, later): (Site<'a>, Site<'a>),
) -> (Site<'a>, Told) {
    let (file, line) = (file_of(program, &earlier), earlier.line());
    let message = format!("{} is called twice in one scan for \"{}\", first at {file}:{line}", later.id, module.name);
    let remedy = "with FRG = 1 at both, both orders fail and nothing is sent: jump over one of them while the other has \
        an order, as with the slaves of a Modbus master, which are asked one after the other";
    (later, (TWICE, message, remedy.to_owned()))
}
