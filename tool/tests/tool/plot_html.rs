//! `ecmsk plot -o run.html`: a recording as one page.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::common::page::{channel, data, hello, points};
use crate::common::plots::{Recorded, two_axes};
use crate::common::{json_lines, run};

/// The limit of the page without its data, in bytes.
const PAGE_MAX: usize = 300_000;

/// Records a run in which two axes move and one of them gets an alarm on the way; returns the path of the recording.
pub fn recorded(folder: &Path) -> PathBuf {
    let script = folder.join("alarm.ecmscript");
    std::fs::write(&script, "at 600ms alarm 2 0x7305\n").expect("a file");
    let file = folder.join("run.pcapng");
    let link = format!("sim:?slaves=drive*2,io&clock=virtual&record={}&script={}", file.display(), script.display());
    let moved = run(["move", "1=10000", "2=-5000", "--up", "--link", &link]);
    assert_eq!(moved.code, Some(1), "the alarm ends the move: {moved:?}");
    file
}

fn page(file: &Path, options: &[&str]) -> String {
    let html = file.with_extension("html");
    let name = html.to_str().expect("UTF-8");
    let said = run([&["plot", file.to_str().expect("UTF-8"), "-o", name], options].concat());
    assert_eq!((said.code, &*said.out), (Some(0), &*format!("{name}\n")), "{said:?}");
    std::fs::read_to_string(&html).expect("a page")
}

/// The page is one file: it has all data, fetches nothing (a content security policy forbids it), and is small without the
/// data.
#[test]
fn a_page_is_one_small_file_that_fetches_nothing() {
    let recorded = Recorded::new(&two_axes().0);
    let html = page(&recorded.file, &[]);
    let without_data = html.replace(data(&html), "");
    assert!(without_data.len() < PAGE_MAX, "{} bytes", without_data.len());
    for text in ["<script src", "<link", "@import", "url(", "\nimport ", "\nexport ", "{{policy", "{{data"] {
        assert!(!without_data.contains(text), "{text}");
    }
    assert!(html.contains("default-src 'none'") && html.contains("connect-src 'none'"));
    assert!(html.contains("Leon Sorokin"), "the licence of the library is in the page");
    assert_eq!(html, page(&recorded.file, &[]), "the same bytes again");
}

/// The page has the positions of the frames, one for each report, as `dump` shows them.
#[test]
fn the_points_are_those_of_the_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = recorded(folder.path());
    let hello = hello(&page(&file, &[]));
    let block = data_encoding::BASE64.decode(hello["block"].as_str().expect("a block").as_bytes()).expect("base64");
    let points = points(&block);
    let positions = &points[&channel(&hello, 1, "position")];
    let dumped = dumped(&file);
    assert!(positions.len() > 100 && dumped.len() > 200, "{} of {}", positions.len(), dumped.len());
    // The page leaves out points inside a run of equal values. So a report without a point of its own has the value of the
    // point before it.
    let mut later = positions.iter().peekable();
    let mut before = None;
    let mut compared = 0;
    for (at_ns, position) in dumped {
        while let Some(point) = later.next_if(|(then, _)| *then <= at_ns) {
            before = Some(*point);
        }
        let Some(shown) = before else { continue };
        assert_eq!(shown.1, position, "at {at_ns} ns");
        compared += 1;
    }
    assert!(compared > 200, "{compared}");
}

/// With `--find` the times that `ecmsk find` prints are among the events of the page. A picture has no list for them.
#[test]
fn times_of_a_condition_are_events_of_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = recorded(folder.path());
    let name = file.to_str().expect("UTF-8");
    for condition in ["alarm(2)", "following_error(1) > 5 and not homing", "fifo < 100"] {
        let out = run(["find", condition, name, "--json"]).expect_quiet();
        let wanted: Vec<i64> = json_lines(&out)
            .iter()
            .map(|line| (line["at_s"].as_f64().expect("seconds") * 1e9).round() as i64)
            .collect();
        let hello = hello(&page(&file, &["--find", condition, "--overwrite"]));
        assert_eq!(hello["find"], condition);
        let events = hello["events"].as_array().expect("a list").iter().filter(|event| event["kind"] == "found");
        let found: Vec<i64> = events
            .map(|event| {
                assert_eq!((&event["text"], &event["slave"]), (&condition.into(), &0.into()));
                event["at_ns"].as_i64().expect("a time")
            })
            .collect();
        assert!(!wanted.is_empty() && found == wanted, "{condition}: {found:?}, not {wanted:?}");
    }
    let wrong = run(["plot", name, "-o", "x.html", "--find", "alarm(2"]);
    wrong.expect_failure(1, &["--find: column 8"], "see `ecmsk find --help`");
    let picture = run(["plot", name, "-o", "x.svg", "--find", "alarm(2)"]);
    picture.expect_failure(1, &["a picture has no list"], "-o FILE.html");
}

/// With `--beside` the page has the positions of another recording too, and the first difference in the words of `compare`.
/// Recordings that are equal have none, and what cannot be compared is said.
#[test]
fn another_recording_is_beside_and_the_first_difference_is_an_event() {
    let folder = tempfile::tempdir().expect("a folder");
    let (alarm, whole) = (recorded(folder.path()), folder.path().join("whole.pcapng"));
    let link = format!("sim:?slaves=drive*2,io&clock=virtual&record={}", whole.display());
    run(["move", "1=10000", "2=-5000", "--up", "--link", &link]).expect_code(0);
    let names = [&alarm, &whole].map(|file| file.to_str().expect("UTF-8"));
    let hello = hello(&page(&alarm, &["--beside", names[1]]));
    let block = data_encoding::BASE64.decode(hello["block"].as_str().expect("a block").as_bytes()).expect("base64");
    let points = points(&block);
    let beside = &points[&channel(&hello, 1, "beside")];
    let last = dumped(&whole).last().copied().expect("a report");
    assert_eq!((beside.last().expect("a point").1, last.1), (10_000, 10_000));
    assert!(beside.last() > points[&channel(&hello, 1, "position")].last(), "it goes on for longer");

    let said: Value = serde_json::from_str(&run(["compare", names[0], names[1], "--json"]).out).expect("JSON");
    let events = hello["events"].as_array().expect("a list");
    let differences: Vec<&Value> = events.iter().filter(|event| event["kind"] == "difference").collect();
    let [difference] = differences[..] else { panic!("{differences:?}") };
    assert_eq!((&difference["at_ns"], &difference["slave"]), (&said["first"]["at_ns"][0], &2.into()));
    let text = difference["text"].as_str().expect("a text");
    let message = said["first"]["message"].as_str().expect("a text");
    assert!(text.contains("whole.pcapng") && text.contains(message), "{text}");

    let same = crate::common::page::hello(&page(&alarm, &["--beside", names[0], "--overwrite"]));
    assert!(same["events"].as_array().expect("a list").iter().all(|event| event["kind"] != "difference"));
    assert!(same["notes"].to_string().contains("no difference between them"), "{}", same["notes"]);
    // The page shows the end of the first recording at first, also if the second one goes on.
    let cut = folder.path().join("cut.pcapng");
    let bytes = std::fs::read(&whole).expect("a file");
    std::fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).expect("it is written");
    let cut = run(["plot", names[0], "-o", &format!("{}.html", names[0]), "--beside", cut.to_str().expect("UTF-8")]);
    cut.expect_code(0);
    assert!(cut.err.contains("cut.pcapng ends in the middle"), "{}", cut.err);
    let noted = run(["plot", names[0], "-o", &format!("{}.html", names[0]), "--panels", "torque"]);
    noted.expect_code(0);
    assert!(noted.err.contains("a page has all diagrams"), "{}", noted.err);
}

/// The position of slave 1 in each report of OP: nanoseconds, counts.
pub fn dumped(file: &Path) -> Vec<(i64, i64)> {
    let out = run(["dump", file.to_str().expect("UTF-8"), "--json", "--direction", "response", "--slots", "0,1"])
        .expect_quiet();
    let frames = json_lines(&out).into_iter().filter(|frame| frame["slots"][0]["state"] == "OP");
    let number = |value: &Value| value.as_i64().expect("a number");
    frames.map(|frame| (number(&frame["time_ns"]), number(&frame["slots"][1]["position_counts"]))).collect()
}

/// The page lists the events of the run in order, with their times, in the words of the tool.
#[test]
fn events_stand_in_words() {
    let folder = tempfile::tempdir().expect("a folder");
    let hello = hello(&page(&recorded(folder.path()), &[]));
    let events = hello["events"].as_array().expect("a list");
    let texts: Vec<(u64, &str)> = events
        .iter()
        .map(|event| (event["slave"].as_u64().expect("a number"), event["text"].as_str().expect("a text")))
        .collect();
    for expected in [(0, "PreOP"), (0, "OP"), (1, "Operation enabled"), (2, "Fault")] {
        assert!(texts.contains(&expected), "{expected:?} is missing in {texts:?}");
    }
    let alarm = texts.iter().find(|(slave, text)| *slave == 2 && text.starts_with("alarm 0x7305: "));
    assert!(alarm.is_some(), "{texts:?}");
    assert!(events.is_sorted_by_key(|event| event["at_ns"].as_i64()));
    let spans = hello["spans"].as_array().expect("a list");
    assert!(spans.iter().any(|span| span["slave"] == 2 && span["state"] == "fault"), "{spans:?}");
}

/// An axis that its drive holds back is an event of the page, where it stands.
#[test]
fn an_axis_that_is_held_back_is_an_event() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("held.pcapng");
    let link = format!("sim:?slaves=drive:limits@-1000..1000&clock=virtual&record={}", file.display());
    assert_eq!(run(["move", "1=5000", "--up", "--link", &link]).code, Some(1));
    let hello = hello(&page(&file, &[]));
    let events = hello["events"].as_array().expect("a list");
    let is_held = |event: &&Value| {
        event["slave"] == 1 && event["text"].as_str().is_some_and(|text| text.starts_with("held back at 10"))
    };
    assert!(events.iter().any(|event| is_held(&event)), "{events:?}");
}

/// The page names axes and units as the machine file does.
#[test]
fn axes_have_their_names_and_units() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = recorded(folder.path());
    let machine = folder.path().join("m.toml");
    std::fs::write(&machine, "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.001 }\n").expect("a file");
    let hello = hello(&page(&file, &["--machine", machine.to_str().expect("UTF-8")]));
    let position = &hello["channels"][channel(&hello, 1, "position")];
    assert_eq!((&position["unit"], &position["factor"]), (&"mm".into(), &0.001.into()));
    assert_eq!(hello["channels"][channel(&hello, 1, "velocity")]["unit"], "mm/s");
    assert_eq!(hello["slaves"][0]["name"], "X");
}

/// A page is not written over its recording, and a range of times outside OP is an error.
#[test]
fn what_cannot_be_shown_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = recorded(folder.path()).with_extension("html");
    std::fs::rename(file.with_extension("pcapng"), &file).expect("it is there");
    let name = file.to_str().expect("UTF-8");
    run(["plot", name, "-o", name]).expect_failure(1, &["would replace the recording"], "-o");
    let other = folder.path().join("other.html");
    let other = other.to_str().expect("UTF-8");
    run(["plot", name, "-o", other, "--from", "99"]).expect_failure(1, &["no time in OP is left"], "--from or --to");
    assert!(!Path::new(other).exists());
}

/// Tests of the page's JavaScript modules, run by Node.js.
mod needs_node {
    use std::process::Command;

    #[test]
    fn the_modules_of_the_page_pass_their_tests() {
        let folder = support::root().join("tool/web/tests");
        let tests: Vec<_> = folder.read_dir().expect("a folder").map(|file| file.expect("a file").path()).collect();
        assert!(!tests.is_empty());
        let said = support::succeed(Command::new("node").arg("--test").args(tests));
        assert!(said.contains("# fail 0") && !said.contains("# pass 0"), "{said}");
    }

    /// The page joins its modules into one. So no two modules may have the same name at their top level.
    #[test]
    fn the_modules_are_one_module() {
        let recorded = super::Recorded::new(&super::two_axes().0);
        let html = super::page(&recorded.file, &[]);
        let (_, script) = html.split_once(r#"<script type="module">"#).expect("the script");
        let file = recorded.file.with_extension("mjs");
        std::fs::write(&file, script.split("</script>").next().expect("its end")).expect("a file");
        support::succeed(Command::new("node").arg("--check").arg(&file));
    }
}
