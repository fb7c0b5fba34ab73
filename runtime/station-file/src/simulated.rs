//! Simulated lines: `[[simulated_line]]`, and who is on them.

use std::path::Path;

use ob1_time::Span;

use super::findings::{CONTRADICTION, Findings, LINE, MISSING, TWICE, VALUE};
use super::line::Line;
use super::tables::{Placed, RatesTable, SimulatedLineTable, StationFile};
use ob1_serial::FaultRates;

use super::types::{Bursts, DELAY_MAX, Partner, SimulatedLine};
use super::values::{choice, name, number, time};
use crate::finding::nearest;

/// Stands in for the missing length of a burst: the file is refused anyway.
const SHORTEST: Span = Span::from_nanos(1);

pub(super) fn lines(f: &mut Findings<'_>, file: &StationFile, folder: &Path) -> Vec<SimulatedLine> {
    let tables = &file.simulated_line;
    let mut lines: Vec<SimulatedLine> = Vec::with_capacity(tables.len());
    for table in tables {
        let line = line(f, table, folder);
        if lines.iter().any(|other| other.name == line.name) {
            let message = format!("there are two simulated lines with the name \"{}\"", line.name);
            f.error(TWICE, table.name.span(), message, "give each line a name of its own");
        }
        lines.push(line);
    }
    places(f, file, &lines);
    lines
}

fn line(f: &mut Findings<'_>, table: &SimulatedLineTable, folder: &Path) -> SimulatedLine {
    let faults = table.faults.as_ref().map(|rates| {
        for key in [&rates.every, &rates.length].into_iter().flatten() {
            f.error(
                CONTRADICTION,
                key.span(),
                "`every` and `length` belong to `bursts`: `faults` apply all the time",
                "put them under `bursts`",
            );
        }
        fault_rates(f, rates)
    });
    SimulatedLine {
        name: name(f, "simulated line", &table.name),
        half_duplex: choice(f, "duplex", table.duplex.as_ref(), &[("full", false), ("half", true)]).unwrap_or(false),
        shared: table.shared,
        seed: number(f, "seed", table.seed.as_ref(), 0..=i64::MAX, 1),
        faults: faults.unwrap_or(FaultRates::NONE),
        bursts: table.bursts.as_ref().map(|bursts| of_bursts(f, bursts)),
        partner: table.partner.as_ref().map_or(Partner::None, |partner| of_partner(f, partner, folder)),
    }
}

fn fault_rates(f: &mut Findings<'_>, rates: &RatesTable) -> FaultRates {
    let mut rate = |key: &str, value: &Option<Placed<i64>>| number(f, key, value.as_ref(), 0..=1_000_000, 0);
    let faults = FaultRates {
        flip: rate("flip", &rates.flip),
        lose: rate("lose", &rates.lose),
        double: rate("double", &rates.double),
        delay: rate("delay", &rates.delay),
        parity: rate("parity", &rates.parity),
        framing: rate("framing", &rates.framing),
        break_: rate("break", &rates.break_),
        delay_max: time(f, rates.delay_max.as_ref(), DELAY_MAX),
    };
    let FaultRates { flip, lose, double, delay, parity, framing, break_, .. } = faults;
    let sum: u64 = [flip, lose, double, delay, parity, framing, break_].into_iter().map(u64::from).sum();
    let last = [&rates.break_, &rates.framing, &rates.parity, &rates.delay, &rates.double, &rates.lose, &rates.flip];
    if let (true, Some(key)) = (sum > 1_000_000, last.into_iter().flatten().next()) {
        let message = format!("the fault rates add up to {sum}, more than 1000000");
        f.error(
            CONTRADICTION,
            key.span(),
            message,
            "a character suffers at most one fault: the rates add up to 1000000 at most",
        );
    }
    faults
}

fn of_bursts(f: &mut Findings<'_>, placed: &Placed<RatesTable>) -> Bursts {
    let table = placed.get_ref();
    for (key, value) in [("every", &table.every), ("length", &table.length)] {
        if value.is_none() {
            let remedy = "bursts = { every = \"10s\", length = \"200ms\", parity = 100000 }";
            f.error(MISSING, placed.span(), format!("`{key}` is missing"), remedy);
        }
    }
    let bursts = Bursts {
        every: time(f, table.every.as_ref(), SHORTEST),
        length: time(f, table.length.as_ref(), SHORTEST),
        faults: fault_rates(f, table),
    };
    if let Some(length) = table.length.as_ref().filter(|_| bursts.length.is_zero()) {
        f.error(VALUE, length.span(), "a burst of no length", "how long it lasts, such as \"200ms\"");
    }
    bursts
}

fn of_partner(f: &mut Findings<'_>, partner: &Placed<String>, folder: &Path) -> Partner {
    match partner.get_ref().as_str() {
        "echo" => Partner::Echo,
        text => match Line::parse(text, folder) {
            Ok(Line::Pty(path)) => Partner::Pty(path),
            _ => {
                let message = format!("\"{text}\" cannot be a partner");
                f.error(VALUE, partner.span(), message, "\"echo\", or \"pty:PATH\" for a program that opens PATH");
                Partner::None
            }
        },
    }
}

/// Whether every `sim:NAME` has its line, and every line somebody on it and room for all.
fn places(f: &mut Findings<'_>, file: &StationFile, lines: &[SimulatedLine]) {
    let mut on: Vec<usize> = vec![0; lines.len()];
    let of_modules = file.module.iter().filter_map(|module| module.get_ref().line.as_ref());
    for text in of_modules.chain(file.bus.iter().filter_map(|bus| bus.line.as_ref())) {
        let Some(wanted) = text.get_ref().strip_prefix("sim:").filter(|name| !name.is_empty()) else { continue };
        let Some(at) = lines.iter().position(|line| line.name == wanted) else {
            let remedy = match nearest(wanted, lines.iter().map(|line| line.name.as_str())) {
                Some(near) => format!("did you mean \"sim:{near}\"?"),
                None => format!("add a table [[simulated_line]] with name = \"{wanted}\""),
            };
            f.error(LINE, text.span(), format!("there is no simulated line \"{wanted}\""), remedy);
            continue;
        };
        on[at] += 1;
        let line = &lines[at];
        let room = if line.half_duplex { 32 } else { 2 - usize::from(line.partner != Partner::None) };
        if on[at] == room + 1 {
            let message = format!("the simulated line \"{wanted}\" has no place left for this CP");
            let remedy = "a cable has two ends, its partner included; duplex = \"half\" is a bus with room for 32";
            f.error(CONTRADICTION, text.span(), message, remedy);
        }
    }
    for (table, _) in file.simulated_line.iter().zip(on).filter(|(_, on)| *on == 0) {
        let message = format!("the simulated line \"{}\" is not used", table.name.get_ref());
        f.error(
            CONTRADICTION,
            table.name.span(),
            message,
            format!("give a CP line = \"sim:{}\"", table.name.get_ref()),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disturbed_line_has_so_many_faults_more_and_no_more_than_characters() {
        let faults = FaultRates { flip: 100, ..FaultRates::NONE };
        let line = SimulatedLine {
            name: "x".into(),
            half_duplex: false,
            shared: false,
            seed: 1,
            faults,
            bursts: None,
            partner: Partner::Echo,
        };
        let total = |f: FaultRates| f.flip + f.lose + f.double + f.delay + f.parity + f.framing + f.break_;
        for (rate, all) in [(10, 110), (2_000_000, 1_000_000)] {
            let mut disturbed = line.clone();
            disturbed.disturb(rate, 7);
            assert_eq!((total(disturbed.faults), disturbed.seed, disturbed.faults.delay_max), (all, 6, DELAY_MAX));
            assert!(disturbed.faults.lose > 0 && disturbed.faults.flip > 100);
        }
    }
}
