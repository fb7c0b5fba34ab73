//! How long a block takes as native code: compiled from its source, and imported.

use std::collections::BTreeSet;
use std::time::Instant;

use ob1_cpu::{OperatingState, engine::Factory};
use ob1_ir::{Op, Program, Stmt, Target};
use ob1_model::{BlockId, BlockKind, Section};
use ob1_native::{AtLoad, Tier};
use ob1_time::Span;

use crate::judge::{Pair, Side, supply};

/// Calls of the block in a scan, and scans; the shortest scan counts.
const CALLS: usize = 50;
const SCANS: u32 = 60;

impl Pair<'_> {
    /// The time of our code for one of theirs. `None` where the block does not run to its end.
    pub fn ratio(&self) -> Option<f64> {
        let native: &dyn Factory = &AtLoad(Tier::Optimised);
        let side = |at: usize| {
            let program = measured(&self.programs[at], self.id);
            Side::new(&program, self.natives(), native).ok()
        };
        let mut sides = [side(0)?, side(1)?];
        let mut rng = fastrand::Rng::with_seed(u64::from(self.id.number));
        let mut best = [f64::INFINITY; 2];
        for scan in 0..SCANS {
            // The values stay for some scans, so that both are measured with the same.
            if scan % 12 == 0 {
                for slot in self.slots().iter().filter(|s| matches!(s.section, Section::Input | Section::InOut)) {
                    supply(&mut sides, slot, &mut rng, 1000, true);
                }
            }
            for (side, best) in sides.iter_mut().zip(&mut best) {
                let began = Instant::now();
                if side.cycle(Span::from_millis(10)) != OperatingState::Run {
                    return None;
                }
                *best = best.min(began.elapsed().as_secs_f64());
            }
        }
        Some(best[1] / best[0])
    }
}

/// The block, what it calls, and an OB 1 that calls it many times.
fn measured(program: &Program, id: BlockId) -> Program {
    let mut program = program.clone();
    let ob1 = BlockId::new(BlockKind::Ob, 1);
    if let Some(ob1) = program.blocks.iter_mut().find(|b| b.id == ob1) {
        let call = ob1.code.iter().filter(|s| matches!(&s.op, Op::Call(call) if target(call.target) == id));
        ob1.code = call.cloned().cycle().take(CALLS).collect::<Vec<Stmt>>();
    }
    let mut wanted: BTreeSet<BlockId> =
        program.blocks.iter().map(|b| b.id).filter(|b| b.kind == BlockKind::Ob).collect();
    let mut open: Vec<BlockId> = wanted.iter().copied().collect();
    while let Some(next) = open.pop() {
        let code = program.blocks.iter().find(|b| b.id == next).map(|b| b.code.as_slice()).unwrap_or_default();
        for stmt in code {
            if let Op::Call(call) = &stmt.op
                && wanted.insert(target(call.target))
            {
                open.push(target(call.target));
            }
        }
    }
    program.data.retain(|d| !matches!(d.kind, ob1_ir::DataKind::Instance(fb) if !wanted.contains(&fb)));
    program.blocks.retain(|b| wanted.contains(&b.id));
    program
}

const fn target(target: Target) -> BlockId {
    match target {
        Target::Block(id) | Target::Local(id, _) => id,
        _ => BlockId::new(BlockKind::Ob, 0),
    }
}

/// The geometric mean.
pub fn mean(ratios: &[f64]) -> f64 {
    (ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len().max(1) as f64).exp()
}
