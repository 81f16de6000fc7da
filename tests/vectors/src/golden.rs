//! The golden frames as the crate's types: the meaning of each slot by the frame's name.

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::sk::{
    AxisTarget, CommandId, CycleTime, DcShift, DriveResponse, DriveSync, FifoAction, HspAxis, HspResponse, IoResponse,
    MASTER_CYCLIC, MasterCommand, MasterResponse, MasterState, Motion, RawSlot, SdoCommand, SdoResponse, SlaveCommand,
    SlaveKind, SlaveResponse, SlotCommand, SlotSize, StateByte,
};

/// A slot's content, as the type for that slot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    Master(MasterCommand),
    Slave(SlotCommand),
    Sdo(SdoCommand),
    Board(MasterResponse),
    Drive(DriveResponse),
    Io(IoResponse),
    Hsp(HspResponse),
    Transfer(SdoResponse),
}

impl Content {
    pub fn encode(&self, size: SlotSize) -> RawSlot {
        match self {
            Self::Master(command) => command.encode(),
            Self::Slave(command) => command.encode(size),
            Self::Sdo(command) => command.encode(),
            Self::Board(response) => response.encode(),
            Self::Drive(response) => response.encode(),
            Self::Io(response) => response.encode(),
            Self::Hsp(response) => response.encode(size),
            Self::Transfer(response) => response.encode(),
        }
    }

    /// `raw` read as the same type of content as `self`.
    pub fn read_alike(&self, raw: &RawSlot, size: SlotSize) -> Self {
        match self {
            Self::Master(_) => Self::Master(MasterCommand::decode(raw, size).expect("well formed")),
            Self::Slave(_) => Self::Slave(SlotCommand::decode(raw, size).expect("well formed")),
            Self::Sdo(_) => Self::Sdo(SdoCommand::decode(raw, size).expect("well formed")),
            Self::Board(_) => Self::Board(MasterResponse::decode(raw)),
            Self::Drive(_) => Self::Drive(DriveResponse::decode(raw)),
            Self::Io(_) => Self::Io(IoResponse::decode(raw)),
            Self::Hsp(_) => Self::Hsp(HspResponse::decode(raw, size)),
            Self::Transfer(_) => Self::Transfer(SdoResponse::decode(raw)),
        }
    }
}

/// The slots of a golden frame that are not empty.
///
/// # Panics
/// If the name is new: add the frame's meaning here.
pub fn contents(name: &str) -> Vec<(usize, Content)> {
    use MasterCommand as M;
    use SlaveCommand as S;
    let csp = |target| S::Csp(Motion::to(target));
    match name {
        "all-zero-12" | "all-zero-16" => vec![],
        "set-state-preop" => master(M::SetState(MasterState::PreOp)),
        "set-state-op-16" => master(M::SetState(MasterState::Op)),
        "set-axis-group0" => {
            use SlaveKind::{Drive, Hsp, Io, None};
            master(M::SetAxis { group: 0, kinds: [Drive, Io, Hsp, Drive, Drive, None, None, None] })
        }
        "set-axis-group4" => master(M::SetAxis { group: 4, kinds: [SlaveKind::None; 8] }),
        "set-dc-2000" => master(M::SetDc { cycle: CycleTime::from_us(2000).expect("250 * 2^3"), shift: DcShift::Auto }),
        "set-ex-both" => master(M::SetEx { check_commands: true, fill_responses: true }),
        "set-fifo-threshold" => master(M::SetFifo(FifoAction::Threshold(120))),
        "lio-wr" => master(M::LocalWrite(0b10_1010)),
        "sw-reset" => master(M::SoftReset),
        "crc-wrong" => master(M::SetState(MasterState::Init)),
        "drive-mode-csp-1-4-5" => {
            let command = S::DriveMode { mode: Mode::Csp, sync: DriveSync::DcSync };
            [1, 4, 5].map(|slave| (slave, Content::Slave(command.into()))).into()
        }
        "csp-index-7" => slave(1, csp(-1_234_567).with_index(7)),
        "csp-all-40" => (1..=40).map(|n| (n, Content::Slave(csp(n as i32 * 1_000_003 - 20_000_000).into()))).collect(),
        "crc-is-zero" => slave(1, csp(157)),
        "csp-hsp-2ch-16" => {
            let first = AxisTarget { target: -5, outputs: 0x00FF };
            let second = AxisTarget { target: 123_456_789, outputs: 0xAA55 };
            slave(1, S::Csp(Motion { first, second }))
        }
        "io-wr" => slave(2, S::IoWrite(0xA5C3)),
        "go-home-2" => slave(2, S::GoHome),
        "cst-negative" => slave(1, S::Cst(-300)),
        "sv-on-index-255" => slave(40, S::ServoOn.with_index(255)),
        "sdo-wr-6060-homing" => {
            let object = ObjectAddress::new(0x6060, 0);
            vec![(41, Content::Sdo(SdoCommand::Write { slave: 1, object, size: SdoSize::One, value: 6 }))]
        }
        "sdo-rd-603f-16" => {
            vec![(31, Content::Sdo(SdoCommand::Read { slave: 3, object: ObjectAddress::new(0x603F, 0) }))]
        }
        _ => response(name),
    }
}

fn response(name: &str) -> Vec<(usize, Content)> {
    let inputs = |n| (n, Content::Io(IoResponse { head: head(0x13, 0), bits: 0xBEEF }));
    match name {
        "resp-op-fw17" => {
            let drive = drive(head(0x15, 7), 0x1637, -1_234_560, 37, 0);
            vec![in_op(159, 1), (1, drive), inputs(2)]
        }
        "resp-op-fw15" => {
            let drive = drive(head(0x15, 8), 0x9637, -1_234_560, -37, 0xFF10);
            vec![in_op(159, 126), (1, drive), inputs(2)]
        }
        "resp-op-16" => {
            let homed = drive(head(0x18, 1), 0x1437, i32::MAX, 0, 0);
            let aborted = drive(head(0x19, 0), 0x0250, i32::MIN, 0, 0);
            vec![in_op(160, 0), (1, homed), (30, aborted)]
        }
        "resp-hsp-12" => {
            let first = HspAxis { position: 500, inputs: 0x00A5 };
            vec![in_op(160, 0), (1, hsp(head(0x15, 2), first, HspAxis::default()))]
        }
        "resp-hsp-2ch-16" => {
            let first = HspAxis { position: 70_000, inputs: 0x0001 };
            let second = HspAxis { position: -70_000, inputs: 0x8000 };
            vec![in_op(160, 0), (1, hsp(head(0x16, 3), first, second))]
        }
        "resp-sdo-rd" => {
            let (id, object) = (CommandId::SdoRead, ObjectAddress::new(0x6041, 0));
            after_sdo(SdoResponse::Done { id, slave: 3, object, value: 0x0250 })
        }
        "resp-sdo-wr" => {
            let (id, object) = (CommandId::SdoWrite, ObjectAddress::new(0x6060, 0));
            after_sdo(SdoResponse::Done { id, slave: 1, object, value: 6 })
        }
        "resp-sdo-abort" => {
            let (id, object) = (CommandId::SdoRead, ObjectAddress::new(0x5FFF, 0));
            after_sdo(SdoResponse::Aborted { id, slave: 3, object, code: AbortCode::NO_OBJECT })
        }
        "resp-preop-nocrc" => vec![(0, Content::Board(MasterResponse { id: 0x02, result: 5, ..pre_op() }))],
        other => panic!("nothing is said here about the vector {other}"),
    }
}

fn master(command: MasterCommand) -> Vec<(usize, Content)> {
    vec![(0, Content::Master(command))]
}

fn slave(n: usize, command: impl Into<SlotCommand>) -> Vec<(usize, Content)> {
    vec![(n, Content::Slave(command.into()))]
}

fn in_op(fifo_free: u16, full_count: u16) -> (usize, Content) {
    let state = StateByte::reached(MasterState::Op);
    (0, Content::Board(MasterResponse { id: MASTER_CYCLIC, state, fifo_free, full_count, ..MasterResponse::default() }))
}

fn pre_op() -> MasterResponse {
    MasterResponse { state: StateByte::reached(MasterState::PreOp), ..MasterResponse::default() }
}

fn after_sdo(transfer: SdoResponse) -> Vec<(usize, Content)> {
    vec![(0, Content::Board(pre_op())), (41, Content::Transfer(transfer))]
}

fn head(id: u8, index: u8) -> SlaveResponse {
    SlaveResponse { id, index }
}

fn drive(head: SlaveResponse, statusword: u16, position: i32, torque: i16, error_code: u16) -> Content {
    Content::Drive(DriveResponse { head, statusword: Statusword(statusword), position, torque, error_code })
}

fn hsp(head: SlaveResponse, first: HspAxis, second: HspAxis) -> Content {
    Content::Hsp(HspResponse { head, statusword: Statusword(0x1637), first, second })
}
