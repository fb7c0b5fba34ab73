//! What a use of an operand reaches, and whether two of these touch.

use ob1_model::{Area, BlockId, BlockKind};

/// What a statement reaches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Extent {
    /// Bits of the inputs, outputs, bit memory or peripheral area.
    Bits {
        area: Area,
        at: u32,
        bits: u32,
    },
    /// Bits of a data block; none: of whichever is open.
    Data {
        db: Option<u16>,
        at: u32,
        bits: u32,
    },
    /// Bits of the instance of a function block, whichever data block that lies in.
    Instance {
        fb: BlockId,
        at: u32,
        bits: u32,
    },
    Timer(u16),
    Counter(u16),
    /// A block; a data block as a whole.
    Block(BlockId),
    /// Something of an area, at an address known at run time only; none: of any area.
    Somewhere(Option<Area>),
    SomeTimer,
    SomeCounter,
    SomeBlock(BlockKind),
    /// Local data and parameters of functions, which have no address of their own.
    Own,
}

/// How a use meets what is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Match {
    /// It is the same operand.
    Same,
    /// It reaches part of it, or more than it.
    Overlap,
    /// It may: which address, block or data block is known at run time only.
    Possible,
}

/// What is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Bits of an area; of outputs of the peripheral area only those that are written (`PAW`), of inputs those read.
    Bits {
        area: Area,
        at: u32,
        bits: u32,
        written: Option<bool>,
    },
    Data {
        db: u16,
        at: u32,
        bits: u32,
    },
    Timers(u16, u16),
    Counters(u16, u16),
    Blocks(BlockKind, u16, u16),
    /// A name of a block, `#NAME` or `FB 20 #NAME`, in capitals.
    Own(String),
    /// Everything whose address is known at run time only.
    AtRunTime,
}

/// Where the instances of function blocks lie: for each data block the blocks with their first bits.
pub(super) type Instances = std::collections::BTreeMap<u16, Vec<(BlockId, u32)>>;

const fn meet(a: u32, a_bits: u32, b: u32, b_bits: u32) -> bool {
    a < b.saturating_add(b_bits) && b < a.saturating_add(a_bits)
}

fn touch(at: u32, bits: u32, other: u32, other_bits: u32) -> Option<Match> {
    if (at, bits) == (other, other_bits) {
        Some(Match::Same)
    } else {
        meet(at, bits, other, other_bits).then_some(Match::Overlap)
    }
}

impl Wanted {
    /// How a use meets this; `reads` and `writes`: what it does there.
    pub(super) fn meets(&self, extent: &Extent, name: &str, access: [bool; 2], instances: &Instances) -> Option<Match> {
        match (self, extent) {
            (
                Wanted::AtRunTime,
                Extent::Somewhere(_) | Extent::SomeTimer | Extent::SomeCounter | Extent::SomeBlock(_),
            ) => Some(Match::Same),
            (Wanted::AtRunTime, Extent::Data { db: None, .. }) => Some(Match::Same),
            (Wanted::Own(wanted), _) => own(name, wanted).then_some(Match::Same),
            (Wanted::Bits { area, at, bits, written }, Extent::Bits { area: of, at: other, bits: others }) => {
                let touched = touch(*at, *bits, *other, *others)?;
                self.same_wire(*area, *of, *written, access).then_some(())?;
                Some(if area == of { touched } else { Match::Overlap })
            }
            (Wanted::Bits { .. }, Extent::Somewhere(None)) => Some(Match::Possible),
            (Wanted::Bits { area, written, .. }, Extent::Somewhere(Some(of))) => {
                self.same_wire(*area, *of, *written, access).then_some(Match::Possible)
            }
            (Wanted::Data { db, at, bits }, extent) => data(*db, *at, *bits, extent, instances),
            (Wanted::Timers(first, last), Extent::Timer(n)) => number(*first, *last, *n),
            (Wanted::Timers(..), Extent::SomeTimer) => Some(Match::Possible),
            (Wanted::Counters(first, last), Extent::Counter(n)) => number(*first, *last, *n),
            (Wanted::Counters(..), Extent::SomeCounter) => Some(Match::Possible),
            (Wanted::Blocks(kind, first, last), Extent::Block(id)) if id.kind == *kind => {
                number(*first, *last, id.number)
            }
            (Wanted::Blocks(kind, ..), Extent::SomeBlock(of)) if kind == of => Some(Match::Possible),
            _ => None,
        }
    }

    /// The peripheral inputs are the same wires as the inputs, read past the process image; so are the outputs.
    fn same_wire(&self, area: Area, of: Area, written: Option<bool>, [reads, writes]: [bool; 2]) -> bool {
        match (area, of) {
            (Area::Input, Area::Peripheral) => reads,
            (Area::Output, Area::Peripheral) => writes,
            (Area::Peripheral, Area::Peripheral) => match written {
                Some(true) => writes,
                Some(false) => reads,
                None => true,
            },
            (Area::Peripheral, Area::Input) => written != Some(true),
            (Area::Peripheral, Area::Output) => written != Some(false),
            (area, of) => area == of,
        }
    }
}

fn data(db: u16, at: u32, bits: u32, extent: &Extent, instances: &Instances) -> Option<Match> {
    match *extent {
        Extent::Data { db: Some(of), at: other, bits: others } if of == db => touch(at, bits, other, others),
        Extent::Data { db: None, at: other, bits: others } => meet(at, bits, other, others).then_some(Match::Possible),
        Extent::Instance { fb, at: other, bits: others } => {
            let places = instances.get(&db).into_iter().flatten().filter(|(of, _)| *of == fb);
            places.filter_map(|(_, base)| touch(at, bits, base.saturating_add(other), others)).min()
        }
        // Opening a data block reaches no cell of it; whoever asks for all of it wants to know.
        Extent::Block(BlockId { kind: BlockKind::Db, number }) if number == db && bits == u32::MAX => Some(Match::Same),
        Extent::Somewhere(None | Some(Area::Db | Area::Di)) => Some(Match::Possible),
        Extent::SomeBlock(BlockKind::Db) if bits == u32::MAX => Some(Match::Possible),
        _ => None,
    }
}

fn number(first: u16, last: u16, number: u16) -> Option<Match> {
    (first..=last).contains(&number).then_some(Match::Same)
}

/// Whether a name of a block (`FB 20 #pump.run`) is the wanted one or lies in it.
fn own(name: &str, wanted: &str) -> bool {
    let Some(hash) = name.find('#') else { return false };
    let name = name.to_uppercase();
    let text = if wanted.starts_with('#') { name.get(hash..).unwrap_or_default() } else { name.as_str() };
    text.strip_prefix(wanted).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
}
