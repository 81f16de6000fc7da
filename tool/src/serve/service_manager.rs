//! Reports the state of a server to systemd, by the protocol of sd_notify(3): that it is ready, that it is alive, what
//! is wrong, and that it ends. So units of `Type=notify` know when the board is present, and units with `WatchdogSec=`
//! know when its cycle has stopped.
//!
//! A separate thread sends the reports, so that a service manager that does not read them never blocks the server. Only
//! at its end, after axes were stopped, the server waits briefly for the last report.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use crate::stderr::say;

/// The largest number of queued reports; further reports are dropped. \[OURS]
const WAITING_MAX: usize = 16;
/// The longest wait of a server at its end until its last report is sent, counted from when the report was made.
/// \[OURS]
const END_WAIT_MAX: Duration = Duration::from_millis(200);

/// The connection to the service manager that has started the server, if there is one.
#[derive(Clone)]
pub struct Manager {
    reports: Option<SyncSender<Report>>,
    /// The time within which the service manager expects a ping; `None` if it expects none.
    watchdog: Option<Duration>,
}

#[cfg_attr(not(target_os = "linux"), allow(dead_code, reason = "there is no systemd"))]
enum Report {
    Ready(String),
    Status(String),
    Ping,
    /// The server ends. A message on the channel confirms that this report was sent.
    Stopping(SyncSender<()>),
}

impl Manager {
    /// Finds the service manager from the environment variables `NOTIFY_SOCKET` and `WATCHDOG_USEC`.
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

    /// The time within which the service manager expects a ping; `None` if it expects none.
    pub const fn watchdog(&self) -> Option<Duration> {
        self.watchdog
    }

    /// Reports that the server is ready; `status` says what it serves.
    pub fn ready(&self, status: &str) {
        self.report(Report::Ready(status.trim_end().to_owned()));
    }

    /// Reports what the server does, or what is wrong, in words.
    pub fn status(&self, status: &str) {
        self.report(Report::Status(status.trim_end().to_owned()));
    }

    /// Reports that the server is alive, for the watchdog of systemd.
    pub fn ping(&self) {
        self.report(Report::Ping);
    }

    /// Reports that the server ends. It does not wait for the report to be sent, because axes have to be stopped first.
    pub fn stopping(&self) -> EndReport {
        let (sent, is_sent) = sync_channel(1);
        self.report(Report::Stopping(sent));
        EndReport { is_sent, until: Instant::now() + END_WAIT_MAX }
    }

    fn report(&self, report: Report) {
        if let Some(reports) = &self.reports {
            // This fails if the queue is full because the service manager does not read. The report is then dropped.
            let _ = reports.try_send(report);
        }
    }
}

/// The report that the server ends, which may not have been sent yet.
pub struct EndReport {
    is_sent: Receiver<()>,
    until: Instant,
}

impl EndReport {
    /// Waits until the report is sent, at most [`END_WAIT_MAX`] after it was made. Returns whether it was sent.
    pub fn wait(self) -> bool {
        // This fails at once if there is no service manager, or the report did not fit into the queue.
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

/// Makes a status one line, and removes the token after `?token=`: the token gives access to the page, and every user
/// of the machine can read the status.
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
        let ready = "listening on http://127.0.0.1:1/?token=0a9f (showing sim:)\n";
        assert_eq!(one_line(ready), "listening on http://127.0.0.1:1/ (showing sim:)");
    }

    /// docs/SAFETY.md: a server that ends waits for its service manager only after it has stopped the axes.
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
