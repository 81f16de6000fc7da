//! `ecmsk shell`: runs steps on one open board as the user types them.

mod input;
mod terminal;

use std::io::{self, IsTerminal};
use std::process::ExitCode;

use super::board::{self, Board, BoardError, BoardUse, Interrupt, StepSource};
use super::output;
use super::script;
use super::stderr::say;
use super::step::Line;
use input::Input;

/// Type steps on one open board
///
/// The steps are those of a script (see `ecmsk run --help`), and help [VERB] and quit. Tab completes, arrow up brings
/// back earlier lines. Ctrl-C ends the running step; Ctrl-D or quit closes the board, as --close says. Without a
/// terminal, the first line that fails ends the shell: its number is printed, and the exit code is 1.
#[derive(Debug, clap::Args)]
#[allow(rustdoc::broken_intra_doc_links, reason = "the text is what --help prints, in which [VERB] is no link")]
pub struct Args {
    /// Without a terminal, go on after lines that fail; the exit code is 1 if at least one has failed
    #[arg(long)]
    keep_going: bool,

    #[command(flatten)]
    board: board::Args,
}

/// Runs `ecmsk shell`: opens the board, and executes lines until the input ends or a line ends it.
///
/// # Errors
/// [`BoardError`] if the board cannot be opened, standard input cannot be read, a signal stops the shell, or a line fails
/// without a terminal and without `--keep-going`.
pub fn run(args: &Args) -> Result<ExitCode, BoardError> {
    let board = Board::open(&args.board, BoardUse::Moves, StepSource::Lines, Interrupt::watch()?)?;
    let typed = io::stdin().is_terminal();
    let input = Input::start(typed)?;
    let mut failed = false;
    let mut number = 0;
    let done = loop {
        number += 1;
        match input.next(&board) {
            Ok(Some(line)) => match answer(&board, &line) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(error) if ends(&board, &error) => break Err(error),
                Err(error) => {
                    failed = true;
                    // An error in a piped line needs its line number; a typed line is visible anyway.
                    let error = if typed { error } else { script::at(script::STDIN, number, error) };
                    if !typed && !args.keep_going {
                        break Err(error);
                    }
                    board.reporter.clear();
                    say("error", &error);
                    board.interrupt.clear();
                }
            },
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    board.close(done)?;
    Ok(if failed && !typed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Whether the error ends the shell: a signal other than Ctrl-C, or a terminal that was closed.
fn ends(board: &Board, error: &BoardError) -> bool {
    match error {
        // Ctrl-C (signal 2) at a terminal ends only the step.
        BoardError::Stopped { signal, .. } => *signal != 2 || !io::stdin().is_terminal(),
        BoardError::Output(_) => true,
        _ => board.interrupt.signal().is_some_and(|signal| signal != 2),
    }
}

/// Runs a line; returns false if it is `quit` or `exit`.
fn answer(board: &Board, line: &str) -> Result<bool, BoardError> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words.split_first() {
        Some((&("quit" | "exit"), [])) => return Ok(false),
        Some((&"help", words)) => {
            let help = Line::help(words).map_err(wrong)?;
            output::print(help)?;
            if words.is_empty() {
                output::print("\nhelp [VERB] and quit are of the shell; lines of a script are the rest.\n")?;
            }
        }
        _ => match Line::parse(line).map_err(wrong)? {
            Line::Empty => {}
            Line::Step(step) => step.run(board)?,
        },
    }
    Ok(true)
}

fn wrong(why: String) -> BoardError {
    BoardError::Typed { why }
}

/// The completions of a line, and the position of the word that they replace.
pub fn complete(line: &str) -> (usize, Vec<String>) {
    let start = line.rfind(char::is_whitespace).map_or(0, |blank| blank + 1);
    let (before, word) = line.split_at(start);
    let words: Vec<&str> = before.split_whitespace().collect();
    let mut all = match words.split_first() {
        None => ["help", "quit"].map(str::to_owned).into_iter().chain(Line::verbs()).collect(),
        Some((&"help", words)) => Line::after(words),
        Some(_) => Line::after(&words),
    };
    all.retain(|candidate| candidate.starts_with(word) && (word.starts_with('-') || !candidate.starts_with('-')));
    if let [only] = &mut all[..] {
        // A single completion is followed by a blank for the next word.
        only.push(' ');
    }
    (start, all)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tab completes verbs, the verbs below them, and options.
    #[test]
    fn tab_completes_verbs_their_verbs_and_their_options() {
        assert_eq!(complete("mo"), (0, vec!["move ".to_owned()]));
        assert_eq!(complete("sdo w"), (4, vec!["write ".to_owned()]));
        assert_eq!(complete("servo o").1, ["on", "off"]);
        assert_eq!(complete("move 1=5 --acc"), (9, vec!["--acceleration ".to_owned()]));
        assert_eq!(complete("help ho"), (5, vec!["home ".to_owned()]));
        assert!(complete("").1.contains(&"quit".to_owned()));
        assert!(complete("nonsense x").1.is_empty());
    }
}
