//! Enums whose variants have names.

/// Declares an enum whose variants have names in files and on the command line, so that no variant can be missing from
/// `ALL` or lack a name.
///
/// ```
/// genmanip_core::named_enum! {
///     /// Size of a drink.
///     #[derive(Clone, Copy, Debug, PartialEq)]
///     pub enum Cup {
///         /// A sip.
///         Small = "small",
///         /// A mouthful.
///         Large = "large",
///     }
/// }
/// assert_eq!(Cup::ALL.map(Cup::name), ["small", "large"]);
/// assert_eq!(Cup::named("large"), Some(Cup::Large));
/// ```
#[macro_export]
macro_rules! named_enum {
    ($(#[$meta:meta])* pub enum $name:ident { $($(#[$doc:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$meta])*
        pub enum $name {
            $($(#[$doc])* $variant,)+
        }

        impl $name {
            /// All variants.
            pub const ALL: [Self; [$($text),+].len()] = [$(Self::$variant),+];

            /// Name in files and on the command line.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)+
                }
            }

            /// Variant with this name; `None` if there is none.
            pub fn named(name: &str) -> Option<Self> {
                Self::ALL.into_iter().find(|variant| variant.name() == name)
            }
        }
    };
}
