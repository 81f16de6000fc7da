//! `capi_call`: a write and a read through the C functions against the same through the Rust link, on virtual time, as a
//! program does that moves two axes: a CSP frame out, a report in.

#[path = "../../benches/common/mod.rs"]
mod common;

use std::ffi::c_ulong;
use std::hint::black_box;
use std::time::Duration;

use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::sk::{
    DriveResponse, FRAME_LEN, Frame, MasterCommand, MasterResponse, MasterState, Motion, SlaveCommand, SlaveKind,
    SlotSize, StateByte,
};
// Brings the C functions in, which the linker finds by their names.
use NEXTWUSBLib as _;

const LINK: &str = "sim:?slaves=drive*2&clock=virtual";
const SIZE: SlotSize = SlotSize::Bytes12;
const LENGTH: c_ulong = SIZE.frame_len() as c_ulong;

unsafe extern "system" {
    safe fn OpenECMUSB() -> u32;
    fn ECMUSBWrite(data: *const u8, length: c_ulong) -> u32;
    fn ECMUSBRead(data: *mut u8, length: c_ulong) -> u32;
    safe fn CloseECMUSB();
}

fn c_write(frame: &Frame) {
    // SAFETY: a frame has 512 bytes, of which `LENGTH` are used.
    assert_eq!(unsafe { ECMUSBWrite(frame.bytes().as_ptr(), LENGTH) }, 1);
}

fn c_read(report: &mut [u8; FRAME_LEN]) {
    // SAFETY: the buffer has 512 bytes, of which `LENGTH` are used.
    assert_eq!(unsafe { ECMUSBRead(report.as_mut_ptr(), LENGTH) }, 1);
}

fn native_write(board: &dyn Link, frame: &Frame) {
    board.write(frame, Wait::Forever).expect("the board takes it");
}

fn native_read(board: &dyn Link, report: &mut Frame) {
    board.read(report, Wait::Forever).expect("a report comes");
}

fn main() {
    // SAFETY: no other thread has been started.
    unsafe { std::env::set_var("ECMSK_LINK", LINK) };
    assert_eq!(OpenECMUSB(), 1, "the board opens");
    start(&mut c_write, &mut |report| c_read(report.bytes_mut()));
    let native = link::open(LINK, Share::ByName).expect("the board opens");
    start(&mut |frame| native_write(&*native, frame), &mut |report| native_read(&*native, report));

    let (mut ours, mut theirs) = (Path::default(), Path::default());
    let mut buffer = [0; FRAME_LEN];
    let mut report = Frame::new();
    // What the C functions add, deferring a cancellation of the thread for the most part, is the same whatever a cycle of the
    // model takes; that has become so short that a tenth of it is hardly more.
    let allowance = Some(Duration::from_nanos(100));
    common::pair_of_calls(
        common::Demand { name: "capi_call", target: Some(1.1), allowance, against: None },
        || {
            c_write(black_box(ours.next()));
            c_read(black_box(&mut buffer));
        },
        || {
            native_write(&*native, black_box(theirs.next()));
            native_read(&*native, black_box(&mut report));
        },
    );
    CloseECMUSB();
}

/// Two axes that go to and fro.
#[derive(Default)]
struct Path {
    frame: Frame,
    target: i32,
    n: i32,
}

impl Path {
    fn next(&mut self) -> &Frame {
        self.target += if self.n % 2000 < 1000 { 20 } else { -20 };
        self.n += 1;
        for slave in 1..=2 {
            self.frame.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(self.target)).into());
        }
        &self.frame
    }
}

/// Brings a board to OP with both axes on.
fn start(write: &mut dyn FnMut(&Frame), read: &mut dyn FnMut(&mut Frame)) {
    let mut frame = Frame::new();
    frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
    write(&frame);
    frame.put_master(SIZE, &MasterCommand::SetState(MasterState::Op));
    write(&frame);
    wait_for(read, |report| MasterResponse::decode(&report.slot(SIZE, 0)).state == StateByte::reached(MasterState::Op));
    let mut frame = Frame::new();
    for slave in 1..=2 {
        frame.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into());
    }
    write(&frame);
    wait_for(read, |report| {
        (1..=2).all(|slave| DriveResponse::decode(&report.slot(SIZE, slave)).statusword.is_enabled())
    });
}

fn wait_for(read: &mut dyn FnMut(&mut Frame), done: impl Fn(&Frame) -> bool) {
    let mut report = Frame::new();
    for _ in 0..10_000 {
        read(&mut report);
        if done(&report) {
            return;
        }
    }
    panic!("the bench's board does not come up");
}
