//! The maps of shadows that point and spot lights take, and which lights have some where there are
//! too many: a function of the lights alone, so that every display comes to one answer.

use super::{Light, LightKind};

/// Maximum number of maps of the point and spot lights of a view: 256 MiB on the GPU. A spot light
/// takes 1, or 5 if it is wide, and a point light 6.
pub const LAMP_MAPS_MAX: usize = 64;

/// The half angle of the widest spot light that has a single map, in radians: 60°. The tangent of
/// more makes the texels in the middle of a map too large.
pub const SPOT_MAP_RAD_MAX: f32 = std::f32::consts::FRAC_PI_3;

impl Light {
    /// Returns the number of maps that its shadows take: 0 for a directional light, whose maps
    /// follow the viewer, and for one that is black; 1 for a narrow spot light; for others the
    /// faces of a cube, less the one behind a wide spot light.
    pub fn lamp_map_count(&self) -> usize {
        match self.kind {
            _ if !self.casts_shadows() => 0,
            LightKind::Directional => 0,
            LightKind::Spot { outer_rad, .. } if outer_rad <= SPOT_MAP_RAD_MAX => 1,
            LightKind::Spot { .. } => 5,
            LightKind::Point => 6,
        }
    }
}

/// Returns which lights have maps, in the order given: the brightest first, of equal ones the first
/// in that order, each if [`LAMP_MAPS_MAX`] leaves room for all of its maps. A light is its number
/// of maps and its intensity in candela.
pub fn lamps_with_maps(lamps: &[(usize, f32)]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..lamps.len()).filter(|&at| lamps[at].0 > 0).collect();
    order.sort_by(|&a, &b| lamps[b].1.total_cmp(&lamps[a].1));
    let (mut has_maps, mut left) = (vec![false; lamps.len()], LAMP_MAPS_MAX);
    for at in order {
        if let Some(rest) = left.checked_sub(lamps[at].0) {
            (left, has_maps[at]) = (rest, true);
        }
    }
    has_maps
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn maps_follow_the_kind_of_a_light() {
        let count = |kind, intensity| {
            Light { kind, color: Vec3::ONE, intensity, range: None }.lamp_map_count()
        };
        let spot = |outer_rad| LightKind::Spot { inner_rad: 0.0, outer_rad };
        assert_eq!(count(LightKind::Directional, 1.0), 0);
        assert_eq!((count(LightKind::Point, 1.0), count(LightKind::Point, 0.0)), (6, 0));
        assert_eq!((count(spot(0.5), 1.0), count(spot(SPOT_MAP_RAD_MAX), 1.0)), (1, 1));
        assert_eq!(count(spot(std::f32::consts::FRAC_PI_2), 1.0), 5);
    }

    #[test]
    fn the_brightest_lights_have_maps_and_equal_ones_in_their_order() {
        // 10 point lights fill 60 of 64 maps; then only spot lights fit.
        let mut lamps = vec![(6, 1.0); 12];
        lamps.push((1, 0.5));
        lamps[11].1 = 2.0;
        lamps.push((0, 9.0));
        let has_maps = lamps_with_maps(&lamps);
        let wanted: Vec<bool> = (0..14).map(|at| !matches!(at, 9 | 10 | 13)).collect();
        assert_eq!(has_maps, wanted);
        assert_eq!(lamps_with_maps(&[]), [] as [bool; 0]);
    }
}
