//! Enums whose values have names, written as a table.

/// Declares an enum from a row for each value: the value and its name. The enum gets `ALL`, every value once in the
/// order of the rows, and `name`.
///
/// ```
/// ob1_model::named! {
///     /// A colour of the lamp.
///     #[derive(Clone, Copy, Debug, PartialEq)]
///     pub enum Colour {
///         /// Stop.
///         Red = "red",
///         /// Go.
///         Green = "green",
///     }
/// }
/// assert_eq!(Colour::ALL.map(Colour::name), ["red", "green"]);
/// ```
#[macro_export]
macro_rules! named {
    ($(#[$meta:meta])* $vis:vis enum $ty:ident { $($(#[$doc:meta])* $value:ident = $name:literal,)* }) => {
        $(#[$meta])*
        $vis enum $ty { $($(#[$doc])* $value,)* }

        impl $ty {
            /// Every value, each once.
            #[allow(dead_code, reason = "a private enum may need its names only")]
            $vis const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// The name of the value.
            $vis const fn name(self) -> &'static str {
                match self { $(Self::$value => $name,)* }
            }
        }
    };
}
