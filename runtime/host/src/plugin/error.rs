//! Why a plugin is refused: numbered, with a remedy.

use std::path::PathBuf;

use ob1_model::BlockId;
use ob1_sdk::abi::{ABI_MAJOR, ABI_MINOR, ENTRY_SYMBOL};

/// A plugin was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: plugin {}: {refusal}\n  remedy: {}", refusal.number(), path.display(), refusal.remedy())]
pub struct PluginError {
    /// The file, as it was named.
    pub path: PathBuf,
    /// Why it was refused.
    pub refusal: Refusal,
}

/// The reason of a refusal. Numbers and remedies are listed in `docs/plugins.md`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The file cannot be found; what the system says.
    #[error("cannot be opened ({0})")]
    Missing(String),
    /// The file is not a shared library for this machine, or needs one that is not there; what the loader says.
    #[error("cannot be loaded ({0})")]
    NotALibrary(String),
    /// It has no function `ob1_plugin`.
    #[error("is not an ob1 plugin: it has no function `{ENTRY_SYMBOL}`")]
    NoSymbol,
    /// It was built with another major version of the interface.
    #[error("was built for plugin interface {major}.{minor}, this is {ABI_MAJOR}.{ABI_MINOR}")]
    OtherMajor {
        /// Major version that the plugin was built with.
        major: u16,
        /// And its minor version.
        minor: u16,
    },
    /// Its table says something impossible.
    #[error("has a malformed table: {0}")]
    Malformed(String),
    /// Its `init` returned a status other than 0.
    #[error("refuses to start: its init returned {0}")]
    InitFailed(i32),
    /// The station file gives a number to a block the plugin does not bring.
    #[error("has no {0}, but the station file gives it a number")]
    NoSuchBlock(BlockId),
    /// The first block would get the id of another, or one of another kind.
    #[error("{0} cannot become {1}")]
    SameNumber(BlockId, BlockId),
}

impl Refusal {
    /// The number under which `docs/plugins.md` explains it.
    pub const fn number(&self) -> &'static str {
        match self {
            Refusal::Missing(_) => "P001",
            Refusal::NotALibrary(_) => "P002",
            Refusal::NoSymbol => "P003",
            Refusal::OtherMajor { .. } => "P004",
            Refusal::Malformed(_) => "P005",
            Refusal::InitFailed(_) => "P006",
            Refusal::NoSuchBlock(_) => "P007",
            Refusal::SameNumber(..) => "P008",
        }
    }

    /// What to do about it.
    pub const fn remedy(&self) -> &'static str {
        match self {
            Refusal::Missing(_) => "check `path` in the station file; relative paths count from the station file",
            Refusal::NotALibrary(_) => "build the plugin for this machine (crate type cdylib, or `cc -shared -fPIC`)",
            Refusal::NoSymbol => {
                "export the blocks: `ob1_sdk::export_plugin!` in Rust, `const struct Ob1PluginTable *ob1_plugin(void)` in C"
            }
            Refusal::OtherMajor { .. } => "build the plugin again with the sdk or the ob1.h of this ob1",
            Refusal::Malformed(_) => "correct the plugin's table; ob1.h says what each field means",
            Refusal::InitFailed(_) => "ask the plugin's maker what this status of its init function means",
            Refusal::NoSuchBlock(_) => {
                "give numbers only to blocks the plugin brings; `ob1 check --plugin FILE` lists them"
            }
            Refusal::SameNumber(..) => "give each block a number of its own, of its own kind",
        }
    }
}
