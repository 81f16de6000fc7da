//! The log. It is written to standard error as far as `ECMSK_LOG` asks for it, and its warnings go to `ecmsk exec` if that has
//! started the program. Without either the library prints nothing, like the vendor's library.

use ecmsk::link::config;
use ecmsk::summary::writer::{self, SummaryWriter};
use log::{Level, LevelFilter, Log, Metadata, Record};

/// Installs the log of the process. A Rust program that links the static library may have installed its own before, which is
/// used then.
pub fn set_up() {
    let wanted = config::variable("ECMSK_LOG").and_then(|wanted| wanted.into_string().ok());
    let shown = wanted.filter(|wanted| !wanted.is_empty());
    let shown = shown.map(|wanted| env_logger::Builder::new().parse_filters(&wanted).build());
    let summary_writer = writer::of_process();
    let level = |wanted: bool, level| if wanted { level } else { LevelFilter::Off };
    let shown_level = shown.as_ref().map_or(LevelFilter::Off, env_logger::Logger::filter);
    let max = shown_level.max(level(summary_writer.is_some(), LevelFilter::Warn));
    if max > LevelFilter::Off && log::set_boxed_logger(Box::new(Logger { shown, summary_writer })).is_ok() {
        log::set_max_level(max);
    }
}

struct Logger {
    shown: Option<env_logger::Logger>,
    summary_writer: Option<&'static SummaryWriter>,
}

impl Logger {
    fn shows(&self, metadata: &Metadata<'_>) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.enabled(metadata))
    }

    /// Whether `ecmsk exec` gets the message: warnings of this project, and none of other crates.
    fn tells(&self, metadata: &Metadata<'_>) -> bool {
        let of_ours = || ["ecmsk", "NEXTWUSBLib"].iter().any(|name| metadata.target().starts_with(name));
        self.summary_writer.is_some() && metadata.level() <= Level::Warn && of_ours()
    }
}

impl Log for Logger {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        self.shows(metadata) || self.tells(metadata)
    }

    fn log(&self, record: &Record<'_>) {
        if self.tells(record.metadata())
            && let Some(summary_writer) = self.summary_writer
        {
            summary_writer.queue_message(record.args().to_string());
        }
        if let Some(shown) = &self.shown {
            shown.log(record);
        }
    }

    fn flush(&self) {}
}
