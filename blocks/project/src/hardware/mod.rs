//! Stations, CPUs and modules with their addresses, as the hardware configuration keeps them.
//!
//! Objects lie in tables of their own by kind of module (`hOmSave7/*/HOBJECT1.DBF`), their addresses and parameters in
//! `HATTRME1`, their place in the plant in their unit: module, rack, station. What the attributes mean was found out
//! by comparing projects (`docs/import.md`); what is not known is not used.

pub(crate) mod objects;
pub(crate) mod profibus;

use crate::cpu_parameters::{self, CpuParameters};
use crate::note::Notes;
use crate::text::CodePage;
use crate::tree::Tree;

pub use objects::Area;
use objects::{Interfaces, Object, Objects, read_kind};
pub use profibus::{DpModule, DpSlave, DpSystem};

/// The hardware of a project.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Hardware {
    /// The CPUs of all stations.
    pub cpus: Vec<Cpu>,
    /// Modules with addresses, CPUs left out.
    pub modules: Vec<Module>,
    /// DP master systems; their modules are among the modules too.
    pub dp: Vec<DpSystem>,
}

/// A CPU with its station and parameters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cpu {
    /// Its name: `CPU 315-2 DP`.
    pub name: String,
    /// True for one of an S7-400: its name may be the user's.
    pub s7_400: bool,
    /// The station it is in.
    pub station: String,
    /// The program it has.
    pub program: Option<i64>,
    /// What it is set to.
    pub parameters: CpuParameters,
}

/// A module with its place and addresses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Module {
    /// Its name in the catalogue: `DI16xDC24V`.
    pub name: String,
    /// Its order number, as far as the catalogue's name has it: `6ES7 321-1BH02-0AA`.
    pub order: String,
    /// The station it is in.
    pub station: String,
    /// Rack, slot and submodule; a device on a bus has its number as rack.
    pub place: (i64, i64, i64),
    /// Its areas of inputs: first byte and length.
    pub inputs: Vec<Area>,
    /// Its areas of outputs.
    pub outputs: Vec<Area>,
}

/// The unit type of stations: the project.
pub(crate) const IN_PROJECT: i64 = 1_122_305;
/// Objects within each other: module, rack, station; a submodule of a device on a bus of a bus has some more.
const DEEPEST: usize = 16;

/// Reads the hardware of the project at `root`.
pub(crate) fn read(tree: &Tree<'_>, root: &str, page: CodePage, notes: &mut Notes) -> Hardware {
    let base = format!("{root}hOmSave7/");
    let (mut objects, mut interfaces) = (Objects::new(), Interfaces::new());
    for part in tree.list(&base) {
        read_kind(tree, &format!("{base}{part}/"), page, (&mut objects, &mut interfaces), notes);
    }
    let station = |object: &Object| {
        let mut unit = object.unit;
        for _ in 0..DEEPEST {
            match objects.get(&unit) {
                Some(above) if above.unit.0 == IN_PROJECT => return above.name.clone(),
                Some(above) => unit = above.unit,
                None => break,
            }
        }
        String::new()
    };
    let mut hardware = Hardware::default();
    for object in objects.values() {
        if object.program.is_some() || !object.parameters.is_empty() {
            hardware.cpus.push(Cpu {
                name: object.name.clone(),
                s7_400: object.s7_400,
                station: station(object),
                program: object.program,
                parameters: cpu_parameters::read(&object.parameters),
            });
        } else if !object.inputs.is_empty() || !object.outputs.is_empty() {
            hardware.modules.push(Module {
                name: object.name.clone(),
                order: object.order.clone(),
                station: station(object),
                place: object.place,
                inputs: object.inputs.clone(),
                outputs: object.outputs.clone(),
            });
        }
    }
    hardware.dp = profibus::systems(&objects, &interfaces, station);
    hardware.modules.sort_by(|a, b| (&a.station, a.place).cmp(&(&b.station, b.place)));
    hardware
}
