//! The network, slaves, process data, objects, files and mailboxes.

use super::field::{Field, Kind, Names, Place};
use super::rows::rows;
use super::{AnswerFields, FunctionFields};
use crate::xf::EtherCatState;
use crate::xf::request::*;
use crate::xf::value::{Switch, WriteOrRead};
use crate::xf::{NetworkState, Reserve};

/// A slave, or all of them.
const ALL: Names = &[("all", 0xFF)];
/// Reserve bits of ECAT_INIT_OP.
const INIT_BITS: Names = &[("master_shift", Reserve::MASTER_SHIFT.0 as u32), ("lrw", Reserve::LRW.0 as u32)];

pub(super) const fn answer(fields: &'static [Field]) -> AnswerFields {
    AnswerFields { len: None, every: None, fields }
}

pub(super) const DATA: AnswerFields = answer(&[Field::tail("data", 0, Kind::Bytes)]);

const fn slave(place: u16) -> Field {
    Field::at("slave", place, 1)
}

const fn slaves() -> Field {
    Field::par("slaves").kind(Kind::Named(ALL))
}

const fn state() -> Field {
    Field::info("state", 0, 1).one_of(EtherCatState::NAMES)
}

const STATE: AnswerFields = answer(&[
    Field::ret("state").part(0, 4).kind(Kind::Named(EtherCatState::NAMES)),
    Field::ret("error").part(4, 1).one_of(Switch::NAMES),
]);
const _: () = assert!(NetworkState::ERROR == 1 << 4);

const fn assignment() -> Field {
    Field::at("assignment", 2, 2).one_of(PdoAssignment::NAMES)
}

const fn pdo(name: &'static str, at: u16) -> Field {
    Field::at(name, at, 2).hex().or(0)
}

const PDO_CONFIG_3: AnswerFields = AnswerFields {
    len: Some(PdoConfigForm::Three.bytes() as u16),
    every: None,
    fields: &[
        slave(0),
        Field::at("count", 1, 1),
        assignment(),
        pdo("pdo1", 4),
        Field::objects("objects1", 16, 10),
        pdo("pdo2", 6),
        Field::objects("objects2", 48, 12),
        pdo("pdo3", 8),
        Field::objects("objects3", 80, 14),
    ],
};

const PDO_CONFIG_4: AnswerFields = AnswerFields {
    len: Some(PdoConfigForm::Four.bytes() as u16),
    every: None,
    fields: &[
        slave(0),
        Field::at("count", 1, 1),
        assignment(),
        pdo("pdo1", 4),
        Field::objects("objects1", 20, 12),
        pdo("pdo2", 6),
        Field::objects("objects2", 52, 14),
        pdo("pdo3", 8),
        Field::objects("objects3", 84, 16),
        pdo("pdo4", 10),
        Field::objects("objects4", 116, 18),
    ],
};

const fn assign_activate() -> Field {
    Field::at("assign_activate", 2, 2).hex().or(0)
}

const fn sync0() -> Field {
    Field::at("sync0_ns", 4, 4)
}

const fn sync1() -> Field {
    Field::at("sync1_ns", 8, 4).or(0)
}

const fn shift() -> Field {
    Field::at("shift_ns", 12, 4).kind(Kind::Signed).or(0)
}

const fn timeout(at: u16) -> Field {
    Field::at("timeout_us", at, 4).or(1_000_000)
}

const fn operation(at: u16, names: Names) -> Field {
    Field::at("operation", at, 1).one_of(names)
}

const fn data(at: u16) -> Field {
    Field::tail("data", at, Kind::Bytes)
}

const EXCHANGED: AnswerFields =
    answer(&[Field::ret("done").bits(PdoOperation::NAMES), Field::tail("data", 0, Kind::Bytes)]);

#[rustfmt::skip]
pub(super) const ROWS: &[FunctionFields] = rows! {
    InfoUpdate, "asks for a new header and nothing else", [];
    EcatInit, "initialises the network", [
        Field::par("special_slaves").one_of(&[("no", 0), ("yes", 48)]).or(0),
        Field::word("reserve", Place::Reserve).bits(INIT_BITS).or(0),
        Field::at("fifo", 1, 1).one_of(&[("on", 0), ("off", 0x81)]).or(0x81),
        assign_activate(), sync0(), sync1(), shift(),
    ];
    Reconfig, "lays out the chip's memory anew after a change of process data", [];
    InitDc, "initialises the distributed clocks", [];
    PdoWorkingCounterGet, "reads the working counter, or how many slaves count in it", [
        Field::par("which").one_of(WorkingCounterItem::NAMES),
    ] -> answer(&[Field::at("value", 0, 4)]);
    PdoDataFifo<'static>, "moves process data through the FIFOs", [
        Field::par("count"),
        Field::info("operation", 0, 1).bits(PdoOperation::NAMES), data(0),
    ] -> EXCHANGED;
    PdoData<'static>, "moves process data past the FIFOs", [
        Field::info("operation", 0, 1).bits(PdoOperation::NAMES), data(0),
    ] -> EXCHANGED;
    PdoConfigSet, "sets the PDOs of a slave", [
        slave(0), Field::at("count", 1, 1), assignment(),
        pdo("pdo1", 4), Field::objects("objects1", 16, 10),
        pdo("pdo2", 6), Field::objects("objects2", 48, 12),
        pdo("pdo3", 8), Field::objects("objects3", 80, 14),
    ];
    PdoConfigRequest, "has the PDOs of a slave read, for PDO_CONFIG_GET", [slave(0), assignment()];
    SdoRequest<'static>, "reads an object of a slave, for SDO_GET, or writes one", [
        operation(0, WriteOrRead::NAMES), slave(1),
        Field::at("index", 2, 2).hex(), Field::at("sub", 4, 1).or(0),
        Field::at("complete", 5, 1).one_of(Switch::NAMES).or(0),
        Field::at("bytes", 6, 2).counts("data"), timeout(8), data(12),
    ];
    SdoGet, "gives the object that SDO_REQ has read", [] -> DATA;
    StateSet, "brings slaves to a state", [slaves(), state()];
    StateGet, "gives the state of slaves from the chip's memory", [slaves()] -> STATE;
    SlaveInfoGet, "gives an item about a slave", [
        Field::par("slave"), Field::info("item", 0, 1).one_of(SlaveInfoItem::NAMES),
    ] -> answer(&[Field::tail("value", 0, Kind::NumberOrText)]);
    SlaveCountGet, "gives the number of slaves", [] -> answer(&[Field::ret("count")]);
    StateCheck, "brings slaves to a state and reads it back", [slaves(), state()];
    DcSync, "sets other times of the distributed clocks for one slave", [
        Field::at("slaves", 0, 1).kind(Kind::Named(ALL)), assign_activate(), sync0(), sync1(), shift(),
    ];
    StateUpdate, "reads the states of the slaves into the chip's memory", [];
    SdoAbortCodeGet, "gives the abort code of the last SDO transfer", []
        -> answer(&[Field::at("abort", 0, 4).kind(Kind::Abort)]);
    ConfigSyncManager, "sets a sync manager of a slave", [
        slave(0), Field::at("number", 1, 1), Field::at("start", 2, 2).hex(), Field::at("length", 4, 2),
        Field::at("control", 6, 1).hex(), Field::at("activate", 7, 1).hex(),
    ];
    ConfigFmmu, "sets the functions of a slave's FMMUs, without effect", [
        slave(0), Field::at("fmmu0", 1, 1).or(0), Field::at("fmmu1", 2, 1).or(0),
        Field::at("fmmu2", 3, 1).or(0), Field::at("fmmu3", 4, 1).or(0),
    ];
    ConfigMap, "as RECONFIG, for slaves that fall back to their default process data with that", [];
    DirectAssign, "assigns the length of a slave's process data by hand", [
        Field::par("operation").one_of(DirectAssignOperation::NAMES), Field::info("slave", 0, 1),
        Field::info("on", 1, 1).one_of(Switch::NAMES).or(0),
        Field::info("direction", 1, 1).one_of(Direction::NAMES).or(0), Field::info("bytes", 2, 2).or(0),
    ];
    CoeEmergency, "lists the newest emergencies of slaves", [Field::par("count")] -> AnswerFields {
        len: None,
        every: Some(12),
        fields: &[
            Field::at("number", 0, 1).kind(Kind::Named(&[("none", 0xFF)])), slave(1),
            Field::at("running_number", 2, 2), Field::at("code", 4, 2).hex(), Field::at("register", 6, 1).hex(),
            Field::at("data", 7, 5).kind(Kind::Bytes),
        ],
    };
    WkcErrorCountGet, "gives how many working counters in a row were wrong", [] -> answer(&[Field::ret("count")]);
    WkcErrorMaxGet, "gives how many of them are allowed", []
        -> answer(&[Field::ret("limit").kind(Kind::Named(&[("none", 0xFF)]))]);
    WkcErrorMaxSet, "sets how many of them are allowed", [Field::par("limit").kind(Kind::Named(&[("none", 0xFF)]))];
    RawRequest<'static>, "sends an EtherCAT datagram, whose answer is for RAW_ECAT_FUNC_GET", [
        operation(0, RawOperation::NAMES), Field::at("bytes", 2, 2).counts("data"),
        Field::at("adp", 4, 2).hex().or(0), Field::at("ado", 6, 2).hex().or(0), Field::at("logical", 8, 4).hex().or(0),
        timeout(12).kind(Kind::Signed).or(10_000), data(20),
    ];
    RawGet, "gives what came back of the datagram", [] -> answer(&[
        Field::at("operation", 0, 1).kind(Kind::Named(RawOperation::NAMES)), Field::at("adp", 4, 2).hex(),
        Field::at("ado", 6, 2).hex(), Field::at("logical", 8, 4).hex(),
        Field::at("timeout_us", 12, 4).kind(Kind::Signed), Field::at("working_counter", 16, 4).kind(Kind::Signed),
        data(20),
    ]);
    FoeRequest<'static>, "moves a file between a slave and the flash memory, or reads or writes that", [
        operation(2, FoeOperation::NAMES), slave(0).or(0), Field::at("password", 4, 4).hex().or(0),
        Field::at("bytes", 8, 4).counts("data"), timeout(12), Field::at("start", 16, 4).hex(),
        Field::tail("name", 20, Kind::Text), data(20),
    ];
    FoeGet, "gives the part of the flash memory that FOE_FUNC_REQ has read", [] -> DATA;
    EnableLrw, "chooses LRW, or LRD and LWR, for process data", [Field::par("lrw").one_of(Switch::NAMES)];
    ReceiveMailbox, "fetches a slave's mailbox, or gives a part of it", [
        Field::par("operation").one_of(ReceiveMailboxOperation::NAMES), Field::info("slave", 0, 2).or(0),
        Field::info("start", 0, 2).or(0), Field::info("length", 2, 2).or(0),
    ] -> DATA;
    MailboxStatus, "tells which mailboxes are full, or which are polled, or sets that", [
        Field::par("operation").one_of(MailboxStatusOperation::NAMES), Field::tail("slaves", 0, Kind::SlaveSet),
    ] -> answer(&[Field::tail("slaves", 0, Kind::SlaveSet)]);
    PdoConfigGet, "gives what PDO_CONFIG_REQ has read", [] -> PDO_CONFIG_3, PDO_CONFIG_4;
};
