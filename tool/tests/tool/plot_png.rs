//! `ecmsk plot`: the file formats of pictures.

use std::io::Cursor;

use crate::common::plots::{Recorded, two_axes};
use crate::common::run;
use crate::common::svg::{COLOURS, Plot};

/// Red, green and blue of `#1F77B4`.
fn rgb(colour: &str) -> [u8; 3] {
    [1, 3, 5].map(|i| u8::from_str_radix(&colour[i..i + 2], 16).expect("a colour"))
}

/// `-o x.png` writes a PNG: twice as many points each way as the page has pixels, with the same lines in it, at the
/// same places, and letters.
#[test]
fn a_png_shows_what_the_svg_shows() {
    let (board, _) = two_axes();
    let recorded = Recorded::new(&board);
    let plot = Plot::parse(&String::from_utf8(recorded.picture("svg", &[])).expect("SVG"));
    let bytes = recorded.picture("PNG", &["--title", "WWWWWWWW"]);
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().expect("a PNG");
    let (width, height) = (reader.info().width, reader.info().height);
    assert_eq!((f64::from(width), f64::from(height)), (2.0 * plot.page.0, 2.0 * plot.page.1));
    let mut points = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut points).expect("points");
    let at = |x: f64, y: f64| {
        let place = (y as usize * width as usize + x as usize) * 3;
        [points[place], points[place + 1], points[place + 2]]
    };
    // Coordinates in the SVG are twice those of the PNG.
    for (axis, colour) in [(1, COLOURS[0]), (2, COLOURS[1])] {
        let line = &plot.panel(&format!("Axis {axis}")).lines(colour, false)[0];
        for (x, y) in line.iter().step_by(line.len() / 20) {
            assert_eq!(at(x / 2.0, y / 2.0), rgb(colour), "axis {axis} at {x}, {y}");
        }
    }
    let dark = |left: u32, top: u32, right: u32, bottom: u32| {
        let points = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
        points.filter(|(x, y)| at(f64::from(*x), f64::from(*y)).iter().all(|part| *part < 0x80)).count()
    };
    // Eight letters W, each of two broad strokes, 17 pixels high.
    let title = dark(40, 20, 400, 70);
    assert!((800..8000).contains(&title), "{title} points are dark in the title");
    assert_eq!(dark(800, 20, 2300, 70), 0, "nothing stands beside it");
}

/// Another ending is refused, by `plot` and by `compare --plot`, with what to do, and nothing is written.
#[test]
fn an_unknown_ending_of_the_picture_is_refused() {
    let (board, _) = two_axes();
    let recorded = Recorded::new(&board);
    let recording = recorded.file.to_str().expect("UTF-8");
    for ending in ["jpg", "pdf", "svgz"] {
        let file = recorded.file.with_extension(ending);
        let name = file.to_str().expect("UTF-8");
        let said = [".svg", ".png", &format!("not as .{ending}")];
        recorded.try_plot(&["-o", name]).expect_failure(1, &said, "make other kinds from SVG");
        run(["compare", recording, recording, "--plot", name]).expect_failure(2, &said, "make other kinds from SVG");
        assert!(!file.exists());
    }
    let bare = recorded.file.with_file_name("bare");
    let name = bare.to_str().expect("UTF-8");
    recorded.try_plot(&["-o", name]).expect_quiet();
    Plot::parse(&std::fs::read_to_string(&bare).expect("a picture"));
}
