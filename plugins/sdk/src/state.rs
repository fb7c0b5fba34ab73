//! Memory the host keeps for a block or for a module: zeroed at every start-up, shared by calls that may be nested.

use core::cell::Cell;

/// Types for which zero bytes are a value, and which need no destructor: what the host can allocate for a block.
///
/// State is given as a shared reference, because a block may be called again from a block it called or by a higher
/// priority: put what changes into [`Cell`]s. Declare a state with [`crate::state!`], which needs no unsafe code.
///
/// # Safety
/// All-zero bytes are a valid value of the type, and dropping it does nothing.
pub unsafe trait Zeroable: 'static {}

macro_rules! zeroable {
    ($($ty:ty),*) => {$(
        // SAFETY: a plain number (or nothing), 0 is one of its values.
        unsafe impl Zeroable for $ty {}
    )*};
}

zeroable!((), bool, u8, u16, u32, u64, i8, i16, i32, i64, usize, isize, f32, f64);

// SAFETY: an array of zeroed values is a row of zero bytes.
unsafe impl<T: Zeroable, const N: usize> Zeroable for [T; N] {}
// SAFETY: a Cell has the layout of its content.
unsafe impl<T: Zeroable> Zeroable for Cell<T> {}

/// Declares a state type whose fields are all [`Zeroable`].
///
/// ```
/// use std::cell::Cell;
///
/// ob1_sdk::state! {
///     /// What the block remembers of the last call.
///     pub struct Edge {
///         last: Cell<bool>,
///         count: Cell<u32>,
///     }
/// }
/// # fn zeroable<T: ob1_sdk::Zeroable>() {}
/// # zeroable::<Edge>();
/// ```
#[macro_export]
macro_rules! state {
    (
        $(#[$meta:meta])*
        $vis:vis struct $name:ident { $($(#[$field_meta:meta])* $field_vis:vis $field:ident: $ty:ty),* $(,)? }
    ) => {
        $(#[$meta])*
        $vis struct $name { $($(#[$field_meta])* $field_vis $field: $ty),* }

        const _: () = {
            const fn zeroable<T: $crate::Zeroable>() {}
            $(zeroable::<$ty>();)*
        };

        // SAFETY: every field is Zeroable, checked above.
        unsafe impl $crate::Zeroable for $name {}
    };
}
