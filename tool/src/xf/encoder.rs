//! `xf encoder`: shows, starts or stops the chip's encoder input.

use clap::Subcommand;
use ecmsk::xf::request::{EncGetCount, EncOpen, EncStart, EncStop, EncoderMode};
use serde_json::json;

use super::error::unless_refused;
use super::session::{ChipArgs, Session};
use super::words::{chosen, word};
use super::{Shown, XfVerbError};

/// Show, start or stop the encoder's count
///
/// Without a verb the count is shown. The chip counts while it is started, also between two calls of this tool.
#[derive(clap::Args)]
#[command(disable_help_subcommand = true, args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    verb: Option<Verb>,

    #[command(flatten)]
    chip: ChipArgs,
}

#[derive(Subcommand)]
enum Verb {
    /// Open the encoder and start counting
    Start {
        /// Counting mode: x4 counts all edges of both signals, x2 half of them; free wraps around, compare counts up to a
        /// comparison value, at which the encoder's interrupt occurs
        #[arg(long, value_name = "x4-free|x2-free|x4-compare|x2-compare", default_value = "x4-free", value_parser = mode)]
        mode: EncoderMode,
        #[command(flatten)]
        chip: ChipArgs,
    },
    /// Stop counting
    Stop {
        #[command(flatten)]
        chip: ChipArgs,
    },
}

fn mode(text: &str) -> Result<EncoderMode, String> {
    chosen(text, EncoderMode::NAMES).and_then(|code| EncoderMode::from_code(code).ok_or_else(String::new))
}

impl Args {
    pub const fn chip(&self) -> &ChipArgs {
        match &self.verb {
            None => &self.chip,
            Some(Verb::Start { chip, .. } | Verb::Stop { chip }) => chip,
        }
    }

    /// Shows the count, or starts or stops counting.
    ///
    /// # Errors
    /// [`XfVerbError`] if the chip does not answer or refuses a command; [`XfVerbError::Refused`] if the encoder is not
    /// open.
    pub fn run(&self, session: &mut Session) -> Result<Vec<Shown>, XfVerbError> {
        let not_open = || XfVerbError::Refused {
            what: "xf encoder",
            why: "the chip refused: its encoder is not open".into(),
            next: "open it with `ecmsk xf encoder start`".into(),
        };
        match &self.verb {
            None => {
                let count = unless_refused(session.xf.run(&EncGetCount))?.ok_or_else(not_open)?;
                Ok(vec![(count.to_string(), json!({"verb": "xf encoder", "count": count}))])
            }
            Some(Verb::Start { mode, .. }) => {
                session.xf.run(&EncOpen { mode: *mode })?;
                session.xf.run(&EncStart)?;
                let mode = word(&format!("{mode:?}"));
                let json = json!({"verb": "xf encoder start", "mode": mode});
                Ok(vec![(format!("counting, {mode}"), json)])
            }
            Some(Verb::Stop { .. }) => {
                unless_refused(session.xf.run(&EncStop))?.ok_or_else(not_open)?;
                Ok(vec![("stopped".to_owned(), json!({"verb": "xf encoder stop"}))])
            }
        }
    }
}
