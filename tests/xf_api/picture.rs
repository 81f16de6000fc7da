//! The picture of the example's motion: both positions over time, and the path in the plane.

use std::fmt::Write as _;

/// Cycles per point.
const STEP: usize = 15;
const AXES: [&str; 2] = ["#1F77B4", "#E66A00"];
/// The diagram over time and that of the plane: left, top, width, height in pixels.
const TIME: [f64; 4] = [70.0, 60.0, 560.0, 360.0];
const PLANE: [f64; 4] = [730.0, 60.0, 360.0, 360.0];

/// A diagram with its ranges.
struct Diagram {
    place: [f64; 4],
    x: [f64; 2],
    y: [f64; 2],
}

impl Diagram {
    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top, width, height] = self.place;
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        [left + width * share(x, self.x), top + height * (1.0 - share(y, self.y))]
    }

    fn line(&self, svg: &mut String, points: impl Iterator<Item = [f64; 2]>, look: &str) {
        let points: Vec<String> = points.map(|point| self.at(point)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        writeln!(svg, "<polyline fill=\"none\" {look} points=\"{}\"/>", points.join(" ")).unwrap();
    }

    /// The frame, with numbers at these values and the names of the axes.
    fn frame(&self, svg: &mut String, xs: &[f64], ys: &[f64], names: [&str; 2]) {
        let [left, top, width, height] = self.place;
        writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#999\"/>"
        )
        .unwrap();
        for x in xs {
            let [at, bottom] = [self.at([*x, 0.0])[0], top + height + 18.0];
            writeln!(svg, "<text x=\"{at:.1}\" y=\"{bottom}\" text-anchor=\"middle\">{x}</text>").unwrap();
        }
        for y in ys {
            let at = self.at([0.0, *y])[1];
            let end = left + width;
            writeln!(svg, "<path stroke=\"#DDD\" d=\"M{left},{at:.1}H{end}\"/>").unwrap();
            writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{y}</text>", left - 6.0, at + 4.0).unwrap();
        }
        let (middle, bottom) = (left + width / 2.0, top + height + 38.0);
        writeln!(svg, "<text x=\"{middle}\" y=\"{bottom}\" text-anchor=\"middle\">{}</text>", names[0]).unwrap();
        writeln!(svg, "<text x=\"{left}\" y=\"{}\">{}</text>", top - 8.0, names[1]).unwrap();
    }
}

/// The SVG of lines `time,target 0,position 0,target 1,position 1`, in s and mm.
pub fn draw(csv: &str) -> String {
    let rows: Vec<[f64; 5]> = csv
        .lines()
        .map(|line| {
            let values: Vec<f64> = line.split(',').map(|value| value.parse().expect("a number")).collect();
            values.try_into().expect("five columns")
        })
        .collect();
    let thin = || rows.iter().step_by(STEP);
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1120 480\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"1120\" height=\"480\" fill=\"white\"/>\n\
         <text x=\"70\" y=\"28\" font-size=\"17\">Two axes behind an ECM-XF go round a square (examples/rust/xf_two_axes.rs)</text>\n",
    );
    let time = Diagram { place: TIME, x: [0.0, 3.0], y: [-45.0, 45.0] };
    time.frame(
        &mut svg,
        &[0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0],
        &[-40.0, -20.0, 0.0, 20.0, 40.0],
        ["time (s)", "position (mm): target pale, as it is written 20 cycles ahead; actual solid"],
    );
    let plane = Diagram { place: PLANE, x: [-45.0, 5.0], y: [-5.0, 45.0] };
    plane.frame(&mut svg, &[-40.0, -20.0, 0.0], &[0.0, 20.0, 40.0], ["axis 0 (mm)", "axis 1 (mm)"]);
    for (axis, colour) in AXES.into_iter().enumerate() {
        let (target, position) = (1 + 2 * axis, 2 + 2 * axis);
        let pale = format!("stroke=\"{colour}\" stroke-opacity=\"0.35\" stroke-width=\"4\"");
        time.line(&mut svg, thin().map(|row| [row[0], row[target]]), &pale);
        time.line(&mut svg, thin().map(|row| [row[0], row[position]]), &format!("stroke=\"{colour}\""));
        let y = 450.0 - 14.0 * (1.0 - axis as f64);
        writeln!(svg, "<text x=\"640\" y=\"{:.0}\" fill=\"{colour}\">axis {axis}</text>", y - 40.0).unwrap();
    }
    plane.line(
        &mut svg,
        thin().map(|row| [row[1], row[3]]),
        "stroke=\"#999\" stroke-opacity=\"0.35\" stroke-width=\"4\"",
    );
    plane.line(&mut svg, thin().map(|row| [row[2], row[4]]), "stroke=\"#2C8C2C\"");
    svg.push_str("</svg>\n");
    svg
}
