//! What the broker knows of the station and of each link.

use std::os::fd::OwnedFd;

use ob1_access::door::{Addresses, BlockFact, Connection, Diagnosis, Document, Refusal, State};
use ob1_access::{Allowed, Put, Right};
use ob1_cpu::DiagEntry;
use ob1_model::{BlockId, Forced};
use ob1_time::Span;

/// A driver, and whether it is up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriverState {
    /// Name of the module in the station file.
    pub name: String,
    /// Its process runs and gives signs of life.
    pub up: bool,
}

/// A link as others see it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkState {
    /// Name of the link in the station file.
    pub name: String,
    /// Its process is up.
    pub up: bool,
    /// Its connections, where it reports them.
    pub connections: Vec<Connection>,
}

/// A change of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// These blocks come in, in place of those of the same names.
    Link(Vec<(BlockId, Box<[u8]>)>),
    /// These blocks are deleted, if they are there.
    Delete(Vec<BlockId>),
}

/// The outcome of the change with this number.
pub type Changed = (u64, Result<(), Refusal>);

/// What the broker needs to know of the station. Asked by its thread, never by the scan.
pub trait Facts: Send {
    /// Name of the station, from the station file.
    fn name(&self) -> &str;
    /// Family of the CPU: 300 or 400.
    fn family(&self) -> u16;
    /// Bytes of inputs, outputs and bit memory.
    fn areas(&self) -> [u32; 3];
    /// Number of timers, and number of counters.
    fn timers_and_counters(&self) -> [u16; 2];
    /// Minimum cycle time; 0: none.
    fn min_cycle(&self) -> Span;
    /// Number of modules in the rack.
    fn modules(&self) -> u32;
    /// The drivers of the station, each with its present state.
    fn drivers(&self) -> Vec<DriverState>;
    /// An entry of the diagnostic buffer in words.
    fn diagnosis(&self, entry: &DiagEntry) -> Diagnosis;
    /// The blocks of the program.
    fn blocks(&self) -> Vec<BlockFact>;
    /// One of them as a block folder has it.
    fn block(&self, id: BlockId) -> Option<Box<[u8]>>;
    /// Checksums of the system data and of the program.
    fn checksums(&self) -> [u32; 2] {
        [0; 2]
    }

    /// What lies at these addresses of its machine code; `None` where it has none.
    fn addresses(&self, _id: BlockId, _wanted: &[u16]) -> Option<Addresses> {
        None
    }
    /// Where this statement of it lies in its machine code, in bytes.
    fn address(&self, _id: BlockId, _statement: u32) -> Option<u16> {
        None
    }
    /// A document. `state` and which modules answer are asked of the CPU for [`Document::Status`] only; `links` are
    /// all links.
    fn document(&self, which: Document, state: State, present: &[bool], links: &[LinkState]) -> Box<[u8]>;
    /// An input that a module feeds is written where the module reads it: true when this was done.
    fn take_input(&self, put: &Put) -> bool;
    /// Begins a change of the program; its outcome comes from [`Facts::changed`] under this number. False: this program
    /// cannot be changed.
    fn change(&mut self, _number: u64, _change: Change) -> bool {
        false
    }
    /// A partner of a link has given a wrong password, or changes something: for the audit log.
    fn record(&mut self, _link: &str, _partner: &str, _what: &str, _outcome: &str) {}
    /// The CPU forces these cells from now on: they are kept.
    fn force(&mut self, _cells: Vec<Forced>) {}
    /// The cells that are forced.
    fn forced(&self) -> Vec<Forced> {
        Vec::new()
    }
    /// The next change that has ended.
    fn changed(&mut self) -> Option<Changed> {
        None
    }
}

/// A link, as the station file has it.
#[derive(Debug, Default)]
pub struct LinkConfig {
    /// Its name; without one it is part of the runtime, and no link hears of it.
    pub name: String,
    /// What its clients may do.
    pub rights: Right,
    /// Which cells they may touch.
    pub allowed: Allowed,
    /// With this password a client may do more.
    pub password: Option<String>,
    /// The rights with this password.
    pub password_rights: Right,
    /// The keys of its table as JSON, without passwords.
    pub config: String,
    /// Its listening sockets, open and bound; its process gets them.
    pub listeners: Vec<OwnedFd>,
}
