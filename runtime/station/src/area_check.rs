//! Operands that the CPU of the station does not have: OB 121, or STOP.

use std::collections::BTreeSet;

use ob1_ir::{Number, Numbered, Op, Operand, Place, Program};
use ob1_model::{Area, Width};

use ob1_station_file::Station;
use ob1_station_file::finding::{Finding, Level};

/// A timer, counter, or a bit, byte or word of the bit memory or process image beyond what `[cpu]` gives.
const BEYOND: &str = "L031";

/// Each of them once for a block and operand.
pub(crate) fn findings(program: &Program, station: &Station) -> Vec<Finding> {
    let mut told = BTreeSet::new();
    let mut all = Vec::new();
    for block in &program.blocks {
        let file = program.sources.get(block.source as usize).map_or("program", String::as_str);
        for stmt in &block.code {
            let mut found = Vec::new();
            found.extend(number(&stmt.op, station));
            stmt.op.places(&mut |place, width| found.extend(address(place, width, station)));
            for (operand, has, remedy) in found {
                if told.insert((block.id, operand.clone())) {
                    let message =
                        format!("the CPU has no {operand}, only {has}: its statement is an error (OB 121, or STOP)");
                    all.push(Finding::in_line(Level::Warning, BEYOND, file, stmt.line, message, &remedy));
                }
            }
        }
    }
    all
}

/// What is used, what there is, and the key that makes more of it.
type Beyond = (String, String, String);

fn number(op: &Op, station: &Station) -> Option<Beyond> {
    let &Number::Fixed(number) = op.number()? else { return None };
    let cpu = &station.cpu;
    let (letter, key, there) = match op.numbered()? {
        Numbered::Timer => ("T", "timers", cpu.timers),
        Numbered::Counter => ("Z", "counters", cpu.counters),
        Numbered::DataBlock => return None,
    };
    (u32::from(number) >= u32::from(there)).then(|| {
        let has = format!("{letter} 0 to {letter} {}", there.saturating_sub(1));
        let remedy = format!("use one of them, or `{key} = {}` in [cpu]", u32::from(number) + 1);
        (format!("{letter} {number}"), has, remedy)
    })
}

fn address(place: Place, width: Width, station: &Station) -> Option<Beyond> {
    let Place::Fixed(area, at) = place else { return None };
    let cpu = &station.cpu;
    let (there, key) = match area {
        Area::Memory => (cpu.memory_bytes, "memory_bytes = "),
        Area::Input => (cpu.input_bytes, "process_image.inputs = "),
        Area::Output => (cpu.output_bytes, "process_image.outputs = "),
        _ => return None,
    };
    let end = (at.0 + u32::from(width.bits())).div_ceil(8);
    (end > there).then(|| {
        let has = format!("{there} bytes");
        (Operand { width, place }.to_string(), has, format!("use one of them, or `{key}{end}` in [cpu]"))
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ob1_stl::{Library, Options, Source, compile};

    use super::*;

    #[test]
    fn what_the_cpu_does_not_have_is_told_once_with_the_key() {
        let text = "FUNCTION FC 1 : VOID\nBEGIN\nL S5T#2S;\nSE T 256;\nR T 255;\nZV Z 300;\nU T 256;\nL MW 254;\nL MW 255;\nU M 256.0;\n\
                    = A 127.7;\n= A 128.0;\nL ED [MD 254];\nAUF DB 300;\nL DBW 300;\nEND_FUNCTION\n";
        let output = compile(&[Source::new("a.awl", text)], &Library::new(), &Options::default());
        assert!(output.is_good(), "{:?}", output.diagnostics);
        let station =
            ob1_station_file::parse("[station]\nname = \"a\"\n", "a.toml", Path::new("/a")).expect("a station");
        let told: Vec<(u32, String)> =
            findings(&output.program, &station).into_iter().map(|f| (f.line, f.message)).collect();
        let lines: Vec<u32> = told.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [4, 6, 9, 10, 12, 13], "{told:#?}");
        assert!(told[0].1.contains("T 256"), "{told:?}");
    }
}
