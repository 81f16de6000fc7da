//! Any frames through a chain of slaves, in any state, with cables that are cut and slaves that lose their power: nothing panics,
//! a frame keeps its length, each slave is in a state that there is and shows the one that its device is in, and the chain goes
//! on.

#![no_main]

use ecmsk::ethercat::registers::{self, Fmmu, FmmuDirections, RequestedState, SmControl, SyncManager};
use ecmsk::ethercat::{AlState, Command, DatagramHeader, FRAME_LEN_MAX, Frame, FrameHeader, FrameWriter};
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, FrameFate};
use ecmsk::slave::{Drive, DriveConfig, Hsp, HspConfig, Io, Slave};
use libfuzzer_sys::fuzz_target;

/// Bytes of a step, its data not counted.
const STEP: usize = 8;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, mut bytes)) = bytes.split_first() else { return };
    let mut rig = Rig::new(kind);
    while let Some((step, rest)) = bytes.split_first_chunk::<STEP>() {
        let (data, rest) = rest.split_at(usize::from(step[7]).min(rest.len()));
        bytes = rest;
        rig.step(step, data);
    }
    rig.end();
});

struct Rig {
    chain: Chain,
    now: u64,
}

fn slave(device: Box<dyn Slave>) -> EscSlave {
    let settings = EscSettings { ports: [3; 4], ..EscSettings::default() };
    EscSlave::describe(device, settings, 0).expect("it can be described")
}

impl Rig {
    fn new(kind: u8) -> Self {
        let mut chain =
            Chain::line([slave(Box::new(Drive::new(DriveConfig::default()))), slave(Box::new(Io::default()))]);
        chain.add(slave(Box::new(Hsp::new(HspConfig::default()))), 0, 3);
        let mut rig = Self { chain, now: 1_000_000 };
        // Up to a state, as masters bring slaves there.
        for state in [0, 2, 4, 8].into_iter().take(1 + usize::from(kind % 4)) {
            rig.bring(state);
        }
        rig
    }

    /// The drive to bootstrap, with an FoE message in its mailbox.
    fn boot(&mut self, data: &[u8]) {
        let boxes = [
            SyncManager::enabled(0x1000, 256, SmControl::MAILBOX_OUT).encode(),
            SyncManager::enabled(0x1100, 256, SmControl::MAILBOX_IN).encode(),
        ];
        self.one(Command::Apwr, 0, registers::AL_CONTROL, &[0x11, 0]);
        self.one(Command::Apwr, 0, registers::SYNC_MANAGER, &[0; 16]);
        self.one(Command::Apwr, 0, registers::SYNC_MANAGER, &boxes.concat());
        self.one(Command::Apwr, 0, registers::AL_CONTROL, &[3, 0]);
        let mut mailbox = [0; 256];
        let len = data.len().min(250);
        mailbox[0] = len as u8;
        mailbox[5] = 4;
        mailbox[6..][..len].copy_from_slice(&data[..len]);
        self.one(Command::Apwr, 0, 0x1000, &mailbox);
        self.one(Command::Aprd, 0, 0x1100, &[0; 256]);
    }

    fn bring(&mut self, state: u8) {
        let lens: Vec<(u16, u16)> = (0..3).map(|n| self.lens(n)).collect();
        for (n, (outputs, inputs)) in (0..3u16).zip(lens) {
            // The position of the third slave on the wire is the second one.
            let adp = [0u16, 2, 1][usize::from(n)].wrapping_neg();
            let mut put = |ado, data: &[u8]| self.one(Command::Apwr, adp, ado, data);
            match state {
                2 => {
                    put(registers::STATION_ADDRESS, &(0x1001 + n).to_le_bytes());
                    put(registers::sync_manager(0), &SyncManager::enabled(0x1000, 64, SmControl::MAILBOX_OUT).encode());
                    put(registers::sync_manager(1), &SyncManager::enabled(0x1080, 64, SmControl::MAILBOX_IN).encode());
                }
                4 => {
                    let out = SyncManager::enabled(0x1100, outputs, SmControl::OUTPUTS);
                    put(registers::sync_manager(2), &out.encode());
                    let back = SyncManager::enabled(0x1200, inputs, SmControl::INPUTS);
                    put(registers::sync_manager(3), &back.encode());
                    let logical = u32::from(n) * 64;
                    put(registers::fmmu(0), &Fmmu::bytes(logical, outputs, 0x1100, FmmuDirections::WRITE).encode());
                    put(registers::fmmu(1), &Fmmu::bytes(logical, inputs, 0x1200, FmmuDirections::READ).encode());
                }
                _ => {}
            }
        }
        if state == 8 {
            self.send(DatagramHeader::new(Command::Lrw, 0, 0), &[0; 192]);
        }
        if state > 0 {
            self.one(Command::Bwr, 0, registers::AL_CONTROL, &[state, 0]);
            assert!((0..3).all(|n| self.chain.slave(n).state() as u8 == state));
        }
    }

    fn lens(&self, n: usize) -> (u16, u16) {
        use ecmsk::ethercat::sii::{CategoryKind, Sii};
        let sii = Sii::new(self.chain.slave(n).controller().eeprom()).expect("an EEPROM");
        let managers = sii.category(CategoryKind::SyncManagers).expect("sync managers");
        let lens: Vec<u16> = managers.sync_managers().map(|manager| manager.len).collect();
        (lens[2], lens[3])
    }

    fn one(&mut self, command: Command, adp: u16, ado: u16, data: &[u8]) {
        self.send(DatagramHeader::register(command, 0, adp, ado), data);
    }

    fn send(&mut self, header: DatagramHeader, data: &[u8]) {
        let mut buffer = [0xA5; FRAME_LEN_MAX];
        let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x10; 6])).expect("room");
        frame.push(header, data).expect("at most 255 bytes");
        let len = frame.finish().len();
        self.raw(&mut buffer[..len]);
    }

    fn raw(&mut self, bytes: &mut [u8]) {
        let before = bytes.to_vec();
        let fate = self.chain.process(bytes, self.now);
        if let FrameFate::Returned(back) = fate {
            assert!(back >= self.now);
        } else {
            assert_eq!(bytes, before, "a frame that does not come back is not changed");
        }
        if let (Ok(before), Ok(after)) = (Frame::decode(&before), Frame::decode(bytes)) {
            assert_eq!(before.payload.len(), after.payload.len());
        }
        self.check();
    }

    fn check(&self) {
        for n in 0..self.chain.len() {
            let slave = self.chain.slave(n);
            let shown = slave.controller().peek(registers::AL_STATUS, 2);
            let state = RequestedState::from_code(shown[0]);
            assert_eq!(state, slave.shown_state());
            // In bootstrap the device stands as in Init.
            let of_device = if state == RequestedState::Boot { RequestedState::State(AlState::Init) } else { state };
            assert_eq!((of_device, slave.state()), (RequestedState::State(slave.state()), slave.device().state()));
            assert!(shown[0] & 0xC0 == 0 && shown[1] == 0, "{shown:X?}");
        }
    }

    fn step(&mut self, step: &[u8; STEP], data: &[u8]) {
        self.now += u64::from(step[1]) * 20_000;
        let [what, _, command, low, high, adp, _, _] = *step;
        let n = usize::from(low % 3);
        match what % 16 {
            0 => self.chain.connect(n, high & 1 == 0),
            1 => self.chain.power(n, high & 1 == 0, self.now),
            2 => self.raw(&mut data.to_vec()),
            3 => self.chain.advance(self.now),
            4 => {
                // As a master writes an SDO: a whole mailbox.
                let mut mailbox = [0; 64];
                let len = data.len().min(mailbox.len());
                mailbox[..len].copy_from_slice(&data[..len]);
                self.one(Command::Fpwr, 0x1001 + u16::from(adp % 3), 0x1000, &mailbox);
            }
            5 => self.one(Command::Fprd, 0x1001 + u16::from(adp % 3), 0x1080, &[0; 64]),
            7 => self.boot(data),
            6 => self.send(DatagramHeader::new(Command::from_code(10 + command % 3), 0, low.into()), data),
            _ => {
                let adp = [0, 0xFFFF, 0x1001, 0x1002, u16::from(adp)][usize::from(adp % 5)];
                let ado = u16::from_le_bytes([low, high % 0x14]);
                self.one(Command::from_code(command % 17), adp, ado, data);
            }
        }
        self.check();
    }

    /// With whole cables and power the chain answers again.
    fn end(&mut self) {
        for n in 0..3 {
            self.chain.connect(n, true);
            self.chain.power(n, false, self.now);
            self.chain.power(n, true, self.now);
        }
        let mut buffer = [0; 60];
        let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x10; 6])).expect("room");
        frame.push(DatagramHeader::register(Command::Brd, 0, 0, registers::AL_STATUS), &[0; 2]).expect("room");
        frame.finish();
        self.raw(&mut buffer);
        let mut answers = Frame::decode(&buffer).expect("a frame").datagrams().expect("one");
        let answer = answers.next().expect("one").expect("whole");
        assert_eq!((answer.working_counter, answer.data), (3, &[1, 0][..]));
    }
}
