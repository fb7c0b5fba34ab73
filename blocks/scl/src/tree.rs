//! Expressions with their types, every conversion written out.

use ob1_ir::{AccuOp, Compare, Logic, Number, Op, Target};
use ob1_model::{Area, BitAddr, DataType, Param};
use ob1_stl::front::{Constant, Span};

/// An expression with its type.
#[derive(Clone, Debug)]
pub(crate) struct Typed<'w> {
    pub(crate) kind: Kind<'w>,
    pub(crate) ty: &'w DataType,
    pub(crate) span: Span,
}

#[derive(Clone, Debug)]
pub(crate) enum Kind<'w> {
    /// A constant that takes the type its place wants.
    Flexible(Constant),
    /// An elementary constant of its type, right-aligned.
    Constant(u32),
    /// A composed constant, laid out.
    Bytes(Vec<u8>),
    Var(Var<'w>),
    /// Operations on ACCU1 alone.
    Convert(Vec<Op>, Check, Box<Typed<'w>>),
    /// 0 or 1 of a BOOL.
    FromBool(Box<Typed<'w>>),
    /// The lowest bit.
    ToBool(Box<Typed<'w>>),
    Arithmetic(AccuOp, Box<Typed<'w>>, Box<Typed<'w>>),
    /// TIME_OF_DAY and TIME: the result stays within a day.
    WithinDay(AccuOp, Box<Typed<'w>>, Box<Typed<'w>>),
    Power(Box<Typed<'w>>, Box<Typed<'w>>),
    /// AND, OR, XOR of bit strings.
    Bits(Logic, Box<Typed<'w>>, Box<Typed<'w>>),
    Logic(Logic, Vec<Typed<'w>>),
    Not(Box<Typed<'w>>),
    Compare(Compare, Box<Typed<'w>>, Box<Typed<'w>>),
    Shift(Shifted, Box<Typed<'w>>, Box<Typed<'w>>),
    Abs(Box<Typed<'w>>),
    /// G, IN0, IN1.
    Select(Box<[Typed<'w>; 3]>),
    Mux(Box<Typed<'w>>, Vec<Typed<'w>>),
    /// MIN with `<=`, MAX with `>=`.
    Extreme(Compare, Vec<Typed<'w>>),
    /// MN, IN, MX.
    Limit(Box<[Typed<'w>; 3]>),
    Call(Box<Call<'w>>),
    /// The OK flag of the block.
    Ok,
    /// BR after a call.
    Eno,
    /// What UDINT of TIA Portal needs besides the operations of DINT.
    Unsigned(Unsigned, Vec<Typed<'w>>),
    /// RD_SYS_T of TIA Portal.
    Clock(Box<crate::dates::ClockRead<'w>>),
    /// A timer or counter that is worked as a function.
    Timed(Box<Timed<'w>>),
    Timer(Number),
    Counter(Number),
    /// A block by its number: DB, FB, FC.
    Block(Number),
    Bad,
}

/// An operation of numbers of 32 bits without sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unsigned {
    Divide,
    Mod,
    /// Its value as a REAL.
    ToReal,
    /// Of a REAL.
    OfReal,
}

/// Which shift or rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shifted {
    Left,
    Right,
    RotateLeft,
    RotateRight,
}

/// When a conversion clears the OK flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Check {
    Never,
    /// One of these bits is not 0 before.
    Bits(u32),
    /// The number before is no INT.
    Int,
    /// The number before is not within a day.
    Day,
    /// OV is set.
    Overflow,
    /// OV is set, or the number is no INT before the last step.
    OverflowOrInt,
}

/// A place in memory.
#[derive(Clone, Debug)]
pub(crate) struct Var<'w> {
    pub(crate) base: Base<'w>,
    /// Bits from the base.
    pub(crate) at: BitAddr,
    /// What is added at run time.
    pub(crate) terms: Vec<Term<'w>>,
    /// The declaration it is or lies in: its index in the block's interface.
    pub(crate) declared: Option<usize>,
    /// Peripheral inputs are only read, outputs only written.
    pub(crate) side: Side,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Both,
    Read,
    Write,
}

#[derive(Clone, Debug)]
pub(crate) enum Base<'w> {
    Fixed(Area),
    Instance,
    /// A parameter of a function.
    Param(u16),
    Db(u16),
    /// A data block whose number is known at run time.
    DbAt(Box<Typed<'w>>),
    /// What the POINTER at this address of the instance leads to.
    Through(BitAddr),
}

/// `(index - low) * stride` bits; the index is a DINT.
#[derive(Clone, Debug)]
pub(crate) struct Term<'w> {
    pub(crate) index: Typed<'w>,
    pub(crate) low: i32,
    /// The highest index, where array limits are monitored.
    pub(crate) high: i32,
    pub(crate) stride: u32,
}

/// A timer or counter as a function.
#[derive(Clone, Debug)]
pub(crate) struct Timed<'w> {
    pub(crate) stages: Vec<Stage<'w>>,
    /// Variables, and what they get.
    pub(crate) outputs: Vec<(Typed<'w>, Typed<'w>)>,
    /// Loads the value of the function.
    pub(crate) result: Op,
}

/// `A bit; L load; op`.
#[derive(Clone, Debug)]
pub(crate) struct Stage<'w> {
    pub(crate) bit: Typed<'w>,
    pub(crate) load: Option<Typed<'w>>,
    pub(crate) op: Op,
}

/// A call of a block.
#[derive(Clone, Debug)]
pub(crate) struct Call<'w> {
    pub(crate) target: Target,
    pub(crate) instance: Option<Number>,
    /// The instance as a place, for function blocks.
    pub(crate) place: Option<Var<'w>>,
    pub(crate) actuals: Vec<Actual<'w>>,
    pub(crate) enable: Option<Typed<'w>>,
    /// `ENO => x`.
    pub(crate) enabled: Option<Typed<'w>>,
    /// The function's own inputs may be written, so that it gets copies.
    pub(crate) copies: bool,
    /// Of a function: all its formals.
    pub(crate) formals: Vec<&'w Param>,
    pub(crate) line: u32,
}

/// A parameter with what is supplied, in the order of the call.
#[derive(Clone, Debug)]
pub(crate) struct Actual<'w> {
    /// Its index among the formals.
    pub(crate) index: usize,
    pub(crate) formal: &'w Param,
    /// An input's value, or the variable of an output or in/out.
    pub(crate) value: Typed<'w>,
}

impl<'w> Typed<'w> {
    pub(crate) const fn new(kind: Kind<'w>, ty: &'w DataType, span: Span) -> Self {
        Self { kind, ty, span }
    }

    pub(crate) const fn is_bad(&self) -> bool {
        matches!(self.kind, Kind::Bad)
    }

    /// The value, unless it has a mistake.
    pub(crate) fn good(self) -> Option<Self> {
        if self.is_bad() { None } else { Some(self) }
    }

    /// True for a constant of any kind.
    pub(crate) const fn is_constant(&self) -> bool {
        matches!(self.kind, Kind::Flexible(_) | Kind::Constant(_) | Kind::Bytes(_))
    }

    /// True for what one `L` brings into ACCU1, conversions behind it included: ACCU2 keeps what was in ACCU1.
    pub(crate) fn is_leaf(&self) -> bool {
        match &self.kind {
            Kind::Constant(_) => true,
            Kind::Var(var) => var.is_direct() && *self.ty != DataType::Bool,
            Kind::Convert(_, check, inner) => *check == Check::Never && inner.is_leaf(),
            _ => false,
        }
    }

    /// True for a bit that one `A` scans.
    pub(crate) fn is_bit(&self) -> bool {
        match &self.kind {
            Kind::Var(var) => var.is_direct(),
            Kind::Ok | Kind::Eno | Kind::Timer(_) | Kind::Counter(_) => true,
            Kind::Not(inner) => inner.is_bit() && !matches!(inner.kind, Kind::Not(_)),
            _ => false,
        }
    }
}

impl Var<'_> {
    /// True where no address register is needed.
    pub(crate) const fn is_direct(&self) -> bool {
        self.terms.is_empty() && !matches!(self.base, Base::DbAt(_) | Base::Through(_))
    }
}
