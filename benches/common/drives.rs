//! 40 drives that are served on a network interface, and a bare master that brings them to OP.

#![allow(dead_code, reason = "each bench takes what it needs")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use ecmsk::engine::RealTime;
use ecmsk::ethercat::registers::{self, Fmmu, FmmuDirections, SmControl, SyncManager};
use ecmsk::ethercat::{
    Command as Wire, DATAGRAM_HEADER_LEN, DatagramHeader, FRAME_HEADER_LEN, FRAME_LEN_MAX, FrameHeader, FrameWriter,
};
use ecmsk::link::slaves;
use ecmsk::port::ethercat::{Options, Server};

use super::wire::Interface;

/// How many there are.
pub const DRIVES: u16 = 40;
/// Bytes of a drive's outputs and inputs, by its PDOs at power-on.
const OUTPUTS: u16 = 6;
const INPUTS: u16 = 10;

/// Serves the drives on an interface.
pub fn serve(interface: &str, real_time: RealTime) -> Server {
    Server::start(Options {
        interface: interface.to_owned(),
        second: None,
        slaves: slaves::parse(&format!("drive*{DRIVES}")).expect("a list"),
        script: None,
        record: None,
        allow_default_route: false,
        drift_ppm: 0,
        real_time,
        tell: Arc::new(|_| {}),
        failed: Arc::new(|| {}),
    })
    .expect("the slaves are served")
}

/// A master that has one frame under way.
pub struct Master {
    interface: Interface,
    answer: [u8; FRAME_LEN_MAX],
    len: usize,
}

impl Master {
    pub const fn new(interface: Interface) -> Self {
        Self { interface, answer: [0; FRAME_LEN_MAX], len: 0 }
    }

    pub fn exchange(&mut self, frame: &[u8]) {
        self.interface.send(frame);
        self.len = self.interface.take(&mut self.answer);
    }

    /// The working counter of the newest frame, which had one datagram.
    fn counter(&self) -> u16 {
        let data: usize = DatagramHeader::decode(
            self.answer[FRAME_HEADER_LEN..].first_chunk::<DATAGRAM_HEADER_LEN>().expect("a datagram"),
        )
        .len
        .into();
        let at = FRAME_HEADER_LEN + DATAGRAM_HEADER_LEN + data;
        u16::from_le_bytes([self.answer[at], self.answer[at + 1]])
    }

    fn write(&mut self, header: DatagramHeader, data: &[u8]) {
        self.exchange(&frame(header, data));
        assert!(self.counter() > 0, "{header:?} was taken");
    }

    fn write_all(&mut self, ado: u16, data: &[u8]) {
        self.write(DatagramHeader::register(Wire::Bwr, 0, 0, ado), data);
    }

    /// Brings all drives to OP; the frame with their process data.
    pub fn bring_to_op(&mut self) -> Vec<u8> {
        for (manager, registers) in [
            (0, SyncManager::enabled(0x1000, 128, SmControl::MAILBOX_OUT)),
            (1, SyncManager::enabled(0x1080, 128, SmControl::MAILBOX_IN)),
            (2, SyncManager::enabled(0x1100, OUTPUTS, SmControl::OUTPUTS)),
            (3, SyncManager::enabled(0x1200, INPUTS, SmControl::INPUTS)),
        ] {
            self.write_all(registers::sync_manager(manager), &registers.encode());
        }
        for n in 0..DRIVES {
            let logical = u32::from(n * (OUTPUTS + INPUTS));
            for (fmmu, registers) in [
                (0, Fmmu::bytes(logical, OUTPUTS, 0x1100, FmmuDirections::WRITE)),
                (1, Fmmu::bytes(logical + u32::from(OUTPUTS), INPUTS, 0x1200, FmmuDirections::READ)),
            ] {
                let header = DatagramHeader::register(Wire::Apwr, 0, n.wrapping_neg(), registers::fmmu(fmmu));
                self.write(header, &registers.encode());
            }
        }
        // They get nothing while the bare loop is measured.
        self.write_all(registers::WATCHDOG_PROCESS_DATA, &[0, 0]);
        for state in [2, 4, 8] {
            self.write_all(registers::AL_CONTROL, &[state, 0]);
        }
        // Switched on, and held where they stand.
        for controlword in [0x06, 0x07, 0x0F] {
            let until = Instant::now() + Duration::from_millis(300);
            while Instant::now() < until {
                self.exchange(&cyclic(controlword));
            }
        }
        self.assert_enabled();
        cyclic(0x0F)
    }

    /// All drives are in OP and switched on, by the newest frame.
    pub fn assert_enabled(&self) {
        assert_eq!(self.counter(), 3 * DRIVES, "all drives are in OP");
        let images = self.answer[FRAME_HEADER_LEN + DATAGRAM_HEADER_LEN..].chunks((OUTPUTS + INPUTS).into());
        let statuswords = images.map(|image| image[usize::from(OUTPUTS)]).take(DRIVES.into());
        assert!(statuswords.into_iter().all(|statusword| statusword & 0x6F == 0x27), "all drives are switched on");
    }
}

/// One LRW with the process data of all drives: this controlword, and 0 as the target.
fn cyclic(controlword: u8) -> Vec<u8> {
    frame(DatagramHeader::new(Wire::Lrw, 0, 0), &image(controlword))
}

fn image(controlword: u8) -> Vec<u8> {
    let mut image = vec![0; (DRIVES * (OUTPUTS + INPUTS)).into()];
    image.chunks_mut((OUTPUTS + INPUTS).into()).for_each(|image| image[0] = controlword);
    image
}

/// The frame of a cycle with all that a master wants of it: the time of the first drive for the others, the states of all, and
/// the process data of [`Master::bring_to_op`].
pub fn with_clock_and_states() -> Vec<u8> {
    frames(&[
        (DatagramHeader::register(Wire::Frmw, 0, 0x1001, registers::SYSTEM_TIME), &[0; 8]),
        (DatagramHeader::register(Wire::Brd, 0, 0, registers::AL_STATUS), &[0; 2]),
        (DatagramHeader::new(Wire::Lrw, 0, 0), &image(0x0F)),
    ])
}

/// A frame with one datagram.
fn frame(header: DatagramHeader, data: &[u8]) -> Vec<u8> {
    frames(&[(header, data)])
}

fn frames(datagrams: &[(DatagramHeader, &[u8])]) -> Vec<u8> {
    let mut buffer = [0; FRAME_LEN_MAX];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x10; 6])).expect("room");
    for (header, data) in datagrams {
        frame.push(*header, data).expect("room");
    }
    let len = frame.finish().len();
    buffer[..len].to_vec()
}
