//! Pictures of trends: a few values per recording, hour or day, instead of every frame over time.

use super::PlotError;
use super::chart::{Caption, Sheet};
use super::panel::{Look, Panel, Stroke, range};
use super::{style, svg};

/// The height of a diagram in pixels.
const HEIGHT: u32 = 150;

/// A picture of several diagrams below each other, with a common horizontal axis.
pub struct Picture {
    pub title: String,
    /// The line below the title.
    pub about: String,
    /// The name of the common horizontal axis.
    pub across: &'static str,
    /// The diagrams; those without a point are left out.
    pub diagrams: Vec<Diagram>,
}

/// One diagram of the picture: curves with a common vertical axis.
pub struct Diagram {
    /// The name of the diagram, with the unit.
    pub name: String,
    pub curves: Vec<Curve>,
    /// The smallest possible step of a value.
    pub least: f64,
}

/// A curve: a line through points, with a dot at each point.
pub struct Curve {
    /// The name of the curve in the legend; if empty, the curve is not in the legend.
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

impl Picture {
    /// Draws the picture as SVG.
    ///
    /// # Errors
    /// The drawing library fails.
    pub fn svg(self) -> Result<String, PlotError> {
        let panels: Vec<Panel> = self.diagrams.into_iter().filter_map(Diagram::panel).collect();
        let strokes: Vec<&Stroke> = panels.iter().flat_map(|panel| &panel.strokes).collect();
        let points = strokes.iter().flat_map(|stroke| stroke.pieces.iter().flatten().copied()).collect();
        let all = [Stroke { pieces: vec![points], look: Look::Solid(style::INK) }];
        let Some(range) = range(&all, |point| point.0, 0.1) else {
            return Ok("<p>There is nothing to draw.</p>".to_owned());
        };
        let caption = Caption { title: self.title, about: self.about, range, axis: self.across };
        svg::write(&Sheet { panels, caption })
    }
}

impl Diagram {
    fn panel(self) -> Option<Panel> {
        let colours = style::colours(1..=self.curves.len() as u8);
        let mut strokes = Vec::new();
        let mut legend = Vec::new();
        for (Curve { name, points }, colour) in self.curves.into_iter().zip(colours) {
            let look = Look::Solid(colour);
            if points.is_empty() {
                continue;
            }
            if !name.is_empty() {
                legend.push((look, name));
            }
            // A piece with a single point is drawn as a dot, so each point is added as a piece of its own.
            let dots = points.iter().map(|point| vec![*point]);
            strokes.push(Stroke { pieces: dots.chain([points.clone()]).collect(), look });
        }
        Panel::of(self.name, HEIGHT, self.least, strokes, legend)
    }
}
