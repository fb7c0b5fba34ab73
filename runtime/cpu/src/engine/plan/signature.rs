//! What a caller must know of a block.

use ob1_model::{BlockId, DataType, Interface, Section};

use super::Callee;

/// A formal parameter, as calls need it.
#[derive(Clone, Debug, Hash)]
pub struct Formal {
    /// How it is declared: IN, OUT or IN_OUT.
    pub section: Section,
    /// Size in bits; numbers of timers, counters and blocks are 16.
    pub bits: u32,
    /// Up to 32 bits and copied by value.
    pub elementary: bool,
    /// TIMER, COUNTER, BLOCK_xx: the reference is the number itself.
    pub number: bool,
    /// The callee writes it, or passes it on.
    pub written: bool,
    /// Bit in the instance of an FB.
    pub at: u32,
    /// A STRING: its operand may be shorter than declared here, as its length bytes tell.
    pub string: bool,
    /// Composed, and neither POINTER nor ANY: a list of pointers names the POINTER to it.
    pub by_pointer: bool,
    /// Its place in a list of pointers.
    pub listed: u16,
}

impl Formal {
    /// Bits an operand passed by reference must have.
    #[must_use]
    pub const fn least_bits(&self) -> u32 {
        if self.string { 16 } else { self.bits }
    }
}

/// What a caller must know of a block.
#[derive(Clone, Debug, Hash)]
pub struct Signature {
    /// Kind and number of the block.
    pub id: BlockId,
    /// The block itself, for calls without a search.
    pub callee: Callee,
    /// Its formal parameters, in the order of their indices.
    pub formals: Vec<Formal>,
    /// Bytes of an instance.
    pub instance_bytes: u32,
}

impl Signature {
    /// The signature of an interface; `written` tells which formals the callee may write.
    pub(crate) fn new(id: BlockId, callee: Callee, interface: &Interface, written: &dyn Fn(usize) -> bool) -> Self {
        let places = interface.list_places();
        let formals = interface
            .formals()
            .enumerate()
            .map(|(i, p)| {
                let bits = p.passed_bits(id.kind.has_instance());
                let number = p.ty.is_parameter_type();
                Formal {
                    section: p.section,
                    bits,
                    elementary: p.ty.elementary_bits().is_some(),
                    number,
                    written: p.section != Section::Input || written(i),
                    at: p.at.0,
                    string: matches!(p.ty, DataType::String(_)),
                    by_pointer: p.ty.is_composed() && !matches!(p.ty, DataType::Pointer | DataType::Any),
                    listed: places.get(i).copied().unwrap_or(u16::MAX),
                }
            })
            .collect();
        Self { id, callee, formals, instance_bytes: interface.instance_bytes }
    }
}

/// Every loaded block's signature, sorted by id.
#[derive(Clone, Debug, Default, Hash)]
pub struct Signatures(pub Vec<Signature>);

impl Signatures {
    /// The signature of this block.
    #[must_use]
    pub fn find(&self, id: BlockId) -> Option<&Signature> {
        self.0.binary_search_by_key(&id, |s| s.id).ok().map(|i| &self.0[i])
    }

    /// Its index among all signatures; `None`: it is not loaded.
    #[must_use]
    pub fn index(&self, id: BlockId) -> Option<u32> {
        self.0.binary_search_by_key(&id, |s| s.id).ok().and_then(|i| u32::try_from(i).ok())
    }
}
