//! The notation of the rows of the table.

/// Builds rows: the type, its purpose, the fields of the request, and after `->` the fields of its answer.
macro_rules! rows {
    ($($name:ident $(<$life:lifetime>)?, $what:literal, [$($field:expr),* $(,)?] $(-> $($answer:expr),+)?;)*) => {
        &[$(super::FunctionFields {
            type_name: stringify!($name),
            code: <$name $(<$life>)? as $crate::xf::request::Call<'static>>::CODE,
            function: <$name $(<$life>)? as $crate::xf::request::Call<'static>>::FUNCTION,
            what: $what,
            request: &[$($field),*],
            answers: &[$($($answer),+)?],
        },)*]
    };
}

pub(super) use rows;
