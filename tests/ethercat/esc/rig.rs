//! A master of single steps on a chain of simulated slaves.

use ecmsk::coe::{CoeMessage, SdoRequest};
use ecmsk::ethercat::mailbox::{MailboxCounter, MailboxHeader, MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{self, AlStatusWithCode, Fmmu, FmmuDirections, SmControl, SyncManager};
use ecmsk::ethercat::sii::{CategoryKind, Sii};
use ecmsk::ethercat::{AlState, AlStatus, Command, DatagramHeader, Frame, FrameHeader, FrameWriter, Ns};
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, FrameFate};
use ecmsk::slave::{Drive, DriveConfig, Slave};

pub const US: Ns = 1_000;
pub const MS: Ns = 1_000_000;
/// The station address of the first slave; those of others follow.
pub const FIRST: u16 = 0x1001;
/// Length of the mailboxes that the rig sets.
pub const MAILBOX: u16 = 128;
pub const OUTPUTS: u16 = 0x1100;
pub const INPUTS: u16 = 0x1200;
/// The source address of the rig's frames.
const SOURCE: [u8; 6] = [0x10; 6];

/// A datagram that has come back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    pub header: DatagramHeader,
    pub data: Vec<u8>,
    pub wkc: u16,
}

pub struct Rig {
    pub chain: Chain,
    pub now: Ns,
    /// How long the master waits between frames.
    pub pause: Ns,
    /// The frames that were sent, if they are to be kept.
    pub sent: Option<Vec<Vec<u8>>>,
    index: u8,
    counter: MailboxCounter,
}

/// A slave with a drive in it.
pub fn drive(settings: EscSettings) -> EscSlave {
    slave(Box::new(Drive::new(DriveConfig::default())), settings)
}

/// A slave with a device in it, and the EEPROM of that device.
pub fn slave(device: Box<dyn Slave>, settings: EscSettings) -> EscSlave {
    EscSlave::describe(device, settings, 0).expect("it can be described")
}

impl Rig {
    pub fn new(slaves: impl IntoIterator<Item = EscSlave>) -> Self {
        let chain = Chain::line(slaves);
        Self { chain, now: MS, pause: 100 * US, sent: None, index: 0, counter: MailboxCounter::NONE }
    }

    /// Slaves in Init, which have their station addresses.
    pub fn with_stations(slaves: impl IntoIterator<Item = EscSlave>) -> Self {
        let mut rig = Self::new(slaves);
        rig.give_stations();
        rig
    }

    /// Drives in Init, which have their station addresses.
    pub fn drives(n: usize) -> Self {
        Self::with_stations((0..n).map(|_| drive(EscSettings::default())))
    }

    /// A drive in PreOP.
    pub fn in_preop() -> Self {
        let mut rig = Self::drives(1);
        rig.bring_to_preop(FIRST);
        rig
    }

    /// Two drives in that state, with their process data at 0 and 100.
    pub fn in_state(state: AlState) -> Self {
        let mut rig = Self::drives(2);
        for (station, logical) in [(FIRST, 0), (FIRST + 1, 100)] {
            if state >= AlState::PreOp {
                rig.bring_to_preop(station);
            }
            if state >= AlState::SafeOp {
                rig.set_process_data(station, logical);
                rig.reach(station, AlState::SafeOp);
            }
            if state == AlState::Op {
                rig.logical(Command::Lrw, 0, &[0; 200]);
                rig.reach(station, AlState::Op);
            }
        }
        rig
    }

    /// Switches a slave off and on.
    pub fn power_cycle(&mut self, n: usize) {
        self.chain.power(n, false, self.now);
        self.chain.power(n, true, self.now);
    }

    pub fn give_stations(&mut self) {
        for n in 0..self.chain.len() as u16 {
            let station = (FIRST + n).to_le_bytes();
            assert_eq!(self.one(Command::Apwr, n.wrapping_neg(), registers::STATION_ADDRESS, &station).wkc, 1);
        }
    }

    /// Sends the bytes of a frame and waits for the pause.
    pub fn raw(&mut self, bytes: &mut [u8]) -> FrameFate {
        self.now += self.pause;
        self.sent.iter_mut().for_each(|sent| sent.push(bytes.to_vec()));
        self.chain.process(bytes, self.now)
    }

    /// Sends datagrams in one frame.
    pub fn frame(&mut self, datagrams: &[(DatagramHeader, &[u8])]) -> Vec<Answer> {
        let mut bytes = frame_of(datagrams);
        assert!(matches!(self.raw(&mut bytes), FrameFate::Returned(_)));
        answers(&bytes)
    }

    /// Sends one datagram to a register.
    pub fn one(&mut self, command: Command, adp: u16, ado: u16, data: &[u8]) -> Answer {
        self.index = self.index.wrapping_add(1);
        self.frame(&[(DatagramHeader::register(command, self.index, adp, ado), data)]).remove(0)
    }

    /// Sends one datagram to logical addresses.
    pub fn logical(&mut self, command: Command, address: u32, data: &[u8]) -> Answer {
        self.index = self.index.wrapping_add(1);
        self.frame(&[(DatagramHeader::new(command, self.index, address), data)]).remove(0)
    }

    /// Reads a register of a station, which must answer.
    #[track_caller]
    pub fn read(&mut self, station: u16, ado: u16, len: usize) -> Vec<u8> {
        let answer = self.one(Command::Fprd, station, ado, &vec![0; len]);
        assert_eq!(answer.wkc, 1, "FPRD of 0x{ado:04X}");
        answer.data
    }

    pub fn read_u8(&mut self, station: u16, ado: u16) -> u8 {
        self.read(station, ado, 1)[0]
    }

    pub fn read_u16(&mut self, station: u16, ado: u16) -> u16 {
        u16::from_le_bytes(self.read(station, ado, 2).try_into().expect("2 bytes"))
    }

    pub fn read_u32(&mut self, station: u16, ado: u16) -> u32 {
        u32::from_le_bytes(self.read(station, ado, 4).try_into().expect("4 bytes"))
    }

    pub fn read_u64(&mut self, station: u16, ado: u16) -> u64 {
        u64::from_le_bytes(self.read(station, ado, 8).try_into().expect("8 bytes"))
    }

    /// Writes a register of a station, which must accept it.
    #[track_caller]
    pub fn write(&mut self, station: u16, ado: u16, data: &[u8]) {
        assert_eq!(self.one(Command::Fpwr, station, ado, data).wkc, 1, "FPWR to 0x{ado:04X}");
    }

    pub fn set_manager(&mut self, station: u16, n: u8, manager: SyncManager) {
        self.write(station, registers::sync_manager(n), &manager.encode());
    }

    pub fn set_fmmu(&mut self, station: u16, n: u8, fmmu: Fmmu) {
        self.write(station, registers::fmmu(n), &fmmu.encode());
    }

    /// Writes AL control and reads the resulting AL status.
    pub fn request(&mut self, station: u16, control: u16) -> (u16, AlStatus) {
        self.write(station, registers::AL_CONTROL, &control.to_le_bytes());
        self.al_status(station)
    }

    pub fn al_status(&mut self, station: u16) -> (u16, AlStatus) {
        let bytes: [u8; 6] = self.read(station, registers::AL_STATUS, 6).try_into().expect("6 bytes");
        let both = AlStatusWithCode::decode(&bytes);
        (both.status.0, both.code)
    }

    #[track_caller]
    pub fn reach(&mut self, station: u16, state: AlState) {
        assert_eq!(self.request(station, state as u16), (state as u16, AlStatus::NONE));
    }

    /// Sets the mailbox as masters do.
    pub fn set_mailbox(&mut self, station: u16) {
        self.set_manager(station, 0, SyncManager::enabled(0x1000, MAILBOX, SmControl::MAILBOX_OUT));
        self.set_manager(station, 1, SyncManager::enabled(0x1080, MAILBOX, SmControl::MAILBOX_IN));
    }

    pub fn bring_to_preop(&mut self, station: u16) {
        self.set_mailbox(station);
        self.reach(station, AlState::PreOp);
    }

    /// The lengths of outputs and inputs by a slave's EEPROM, bytes.
    pub fn lens(&self, station: u16) -> (u16, u16) {
        let eeprom = self.chain.slave(usize::from(station - FIRST)).controller().eeprom();
        let sii = Sii::new(eeprom).expect("an EEPROM");
        let managers = sii.category(CategoryKind::SyncManagers).expect("sync managers");
        let lens: Vec<u16> = managers.sync_managers().map(|manager| manager.len).collect();
        (lens[2], lens[3])
    }

    /// Maps process data at a logical address: outputs there, inputs behind them. Returns their bytes.
    pub fn set_process_data(&mut self, station: u16, logical: u32) -> usize {
        let (outputs, inputs) = self.lens(station);
        self.set_manager(station, 2, SyncManager::enabled(OUTPUTS, outputs, SmControl::OUTPUTS));
        self.set_manager(station, 3, SyncManager::enabled(INPUTS, inputs, SmControl::INPUTS));
        self.set_fmmu(station, 0, Fmmu::bytes(logical, outputs, OUTPUTS, FmmuDirections::WRITE));
        self.set_fmmu(station, 1, Fmmu::bytes(logical + u32::from(outputs), inputs, INPUTS, FmmuDirections::READ));
        usize::from(outputs + inputs)
    }

    /// Brings a slave from Init to OP, with its process data at a logical address; returns their length.
    pub fn bring_to_op(&mut self, station: u16, logical: u32) -> usize {
        self.bring_to_preop(station);
        let len = self.set_process_data(station, logical);
        self.reach(station, AlState::SafeOp);
        self.logical(Command::Lrw, logical, &vec![0; len]);
        self.reach(station, AlState::Op);
        len
    }

    /// The next mailbox message, with the counter that follows.
    pub fn message(&mut self, protocol: MailboxProtocol, data: &[u8]) -> Vec<u8> {
        self.counter = self.counter.next();
        self.message_with(MailboxHeader::new(protocol, self.counter), data)
    }

    pub fn message_with(&self, header: MailboxHeader, data: &[u8]) -> Vec<u8> {
        let mut mailbox = vec![0; MAILBOX.into()];
        MailboxMessage { header, data }.encode(&mut mailbox).expect("room");
        mailbox
    }

    /// Writes a message to a slave's mailbox; returns the working counter.
    pub fn post(&mut self, station: u16, mailbox: &[u8]) -> u16 {
        self.one(Command::Fpwr, station, 0x1000, mailbox).wkc
    }

    /// Reads a slave's mailbox; `None`: it is empty.
    pub fn collect(&mut self, station: u16) -> Option<Vec<u8>> {
        let answer = self.one(Command::Fprd, station, 0x1080, &vec![0; MAILBOX.into()]);
        (answer.wkc == 1).then_some(answer.data)
    }

    /// Sends CoE data and returns the data of the answer.
    #[track_caller]
    pub fn coe(&mut self, station: u16, data: &[u8]) -> Vec<u8> {
        let message = self.message(MailboxProtocol::Coe, data);
        assert_eq!(self.post(station, &message), 1, "the mailbox is empty");
        let answer = self.collect(station).expect("an answer");
        let answer = MailboxMessage::decode(&answer).expect("a message");
        assert_eq!(answer.header.protocol, MailboxProtocol::Coe);
        answer.data.to_vec()
    }

    /// Sends an SDO request and returns the data of the answer.
    #[track_caller]
    pub fn sdo(&mut self, station: u16, request: SdoRequest<'_>) -> Vec<u8> {
        let mut room = [0; 1500];
        let len = CoeMessage::SdoRequest(request).encode(&mut room).expect("room");
        self.coe(station, &room[..len])
    }
}

/// The bytes of a frame with these datagrams.
pub fn frame_of(datagrams: &[(DatagramHeader, &[u8])]) -> Vec<u8> {
    let mut buffer = [0xA5; 1514];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
    for (header, data) in datagrams {
        frame.push(*header, data).expect("room");
    }
    frame.finish().to_vec()
}

/// The datagrams in the bytes of a frame.
pub fn answers(bytes: &[u8]) -> Vec<Answer> {
    let datagrams = Frame::decode(bytes).expect("a frame").datagrams().expect("datagrams");
    let answer = |datagram: ecmsk::ethercat::Datagram<'_>| Answer {
        header: datagram.header,
        data: datagram.data.to_vec(),
        wkc: datagram.working_counter,
    };
    datagrams.map(|datagram| answer(datagram.expect("whole"))).collect()
}
