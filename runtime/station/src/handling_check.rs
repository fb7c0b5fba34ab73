//! Calls of handling blocks for a CP that has no use for them: found before the station runs.

use std::collections::BTreeMap;
use std::sync::Arc;

use ob1_host::plugin::Plugin;
use ob1_ir::{Arg, Op, Program, Target};
use ob1_model::{BlockId, BlockKind};
use ob1_params::{Cp240, CpKind, ModbusKind, Protocol};

use crate::finding::{Finding, Level};
use crate::station_file::{ModuleConfig, ModuleKind};

/// A handling block that does nothing at this CP.
pub(crate) const NO_USE: &str = "L022";

/// What a CP 240 does not have for its handling blocks.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Lacks {
    /// Modbus: no start-up identifier for FC 9. [S0 L1409 ff.]
    Synchronisation,
    /// Modbus slave "short": its registers are the master's data, and no block may write there.
    /// [S0 "Modbus Slave Short"]
    Handshake,
}

fn lacks(params: &Cp240) -> Option<Lacks> {
    match &params.protocol {
        Protocol::Modbus(p) if matches!(p.kind, ModbusKind::SlaveAsciiShort | ModbusKind::SlaveRtuShort) => {
            Some(Lacks::Handshake)
        }
        Protocol::Modbus(_) => Some(Lacks::Synchronisation),
        _ => None,
    }
}

/// Calls of the blocks of `ob1_cp240` with the constant address of a CP 240 that has nothing for them.
pub(crate) fn without_use(
    program: &Program,
    plugins: &[(Arc<Plugin>, BTreeMap<BlockId, BlockId>)],
    modules: &[ModuleConfig],
) -> Vec<Finding> {
    let blocks: BTreeMap<BlockId, BlockId> = plugins
        .iter()
        .filter(|(plugin, _)| plugin.info().name == CpKind::Cp240.name())
        .flat_map(|(plugin, renumber)| {
            plugin.info().blocks.iter().map(|block| (renumber.get(&block.id).copied().unwrap_or(block.id), block.id))
        })
        .collect();
    let cps: Vec<(u32, &str, Lacks)> = modules
        .iter()
        .filter_map(|module| match &module.kind {
            ModuleKind::Cp240 { params, .. } => Some((module.input_address, module.name.as_str(), lacks(params)?)),
            _ => None,
        })
        .collect();
    let mut findings = Vec::new();
    for block in &program.blocks {
        for stmt in &block.code {
            let Op::Call(call) = &stmt.op else { continue };
            let (Target::Block(id), Some(Arg::Const(address))) = (call.target, call.args.first()) else { continue };
            let Some(original) = blocks.get(&id) else { continue };
            let Some((_, name, lacks)) = cps.iter().find(|(at, ..)| at == address) else { continue };
            let (message, remedy) = match lacks {
                Lacks::Synchronisation if *original == BlockId::new(BlockKind::Fc, 9) => (
                    format!("{id} is called for \"{name}\": a CP with a Modbus protocol has nothing to synchronise"),
                    "leave the call out; it takes ANL back at once and does nothing else",
                ),
                Lacks::Handshake => (
                    format!("{id} is called for \"{name}\": the registers of a Modbus slave \"short\" are its data"),
                    "read and write the data with L PEW and T PAW; the block touches nothing there",
                ),
                Lacks::Synchronisation => continue,
            };
            let file = program.sources.get(block.source as usize).map_or("program", String::as_str);
            findings.push(Finding::in_line(Level::Warning, NO_USE, file, stmt.line, message, remedy));
        }
    }
    findings
}
