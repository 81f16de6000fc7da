//! Frames that nobody should send: whatever comes, slaves go on, in a state of the diagram, and nothing is allocated for a frame.

use ecmsk::coe::{ObjectAddress, SdoRequest, SdoScope};
use ecmsk::ethercat::registers::{self, RequestedState};
use ecmsk::ethercat::{AlState, Command, DatagramHeader, FrameHeader, FrameWriter};
use ecmsk::slave::esc::FrameFate;

use super::rig::{FIRST, Rig, SOURCE, US};

/// Places that matter, so that random frames often hit one.
const ADDRESSES: [u16; 24] = [
    0x0010, 0x0040, 0x0100, 0x0120, 0x0130, 0x0200, 0x0300, 0x0400, 0x0420, 0x0500, 0x0502, 0x0600, 0x0610, 0x0800,
    0x0806, 0x0808, 0x080E, 0x0810, 0x0818, 0x0900, 0x0910, 0x0980, 0x0990, 0x1000,
];

/// Random numbers, the same ones in each run.
struct Random(u64);

impl Random {
    /// A number below `n`.
    fn below(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % n
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }

    /// A datagram: command, where to, data. Numbers are often small, and places often some that matter.
    fn datagram(&mut self) -> (DatagramHeader, Vec<u8>) {
        let command = Command::from_code(self.below(17) as u8);
        let any = self.below(0x1_0000) as u16;
        let adp = self.of(&[0, FIRST, FIRST + 1, 0xFFFF, any]);
        let place = self.of(&ADDRESSES) + self.below(10) as u16;
        let ado = match self.below(8) {
            0 => 0x1000 + self.below(0x300) as u16,
            1 => any,
            _ => place,
        };
        let is_logical = matches!(command, Command::Lrd | Command::Lwr | Command::Lrw);
        let header = DatagramHeader::register(command, 1, adp, if is_logical { 0 } else { ado });
        let len = match self.below(10) {
            0..=6 => 1 + self.below(20),
            7..=8 => 128,
            _ => self.below(300),
        };
        let byte = |random: &mut Self| match random.below(4) {
            0 => random.below(256) as u8,
            _ => random.below(9) as u8,
        };
        (header, (0..len).map(|_| byte(self)).collect())
    }
}

/// Whether each slave is in a state that there is, and shows the one that its device is in.
#[track_caller]
fn check(rig: &Rig) {
    for n in 0..rig.chain.len() {
        let slave = rig.chain.slave(n);
        let shown = slave.controller().peek(registers::AL_STATUS, 2);
        let state = RequestedState::from_code(shown[0]);
        assert_eq!(state, RequestedState::State(slave.state()), "{shown:X?}");
        assert_eq!(slave.state(), slave.device().state());
        assert!(shown[0] & 0xC0 == 0 && shown[1] == 0, "{shown:X?}");
    }
}

/// The slaves of a rig are in that state at the beginning.
fn rig_in(state: AlState) -> Rig {
    let mut rig = Rig::drives(2);
    if state >= AlState::PreOp {
        for (station, logical) in [(FIRST, 0), (FIRST + 1, 100)] {
            rig.bring_to_preop(station);
            if state >= AlState::SafeOp {
                rig.set_process_data(station, logical);
                rig.reach(station, AlState::SafeOp);
            }
            if state == AlState::Op {
                rig.logical(Command::Lrw, 0, &[0; 200]);
                rig.reach(station, AlState::Op);
            }
        }
    }
    rig
}

/// ECAT-14.1 Whatever frames come, in whatever state, each slave is in a state that there is and shows it.
#[test]
fn random_frames_leave_slaves_in_states_that_there_are() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    for state in [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op] {
        let mut visited = [0; 9];
        for _ in 0..20 {
            let mut rig = rig_in(state);
            for _ in 0..250 {
                let (header, data) = random.datagram();
                rig.pause = US * random.below(5_000);
                let mut buffer = [0; 1514];
                let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
                frame.push(header, &data).expect("room");
                let mut bytes = frame.finish().to_vec();
                rig.raw(&mut bytes);
                check(&rig);
                visited[rig.chain.slave(0).state() as usize] += 1;
            }
        }
        assert!(visited[state as usize] > 0 && visited[1] > 0, "{visited:?}");
    }
}

/// ECAT-14.1 Bytes that are no frames, and frames that are cut or changed, harm nobody.
#[test]
fn torn_frames_harm_nobody() {
    let mut rig = rig_in(AlState::Op);
    let mut buffer = [0; 1514];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
    frame.push(DatagramHeader::new(Command::Lrw, 1, 0), &[0; 40]).expect("room");
    frame.push(DatagramHeader::register(Command::Fprd, 2, FIRST, 0x0130), &[0; 6]).expect("room");
    let whole = frame.finish().to_vec();
    for len in 0..whole.len() {
        rig.raw(&mut whole[..len].to_vec());
        check(&rig);
    }
    for at in 14..whole.len() {
        for bit in 0..8 {
            let mut changed = whole.clone();
            changed[at] ^= 1 << bit;
            rig.raw(&mut changed);
            check(&rig);
        }
    }
}

/// ECAT-14.2 A frame allocates nothing, whatever it carries in a cycle: process data, clocks, states, a short SDO.
#[test]
fn a_frame_allocates_nothing() {
    let mut rig = Rig::drives(10);
    for n in 0..10 {
        rig.bring_to_op(FIRST + n, u32::from(n) * 100);
    }
    let mut buffer = [0; 1514];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
    frame.push(DatagramHeader::register(Command::Frmw, 1, FIRST, registers::SYSTEM_TIME), &[0; 8]).expect("room");
    frame.push(DatagramHeader::new(Command::Lrw, 2, 0), &[0; 1000]).expect("room");
    frame.push(DatagramHeader::register(Command::Brd, 3, 0, registers::AL_STATUS), &[0; 2]).expect("room");
    frame.push(DatagramHeader::register(Command::Bwr, 4, 0, registers::RECEIVE_TIMES), &[0; 4]).expect("room");
    let cyclic = frame.finish().to_vec();

    let mut room = [0; 20];
    let upload = SdoRequest::Upload { object: ObjectAddress::new(0x6041, 0), scope: SdoScope::Entry };
    let len = ecmsk::coe::CoeMessage::SdoRequest(upload).encode(&mut room).expect("room");
    let request = rig.message(ecmsk::ethercat::mailbox::MailboxProtocol::Coe, &room[..len]);
    let mut mails = Vec::new();
    for (command, ado, data) in [(Command::Fpwr, 0x1000, &request), (Command::Fprd, 0x1080, &vec![0; 128])] {
        let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
        frame.push(DatagramHeader::register(command, 5, FIRST, ado), data).expect("room");
        mails.push(frame.finish().to_vec());
    }
    rig.pause = 250 * US;
    let mut counts = Vec::with_capacity(1000);
    let counted = allocation_counter::measure(|| {
        let mut bytes = [0; 1514];
        for _ in 0..300 {
            for frame in [&cyclic, &mails[0], &mails[1]] {
                let bytes = &mut bytes[..frame.len()];
                bytes.copy_from_slice(frame);
                assert!(matches!(rig.raw(bytes), FrameFate::Returned(_)));
                counts.push(bytes[frame.len() - 2]);
            }
        }
    });
    assert_eq!(counted.count_total, 0);
    assert_eq!(rig.al_status(FIRST).0, 8);
    // The mailbox frame ends with its working counter: the first request was worked on, the same ones again were dropped.
    assert_eq!((counts[1], counts[2], counts[4], counts[5]), (1, 1, 1, 0));
}
