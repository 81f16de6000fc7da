//! The macro that declares types with their layouts.

/// Declares the layout of types. `pub struct` and `pub enum` also define the type; `impl` declares the layout of a
/// struct that is defined elsewhere.
///
/// In `slave: SlaveNumber = at(1)` the expression after `=` gives the position of the value, here byte 1 of the data
/// segment. A value without `=`, as in `dc: DcTiming`, has a type with a layout of its own, which gives the positions.
///
/// A number on the wire selects the variant of an enum. The expression after `by` gives the position of this number,
/// the name that errors use for it, and its allowed values.
macro_rules! layout {
    () => {};

    ($(#[$meta:meta])* pub struct $name:ident; $($rest:tt)*) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name;

        $crate::xf::layout::layout! { impl $name {} $($rest)* }
    };

    ($(#[$meta:meta])* pub struct $name:ident $(<$life:lifetime>)? {
        $($(#[$doc:meta])* $vis:vis $field:ident: $type:ty $(= $decl:expr)?,)*
    } $($rest:tt)*) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name $(<$life>)? {
            $($(#[$doc])* $vis $field: $type,)*
        }

        $crate::xf::layout::layout! { impl $name $(<$life>)? { $($field: $type $(= $decl)?,)* } $($rest)* }
    };

    (impl $name:ident $(<$life:lifetime>)? { $($field:ident: $type:ty $(= $decl:expr)?,)* } $($rest:tt)*) => {
        #[allow(unused_imports, unused_variables, reason = "a request without fields needs none")]
        const _: () = {
            use $crate::xf::Malformed;
            use $crate::xf::layout::*;

            impl<'d> FieldLayout<'d> for $name $(<$life>)? {
                const FIELDS: FieldList = FieldList::NONE $(.and(part!(fields $field: $type $(= $decl)?)))*;

                fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
                    $(part!(put &self.$field, to, $field: $type $(= $decl)?)?;)*
                    Ok(())
                }

                fn take(from: &FieldReader<'d>) -> Result<Self, Malformed> {
                    Ok(Self { $($field: part!(take from, $field: $type $(= $decl)?)?,)* })
                }
            }
        };

        $crate::xf::layout::layout! { $($rest)* }
    };

    ($(#[$meta:meta])* pub enum $name:ident $(<$life:lifetime>)?
        by $operation:ident: $int:ident = $by:expr, $called:literal, $allowed:literal
    {
        $(
            $(#[$variant_doc:meta])*
            $variant:ident = $code:literal
            $({ $($(#[$doc:meta])* $field:ident: $type:ty $(= $decl:expr)?,)* })?
            $(($inner:ident: $inner_type:ty $(= $inner_spot:expr)?))?,
        )*
    } $($rest:tt)*) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name $(<$life>)? {
            $($(#[$variant_doc])* $variant $({ $($(#[$doc])* $field: $type,)* })? $(($inner_type))?,)*
        }

        const _: () = {
            use $crate::xf::Malformed;
            use $crate::xf::layout::*;

            const NAMES: $crate::xf::fields::Names = &[$((stringify!($variant), $code),)*];
            const OPERATION: FieldDecl = $by.one_of(NAMES).of::<$int>(stringify!($operation));

            impl $(<$life>)? $name $(<$life>)? {
                /// The number on the wire that selects this variant.
                pub(in crate::xf) const fn $operation(&self) -> $int {
                    match self {
                        $(Self::$variant { .. } => $code,)*
                    }
                }
            }

            impl<'d> FieldLayout<'d> for $name $(<$life>)? {
                const FIELDS: FieldList = FieldList::NONE
                    $($($(.and(part!(fields $field: $type $(= $decl)?)))*)?
                    $(.and(part!(fields $inner: $inner_type $(= $inner_spot)?)))?)*
                    .after(OPERATION.field);

                fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
                    OPERATION.put(&self.$operation(), to)?;
                    match self {
                        $(Self::$variant $({ $($field),* })? $(($inner))? => {
                            $($(part!(put $field, to, $field: $type $(= $decl)?)?;)*)?
                            $(part!(put $inner, to, $inner: $inner_type $(= $inner_spot)?)?;)?
                        })*
                    }
                    Ok(())
                }

                fn take(from: &FieldReader<'d>) -> Result<Self, Malformed> {
                    Ok(match OPERATION.take::<$int>(from)? {
                        $($code => Self::$variant
                            $({ $($field: part!(take from, $field: $type $(= $decl)?)?),* })?
                            $((part!(take from, $inner: $inner_type $(= $inner_spot)?)?))?,)*
                        other => return Err(Malformed::only($called, other.into(), $allowed)),
                    })
                }
            }
        };

        $crate::xf::layout::layout! { $($rest)* }
    };
}

/// Expands to an expression for one value of a layout: `fields` gives the value's list of fields, `put` writes the
/// value, `take` reads it. A value with `=` is one field at that position; a value without `=` has a type with a layout
/// of its own.
macro_rules! part {
    (fields $name:ident: $type:ty) => {
        <$type as FieldLayout<'_>>::FIELDS
    };
    (fields $name:ident: $type:ty = $decl:expr) => {
        FieldList::of($decl.of::<$type>(stringify!($name)))
    };
    (put $part:expr, $to:ident, $name:ident: $type:ty) => {
        FieldLayout::put($part, $to)
    };
    (put $part:expr, $to:ident, $name:ident: $type:ty = $decl:expr) => {
        const { $decl.of::<$type>(stringify!($name)) }.put($part, $to)
    };
    (take $from:ident, $name:ident: $type:ty) => {
        <$type as FieldLayout<'_>>::take($from)
    };
    (take $from:ident, $name:ident: $type:ty = $decl:expr) => {
        const { $decl.of::<$type>(stringify!($name)) }.take::<$type>($from)
    };
}

pub(in crate::xf) use {layout, part};
