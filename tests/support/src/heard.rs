//! Captures this process's log, for tests of it.

use std::sync::{Mutex, MutexGuard};

/// Log lines of this process, warnings and worse, and the lock of the test that listens.
static HEARD: Mutex<Vec<String>> = Mutex::new(Vec::new());
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

struct Listener;

impl log::Log for Listener {
    fn enabled(&self, _: &log::Metadata) -> bool {
        true
    }
    fn log(&self, record: &log::Record) {
        HEARD.lock().unwrap().push(record.args().to_string());
    }
    fn flush(&self) {}
}

/// Captures lines from now on. Only one test listens at a time.
pub fn listen() -> MutexGuard<'static, ()> {
    let turn = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    // The first test that listens installs the logger.
    let _ = log::set_logger(&Listener);
    log::set_max_level(log::LevelFilter::Warn);
    HEARD.lock().unwrap().clear();
    turn
}

/// The lines with all of these words.
pub fn lines_with(words: &[&str]) -> Vec<String> {
    let has_all = |line: &&String| words.iter().all(|word| line.contains(word));
    HEARD.lock().unwrap().iter().filter(has_all).cloned().collect()
}
