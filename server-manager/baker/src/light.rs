//! Lights of `KHR_lights_punctual`.

use glam::Vec3;
use gltf::json::extensions::scene::khr_lights_punctual::Type;
use gltf::json::validation::Checked;
use polyptych_scene::{LAMP_MAPS_MAX, Light, LightKind, Scene, lamps_with_maps};

use super::BakeJob;
use super::error::BakeError;

/// Least width of a spot's soft rim, in radians: a division by it stays finite.
const RIM_RAD_MIN: f32 = 1e-3;

/// The light at this place of the file's list, which is known to be there.
pub(super) fn convert(job: &mut BakeJob<'_>, index: u32) -> Result<Light, BakeError> {
    let place = format!("extensions.KHR_lights_punctual.lights[{index}]");
    let json = job.source.document.extensions.lights.lights.at(index, &place)?;
    let kind = match json.type_ {
        Checked::Valid(Type::Directional) => LightKind::Directional,
        Checked::Valid(Type::Point) => LightKind::Point,
        Checked::Valid(Type::Spot) => {
            let spot = json.spot.clone().unwrap_or(
                gltf::json::extensions::scene::khr_lights_punctual::Spot {
                    inner_cone_angle: 0.0,
                    outer_cone_angle: std::f32::consts::FRAC_PI_4,
                },
            );
            let kind = cone(spot.inner_cone_angle, spot.outer_cone_angle);
            let given = (spot.inner_cone_angle, spot.outer_cone_angle);
            if !matches!(kind, LightKind::Spot { inner_rad, outer_rad }
                if (inner_rad, outer_rad) == given)
            {
                job.warn(&format!("{place}.spot: its cone was brought to 0 <= inner < outer"));
            }
            kind
        }
        Checked::Invalid => {
            let right = "directional, point or spot would be right";
            return Err(BakeError::at(place, "its type does not exist", right));
        }
    };
    let intensity = finite_or(json.intensity, 0.0).max(0.0);
    let color = Vec3::from(json.color.map(|value| finite_or(value, 1.0).max(0.0)));
    if intensity != json.intensity || color.to_array() != json.color {
        job.warn(&format!("{place}: its colour or intensity was negative and became 0"));
    }
    let range = json.range.filter(|range| range.is_finite() && *range > 0.0);
    if range != json.range {
        job.warn(&format!("{place}.range: it was not above 0 and was left out"));
    }
    Ok(Light { kind, color, intensity, range })
}

/// Notes how many lights of a scene cast no shadow, because brighter ones take all maps. Those of
/// `hidden` nodes take none.
pub(super) fn note_without_shadows(job: &mut BakeJob<'_>, scene: &Scene, hidden: &[bool]) {
    let shown = scene.nodes.iter().zip(hidden).filter(|(_, is_hidden)| !**is_hidden);
    let placed = shown.filter_map(|(node, _)| node.light);
    let lights = placed.filter_map(|light| scene.lights.get(light as usize));
    let lamps: Vec<_> = lights
        .map(|light| (light.lamp_map_count(), (light.color * light.intensity).max_element()))
        .collect();
    let has_maps = lamps_with_maps(&lamps);
    let is_without = |((count, _), has_maps): &(&(usize, f32), &bool)| *count > 0 && !**has_maps;
    let without = lamps.iter().zip(&has_maps).filter(is_without).count();
    if without > 0 {
        let all = lamps.iter().filter(|(count, _)| *count > 0).count();
        job.warn(&format!(
            "lights: {without} of {all} point and spot lights cast no shadows: there are \
             {LAMP_MAPS_MAX} maps for all, of which a point light takes 6; the brightest have them"
        ));
    }
}

fn finite_or(value: f32, other: f32) -> f32 {
    if value.is_finite() { value } else { other }
}

fn cone(inner: f32, outer: f32) -> LightKind {
    let right_angle = std::f32::consts::FRAC_PI_2;
    let outer_rad = finite_or(outer, std::f32::consts::FRAC_PI_4).clamp(RIM_RAD_MIN, right_angle);
    let inner_rad = finite_or(inner, 0.0).clamp(0.0, outer_rad);
    // A hard rim keeps the cone that was asked for, and gets the narrowest rim there is.
    let hard = outer_rad - RIM_RAD_MIN;
    let inner_rad = if inner_rad < outer_rad { inner_rad } else { hard.max(0.0) };
    LightKind::Spot { inner_rad, outer_rad }
}
