//! Forty drives in CSP, enabled and moving: behind the model of the chip, and on the simulated bus. Both map what the board
//! maps for such a drive.

use std::hint::black_box;

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::AlState;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AxisOut, BusConfig, Fieldbus, Inputs, Job, JobDone, Outputs, Role, SlaveConfig, SlaveSet};
use ecmsk::sk::{CycleTime, DriveSync};
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{Chip, Controllers, Profile, SlaveModels, SlaveNetwork};
use ecmsk::xf::request::{
    CrcTypeSet, DcTiming, EcatInit, Encode, FifoEnable, FifoSetRxCount, FifoSetTxCount, InfoUpdate, MappedObject,
    PdoAssignment, PdoConfigSet, PdoDataFifo, PdoMap, PdoOperation, Reconfig, ReferenceClock, SdoOperation, SdoRequest,
    SlaveNumber, Slaves, StateSet,
};
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandHeader, CrcCoverage, DataSize, Errors, EtherCatState,
    MAX_PACKET, Received, Status, write_request,
};

const DRIVES: usize = 40;
const CYCLE_NS: u64 = 1_000_000;
/// Bytes of an axis: controlword and target; statusword, position, torque and error code.
const OUT_BYTES: usize = 6;
const IN_BYTES: usize = 10;
const OUTPUTS: [(u16, u8); 2] = [(0x6040, 16), (0x607A, 32)];
const INPUTS: [(u16, u8); 4] = [(0x6041, 16), (0x6064, 32), (0x6077, 16), (0x603F, 16)];
/// Counts in a cycle, and the cycles after which the axes turn back.
const STEP: i32 = 20;
const STROKE: i32 = 1000;
/// The way of a drive to Operation enabled, and how long each step of it lasts, in cycles.
const CONTROLWORDS: [u16; 3] = [0x06, 0x07, 0x0F];
const SWITCHING: u32 = 500;
/// Bits of the statusword that tell the state, and "Operation enabled" in them.
const STATE_BITS: u16 = 0x6F;
const ENABLED: u16 = 0x27;

fn drives() -> Vec<Box<dyn Slave>> {
    (0..DRIVES).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect()
}

/// What all axes are told: a target that goes to and fro.
struct Path {
    controlword: u16,
    target: i32,
    n: i32,
}

impl Path {
    const fn new() -> Self {
        Self { controlword: 0, target: 0, n: 0 }
    }

    fn advance(&mut self) {
        self.target += if self.n % (2 * STROKE) < STROKE { STEP } else { -STEP };
        self.n += 1;
    }
}

/// The chip, each of whose exchanges is a cycle behind the one before.
pub struct ChipWithDrives<N> {
    chip: Chip<N>,
    now: u64,
    index: u8,
    rule: CheckRule,
    path: Path,
    command: [u8; MAX_PACKET],
    answer: [u8; MAX_PACKET],
    cycles: u64,
}

/// The drives as models.
pub fn models() -> SlaveModels {
    SlaveModels::new(drives())
}

/// The drives behind controllers.
pub fn controllers() -> Controllers {
    Controllers::new(drives(), SimHandle::default()).expect("drives can be described")
}

impl<N: SlaveNetwork> ChipWithDrives<N> {
    /// Drives that are enabled, as an application does it.
    pub fn in_op(network: N) -> Self {
        let size = DataSize::new(DRIVES * IN_BYTES).expect("a size");
        let chip = Chip::new(Profile { size, ..Profile::NEW }, network);
        let (command, answer) = ([0; MAX_PACKET], [0; MAX_PACKET]);
        let (now, rule, path) = (1_000 * CYCLE_NS, CheckRule::FIXED, Path::new());
        let mut this = Self { chip, now, index: 0, rule, path, command, answer, cycles: 0 };
        this.send(&CrcTypeSet { kind: CheckType::Crc32 });
        this.rule = CheckRule::CRC32;
        this.configure();
        this.run(&StateSet { slaves: Slaves::All, state: EtherCatState::SafeOp });
        this.run(&StateSet { slaves: Slaves::All, state: EtherCatState::Op });
        this.run(&FifoEnable { on: true });
        for controlword in CONTROLWORDS {
            this.path.controlword = controlword;
            (0..SWITCHING).for_each(|_| this.exchange());
        }
        this.cycles = 0;
        this
    }

    fn configure(&mut self) {
        let dc = DcTiming { assign_activate: 0x0300, sync0_ns: CYCLE_NS as u32, sync1_ns: 0, shift_ns: 0 };
        let reference_clock = ReferenceClock::FirstSlave;
        self.run(&EcatInit { special_slaves: false, reference_clock, lrw: true, fifo_on: false, dc });
        self.run(&StateSet { slaves: Slaves::All, state: EtherCatState::PreOp });
        for slave in (0..DRIVES as u8).filter_map(SlaveNumber::new) {
            let object = ObjectAddress::new(0x6060, 0);
            let operation = SdoOperation::Write(&[8]);
            self.run(&SdoRequest { slave, object, scope: SdoScope::Entry, timeout_us: 100_000, operation });
            self.map(slave, PdoAssignment::Rx, 0x1600, &OUTPUTS);
            self.map(slave, PdoAssignment::Tx, 0x1A00, &INPUTS);
        }
        // As many as the memory of the FIFOs has room for.
        self.run(&FifoSetRxCount { entries: 16 });
        self.run(&FifoSetTxCount { entries: 16 });
        self.run(&Reconfig);
    }

    fn map(&mut self, slave: SlaveNumber, assignment: PdoAssignment, index: u16, objects: &[(u16, u8)]) {
        let mapped = |&(index, bits): &(u16, u8)| MappedObject::new(ObjectAddress::new(index, 0), bits);
        let objects: Vec<_> = objects.iter().map(mapped).collect();
        let maps = [PdoMap::new(index, &objects).expect("at most 8")];
        self.run(&PdoConfigSet::new(slave, assignment, &maps).expect("one PDO"));
    }

    fn send(&mut self, request: &impl Encode) {
        self.index = self.index.wrapping_add(1);
        let (size, header) = (self.chip.size(), CommandHeader::with_index(self.index));
        let packet = write_request(&mut self.command, size, self.rule, header, request).expect("it fits");
        self.now += CYCLE_NS;
        self.chip.exchange(self.now, black_box(packet), &mut self.answer[..size.packet_len()]);
        black_box(&self.answer);
    }

    /// What came last.
    fn received(&self) -> (AnswerHeader, &[u8]) {
        let size = self.chip.size();
        let packet = &self.answer[..size.packet_len()];
        match AnswerPacket::parse(packet, size, CrcCoverage::All).expect("an answer") {
            Received::Answer(answer) => (answer.header, answer.data),
            Received::NotReady => panic!("the chip is ready"),
        }
    }

    /// A command is run to its end, and nothing may fail.
    fn run(&mut self, request: &impl Encode) {
        self.send(request);
        loop {
            self.send(&InfoUpdate);
            let header = self.received().0;
            assert_eq!(Errors(header.errors.0 & Errors::ALL.0), Errors::NONE);
            if !header.status.contains(Status::BUSY) {
                return;
            }
        }
    }

    fn exchange(&mut self) {
        let mut outputs = [0; DRIVES * OUT_BYTES];
        for axis in outputs.chunks_exact_mut(OUT_BYTES) {
            axis[..2].copy_from_slice(&self.path.controlword.to_le_bytes());
            axis[2..].copy_from_slice(&self.path.target.to_le_bytes());
        }
        let operation = PdoOperation::WRITE | PdoOperation::READ;
        self.send(&PdoDataFifo { count: 1, operation, data: &outputs });
        self.cycles += 1;
    }

    /// A cycle with a new target for each drive.
    pub fn cycle(&mut self) {
        self.path.advance();
        self.exchange();
    }

    /// All drives are enabled, and where the path is.
    pub fn assert_well(&self) {
        let (header, data) = self.received();
        assert_eq!((header.wkc_errors, header.crc_errors), (0, 0));
        assert_eq!(usize::from(header.len), DRIVES * IN_BYTES, "TxPDOs come");
        for axis in data[..DRIVES * IN_BYTES].chunks_exact(IN_BYTES) {
            let statusword = u16::from_le_bytes([axis[0], axis[1]]);
            let position = i32::from_le_bytes([axis[2], axis[3], axis[4], axis[5]]);
            assert_follows(statusword, position, self.path.target);
        }
    }
}

/// The simulated bus.
pub struct BusWithDrives {
    bus: SimBus,
    now: u64,
    path: Path,
    outputs: Outputs,
    inputs: Inputs,
}

impl BusWithDrives {
    /// Drives that are enabled, by the same controlwords.
    pub fn in_op() -> Self {
        let (outputs, inputs) = (Outputs::default(), Inputs::default());
        let mut this = Self { bus: SimBus::new(drives()), now: 0, path: Path::new(), outputs, inputs };
        let drive = SlaveConfig { role: Role::Drive(Mode::Csp), sync: DriveSync::DcSync };
        let slaves: SlaveSet = (1..=DRIVES as u8).collect();
        this.run(Job::Scan);
        let configure = BusConfig { cycle: CycleTime::DEFAULT, selected: slaves, slaves: [drive; DRIVES] };
        for target in [AlState::PreOp, AlState::SafeOp, AlState::Op] {
            this.run(Job::State { target, slaves, timeout_ns: 10_000 * CYCLE_NS });
            if target == AlState::PreOp {
                this.run(Job::Configure(configure));
            }
        }
        for controlword in CONTROLWORDS {
            this.path.controlword = controlword;
            (0..SWITCHING).for_each(|_| this.exchange());
        }
        this
    }

    fn run(&mut self, job: Job) {
        self.bus.start(job, self.now).expect("no other job runs");
        let done = loop {
            self.now += CYCLE_NS;
            self.bus.poll(self.now, &mut self.inputs);
            if let Some(done) = self.bus.poll_job(self.now) {
                break done;
            }
        };
        match done {
            JobDone::Scan { found } => assert_eq!(usize::from(found), DRIVES),
            JobDone::Configure(result) => assert!(result.is_ok(), "{result:?}"),
            JobDone::State(result) => assert_eq!(result, Ok(())),
            JobDone::NotScanned(_) | JobDone::Beyond(_) => unreachable!("no such job was started"),
        }
    }

    fn exchange(&mut self) {
        self.now += CYCLE_NS;
        self.outputs.id += 1;
        let controlword = Controlword(self.path.controlword);
        for slave in &mut self.outputs.slaves {
            slave[0] = AxisOut { controlword, target: self.path.target, outputs: 0 };
        }
        self.bus.push(black_box(&self.outputs)).expect("room");
        black_box(self.bus.poll(self.now, &mut self.inputs));
        black_box(&self.inputs);
    }

    /// A cycle with a new target for each drive.
    pub fn cycle(&mut self) {
        self.path.advance();
        self.exchange();
    }

    /// All drives are enabled, and where the path is.
    pub fn assert_well(&self) {
        for slave in &self.inputs.slaves {
            let axis = &slave[0];
            assert_follows(axis.statusword.0, axis.position, self.path.target);
        }
    }
}

fn assert_follows(statusword: u16, position: i32, target: i32) {
    assert_eq!(statusword & STATE_BITS, ENABLED, "0x{statusword:04X}");
    assert!((position - target).abs() < 100 * STEP, "at {position} on the way to {target}");
}
