//! Where the two ends of a connection run.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// One processor for each end, as if they were two machines: with the threads wherever the system puts them, the figure is
/// whether two that talk came to share a processor.
pub struct Places {
    client: CpuSet,
    server: CpuSet,
}

impl Places {
    /// Goes to the client's.
    pub fn find() -> Self {
        let all = sched_getaffinity(None).expect("it is told");
        let mut there = (0..CpuSet::MAX_CPU).filter(|cpu| all.is_set(*cpu));
        let one = |cpu| {
            let mut set = CpuSet::new();
            set.set(cpu);
            set
        };
        let server = there.next().expect("we run on one");
        let client = there.next().unwrap_or(server);
        let places = Self { client: one(client), server: one(server) };
        places.go(&places.client);
        places
    }

    /// Starts something whose threads all run at the server's end.
    pub fn server<T>(&self, start: impl FnOnce() -> T) -> T {
        self.go(&self.server);
        let started = start();
        self.go(&self.client);
        started
    }

    fn go(&self, place: &CpuSet) {
        sched_setaffinity(None, place).expect("a processor that we may use");
    }
}
