//! `xf commands`: prints the table of the chip's commands and functions.

use std::fmt::Write;

use ecmsk::xf::command_table::CommandTiming;
use ecmsk::xf::fields::{FUNCTIONS, FunctionFields};
use serde_json::{Value, json};

use super::XfVerbError;
use crate::output;

/// List the functions of the chip: code, name, whether the answer has the result at once or the function takes time, and
/// its purpose
#[derive(clap::Args)]
pub struct Args {
    /// Print one JSON object for each function, each on a line of its own
    #[arg(long)]
    json: bool,
}

/// Prints the list of functions.
///
/// # Errors
/// [`XfVerbError::Output`] if standard output cannot be written to.
pub fn run(args: &Args) -> Result<(), XfVerbError> {
    let text = if args.json { FUNCTIONS.iter().map(|row| format!("{}\n", line_json(row))).collect() } else { table() };
    Ok(output::print(text)?)
}

fn table() -> String {
    let widest = |text: fn(&FunctionFields) -> usize| FUNCTIONS.iter().map(text).max().unwrap_or(0);
    let (name, kind) = (widest(|row| row.name().len()), widest(|row| row.type_name.len()));
    let mut text = String::new();
    for row in &FUNCTIONS {
        let since = match row.since() {
            0 => String::new(),
            since => format!("; from firmware {since} on"),
        };
        // Writing to a String does not fail.
        let _ = writeln!(
            text,
            "{:<6} {:<name$}  {:<kind$}  {:<12}  {}{since}",
            number(row),
            row.name(),
            row.type_name,
            timing(row),
            row.what
        );
    }
    text
}

/// The number of a function: the code of its command, such as `12`. If a parameter selects the function, it is
/// appended: `31:8`.
fn number(row: &FunctionFields) -> String {
    let code = row.code.code();
    row.function.map_or_else(|| code.to_string(), |parameter| format!("{code}:{parameter}"))
}

fn timing(row: &FunctionFields) -> &'static str {
    match row.timing() {
        CommandTiming::Immediate => "at once",
        CommandTiming::NonImmediate => "takes time",
        CommandTiming::ByParameter => "by parameter",
    }
}

fn line_json(row: &FunctionFields) -> Value {
    let immediate = match row.timing() {
        CommandTiming::Immediate => Some(true),
        CommandTiming::NonImmediate => Some(false),
        CommandTiming::ByParameter => None,
    };
    let names = |fields: &[ecmsk::xf::fields::Field]| fields.iter().map(|field| field.name).collect::<Vec<_>>();
    json!({
        "verb": "xf commands", "code": row.code.code(), "parameter": row.function, "name": row.name(),
        "type": row.type_name, "immediate": immediate, "since_firmware": (row.since() > 0).then(|| row.since()),
        "what": row.what, "fields": names(row.request),
        "answer": row.answers.last().map_or_else(Vec::new, |answer| names(answer.fields)),
    })
}
