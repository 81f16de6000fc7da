//! Makes the tables of the Wireshark plugin for frames of a board: names, codes and texts, and the offsets of values in
//! a slot.
//!
//! This file contains no offset as a number. To find the offset of a value, two slots are encoded that differ only in
//! this value; the offset is the first byte that differs.

use ecmsk::cia402::{DriveState, Mode, Statusword, error_name};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::link::slaves;
use ecmsk::sk::{
    Argument, AxisTarget, BOARD_IDS, CommandId, CycleTime, DcShift, DriveResponse, DriveSync, FIFO_ENTRIES, FifoAction,
    Frame, HspAxis, HspResponse, InvalidArgument, IoResponse, MASTER_CYCLIC, MasterCommand, MasterResponse,
    MasterState, Motion, RawSlot, SdoCommand, SdoResponse, SlaveCommand, SlaveKind, SlotCommand, SlotKind, SlotSize,
    StateByte, crc,
};
use serde_json::{Map, Value, json};

use crate::filter::CYCLIC;

/// All tables of the plugin for the frames of a board.
pub fn tables() -> Value {
    let (vendor, product) = BOARD_IDS;
    json!({
        "usb": {"vendor": vendor, "product": product},
        "fifo_entries": FIFO_ENTRIES,
        "crc": {"poly": crc::ALGORITHM.poly, "init": crc::ALGORITHM.init, "at": crc::CRC_BYTE},
        "sizes": SlotSize::ALL.map(size),
        "cyclic": {"code": MASTER_CYCLIC, "name": CYCLIC},
        "commands": by_code(CommandId::ALL.map(|id| (id.code().into(), command(id)))),
        "states": by_code((0..=u8::MAX).filter_map(|code| Some((code.into(), state(StateByte(code))?)))),
        "unknown_state": template(StateByte(0xFF).to_string(), &[("FF", "%02X")]),
        "kinds": by_code((0..16).filter_map(kind)),
        "modes": by_code(modes().map(|mode| (mode.code().into(), mode.name().into()))),
        "statusword": statusword(),
        "error_codes": error_codes(),
        "aborts": by_code(AbortCode::ALL.iter().map(|code| (code.0, code.text().into()))),
        "malformed": malformed(),
        "arguments": arguments(),
        "responses": responses(),
        "head": head(),
    })
}

fn size(size: SlotSize) -> Value {
    json!({"bytes": size.bytes(), "slots": size.slots(), "frame": size.frame_len()})
}

/// The word for a kind of slaves. `nibble` is the 4-bit code of the kind in SET_AXIS.
fn kind(nibble: u8) -> Option<(u32, Value)> {
    SlaveKind::from_nibble(nibble).map(|kind| (nibble.into(), slaves::word(kind).into()))
}

/// All modes of operation that a board uses.
fn modes() -> impl Iterator<Item = Mode> {
    (0..=u8::MAX).filter_map(Mode::from_code)
}

/// A table of values by their codes. The keys are numbers as text; in Lua they become indexes.
pub fn by_code(entries: impl IntoIterator<Item = (u32, Value)>) -> Value {
    Value::Object(entries.into_iter().map(|(code, value)| (code.to_string(), value)).collect())
}

fn command(id: CommandId) -> Value {
    let mut row = Map::from_iter([("name".to_owned(), id.name().into())]);
    for (name, kind) in [("ecm", SlotKind::Master), ("slave", SlotKind::Slave), ("sdo", SlotKind::Sdo)] {
        if id.belongs_in(kind) {
            row.insert(name.to_owned(), true.into());
        }
    }
    if id.is_for_axes() {
        row.insert("axes".to_owned(), true.into());
    }
    if let Some(kind) = id.only_kind() {
        row.insert("only".to_owned(), kind.nibble().into());
    }
    Value::Object(row)
}

/// The texts for a state byte in a response; `None` if the byte is shown only as a number.
fn state(state: StateByte) -> Option<Value> {
    let text = state.to_string();
    let is_named = state.0 == 0 || state.0 == StateByte::FAILED || state.state().is_some();
    let known = state.state().map(MasterState::name);
    is_named.then(|| json!({"text": text, "state": known, "failed": state.is_failed(), "why": state.explanation()}))
}

fn statusword() -> Value {
    let states = (0..=Statusword::STATE_BITS).filter(|word| word & !Statusword::STATE_BITS == 0);
    let states = states.filter_map(|word| Some((u32::from(word), Statusword(word).state()?.name().into())));
    json!({
        "mask": Statusword::STATE_BITS,
        "states": by_code(states),
        "faults": [DriveState::FaultReactionActive.name(), DriveState::Fault.name()],
        "bits": [
            ["fault", Statusword::FAULT], ["voltage_enabled", Statusword::VOLTAGE_ENABLED],
            ["quick_stop", Statusword::QUICK_STOP], ["warning", Statusword::WARNING], ["remote", Statusword::REMOTE],
            ["target_reached", Statusword::TARGET_REACHED], ["internal_limit", Statusword::INTERNAL_LIMIT],
            ["bit12", Statusword::BIT12], ["bit13", Statusword::BIT13],
        ],
    })
}

/// The meanings of error codes, as ranges of codes: first, last, text.
fn error_codes() -> Value {
    let mut ranges: Vec<(u16, u16, &str)> = Vec::new();
    for code in 0..=u16::MAX {
        match ranges.last_mut() {
            Some((_, last, text)) if *text == error_name(code) => *last = code,
            _ => ranges.push((code, code, error_name(code))),
        }
    }
    json!(ranges)
}

/// Turns an error text into a format string of Lua: the sample values in the text are replaced by placeholders.
pub fn template(text: String, samples: &[(&str, &str)]) -> String {
    samples.iter().fold(text.replace('%', "%%"), |text, (sample, placeholder)| text.replace(sample, placeholder))
}

/// Why a command is malformed, in the words of [`InvalidArgument`].
fn malformed() -> Value {
    // A number that no text contains otherwise, so that it can be replaced by a placeholder.
    const SAMPLE: u8 = 77;
    let text = |error: InvalidArgument| template(error.to_string(), &[("77", "%d"), ("0xE", "0x%X")]);
    json!({
        "state": text(InvalidArgument::State(SAMPLE.into())),
        "group": text(InvalidArgument::Group(SAMPLE)),
        "kind": text(InvalidArgument::Kind { slave: SAMPLE, nibble: 0xE }),
        "cycle": text(InvalidArgument::CycleTime(SAMPLE.into())),
        "fifo_action": text(InvalidArgument::FifoAction(SAMPLE)),
        "zero_threshold": text(InvalidArgument::ZeroThreshold),
        "mode": text(InvalidArgument::DriveMode(SAMPLE.into())),
        "sdo_slave": text(InvalidArgument::SdoSlave(SAMPLE.into())),
        "sub": text(InvalidArgument::SubIndex(SAMPLE.into())),
        "sdo_size": text(InvalidArgument::SdoSize(SAMPLE)),
    })
}

/// The offset of a value of `len` bytes in a slot: the first byte in which these two slots differ.
fn place(one: RawSlot, other: RawSlot, len: usize) -> Value {
    json!({"at": first_difference(one, other), "len": len})
}

/// The byte and the bit mask of a value in a slot: the bits in which these two slots differ.
fn bits(one: RawSlot, other: RawSlot) -> Value {
    let at = first_difference(one, other);
    json!({"at": at, "len": 1, "mask": at.map(|at| bytes(one)[at] ^ bytes(other)[at])})
}

fn first_difference(one: RawSlot, other: RawSlot) -> Option<usize> {
    bytes(one).iter().zip(bytes(other)).position(|(one, other)| *one != other)
}

/// The bytes of a 16-byte slot, which has all fields.
fn bytes(slot: RawSlot) -> Vec<u8> {
    let mut frame = Frame::new();
    frame.put(SlotSize::Bytes16, 0, &slot);
    frame.bytes()[..SlotSize::Bytes16.bytes()].to_vec()
}

/// The fields that every slot has, independent of its command or response.
fn head() -> Value {
    json!({
        "id": place(RawSlot::ZERO, RawSlot { id: u8::MAX, ..RawSlot::ZERO }, 1),
        "index": place(RawSlot::ZERO, RawSlot { index: u8::MAX, ..RawSlot::ZERO }, 1),
        "parm": place(RawSlot::ZERO, RawSlot { parm: u16::MAX, ..RawSlot::ZERO }, 2),
        "data1": place(RawSlot::ZERO, RawSlot { data1: u32::MAX, ..RawSlot::ZERO }, 4),
        "data2": place(RawSlot::ZERO, RawSlot { data2: u32::MAX, ..RawSlot::ZERO }, 4),
        "data3": place(RawSlot::ZERO, RawSlot { data3: u32::MAX, ..RawSlot::ZERO }, 4),
    })
}

fn arguments() -> Value {
    let master = |one: MasterCommand, other: MasterCommand, len| place(one.encode(), other.encode(), len);
    let slave = |one: SlaveCommand, other: SlaveCommand, len| {
        let slot = |command: SlaveCommand| SlotCommand::from(command).encode(SlotSize::Bytes16);
        place(slot(one), slot(other), len)
    };
    let axes = |group, kind| MasterCommand::SetAxis { group, kinds: [kind; 8] };
    let dc = |us, shift| MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap_or(CycleTime::DEFAULT), shift };
    let ex = |check_commands, fill_responses| MasterCommand::SetEx { check_commands, fill_responses };
    let threshold = |free| MasterCommand::SetFifo(FifoAction::Threshold(free));
    let mode = |mode, sync| SlaveCommand::DriveMode { mode, sync };
    let clear = MasterCommand::SetFifo(FifoAction::Clear);
    let auto_shifts = [DcShift::Auto, DcShift::AutoHigh].map(|shift| dc(250, shift).encode().data2);
    json!({
        "state": master(MasterCommand::SetState(MasterState::Init), MasterCommand::SetState(MasterState::Op), 4),
        "group": master(axes(0, SlaveKind::None), axes(u8::MAX, SlaveKind::None), 1),
        "last_group": last_group(),
        "kinds": master(axes(0, SlaveKind::Drive), axes(0, SlaveKind::None), 4),
        "cycle": master(dc(250, DcShift::Auto), dc(1000, DcShift::Auto), 4),
        "cycles": by_code((0..=1 << 20).filter_map(CycleTime::from_us).map(|cycle| (cycle.us(), true.into()))),
        "shift": master(dc(250, DcShift::Auto), dc(250, DcShift::AutoHigh), 4),
        "auto_shifts": auto_shifts,
        "check_commands": bits(ex(false, false).encode(), ex(true, false).encode()),
        "fill_responses": bits(ex(false, false).encode(), ex(false, true).encode()),
        "fifo_action": master(clear, threshold(0), 1),
        "fifo_actions": by_code([clear, threshold(1)].map(|command| (command.encode().parm.into(), action(&command)))),
        "threshold": master(threshold(0), threshold(u32::MAX), 4),
        "local_outputs": bits(MasterCommand::LocalWrite(0).encode(), MasterCommand::LocalWrite(u8::MAX).encode()),
        "mode": slave(mode(Mode::Csp, DriveSync::DcSync), mode(Mode::Csv, DriveSync::DcSync), 4),
        "drive_modes": drive_modes(),
        "sync": slave(mode(Mode::Csp, DriveSync::DcSync), mode(Mode::Csp, DriveSync::FreeRun), 4),
        "outputs": slave(SlaveCommand::IoWrite(0), SlaveCommand::IoWrite(u16::MAX), 2),
        "torque": slave(SlaveCommand::Cst(0), SlaveCommand::Cst(-1), 2),
        "motion": motion(slave),
        "sdo": sdo(),
    })
}

/// The highest group of slaves that SET_AXIS of a board accepts; a group has 8 slaves.
fn last_group() -> Option<u8> {
    let axes = |group| MasterCommand::SetAxis { group, kinds: [SlaveKind::None; 8] }.encode();
    (0..=u8::MAX).rev().find(|group| MasterCommand::decode(&axes(*group), SlotSize::Bytes12).is_ok())
}

/// The modes of operation that DRIVE_MODE accepts.
fn drive_modes() -> Value {
    let command = |mode| SlotCommand::from(SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    let takes = |mode: &Mode| {
        let slot = command(*mode).encode(SlotSize::Bytes12);
        SlotCommand::decode(&slot, SlotSize::Bytes12).is_ok()
    };
    by_code(modes().filter(takes).map(|mode| (mode.code().into(), true.into())))
}

/// The name of the action of a command such as SET_FIFO: its first argument that is a name and not a number.
fn action(command: &MasterCommand) -> Value {
    let mut word = None;
    command.arguments(&mut |_, argument| {
        if let Argument::Word(name) = argument {
            word.get_or_insert(name);
        }
    });
    word.into()
}

fn motion(slave: impl Fn(SlaveCommand, SlaveCommand, usize) -> Value) -> Value {
    let zero = AxisTarget::default();
    let (target, outputs) = (AxisTarget { target: -1, ..zero }, AxisTarget { outputs: u16::MAX, ..zero });
    let first = |first, len| {
        slave(SlaveCommand::Csp(Motion::default()), SlaveCommand::Csp(Motion { first, second: zero }), len)
    };
    let second = |second, len| {
        slave(SlaveCommand::Csp(Motion::default()), SlaveCommand::Csp(Motion { first: zero, second }), len)
    };
    json!([
        {"target": first(target, 4), "outputs": first(outputs, 2)},
        {"target": second(target, 4), "outputs": second(outputs, 2)},
    ])
}

fn sdo() -> Value {
    let write = |slave, index, sub, size, value| {
        SdoCommand::Write { slave, object: ObjectAddress::new(index, sub), size, value }.encode()
    };
    let base = write(0, 0, 0, SdoSize::One, 0);
    json!({
        "slave": place(base, write(u8::MAX, 0, 0, SdoSize::One, 0), 1),
        "index": place(base, write(0, u16::MAX, 0, SdoSize::One, 0), 2),
        "sub": place(base, write(0, 0, u8::MAX, SdoSize::One, 0), 2),
        "size": place(base, write(0, 0, 0, SdoSize::Two, 0), 1),
        "sizes": by_code([SdoSize::One, SdoSize::Two, SdoSize::Four].map(|size| (size.bytes().into(), true.into()))),
        "value": place(base, write(0, 0, 0, SdoSize::One, u32::MAX), 4),
    })
}

fn responses() -> Value {
    json!({"master": master_response(), "drive": drive(), "io": io(), "hsp": hsp(), "sdo": sdo_response()})
}

fn master_response() -> Value {
    let base = MasterResponse::default();
    let at = |other: MasterResponse, len| place(base.encode(), other.encode(), len);
    json!({
        "crc_errors": at(MasterResponse { error: u8::MAX, ..base }, 1),
        "state": at(MasterResponse { state: StateByte(u8::MAX), ..base }, 1),
        "result": at(MasterResponse { result: u32::MAX, ..base }, 4),
        "fifo_free": at(MasterResponse { fifo_free: u16::MAX, ..base }, 2),
        "full_count": at(MasterResponse { full_count: u16::MAX, ..base }, 2),
    })
}

fn drive() -> Value {
    let base = DriveResponse::default();
    let at = |other: DriveResponse, len| place(base.encode(), other.encode(), len);
    json!({
        "statusword": at(DriveResponse { statusword: Statusword(u16::MAX), ..base }, 2),
        "position": at(DriveResponse { position: -1, ..base }, 4),
        "torque": at(DriveResponse { torque: -1, ..base }, 2),
        "error_code": at(DriveResponse { error_code: u16::MAX, ..base }, 2),
    })
}

fn io() -> Value {
    let base = IoResponse::default();
    json!({"bits": place(base.encode(), IoResponse { bits: u16::MAX, ..base }.encode(), 2)})
}

fn hsp() -> Value {
    let base = HspResponse::default();
    let at = |other: HspResponse, len| place(base.encode(SlotSize::Bytes16), other.encode(SlotSize::Bytes16), len);
    let (position, inputs) = (HspAxis { position: -1, inputs: 0 }, HspAxis { position: 0, inputs: u16::MAX });
    json!({
        "statusword": at(HspResponse { statusword: Statusword(u16::MAX), ..base }, 2),
        "axes": [
            {
                "position": at(HspResponse { first: position, ..base }, 4),
                "inputs": at(HspResponse { first: inputs, ..base }, 2),
            },
            {
                "position": at(HspResponse { second: position, ..base }, 4),
                "inputs": at(HspResponse { second: inputs, ..base }, 2),
            },
        ],
    })
}

fn sdo_response() -> Value {
    let (id, slave, object) = (CommandId::SdoRead, 0, ObjectAddress::new(0, 0));
    let done = SdoResponse::Done { id, slave, object, value: 0 };
    let aborted = SdoResponse::Aborted { id, slave, object, code: AbortCode(0) };
    json!({"aborted": bits(done.encode(), aborted.encode())})
}
