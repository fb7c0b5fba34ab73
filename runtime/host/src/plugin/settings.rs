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
