//! A table of all functions: their purpose, and the fields of their requests and answers. It is for programs that
//! take a request from a user by name, or show an answer field by field.
//!
//! A field is a named value at a position in the header or the data segment. [`Draft`] writes fields, and
//! [`Request::decode`](crate::xf::Request::decode) checks them as a request; [`Field::get`] reads the fields of an answer:
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
//! - `mod.rs`: the rows of the table, and the search for a row by name
//! - `field.rs`: a field: its position, its kind, its value
//! - `draft.rs`: building a request from fields
//!
//! The functions are listed in `request/table.rs`; their fields are those of the layouts of requests and answers.

mod draft;
mod field;

pub use super::request::table::FUNCTIONS;
pub use draft::Draft;
pub use field::{Field, FieldKind, FieldPosition, Names, Value};

use super::CommandCode;
use super::command_table::{AnswerForm, CommandTiming};
use super::response::Returned;

/// A function: its purpose, its fields, and the fields of its answer.
#[derive(Clone, Copy, Debug)]
pub struct FunctionFields {
    /// The name of the function's type in [`request`](super::request).
    pub type_name: &'static str,
    /// The code of the command to which the function belongs.
    pub code: CommandCode,
    /// The parameter byte that selects the function, for the codes 31 to 35.
    pub function: Option<u8>,
    /// The purpose of the function in a few words, such as for a list of all functions.
    pub what: &'static str,
    /// The fields of a request for this function, in the order of their positions.
    pub request: &'static [Field],
    /// The possible forms of the answer; empty if there is no result.
    pub answers: &'static [AnswerFields],
}

/// One form of an answer: its length, and its fields.
#[derive(Clone, Copy, Debug)]
pub struct AnswerFields {
    /// The number of valid bytes in an answer of this form; `None` for any number.
    pub len: Option<u16>,
    /// The distance in bytes at which the fields repeat in the data segment, as in a list; `None` if they occur once.
    pub every: Option<u16>,
    /// The fields of an answer of this form, with their positions in its header and its data segment.
    pub fields: &'static [Field],
}

impl AnswerFields {
    /// The form of an answer that always has these fields, whatever its length.
    pub(super) const fn of(fields: &'static [Field]) -> Self {
        Self { len: None, every: None, fields }
    }
}

impl FunctionFields {
    /// The function's name as in the manuals.
    pub fn name(&self) -> &'static str {
        let function = self.function.and_then(|parameter| self.code.function(parameter)).map(|function| function.name);
        function.or_else(|| self.code.name()).unwrap_or(self.type_name)
    }

    /// The first firmware version that has the function, as FW_VERSION_GET returns it; 0 if the manuals name none.
    pub fn since(&self) -> u8 {
        self.function.and_then(|parameter| self.code.function(parameter)).map_or(0, |function| function.since)
    }

    /// Whether the chip completes the function's command before the next packet, or needs more time.
    pub fn timing(&self) -> CommandTiming {
        self.code.command().map_or(CommandTiming::Immediate, |command| command.timing)
    }

    /// The part of the answer that carries the result.
    pub fn answer_form(&self) -> AnswerForm {
        let function =
            self.function.and_then(|parameter| self.code.function(parameter)).map(|function| function.answer);
        let command = || self.code.command().map_or(AnswerForm::Nothing, |command| command.answer);
        function.unwrap_or_else(command)
    }

    /// The request's field with that name, ignoring case; `None` if the request has no such field.
    pub fn field(&self, name: &str) -> Option<&'static Field> {
        self.request.iter().find(|field| field.name.eq_ignore_ascii_case(name))
    }

    /// The form of an answer whose header has these fields: the first form with this number of valid bytes. `None` if
    /// no form has this length, or the function has no result.
    pub fn answer(&self, returned: Returned) -> Option<&'static AnswerFields> {
        self.answers.iter().find(|form| form.len.is_none_or(|len| len == returned.len))
    }

    /// Whether a name is the name of this function in the manuals, with or without `ECM_`, `ECM_CMD_` and `ECAT_`.
    /// Case, `_` and `-` are ignored.
    fn is_named(&self, name: &str) -> bool {
        let full = self.name();
        let command = full.strip_prefix("ECM_").unwrap_or(full);
        let command = command.strip_prefix("CMD_").unwrap_or(command);
        let short = command.strip_prefix("ECAT_").unwrap_or(command);
        [full, command, short].into_iter().any(|known| is_same(known, name))
    }
}

/// The functions that a name means: none, one, or several to which the manuals give the same name. If it is the name of
/// a type in [`request`](super::request), only the function of that type is returned.
pub fn function(name: &str) -> impl Iterator<Item = &'static FunctionFields> {
    let typed = FUNCTIONS.iter().find(|row| is_same(row.type_name, name));
    let named = move |row: &&FunctionFields| typed.is_none() && row.is_named(name);
    typed.into_iter().chain(FUNCTIONS.iter().filter(named))
}

/// Whether two names are the same if case, `_` and `-` are ignored.
fn is_same(a: &str, b: &str) -> bool {
    fn letters(text: &str) -> impl Iterator<Item = u8> {
        text.bytes().filter(|byte| !matches!(byte, b'_' | b'-')).map(|byte| byte.to_ascii_lowercase())
    }
    letters(a).eq(letters(b))
}
