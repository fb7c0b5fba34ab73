//! Codes of one byte: an enum, and the value for the byte that the other side shows.

/// Declares an enum from a row for each value: its name and its code. The enum gets `ALL`, every value once, and `of`,
/// the value of a byte.
#[macro_export]
macro_rules! codes {
    ($(#[$doc:meta])* $name:ident { $($(#[$item:meta])* $variant:ident = $value:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$item])* $variant = $value,)* }

        impl $name {
            /// Every value, each once.
            pub const ALL: [Self; [$($value),*].len()] = [$(Self::$variant),*];

            /// The value of this byte; `None` for one that has no meaning.
            pub const fn of(byte: u8) -> Option<Self> {
                match byte { $($value => Some(Self::$variant),)* _ => None }
            }
        }
    };
}
