//! `esc_lrw_40`: one LRW through 40 drives in OP, which follow their targets: each drive takes its 12 bytes of outputs, moves its
//! motor for a cycle and gives 12 bytes of inputs. The baseline is what that cannot do without: the same bytes copied into and
//! out of 40 images, and the same motors moved.
//!
//! `esc_lrw_of_1` to `esc_lrw_of_200`: what a slave costs of a cycle of so many drives. Over one it is the frame itself, too;
//! 100 drives take two frames and 200 take four, and each frame passes all of them.

mod common;

use std::hint::black_box;

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::{self, Fmmu, FmmuDirections, SmControl, SyncManager};
use ecmsk::ethercat::{
    AlState, Command, DATAGRAM_HEADER_LEN, DatagramHeader, FRAME_HEADER_LEN, FRAME_LEN_MAX, FrameHeader, FrameWriter,
};
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, FrameFate};
use ecmsk::slave::plant::{Motor, Servo, Setpoint};
use ecmsk::slave::{Drive, DriveConfig, Slave};

const DRIVES: usize = 40;
const CYCLE_NS: u64 = 1_000_000;
/// Bytes of a drive in one direction.
const BYTES: usize = 12;
/// Controlword, target position, target velocity, target torque.
const OUTPUTS: [u32; 4] = [0x6040_0010, 0x607A_0020, 0x60FF_0020, 0x6071_0010];
/// Statusword, position, velocity, torque.
const INPUTS: [u32; 4] = [0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010];
/// How far the targets go in a cycle, counts.
const STEP: i32 = 10;

fn main() {
    let mut wire = Wire::new(DRIVES);
    let mut plain = PlainLoop::new();
    common::pair("esc_lrw_40", 2.0, || wire.cycle(), || plain.cycle());
    wire.assert_well();
    for drives in [1, 10, 40, 100, 200] {
        let mut wire = Wire::new(drives);
        let cycles = 10_000 / drives;
        let block = || common::per_call_ns(cycles as u64, &mut || wire.cycle()) / drives as f64;
        let blocks = std::iter::repeat_with(block).take(31).collect();
        common::fact(&format!("esc_lrw_of_{drives}"), common::median(blocks), "ns per slave");
        wire.assert_well();
    }
}

/// A drive that maps these objects, in a controller.
fn slave() -> EscSlave {
    let mut drive = Drive::new(DriveConfig::default());
    drive.enter(AlState::PreOp).expect("from Init");
    for (index, entries) in [(0x1600, OUTPUTS), (0x1A00, INPUTS)] {
        let list: Vec<u8> = [4, 0].into_iter().chain(entries.into_iter().flat_map(u32::to_le_bytes)).collect();
        drive.write(ObjectAddress::new(index, 0), SdoScope::Complete, &list).expect("they can be mapped");
    }
    drive.write(ObjectAddress::new(0x6060, 0), SdoScope::Entry, &[8]).expect("it has CSP");
    drive.enter(AlState::Init).expect("from PreOP");
    EscSlave::describe(Box::new(drive), EscSettings::default(), 0).expect("it can be described")
}

/// A master with drives, all in OP and enabled.
struct Wire {
    chain: Chain,
    now: u64,
    /// Frames with one LRW each, of at most 60 drives.
    frames: Vec<Vec<u8>>,
    target: i32,
}

/// How many drives one frame is for.
const DRIVES_PER_FRAME: usize = 60;

impl Wire {
    fn new(drives: usize) -> Self {
        let chain = Chain::line((0..drives).map(|_| slave()));
        let mut wire = Self { chain, now: 0, frames: Vec::new(), target: 0 };
        let mut left = drives;
        while left > 0 {
            let here = left.min(DRIVES_PER_FRAME);
            let logical = (drives - left) as u32 * 2 * BYTES as u32;
            wire.frames.push(frame(DatagramHeader::new(Command::Lrw, 0, logical), &vec![0; here * 2 * BYTES]));
            left -= here;
        }
        let bytes = BYTES as u16;
        for (manager, registers) in [
            (0, SyncManager::enabled(0x1000, 128, SmControl::MAILBOX_OUT)),
            (1, SyncManager::enabled(0x1080, 128, SmControl::MAILBOX_IN)),
            (2, SyncManager::enabled(0x1100, bytes, SmControl::OUTPUTS)),
            (3, SyncManager::enabled(0x1200, bytes, SmControl::INPUTS)),
        ] {
            wire.all(registers::sync_manager(manager), &registers.encode());
        }
        for n in 0..drives as u16 {
            let logical = u32::from(n) * 2 * u32::from(bytes);
            for (fmmu, at, physical, direction) in [
                (0, logical, 0x1100, FmmuDirections::WRITE),
                (1, logical + u32::from(bytes), 0x1200, FmmuDirections::READ),
            ] {
                let fmmu_registers = Fmmu::bytes(at, bytes, physical, direction).encode();
                let header = DatagramHeader::register(Command::Apwr, 0, n.wrapping_neg(), registers::fmmu(fmmu));
                wire.send(&mut frame(header, &fmmu_registers));
            }
        }
        for state in [2, 4, 8] {
            wire.all(registers::AL_CONTROL, &[state, 0]);
            wire.cycle_with(0);
        }
        for word in [0x06, 0x07, 0x0F] {
            (0..300).for_each(|_| wire.cycle_with(word));
        }
        wire
    }

    fn send(&mut self, frame: &mut [u8]) {
        self.now += CYCLE_NS;
        assert!(matches!(self.chain.process(frame, self.now), FrameFate::Returned(_)));
    }

    fn all(&mut self, ado: u16, data: &[u8]) {
        self.send(&mut frame(DatagramHeader::register(Command::Bwr, 0, 0, ado), data));
    }

    fn cycle(&mut self) {
        self.target += STEP;
        self.cycle_with(0x0F);
    }

    fn cycle_with(&mut self, controlword: u16) {
        self.now += CYCLE_NS;
        for frame in &mut self.frames {
            let end = frame.len();
            for image in frame[FRAME_HEADER_LEN + DATAGRAM_HEADER_LEN..end - 2].chunks_exact_mut(2 * BYTES) {
                image[..2].copy_from_slice(&controlword.to_le_bytes());
                image[2..6].copy_from_slice(&self.target.to_le_bytes());
            }
            frame[end - 2..].fill(0);
            black_box(self.chain.process(black_box(frame), self.now));
        }
    }

    /// All drives are in OP, enabled, and where they were sent to.
    fn assert_well(&mut self) {
        (0..100).for_each(|_| self.cycle_with(0x0F));
        for n in 0..self.chain.len() {
            let slave = self.chain.slave(n);
            assert_eq!(slave.state(), AlState::Op);
            let position = slave.device().shaft(0).expect("it has a shaft");
            assert!((position - i64::from(self.target)).abs() <= 1, "{position} is not {}", self.target);
        }
        let counts: u64 = self
            .frames
            .iter()
            .map(|frame| u64::from(frame[frame.len() - 2]) | u64::from(frame[frame.len() - 1]) << 8)
            .sum();
        assert_eq!(counts, 3 * self.chain.len() as u64);
    }
}

/// A frame with one datagram, without padding.
fn frame(header: DatagramHeader, data: &[u8]) -> Vec<u8> {
    let mut buffer = [0; FRAME_LEN_MAX];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x10; 6])).expect("room");
    frame.push(header, data).expect("room");
    frame.finish();
    buffer[..FRAME_HEADER_LEN + DATAGRAM_HEADER_LEN + data.len() + 2].to_vec()
}

struct PlainLoop {
    frame: Vec<u8>,
    images: Vec<[u8; 2 * BYTES]>,
    plants: Vec<Servo>,
    target: i32,
}

impl PlainLoop {
    fn new() -> Self {
        Self {
            frame: vec![0; DRIVES * 2 * BYTES],
            images: vec![[0; 2 * BYTES]; DRIVES],
            plants: vec![Servo::new(&Motor::default(), 0); DRIVES],
            target: 0,
        }
    }

    fn cycle(&mut self) {
        let from = self.target;
        self.target += STEP;
        let slaves = self.images.iter_mut().zip(&mut self.plants).zip(self.frame.chunks_exact_mut(2 * BYTES));
        for ((image, plant), bytes) in slaves {
            bytes[2..6].copy_from_slice(&self.target.to_le_bytes());
            image[..BYTES].copy_from_slice(&black_box(&*bytes)[..BYTES]);
            plant.run(Setpoint::Position { from: from.into(), fraction: 0.0, by: STEP.into() }, CYCLE_NS);
            image[BYTES..][..4].copy_from_slice(&(plant.position() as i32).to_le_bytes());
            bytes[BYTES..].copy_from_slice(&black_box(&*image)[BYTES..]);
        }
        black_box(&self.frame);
    }
}
