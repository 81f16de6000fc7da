//! Reads a plot as a person does: finds panels by their names and lines by their colours, and converts coordinates to
//! values by the numbers at the axes.

/// Colours of axes 1 to 8, in the plot of all of them.
pub const COLOURS: [&str; 8] = ["#1F77B4", "#E66A00", "#2C8C2C", "#A04EC4", "#009EA8", "#8C564B", "#E04FA0", "#7A7F1A"];
/// The colour of marks for lost commands, alarms and other notes.
pub const ALARM: &str = "#D01020";
/// Colour of the areas in which the FIFO was empty during motion.
pub const GAP: &str = "#E39BF5";
/// Colours of the curves of inputs and of outputs.
pub const IN_OUT: [&str; 2] = ["#0B6E8A", "#B84A00"];
/// Colours of the areas in which a drive has a fault, is homing, is not enabled.
pub const STATES: [&str; 3] = ["#F9CFD0", "#FFEEB8", "#E9ECEF"];
/// Colour of the numbers at the axes.
const SOFT_INK: &str = "#586068";
/// Colour of the FIFO's level.
pub const FIFO: &str = "#405060";

/// A text of the picture.
#[derive(Clone, Debug)]
pub struct Label {
    pub text: String,
    pub x: f64,
    pub y: f64,
    /// The distance from `y` down to the baseline of the letters.
    pub baseline: f64,
    /// `start`, `middle` or `end`: which part of the text is at `x`.
    pub anchor: String,
    pub size: f64,
    /// The colour. A dark text is a name, a pale one a number or a caption.
    pub colour: String,
}

impl Label {
    /// The box around the text: left, top, right, bottom. The width is estimated with broad letters.
    fn place(&self) -> (f64, f64, f64, f64) {
        let width = self.text.chars().count() as f64 * self.size * 0.55;
        let baseline = self.y + self.baseline;
        let left = match self.anchor.as_str() {
            "start" => self.x,
            "middle" => self.x - width / 2.0,
            _ => self.x - width,
        };
        (left, baseline - 0.75 * self.size, left + width, baseline + 0.22 * self.size)
    }
}

/// Converts a distance such as `0.76em` or `-0.5ex` to a fraction of the text size. The height of an x (`ex`) is about half of
/// the size.
fn shift(text: &str) -> f64 {
    let (number, unit) = text.split_at(text.len().saturating_sub(2));
    let number: f64 = number.parse().expect("a number with a unit");
    if unit == "ex" { number / 2.0 } else { number }
}

/// A line of the picture.
#[derive(Clone, Debug)]
pub struct Line {
    pub colour: String,
    pub pale: bool,
    pub points: Vec<(f64, f64)>,
}

/// An area of the picture: left, top, right, bottom.
#[derive(Clone, Debug)]
pub struct Area {
    pub colour: String,
    pub place: (f64, f64, f64, f64),
}

/// A plot that was read from an SVG: its texts, lines and areas.
pub struct Plot {
    pub size: (f64, f64),
    /// Width and height of the picture on a page, in pixels; `size` is that of its finer grid.
    pub page: (f64, f64),
    pub labels: Vec<Label>,
    pub lines: Vec<Line>,
    pub areas: Vec<Area>,
}

impl Plot {
    /// # Panics
    /// If it is no well-formed SVG.
    pub fn parse(svg: &str) -> Self {
        let document = roxmltree::Document::parse(svg).expect("well-formed XML");
        let root = document.root_element();
        assert_eq!((root.tag_name().name(), root.tag_name().namespace()), ("svg", Some("http://www.w3.org/2000/svg")));
        let number = |node: roxmltree::Node<'_, '_>, name: &str| -> f64 {
            node.attribute(name).and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{name} is a number"))
        };
        let view: Vec<f64> = root.attribute("viewBox").expect("a view").split(' ').flat_map(str::parse).collect();
        let mut plot = Self {
            size: (view[2], view[3]),
            page: (number(root, "width"), number(root, "height")),
            labels: Vec::new(),
            lines: Vec::new(),
            areas: Vec::new(),
        };
        for node in root.children().filter(|node| node.is_element()) {
            let colour = |name: &str| node.attribute(name).unwrap_or_default().to_owned();
            match node.tag_name().name() {
                "text" => plot.labels.push(Label {
                    text: node.text().unwrap_or_default().trim().to_owned(),
                    x: number(node, "x"),
                    y: number(node, "y"),
                    baseline: shift(&colour("dy")) * number(node, "font-size"),
                    anchor: colour("text-anchor"),
                    size: number(node, "font-size"),
                    colour: colour("fill"),
                }),
                "polyline" => {
                    let points = node.attribute("points").expect("points").split_whitespace();
                    let point = |text: &str| {
                        let (x, y) = text.split_once(',').expect("x,y");
                        (x.parse().expect("a number"), y.parse().expect("a number"))
                    };
                    let points = points.map(point).collect();
                    plot.lines.push(Line { colour: colour("stroke"), pale: number(node, "opacity") < 1.0, points });
                }
                "line" => plot.lines.push(Line {
                    colour: colour("stroke"),
                    pale: number(node, "opacity") < 1.0,
                    points: vec![(number(node, "x1"), number(node, "y1")), (number(node, "x2"), number(node, "y2"))],
                }),
                // A piece of a curve with a single sample is drawn as a circle.
                "circle" => plot.lines.push(Line {
                    colour: colour("fill"),
                    pale: number(node, "opacity") < 1.0,
                    points: vec![(number(node, "cx"), number(node, "cy"))],
                }),
                "rect" => {
                    let (left, top) = (number(node, "x"), number(node, "y"));
                    let place = (left, top, left + number(node, "width"), top + number(node, "height"));
                    plot.areas.push(Area { colour: colour("fill"), place });
                }
                other => panic!("<{other}> in a plot"),
            }
        }
        plot
    }

    /// Asserts that no label is cut by the edge of the picture, and that no two labels overlap.
    ///
    /// # Panics
    /// If one is, or two do.
    pub fn assert_labels_are_readable(&self) {
        for (i, label) in self.labels.iter().enumerate() {
            let (left, top, right, bottom) = label.place();
            assert!(left >= 0.0 && top >= 0.0 && right <= self.size.0 && bottom <= self.size.1, "{label:?} is cut");
            for other in &self.labels[i + 1..] {
                let (l, t, r, b) = other.place();
                assert!(right <= l || r <= left || bottom <= t || b <= top, "{label:?}\n{other:?}");
            }
        }
    }

    /// All texts.
    pub fn texts(&self) -> Vec<&str> {
        self.labels.iter().map(|label| label.text.as_str()).collect()
    }

    /// The panel with the name `name`.
    ///
    /// # Panics
    /// If there is none.
    pub fn panel(&self, name: &str) -> Panel<'_> {
        let heads: Vec<&Label> =
            self.labels.iter().filter(|label| PANELS.iter().any(|start| label.text.starts_with(start))).collect();
        let i = heads.iter().position(|head| head.text.starts_with(name));
        let i = i.unwrap_or_else(|| panic!("no panel `{name}` in {:?}", self.texts()));
        let top = heads[i].y + 0.6 * heads[i].size;
        let bottom = heads.get(i + 1).map_or(self.size.1, |next| next.y - 0.6 * next.size);
        Panel { plot: self, name: name.to_owned(), top, bottom }
    }

    /// Names of the panels, from top to bottom.
    pub fn panel_names(&self) -> Vec<&str> {
        self.texts().into_iter().filter(|text| PANELS.iter().any(|start| text.starts_with(start))).collect()
    }
}

/// The beginnings of the names of all panels.
const PANELS: [&str; 10] = [
    "Axis ",
    "Torque ",
    "FIFO:",
    "Following ",
    "Difference:",
    "Target velocity",
    "Velocity ",
    "IO ",
    "Plane ",
    "Pauses ",
];

/// One diagram of a plot: its name, and its top and bottom in the coordinates of the picture.
pub struct Panel<'a> {
    plot: &'a Plot,
    name: String,
    top: f64,
    bottom: f64,
}

impl Panel<'_> {
    /// The samples of all pieces of a curve, as seconds and values that are read at the axes. `pale` chooses the curve of the
    /// commanded values.
    ///
    /// # Panics
    /// If the axes cannot be read.
    pub fn samples(&self, colour: &str, pale: bool) -> Vec<(f64, f64)> {
        let (seconds, value) = (self.seconds(), self.values());
        self.lines(colour, pale).into_iter().flatten().map(|(x, y)| (seconds(x), value(y))).collect()
    }

    /// The value of a curve at a time, interpolated between the two samples around it.
    ///
    /// # Panics
    /// If the curve has no samples around this time.
    pub fn at(&self, colour: &str, pale: bool, seconds: f64) -> f64 {
        let samples = self.samples(colour, pale);
        let around = samples.windows(2).find(|pair| pair[0].0 <= seconds && seconds <= pair[1].0);
        let [(t0, v0), (t1, v1)] = around.unwrap_or_else(|| panic!("{}: nothing at {seconds} s", self.name)) else {
            unreachable!("windows of two")
        };
        if t1 == t0 { *v0 } else { v0 + (v1 - v0) * (seconds - t0) / (t1 - t0) }
    }

    /// The pieces of a curve, in the coordinates of the picture.
    pub fn lines(&self, colour: &str, pale: bool) -> Vec<Vec<(f64, f64)>> {
        let ours = |line: &&Line| {
            line.colour == colour
                && line.pale == pale
                && line.points.iter().all(|(_, y)| (self.top..self.bottom).contains(y))
        };
        self.plot.lines.iter().filter(ours).map(|line| line.points.clone()).collect()
    }

    /// The beginnings and ends, in seconds, of the areas of a colour that fill more than half of the panel's height.
    pub fn spans(&self, colour: &str) -> Vec<(f64, f64)> {
        let seconds = self.seconds();
        let ours = |area: &&Area| {
            let (_, top, _, bottom) = area.place;
            area.colour == colour
                && self.top <= top
                && bottom <= self.bottom
                && bottom - top > (self.bottom - self.top) / 2.0
        };
        self.plot.areas.iter().filter(ours).map(|area| (seconds(area.place.0), seconds(area.place.2))).collect()
    }

    /// The notes in the panel's diagram, which have the colour [`ALARM`], each with the time at which it begins, in seconds.
    pub fn notes(&self) -> Vec<(f64, &str)> {
        let seconds = self.seconds();
        let ours = |label: &&Label| label.colour == ALARM && (self.top..self.bottom).contains(&label.y);
        self.plot.labels.iter().filter(ours).map(|label| (seconds(label.x), label.text.as_str())).collect()
    }

    /// Returns a function that converts a vertical coordinate to a value of the panel, by the numbers at its vertical axis.
    fn values(&self) -> impl Fn(f64) -> f64 + use<> {
        let numbers =
            self.plot.labels.iter().filter(|label| label.anchor == "end" && (self.top..self.bottom).contains(&label.y));
        scale(numbers.map(|label| (label.y, number(&label.text))).collect())
    }

    /// Returns a function that converts a horizontal coordinate to seconds: by the numbers at the first horizontal axis below
    /// the top of this panel, which may be that of a later panel.
    fn seconds(&self) -> impl Fn(f64) -> f64 + use<> {
        let numbers = self.plot.labels.iter().filter(|label| label.anchor == "middle" && label.colour == SOFT_INK);
        let below: Vec<&Label> = numbers.filter(|label| label.y > self.top).collect();
        let row = below.iter().map(|label| label.y).fold(f64::MAX, f64::min);
        let numbers = below.iter().filter(|label| label.y == row);
        scale(numbers.map(|label| (label.x, number(&label.text))).collect())
    }

    /// The names of the lanes at the left of the panel, which has no numbers there, from top to bottom, each with its vertical
    /// coordinate.
    pub fn lanes(&self) -> Vec<(&str, f64)> {
        let ours = |label: &&Label| label.anchor == "end" && (self.top..self.bottom).contains(&label.y);
        self.plot.labels.iter().filter(ours).map(|label| (label.text.as_str(), label.y)).collect()
    }

    /// The edges of a lane's curve from its first sample on: the time in seconds, and whether the level is high afterwards.
    pub fn edges(&self, lane: &str, colour: &str) -> Vec<(f64, bool)> {
        let lanes = self.lanes();
        let (_, middle) = lanes.iter().find(|(text, _)| *text == lane).unwrap_or_else(|| panic!("{lane} in {lanes:?}"));
        let room = lanes.windows(2).map(|two| two[1].1 - two[0].1).fold(72.0, f64::min) / 2.0;
        let seconds = self.seconds();
        let ours = |piece: &Vec<(f64, f64)>| piece.iter().all(|(_, y)| (y - middle).abs() < room);
        let points = self.lines(colour, false).into_iter().filter(ours).flatten();
        let mut edges: Vec<(f64, bool)> = Vec::new();
        for (x, y) in points {
            let up = y < *middle;
            // Two edges in one pixel column: only the level after them counts.
            if edges.last().is_some_and(|(before, _)| (seconds(x) - before).abs() < 1e-4) {
                edges.pop();
            }
            if edges.last().is_none_or(|(_, before)| *before != up) {
                edges.push((seconds(x), up));
            }
        }
        edges
    }
}

/// Returns the function that converts coordinates to values: the straight line through the first and the last number at an
/// axis. `numbers` are coordinates with their values.
fn scale(numbers: Vec<(f64, f64)>) -> impl Fn(f64) -> f64 + use<> {
    let [(p0, v0), .., (p1, v1)] = numbers[..] else { panic!("an axis has two numbers at least, not {numbers:?}") };
    move |p| v0 + (v1 - v0) * (p - p0) / (p1 - p0)
}

/// Parses a number at an axis, which has blanks between groups of three digits.
fn number(text: &str) -> f64 {
    let plain: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    plain.parse().unwrap_or_else(|_| panic!("`{text}` is no number"))
}
