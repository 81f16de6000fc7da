//! A box in the middle of a cable: it passes frames on, and loses, delays and doubles some of them. It works on kernels
//! without `sch_netem`, too, and makes the same faults in every run with the same frames.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecmsk::ethercat::{ETHERTYPE, FRAME_LEN_MAX};
use ecmsk::io::ethernet::{DefaultRoute, EthernetSocket, check};
use parking_lot::Mutex;
use support::dice::Dice;

/// The ends of the two cables that it connects: the master's, and that of the slaves.
pub(super) const INTERFACES: [&str; 2] = ["veth2", "veth3"];
/// The interval at which it polls for frames.
const LOOK: Duration = Duration::from_micros(20);

/// The faults of frames: one in that many is lost, duplicated or late; 0: none is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trouble {
    /// Lost, on the way out or back.
    pub lost: u64,
    /// Doubled, on the way out or back.
    pub doubled: u64,
    /// Late by up to that time. On their way back later frames overtake it; on their way out, as on a cable, they wait.
    pub late: u64,
    /// The greatest delay.
    pub by: Duration,
}

struct Shared {
    trouble: Trouble,
    /// How many frames were lost, doubled or late.
    faults: u64,
    is_over: bool,
}

/// The middle of a cable.
pub struct Middle {
    shared: Arc<Mutex<Shared>>,
    thread: Option<JoinHandle<()>>,
}

impl Middle {
    /// Connects both cables.
    pub(super) fn start() -> Self {
        let shared = Arc::new(Mutex::new(Shared { trouble: Trouble::default(), faults: 0, is_over: false }));
        let sockets = INTERFACES.map(|name| {
            EthernetSocket::open(&check(name, DefaultRoute::Allowed).expect("an interface"), ETHERTYPE).expect("root")
        });
        let thread = std::thread::spawn({
            let shared = Arc::clone(&shared);
            move || run(&sockets, &shared)
        });
        Self { shared, thread: Some(thread) }
    }

    /// Sets the faults from now on.
    pub fn make(&self, trouble: Trouble) {
        self.shared.lock().trouble = trouble;
    }

    /// How many frames were lost, doubled or late.
    pub fn faults(&self) -> u64 {
        self.shared.lock().faults
    }
}

impl Drop for Middle {
    fn drop(&mut self) {
        self.shared.lock().is_over = true;
        if let Some(thread) = self.thread.take() {
            thread.join().expect("no panic");
        }
    }
}

/// A frame that is passed on at that time.
struct Waiting {
    at: Instant,
    frame: Vec<u8>,
}

fn run(sockets: &[EthernetSocket; 2], shared: &Mutex<Shared>) {
    let mut dice = Dice(20);
    let mut waiting = [Vec::new(), Vec::new()];
    let mut buffer = [0; FRAME_LEN_MAX];
    loop {
        let Trouble { lost, doubled, late, by } = {
            let shared = shared.lock();
            if shared.is_over {
                return;
            }
            shared.trouble
        };
        let mut faults = 0;
        for (way, from) in sockets.iter().enumerate() {
            // A cable that is pulled carries nothing.
            while let Ok(Some(len)) = from.take(&mut buffer) {
                let mut is = |one_in: u64| one_in > 0 && dice.one_in(one_in);
                let (is_lost, is_doubled, is_late) = (is(lost), is(doubled), is(late));
                faults += u64::from(is_lost || is_doubled || is_late);
                if is_lost || len > buffer.len() {
                    continue;
                }
                let delay = if is_late { by.mul_f64(dice.below(1000) as f64 / 1000.0) } else { Duration::ZERO };
                let queue: &mut Vec<Waiting> = &mut waiting[way];
                let after = if way == 0 { queue.iter().map(|one| one.at).max() } else { None };
                let at = (Instant::now() + delay).max(after.unwrap_or_else(Instant::now));
                for _ in 0..=usize::from(is_doubled) {
                    queue.push(Waiting { at, frame: buffer[..len].to_vec() });
                }
            }
        }
        shared.lock().faults += faults;
        for (queue, to) in waiting.iter_mut().zip([&sockets[1], &sockets[0]]) {
            let now = Instant::now();
            queue.retain(|Waiting { at, frame }| {
                // A frame that cannot be sent is lost, as on a pulled cable.
                let is_due = *at <= now;
                is_due.then(|| to.send(frame));
                !is_due
            });
        }
        std::thread::sleep(LOOK);
    }
}
