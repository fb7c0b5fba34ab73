//! What a shadow run has found, as text and as JSON.

use std::fmt::Write as _;
use std::path::Path;

use ob1_access::text;
use ob1_model::BlockId;
use serde_json::{Value, json};

use super::judge::{Difference, Judge};
use super::rack::Look;
use super::subject::Subject;
use crate::diff::Side;
use crate::exit::DiffExit;
use crate::import::CpuArgs;
use crate::units;

/// The form of the report.
const SCHEMA: u32 = 1;

/// The report of a run.
pub(super) struct Report<'s> {
    subject: &'s Subject,
    rack: String,
    found: Vec<Found>,
    /// The rack's program, or why it is not given; read at the first difference.
    program: Option<Result<Side, String>>,
}

struct Found {
    difference: Difference,
    /// How the rack's block differs from the station's where the difference begins.
    evidence: Vec<String>,
}

impl<'s> Report<'s> {
    pub(super) fn new(subject: &'s Subject, rack: &str) -> Self {
        Self { subject, rack: rack.to_owned(), found: Vec::new(), program: None }
    }

    /// How many cells are compared.
    pub(super) fn cells(&self) -> usize {
        self.subject.cells.iter().filter(|watched| watched.compared).count()
    }

    fn name(&self, cell: usize) -> String {
        self.subject.cells.get(cell).map_or_else(String::new, |watched| watched.item.name.clone())
    }

    fn value(&self, cell: usize, bits: u32) -> String {
        self.subject.cells.get(cell).map_or_else(String::new, |watched| text::of_bits(&watched.item, bits))
    }

    /// Notes a difference; what there is to print of it.
    pub(super) fn add(&mut self, difference: Difference, cpu: &CpuArgs) -> String {
        let evidence = self.evidence(&difference, cpu);
        let found = Found { difference, evidence };
        let text = self.told(&found);
        self.found.push(found);
        text
    }

    /// How the rack's blocks differ where the difference begins.
    fn evidence(&mut self, difference: &Difference, cpu: &CpuArgs) -> Vec<String> {
        let program = self.program.get_or_insert_with(|| Side::of_cpu(cpu));
        let Ok(rack) = program else { return Vec::new() };
        let (program, library) = (self.subject.xref.program().clone(), self.subject.library.clone());
        let own = Side::of_program(self.subject.name.clone(), program, library);
        let mut blocks: Vec<_> = difference.origins.iter().map(|origin| origin.block).collect();
        blocks.dedup();
        let told = |block: BlockId| {
            let (at, lines) = own.first_difference(rack, block)?;
            Some(std::iter::once(format!("the rack's {block} is another one, {at}:")).chain(lines))
        };
        blocks.into_iter().filter_map(told).flatten().collect()
    }

    fn told(&self, found: &Found) -> String {
        let Difference { cell, since, rack, shadow, origins, .. } = &found.difference;
        let at = units::time(since.since_start().nanos() as f64);
        let shadow = shadow.map_or_else(|| "nothing".to_owned(), |bits| self.value(*cell, bits));
        let mut text =
            format!("{} differs since {at}: rack {}, station {shadow}\n", self.name(*cell), self.value(*cell, *rack));
        for origin in origins {
            let _ = writeln!(text, "  it begins in {} ({})", origin.place, origin.operand);
        }
        for line in &found.evidence {
            let _ = writeln!(text, "  {line}");
        }
        text
    }

    /// The end of the run.
    pub(super) fn text(&self, judge: &Judge<'_>) -> String {
        let counts = judge.counts();
        let mut text = format!(
            "{} readings, {} equal; allowance {}; state taken over {} times, {} gaps, {} stops of the rack\n",
            counts.readings,
            counts.equal,
            units::time(judge.allowance().nanos() as f64),
            counts.taken_over,
            counts.gaps,
            counts.stops
        );
        if counts.once > 0 {
            let _ = writeln!(
                text,
                "{} times something differed once and not again: a change shorter than the reading, most likely",
                counts.once
            );
        }
        for (cell, _, _) in judge.cells().filter(|(_, _, missing)| *missing) {
            let _ = writeln!(text, "not compared: {}: the rack does not have it", self.name(cell));
        }
        let other = self.found.len();
        let _ = writeln!(text, "{} cells compared, {other} of them different", self.cells());
        text
    }

    pub(super) fn exit(&self, judge: &Judge<'_>) -> DiffExit {
        match (self.found.is_empty(), judge.counts().equal) {
            (false, _) => DiffExit::Other,
            (true, 0) => DiffExit::Nothing,
            (true, _) => DiffExit::Same,
        }
    }

    /// Writes the report as JSON.
    pub(super) fn write(&self, path: Option<&Path>, judge: &Judge<'_>) -> Result<(), String> {
        let Some(path) = path else { return Ok(()) };
        let counts = judge.counts();
        let cells = judge.cells().map(|(cell, differing, missing)| {
            json!({ "name": self.name(cell), "readings_different": differing, "in_rack": !missing })
        });
        let report = json!({
            "schema": SCHEMA,
            "station": self.subject.name,
            "rack": self.rack,
            "readings": counts.readings,
            "equal": counts.equal,
            "skipped": counts.skipped,
            "gaps": counts.gaps,
            "taken_over": counts.taken_over,
            "stops": counts.stops,
            "once": counts.once,
            "allowance_ms": judge.allowance().millis(),
            "not_compared": self.subject.left_out,
            "cells": cells.collect::<Vec<_>>(),
            "differences": self.found.iter().map(|found| self.json(found)).collect::<Vec<_>>(),
        });
        ob1_process::files::replace(path, report.to_string().as_bytes())
            .map_err(|error| format!("{}: {error}", path.display()))
    }

    fn json(&self, found: &Found) -> Value {
        let Difference { cell, since, rack, shadow, origins, around } = &found.difference;
        let origins = origins.iter().map(|origin| {
            let block = origin.block.to_string();
            json!({ "block": block, "network": origin.network, "line": origin.line, "operand": origin.operand })
        });
        let look = |look: &Look| {
            let inputs: String = look.inputs.iter().map(|byte| format!("{byte:02X}")).collect();
            json!({ "ms": look.at.since_start().millis(), "inputs": inputs, "values": look.values })
        };
        json!({
            "cell": self.name(*cell),
            "since_ms": since.since_start().millis(),
            "rack": self.value(*cell, *rack),
            "station": shadow.map(|bits| self.value(*cell, bits)),
            "begins": origins.collect::<Vec<_>>(),
            "program": found.evidence,
            "around": around.iter().map(look).collect::<Vec<_>>(),
        })
    }
}
