//! Frustum culling of boxes against a channel's rectangle, in f64 and on the safe side.

use glam::{DMat3, DMat4, DVec3, DVec4};

/// Slack of the plane tests, relative to the sizes involved: far above the rounding of f64, far
/// below a pixel.
const SLACK: f64 = 1e-9;

/// The planes around what a rectangle of the canvas shows. A point p, in world space, is inside
/// a plane where `normal · (p − eye) + offset ≥ 0`.
///
/// Taken from the rows of the projection, as in Gribb and Hartmann, "Fast Extraction of Viewing
/// Frustum Planes from the World-View-Projection Matrix" (2001).
#[derive(Clone, Debug)]
pub(crate) struct FrustumPlanes {
    eye: DVec3,
    /// Along all rays, where they do not meet in the eye.
    rays: Option<DVec3>,
    /// Left, right, bottom, top, near, far.
    sides: [DVec4; 6],
}

impl FrustumPlanes {
    /// Every plane is still to be tested.
    pub const ALL: u8 = 0b11_1111;

    /// The planes around the rectangle `[left, bottom, right, top]` of normalised device
    /// coordinates. `clip_from_eye` acts on eye-relative world positions; z is reversed, 1 at
    /// the near plane.
    pub fn new(eye: DVec3, clip_from_eye: &DMat4, rectangle: [f64; 4]) -> Self {
        let [x, y, z, w] = [0, 1, 2, 3].map(|row| clip_from_eye.row(row));
        let [left, bottom, right, top] = rectangle;
        let planes = [x - w * left, w * right - x, y - w * bottom, w * top - y, w - z, z];
        let unit = |plane: DVec4| {
            let length = plane.truncate().length();
            // An infinite far plane has no normal: it lets everything through.
            if length > 0.0 { plane / length } else { DVec4::W }
        };
        // The row of w is the direction in which it grows: none has no eye that rays meet in.
        let rays = (w.truncate() == DVec3::ZERO).then(|| -z.truncate().normalize_or_zero());
        Self { eye, rays, sides: planes.map(unit) }
    }

    /// The direction of all rays, where they are parallel.
    pub fn view_direction(&self) -> Option<DVec3> {
        self.rays
    }

    /// The eye, in the space of the planes.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Returns these planes in the space of an item, whose points `p` lie at `origin + linear · p`
    /// in the world.
    pub fn in_space_of(&self, linear: &DMat3, origin: DVec3) -> Self {
        let offset = origin - self.eye;
        let transposed = linear.transpose();
        let sides = self.sides.map(|plane| {
            let normal = plane.truncate();
            (transposed * normal).extend(plane.w + normal.dot(offset))
        });
        Self { eye: DVec3::ZERO, rays: None, sides }
    }

    /// `None` where the box is outside; else the planes of `mask` that cut it.
    pub fn test(&self, center: DVec3, half: DVec3, mask: u8) -> Option<u8> {
        let center = center - self.eye;
        let slack = SLACK * (center.abs().element_sum() + self.eye.abs().element_sum());
        let mut cutting = mask;
        for (index, plane) in self.sides.iter().enumerate() {
            let bit = 1 << index;
            if mask & bit == 0 {
                continue;
            }
            let normal = plane.truncate();
            let distance = normal.dot(center) + plane.w;
            let reach = normal.abs().dot(half) + slack;
            // Comparisons with NaN, from boxes that are not finite, are false: such a box is
            // neither rejected nor taken as wholly inside.
            if distance < -reach {
                return None;
            }
            if distance >= reach {
                cutting &= !bit;
            }
        }
        Some(cutting)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Bounds, Bvh};

    /// A small generator, so that the scenes are random but always the same.
    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }
        fn vector(&mut self, size: f64) -> DVec3 {
            (DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0) * size
        }
    }

    fn reversed_infinite(near: f64) -> DMat4 {
        DMat4::from_cols(DVec4::X, DVec4::Y, -DVec4::W, DVec4::Z * near)
    }

    /// Returns whether any of 343 points of the box lies within the rectangle and before the near
    /// plane.
    fn any_point_shows(b: &Bounds, eye: DVec3, clip: &DMat4, r: [f64; 4]) -> bool {
        let steps = |i: usize| i as f64 / 6.0;
        let mut points = (0..343).map(|i| {
            let t = DVec3::new(steps(i % 7), steps(i / 7 % 7), steps(i / 49));
            *clip * (b.min + (b.max - b.min) * t - eye).extend(1.0)
        });
        points.any(|p| {
            let inside = |v: f64, low: f64, high: f64| v >= low * p.w && v <= high * p.w;
            p.w > 0.0 && p.z <= p.w && inside(p.x, r[0], r[2]) && inside(p.y, r[1], r[3])
        })
    }

    #[test]
    fn tree_never_rejects_what_shows() {
        let mut random = Random(7);
        let mut rejected = 0;
        for round in 0..60 {
            let far = if round % 3 == 0 { 1e7 } else { 1.0 };
            let middle = random.vector(far);
            let boxes: Vec<Bounds> = (0..300)
                .map(|_| {
                    let (center, half) = (middle + random.vector(40.0), random.vector(6.0).abs());
                    Bounds { min: center - half, max: center + half }
                })
                .collect();
            let eye = middle + random.vector(20.0);
            let axis = random.vector(1.0).normalize_or(DVec3::X);
            let turn = DMat4::from_axis_angle(axis, random.unit() * 6.0);
            let clip = reversed_infinite(0.1) * turn;
            let (x, y) = (random.unit() * 2.0 - 1.0, random.unit() * 2.0 - 1.0);
            let rectangle = [x, y, x + 0.5, y + 0.5];
            let planes = FrustumPlanes::new(eye, &clip, rectangle);
            let mut found = Vec::new();
            Bvh::new(&boxes, &|| false).expect("not cancelled").visible(&planes, &mut found);
            found.sort_unstable();
            assert!(found.windows(2).all(|pair| pair[0] < pair[1]), "an item came twice");
            for (index, b) in boxes.iter().enumerate() {
                let kept = found.binary_search(&(index as u32)).is_ok();
                let brute = planes.test(b.center(), b.half(), FrustumPlanes::ALL).is_some();
                assert_eq!(kept, brute, "the tree and the single test disagree on {b:?}");
                assert!(kept || !any_point_shows(b, eye, &clip, rectangle), "lost {b:?}");
                rejected += u32::from(!kept);
            }
        }
        assert!(rejected > 9000, "only {rejected} of 18000 rejected: not culling");
    }

    #[test]
    fn boxes_around_the_eye_and_without_bounds_stay() {
        let planes =
            FrustumPlanes::new(DVec3::ZERO, &reversed_infinite(0.1), [-1.0, -1.0, 1.0, 1.0]);
        assert!(planes.test(DVec3::ZERO, DVec3::splat(100.0), FrustumPlanes::ALL).is_some());
        assert!(
            planes.test(DVec3::ZERO, DVec3::splat(f64::INFINITY), FrustumPlanes::ALL).is_some()
        );
        assert!(planes.test(DVec3::NAN, DVec3::splat(f64::INFINITY), FrustumPlanes::ALL).is_some());
        assert!(planes.test(DVec3::Z * 10.0, DVec3::ONE, FrustumPlanes::ALL).is_none(), "behind");
    }

    #[test]
    fn tree_of_many_items_is_fast_enough_to_be_worth_it() {
        let mut random = Random(3);
        let boxes: Vec<Bounds> = (0..100_000)
            .map(|_| {
                let center = random.vector(1000.0);
                Bounds { min: center - 0.5, max: center + 0.5 }
            })
            .collect();
        let tree = Bvh::new(&boxes, &|| false).expect("not cancelled");
        let planes = FrustumPlanes::new(DVec3::ZERO, &reversed_infinite(0.1), [0.0, 0.0, 0.3, 0.3]);
        let mut found = Vec::new();
        let start = std::time::Instant::now();
        tree.visible(&planes, &mut found);
        println!("culled 100,000 to {} in {:?}", found.len(), start.elapsed());
        assert!(found.len() < 4000);
    }
}
