//! The macro for register fields that are sets of named bits.

/// Defines integer newtypes with named bits. A value may also have bits that have no name: no function drops them.
macro_rules! bits {
    ($($(#[$doc:meta])* $name:ident($int:ty) { $($(#[$bit_doc:meta])* $bit:ident = $value:expr;)* })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name(pub $int);

        impl $name {
            /// No bit is set.
            pub const NONE: Self = Self(0);
            $($(#[$bit_doc])* pub const $bit: Self = Self($value);)*

            /// The names of the constants of this type with their values, including names that stand for several bits.
            pub const NAMES: &'static [(&'static str, u32)] = &[$((stringify!($bit), Self::$bit.0 as u32),)*];

            /// The names of the bits that are set. Bits without a name are left out.
            pub fn names(self) -> impl Iterator<Item = &'static str> {
                let is_set = move |(_, bits): &&(&str, u32)| bits.is_power_of_two() && self.0 as u32 & bits != 0;
                Self::NAMES.iter().filter(is_set).map(|(name, _)| *name)
            }

            /// Whether all bits of the argument are set.
            pub const fn contains(self, bits: Self) -> bool {
                self.0 & bits.0 == bits.0
            }

            /// Whether at least one bit of the argument is set.
            pub const fn intersects(self, bits: Self) -> bool {
                self.0 & bits.0 != 0
            }

            /// This value with the bits of the argument set.
            #[must_use]
            pub const fn with(self, bits: Self) -> Self {
                Self(self.0 | bits.0)
            }

            /// This value with the bits of the argument cleared.
            #[must_use]
            pub const fn without(self, bits: Self) -> Self {
                Self(self.0 & !bits.0)
            }
        }

        impl core::ops::BitOr for $name {
            type Output = Self;

            fn bitor(self, other: Self) -> Self {
                self.with(other)
            }
        }
    )*};
}

pub(crate) use bits;
