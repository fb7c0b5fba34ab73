//! The parameter list of a block, readable and checked at compile time.

/// Declares the parameters of a block and, for an FB, its instance variables, as the manual's table does: section,
/// name, other spellings, type.
///
/// Gives a module with the table `PARAMS` for [`crate::Block::PARAMS`] and one typed constant for each name, for
/// [`Cx::get`](crate::Cx::get) and [`Cx::set`](crate::Cx::set). Writing an input, or a value of another type, does not
/// compile. Types are those of [`crate::types`]; sections are `in`, `out`, `in_out`, `ret` and, last and only in an FB,
/// `static`.
///
/// ```
/// ob1_sdk::interface! {
///     /// Counts batches.
///     pub mod batch {
///         in     COUNT_UP: Bool;
///         in     BATCH_SIZE: Int;
///         out    DONE | FERTIG: Bool;
///         static PIECES: DInt = 0;
///         static LAST: Bool;
///     }
/// }
/// assert_eq!(batch::PIECES.bit_address(), 6 * 8);
/// ```
///
/// ```compile_fail
/// # use ob1_sdk::*;
/// interface! { mod p { in ADR: Int; } }
/// fn wrong(cx: &mut Cx<'_>) -> Result<(), Abort> {
///     cx.set(p::ADR, 1)
/// }
/// ```
#[macro_export]
macro_rules! interface {
    (
        $(#[$doc:meta])*
        $vis:vis mod $module:ident {
            $(
                $(#[$param_doc:meta])*
                $section:ident $name:ident $(| $alias:ident $(| $more:ident)*)? : $ty:ty $(= $initial:expr)?;
            )*
        }
    ) => {
        $(#[$doc])*
        #[allow(unreachable_pub, reason = "as visible as the module")]
        $vis mod $module {
            // An interface uses only some of the types.
            #[allow(unused_imports, reason = "generated")]
            use $crate::types::*;

            #[allow(non_camel_case_types, clippy::upper_case_acronyms, clippy::enum_variant_names, reason = "the manual's names")]
            enum Index {
                $($name,)*
            }

            /// The table of the parameters.
            pub const PARAMS: &[$crate::Param] = &[$(
                $crate::Param::new(
                    stringify!($name),
                    concat!($(stringify!($alias) $(, "|", stringify!($more))*)?),
                    $crate::interface!(@section $section),
                    <$ty as S7Type>::TY,
                    <$ty as S7Type>::LENGTH,
                    0 $(+ <$ty>::raw($initial))?,
                ),
            )*];

            $(
                $(#[$param_doc])*
                #[doc = concat!("`", stringify!($section), " ", stringify!($name), ": ", stringify!($ty), "`")]
                #[allow(non_upper_case_globals, dead_code, reason = "the manual's names")]
                pub const $name: $crate::interface!(@handle $section $ty) =
                    $crate::interface!(@make $section PARAMS, Index::$name as usize);
            )*
        }
    };
    (@section in) => { $crate::Section::In };
    (@section out) => { $crate::Section::Out };
    (@section in_out) => { $crate::Section::InOut };
    (@section ret) => { $crate::Section::Return };
    (@section static) => { $crate::Section::Static };
    (@handle in $ty:ty) => { $crate::Formal<$ty, $crate::In> };
    (@handle out $ty:ty) => { $crate::Formal<$ty, $crate::Out> };
    (@handle in_out $ty:ty) => { $crate::Formal<$ty, $crate::InOut> };
    (@handle ret $ty:ty) => { $crate::Formal<$ty, $crate::Return> };
    (@handle static $ty:ty) => { $crate::Static<$ty> };
    (@make static $params:expr, $index:expr) => { $crate::Static::new($crate::export::bit_address($params, $index)) };
    (@make $section:ident $params:expr, $index:expr) => { $crate::Formal::new($index as u32) };
}

#[cfg(test)]
mod tests {
    interface! {
        mod every {
            in     ADR: Int;
            in     _DB: BlockDb;
            in     TIMER_NR: TimerOrWord;
            in_out ENDE_KOM | ENDE_KOMM | Kom_Ende: Bool;
            out    PAFE: Byte;
            in     LATE: Bool;
            static A: Bool = true;
            static B: Byte;
            static TEXT: Str<5>;
            static C: Real = 0.5;
            static RAW: Bytes<3>;
            static D: Bool;
        }
    }

    #[test]
    fn indices_follow_the_declaration() {
        assert_eq!(
            [every::ADR.index(), every::ENDE_KOM.index(), every::PAFE.index(), every::LATE.index()],
            [0, 3, 4, 5]
        );
        assert_eq!(every::PARAMS.len(), 12);
        assert_eq!(every::PARAMS[9].0.initial, 0.5f32.to_bits());
    }

    #[test]
    fn statics_lie_behind_the_parameters() {
        // Inputs 0..8 (ADR, _DB, TIMER_NR, LATE 6.0), outputs 8..10, in/outs 10..12.
        let at = |bit: u32| (bit / 8, bit % 8);
        assert_eq!(at(every::A.bit_address()), (12, 0));
        assert_eq!(at(every::B.bit_address()), (13, 0));
        assert_eq!(at(every::TEXT.bit_address()), (14, 0));
        assert_eq!(at(every::C.bit_address()), (22, 0));
        assert_eq!(at(every::RAW.bit_address()), (26, 0));
        assert_eq!(at(every::D.bit_address()), (30, 0));
    }
}
