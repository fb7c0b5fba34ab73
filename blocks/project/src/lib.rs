//! Reads STEP 7 projects (`.s7p`), libraries (`.s7l`) and archives of them: programs, blocks, symbols, hardware.
//!
//! The files come through [`FileSource`]: this crate never touches the disk, and trusts nothing it reads. Every
//! length is checked against the file before it is used; what is damaged is left out and reported.

mod archive;
mod comments;
mod compiled;
mod cpu_parameters;
mod dbf;
mod folder;
mod hardware;
mod links;
mod listing;
mod note;
mod old_names;
mod overlay;
mod project;
mod register;
mod scl;
mod source;
mod sources;
mod stand_in;
mod symbols;
mod text;
mod translate;
mod tree;
mod uploaded;
mod values;
#[cfg(feature = "write")]
mod write;

pub use archive::{Archive, LONGEST_FILE};
pub use comments::{Comments, Line, Network};
pub use cpu_parameters::{CpuParameters, Cyclic};
pub use dbf::{Damage, Memos, Row, Table};
pub use folder::{Block, Folder, Head, Language, Udt, Use};
pub use hardware::{Area, Cpu, DpModule, DpSlave, DpSystem, Hardware, Module};
pub use note::{Note, Notes, Weight};
pub use old_names::OldNames;
pub use overlay::{Image, Refused, announce, overlay};
pub use project::{BlockFolder, Choice, Program, Project};
pub use scl::{OK_FLAG, SclSource, awl, has_ok, heads, scl_sources};
pub use sources::SourceText;
pub use symbols::SymbolRow;
pub use text::CodePage;
pub use translate::{ProgramFile, Translation, Wanted, image_of, translate};
pub use tree::{FileSource, Files, Root, Tree};
#[cfg(feature = "write")]
pub use write::NewProject;
