//! The master with a wire to a chain of slaves, in virtual time.

use allocation_counter::opt_out;
use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::Features;
use ecmsk::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
use ecmsk::fieldbus::Role;
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::master::{
    CycleDone, Ending, FrameBuffer, Job, JobId, Master, SdoError, Settings, StateError, SyncSignals, Wire, WireDown,
};
use ecmsk::sk::DriveSync;
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, FrameFate};
use ecmsk::slave::{Channels, Dp3cl, Dp3clConfig, Drive, DriveConfig, Hsp, HspConfig, Io, Slave};
use support::dice::Dice;

pub const US: Ns = 1_000;
pub const MS: Ns = 1_000_000;
pub const SECOND: Ns = 1_000_000_000;
/// The cycle of process data.
pub const CYCLE: Ns = MS;
/// How often the master is polled.
pub const STEP: Ns = 50 * US;

/// The number of preallocated frame buffers: as many as the master has under way.
const FRAMES: usize = 32;

/// A wire to a chain of slaves.
pub struct Net {
    pub chain: Chain,
    pub now: Ns,
    /// Frames on their way back, with their times of arrival, in that order.
    back: Vec<(Ns, Vec<u8>)>,
    pub faults: Faults,
    /// A function that changes each frame on its way back, for hostile slaves.
    pub hostile: Option<Hostile>,
    /// A function that is called with each frame as the master has sent it.
    pub heard: Option<Heard>,
    /// Buffers of frames that have come back, to be used again.
    spare: Vec<Vec<u8>>,
}

/// A function that changes frames on their way back.
pub type Hostile = Box<dyn FnMut(&mut Vec<u8>)>;

/// A listener at the first slave.
pub type Heard = Box<dyn FnMut(&[u8])>;

/// The faults of frames: one in that many, 0: none.
pub struct Faults {
    pub dice: Dice,
    /// A frame reaches no slave.
    pub lost_out: u64,
    /// A frame is lost on its way back.
    pub lost_back: u64,
    /// A frame comes back once more, up to 10 ms later.
    pub doubled: u64,
    /// A frame comes back up to 10 ms later.
    pub late: u64,
}

impl Faults {
    pub const NONE: Self = Self { dice: Dice(0), lost_out: 0, lost_back: 0, doubled: 0, late: 0 };

    /// Each kind, one in that many.
    pub fn all(seed: u64, one_in: u64) -> Self {
        Self { dice: Dice(seed), lost_out: one_in, lost_back: one_in, doubled: one_in, late: one_in }
    }

    fn hits(&mut self, one_in: u64) -> bool {
        one_in > 0 && self.dice.one_in(one_in)
    }
}

impl Net {
    fn arrive(&mut self, at: Ns, frame: Vec<u8>) {
        let place = self.back.partition_point(|(other, _)| *other <= at);
        self.back.insert(place, (at, frame));
    }
}

impl Wire for Net {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        if let Some(heard) = &mut self.heard {
            heard(frame);
        }
        let mut bytes = self.spare.pop().unwrap_or_else(|| Vec::with_capacity(1514));
        bytes.clear();
        bytes.extend_from_slice(frame);
        let mut frame = bytes;
        if self.faults.hits(self.faults.lost_out) {
            self.spare.push(frame);
            return Ok(());
        }
        // Allocations of the slaves do not count as the master's.
        let mut fate = FrameFate::Lost;
        opt_out(|| fate = self.chain.process(&mut frame, self.now));
        let FrameFate::Returned(mut at) = fate else {
            self.spare.push(frame);
            return Ok(());
        };
        if let Some(hostile) = &mut self.hostile {
            hostile(&mut frame);
        }
        if self.faults.hits(self.faults.lost_back) {
            self.spare.push(frame);
            return Ok(());
        }
        if self.faults.hits(self.faults.late) {
            at += self.faults.dice.below(10 * MS);
        }
        if self.faults.hits(self.faults.doubled) {
            let again = at + self.faults.dice.below(10 * MS);
            self.arrive(again, frame.clone());
        }
        self.arrive(at, frame);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        self.back.first().filter(|(at, _)| *at <= self.now)?;
        let (_, frame) = self.back.remove(0);
        let len = frame.len().min(buffer.len());
        buffer[..len].copy_from_slice(&frame[..len]);
        self.spare.push(frame);
        Some(len)
    }
}

pub struct Rig {
    pub master: Master,
    pub net: Net,
    /// When the next cycle is; `None`: there are no cycles.
    pub next_cycle: Option<Ns>,
    pub last: CycleDone,
}

/// The kinds of slaves, by the names that links give them.
pub fn device(kind: &str) -> Box<dyn Slave> {
    match kind {
        "drive" => Box::new(Drive::new(DriveConfig::default())),
        "step" => Box::new(Drive::new(DriveConfig::stepper())),
        "dp3cl" => Box::new(Dp3cl::new(Dp3clConfig::default())),
        "hsp" => Box::new(Hsp::new(HspConfig { channels: Channels::One, ..HspConfig::default() })),
        "hsp2" => Box::new(Hsp::new(HspConfig { channels: Channels::Two, ..HspConfig::default() })),
        "io" => Box::<Io>::default(),
        kind => panic!("no kind of slave: {kind}"),
    }
}

/// The board's mapping for a kind.
pub fn process_data(kind: &str) -> ProcessData {
    let role = match kind {
        "drive" => Role::Drive(Mode::Csp),
        "step" | "dp3cl" => Role::Step(Mode::Csp),
        "hsp" | "hsp2" => Role::Hsp(Mode::Csp),
        _ => Role::Io,
    };
    ProcessData::of(role, kind == "hsp2").expect("the board has process data for it")
}

pub fn slave(kind: &str, settings: EscSettings) -> EscSlave {
    EscSlave::describe(device(kind), settings, 0).expect("it can be described")
}

/// A master may be moved to another thread.
const fn is_send<T: Send>() {}
const _: () = is_send::<Master>();

impl Rig {
    pub fn of(chain: Chain) -> Self {
        let spare = (0..FRAMES).map(|_| Vec::with_capacity(1514)).collect();
        let back = Vec::with_capacity(FRAMES);
        let net = Net { chain, now: MS, back, faults: Faults::NONE, hostile: None, heard: None, spare };
        let master = Master::new(Settings::default());
        Self { master, net, next_cycle: None, last: CycleDone::default() }
    }

    /// Slaves of these kinds in a line.
    pub fn line(kinds: &[&str]) -> Self {
        Self::of(Chain::line(kinds.iter().map(|kind| slave(kind, EscSettings::default()))))
    }

    /// Slaves of these kinds in a line, which were found.
    pub fn scanned(kinds: &[&str]) -> Self {
        let mut rig = Self::line(kinds);
        assert_eq!(rig.scan(), kinds.len());
        rig
    }

    /// Lets time pass by one step.
    pub fn step(&mut self) {
        self.net.now += STEP;
        let now = self.net.now;
        opt_out(|| self.net.chain.advance(now));
        if self.next_cycle.is_some_and(|next| now >= next) {
            self.next_cycle = Some(now + CYCLE);
            self.master.cycle(now, &mut self.net);
        }
        self.master.poll(now, &mut self.net);
        if let Some(done) = self.master.take_cycle() {
            self.last = done;
        }
    }

    pub fn run_for(&mut self, ns: Ns) {
        let until = self.net.now + ns;
        while self.net.now < until {
            self.step();
        }
    }

    /// Waits for a job.
    #[track_caller]
    pub fn wait<T: Ending>(&mut self, job: Job<T>) -> T {
        self.wait_until_ended(job.id());
        self.master.take(job).expect("it has ended")
    }

    /// Waits for a job, however it ends.
    #[track_caller]
    pub fn wait_for_end(&mut self, id: JobId) {
        self.wait_until_ended(id);
        self.master.cancel(id);
    }

    #[track_caller]
    fn wait_until_ended(&mut self, id: JobId) {
        let until = self.net.now + 60 * SECOND;
        while self.net.now < until {
            self.step();
            if let Some(ended) = self.master.ended().next() {
                assert_eq!(ended, id, "another one has ended");
                return;
            }
        }
        panic!("a job does not end");
    }

    #[track_caller]
    pub fn scan(&mut self) -> usize {
        let id = self.master.scan();
        self.wait(id).expect("slaves").into()
    }

    pub fn all(&self) -> SlaveSet {
        SlaveSet::first(self.master.slaves().len() as u8)
    }

    #[track_caller]
    pub fn request(&mut self, slaves: SlaveSet, target: AlState) -> Result<(), StateError> {
        let id = self.master.request_state(slaves, target, 10 * SECOND);
        self.wait(id)
    }

    #[track_caller]
    pub fn reach(&mut self, target: AlState) {
        assert_eq!(self.request(self.all(), target), Ok(()));
    }

    #[track_caller]
    pub fn upload(&mut self, slave: u8, index: u16, sub: u8) -> Result<Vec<u8>, SdoError> {
        let id = self.master.upload(slave, ObjectAddress::new(index, sub), SdoScope::Entry, SECOND);
        self.wait(id)
    }

    #[track_caller]
    pub fn download(&mut self, slave: u8, index: u16, sub: u8, value: &[u8]) -> Result<(), SdoError> {
        let id = self.master.download(slave, ObjectAddress::new(index, sub), SdoScope::Entry, value, SECOND);
        self.wait(id)
    }

    /// Maps a slave in PreOP as the board maps its kind.
    #[track_caller]
    pub fn map(&mut self, slave: u8, kind: &str, sync: DriveSync) {
        let data = process_data(kind);
        for download in data.downloads(sync) {
            let value = &download.value.to_le_bytes()[..usize::from(download.size.bytes())];
            let ended = self.download(slave, download.object.index, download.object.sub, value);
            assert!(
                ended.is_ok() || download.may_fail_with(ended.unwrap_err().abort_code()),
                "{download:?}: {ended:?}"
            );
        }
        let clock = self.master.slaves()[usize::from(slave) - 1].features.contains(Features::CLOCK);
        let sync = (clock && sync == DriveSync::DcSync).then_some(SyncSignals::sync0(CYCLE as u32, 0));
        self.master.set_sync(slave, sync).expect("it was found");
        let configured = self.master.configure(slave, data.output_bytes() as u16, data.input_bytes() as u16);
        configured.expect("its process data can be configured");
    }

    /// Slaves of these kinds in OP, with the board's mapping.
    #[track_caller]
    pub fn in_op(kinds: &[&str]) -> Self {
        let mut rig = Self::scanned(kinds);
        rig.bring_to_op(kinds);
        rig
    }

    #[track_caller]
    pub fn bring_to_op(&mut self, kinds: &[&str]) {
        self.bring_to_op_with(kinds, DriveSync::FreeRun);
    }

    #[track_caller]
    pub fn bring_to_op_with(&mut self, kinds: &[&str], sync: DriveSync) {
        self.reach(AlState::PreOp);
        for (slave, kind) in (1..).zip(kinds) {
            self.map(slave, kind, sync);
        }
        self.reach(AlState::SafeOp);
        self.next_cycle = Some(self.net.now);
        self.reach(AlState::Op);
        self.run_for(3 * CYCLE);
    }
}

/// So many kinds, in turns.
pub fn kinds(count: usize) -> Vec<&'static str> {
    assert!(count <= MAX_SLAVES);
    ["drive", "io", "step", "dp3cl", "hsp", "hsp2"].into_iter().cycle().take(count).collect()
}
