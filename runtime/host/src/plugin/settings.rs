//! What the station file says about modules for their plugins.

use std::collections::BTreeMap;

/// The value of a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Setting {
    /// A setting that is a number.
    Int(i64),
    /// A setting that is a text.
    Text(String),
}

/// The address under which plugins find the settings of the station as a whole; no module has it.
pub const STATION: u32 = u32::MAX;

/// A module of a station as its plugins see it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PluginModule {
    /// Logical base address, by which handling blocks name it.
    pub address: u32,
    /// Its settings by name, as the station file has them.
    pub settings: BTreeMap<String, Setting>,
}

impl PluginModule {
    /// A module without settings.
    pub fn at(address: u32) -> Self {
        Self { address, settings: BTreeMap::new() }
    }
}
