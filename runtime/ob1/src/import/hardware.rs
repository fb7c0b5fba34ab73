//! The modules of a station as our station file can have them.

use ob1_params::CpKind;
use ob1_project::{Area, Choice, Cpu, DpSystem, Module, Project};

/// The hardware of a program.
#[derive(Debug, Default)]
pub(super) struct Hardware {
    /// The CPU that the program belongs to; `None`: the project does not say.
    pub(super) cpu: Option<Cpu>,
    /// The modules of its station.
    pub(super) modules: Vec<Module>,
    /// The DP master systems of its station.
    pub(super) dp: Vec<DpSystem>,
}

/// The CPU of a program and the modules of its station. A program without a CPU has none.
pub(super) fn of_choice(project: &Project, choice: Choice) -> Hardware {
    let cpu = choice.program.and_then(|i| project.hardware.cpus.get(project.programs.get(i)?.cpu?)).cloned();
    let station = cpu.as_ref().map(|cpu| cpu.station.clone());
    let of_station = |module: &&Module| Some(&module.station) == station.as_ref();
    let dp = project.hardware.dp.iter().filter(|system| Some(&system.station) == station.as_ref()).cloned().collect();
    Hardware { modules: project.hardware.modules.iter().filter(of_station).cloned().collect(), dp, cpu }
}

/// Communication processors we have: the type in the station file, and how the module's name or order number begins.
const CPS: [(CpKind, &[&str]); 3] = [
    (CpKind::Cp340, &["CP 340", "CP340", "6ES7 340"]),
    (CpKind::Cp341, &["CP 341", "CP341", "6ES7 341"]),
    (CpKind::Cp341, &["CP 441", "CP441", "6ES7 441"]),
];

/// The type of a communication processor.
pub(super) fn cp_type(module: &Module) -> Option<&'static str> {
    let begins = |start: &&str| module.name.starts_with(*start) || module.order.starts_with(*start);
    CPS.iter().find(|(_, starts)| starts.iter().any(begins)).map(|(kind, _)| kind.name())
}

/// Areas in order, those that touch or overlap as one.
pub(super) fn merged(areas: impl Iterator<Item = Area>) -> Vec<Area> {
    let mut sorted: Vec<Area> = areas.collect();
    sorted.sort_unstable();
    let mut out: Vec<Area> = Vec::new();
    for area in sorted {
        match out.last_mut().filter(|last| last.first + last.bytes > area.first) {
            Some(last) => last.bytes = last.bytes.max(area.first + area.bytes - last.first),
            None => out.push(area),
        }
    }
    out
}
