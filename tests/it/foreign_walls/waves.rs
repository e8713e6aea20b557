//! Patterns whose colours tell the place of a screen's canvas, and what a colour tells.
//!
//! Red and blue are a triangle wave along an axis, green is the same a quarter of a period ahead,
//! so that one of them is far from its turns everywhere. Waves are linear in light between their
//! turns, so that no symmetric filter moves them.

use glam::{DMat4, DVec2, DVec3, Vec3};
use polyptych_client::{Camera, Wall};

use crate::harness::model::{Model, Part};
use crate::reference::tone;

/// Pixels of the canvas from turn to turn of a wave and back; the last one is longer than any
/// canvas here.
const PERIODS: [f64; 4] = [1600.0, 96.0, 24.0, 6.0];

/// Light of flat fields.
const GREYS: [f64; 2] = [1.0, 0.2];

/// Pixels of a channel that a period must span, so that its turns blur nothing between them.
pub const PIXELS_PER_PERIOD: f64 = 12.0;

/// Least share of the light that has enough levels.
const LIGHT_MIN: f64 = 0.1;

/// Maximum distance of a level from the middle of its wave, in light: beyond it, the wave soon
/// turns.
const SLOPED_MAX: f64 = 0.3;

/// Distance of the patterns from the eye, in distances from the eye to the screen: they lie behind
/// it. A place is right only if the eye is taken into account.
const DEPTH: f64 = 1.5;

/// The fraction of the canvas by which patterns reach beyond it.
const MARGIN: f64 = 1.0;

/// Metres from one pattern's place in the world to the next one's.
const APART_M: f64 = 1000.0;

/// A pattern that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// One light everywhere.
    Flat(f64),
    /// Waves across (0) or down (1), with a period in pixels of the canvas.
    Wave { axis: usize, period: f64 },
}

/// A planar screen and the eye that looks at it, in metres.
#[derive(Clone, Copy, Debug)]
pub struct Seat {
    eye: DVec3,
    lower_left: DVec3,
    /// From the lower left to the lower right corner, and to the upper left one.
    right: DVec3,
    up: DVec3,
    canvas: DVec2,
}

impl Seat {
    /// Creates the seat of the only screen of a wall.
    pub fn of(wall: &Wall) -> Self {
        let plane = wall.screens[0].plane().expect("a planar screen");
        let lower_left = plane.lower_left;
        let (right, up) = (plane.lower_right - lower_left, plane.upper_left - lower_left);
        Self { eye: wall.eye, lower_left, right, up, canvas: wall.screens[0].canvas.as_dvec2() }
    }

    /// The viewer's eye.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// The point of the screen at a place from 0 to 1, to the right and up.
    pub fn point(&self, u: f64, v: f64) -> DVec3 {
        self.lower_left + self.right * u + self.up * v
    }

    /// Returns the position at which the eye sees a point on the screen's plane, in pixels of the
    /// canvas from its upper left corner; `None` if its ray does not meet the plane.
    pub fn place(&self, point: DVec3) -> Option<DVec2> {
        let ray = point - self.eye;
        let met = self.met(self.eye, ray);
        let from = met - self.lower_left;
        // The sides of a screen are perpendicular.
        let u = from.dot(self.right) / self.right.length_squared();
        let v = from.dot(self.up) / self.up.length_squared();
        let is_ahead = ray.dot(met - self.eye) > 0.0;
        is_ahead.then(|| DVec2::new(u, 1.0 - v) * self.canvas)
    }

    /// Returns the point where a ray meets the screen's plane.
    pub fn met(&self, from: DVec3, ray: DVec3) -> DVec3 {
        let normal = self.right.cross(self.up);
        from + ray * ((self.lower_left - from).dot(normal) / ray.dot(normal))
    }

    /// All patterns, flat ones first, waves from long to short.
    pub fn patterns(&self) -> Vec<Pattern> {
        assert!(self.canvas.max_element() * (1.0 + 2.0 * MARGIN) < PERIODS[0], "too large");
        let waves = PERIODS.iter().flat_map(|period| [(0, *period), (1, *period)]);
        let waves = waves.map(|(axis, period)| Pattern::Wave { axis, period });
        GREYS.map(Pattern::Flat).into_iter().chain(waves).collect()
    }

    /// Returns the camera that sees the pattern of this index.
    pub fn camera(index: usize) -> Camera {
        Camera { position: DVec3::X * (APART_M * index as f64), ..Camera::IDENTITY }
    }

    /// A scene of patterns, each before the eye of its own camera.
    pub fn model(&self, patterns: &[Pattern]) -> Model {
        let part = |(index, pattern): (usize, &Pattern)| {
            let root = DMat4::from_translation(Self::camera(index).position + self.eye);
            match *pattern {
                Pattern::Flat(grey) => {
                    let all = DVec2::splat(-MARGIN)..DVec2::splat(1.0 + MARGIN);
                    let corner = |x: f64, y: f64| self.behind(DVec2::new(x, y) * self.canvas);
                    let corners = [
                        corner(all.start.x, all.end.y),
                        corner(all.end.x, all.end.y),
                        corner(all.end.x, all.start.y),
                        corner(all.start.x, all.start.y),
                    ];
                    let mut part = Part::flat(root, &corners, Vec3::splat(grey as f32));
                    part.indices = vec![0, 1, 2, 0, 2, 3];
                    part
                }
                Pattern::Wave { axis, period } => self.wave(root, axis, period),
            }
        };
        Model::of(patterns.iter().enumerate().map(part).collect())
    }

    /// The point behind a place of the canvas, from the eye.
    fn behind(&self, canvas: DVec2) -> Vec3 {
        let place = canvas / self.canvas;
        ((self.point(place.x, 1.0 - place.y) - self.eye) * DEPTH).as_vec3()
    }

    fn wave(&self, root: DMat4, axis: usize, period: f64) -> Part {
        let quarter = period / 4.0;
        let first = (-MARGIN * self.canvas[axis] / quarter).floor() as i64;
        let last = ((1.0 + MARGIN) * self.canvas[axis] / quarter).ceil() as i64;
        let across = 1 - axis;
        let ends = [-MARGIN, 1.0 + MARGIN].map(|end| end * self.canvas[across]);
        let (mut positions, mut colors, mut indices) = (Vec::new(), Vec::new(), Vec::new());
        for step in first..=last {
            let level = |step: i64| [0.0, 0.5, 1.0, 0.5][step.rem_euclid(4) as usize];
            for end in ends {
                let mut canvas = DVec2::ZERO;
                (canvas[axis], canvas[across]) = (step as f64 * quarter, end);
                positions.push(self.behind(canvas));
                colors.push(Vec3::new(level(step), level(step + 1), level(step)));
            }
            if step > first {
                let at = positions.len() as u32 - 4;
                indices.extend([at, at + 1, at + 2, at + 2, at + 1, at + 3]);
            }
        }
        Part {
            positions,
            colors,
            indices,
            is_double_sided: true,
            ..Part::flat(root, &[], Vec3::ONE)
        }
    }
}

/// A place along an axis that a colour tells.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// In pixels of the canvas.
    pub place: f64,
    /// The uncertainty from rounding to a code, in pixels of the canvas.
    pub unsure: f64,
}

/// The place along an axis that the codes of a pixel tell, nearest to `due`. `light` is what the
/// file leaves of the pattern's light and adds to it. `None` where that is too little.
pub fn place(codes: [u8; 4], light: [DVec3; 2], period: f64, due: f64) -> Option<Told> {
    let [alpha, beta] = light;
    // Red and blue are one wave, green is the other.
    let levels = [(0, 0.0), (1, period / 4.0), (2, 0.0)].into_iter().filter_map(|(i, ahead)| {
        let factor = alpha[i] * (1.0 - beta[i]);
        let [here, next] = [codes[i], codes[i].saturating_add(1)].map(tone::linear);
        let level = (here - beta[i]) / factor;
        let is_sloped = (level - 0.5).abs() < SLOPED_MAX;
        (factor > LIGHT_MIN && is_sloped).then_some((level, ahead, (next - here) / 2.0 / factor))
    });
    let (level, ahead, half) = levels.min_by(|a, b| a.2.total_cmp(&b.2))?;
    let cycle = ((due + ahead) / period).floor() * period;
    let rising = cycle + level * period / 2.0 - ahead;
    let falling = cycle + period - level * period / 2.0 - ahead;
    let all = [rising, falling].into_iter().flat_map(|at| [at - period, at, at + period]);
    let place = all.min_by(|a, b| (a - due).abs().total_cmp(&(b - due).abs()))?;
    Some(Told { place, unsure: half * period / 2.0 })
}
