//! The blocks of pages, and those in `console`: commands with what they print, and running them in one shell.

use std::process::Command;

/// A line that no command prints.
const MARK: &str = "-- end of a command --";

/// A command of a page with what it prints.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// The command, without `$ ` and `> `.
    pub command: String,
    /// The lines below it.
    pub output: String,
}

/// The texts of a page's blocks in this language, without their fences.
pub fn blocks<'a>(page: &'a str, language: &'a str) -> impl Iterator<Item = &'a str> {
    page.split("\n```").filter_map(move |part| part.strip_prefix(language)?.strip_prefix('\n'))
}

/// The commands of all `console` blocks: lines after `$ `, going on after `> `; what follows is their output.
///
/// # Panics
/// A block begins with an output.
pub fn commands(page: &str) -> Vec<Shown> {
    let mut shown: Vec<Shown> = Vec::new();
    for line in blocks(page, "console").flat_map(str::lines) {
        match (line.strip_prefix("$ "), line.strip_prefix("> "), shown.last_mut()) {
            (Some(command), ..) => shown.push(Shown { command: command.to_owned(), output: String::new() }),
            (None, Some(more), Some(last)) => last.command += &format!("\n{more}"),
            (None, None, Some(last)) => last.output += &format!("{line}\n"),
            (None, _, None) => panic!("output before the first command: {line}"),
        }
    }
    shown
}

/// Runs these commands in one bash, whose folder and environment `bash` has, and returns the output of each: standard output
/// and standard error as they come.
///
/// # Panics
/// The shell ended early.
pub fn run(bash: &mut Command, commands: impl IntoIterator<Item = impl AsRef<str>>) -> Vec<String> {
    let script: String = commands.into_iter().map(|command| format!("{}\necho '{MARK}'\n", command.as_ref())).collect();
    let output = bash.args(["-c", &format!("exec 2>&1\n{script}")]).output().expect("bash starts");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let mut said: Vec<String> = text.split(&format!("{MARK}\n")).map(str::to_owned).collect();
    assert_eq!(said.pop().as_deref(), Some(""), "the shell ended early: {text}");
    said
}
