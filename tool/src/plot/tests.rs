//! Tests how much of a recording is read to draw a section of it.

use clap::Parser;
use support::script_client::Client;

use super::*;

#[derive(Parser)]
struct Command {
    #[command(flatten)]
    args: Args,
}

/// A section of a long recording is drawn by reading the recording twice, up to the end of the section and no further,
/// because the rest may be damaged. Only if nothing can be drawn, it is read to its end. The error then names the whole
/// time in OP.
#[test]
fn a_part_of_a_recording_is_read_once_more_up_to_its_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("long.pcapng");
    let options = format!("clock=virtual&record={}", file.display());
    let mut client = Client::with("drive", "plot_part", &options, "");
    client.op();
    for _ in 0..20_000 {
        client.read();
    }
    client.link.close();
    let plot = |from: &str, to: &str| {
        let file = file.to_str().expect("UTF-8");
        let picture = folder.path().join("part.svg");
        let words = ["plot", file, "--from", from, "--to", to, "-o", picture.to_str().expect("UTF-8")];
        recording::FRAMES_READ.set(0);
        let plotted = sheet(&Command::parse_from(words).args);
        (recording::FRAMES_READ.get(), plotted)
    };
    let all = {
        let mut recording = Frames::open(&file, None, None).expect("a recording");
        recording.walk(i64::MAX, |_| {}).expect("frames").frames
    };
    assert!(all > 20_000, "{all}");
    // Each reading may continue up to a second after the section, and sorting by time reads some frames ahead.
    let most = |seconds: u64| 2 * (all * (seconds + 1) / 20 + 1100 + all / 40);
    for (from, to, seconds) in [("1", "2", 2), ("7.5", "8", 8)] {
        let (read, plotted) = plot(from, to);
        let (sheet, damage) = plotted.expect("a plot");
        assert!(read < most(seconds) && read > all * seconds / 10, "{from} to {to}: {read} of {all}");
        assert!(damage.is_none() && sheet.caption.about.contains(", first "), "{}", sheet.caption.about);
    }
    let error = plot("0", "0.0001").1.err().expect("nothing is in OP").to_string();
    let whole = plot("0", "30").1.expect("all of it").0.caption;
    assert!(!whole.about.contains("first"), "{}", whole.about);
    let end: f64 = whole.about.split(' ').nth(2).and_then(|end| end.parse().ok()).expect("a time");
    assert!(error.contains(&format!(" to {end:.3} s;")), "{error}: {}", whole.about);

    // Frames after the end of the section are not read, so damage there has no effect.
    let bytes = std::fs::read(&file).expect("the recording");
    std::fs::write(&file, &bytes[..bytes.len() / 2 + 7]).expect("half of it");
    assert!(plot("1", "2").1.expect("a plot").1.is_none());
    assert!(plot("1", "12").1.expect("a plot").1.is_some());
}
