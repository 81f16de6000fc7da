//! Little-endian integers without alignment, for wire layouts on any host.

use bytemuck::{Pod, Zeroable};

/// Defines integers with the wire's byte order and alignment 1, so that a layout can be cast onto the bytes of a frame.
macro_rules! little_endian {
    ($($(#[$doc:meta])* $name:ident($int:ty, $n:literal);)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
        #[repr(transparent)]
        pub struct $name([u8; $n]);

        impl $name {
            /// Converts from the host's byte order.
            pub const fn new(value: $int) -> Self {
                Self(value.to_le_bytes())
            }

            /// The value in the host's byte order.
            pub const fn get(self) -> $int {
                <$int>::from_le_bytes(self.0)
            }
        }

        impl From<$int> for $name {
            fn from(value: $int) -> Self {
                Self::new(value)
            }
        }
    )*};
}

little_endian! {
    /// `u16`, little endian, alignment 1.
    U16Le(u16, 2);
    /// `u32`, little endian, alignment 1.
    U32Le(u32, 4);
    /// `i32`, little endian, alignment 1.
    I32Le(i32, 4);
}
