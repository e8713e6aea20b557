//! Finds the lamps that may reach a box, without a look at each: a town has tens of thousands of
//! both.

use super::bvh::Bvh;
use super::draw_item::Bounds;
use super::light::LocalLight;

/// Lamps by where they reach.
#[derive(Clone, Debug, Default)]
pub(super) struct LampSearch {
    /// Of the boxes around all that each of `reaching` reaches.
    tree: Bvh,
    /// By item of the tree, the index of the lamp.
    reaching: Vec<u32>,
    /// The lamps that reach everything.
    endless: Vec<u32>,
}

impl LampSearch {
    pub fn new(lamps: &[LocalLight]) -> Self {
        let (mut boxes, mut search) = (Vec::new(), Self::default());
        for (index, lamp) in (0..).zip(lamps) {
            let bounds = Bounds::of_lamp(lamp);
            if bounds.min.is_finite() && bounds.max.is_finite() {
                boxes.push(bounds);
                search.reaching.push(index);
            } else {
                search.endless.push(index);
            }
        }
        // Never cancelled: it takes milliseconds.
        search.tree = Bvh::new(&boxes, &|| false).unwrap_or_default();
        search
    }

    /// The lamps that may reach a box, in rising order. Never leaves one out that does.
    pub fn near(&self, bounds: &Bounds) -> Vec<u32> {
        let mut found = Vec::new();
        if bounds.min.is_finite() && bounds.max.is_finite() {
            self.tree.meeting(bounds, &mut found);
            for item in &mut found {
                *item = self.reaching[*item as usize];
            }
        } else {
            found.extend_from_slice(&self.reaching);
        }
        found.extend_from_slice(&self.endless);
        found.sort_unstable();
        found
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3, Vec3};
    use polyptych_scene::{Light, LightKind};
    use proptest::prelude::*;

    use super::super::light::Condition;
    use super::*;

    fn lamp(position: DVec3, range: Option<f32>) -> LocalLight {
        let (kind, color) = (LightKind::Point, Vec3::ONE);
        let light = Light { kind, color, intensity: 10.0, range };
        LocalLight::new(&light, &DAffine3::from_translation(position), Condition::Always)
    }

    proptest! {
        #[test]
        fn no_lamp_is_left_out_that_reaches_a_box(
            lamps in prop::collection::vec(
                (prop::array::uniform3(-100.0..100.0f64), 0.0..40.0f32, any::<u8>()), 0..200),
            corner in prop::array::uniform3(-120.0..120.0f64),
            size in prop::array::uniform3(0.0..60.0f64),
            far in prop::sample::select(vec![0.0, 1e9, 1e15]),
        ) {
            let far = DVec3::splat(far);
            let lamps: Vec<LocalLight> = lamps
                .into_iter()
                .map(|(at, range, kind)| match kind {
                    0..8 => lamp(DVec3::from(at) + far, None),
                    8 => lamp(DVec3::NAN, Some(range)),
                    _ => lamp(DVec3::from(at) + far, Some(range)),
                })
                .collect();
            let search = LampSearch::new(&lamps);
            let min = DVec3::from(corner) + far;
            let boxes = [
                Bounds { min, max: min + DVec3::from(size) },
                Bounds { min, max: min },
                Bounds::UNBOUNDED,
            ];
            for bounds in boxes {
                let reached = |of: &Vec<u32>| -> Vec<u32> {
                    of.iter().copied().filter(|at| lamps[*at as usize].reaches(&bounds)).collect()
                };
                let all: Vec<u32> = (0..lamps.len() as u32).collect();
                let near = search.near(&bounds);
                prop_assert!(near.is_sorted());
                prop_assert_eq!(reached(&near), reached(&all));
            }
        }
    }

    #[test]
    fn most_lamps_of_a_street_are_not_looked_at() {
        let at = |x: u32| lamp(DVec3::X * f64::from(x) * 10.0, Some(12.0));
        let lamps: Vec<LocalLight> = (0..10_000).map(at).collect();
        let search = LampSearch::new(&lamps);
        let house = Bounds { min: DVec3::new(500.0, 0.0, 0.0), max: DVec3::new(510.0, 8.0, 9.0) };
        assert!(search.near(&house).len() < 12, "{:?}", search.near(&house));
    }
}
