//! An EtherCAT master in software, for networks of up to [`MAX_SLAVES`](crate::ethercat::MAX_SLAVES) slaves.
//!
//! The master is pure and polled: it uses no clock, no thread and no network card. Time is an argument, in nanoseconds of
//! one clock that never goes back; a [`Wire`] sends and receives the frames. The same frames at the same times always
//! lead to the same steps.
//!
//! A cycle allocates nothing. After a scan the jobs of a running program allocate nothing either: changes of state
//! ([`Master::request_state`]), transfers of up to 4 bytes ([`Master::download`], [`Master::upload_number`]), slaves that
//! are lost and come back, and emergencies. Other jobs allocate when they begin.
//!
//! # Calls and their order
//!
//! - [`Master::poll`] as often as the user likes, say every 50 us: it receives frames, continues the running jobs, and
//!   sends the frames that they need.
//! - Each operation of more than one frame is a job, whose start returns a [`Job`]: [`Master::scan`],
//!   [`Master::request_state`], [`Master::upload`], [`Master::download`], [`Master::object_list`], [`Master::read_file`],
//!   [`Master::write_eeprom`], [`Master::datagram`] and others. [`Master::take`] returns the result; every job ends.
//!   Several jobs may run at once: SDOs to several slaves, and changes of state of several sets of slaves, both beside
//!   cycles.
//! - [`Master::configure`] in PreOP, once the process data of a slave are mapped.
//! - [`Master::cycle`] once per cycle, from SafeOP on: it sends the process data. When its frames have come back,
//!   [`Master::take_cycle`] returns the working counters. [`Master::outputs_mut`] sets outputs at any time before, and
//!   [`Master::inputs`] reads inputs after it. On its way to OP a slave waits for outputs.
//! - [`CycleDone::fresh`] has the slaves whose inputs are those of that cycle. After a wrong working counter, inputs
//!   keep their previous values.
//! - With distributed clocks: [`Master::set_sync`] before a slave goes to SafeOP, and [`Master::set_pace`] once.
//!   [`CycleDone::next_deadline`] is then the time for the next cycle.
//! - [`Master::take_event`] returns what happens without a request: emergencies, slaves that are lost or come back, states
//!   that slaves leave. [`Master::missing`] has the slaves that do not answer now. [`Master::request_state`] brings back
//!   a slave that was cut off. A slave that was without power ([`Event::PowerCycled`]) first has to be mapped by SDO, as
//!   at the start.
//!
//! While the user runs cycles, the datagrams of jobs share one frame, which follows the frames of each cycle. Otherwise
//! they are sent as fast as answers come back.
//!
//! ```
//! # #[cfg(feature = "sim")] {
//! use ecmsk::ethercat::{AlState, Ns, SlaveSet};
//! use ecmsk::master::{Ending, FrameBuffer, Job, Master, Settings, Wire, WireDown};
//! use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, FrameFate};
//! use ecmsk::slave::{Drive, DriveConfig};
//!
//! /// A wire to simulated slaves, from which every frame comes back at once.
//! struct Slaves {
//!     chain: Chain,
//!     now: Ns,
//!     back: Vec<Vec<u8>>,
//! }
//!
//! impl Wire for Slaves {
//!     fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
//!         let mut frame = frame.to_vec();
//!         if let FrameFate::Returned(_) = self.chain.process(&mut frame, self.now) {
//!             self.back.insert(0, frame);
//!         }
//!         Ok(())
//!     }
//!
//!     fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
//!         let frame = self.back.pop()?;
//!         buffer[..frame.len()].copy_from_slice(&frame);
//!         Some(frame.len())
//!     }
//! }
//!
//! /// Polls each 50 us, with a cycle each millisecond if there are some, until something has ended.
//! fn wait<T: Ending>(master: &mut Master, wire: &mut Slaves, job: Job<T>, cyclic: bool) -> T {
//!     loop {
//!         wire.now += 50_000;
//!         if cyclic && wire.now % 1_000_000 == 0 {
//!             master.cycle(wire.now, wire);
//!         }
//!         master.poll(wire.now, wire);
//!         if let Some(end) = master.take(job) {
//!             return end;
//!         }
//!     }
//! }
//!
//! let drive = Box::new(Drive::new(DriveConfig::default()));
//! let slave = EscSlave::describe(drive, EscSettings::default(), 0).expect("a drive can be described");
//! let mut wire = Slaves { chain: Chain::line([slave]), now: 0, back: Vec::new() };
//! let mut master = Master::new(Settings::default());
//!
//! let scan = master.scan();
//! assert_eq!(wait(&mut master, &mut wire, scan, false), Ok(1));
//! let all = SlaveSet::first(1);
//! master.configure_as_described(1).expect("the EEPROM says which process data there are");
//! let change = master.request_state(all, AlState::SafeOp, 2_000_000_000);
//! assert_eq!(wait(&mut master, &mut wire, change, false), Ok(()));
//! let change = master.request_state(all, AlState::Op, 2_000_000_000);
//! assert_eq!(wait(&mut master, &mut wire, change, true), Ok(()));
//!
//! // Controlword 0x0006, whatever the target: the drive is ready to switch on.
//! master.outputs_mut(1).expect("a slave")[0] = 6;
//! for _ in 0..100 {
//!     wire.now += 1_000_000;
//!     master.cycle(wire.now, &mut wire);
//!     master.poll(wire.now, &mut wire);
//!     let cycle = master.take_cycle().expect("its frames are back");
//!     assert_eq!((cycle.working_counter, cycle.expected_working_counter), (3, 3));
//! }
//! assert_eq!(master.inputs(1).expect("a slave")[0] & 0x6F, 0x21);
//! # }
//! ```
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | the [`Master`]: polls and cycles |
//! | `jobs.rs`, `handle.rs` | the jobs that a user can start, their handles and the types of their results |
//! | `configure.rs` | the configuration of process data and clocks |
//! | `place.rs` | preallocated slots for sequences |
//! | `settings.rs`, `wire.rs` | [`Settings`], [`Wire`] |
//! | `exchange.rs` | the frame layer: indices, matching of answers, lost and late frames |
//! | `bus.rs` | the operations from which sequences of datagrams are written |
//! | `shared.rs` | the state that sequences, the cycle and the user share; events |
//! | `cycle_end.rs` | what the working counters of a cycle show about the slaves |
//! | `scan.rs`, `info.rs`, `sii.rs`, `sii_error.rs` | finding and identifying slaves, their EEPROMs |
//! | `states.rs`, `state_error.rs`, `watchdog.rs` | changes of the AL state; the watchdog that ends OP without a master |
//! | `mailbox/` | mailbox messages, none lost and none executed twice |
//! | `mailbox/coe/`, `mailbox/foe.rs` | a mailbox protocol each, with its jobs: SDO transfers and SDO information, files |
//! | `registers.rs` | single datagrams of a user, registers of a slave |
//! | `topology.rs` | the tree of the cables |
//! | `clock_tree.rs`, `clocks.rs`, `pace.rs` | distributed clocks: delays, setting them, cycles in phase with them |
//! | `process_data.rs`, `process_data/slave.rs` | logical addresses of process data, frames of a cycle; the part of one slave |
//! | `process_data/expected.rs` | the right working counters |
//! | `lost_slaves.rs` | the watch: missing slaves, returned slaves, unsolicited messages |
//! | `acyclic.rs` | when the datagrams of jobs, mailboxes and the watch are sent: after the frames of a cycle |

mod acyclic;
mod bus;
mod clock_tree;
mod clocks;
mod configure;
mod cycle_end;
mod exchange;
mod handle;
mod info;
mod jobs;
mod lost_slaves;
mod mailbox;
mod pace;
pub(crate) mod place;
mod process_data;
mod registers;
mod scan;
mod settings;
mod shared;
mod sii;
mod sii_error;
mod state_error;
mod states;
mod topology;
pub(crate) mod watchdog;
mod wire;

use std::collections::VecDeque;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

pub use clock_tree::{ReferenceClock, SyncSignals};
pub use exchange::FrameCounters;
pub use handle::{Ending, Job, JobId};
pub use info::{MAILBOX_BYTES_MAX, MAILBOX_BYTES_MIN, MailboxInfo, ProcessManager, SlaveInfo};
pub use mailbox::*;
pub use pace::Pace;
pub use process_data::{ConfigureError, CycleDone, SEGMENT_BYTES_MAX};
pub use registers::{DatagramAnswer, DatagramError};
pub use scan::ScanError;
pub use settings::Settings;
pub use shared::{EVENTS_MAX, Event, SlaveStatus};
pub use sii_error::SiiError;
pub use state_error::{StateError, StateReason};
pub use topology::{Upstream, upstreams};
pub use wire::{FrameBuffer, Wire, WireDown};

use crate::ethercat::{FRAME_LEN_MAX, Ns, SlaveSet};
use bus::{Bus, Task};
use cycle_end::judge;
use handle::End;
use jobs::{JOBS, Places, Running};
use process_data::ProcessData;
use shared::Shared;

/// \[OURS] The most frames that one poll receives, so that a flood of frames cannot hold it up.
const RECEIVED_MAX: usize = 256;

/// The master. The documentation of this module says which calls it needs, and when.
pub struct Master {
    bus: Bus,
    jobs: Vec<Running>,
    places: Places,
    next_job: u64,
    done: VecDeque<(JobId, End)>,
    slaves: Vec<SlaveInfo>,
    process: ProcessData,
    /// The future of the watch over the slaves that a scan has found (`lost_slaves.rs`).
    watch: Option<Task<()>>,
    buffer: Box<FrameBuffer>,
}

impl Master {
    /// A master that knows no slaves yet.
    pub fn new(settings: Settings) -> Self {
        Self {
            bus: Bus(Arc::new(Mutex::new(Shared::new(settings)))),
            jobs: Vec::with_capacity(JOBS),
            places: Places::default(),
            next_job: 0,
            done: VecDeque::with_capacity(JOBS),
            slaves: Vec::new(),
            process: ProcessData::default(),
            watch: None,
            buffer: Box::new([0; FRAME_LEN_MAX]),
        }
    }

    /// Receives frames, continues all jobs as far as the answers allow, and sends the frames that they need.
    pub fn poll(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        self.receive(now, wire);
        self.run();
        self.bus.with(|shared| shared.send_acyclic_without_cycles(now, wire));
    }

    fn receive(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        let Self { bus, process, buffer, .. } = self;
        bus.with(|shared| {
            shared.now = shared.now.max(now);
            for _ in 0..RECEIVED_MAX {
                let was_awaited = shared.exchange.is_flying();
                let Some(len) = wire.receive(buffer) else { break };
                let bytes = &buffer[..len.min(buffer.len())];
                shared.exchange.receive(bytes, |number, datagram| process.receive(number, datagram));
                // The last answer has come. Any further frame is no answer, and the next call receives it.
                if was_awaited && !shared.exchange.is_flying() {
                    break;
                }
            }
            shared.exchange.expire(now);
            let until = process.sent_at().saturating_add(shared.settings.frame_timeout_ns);
            if process.is_whole() || now >= until {
                judge(process, shared);
            }
        });
    }

    /// Continues the watch and all running jobs.
    fn run(&mut self) {
        let mut context = Context::from_waker(Waker::noop());
        if let Some(watch) = &mut self.watch {
            // The watch never ends, so polling it gives no result.
            let _ = watch.as_mut().poll(&mut context);
        }
        let mut n = 0;
        while let Some(Running { id, work }) = self.jobs.get_mut(n) {
            let id = *id;
            match work.poll(&self.bus, &mut context) {
                Poll::Pending => n += 1,
                Poll::Ready(output) => {
                    self.places.take_back(self.jobs.remove(n).work);
                    let done = self.end(output);
                    self.done.push_back((id, done));
                }
            }
        }
    }

    /// Sends the frames of a cycle, and one frame with acyclic datagrams. Ends the previous cycle, with those of its
    /// frames that have come back.
    pub fn cycle(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        // Without a frame in flight there is no answer to receive, and other frames can wait for the next poll. That
        // saves a system call for each cycle on a network card.
        let is_awaited = self.bus.with(|shared| {
            shared.now = shared.now.max(now);
            shared.exchange.is_flying()
        });
        if is_awaited {
            self.receive(now, wire);
        }
        let Self { bus, process, .. } = self;
        bus.with(|shared| {
            shared.last_cycle = Some(shared.now);
            shared.exchange.expire_cyclic(now);
            judge(process, shared);
            let (clock, standing) = (shared.clock_datagram(), shared.standing());
            process.send(now, standing, clock, &mut shared.exchange, wire);
            shared.send_acyclic_behind_cycle(now, wire);
        });
    }

    /// The cycle that has ended last; each is returned once. A cycle ends when all its frames have come back, when they
    /// are given up, or when the next one begins.
    pub const fn take_cycle(&mut self) -> Option<CycleDone> {
        self.process.take_done()
    }

    /// Whether frames of the cycle are still in flight.
    pub const fn is_cycle_open(&self) -> bool {
        self.process.is_open()
    }

    /// Takes the oldest event; `None`: there is no event.
    pub fn take_event(&mut self) -> Option<Event> {
        self.bus.with(|shared| shared.events.pop_front())
    }

    /// The counters of all frames so far.
    pub fn counters(&self) -> FrameCounters {
        self.bus.with(|shared| shared.exchange.counters)
    }

    /// The source address, as slaves have changed it, of frames from another master or from a device that sends
    /// EtherCAT frames by mistake. `None`: there were no such frames.
    pub fn other_master(&self) -> Option<[u8; 6]> {
        self.bus.with(|shared| shared.exchange.other_source)
    }

    /// The slaves that the last scan has found.
    pub fn slaves(&self) -> &[SlaveInfo] {
        &self.slaves
    }

    /// A slave that the last scan has found, from 1; `None`: there is none with that number.
    pub fn slave(&self, slave: u8) -> Option<&SlaveInfo> {
        self.slaves.get(usize::from(slave).checked_sub(1)?)
    }

    /// The present condition of a slave, from 1; `None`: there is none with that number.
    pub fn status(&self, slave: u8) -> Option<SlaveStatus> {
        self.bus.with(|shared| shared.live_mut(slave).map(|live| live.status))
    }

    /// Calls `look` with the present condition of each slave that the last scan has found, in the order of their numbers.
    pub fn look_at_statuses(&self, mut look: impl FnMut(u8, &SlaveStatus)) {
        self.bus.with(|shared| (1..).zip(&shared.live).for_each(|(slave, live)| look(slave, &live.status)));
    }

    /// When the newest check of all AL states began in which every slave has answered or was found to be missing;
    /// `None`: there was none yet. The master checks them when cycles have a wrong working counter, and every
    /// [`Settings::watch_ns`] while not all slaves are in OP.
    pub fn states_read(&self) -> Option<Ns> {
        self.bus.with(|shared| shared.states_read)
    }

    /// When the newest complete search for missing slaves began; `None`: there was none yet. A search reads the AL
    /// states of all slaves and, if these do not explain a wrong working counter, the inputs of the slaves whose
    /// datagram had it. A slave that does not answer the read of its state is missing.
    pub fn searched(&self) -> Option<Ns> {
        self.bus.with(|shared| shared.searched)
    }

    /// The slaves that answer, in SafeOP or OP, but whose inputs do not come, as far as known. The inputs of other
    /// slaves in the same datagram are still taken.
    pub fn mute(&self) -> SlaveSet {
        self.bus.with(|shared| shared.mute)
    }

    /// What these slaves add to the expected working counter of a cycle; only those that are in SafeOP or OP as far as
    /// known.
    pub fn working_counter_of(&self, slaves: SlaveSet) -> u16 {
        if slaves.is_empty() {
            return 0;
        }
        self.process.expected(slaves.intersection(self.bus.with(|shared| shared.active)))
    }

    /// The slave with the reference clock, from 1: the first one with distributed clocks that answers; `None`: there is
    /// none.
    pub fn reference_clock(&self) -> Option<u8> {
        self.bus.with(|shared| shared.clocks.reference(shared.missing))
    }

    /// The slaves that are known not to answer. This is known about one cycle after the cycle with the wrong working
    /// counter.
    pub fn missing(&self) -> SlaveSet {
        self.bus.with(|shared| shared.missing)
    }
}
