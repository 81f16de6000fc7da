//! Another network namespace, in which interfaces go that are taken out of this one: for whoever has it open such an interface is
//! gone, as an adapter that is pulled is.

use std::fs;
use std::process::{Child, Command};
use std::thread;
use std::time::Duration;

use nix::unistd::gettid;

/// The namespace, until this is dropped.
pub struct Elsewhere(Child);

impl Elsewhere {
    /// Another one than that of the calling thread.
    ///
    /// # Panics
    /// The system gives none.
    #[allow(clippy::new_without_default, reason = "it starts a process")]
    pub fn new() -> Self {
        let child = Command::new("unshare").args(["--net", "sleep", "600"]).spawn().expect("unshare starts");
        let here = fs::read_link("/proc/thread-self/ns/net").expect("a namespace");
        while fs::read_link(format!("/proc/{}/ns/net", child.id())).is_ok_and(|there| there == here) {
            thread::sleep(Duration::from_millis(1));
        }
        Self(child)
    }

    /// Takes an interface out of this thread's namespace.
    ///
    /// # Panics
    /// It is not there.
    pub fn take(&self, interface: &str) {
        support::succeed(Command::new("ip").args(["link", "set", interface, "netns", &self.0.id().to_string()]));
    }

    /// Gives an interface back, and switches it on.
    ///
    /// # Panics
    /// It was not taken.
    pub fn give_back(&self, interface: &str) {
        let mut command = Command::new("nsenter");
        command.arg(format!("--net=/proc/{}/ns/net", self.0.id()));
        support::succeed(command.args(["ip", "link", "set", interface, "netns", &gettid().to_string()]));
        support::succeed(Command::new("ip").args(["link", "set", interface, "up"]));
    }
}

impl Drop for Elsewhere {
    fn drop(&mut self) {
        // What it has goes with it.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
