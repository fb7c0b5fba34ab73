//! DP master systems with their slaves, as the hardware configuration keeps them. What the attributes mean was found
//! out by comparing projects (`docs/import.md`).

use super::objects::{Area, Interfaces, Object, Objects};

/// A DP master system.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DpSystem {
    /// The name of its subnet, or its own.
    pub name: String,
    /// The station its master is in.
    pub station: String,
    /// The module that is its master: a CPU, or a CP. Empty: the project does not say.
    pub master: String,
    /// Its slaves, in the order of their addresses.
    pub slaves: Vec<DpSlave>,
}

/// A DP slave of a master system.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DpSlave {
    /// Its name in the project.
    pub name: String,
    /// Its address on the PROFIBUS.
    pub address: u8,
    /// Its user parameters, where the project has them as bytes: for slaves of a GSD file.
    pub parameters: Vec<u8>,
    /// Its diagnostic address; `None`: the project gives none.
    pub diagnostic: Option<u16>,
    /// What is in its slots.
    pub modules: Vec<DpModule>,
}

/// What is in a slot of a slave.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DpModule {
    /// Its slot, as the project counts.
    pub slot: i64,
    /// Its name: `DI32xDC24V`; of a GSD file's module its identifiers as STEP 7 shows them.
    pub name: String,
    /// Its order number, as far as the catalogue's name has it.
    pub order: String,
    /// Its name in the GSD file; empty: it is one of STEP 7's own catalogue.
    pub gsd: String,
    /// It belongs to the module in the slot before: a module of the GSD file with more than one identifier.
    pub goes_on: bool,
    /// Its identifier, as in the configuration telegram.
    pub identifier: Vec<u8>,
    /// Its areas of inputs.
    pub inputs: Vec<Area>,
    /// Its areas of outputs.
    pub outputs: Vec<Area>,
}

/// The object type of a DP master system.
pub(crate) const SYSTEM: i64 = 1_314_971;
/// Precedes the name of a module that continues in a further slot.
pub(crate) const GOES_ON: &str = "-->";

/// The master systems among the objects; `station` finds the station of one.
pub(super) fn systems(
    objects: &Objects,
    interfaces: &Interfaces,
    station: impl Fn(&Object) -> String,
) -> Vec<DpSystem> {
    let of_unit = |unit: (i64, i64)| objects.iter().filter(move |(_, object)| object.unit == unit);
    let mut systems = Vec::new();
    for (key, system) in objects.iter().filter(|((ty, _), _)| *ty == SYSTEM) {
        let mut slaves: Vec<DpSlave> = of_unit(*key)
            .filter_map(|(key, slave)| {
                let mut modules: Vec<DpModule> = of_unit(*key).filter_map(|(_, object)| module(object)).collect();
                modules.sort_by_key(|module| module.slot);
                // That of its head, which has no data of its own.
                let heads = of_unit(*key).filter(|(_, object)| object.inputs.is_empty() && object.outputs.is_empty());
                let diagnostic = heads.min_by_key(|(_, head)| head.place.1).and_then(|(_, head)| head.diagnostic);
                let address = u8::try_from(slave.place.0).ok().filter(|address| *address <= 125)?;
                Some(DpSlave { name: slave.name.clone(), address, parameters: slave.user.clone(), diagnostic, modules })
            })
            .collect();
        slaves.sort_by_key(|slave| slave.address);
        let interface = interfaces.get(key).and_then(|interface| objects.get(interface));
        // An interface is a submodule of its CPU; a CP is one itself.
        let master = interface.map(|interface| match objects.get(&interface.unit) {
            Some(module) if interface.place.2 > 0 => module.name.clone(),
            _ => interface.name.clone(),
        });
        let name = if system.subnet.is_empty() { system.name.clone() } else { system.subnet.clone() };
        systems.push(DpSystem { name, station: station(system), master: master.unwrap_or_default(), slaves });
    }
    systems
}

fn module(object: &Object) -> Option<DpModule> {
    if object.inputs.is_empty() && object.outputs.is_empty() && object.identifier.is_empty() {
        return None;
    }
    let rest = object.gsd.strip_prefix(GOES_ON);
    Some(DpModule {
        slot: object.place.1,
        name: object.name.clone(),
        order: object.order.clone(),
        gsd: rest.unwrap_or(&object.gsd).trim().to_owned(),
        goes_on: rest.is_some(),
        identifier: object.identifier.clone(),
        inputs: object.inputs.clone(),
        outputs: object.outputs.clone(),
    })
}
