//! Reports to systemd that a server serves, by the protocol of sd_notify(3), so that units of `Type=notify` know when the board
//! is present.

use std::thread;

use sd_notify::NotifyState;

use crate::stderr::say;

/// Reports that the server is ready, and what it serves. Does nothing unless systemd has set `NOTIFY_SOCKET`.
///
/// A thread of its own waits for the service manager, so that the server reacts to signals while nobody reads that socket.
pub fn ready(status: &str) {
    if std::env::var_os("NOTIFY_SOCKET").is_none() {
        return;
    }
    let status = status.trim_end().to_owned();
    let report = move || {
        if let Err(error) = sd_notify::notify(&[NotifyState::Ready, NotifyState::Status(&status)]) {
            warn(&error);
        }
    };
    if let Err(error) = thread::Builder::new().name("ready".into()).spawn(report) {
        warn(&error);
    }
}

fn warn(error: &std::io::Error) {
    say("warning", &format_args!("systemd does not know that the server is ready ({error}); look at NOTIFY_SOCKET"));
}
