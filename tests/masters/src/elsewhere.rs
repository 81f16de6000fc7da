//! Another network namespace, to which interfaces are moved from this one: for a program that has such an interface
//! open it is gone, like a pulled adapter.

use std::fs;
use std::process::{Child, Command};
use std::thread;
use std::time::Duration;

use nix::unistd::gettid;

/// The namespace, until this is dropped.
pub struct Elsewhere(Child);

impl Elsewhere {
    /// A namespace that differs from the calling thread's.
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

    /// Moves an interface back, and switches it on.
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
        // Its interfaces are deleted with it.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
