//! A small EtherCAT master in software, for networks of up to [`MAX_SLAVES`](crate::ethercat::MAX_SLAVES) slaves.
//!
//! It is pure and polled: it knows no clock, no thread and no network card. Time is an argument, in nanoseconds of one clock
//! that never goes back; frames go out and come in by a [`Wire`]. The same frames at the same times always give the same
//! steps.
//!
//! A cycle allocates nothing. Nor does what a running program causes, once slaves were found: changes of state
//! ([`Master::request_state`]), transfers of up to 4 bytes ([`Master::download`], [`Master::upload_number`]), slaves that are lost and
//! come back, and emergencies. Other jobs allocate when they begin.
//!
//! # Who calls what when
//!
//! - [`Master::poll`] as often as the user likes, say each 50 us: it takes the frames that have come, goes on with what is
//!   under way, and sends what that needs.
//! - What takes more than a frame is started and gives a [`Job`]: [`Master::scan`], [`Master::request_state`],
//!   [`Master::upload`], [`Master::download`], [`Master::object_list`], [`Master::read_file`], [`Master::write_eeprom`], [`Master::datagram`] and others.
//!   [`Master::take`] tells how it has ended; everything ends. Several may run at once: SDOs to several slaves, changes
//!   of state of several sets of slaves, both beside cycles.
//! - [`Master::configure`] in PreOP, once a slave's process data are mapped.
//! - [`Master::cycle`] once a cycle, from SafeOP on: it sends the process data. When its frames have come back,
//!   [`Master::take_cycle`] says so, with the working counters. Outputs are set at any time before by
//!   [`Master::outputs_mut`], inputs read behind by [`Master::inputs`]. On its way to OP a slave waits for outputs.
//! - With distributed clocks: [`Master::set_sync`] before a slave's way to SafeOP, [`Master::set_pace`] once;
//!   [`CycleDone::next_deadline`] then says when the next cycle should be.
//!   [`CycleDone::fresh`] says whose inputs are those of that cycle: with a working counter that is wrong they stay as they were.
//! - [`Master::take_event`] tells what happens unasked: emergencies, lost slaves and such that come back, states that were left.
//!   [`Master::missing`] says who does not answer now. A slave that was cut off is brought back by [`Master::request_state`];
//!   one that was without power ([`Event::PowerCycled`]) has to be mapped by SDO before that, as at the start.
//!
//! While there are cycles, what is under way shares one frame behind those of each cycle; otherwise it goes as fast as answers
//! come back.
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
//! | `mod.rs` | the [`Master`]: its turns |
//! | `jobs.rs`, `handle.rs`, `configure.rs` | what a user starts, and the types of its ends; process data of slaves |
//! | `place.rs` | where sequences run that allocate nothing |
//! | `settings.rs`, `wire.rs` | [`Settings`], [`Wire`] |
//! | `exchange.rs` | the frame layer: indices, what belongs to which frame, lost and late frames |
//! | `bus.rs` | what sequences of datagrams are written with |
//! | `shared.rs` | what sequences, the cycle and the user share; events |
//! | `cycle_end.rs` | what the end of a cycle tells of the slaves |
//! | `scan.rs`, `info.rs`, `sii.rs`, `sii_error.rs` | finding slaves, what is known of them, their EEPROMs |
//! | `states.rs`, `state_error.rs`, `watchdog.rs` | changes of the AL state; the watchdog that ends OP when the master is gone |
//! | `mailbox.rs`, `mailbox_state.rs` | messages to slaves, without loss and without a second time |
//! | `sdo.rs`, `information.rs`, `foe.rs` | SDO transfers, SDO information, files |
//! | `registers.rs` | single datagrams of a user, registers of a slave |
//! | `topology.rs`, `clock_tree.rs`, `clocks.rs`, `pace.rs` | the tree of the cables; distributed clocks, what is known of them and setting them; cycles that keep step with them |
//! | `process_data.rs`, `process_data/slave.rs` | where outputs and inputs lie, the frames of a cycle; what of that is one slave's |
//! | `process_data/expected.rs` | which working counters are right |
//! | `watch.rs` | who is missing, who is back, whose mailbox has something to say |

mod bus;
mod clock_tree;
mod clocks;
mod configure;
mod cycle_end;
mod exchange;
mod foe;
mod handle;
mod info;
mod information;
mod jobs;
mod mailbox;
mod mailbox_state;
mod pace;
pub(crate) mod place;
mod process_data;
mod registers;
mod scan;
mod sdo;
mod settings;
mod shared;
mod sii;
mod sii_error;
mod state_error;
mod states;
mod topology;
mod watch;
mod watchdog;
mod wire;

use std::collections::VecDeque;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

pub use clock_tree::{ReferenceClock, SyncSignals};
pub use exchange::FrameCounters;
pub use foe::FileError;
pub use handle::{Ending, Job, JobId};
pub use info::{MAILBOX_BYTES_MAX, MAILBOX_BYTES_MIN, MailboxInfo, ProcessManager, SlaveInfo};
pub use mailbox::MailboxError;
pub use pace::Pace;
pub use process_data::{ConfigureError, CycleDone, SEGMENT_BYTES_MAX};
pub use registers::{DatagramAnswer, DatagramError};
pub use scan::ScanError;
pub use sdo::{SdoError, VALUE_BYTES_MAX};
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

/// \[OURS] How many frames are received in one poll at most, so that a flood of them ends.
const RECEIVED_MAX: usize = 256;

/// The master. The page of this module says who calls what when.
pub struct Master {
    bus: Bus,
    jobs: Vec<Running>,
    places: Places,
    next_job: u64,
    done: VecDeque<(JobId, End)>,
    slaves: Vec<SlaveInfo>,
    process: ProcessData,
    /// The watch over the slaves that were found.
    watch: Option<Task<()>>,
    buffer: Box<FrameBuffer>,
}

impl Master {
    /// A master that knows of no slaves yet.
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

    /// Takes what has come, goes on with what is under way, and sends what that needs.
    pub fn poll(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        self.receive(now, wire);
        self.run();
        self.send_acyclic(now, wire);
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
                // That was the last answer. What else may have come is none, and is taken the next time.
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

    /// Goes on with all sequences.
    fn run(&mut self) {
        let mut context = Context::from_waker(Waker::noop());
        if let Some(watch) = &mut self.watch {
            // It never ends.
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

    /// Sends datagrams beside the cycle: as fast as answers come, or behind the frames of a cycle while there are cycles.
    fn send_acyclic(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        self.bus.with(|shared| while !shared.has_cycles() && shared.exchange.send_queued(now, FRAME_LEN_MAX, wire) {});
    }

    /// Sends the frames of a cycle, and one frame beside them. The cycle before has ended then, with those of its frames that have
    /// come back.
    pub fn cycle(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        // Without a frame on the way what may have come is no answer, and is taken before the next one: each look at a card is a call
        // of the system.
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
            if !shared.exchange.is_acyclic_flying() {
                shared.exchange.send_queued(now, shared.settings.acyclic_bytes_max, wire);
            }
        });
    }

    /// The cycle that has ended last, once. A cycle ends when all its frames have come back, when they are given up, or with the
    /// next one.
    pub const fn take_cycle(&mut self) -> Option<CycleDone> {
        self.process.take_done()
    }

    /// Whether frames of the cycle are still on the way.
    pub const fn is_cycle_open(&self) -> bool {
        self.process.is_open()
    }

    /// The next event.
    pub fn take_event(&mut self) -> Option<Event> {
        self.bus.with(|shared| shared.events.pop_front())
    }

    /// What became of its frames.
    pub fn counters(&self) -> FrameCounters {
        self.bus.with(|shared| shared.exchange.counters)
    }

    /// The source address of another master on the wire, or of something that sends frames of EtherCAT by mistake, as slaves have
    /// changed it; `None`: there has been none.
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

    /// When the AL status of all slaves was asked for last, if all have answered or are known to be gone; `None`: not yet. It is while
    /// cycles have too few answers, and each [`Settings::watch_ns`] while not all slaves are in OP.
    pub fn states_read(&self) -> Option<Ns> {
        self.bus.with(|shared| shared.states_read)
    }

    /// When it was asked last who is missing, if all of that was answered: for the AL status of all slaves, and where that did not tell
    /// why a working counter is wrong for the inputs of each; `None`: not yet. What a slave has not answered by then it does not answer.
    pub fn searched(&self) -> Option<Ns> {
        self.bus.with(|shared| shared.searched)
    }

    /// The slaves that answer and are in SafeOP or OP, and whose inputs do not come, as far as it is known. Others that share a
    /// datagram with them are read all the same.
    pub fn mute(&self) -> SlaveSet {
        self.bus.with(|shared| shared.mute)
    }

    /// What these slaves add to the expected working counter of a cycle, as far as they are in SafeOP or OP for all that is known.
    pub fn working_counter_of(&self, slaves: SlaveSet) -> u16 {
        if slaves.is_empty() {
            return 0;
        }
        self.process.expected(slaves.intersection(self.bus.with(|shared| shared.active)))
    }

    /// The slave with the reference clock, from 1: the first one with distributed clocks that answers; `None`: there is none.
    pub fn reference_clock(&self) -> Option<u8> {
        self.bus.with(|shared| shared.clocks.reference(shared.missing))
    }

    /// The slaves that do not answer, as far as it is known: a cycle after the one that was short.
    pub fn missing(&self) -> SlaveSet {
        self.bus.with(|shared| shared.missing)
    }
}
