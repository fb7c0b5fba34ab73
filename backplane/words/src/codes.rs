//! Codes of one byte: an enum, and the value for the byte that the other side shows.

macro_rules! codes {
    ($(#[$doc:meta])* $name:ident { $($(#[$item:meta])* $variant:ident = $value:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum $name { $($(#[$item])* $variant = $value,)* }

        impl $name {
            /// The value of this byte; `None` for one that has no meaning.
            #[must_use]
            pub const fn of(byte: u8) -> Option<Self> {
                match byte { $($value => Some(Self::$variant),)* _ => None }
            }
        }
    };
}
pub(crate) use codes;
