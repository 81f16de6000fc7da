//! [`MachineFileError`]: why a machine file cannot be used.

/// Why a machine file cannot be used. Every text ends with the next step.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum MachineFileError {
    /// The file cannot be read.
    #[error(
        "cannot read the machine file {file}: {message}; name another file, or make one with `ecmsk machine new LINK`"
    )]
    Unreadable { file: String, message: String },
    /// The text is no TOML.
    #[error("{file}, line {line}: {message}; correct the line, see https://toml.io")]
    Syntax { file: String, line: usize, message: String },
    /// The file was written for a newer version of this library.
    #[error("{file}, line {line}: format: it is {found}, and this version reads up to {known}; take a newer ecmsk")]
    Newer { file: String, line: usize, found: i64, known: i64 },
    /// A field is missing or wrong.
    #[error("{file}, line {line}: {field}: {what}; {next}")]
    Field {
        file: String,
        line: usize,
        /// The path of the field, such as `axes.X.per`.
        field: String,
        /// What is wrong with the field.
        what: String,
        /// What the user has to do.
        next: String,
    },
}
