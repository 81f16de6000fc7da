//! `ecmsk dump`: prints the frames of a recording, or frames given as hexadecimal digits, as text or JSON.
//!
//! Files:
//!
//! - `dump.rs`: options, and the two sources of frames; `error.rs`: why a dump stopped
//! - `frames.rs`: a frame with its position in the input and its slot size, and which of its slots are shown
//! - `hex.rs`, `direction.rs`: frames from hexadecimal digits, and their direction
//! - `packets.rs`: the recording of an ECM-XF; `packet.rs`: a packet, decoded; `pieces.rs`: packets that were transferred in
//!   parts
//! - `place.rs`: the number, time and direction of a frame or packet
//! - `output_formats.rs`: the formats of the output, with a file for each in `output_formats/`; `slot_json.rs`: slots as JSON

mod direction;
mod error;
mod frames;
mod hex;
mod output_formats;
mod packet;
mod packets;
mod pieces;
mod place;
pub mod slot_json;

use std::collections::BTreeMap;
use std::io::{self, BufRead, Read, Write};
use std::path::PathBuf;
use std::sync::Arc;

use clap::ValueHint;
use ecmsk::engine::Firmware;
use ecmsk::link::Dir;
use ecmsk::recording::{Address, RecordMeta};
use ecmsk::recording::{Kinds, SizeFinder, SizeFrom};
use ecmsk::sk::SlotSize;

use super::error::CliError;
use super::filter::{Command, Slots, TimeOptions, Times};
use super::kind_list::KindList;
use super::output;
use super::recording::{self, Framed, Frames};
use super::slot_size;
use super::stderr::say;
pub use error::DumpError;
use frames::{Shown, View};
use output_formats::Format;
use packet::Packet;
use place::{Place, Time};

/// Show the frames of a recording, or frames given as hexadecimal digits, in words or as JSON
///
/// Only the slots of a frame that are not empty are shown. Responses do not contain the kind of a slave: it is taken
/// from --kinds, else from the SET_AXIS commands that were shown before, else guessed from the fields (`DRIVE?`). For
/// the recording of a chip ECM-XF the packets are shown; --slots, --commands and other options for slots do not apply
/// to them.
#[derive(clap::Args)]
#[command(after_help = "\
Hexadecimal input: one frame a line, 504 to 512 bytes, or one packet of a chip ECM-XF, from a4a3a2a1 to 59585756; blanks do
not count, `#` starts a comment, `>` in front is a frame to the board, `<` one from it. The direction of a line without
either is that of --command or --response, else it is guessed, and the output says so.

Examples:
  ecmsk dump run.pcapng --slots 0,3-5,sdo | less
  ecmsk dump run.pcapng --commands CSP,SET_STATE --direction command --from 1.5s --to 2s
  ecmsk dump run.pcapng --changes --around 6.394
  ecmsk dump run.pcapng --json | jq 'select(.direction == \"response\") | .slots[0].fifo_free_entries'
  xxd -p -c 0 frame.bin | ecmsk dump --hex --command")]
pub struct Args {
    /// The recording (pcapng), as the key `record` of a link writes it, or a capture of usbmon or USBPcap (pcapng, pcap);
    /// `-` is standard input
    #[arg(value_name = "FILE", required_unless_present = "hex", value_hint = ValueHint::FilePath)]
    file: Option<PathBuf>,

    /// Read frames as hexadecimal digits from standard input, one per line; with the recording of a chip, show the
    /// bytes of packets, too
    #[arg(long, conflicts_with_all = ["from", "to", "around"])]
    hex: bool,

    /// Lines without `>` or `<` are frames to the board
    #[arg(long, conflicts_with = "file")]
    command: bool,

    /// Lines without `>` or `<` are frames from the board
    #[arg(long, conflicts_with_all = ["file", "command"])]
    response: bool,

    /// Print one JSON object for each frame, each on a line of its own
    #[arg(long)]
    json: bool,

    /// Show only these slots, even if they are empty: 0 or ecm, N for slave N, sdo for the last; comma list with ranges
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = Slots::parse)]
    slots: Vec<Slots>,

    /// Former name of --slots
    #[arg(long, value_name = "LIST", value_parser = OldSlots::parse, hide = true, conflicts_with = "slots")]
    slot: Vec<OldSlots>,

    /// Show every slot
    #[arg(long, conflicts_with_all = ["slots", "slot"])]
    all: bool,

    /// Show only slots that differ from those of the frame before in the same direction, and no frame without one. The first
    /// frame is shown as a whole. The index of a command and the CRC, which differ in each frame, do not count
    #[arg(long, conflicts_with = "all")]
    changes: bool,

    /// Show only slots with these commands or answers to them, by name, e.g. CSP or SET_STATE; comma list. Frames
    /// without such a slot are left out
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = Command::parse)]
    commands: Vec<Command>,

    /// Show only frames to the board, or only those from it
    #[arg(long, value_name = "command|response", value_parser = direction::parse)]
    direction: Option<Dir>,

    #[command(flatten)]
    times: TimeOptions,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs, else 12]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture, use only this device, by its bus and address, e.g. 1.5
    #[arg(long, value_name = "BUS.ADDRESS", conflicts_with = "hex", value_parser = recording::parse_device)]
    device: Option<Address>,

    #[arg(long, value_name = "LIST", value_parser = KindList::parse, help = KindList::help(
        "What the slaves are, in the order of the network",
        "",
    ))]
    kinds: Option<KindList>,

    /// Firmware of the board, 1.7 or 1.5: with 1.5, byte 1 of a slave's response is its mode [default: from the
    /// recording, else 1.7]
    #[arg(long, value_name = "1.7|1.5", value_parser = firmware)]
    fw: Option<Firmware>,
}

/// The longest line in bytes. It has room for the digits of a frame with blanks between them, and for a long comment. The limit
/// keeps input that is no text from filling the memory. \[OURS]
const LINE_BYTES_MAX: u64 = 64 * 1024;

/// Prints the frames or packets of the input.
pub fn run(args: &Args) -> Result<(), CliError> {
    let frames = match &args.file {
        None => None,
        Some(file) => {
            let (source, name) = recording::source(file)?;
            let (source, of_chip) = packets::look(source, &name)?;
            if of_chip {
                return packets::dump(args, source, &name);
            }
            if args.hex {
                return Err(DumpError::HexOfBoard { name }.into());
            }
            Some(Frames::new(source, &name, args.slot_size, args.device)?)
        }
    };
    let mut printer = Printer::new(args);
    let shown = match frames {
        Some(frames) => dump_recording(args, frames, &mut printer),
        None => dump_hex(args, &mut printer),
    };
    // The output is flushed also after an error, so that the frames before it are shown.
    printer.out.flush()?;
    printer.note_nothing_left();
    shown
}

fn dump_recording(
    args: &Args,
    mut frames: Frames<Box<dyn Read + Send>>,
    printer: &mut Printer,
) -> Result<(), CliError> {
    // The kinds of slaves are known for each board; a capture may have several.
    let mut kinds = BTreeMap::new();
    let mut section: Option<Section> = None;
    for framed in &mut frames {
        let framed = framed?;
        let now = Section { board: framed.board(), meta: framed.meta.clone() };
        if section.as_ref() != Some(&now) {
            printer.section(&now)?;
            section = Some(now);
        }
        let kinds = kinds.entry(framed.board()).or_insert_with(|| Kinds::new(args.kinds.as_ref().map(KindList::kinds)));
        let Framed { number, time_ns, recorded, size, .. } = framed;
        let time = Some(Time { since_start_ns: time_ns, recorded_ns: recorded.at_ns });
        let place = Place { number, time, direction: recorded.dir, guessed: false };
        printer.frame(&Shown { place, size, frame: *recorded.frame }, kinds)?;
    }
    frames.note_zero();
    frames.note_missing();
    match frames.lacks() {
        Some(lacks) => Ok(printer.format.lacks(&mut printer.out, &lacks)?),
        None => Ok(()),
    }
}

fn dump_hex(args: &Args, printer: &mut Printer) -> Result<(), CliError> {
    let direction = match (args.command, args.response) {
        (true, _) => Some(Dir::Write),
        (_, true) => Some(Dir::Read),
        _ => None,
    };
    let mut sizes = SizeFinder::new(args.slot_size);
    let mut kinds = Kinds::new(args.kinds.as_ref().map(KindList::kinds));
    let mut noted = false;
    let mut input = io::stdin().lock();
    let mut bytes = Vec::new();
    for line in 1.. {
        bytes.clear();
        let mut limited = (&mut input).take(LINE_BYTES_MAX + 1);
        match limited.read_until(b'\n', &mut bytes).map_err(DumpError::Input)? as u64 {
            0 => break,
            1..=LINE_BYTES_MAX => {}
            _ => return Err(DumpError::LongLine { line }.into()),
        }
        // A character that is not UTF-8 is no digit, and the error names it.
        let found =
            hex::parse(&String::from_utf8_lossy(&bytes)).map_err(|problem| DumpError::Line { line, problem })?;
        let Some(found) = found else { continue };
        let told = found.direction.or(direction);
        if found.is_of_bytes() && packet::is_packet(&found.bytes) {
            let place = Place::of_line(line, told, || packet::guessed(&found.bytes));
            printer.packet(&Packet { place, bytes: &found.bytes })?;
            continue;
        }
        let len = found.bytes.len();
        let frame = found.frame().map_err(|problem| DumpError::Line { line, problem })?;
        sizes.look(&frame, len);
        let (size, from) = sizes.size_of(&frame, len);
        if len < size.frame_len() {
            return Err(DumpError::TooShort { line, len }.into());
        }
        if from == SizeFrom::Assumed && !std::mem::replace(&mut noted, true) {
            recording::note_assumed(&format!("line {line}"), size);
        }
        let place = Place::of_line(line, told, || direction::guess(&frame));
        printer.frame(&Shown { place, size, frame }, &mut kinds)?;
    }
    Ok(())
}

/// The board that the following frames are from, and its recording. The text output has a heading where this changes.
#[derive(PartialEq, Eq)]
struct Section {
    /// The bus and the device number of the board on USB.
    board: (u16, u8),
    meta: Option<Arc<RecordMeta>>,
}

/// Prints frames, with the filters and the format of the options.
struct Printer {
    out: output::Out,
    format: Box<dyn Format>,
    view: View,
    times: Times,
    direction: Option<Dir>,
    /// The firmware that `--fw` gives, which overrides that of the recording.
    firmware: Option<Firmware>,
    /// The board of the following frames: the bus and the device number on USB.
    board: (u16, u8),
    /// The last frame of each board to the board and from it, with `--changes`.
    before: BTreeMap<((u16, u8), bool), Shown>,
    /// The number of frames read, and of frames printed.
    frames: u64,
    printed: u64,
}

impl Printer {
    fn new(args: &Args) -> Self {
        Self {
            out: output::stdout(),
            format: output_formats::chosen(args),
            view: View {
                slots: args.slots(),
                all: args.all,
                changes: args.changes,
                commands: args.commands.clone(),
                firmware: args.fw.unwrap_or_default(),
            },
            times: args.times.times(),
            direction: args.direction,
            firmware: args.fw,
            board: (0, 0),
            before: BTreeMap::new(),
            frames: 0,
            printed: 0,
        }
    }

    fn section(&mut self, section: &Section) -> Result<(), CliError> {
        let told = recording::firmware(section.meta.as_deref());
        self.view.firmware = self.firmware.or(told).unwrap_or_default();
        self.board = section.board;
        let name = match &section.meta {
            Some(meta) => recording::link_name(meta),
            None => format!("bus {}, device {}", section.board.0, section.board.1),
        };
        Ok(self.format.heading(&mut self.out, &name)?)
    }

    fn frame(&mut self, shown: &Shown, kinds: &mut Kinds) -> Result<(), CliError> {
        if let Some(slot) = self.view.slots.iter().find_map(|slots| slots.missing(shown.size)) {
            return Err(DumpError::NoSlot { slot, size: shown.size }.into());
        }
        self.frames += 1;
        shown.tell(kinds);
        let other_way = self.direction.is_some_and(|direction| direction != shown.place.direction);
        if other_way || shown.place.time.is_some_and(|time| !self.times.contains(time.since_start_ns)) {
            return Ok(());
        }
        let place = (self.board, shown.place.direction == Dir::Write);
        let lines = self.view.lines(shown, self.before.get(&place), kinds);
        if self.view.changes {
            self.before.insert(place, shown.clone());
        }
        if lines.is_empty() && (self.view.changes || !self.view.commands.is_empty()) {
            return Ok(());
        }
        self.printed += 1;
        Ok(self.format.frame(&mut self.out, shown, &lines)?)
    }

    /// Prints a packet of an ECM-XF. Filters by slot and command do not apply, because a packet has no slots.
    fn packet(&mut self, packet: &Packet) -> io::Result<()> {
        self.frames += 1;
        if self.direction.is_none_or(|direction| direction == packet.place.direction) {
            self.printed += 1;
            self.format.packet(&mut self.out, packet)?;
        }
        Ok(())
    }

    /// Prints a note if the filters have left no frame.
    fn note_nothing_left(&self) {
        if self.printed == 0 && self.frames > 0 {
            let frames = self.frames;
            say(
                "note",
                &format_args!("none of {frames} frames is left; change --commands, --direction, --from or --to"),
            );
        }
    }
}

impl Args {
    /// The slots of `--slots`, and of its former name `--slot`.
    fn slots(&self) -> Vec<Slots> {
        if !self.slot.is_empty() {
            slot_size::hint("--slot", "--slots");
        }
        let old = self.slot.iter().flat_map(|OldSlots(slots)| slots);
        self.slots.iter().chain(old).copied().collect()
    }
}

/// The value of `--slot`, which named slots in this verb and the slot size in other verbs. It is accepted only if it
/// cannot be a slot size.
#[derive(Clone, Debug)]
struct OldSlots(Vec<Slots>);

impl OldSlots {
    fn parse(text: &str) -> Result<Self, String> {
        match text.trim() {
            size @ ("12" | "16") => Err(format!(
                "that may be a slot or the slot size; write --slots {size} for the slot of slave {size}, --slot-size {size} for \
                 slots of {size} bytes"
            )),
            text => text.split(',').map(Slots::parse).collect::<Result<_, _>>().map(Self),
        }
    }
}

fn firmware(text: &str) -> Result<Firmware, String> {
    match text {
        "1.7" => Ok(Firmware::V17),
        "1.5" => Ok(Firmware::V15),
        _ => Err("allowed: 1.7, 1.5".to_owned()),
    }
}
