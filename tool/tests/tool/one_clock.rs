//! Times of one run: in its script, in its warnings, and in `dump` and `plot` of its recording.

use std::time::Duration;

use crate::common::{json_lines, run};
use ecmsk::sk::DriveResponse;
use support::script_client::Client;

/// `dump` and `plot` count times from the first frame. If the program has waited after it opened the board, they print the time
/// between, because scripts and warnings count from the opening; so an alarm of the script is found at its time. Without a wait
/// they print none.
#[test]
fn times_of_a_recording_and_of_a_script_have_one_zero_or_a_told_offset() {
    let folder = tempfile::tempdir().expect("a folder");
    for (waits_ms, name) in [(2500, "waits"), (0, "at_once")] {
        let file = folder.path().join(name).with_extension("pcapng");
        let file = file.to_str().expect("UTF-8");
        let options = format!("clock=virtual&record={file}");
        let mut client = Client::with("drive", &format!("one_clock_{name}"), &options, "at 4s alarm 1 0x7500\n");
        client.link.pass(Duration::from_millis(waits_ms)).expect("it passes");
        client.op();
        let alarm_ns = client.until("the alarm", |client| DriveResponse::decode(&client.slot(1)).error_code == 0x7500);
        client.link.close();
        assert_eq!(alarm_ns / 1_000_000_000, 4);

        let dump = run(["dump", "--json", file]);
        let frames = json_lines(&dump.out);
        let first = |word: &str| {
            let has = |frame: &&serde_json::Value| frame["direction"] == "response" && frame.to_string().contains(word);
            frames.iter().find(has).and_then(|frame| frame["time_ns"].as_i64()).expect(word)
        };
        assert_eq!(frames[0]["time_ns"], 0);
        let before = dump.err.split("the board was opened ").nth(1).and_then(|rest| rest.split(' ').next());
        assert_eq!(before.is_some(), waits_ms > 0, "{}", dump.err);
        let offset_ms = before.map_or(0.0, |seconds| seconds.parse::<f64>().expect("seconds") * 1000.0);
        let dumped_ms = first("0x7500") as f64 / 1e6;
        assert!((dumped_ms + offset_ms - alarm_ns as f64 / 1e6).abs() <= 2.0, "{dumped_ms} + {offset_ms}, {alarm_ns}");

        let picture = folder.path().join("run.svg");
        let plot = run(["plot", file, "-o", picture.to_str().expect("UTF-8")]);
        assert_eq!((plot.code, plot.err.as_str()), (Some(0), dump.err.as_str()));
        // A time outside OP is an error that names the time of OP.
        let outside = run(["plot", file, "--to", "-1", "-o", picture.to_str().expect("UTF-8")]);
        let op = format!("{:.3} s to ", first("state OP") as f64 / 1e9);
        assert!(outside.code == Some(1) && outside.err.contains(&op), "{op}: {}", outside.err);
    }
}
