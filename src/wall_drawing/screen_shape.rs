//! The surface of a screen, as points in the room.

use glam::{DVec2, DVec3};
use polyptych_wall::Surface;
use polyptych_wall::wall_geometry::ScreenGeometry;

/// Steps across and down a curved screen, with few and with many screens.
const STEPS: [[usize; 2]; 2] = [[64, 16], [16, 4]];

/// Maximum number of screens with the larger number of steps, so that the drawing stays small.
const MANY: usize = 16;

/// Lines across and down that show how a screen is curved.
const LINES: usize = 8;

/// A grid of points of a screen, in metres of display space; `None` where there is no surface.
pub(super) struct ScreenShape {
    steps: [usize; 2],
    points: Vec<Option<DVec3>>,
}

impl ScreenShape {
    pub fn new(ground: ScreenGeometry<'_>, screen_count: usize) -> Self {
        let steps = match ground.screen.surface {
            Surface::Plane(_) => [1, 1],
            _ => STEPS[usize::from(screen_count > MANY)],
        };
        let canvas = ground.screen.canvas.as_dvec2();
        let part = |axis: usize, step: usize| step as f64 / steps[axis] as f64;
        let places = (0..=steps[1])
            .flat_map(|y| (0..=steps[0]).map(move |x| DVec2::new(part(0, x), part(1, y)) * canvas));
        let point = |at: DVec2| ground.display_from_canvas(at).filter(|point| point.is_finite());
        Self { steps, points: places.map(point).collect() }
    }

    fn at(&self, x: usize, y: usize) -> Option<DVec3> {
        self.points[y * (self.steps[0] + 1) + x]
    }

    /// Returns all points.
    pub fn points(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.points.iter().flatten().copied()
    }

    /// Returns the middle of the screen, or the mean of its points for a mesh without a middle.
    pub fn middle(&self) -> Option<DVec3> {
        let middle = match self.steps {
            [1, 1] => self.at(0, 0).zip(self.at(1, 1)).map(|(a, b)| a.midpoint(b)),
            [across, down] => self.at(across / 2, down / 2),
        };
        let count = self.points().count();
        middle.or_else(|| (count > 0).then(|| self.points().sum::<DVec3>() / count as f64))
    }

    /// Returns its cells, each as four corners in order around it.
    pub fn cells(&self) -> impl Iterator<Item = [DVec3; 4]> + '_ {
        let cells = (0..self.steps[1]).flat_map(|y| (0..self.steps[0]).map(move |x| (x, y)));
        cells.filter_map(|(x, y)| {
            let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)];
            let [a, b, c, d] = corners.map(|(x, y)| self.at(x, y));
            Some([a?, b?, c?, d?])
        })
    }

    /// Returns its edges without the sides at which it closes, in pieces if there are gaps.
    pub fn edges(&self) -> Vec<Vec<DVec3>> {
        let [last, lowest] = self.steps;
        let mut lines = [self.row(0), self.row(lowest)].concat();
        let is_one = |(a, b): (DVec3, DVec3)| a.distance(b) < 1e-6 * (1.0 + a.length());
        let mut ends = (0..=lowest).filter_map(|y| self.at(0, y).zip(self.at(last, y)));
        if !ends.all(is_one) {
            lines.extend([self.column(0), self.column(last)].concat());
        }
        lines
    }

    /// Returns lines over a curved screen; none over a plane.
    pub fn lines(&self) -> Vec<Vec<DVec3>> {
        let [across, down] = self.steps;
        let inner = |steps: usize| {
            let count = LINES.min(steps);
            (1..count).map(move |line| line * steps / count)
        };
        let rows = inner(down).flat_map(|at| self.row(at));
        rows.chain(inner(across).flat_map(|at| self.column(at))).collect()
    }

    fn row(&self, y: usize) -> Vec<Vec<DVec3>> {
        pieces((0..=self.steps[0]).map(|x| self.at(x, y)))
    }

    fn column(&self, x: usize) -> Vec<Vec<DVec3>> {
        pieces((0..=self.steps[1]).map(|y| self.at(x, y)))
    }
}

/// Returns the pieces of a line of two points and more.
fn pieces(points: impl Iterator<Item = Option<DVec3>>) -> Vec<Vec<DVec3>> {
    let mut pieces = vec![Vec::new()];
    for point in points {
        match (point, pieces.last_mut()) {
            (Some(point), Some(piece)) => piece.push(point),
            _ => pieces.push(Vec::new()),
        }
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}
