//! The style of the plot: sizes in pixels, colours, and the format of numbers.

use plotters::style::RGBColor;

use crate::visible::is_plain;

/// The number of grid steps per pixel. The drawing library has integer coordinates, so pictures are drawn on a finer
/// grid.
pub const FINE: u32 = 4;

/// Width of the whole picture, in pixels.
pub const WIDTH: u32 = 1200;
/// Height of title and caption, in pixels.
pub const HEAD: u32 = 62;
/// Height of the line with a panel's name and legend, in pixels.
pub const PANEL_HEAD: u32 = 26;
/// Height of the time axis with its numbers and name, in pixels.
pub const TIME_AXIS: u32 = 46;
/// Width of the area at the left with the numbers of the vertical axis, in pixels.
pub const LEFT: u32 = 116;
/// Width of the margin at the right, in pixels.
pub const RIGHT: u32 = 28;

/// Width and height of the diagram that shows the path of two axes in their plane, in pixels.
pub const PLANE: (u32, u32) = (560, 520);
/// Height of the lane of one input or output, in pixels.
pub const LANE: u32 = 18;

/// Size of most texts, in pixels.
pub const TEXT: u32 = 13;
/// Size of texts that are close together, such as the names of lanes, in pixels.
pub const SMALL: u32 = 12;
/// Size of the title, in pixels.
pub const TITLE: u32 = 17;
/// The drawing library divides text sizes by this factor, so they are multiplied by it first.
const TEXT_FACTOR: f64 = 1.24;
/// The mean width of a letter in common sans-serif fonts as a fraction of the text size, with some margin.
const LETTER: f64 = 0.53;

/// The colours of axes, which can be distinguished side by side; none is similar to another or near white.
const COLOURS: [RGBColor; super::MAX_AXES] = [
    RGBColor(0x1F, 0x77, 0xB4),
    RGBColor(0xE6, 0x6A, 0x00),
    RGBColor(0x2C, 0x8C, 0x2C),
    RGBColor(0xA0, 0x4E, 0xC4),
    RGBColor(0x00, 0x9E, 0xA8),
    RGBColor(0x8C, 0x56, 0x4B),
    RGBColor(0xE0, 0x4F, 0xA0),
    RGBColor(0x7A, 0x7F, 0x1A),
];
/// The colour of each axis, chosen by its number, so that an axis has the same colour in all plots. If another axis of the plot
/// has that colour already, the next free one is used.
pub fn colours(axes: impl IntoIterator<Item = u8>) -> Vec<RGBColor> {
    let mut taken = Vec::new();
    for axis in axes {
        let own = usize::from(axis).saturating_sub(1);
        let free =
            (own..own + COLOURS.len()).map(|i| COLOURS[i % COLOURS.len()]).find(|colour| !taken.contains(colour));
        // There are as many colours as axes in a plot, so one is free.
        taken.push(free.unwrap_or(INK));
    }
    taken
}

/// The colour of positions of a second recording.
pub const BESIDE: RGBColor = RGBColor(0x20, 0x20, 0x20);
/// The colour of curves in the FIFO diagram.
pub const FIFO: RGBColor = RGBColor(0x40, 0x50, 0x60);
/// The colour of marks: lost commands, state 0x18, notes on states, the first difference of two recordings, the limits in a
/// picture of `ecmsk migrate`.
pub const ALARM: RGBColor = RGBColor(0xD0, 0x10, 0x20);
/// The background of times in which a drive has a fault.
pub const FAULT: RGBColor = RGBColor(0xF9, 0xCF, 0xD0);
/// The background of times in which a drive is homing.
pub const HOMING: RGBColor = RGBColor(0xFF, 0xEE, 0xB8);
/// The background of times in which a drive is not enabled.
pub const NOT_ENABLED: RGBColor = RGBColor(0xE9, 0xEC, 0xEF);
/// The background of times in which a slave is lost.
pub const LOST: RGBColor = RGBColor(0xB4, 0xBA, 0xC6);
/// The background of times in which the board is in state 0x18.
pub const FAILED: RGBColor = RGBColor(0xFB, 0xC9, 0x8E);
/// The background of gaps: the FIFO was empty during motion.
pub const GAP: RGBColor = RGBColor(0xE3, 0x9B, 0xF5);
/// The colour of the inputs of an IO slave.
pub const INPUT: RGBColor = RGBColor(0x0B, 0x6E, 0x8A);
/// The colour of the outputs of an IO slave.
pub const OUTPUT: RGBColor = RGBColor(0xB8, 0x4A, 0x00);
/// The colour of texts: titles and names.
pub const INK: RGBColor = RGBColor(0x20, 0x24, 0x28);
/// The colour of less important texts: numbers and captions.
pub const SOFT_INK: RGBColor = RGBColor(0x58, 0x60, 0x68);
/// The colour of the frames of panels.
pub const FRAME: RGBColor = RGBColor(0xA8, 0xB0, 0xB8);
/// The colour of the grid lines.
pub const GRID: RGBColor = RGBColor(0xE4, 0xE8, 0xEC);

/// Converts pixels to the drawing's grid.
pub const fn px(pixels: u32) -> u32 {
    pixels * FINE
}

/// Converts pixels to the drawing's grid, as the signed type of coordinates.
pub const fn at(pixels: u32) -> i32 {
    px(pixels) as i32
}

/// Converts a text size in pixels to a text size of the drawing library.
pub fn text_size(pixels: u32) -> f64 {
    f64::from(px(pixels)) * TEXT_FACTOR
}

/// The approximate width of a text in pixels.
pub fn text_width(text: &str, size: u32) -> u32 {
    (text.chars().count() as f64 * f64::from(size) * LETTER).ceil() as u32
}

/// The text with control and other non-printable characters replaced, shortened to fit into `width` pixels.
pub fn fitting(text: &str, size: u32, width: u32) -> String {
    let letters = (f64::from(width) / (f64::from(size) * LETTER)) as usize;
    let clean: Vec<char> = text.chars().map(|c| if c.is_control() || !is_plain(c) { '\u{FFFD}' } else { c }).collect();
    if clean.len() <= letters {
        return clean.into_iter().collect();
    }
    clean[..letters.saturating_sub(1)].iter().chain(&['\u{2026}']).collect()
}

/// A number as text at an axis: digits in groups of three, and no zeros at the end of the decimals.
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let (whole, part) = text.split_once('.').unwrap_or((&text, ""));
    let (sign, whole) = whole.strip_prefix('-').map_or(("", whole), |whole| ("-", whole));
    let mut grouped = String::new();
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && (whole.len() - i).is_multiple_of(3) {
            grouped.push('\u{202F}');
        }
        grouped.push(digit);
    }
    let part = part.trim_end_matches('0');
    let sign = if grouped == "0" && part.is_empty() { "" } else { sign };
    if part.is_empty() { format!("{sign}{grouped}") } else { format!("{sign}{grouped}.{part}") }
}

/// The number of decimals that the numbers at an axis need to differ from each other. `span` is the length of the axis.
pub fn digits(span: f64) -> usize {
    // For example, an axis of length 1 has tick marks 0.1 or 0.05 apart and needs 2 decimals.
    (2.0 - span.max(1e-9).log10().floor()).clamp(0.0, 9.0) as usize
}

/// Numbers as text: `1, 2, 5`.
pub fn list(numbers: &[u8]) -> String {
    numbers.iter().map(u8::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers have groups of thousands, no useless digits after the point, and no negative zero.
    #[test]
    fn numbers_have_groups_of_thousands_and_no_useless_digits() {
        for (value, digits, text) in [
            (0.0, 0, "0"),
            (-0.0, 2, "0"),
            (-0.004, 2, "0"),
            (999.0, 0, "999"),
            (-1000.0, 0, "-1\u{202f}000"),
            (1_234_567.5, 1, "1\u{202f}234\u{202f}567.5"),
            (0.25, 3, "0.25"),
            (100.0, 1, "100"),
        ] {
            assert_eq!(number(value, digits), text);
        }
    }

    /// Neighbouring tick marks of an axis have different numbers, however short the axis is.
    #[test]
    fn numbers_at_an_axis_differ_however_short_the_axis_is() {
        for (span, mark) in [(4_000_000_000.0, 500_000_000.0), (1.0, 0.05), (0.002, 0.0002), (12.0, 1.0)] {
            assert_ne!(number(mark, digits(span)), number(2.0 * mark, digits(span)), "{span}");
        }
    }

    /// An axis has the same colour in every plot, and no two axes of a plot share one.
    #[test]
    fn an_axis_keeps_its_colour_and_no_two_axes_share_one() {
        assert_eq!(colours([3]), [COLOURS[2]]);
        assert_eq!(colours([1, 9, 2]), [COLOURS[0], COLOURS[1], COLOURS[2]]);
    }

    /// A text that is too long is cut, ends with dots, and fits.
    #[test]
    fn text_that_is_too_long_is_cut_with_dots() {
        assert_eq!(fitting("short\n", 10, 1000), "short\u{fffd}");
        let cut = fitting(&"long ".repeat(100), 10, 100);
        assert!(cut.ends_with('\u{2026}') && text_width(&cut, 10) <= 100, "{cut}");
    }
}
