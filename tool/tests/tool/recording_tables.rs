//! `ecmsk recording export` to tables: MCAP and Arrow, read back with the readers of their crates; parts of recordings; damaged
//! ones.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int32Type, TimestampNanosecondType, UInt16Type};
use arrow_array::{Array, RecordBatch};
use arrow_ipc::reader::FileReader;
use arrow_schema::{DataType, TimeUnit};
use ecmsk::ecm::{Close, Config, Ecm};
use ecmsk::link::record::RecordingCopy;
use ecmsk::recording::{Lacks, Recorded, Recording};
use ecmsk::sk::{MasterState, SlaveKind, SlotSize};
use mcap::{MessageStream, Summary};
use serde_json::Value;
use support::recorded::{Program, Run};

use crate::common::motion::FakeBoard;
use crate::common::{json_lines, run};

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A recorded program: two drives move, an IO slave gets outputs, drive 2 has an alarm.
fn recorded() -> Run {
    Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }.record()
}

/// Exports the recording to a file beside it with this ending.
fn exported(file: &Path, ending: &str, options: &[&str]) -> PathBuf {
    let out = file.with_extension(ending);
    run([&["recording", "export", text(file), text(&out)], options].concat()).expect_quiet();
    out
}

/// What `ecmsk dump --json` says of a report in OP, and of the commands before it.
struct Report {
    at_ns: u64,
    time_ns: i64,
    slots: Vec<Value>,
    /// The CSP target that was sent last to drive 2.
    target: Option<i32>,
}

/// All reports in OP.
fn reports(file: &Path) -> Vec<Report> {
    let dumped = run(["dump", "--json", "--slots", "0-3", text(file)]);
    let (mut found, mut target) = (Vec::new(), None);
    let mut frames = json_lines(&dumped.out);
    // In the file a report stands behind commands that were sent before it was read.
    frames.sort_by_key(|frame| frame["time_ns"].as_i64());
    for frame in frames {
        let slots = frame["slots"].as_array().expect("slots").clone();
        if frame["direction"] == "command" {
            if slots[2]["id"] == "CSP" {
                target = Some(slots[2]["raw"]["data1"].as_u64().expect("a number") as u32 as i32);
            }
        } else if slots[0]["state_code"] == 8 {
            let at_ns = frame["recorded_ns"].as_u64().expect("a time");
            found.push(Report { at_ns, time_ns: frame["time_ns"].as_i64().expect("a time"), slots, target });
        }
    }
    assert!(found.len() > 300 && target.is_some());
    found
}

/// The messages of each channel of an MCAP file, with their times.
fn messages(file: &Path) -> BTreeMap<String, Vec<(u64, Value)>> {
    let bytes = fs::read(file).expect("a file");
    let mut found: BTreeMap<String, Vec<(u64, Value)>> = BTreeMap::new();
    for message in MessageStream::new(&bytes).expect("MCAP") {
        let message = message.expect("whole");
        assert_eq!((&*message.channel.message_encoding, message.publish_time), ("json", message.log_time));
        let schema = message.channel.schema.as_ref().expect("a schema");
        assert_eq!(schema.encoding, "jsonschema");
        let schema: Value = serde_json::from_slice(&schema.data).expect("JSON");
        let value: Value = serde_json::from_slice(&message.data).expect("JSON");
        let known = schema["properties"].as_object().expect("an object");
        assert!(value.as_object().expect("an object").keys().all(|name| known.contains_key(name)), "{value}");
        found.entry(message.channel.topic.clone()).or_default().push((message.log_time, value));
    }
    found
}

/// The batches of an Arrow file, and what is said at its end.
fn batches(file: &Path) -> (Vec<RecordBatch>, Option<String>) {
    let reader = FileReader::try_new(File::open(file).expect("a file"), None).expect("Arrow");
    let lacks = reader.custom_metadata().get("lacks").cloned();
    (reader.map(|batch| batch.expect("whole")).collect(), lacks)
}

/// An MCAP file has a channel for the board and each slave, with the values that `dump` shows, at the times of the recording.
#[test]
fn mcap_has_the_reports() {
    let whole = recorded();
    let file = exported(&whole.file, "mcap", &[]);
    let messages = messages(&file);
    assert_eq!(messages.keys().collect::<Vec<_>>(), ["/axis/1", "/axis/2", "/board", "/io/3"]);
    let reports = reports(&whole.file);
    assert!(messages.values().all(|of_channel| of_channel.len() == reports.len()));
    for (n, report) in reports.iter().enumerate() {
        let [board, axis, io] = ["/board", "/axis/2", "/io/3"].map(|channel| &messages[channel][n]);
        assert!([board, axis, io].iter().all(|(at_ns, _)| *at_ns == report.at_ns), "{n}");
        let slot = &report.slots[0];
        let of_board = ["fifo_free_entries", "full_count", "crc_errors", "state_code"].map(|name| &slot[name]);
        assert_eq!(["fifo_free", "full_count", "crc_errors", "state"].map(|name| &board.1[name]), of_board);
        let slot = &report.slots[2];
        let of_axis = ["position_counts", "statusword", "error_code"].map(|name| &slot[name]);
        assert_eq!(["position", "statusword", "error_code"].map(|name| &axis.1[name]), of_axis, "{n}");
        assert_eq!(axis.1["target"].as_i64(), report.target.map(i64::from), "{n}");
        let torque = slot["torque_permille"].as_f64().expect("a number");
        assert_eq!(axis.1["torque_percent"].as_f64(), Some(torque / 10.0), "{n}");
        let bits = report.slots[3].get("outputs").unwrap_or(&report.slots[3]["inputs"]);
        assert_eq!(&io.1["bits"], bits, "{n}");
    }
    let bytes = fs::read(&file).expect("a file");
    let summary = Summary::read(&bytes).expect("MCAP").expect("a summary");
    let stats = summary.stats.as_ref().expect("numbers");
    assert_eq!(stats.message_count, 4 * reports.len() as u64);
    assert!(summary.chunk_indexes.iter().all(|chunk| chunk.compression == "zstd"));
    // A part of the slaves.
    let one = exported(&whole.file, "mcap", &["--axes", "1", "--overwrite"]);
    assert_eq!(self::messages(&one).keys().collect::<Vec<_>>(), ["/axis/1", "/board"]);
}

/// An Arrow file has the columns of the CSV table with types, and the values that `dump` shows.
#[test]
fn arrow_has_the_reports() {
    let whole = recorded();
    let file = exported(&whole.file, "arrow", &[]);
    let (batches, lacks) = batches(&file);
    assert_eq!(lacks, None);
    let schema = batches[0].schema();
    assert_eq!(schema.metadata().get("clock").map(|clock| &**clock), Some("virtual"));
    assert_eq!(schema.field(0).data_type(), &DataType::Timestamp(TimeUnit::Nanosecond, None));
    let names: Vec<&str> = schema.fields().iter().skip(1).map(|field| field.name().as_str()).collect();
    let csv = fs::read_to_string(exported(&whole.file, "csv", &[])).expect("a table");
    assert_eq!(names.join(","), csv.lines().next().expect("names"));

    let reports = reports(&whole.file);
    let mut rows = reports.iter();
    for batch in &batches {
        let column = |name: &str| batch.column_by_name(name).unwrap_or_else(|| panic!("{name}"));
        for row in 0..batch.num_rows() {
            let report = rows.next().expect("as many reports");
            assert_eq!(column("time").as_primitive::<TimestampNanosecondType>().value(row) as u64, report.at_ns);
            assert_eq!(column("time_s").as_primitive::<Float64Type>().value(row), report.time_ns as f64 / 1e9);
            let target = column("2_target").as_primitive::<Int32Type>();
            assert_eq!(target.is_valid(row).then(|| target.value(row)), report.target);
            let position = column("2_position").as_primitive::<Int32Type>().value(row);
            assert_eq!(report.slots[2]["position_counts"], position);
            let torque = column("2_torque_percent").as_primitive::<Float64Type>().value(row);
            assert_eq!(report.slots[2]["torque_permille"], (torque * 10.0).round() as i64);
            let number = |name: &str| column(name).as_primitive::<UInt16Type>().value(row);
            assert_eq!(report.slots[2]["statusword"], number("2_statusword"));
            assert_eq!(report.slots[2]["error_code"], number("2_error_code"));
            assert_eq!(report.slots[0]["fifo_free_entries"], number("fifo_free"));
        }
    }
    assert!(rows.next().is_none());
}

/// `--from` and `--to` select a part: of a table its rows, of a copy its frames with the settings of the board before them.
#[test]
fn a_part_is_exported() {
    let whole = recorded();
    let times = ["--from", "0.5", "--to", "0.6", "--overwrite"];
    let all = reports(&whole.file);
    let within = all.iter().filter(|report| (500_000_000..=600_000_000).contains(&report.time_ns));
    let expected: Vec<u64> = within.map(|report| report.at_ns).collect();
    assert!(expected.len() > 90 && expected.len() < 110, "{}", expected.len());
    let blocks = exported(&whole.file, "ecmrec", &[]);
    for source in [&whole.file, &blocks] {
        let mcap = exported(source, "mcap", &times);
        let found: Vec<u64> = messages(&mcap)["/board"].iter().map(|(at_ns, _)| *at_ns).collect();
        assert_eq!(found, expected, "{}", source.display());
        let (batches, _) = batches(&exported(source, "feather", &times));
        assert_eq!(batches.iter().map(RecordBatch::num_rows).sum::<usize>(), expected.len());
        let csv = fs::read_to_string(exported(source, "csv", &times)).expect("a table");
        assert_eq!(csv.lines().count(), expected.len() + 1);

        let part = source.with_file_name("part.ecmrec");
        run([&["recording", "export", text(source), text(&part)], &times[..]].concat()).expect_quiet();
        let frames: Vec<Recorded> =
            Recording::open(&part).expect("a recording").map(|frame| frame.expect("whole")).collect();
        let (first, last) = (frames[0].at_ns, frames[frames.len() - 1].at_ns);
        // SET_AXIS stands 64 cycles before its beginning: without it nobody knows what the slaves are.
        assert!(last - first <= 164_000_000, "{first} to {last}");
        let dump = run(["dump", text(&part), "--to", "0.499"]).out;
        assert!(dump.contains("SET_AXIS group 0: 1 DRIVE, 2 DRIVE, 3 IO") && dump.contains("SET_DC 1000 us"), "{dump}");
        assert_eq!(reports_of_part(&part), expected.len());
    }
    let none = ["--from", "9999", "--overwrite"];
    for (ending, next) in [("mcap", "`ecmsk dump` shows its frames"), ("pcapng", "says how long it is")] {
        let out = whole.file.with_file_name(format!("none.{ending}"));
        let ran = run([&["recording", "export", text(&whole.file), text(&out)], &none[..]].concat());
        ran.expect_failure(1, &["run.pcapng", "asked for 9999 s and later"], next);
        assert!(!out.exists(), "{ending}");
    }
}

fn reports_of_part(file: &Path) -> usize {
    let dumped = json_lines(&run(["dump", "--json", "--slots", "0", text(file)]).out);
    dumped.iter().filter(|frame| frame["direction"] == "response").count()
}

/// A damaged recording and a cut one are exported as far as they can be read, and the table says what is missing.
#[test]
fn what_is_there_of_a_damaged_recording_is_exported() {
    let whole = recorded();
    let blocks = exported(&whole.file, "ecmrec", &[]);
    let mut bytes = fs::read(&blocks).expect("a file");
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|at| bytes[*at..].starts_with(b"\x89ECMREC\n")).collect();
    // The first block of frames stays whole.
    bytes[places[2] + 100] ^= 1;
    fs::write(&blocks, bytes).expect("a file");
    let cut = whole.file.with_file_name("cut.pcapng");
    let bytes = fs::read(&whole.file).expect("a file");
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).expect("a file");

    let all = reports(&whole.file);
    for (source, words) in [(&blocks, "damaged, and not read"), (&cut, "ends in the middle")] {
        let export = |ending: &str| {
            let out = source.with_extension(ending);
            let ran = run(["recording", "export", text(source), text(&out)]);
            assert!(ran.code == Some(0) && ran.err.contains(words), "{ran:?}");
            out
        };
        let (batches, lacks) = batches(&export("arrow"));
        let times = batches.iter().flat_map(|batch| batch.column(0).as_primitive::<TimestampNanosecondType>().values());
        let times: Vec<u64> = times.map(|at_ns| *at_ns as u64).collect();
        assert!(times.len() > 100 && times.len() < all.len(), "{}", times.len());
        assert!(times.iter().all(|at_ns| all.iter().any(|report| report.at_ns == *at_ns)));
        assert!(lacks.expect("it is said").contains(words));
        let mcap = export("mcap");
        assert_eq!(messages(&mcap)["/board"].len(), times.len());
        let bytes = fs::read(&mcap).expect("a file");
        let summary = Summary::read(&bytes).expect("MCAP").expect("a summary");
        assert_eq!(summary.metadata_indexes.len(), 2, "of the recording, and of what it lacks");
        assert_eq!(fs::read_to_string(export("csv")).expect("a table").lines().count(), times.len() + 1);
        let copy = export(if *source == blocks { "pcapng2.pcapng" } else { "ecmrec" });
        assert!(run(["summary", text(&copy)]).err.contains("frames are missing") || *source == cut);
        assert!(run(["summary", "--exit-code", text(&copy)]).code == Some(1));
    }
}

/// Files of boards with other slots and other slaves are joined: the columns are those of the first board, and values that
/// the second one does not have are unknown.
#[test]
fn joined_recordings_keep_the_columns_of_the_first() {
    let folder = tempfile::tempdir().expect("a folder");
    let joined = folder.path().join("joined.ecmrec");
    let mut bytes = Vec::new();
    for (size, axes) in [(SlotSize::Bytes12, 40), (SlotSize::Bytes16, 2)] {
        let mut board = FakeBoard::of_kind(size, axes, SlaveKind::Drive);
        for cycle in 1..=50 {
            board.send(&vec![10 * cycle; axes]);
            board.cycle();
        }
        let file = folder.path().join(format!("{axes}.ecmrec"));
        board.script.record(&file, "sim:?clock=virtual", Some(size));
        bytes.extend(fs::read(file).expect("a file"));
    }
    fs::write(&joined, bytes).expect("a file");
    let out = joined.with_extension("arrow");
    let ran = run(["recording", "export", text(&joined), text(&out)]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let (batches, _) = batches(&out);
    let last = batches.last().expect("a batch");
    let value = |name: &str| {
        let column = last.column_by_name(name).expect("a column").as_primitive::<Int32Type>();
        column.is_valid(last.num_rows() - 1).then(|| column.value(last.num_rows() - 1))
    };
    assert!(value("2_position").is_some() && value("40_position").is_none());
}

/// A long recording is exported with little memory: the system would end a program that takes more than 32 MB, half of what
/// is promised.
#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_the_recording() {
    const AXES: u8 = 40;
    let folder = tempfile::tempdir().expect("a folder");
    let (short, long) = (folder.path().join("short.ecmrec"), folder.path().join("long.ecmrec"));
    let link = format!("sim:?slaves=drive*{AXES}&clock=virtual&record={}", short.display());
    let ecm = Ecm::open(&link).expect("a board");
    ecm.configure(&Config::drives(AXES.into())).expect("drives");
    ecm.set_state(MasterState::Op).expect("OP");
    ecm.servo_on(&(1..=AXES).collect::<Vec<_>>()).expect("on");
    let mut stream = ecm.stream(8).expect("a stream");
    for cycle in 0..1000 {
        (1..=AXES).for_each(|axis| stream.csp(axis, cycle * i32::from(axis)).expect("it is sent"));
        stream.step().expect("a report");
    }
    stream.finish().expect("it stands");
    ecm.close(Close::ServoOff).expect("closed");

    let mut recording = Recording::open(&short).expect("a recording");
    let frames: Vec<Recorded> = recording.by_ref().map(|frame| frame.expect("whole")).collect();
    let mut copy = RecordingCopy::new(&long, recording.meta().expect("its metadata"));
    let length = frames[frames.len() - 1].at_ns - frames[0].at_ns + 1_000_000;
    for time in 0..25 {
        for frame in &frames {
            copy.add(&Recorded { at_ns: frame.at_ns + time * length, ..frame.clone() }).expect("room on the disk");
        }
    }
    copy.end(&Lacks::default()).expect("room on the disk");
    for ending in ["mcap", "arrow"] {
        let out = long.with_extension(ending);
        let script = "ulimit -d 32768; exec \"$0\" recording export \"$1\" \"$2\"";
        let tool = env!("CARGO_BIN_EXE_ecmsk");
        let ran = std::process::Command::new("sh").args(["-c", script, tool, text(&long), text(&out)]).output();
        let ran = crate::common::Ran::from(ran.expect("sh starts"));
        assert_eq!(ran.code, Some(0), "{ran:?}");
        let rows: usize =
            ran.out.rsplit(": ").next().and_then(|rows| rows.split(' ').next()?.parse().ok()).expect("rows");
        assert!(rows > 25_000, "{rows}");
    }
}
