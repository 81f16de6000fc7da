//! What each of the 91 functions does and which fields it and its answer have, as a table: for programs that take a
//! request from a user by name, or show an answer field by field.
//!
//! A field is a place in the header or the data segment, with a name. [`Draft`] writes fields, and
//! [`Request::decode`](crate::xf::Request::decode) judges what they are together; [`Field::get`] reads those of an
//! answer:
//!
//! ```
//! use ecmsk::xf::fields::{Draft, Value, function};
//! use ecmsk::xf::request::{Slaves, StateSet};
//! use ecmsk::xf::EtherCatState;
//!
//! let set = function("ECAT_STATE_SET").next().expect("a function of the manuals");
//! let mut data = [0; 112];
//! let mut draft = Draft::new(set, &mut data);
//! draft.put(set.field("slaves").expect("a field"), Value::Number(0xFF))?;
//! draft.put(set.field("state").expect("a field"), Value::Number(8))?;
//! assert_eq!(draft.request()?, StateSet { slaves: Slaves::All, state: EtherCatState::Op }.into());
//! # Ok::<(), ecmsk::xf::Malformed>(())
//! ```
//!
//! - `mod.rs`: the rows of the table, and finding one by its name
//! - `field.rs`: a field: its place, its kind, its value
//! - `draft.rs`: a request from fields
//!
//! The functions are listed in `request/table.rs`; their fields are those of the layouts of requests and answers.

mod draft;
mod field;

pub use super::request::table::FUNCTIONS;
pub use draft::Draft;
pub use field::{Field, Kind, Names, Place, Value};

use super::CommandCode;
use super::code::{AnswerForm, Timing};
use super::response::Returned;

/// A function: what it does, its fields, and those of its answer.
#[derive(Clone, Copy, Debug)]
pub struct FunctionFields {
    /// The name of its type in [`request`](super::request).
    pub type_name: &'static str,
    /// The command code.
    pub code: CommandCode,
    /// The parameter that names the function, with the codes 31 to 35.
    pub function: Option<u8>,
    /// What it does, in a few words.
    pub what: &'static str,
    /// The fields of the request.
    pub request: &'static [Field],
    /// The forms that the answer can have; none: there is no result.
    pub answers: &'static [AnswerFields],
}

/// The fields of an answer.
#[derive(Clone, Copy, Debug)]
pub struct AnswerFields {
    /// How many valid bytes an answer of this form has; `None`: any number.
    pub len: Option<u16>,
    /// The fields are there once more every so many bytes; `None`: once.
    pub every: Option<u16>,
    /// The fields.
    pub fields: &'static [Field],
}

impl AnswerFields {
    /// These fields, in any answer.
    pub(super) const fn of(fields: &'static [Field]) -> Self {
        Self { len: None, every: None, fields }
    }
}

impl FunctionFields {
    /// The name as in the manuals.
    pub fn name(&self) -> &'static str {
        let function = self.function.and_then(|parameter| self.code.function(parameter)).map(|function| function.name);
        function.or_else(|| self.code.name()).unwrap_or(self.type_name)
    }

    /// The first firmware that has it; 0 where the manuals name none.
    pub fn since(&self) -> u8 {
        self.function.and_then(|parameter| self.code.function(parameter)).map_or(0, |function| function.since)
    }

    /// When it is done.
    pub fn timing(&self) -> Timing {
        self.code.command().map_or(Timing::Immediate, |command| command.timing)
    }

    /// Where the result stands in the answer.
    pub fn answer_form(&self) -> AnswerForm {
        let function =
            self.function.and_then(|parameter| self.code.function(parameter)).map(|function| function.answer);
        let command = || self.code.command().map_or(AnswerForm::Nothing, |command| command.answer);
        function.unwrap_or_else(command)
    }

    /// The request's field with that name.
    pub fn field(&self, name: &str) -> Option<&'static Field> {
        self.request.iter().find(|field| field.name.eq_ignore_ascii_case(name))
    }

    /// The fields of an answer with these fields of the header.
    pub fn answer(&self, returned: Returned) -> Option<&'static AnswerFields> {
        self.answers.iter().find(|form| form.len.is_none_or(|len| len == returned.len))
    }

    /// Whether it is meant by a name: that of its type, or the manuals' with or without `ECM_`, `ECM_CMD_` and `ECAT_`;
    /// in any case, `_` and `-` left out.
    fn is_named(&self, name: &str) -> bool {
        let full = self.name();
        let command = full.strip_prefix("ECM_").unwrap_or(full);
        let command = command.strip_prefix("CMD_").unwrap_or(command);
        let short = command.strip_prefix("ECAT_").unwrap_or(command);
        [full, command, short].into_iter().any(|known| is_same(known, name))
    }
}

/// The functions that a name means: one, none, or several to which the manuals give one name. The name of a type means
/// that type.
pub fn function(name: &str) -> impl Iterator<Item = &'static FunctionFields> {
    let typed = FUNCTIONS.iter().find(|row| is_same(row.type_name, name));
    let named = move |row: &&FunctionFields| typed.is_none() && row.is_named(name);
    typed.into_iter().chain(FUNCTIONS.iter().filter(named))
}

/// Whether two names have the same letters and digits, in any case.
fn is_same(a: &str, b: &str) -> bool {
    fn letters(text: &str) -> impl Iterator<Item = u8> {
        text.bytes().filter(|byte| !matches!(byte, b'_' | b'-')).map(|byte| byte.to_ascii_lowercase())
    }
    letters(a).eq(letters(b))
}
