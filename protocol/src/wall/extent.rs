//! How long a line on a screen is: in metres, and in degrees as the eye sees it.

use glam::{DMat2, DVec2, DVec3};

use super::pixels::PixelMap;
use super::{Channel, Screen, Surface};

/// Straight pieces that a line is measured in.
const PIECES: u32 = 32;

/// Places of a channel, across and down, at which its sampling is measured.
const SAMPLING_SIDE: u32 = 17;

/// The metres and the degrees of the line through these places, which go from 0 to 1; NaN where a
/// part of it is nowhere.
pub(super) fn of_line(eye: DVec3, place: impl Fn(f64) -> Option<DVec3>) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let mut before = None;
    for step in 0..=PIECES {
        let Some(point) = place(f64::from(step) / f64::from(PIECES)) else {
            return [f64::NAN; 2];
        };
        if let Some(before) = before.replace(point) {
            sums[0] += point.distance(before);
            sums[1] += angle(before - eye, point - eye).to_degrees();
        }
    }
    sums
}

/// The angle between two directions in radians, exact for the tiny angles of one pixel, where the
/// arc cosine is not: W. Kahan, *How Futile are Mindless Assessments of Roundoff*, 2006, §12.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    let (scaled_a, scaled_b) = (a * b.length(), b * a.length());
    2.0 * (scaled_a - scaled_b).length().atan2((scaled_a + scaled_b).length())
}

/// How many pixels of what is drawn go into a pixel of the display, at the place of the channel
/// where they are fewest and where they are most, along the direction in which they are fewest
/// and most; drawn just so fine that the fewest are 1.
///
/// What is drawn is a flat picture as the eye sees it: of the screen's own plane, or for a curved
/// screen of one that faces the middle of the channel. NaN where the channel is wider than a
/// picture in one plane.
pub(super) fn sampling(channel: &Channel, screen: &Screen, eye: DVec3) -> [f64; 2] {
    let unknown = [f64::NAN; 2];
    let Some(map) = PixelMap::new(channel, screen) else { return unknown };
    let size = channel.size.as_dvec2();
    let Some(source) = Source::of(&map, screen, size, eye) else { return unknown };
    let (mut fewest, mut most) = (f64::INFINITY, 0.0_f64);
    let at = |step: u32| f64::from(step) / f64::from(SAMPLING_SIDE - 1);
    for y in 0..SAMPLING_SIDE {
        for x in 0..SAMPLING_SIDE {
            // Middles of pixels, the first and the last too.
            let pixel = DVec2::splat(0.5) + DVec2::new(at(x), at(y)) * (size - 1.0);
            let Some(step) = source.step(&map, pixel) else { continue };
            let [narrow, wide] = singular_values(step);
            fewest = fewest.min(narrow);
            most = most.max(wide);
        }
    }
    if fewest > 0.0 && fewest.is_finite() { [1.0, most / fewest] } else { unknown }
}

/// The plane of the picture that is drawn.
enum Source {
    /// The screen's own.
    Canvas,
    /// Across the line of sight from the eye to the channel's middle: its axes, forward last.
    Facing(DVec3, [DVec3; 3]),
}

impl Source {
    fn of(map: &PixelMap<'_>, screen: &Screen, size: DVec2, eye: DVec3) -> Option<Self> {
        if let Surface::Plane(_) = screen.surface {
            return Some(Self::Canvas);
        }
        let forward = (map.display_from_pixel(size / 2.0)? - eye).try_normalize()?;
        let (right, up) = forward.any_orthonormal_pair();
        Some(Self::Facing(eye, [right, up, forward]))
    }

    /// Where the picture has what this pixel shows; in no particular unit.
    fn place(&self, map: &PixelMap<'_>, pixel: DVec2) -> Option<DVec2> {
        match self {
            Self::Canvas => map.canvas_from_pixel(pixel),
            Self::Facing(eye, [right, up, forward]) => {
                let toward = map.display_from_pixel(pixel)? - *eye;
                let depth = forward.dot(toward);
                (depth > 0.0).then(|| DVec2::new(right.dot(toward), up.dot(toward)) / depth)
            }
        }
    }

    /// How the place changes with a pixel across and one down.
    fn step(&self, map: &PixelMap<'_>, pixel: DVec2) -> Option<DMat2> {
        let along =
            |half: DVec2| Some(self.place(map, pixel + half)? - self.place(map, pixel - half)?);
        Some(DMat2::from_cols(along(DVec2::X / 2.0)?, along(DVec2::Y / 2.0)?))
    }
}

/// The least and the greatest length that a vector of length 1 is given. G. Golub, C. Van Loan,
/// *Matrix Computations*, §2.4: of two by two, by their sum and product of squares.
fn singular_values(matrix: DMat2) -> [f64; 2] {
    let sum = matrix.x_axis.length_squared() + matrix.y_axis.length_squared();
    let product = matrix.determinant().abs();
    let wide = f64::midpoint(sum, (sum * sum - 4.0 * product * product).max(0.0).sqrt()).sqrt();
    [product / wide, wide]
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, UVec2};

    use super::*;
    use crate::wall::surface::Cylinder;

    #[test]
    fn singular_values_are_the_lengths_of_axes() {
        let turned = DMat2::from_angle(0.4) * DMat2::from_diagonal(DVec2::new(3.0, 0.5));
        let [narrow, wide] = singular_values(turned * DMat2::from_angle(-1.1));
        assert!((narrow - 0.5).abs() < 1e-12 && (wide - 3.0).abs() < 1e-12, "{narrow} {wide}");
    }

    #[test]
    fn a_cylinder_is_drawn_finer_at_its_sides_than_it_needs() {
        // From its axis a cylinder's pixels are as many per radian; a plane's pixels widen by the
        // squared secant to the side across, and by the secant down.
        let half: f64 = 0.5;
        let cylinder = Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            radius_m: 3.0,
            azimuth_rad: [-half, half],
            height_m: [-0.003, 0.003],
        };
        let canvas = UVec2::new(1000, 2);
        // Square pixels, so that across and down are alike in the middle.
        let screen = Screen::new("round", Surface::Cylinder(cylinder), canvas);
        let channel = Channel::tile("round", 0, UVec2::ZERO, canvas);
        let [fewest, most] = sampling(&channel, &screen, DVec3::ZERO);
        let side: f64 = half - half / 1000.0;
        let expected = 1.0 / side.cos().powi(2);
        assert_eq!(fewest, 1.0);
        assert!((most / expected - 1.0).abs() < 1e-3, "{most}, not {expected}");
    }
}
