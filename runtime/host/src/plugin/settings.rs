//! What the station file says about modules for their plugins.

use std::collections::BTreeMap;

/// The value of a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Setting {
    /// A number.
    Int(i64),
    /// A text.
    Text(String),
}

/// The address under which plugins find the settings of the station as a whole; no module has it.
pub const STATION: u32 = u32::MAX;

/// A module of a station as its plugins see it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PluginModule {
    /// Logical base address.
    pub address: u32,
    /// Settings by name.
    pub settings: BTreeMap<String, Setting>,
}

impl PluginModule {
    /// A module without settings.
    #[must_use]
    pub fn at(address: u32) -> Self {
        Self { address, settings: BTreeMap::new() }
    }
}
