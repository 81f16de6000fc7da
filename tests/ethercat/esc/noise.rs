//! A cable that damages frames: the error counters of the slaves, and the effects of a damaged frame.

use std::num::NonZeroU16;

use ecmsk::ethercat::registers::{AL_STATUS, FORWARDED_ERRORS, LOST_LINKS, RX_ERRORS, STATION_ADDRESS};
use ecmsk::ethercat::{Command, DatagramHeader, Ns};
use ecmsk::slave::cable::{Cable, Noise};
use ecmsk::slave::esc::{CabledChain, FrameFate};
use ecmsk::slave::{Io, Slave};

use super::rig::{answers, frame_of};

struct Line {
    slaves: CabledChain,
    now: Ns,
}

impl Line {
    fn of(count: usize) -> Self {
        let devices = (0..count).map(|_| Box::new(Io::default()) as Box<dyn Slave>).collect();
        Self { slaves: CabledChain::new(devices, Cable::default()).expect("they can be described"), now: 0 }
    }

    fn noise(&self, slave: u8, one_of: u16) {
        self.slaves.cable().damage_frames(NonZeroU16::new(one_of).map(|one_of| Noise { slave, one_of }));
    }

    /// The working counter of a datagram; `None`: the frame is lost.
    fn send(&mut self, command: Command, address: u32, data: &[u8]) -> Option<u16> {
        let mut frame = frame_of(&[(DatagramHeader::new(command, 0, address), data)]);
        self.now += 10_000;
        let FrameFate::Returned(_) = self.slaves.process(&mut frame, self.now) else { return None };
        Some(answers(&frame)[0].wkc)
    }

    fn count(&mut self) -> Option<u16> {
        self.send(Command::Brd, u32::from(AL_STATUS) << 16, &[0; 2])
    }

    /// Invalid frames and forwarded errors at ports 0 and 1 of each slave.
    fn counted(&self) -> Vec<([u8; 2], [u8; 2])> {
        let chain = self.slaves.chain();
        let of = |n: usize| {
            let peek = |address, len| chain.slave(n).controller().peek(address, len);
            let (errors, forwarded) = (peek(RX_ERRORS, 4), peek(FORWARDED_ERRORS, 2));
            assert_eq!(peek(LOST_LINKS, 4), [0; 4], "no link is lost by that");
            ([errors[0], errors[2]], [forwarded[0], forwarded[1]])
        };
        (0..chain.len()).map(of).collect()
    }
}

/// ECAT-9.14 The slave behind the cable counts the frame on its way out, the one before it that on its way back; all
/// others count the frame as forwarded after that.
#[test]
fn who_gets_a_damaged_frame_first_counts_it() {
    let mut line = Line::of(4);
    line.noise(3, 2);
    assert_eq!([line.count(), line.count()], [Some(4), None]);
    assert_eq!(line.counted(), [([0, 0], [0, 1]), ([0, 0], [0, 1]), ([1, 0], [0, 1]), ([0, 0], [1, 0])]);
    assert_eq!([line.count(), line.count()], [Some(4), None]);
    assert_eq!(line.counted(), [([0, 0], [0, 2]), ([0, 1], [0, 1]), ([1, 0], [0, 1]), ([0, 0], [1, 0])]);
    line.noise(3, 0);
    assert_eq!([line.count(), line.count()], [Some(4); 2]);
}

/// ECAT-9.14 What a frame writes takes effect before the bad cable, and behind it only if it is damaged on its way back.
#[test]
fn a_damaged_frame_takes_effect_before_the_cable_alone() {
    let mut line = Line::of(3);
    line.noise(2, 1);
    let station = |line: &Line, n: usize| {
        let bytes = line.slaves.chain().slave(n).controller().peek(STATION_ADDRESS, 2);
        u16::from_le_bytes([bytes[0], bytes[1]])
    };
    let address = u32::from(STATION_ADDRESS) << 16;
    assert_eq!(line.send(Command::Bwr, address, &[7, 0]), None);
    assert_eq!([0, 1, 2].map(|n| station(&line, n)), [7, 0, 0]);
    assert_eq!(line.send(Command::Bwr, address, &[8, 0]), None);
    assert_eq!([0, 1, 2].map(|n| station(&line, n)), [8; 3]);
}

/// ECAT-9.14 The master's own cable, a cable behind a cut, and a missing one.
#[test]
fn cables_at_the_ends() {
    let mut line = Line::of(2);
    line.noise(1, 1);
    assert_eq!([line.count(), line.count()], [None; 2]);
    // On its way back the master gets the damaged frame, and counts it itself.
    assert_eq!(line.counted(), [([1, 0], [0, 1]), ([0, 0], [1, 0])]);
    line.noise(3, 1);
    assert_eq!(line.count(), Some(2));
    line.slaves.cable().cut_after(1);
    line.noise(2, 1);
    assert_eq!(line.count(), Some(1));
    line.slaves.cable().heal();
    assert_eq!(line.count(), None);
}
