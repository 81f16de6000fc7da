//! Reports to systemd what a server does, by the protocol of sd_notify(3): that it serves, that it lives, what is wrong, and
//! that it ends. So units of `Type=notify` know when the board is present, and units with `WatchdogSec=` when its cycle
//! stands still.
//!
//! A thread of its own sends the reports, so that the server waits for a service manager that does not read at its end only,
//! briefly, and when axes stand.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use crate::stderr::say;

/// The most reports that wait; further pings are left out. \[OURS]
const WAITING_MAX: usize = 16;
/// How long after the report of its end a server waits until the service manager has taken it. \[OURS]
const END_WAIT_MAX: Duration = Duration::from_millis(200);

/// The service manager that has started the server, if one has.
#[derive(Clone)]
pub struct Manager {
    reports: Option<SyncSender<Report>>,
    /// How often the service manager wants a ping at least; `None`: it wants none.
    watchdog: Option<Duration>,
}

#[cfg_attr(not(target_os = "linux"), allow(dead_code, reason = "there is no systemd"))]
enum Report {
    Ready(String),
    Status(String),
    Ping,
    /// The server ends. The sender is told when this was sent.
    Stopping(SyncSender<()>),
}

impl Manager {
    /// The service manager that the environment names (`NOTIFY_SOCKET`, `WATCHDOG_USEC`).
    pub fn find() -> Self {
        let none = Self { reports: None, watchdog: None };
        if !cfg!(target_os = "linux") || std::env::var_os("NOTIFY_SOCKET").is_none() {
            return none;
        }
        let (sender, reports) = sync_channel(WAITING_MAX);
        match thread::Builder::new().name("notify".into()).spawn(move || pass_on(&reports)) {
            Ok(_) => Self { reports: Some(sender), watchdog: watchdog() },
            Err(error) => {
                say("warning", &format_args!("systemd is told nothing, there is no thread for it: {error}"));
                none
            }
        }
    }

    /// In what time the service manager wants a ping; `None`: it wants none.
    pub const fn watchdog(&self) -> Option<Duration> {
        self.watchdog
    }

    /// The server is ready, and what it serves.
    pub fn ready(&self, status: &str) {
        self.report(Report::Ready(status.trim_end().to_owned()));
    }

    /// What the server does, or what is wrong, in words.
    pub fn status(&self, status: &str) {
        self.report(Report::Status(status.trim_end().to_owned()));
    }

    /// The server lives.
    pub fn ping(&self) {
        self.report(Report::Ping);
    }

    /// The server ends. Does not wait, because axes have to be stopped.
    pub fn stopping(&self) -> EndReport {
        let (sent, is_sent) = sync_channel(1);
        self.report(Report::Stopping(sent));
        EndReport { is_sent, until: Instant::now() + END_WAIT_MAX }
    }

    fn report(&self, report: Report) {
        if let Some(reports) = &self.reports {
            // It fails if the service manager does not read. The reports before this one are waiting then.
            let _ = reports.try_send(report);
        }
    }
}

/// The report that the server ends.
pub struct EndReport {
    is_sent: Receiver<()>,
    until: Instant,
}

impl EndReport {
    /// Waits until it was sent, at most [`END_WAIT_MAX`] after it was made. Returns whether it was.
    pub fn wait(self) -> bool {
        // It fails at once if there is no service manager, or no room for the report.
        self.is_sent.recv_timeout(self.until.saturating_duration_since(Instant::now())).is_ok()
    }
}

fn pass_on(reports: &Receiver<Report>) {
    let mut has_failed = false;
    for report in reports {
        if let Err(error) = send(&report)
            && !std::mem::replace(&mut has_failed, true)
        {
            let what = match report {
                Report::Ready(_) => "systemd does not know that the server is ready",
                _ => "systemd takes no reports of the server",
            };
            say("warning", &format_args!("{what} ({error}); look at NOTIFY_SOCKET"));
        }
        if let Report::Stopping(sent) = report {
            let _ = sent.try_send(());
        }
    }
}

/// A status is one line. What follows `?token=` opens the page, and every user of the machine can read the status.
#[cfg(target_os = "linux")]
fn one_line(status: &str) -> String {
    let without_token = |line: &str| match line.split_once("?token=") {
        Some((before, after)) => format!("{before}{}", after.trim_start_matches(|c: char| c.is_ascii_alphanumeric())),
        None => line.to_owned(),
    };
    status.trim_end().lines().map(without_token).collect::<Vec<_>>().join("; ")
}

#[cfg(target_os = "linux")]
fn send(report: &Report) -> io::Result<()> {
    use sd_notify::{NotifyState, notify};

    match report {
        Report::Ready(status) => notify(&[NotifyState::Ready, NotifyState::Status(&one_line(status))]),
        Report::Status(status) => notify(&[NotifyState::Status(&one_line(status))]),
        Report::Ping => notify(&[NotifyState::Watchdog]),
        Report::Stopping(_) => notify(&[NotifyState::Stopping]),
    }
}

#[cfg(not(target_os = "linux"))]
fn send(_: &Report) -> io::Result<()> {
    Ok(())
}

#[cfg(target_os = "linux")]
fn watchdog() -> Option<Duration> {
    sd_notify::watchdog_enabled().filter(|limit| !limit.is_zero())
}

#[cfg(not(target_os = "linux"))]
const fn watchdog() -> Option<Duration> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_status_is_one_line_without_a_token() {
        assert_eq!(one_line("a\nb\n"), "a; b");
        let ready = "listening on http://127.0.0.1:1/?token=0a9f; showing sim:\n";
        assert_eq!(one_line(ready), "listening on http://127.0.0.1:1/; showing sim:");
    }

    /// docs/SAFETY.md: a server that ends waits for its service manager after it has stopped the axes, not before.
    #[test]
    fn the_report_of_the_end_is_waited_for_later() {
        let (sender, reports) = sync_channel(1);
        let manager = Manager { reports: Some(sender), watchdog: None };
        let report = manager.stopping();
        let Ok(Report::Stopping(sent)) = reports.try_recv() else { panic!("there is a report") };
        sent.send(()).expect("nobody has waited for it yet");
        assert!(report.wait());
        assert!(!Manager { reports: None, watchdog: None }.stopping().wait(), "there is no service manager");
    }
}
