//! Why a program or configuration cannot be loaded: numbered, with the place.

use std::fmt;

use ob1_ir::{DataKind, Defect, Finding, Op, Program, Target};
use ob1_model::{BlockId, BlockKind, Site};

/// A reason to refuse a program, a configuration or a set of modules. [`LoadError::number`] is stable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LoadError {
    /// L001: a size or number of the configuration is outside its range.
    Config {
        /// The field of [`crate::CpuConfig`].
        field: &'static str,
        /// The value that was requested.
        value: u64,
        /// The largest value allowed.
        max: u64,
    },
    /// L002: a block is defined twice, or both in the program and in a library or plugin.
    BlockTwice(BlockId),
    /// L003: a call of a block that is not there.
    MissingBlock {
        /// The block that is called.
        block: BlockId,
        /// Where the calling statement stands.
        site: Site,
    },
    /// L004: a call whose arguments do not fit the called block's interface.
    Arguments {
        /// The block that is called.
        block: BlockId,
        /// Where the calling statement stands.
        site: Site,
        /// What does not fit.
        reason: String,
    },
    /// L005: a data block is larger than 65534 bytes.
    DbTooLarge {
        /// Number of the data block.
        number: u16,
        /// Its length in bytes.
        bytes: usize,
    },
    /// L006: an instance data block is shorter than its function block's data, or belongs to no loaded one.
    Instance {
        /// Number of the instance data block.
        number: u16,
        /// The function block that it belongs to.
        block: BlockId,
    },
    /// L007: two modules overlap.
    ModuleOverlap {
        /// Name of the first module.
        first: String,
        /// Name of the second module.
        second: String,
        /// The first common byte.
        address: u32,
        /// True for their outputs.
        outputs: bool,
    },
    /// L008: a module reaches beyond peripheral byte 65535.
    ModuleAddress {
        /// Name of the module.
        name: String,
        /// Its first peripheral byte.
        address: u32,
    },
    /// L009: the intermediate code is not sound: a jump out of the block, a parameter that does not exist, brackets
    /// nested too deep.
    Code {
        /// Where the statement stands.
        site: Site,
        /// What is wrong, in words.
        reason: String,
    },
    /// L010: all data blocks together need more memory than the CPU can address (256 MiB).
    Memory {
        /// Bytes that all data blocks need.
        bytes: usize,
    },
    /// L011: an impossible data block number.
    DbNumber(u16),
    /// L012: a data block that is to be retentive is not loaded.
    Retentive(u16),
    /// L013: all organization blocks and native blocks that can be nested need more than the largest stack.
    Stack {
        /// Bytes of stack that are needed.
        bytes: usize,
        /// Organization blocks that can run at one time.
        obs: usize,
        /// Blocks nested in each.
        nesting: u8,
        /// Bytes of stack that there can be.
        most: usize,
    },
    /// L014: the requested engine cannot run here.
    Engine {
        /// What it lacks, in words.
        reason: String,
    },
}

impl LoadError {
    /// A finding of the verifier as the error of a load.
    pub(crate) fn of(finding: &Finding, program: &Program) -> Self {
        let block = finding.block.and_then(|id| program.blocks.iter().find(|block| block.id == id));
        let statement = block.zip(finding.statement).and_then(|(block, index)| block.code.get(index as usize));
        let site = Site {
            block: finding.block.unwrap_or(BlockId::new(BlockKind::Ob, 0)),
            network: statement.map_or(0, |statement| statement.network),
            line: statement.map_or(0, |statement| statement.line),
        };
        let called = match statement.map(|statement| &statement.op) {
            Some(Op::Call(call)) => match call.target {
                Target::Block(id) | Target::Local(id, _) => Some(id),
                Target::Indirect(kind, _) => Some(BlockId::new(kind, 0)),
            },
            _ => None,
        };
        let reason = finding.defect.to_string();
        match (&finding.defect, called) {
            (Defect::DuplicateBlock(id), _) => LoadError::BlockTwice(*id),
            (Defect::DataNumber(0), _) => LoadError::DbNumber(0),
            (Defect::DataNumber(number), _) => LoadError::BlockTwice(BlockId::new(BlockKind::Db, *number)),
            (Defect::InstanceLength(number), _) => {
                let of = program.data.iter().find(|data| data.number == *number).map(|data| data.kind);
                match of {
                    Some(DataKind::Instance(block)) => LoadError::Instance { number: *number, block },
                    _ => LoadError::Code { site, reason },
                }
            }
            (Defect::UnknownBlock(id), _) => LoadError::MissingBlock { block: *id, site },
            (Defect::ArgCount(..) | Defect::OpenArg(_) | Defect::RawArg(_) | Defect::Instance, Some(block)) => {
                LoadError::Arguments { block, site, reason }
            }
            _ => LoadError::Code { site, reason },
        }
    }

    /// The number in front of the message, `L003`.
    #[must_use]
    pub const fn number(&self) -> u16 {
        match self {
            LoadError::Config { .. } => 1,
            LoadError::BlockTwice(_) => 2,
            LoadError::MissingBlock { .. } => 3,
            LoadError::Arguments { .. } => 4,
            LoadError::DbTooLarge { .. } => 5,
            LoadError::Instance { .. } => 6,
            LoadError::ModuleOverlap { .. } => 7,
            LoadError::ModuleAddress { .. } => 8,
            LoadError::Code { .. } => 9,
            LoadError::Memory { .. } => 10,
            LoadError::DbNumber(_) => 11,
            LoadError::Retentive(_) => 12,
            LoadError::Stack { .. } => 13,
            LoadError::Engine { .. } => 14,
        }
    }

    /// Several as one text.
    #[must_use]
    pub fn together(errors: &[Self]) -> String {
        errors.iter().map(Self::to_string).collect::<Vec<_>>().join("; ")
    }
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "L{:03}: ", self.number())?;
        match self {
            LoadError::Config { field, value, max } => write!(f, "CPU setting {field} = {value}: at most {max}"),
            LoadError::BlockTwice(id) => write!(f, "{id} occurs twice; renumber one of them or leave it out"),
            LoadError::MissingBlock { block, site } => {
                write!(f, "{site} calls {block}, which neither the program nor a library or plugin has")
            }
            LoadError::Arguments { block, site, reason } => write!(f, "{site}, call of {block}: {reason}"),
            LoadError::DbTooLarge { number, bytes } => {
                write!(f, "DB {number} has {bytes} bytes; a data block has at most 65534")
            }
            LoadError::Instance { number, block } => write!(
                f,
                "DB {number} cannot be an instance of {block}: the block is missing or needs more data than the DB has"
            ),
            LoadError::ModuleOverlap { first, second, address, outputs } => write!(
                f,
                "modules {first} and {second} both have {} byte {address}; give one of them another address",
                if *outputs { "output" } else { "input" }
            ),
            LoadError::ModuleAddress { name, address } => {
                write!(f, "module {name} at address {address} reaches beyond peripheral byte 65535")
            }
            LoadError::Code { site, reason } => write!(f, "{site}: {reason}"),
            LoadError::Memory { bytes } => write!(f, "the program needs {bytes} bytes of memory; at most 256 MiB"),
            LoadError::Retentive(number) => write!(f, "DB {number} is to be retentive, but is not loaded"),
            LoadError::Stack { bytes, obs, nesting, most } => write!(
                f,
                "{obs} organization blocks can run at one time, each with {nesting} plugin blocks nested in it: that \
                 needs {} KiB of stack, there are {}; make nesting_depth smaller or leave organization \
                 blocks out",
                bytes.div_ceil(1 << 10),
                most >> 10
            ),
            LoadError::Engine { reason } => f.write_str(reason),
            LoadError::DbNumber(number) => write!(f, "DB {number} is not possible; numbers begin at 1"),
        }
    }
}

impl std::error::Error for LoadError {}
