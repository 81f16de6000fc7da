//! Any frames as a recording, plotted with any words: a picture that is well-formed, has no number that is none and is not
//! larger than all its panels together, or an error that says what is wrong.

#![no_main]

#[path = "support/folder.rs"]
mod folder;
#[path = "support/frames.rs"]
mod frames;

use ecmsk::sk::SlotSize;
use ecmsk_tool::fuzzed;
use folder::Folder;
use libfuzzer_sys::fuzz_target;

/// What recordings say their link is.
const LINKS: [&str; 3] = ["sim:?slaves=drive,io&clock=virtual", "usb:", "sim:?slaves=<&\u{1b}]]>&name=\"'"];
/// The diagrams, by their names.
const PANELS: [&str; 8] = ["position", "velocity", "difference", "torque", "io", "fifo", "xy", "fifo"];
/// Scales of units.
const SCALES: [&str; 6] = ["1", "-0.001", "1e300", "1e-300", "1=5000,2=131072/360", "4294967296"];
/// Times.
const TIMES: [&str; 6] = ["-1", "0", "0.000001", "1", "3600", "1e300"];
/// Pixels: as wide as all plots, and as high as one with everything.
const WIDTH: u32 = 1200;
const HEIGHT_MAX: u32 = 14_000;
/// The highest one that is drawn in pixels too.
const PIXELS_MAX: u32 = 1500;
/// The longest SVG that so few frames may make, bytes.
const SVG_MAX: usize = 8 << 20;

fuzz_target!(|bytes: &[u8]| {
    let Some((&[choice, more, panels, pick], rest)) = bytes.split_first_chunk() else { return };
    let Some((title, rest)) = rest.split_at_checked(8) else { return };
    let size = if choice & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    let frames = frames::frames(rest, size);
    let folder = Folder::make();
    let link = LINKS[usize::from(pick) % LINKS.len()];
    let recording = folder.write("any.pcapng", frames::recording(link, &frames, choice & 2 == 0));
    let mut words = vec![recording.display().to_string(), "-o=any.svg".into()];
    let of = |all: &[&str]| all[usize::from(pick) % all.len()].to_owned();
    let mut say = |said: bool, option: &str, value: String| {
        if said {
            words.push(format!("{option}={value}"));
        }
    };
    say(choice & 4 != 0, "--title", String::from_utf8_lossy(title).into_owned());
    say(choice & 8 != 0, "--xy", "1,2".into());
    say(choice & 16 != 0, "--counts-per-unit", of(&SCALES));
    say(choice & 32 != 0, "--from", of(&TIMES));
    say(choice & 64 != 0, "--to", of(&TIMES));
    say(choice & 128 != 0, "--axes", format!("{}-{}", 1 + pick % 40, 1 + more % 40));
    say(more & 1 != 0 && choice & 16 != 0, "--unit", String::from_utf8_lossy(title).into_owned());
    say(more & 2 != 0, "--commands", "csp,go-home".into());
    let asked = PANELS.iter().enumerate().filter(|(bit, _)| panels >> bit & 1 != 0);
    let asked: Vec<_> = asked.map(|(_, name)| *name).collect();
    say(!asked.is_empty(), "--panels", asked.join(","));
    if more & 4 != 0 {
        words.push("--difference".into());
    }
    let height = match fuzzed::plot(&words) {
        Ok(picture) => check_svg(&String::from_utf8(picture).expect("SVG is text")),
        Err(error) => {
            assert!(!error.is_empty());
            return;
        }
    };
    // What is drawn in pixels takes a hundred times as long: an input of some hundreds, and few of those that are made of it.
    let sum = bytes.iter().fold(0_u32, |sum, byte| sum.wrapping_mul(31).wrapping_add(u32::from(*byte)));
    if sum % 509 == 0 && height <= PIXELS_MAX {
        words[1] = "-o=any.png".into();
        check_png(&fuzzed::plot(&words).expect("what is drawn as SVG is drawn as PNG"), height);
    }
});

/// Gives the height.
fn check_svg(svg: &str) -> u32 {
    assert!(svg.len() <= SVG_MAX, "{} bytes", svg.len());
    let document = roxmltree::Document::parse(svg).unwrap_or_else(|error| panic!("{error}: {svg}"));
    let root = document.root_element();
    let number = |name: &str| root.attribute(name).and_then(|value| value.parse::<u32>().ok());
    assert_eq!(number("width"), Some(WIDTH));
    let height = number("height").expect("a height");
    assert!(height <= HEIGHT_MAX, "{height}");
    for node in root.descendants() {
        for value in node.attributes().map(|attribute| attribute.value()) {
            assert!(!value.contains("NaN") && !value.contains("inf"), "{value}");
        }
        // Numbers at the axes.
        let text = node.text().unwrap_or_default().trim();
        assert!(!["NaN", "inf", "-inf", "-NaN"].contains(&text), "{svg}");
        assert!(!text.contains(|letter: char| letter.is_control() && letter != '\n'), "{text:?}");
    }
    height
}

fn check_png(file: &[u8], height: u32) {
    let reader = png::Decoder::new(std::io::Cursor::new(file)).read_info();
    let mut reader = reader.unwrap_or_else(|error| panic!("{error}"));
    let info = reader.info();
    assert_eq!((info.width, info.height), (2 * WIDTH, 2 * height));
    while reader.next_row().unwrap_or_else(|error| panic!("{error}")).is_some() {}
}
