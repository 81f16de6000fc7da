//! `ecmsk man`: manual pages of the tool and all its verbs.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory, ValueHint};
use clap_mangen::Man;

use super::{CliError, output};

/// Print a manual page, or write those of all verbs to a folder
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk man | man -l -
  ecmsk man dump | man -l -
  ecmsk man --out ~/.local/share/man/man1 && man ecmsk-dump")]
pub struct Args {
    /// Verb whose page is printed, e.g. dump, or link help [default: the tool's own page]
    #[arg(value_name = "VERB")]
    verb: Vec<String>,

    /// Write the pages of the tool and all its verbs to this folder, which is created if it does not exist
    #[arg(long, value_name = "DIR", conflicts_with = "verb", value_hint = ValueHint::DirPath)]
    out: Option<PathBuf>,
}

/// Why no manual page was made.
#[derive(Debug, thiserror::Error)]
pub enum ManError {
    /// The tool has no verb of the name that the user gave.
    #[error("there is no verb `{verb}`; `ecmsk --help` lists the verbs there are")]
    NoVerb {
        /// The requested verb.
        verb: String,
    },
    /// The folder cannot be written to.
    #[error("cannot write {}: {source}; name another folder with --out", .file.display())]
    Write {
        /// The file or folder that cannot be written.
        file: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
}

/// Prints the manual page of a verb, or writes those of all verbs to a folder.
pub fn run(args: &Args) -> Result<(), CliError> {
    let mut tool = super::Cli::command().disable_help_subcommand(true);
    // Fills in the full names of the subcommands, such as `ecmsk-link-help`.
    tool.build();
    if let Some(folder) = &args.out {
        let failed = |file: &Path| {
            let file = file.to_owned();
            |source| ManError::Write { file, source }
        };
        fs::create_dir_all(folder).map_err(failed(folder))?;
        for command in commands(&tool) {
            let file = folder.join(Man::new(command.clone()).get_filename());
            fs::write(&file, page(&command)?).map_err(failed(&file))?;
        }
        return Ok(output::print(format!("{}\n", folder.display()))?);
    }
    let mut command = &tool;
    for verb in &args.verb {
        let unknown = || ManError::NoVerb { verb: args.verb.join(" ") };
        command = command.find_subcommand(verb).ok_or_else(unknown)?;
    }
    Ok(output::print(page(command)?)?)
}

/// A command and all its subcommands.
fn commands(command: &Command) -> Vec<Command> {
    let below = command.get_subcommands().filter(|verb| !verb.is_hide_set()).flat_map(commands);
    [command.clone()].into_iter().chain(below).collect()
}

/// The manual page of a command, in roff.
fn page(command: &Command) -> io::Result<Vec<u8>> {
    let man = Man::new(command.clone()).source(concat!("ecmsk ", env!("CARGO_PKG_VERSION"))).manual("ECM-SK tools");
    let mut page = Vec::new();
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    if command.get_arguments().next().is_some() {
        man.render_options_section(&mut page)?;
    }
    if command.get_subcommands().next().is_some() {
        man.render_subcommands_section(&mut page)?;
    }
    if let Some(help) = command.get_after_long_help().or(command.get_after_help()) {
        sections(&help.to_string(), &mut page)?;
    }
    if command.get_version().is_some() {
        man.render_version_section(&mut page)?;
    }
    Ok(page)
}

/// Writes the text below the options without filling its lines, since they are examples and tables. A line that ends
/// with a colon and is not indented is a heading.
fn sections(text: &str, page: &mut Vec<u8>) -> io::Result<()> {
    let mut open = false;
    for line in text.lines() {
        let heading = line.strip_suffix(':').filter(|heading| !heading.starts_with(' '));
        if let Some(heading) = heading {
            writeln!(page, "{}.SH {}\n.nf", if open { ".fi\n" } else { "" }, escaped(&heading.to_uppercase()))?;
            open = true;
            continue;
        }
        if !std::mem::replace(&mut open, true) {
            writeln!(page, ".SH NOTES\n.nf")?;
        }
        writeln!(page, "{}", escaped(line.strip_prefix("  ").unwrap_or(line)))?;
    }
    if open { writeln!(page, ".fi") } else { Ok(()) }
}

/// The line with backslashes, dashes and a leading dot or quote escaped, so that roff shows it and does not take it for a
/// request.
fn escaped(line: &str) -> String {
    let line = line.replace('\\', "\\e").replace('-', "\\-");
    if line.starts_with(['.', '\'']) { format!("\\&{line}") } else { line }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples keep their line breaks, and a line that begins with a dot is shown as text.
    #[test]
    fn sections_keep_their_lines() {
        let mut page = Vec::new();
        sections("A word.\n\nExamples:\n  ./run -v\n  'x' \\ y", &mut page).expect("memory");
        let page = String::from_utf8(page).expect("UTF-8");
        assert_eq!(page, ".SH NOTES\n.nf\nA word.\n\n.fi\n.SH EXAMPLES\n.nf\n\\&./run \\-v\n\\&'x' \\e y\n.fi\n");
    }
}
