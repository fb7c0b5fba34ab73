//! A test file as it is written. docs/testing.md

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

/// A value with its place in the file.
pub(super) type Placed<T> = Spanned<T>;
/// Cells by their names, each with a value.
pub(super) type Cells = BTreeMap<Placed<String>, Placed<toml::Value>>;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TestFile {
    pub(super) sources: Vec<Placed<String>>,
    pub(super) station: Option<Placed<String>>,
    pub(super) symbols: Vec<Placed<String>>,
    pub(super) mnemonics: Option<Placed<String>>,
    pub(super) libraries: Vec<Placed<String>>,
    pub(super) library: BTreeMap<Placed<String>, Placed<String>>,
    pub(super) cycle: Option<Placed<String>>,
    pub(super) test: Vec<Placed<TestTable>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TestTable {
    pub(super) name: Placed<String>,
    pub(super) start: Option<Placed<String>>,
    pub(super) call: Option<Placed<String>>,
    #[serde(default)]
    pub(super) with: BTreeMap<Placed<String>, Placed<String>>,
    #[serde(default)]
    pub(super) inputs: Cells,
    pub(super) replay: Option<Placed<String>>,
    #[serde(default)]
    pub(super) drive: Vec<Placed<String>>,
    pub(super) compare: Option<Vec<String>>,
    #[serde(default)]
    pub(super) step: Vec<Placed<StepTable>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct StepTable {
    pub(super) at: Option<Placed<String>>,
    pub(super) command: Option<Placed<String>>,
    pub(super) set: Cells,
    pub(super) run: Option<Placed<String>>,
    pub(super) scans: Option<Placed<i64>>,
    pub(super) within: Option<Placed<String>>,
    pub(super) expect: Cells,
    pub(super) state: Option<Placed<String>>,
    pub(super) diagnostics: Vec<Placed<String>>,
}
