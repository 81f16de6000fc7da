//! How the rows of the table are written.

/// Makes rows: the type, what it does, the fields of the request, and after `->` those of its answer.
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
