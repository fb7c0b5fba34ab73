//! How a block declares its parameters: one enum, whose variants carry the manual's names and count the parameters.

use ob1_model::{DataType, Interface, Param, Section};

/// A declared parameter or static.
#[derive(Clone, Copy)]
pub(crate) struct Declared {
    pub(crate) name: &'static str,
    /// Other spellings the manuals print.
    pub(crate) aliases: &'static [&'static str],
    pub(crate) section: Section,
    pub(crate) ty: fn() -> DataType,
    /// Initial value as laid-out bytes; empty for zeros.
    pub(crate) initial: &'static [u8],
}

/// The parameters of a block. Statics come last, so that an index counts formals and declarations alike.
pub(crate) trait Params: Copy {
    /// In the order of the block's declaration.
    const DECLARED: &'static [Declared];
    /// Index of the parameter in the declaration, from 0.
    fn index(self) -> u32;
}

/// A parameter by its index: of several that lie one after the other, or of blocks that have it in different places.
#[derive(Clone, Copy)]
pub(crate) struct At(pub(crate) u32);

impl Params for At {
    const DECLARED: &'static [Declared] = &[];

    fn index(self) -> u32 {
        self.0
    }
}

/// The interface of declared parameters, laid out where there is an instance.
pub(crate) fn interface(declared: &[Declared], has_instance: bool) -> Interface {
    let param = |d: &Declared| {
        let initial = (!d.initial.is_empty()).then(|| d.initial.to_vec());
        let aliases = d.aliases.iter().map(|&alias| alias.to_owned()).collect();
        Param { initial, aliases, ..Param::new(d.name, d.section, (d.ty)()) }
    };
    let mut interface = Interface { params: declared.iter().map(param).collect(), ..Interface::default() };
    interface.lay_out(has_instance);
    interface
}

/// `params!(NAME { Input { IN: BOOL, PT: TIME } Output { Q: BOOL } })`: an enum of the parameters in the order written,
/// which is the order of a STEP 7 call; `NAME | OTHER` is one parameter with two spellings, `= expr` gives an initial
/// value as bytes.
macro_rules! params {
    ($name:ident { $($section:ident { $($param:ident $(| $alias:ident)* : $ty:ident $(= $initial:expr)?),+ $(,)? })* }) => {
        #[allow(non_camel_case_types, clippy::upper_case_acronyms, dead_code, reason = "the manual's names; not all are read")]
        #[derive(Clone, Copy)]
        pub(crate) enum $name { $($($param),+),* }

        impl crate::declare::Params for $name {
            const DECLARED: &'static [crate::declare::Declared] = &[$($(
                crate::declare::Declared {
                    name: stringify!($param),
                    aliases: &[$(stringify!($alias)),*],
                    section: ob1_model::Section::$section,
                    ty: crate::declare::types::$ty,
                    initial: crate::declare::initial!($($initial)?),
                }
            ),+),*];

            fn index(self) -> u32 {
                self as u32
            }
        }
    };
}

/// The initial value, or none.
macro_rules! initial {
    () => {
        &[]
    };
    ($initial:expr) => {
        &$initial
    };
}

pub(crate) use {initial, params};

/// The data types by the names they have in a declaration.
#[allow(non_snake_case, reason = "the keywords of the source language")]
pub(crate) mod types {
    use ob1_model::{DataType, Dimension, Field};

    macro_rules! elementary {
        ($($name:ident = $ty:expr),+ $(,)?) => {
            $(pub(crate) fn $name() -> DataType { $ty })+
        };
    }

    elementary! {
        BOOL = DataType::Bool,
        BYTE = DataType::Byte,
        CHAR = DataType::Char,
        WORD = DataType::Word,
        INT = DataType::Int,
        DWORD = DataType::DWord,
        DINT = DataType::DInt,
        REAL = DataType::Real,
        S5TIME = DataType::S5Time,
        TIME = DataType::Time,
        DATE = DataType::Date,
        TOD = DataType::TimeOfDay,
        DT = DataType::DateAndTime,
        STRING = DataType::String(254),
        POINTER = DataType::Pointer,
        ANY = DataType::Any,
        BLOCK_DB = DataType::BlockDb,
        TIMER_OR_WORD = DataType::TimerOrWord,
    }

    fn fields(fields: &[(&str, DataType)]) -> DataType {
        let field = |(name, ty): &(&str, DataType)| Field { name: (*name).to_owned(), ty: ty.clone(), initial: None };
        DataType::Struct(fields.iter().map(field).collect())
    }

    /// Start information of an OB (SFC 6).
    pub(crate) fn START_INFO() -> DataType {
        fields(&[
            ("EV_CLASS", DataType::Byte),
            ("EV_NUM", DataType::Byte),
            ("PRIORITY", DataType::Byte),
            ("NUM", DataType::Byte),
            ("TYP2_3", DataType::Byte),
            ("TYP1", DataType::Byte),
            ("ZI1", DataType::Word),
            ("ZI2_3", DataType::DWord),
        ])
    }

    /// Length and number of records (SFC 51).
    pub(crate) fn SZL_HEADER() -> DataType {
        fields(&[("LENTHDR", DataType::Word), ("N_DR", DataType::Word)])
    }

    /// Gain and integration time (PI_CON of FB 58).
    pub(crate) fn PI_PARAMETERS() -> DataType {
        fields(&[("GAIN", DataType::Real), ("TI", DataType::Real)])
    }

    /// The same and the derivative time (PID_CON of FB 58).
    pub(crate) fn PID_PARAMETERS() -> DataType {
        fields(&[("GAIN", DataType::Real), ("TI", DataType::Real), ("TD", DataType::Real)])
    }

    /// What FB 58 saves (PAR_SAVE).
    pub(crate) fn SAVED_PARAMETERS() -> DataType {
        let reals = ["PFAC_SP", "GAIN", "TI", "TD", "D_F", "CON_ZONE"].map(|name| (name, DataType::Real));
        fields(&[&reals[..], &[("CONZ_ON", DataType::Bool)]].concat())
    }

    /// 16 words, from 1.
    pub(crate) fn WORDS16() -> DataType {
        DataType::Array(vec![Dimension { low: 1, high: 16 }], Box::new(DataType::Word))
    }

    /// 16 times 16 bits, `[1..16, 0..15]`.
    pub(crate) fn BITS16X16() -> DataType {
        let dims = vec![Dimension { low: 1, high: 16 }, Dimension { low: 0, high: 15 }];
        DataType::Array(dims, Box::new(DataType::Bool))
    }

    /// 16 masks of 16 bits, `[0..15, 0..15]`.
    pub(crate) fn MASKS16() -> DataType {
        let dims = vec![Dimension { low: 0, high: 15 }, Dimension { low: 0, high: 15 }];
        DataType::Array(dims, Box::new(DataType::Bool))
    }
}
