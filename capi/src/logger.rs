//! Where the log goes: to standard error, as far as `ECMSK_LOG` asks for it, and its warnings to `ecmsk exec`, if that
//! started the program. Without either the library says nothing, as the vendor's: standard error is the program's.

use ecmsk::link::config;
use ecmsk::summary::teller::{self, Teller};
use log::{Level, LevelFilter, Log, Metadata, Record};

/// Makes this the log of the process. A program in Rust that links the static library may have one of its own, which then is
/// used.
pub fn set_up() {
    let wanted = config::variable("ECMSK_LOG").and_then(|wanted| wanted.into_string().ok());
    let shown = wanted.filter(|wanted| !wanted.is_empty());
    let shown = shown.map(|wanted| env_logger::Builder::new().parse_filters(&wanted).build());
    let teller = teller::of_process();
    let level = |wanted: bool, level| if wanted { level } else { LevelFilter::Off };
    let shown_level = shown.as_ref().map_or(LevelFilter::Off, env_logger::Logger::filter);
    let max = shown_level.max(level(teller.is_some(), LevelFilter::Warn));
    if max > LevelFilter::Off && log::set_boxed_logger(Box::new(Logger { shown, teller })).is_ok() {
        log::set_max_level(max);
    }
}

struct Logger {
    shown: Option<env_logger::Logger>,
    teller: Option<&'static Teller>,
}

impl Logger {
    fn shows(&self, metadata: &Metadata<'_>) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.enabled(metadata))
    }

    /// Warnings of ours: what other crates warn of is for who looks for it.
    fn tells(&self, metadata: &Metadata<'_>) -> bool {
        let of_ours = || ["ecmsk", "NEXTWUSBLib"].iter().any(|name| metadata.target().starts_with(name));
        self.teller.is_some() && metadata.level() <= Level::Warn && of_ours()
    }
}

impl Log for Logger {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        self.shows(metadata) || self.tells(metadata)
    }

    fn log(&self, record: &Record<'_>) {
        if self.tells(record.metadata())
            && let Some(teller) = self.teller
        {
            teller.say(record.args().to_string());
        }
        if let Some(shown) = &self.shown {
            shown.log(record);
        }
    }

    fn flush(&self) {}
}
