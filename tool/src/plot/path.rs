//! Reduces the path of two axes in their plane to the resolution of a picture.

/// The number of points to keep. When the path has twice as many, each point that is close to the previous one is
/// removed. The limit for "close" depends on the extent of the path ([`POINTS_PER_PICTURE`]).
const POINTS_KEPT: usize = 20_000;
/// \[OURS] Points are merged if their distance is less than the extent of the path divided by this number. That
/// distance is less than a pixel, which is about a thousandth of the extent.
const POINTS_PER_PICTURE: f64 = 4000.0;

/// Builds a thinned path from points that are added one by one.
#[derive(Debug, Default)]
pub struct Path {
    pieces: Vec<Vec<(f64, f64)>>,
    /// The last added point, if it was left out because it was close to the previous one. It is kept only if the piece
    /// ends with it.
    last: Option<(f64, f64)>,
    count: usize,
    /// Points whose distance from the previous one is at most this are left out, in units of the axes. The distance is
    /// the larger of the distances in x and in y.
    near: f64,
    broken: bool,
}

impl Path {
    /// Adds a point.
    pub fn push(&mut self, point: (f64, f64)) {
        if self.pieces.is_empty() || self.broken {
            self.end_piece();
            self.pieces.push(Vec::new());
            self.broken = false;
        }
        let Some(piece) = self.pieces.last_mut() else { return };
        if piece.last().is_some_and(|before| distance(*before, point) <= self.near) {
            self.last = Some(point);
            return;
        }
        piece.push(point);
        self.last = None;
        self.count += 1;
        if self.count > 2 * POINTS_KEPT {
            self.thin();
        }
    }

    /// Begins a new piece: the next point is not connected to the previous one.
    pub const fn interrupt(&mut self) {
        self.broken = true;
    }

    /// Completes the path and returns its pieces.
    pub fn finish(mut self) -> Vec<Vec<(f64, f64)>> {
        self.end_piece();
        self.pieces
    }

    fn end_piece(&mut self) {
        if let (Some(last), Some(piece)) = (self.last.take(), self.pieces.last_mut())
            && piece.last() != Some(&last)
        {
            piece.push(last);
        }
    }

    fn thin(&mut self) {
        let points = || self.pieces.iter().flatten();
        let span = |of: fn(&(f64, f64)) -> f64| {
            let all = || points().map(of);
            all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
        };
        self.near = (2.0 * self.near).max(span(|point| point.0).max(span(|point| point.1)) / POINTS_PER_PICTURE);
        for piece in &mut self.pieces {
            let (near, end) = (self.near, piece.last().copied());
            piece.dedup_by(|point, before| distance(*before, *point) <= near);
            if piece.last().copied() != end {
                piece.extend(end);
            }
        }
        self.count = self.pieces.iter().map(Vec::len).sum();
    }
}

fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0).abs().max((a.1 - b.1).abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A circle that is repeated a thousand times keeps its shape, its first point and its last point, but only few
    /// points.
    #[test]
    fn a_long_path_keeps_its_shape_and_its_ends_in_few_points() {
        let mut path = Path::default();
        let at = |i: u32| {
            let angle = f64::from(i) * 0.002;
            (100_000.0 * angle.cos(), 100_000.0 * angle.sin())
        };
        (0..1_000_000).for_each(|i| path.push(at(i)));
        let pieces = path.finish();
        assert_eq!(pieces.len(), 1);
        assert!(pieces[0].len() <= 2 * POINTS_KEPT + 1, "{}", pieces[0].len());
        assert_eq!((pieces[0][0], pieces[0].last()), (at(0), Some(&at(999_999))));
        for (x, y) in &pieces[0] {
            assert!((x.hypot(*y) - 100_000.0).abs() < 1.0);
        }
        assert!(pieces[0].iter().any(|(x, y)| *x < -99_900.0 && y.abs() < 1000.0));
    }

    /// Two pieces of a path are not connected by a line.
    #[test]
    fn no_line_is_drawn_across_a_break() {
        let mut path = Path::default();
        [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0)].into_iter().for_each(|point| path.push(point));
        path.interrupt();
        path.push((5.0, 5.0));
        assert_eq!(path.finish(), [vec![(0.0, 0.0), (1.0, 0.0)], vec![(5.0, 5.0)]]);
    }
}
