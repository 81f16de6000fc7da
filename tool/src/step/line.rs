//! Parses a line of a script or of the shell. The syntax is that of the command line, without `ecmsk` and without the
//! options of the board. `#` starts a comment.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser};

use super::Step;

#[derive(Debug, Parser)]
#[command(multicall = true, disable_help_flag = true, disable_help_subcommand = true)]
struct Words {
    #[command(subcommand)]
    step: Step,
}

/// A parsed line of a script or of the shell.
#[derive(Debug)]
pub enum Line {
    /// An empty line or a comment.
    Empty,
    /// A step.
    Step(Box<Step>),
}

impl Line {
    /// Parses a line.
    ///
    /// # Errors
    /// The line is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = text.split_once('#').map_or(text, |(text, _)| text);
        let words: Vec<&str> = text.split_whitespace().collect();
        if words.is_empty() {
            return Ok(Self::Empty);
        }
        match Words::try_parse_from(&words) {
            Ok(Words { step }) => Ok(Self::Step(Box::new(step))),
            Err(error) => Err(why(&error, &words)),
        }
    }

    /// The verbs with which a line may begin.
    pub fn verbs() -> Vec<String> {
        Words::command().get_subcommands().map(|verb| verb.get_name().to_owned()).collect()
    }

    /// The verbs, options and fixed values that may follow the words of an incomplete line, for Tab completion.
    pub fn after(words: &[&str]) -> Vec<String> {
        let (at, _) = command(words);
        let verbs = at.get_subcommands().map(|verb| verb.get_name().to_owned());
        let options = at.get_arguments().filter_map(|argument| Some(format!("--{}", argument.get_long()?)));
        let values = at.get_positionals().flat_map(|argument| argument.get_possible_values());
        verbs.chain(values.map(|value| value.get_name().to_owned())).chain(options).collect()
    }

    /// The text that `help WORDS` prints.
    ///
    /// # Errors
    /// The words do not form a verb.
    pub fn help(words: &[&str]) -> Result<String, String> {
        let (mut at, rest) = command(words);
        if words.is_empty() {
            at = at.about("What may be written on a line").override_usage("VERB [ARGUMENTS]");
        }
        match rest {
            [] => Ok(at.render_long_help().to_string()),
            [word, ..] => Err(format!("`{word}` is unknown; allowed: {}", Self::verbs().join(", "))),
        }
    }
}

/// Finds the command for the words of a line. Returns clap's command of the last verb that exists, and the words after
/// it.
fn command<'a>(mut words: &'a [&'a str]) -> (clap::Command, &'a [&'a str]) {
    let mut at = Words::command();
    at.build();
    while let Some((word, rest)) = words.split_first()
        && let Some(next) = at.find_subcommand(word).cloned()
    {
        (at, words) = (next, rest);
    }
    (at, words)
}

/// The text of a clap error for a line, as a single line. It ends with the syntax of the verb, or with the verbs that
/// may follow it.
fn why(error: &clap::Error, words: &[&str]) -> String {
    if let (.., [word, ..]) = command(words)
        && word == &words[0]
    {
        return format!("`{}` is unknown; allowed: {}", words[0], Line::verbs().join(", "));
    }
    let text = error.render().to_string();
    let first = text.split("\n\n").next().unwrap_or_default();
    let first = first.split_whitespace().collect::<Vec<_>>().join(" ");
    let first = match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::DisplayHelp => "a word is missing",
        _ => first.trim_start_matches("error: "),
    };
    // If the verb has verbs below it, the error lists these verbs instead of the syntax.
    let (at, _) = command(words);
    let verbs: Vec<_> = at.get_subcommands().map(clap::Command::get_name).collect();
    if !verbs.is_empty() {
        let wrong = if words.len() > 1 { format!("`{}` is unknown", words[1..].join(" ")) } else { first.to_owned() };
        let verbs = verbs.join(", ");
        return format!("{wrong}; allowed behind `{}`: {verbs}; `help {}` says more", words[0], words[0]);
    }
    let usage = match error.get(ContextKind::Usage) {
        Some(ContextValue::StyledStr(usage)) => usage.to_string(),
        _ => command(words).0.render_usage().to_string(),
    };
    let usage = usage.trim_start_matches("Usage:").split_whitespace().collect::<Vec<_>>().join(" ");
    format!("{first}; write: {usage}")
}
