//! `ecmsk recording info`: shows how long a recording is and what is missing in it.

use std::path::PathBuf;

use clap::ValueHint;
use ecmsk::recording::{Address, Outline, RecordError};
use serde_json::{Value, json};

use super::super::error::CliError;
use super::super::output;
use super::super::recording::{self, Frames, link_name};
use super::RecordingVerbError;
use super::export::Progress;

/// Show the number of frames in a recording, the time that they cover, the size of the file, and what is missing or damaged
///
/// For a recording in blocks (.ecmrec) only its index is read, which is quick for a recording of any length; with --check
/// all frames are read. Other formats have no index and are always read to their end.
#[derive(clap::Args)]
pub struct Args {
    /// The recording or capture
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// Read all frames, to find every missing or damaged one; without this option a recording in blocks is not searched
    #[arg(long)]
    check: bool,

    /// Print the machine file that the recording carries, and nothing else
    #[arg(long, conflicts_with_all = ["check", "json"])]
    machine_file: bool,

    /// In a capture with several boards, use the one at BUS.DEVICE
    #[arg(long, value_name = "BUS.DEVICE", value_parser = recording::parse_device)]
    device: Option<Address>,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The data that `ecmsk recording info` shows for a recording of any format. For a recording in the format .ecmrec, its
/// blocks are shown in addition.
#[derive(Default)]
struct Info {
    frames: u64,
    times_ns: Option<(u64, u64)>,
    link: Option<String>,
    /// What is missing or damaged in the recording, as text. `None` if nothing is known to be missing, or if the frames
    /// were not read.
    lacks: Option<String>,
}

/// Runs `ecmsk recording info`.
///
/// # Errors
/// [`CliError`] if the recording cannot be read or standard output cannot be written to.
pub fn run(args: &Args) -> Result<(), CliError> {
    let carried = recording::carried(&args.file);
    if args.machine_file {
        let none = || RecordingVerbError::NoMachineFile { file: args.file.clone() };
        return Ok(output::print(carried.ok_or_else(none)?.text())?);
    }
    let outline =
        Outline::of(&args.file).map_err(|source| RecordingVerbError::Read { file: args.file.clone(), source })?;
    let size = std::fs::metadata(&args.file).map_or(0, |metadata| metadata.len());
    let info = match &outline {
        Some(outline) if !args.check => Info {
            frames: outline.frames,
            times_ns: outline.times_ns,
            link: first_link(args)?,
            lacks: (outline.ended < outline.recordings).then(|| "the end: the recording was not ended".to_owned()),
        },
        _ => read(args)?,
    };
    let seconds = info.times_ns.map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 / 1e9);
    if args.json {
        let blocks = outline.as_ref().map(blocks_json);
        let object = json!({"file": args.file.display().to_string(), "bytes": size, "frames": info.frames, "seconds": seconds,
            "first_ns": info.times_ns.map(|times| times.0), "last_ns": info.times_ns.map(|times| times.1),
            "link": info.link, "machine": carried.as_ref().map(|file| file.name()), "lacks": info.lacks, "checked": args.check || outline.is_none(), "blocks": blocks});
        return Ok(output::print(format!("{object}\n"))?);
    }
    let per_frame = size as f64 / info.frames.max(1) as f64;
    let mut text = format!(
        "{}: {} frames, {seconds:.3} s, {size} bytes ({per_frame:.1} a frame)\n",
        args.file.display(),
        info.frames
    );
    if let Some(link) = &info.link {
        text += &format!("link: {link}\n");
    }
    if let Some(file) = &carried {
        text += &format!("machine file: {}, --machine-file prints it\n", file.name());
    }
    match &outline {
        Some(Outline { recordings, blocks, pieces, has_index, .. }) => {
            let index = if *has_index { "with an index" } else { "without an index of all of them" };
            let recordings = output::counted(*recordings, "recording");
            text += &format!("blocks: {blocks} and {pieces} pieces in {recordings}, {index}\n");
        }
        None => text += "blocks: none, it is no recording in blocks (.ecmrec)\n",
    }
    match &info.lacks {
        Some(lacks) => text += &format!("lacks: {lacks}\n"),
        None if args.check || outline.is_none() => text += "lacks: nothing is known to be missing\n",
        None => text += "lacks: not looked for; --check reads all frames\n",
    }
    Ok(output::print(text)?)
}

fn blocks_json(outline: &Outline) -> Value {
    let Outline { recordings, ended, blocks, pieces, has_index, .. } = outline;
    json!({"recordings": recordings, "ended": ended, "blocks": blocks, "pieces": pieces, "has_index": has_index})
}

/// The link of the first recording in the file.
fn first_link(args: &Args) -> Result<Option<String>, CliError> {
    let mut frames = Frames::open(&args.file, None, args.device)?.quiet();
    let first = frames.next().transpose()?;
    Ok(first.and_then(|framed| framed.meta.as_deref().map(link_name)))
}

/// Reads all frames to count them, and to find what is missing or damaged.
fn read(args: &Args) -> Result<Info, CliError> {
    let device = recording::board(&args.file, args.device)?;
    let mut frames = Frames::open(&args.file, None, device)?.quiet();
    let mut info = Info::default();
    let mut progress = Progress::new(&args.file);
    let order = frames.in_time().unsorted();
    let walked = frames.try_walk(order, i64::MAX, |framed| {
        let at_ns = framed.recorded.at_ns;
        let (first, last) = info.times_ns.get_or_insert((at_ns, at_ns));
        (*first, *last) = ((*first).min(at_ns), (*last).max(at_ns));
        if info.link.is_none() {
            info.link = framed.meta.as_deref().map(link_name);
        }
        progress.frame(framed);
        Ok::<_, RecordError>(true)
    })?;
    info.frames = walked.frames;
    info.lacks = frames.lacks_with(&walked);
    Ok(info)
}
