//! Checks of the values that edits give nodes.

use std::collections::BTreeMap;

use glam::DAffine3;

use crate::edit::Attribute;
use crate::layers::Layers;
use crate::limits::{ATTRIBUTE_BYTES_MAX, ATTRIBUTES_MAX, LAYERS_MAX, NODE_NAME_BYTES_MAX};
use crate::{Light, LightKind};

/// Largest distance by which a node may be moved, and factor by which it may scale; a factor's
/// reciprocal is the smallest. Far beyond any unit.
const SCALE_MAX: f64 = 1e18;

pub(super) fn check_transform(local: &DAffine3) -> Result<(), String> {
    if !local.is_finite() {
        return Err("a transform is of finite numbers".to_owned());
    }
    let axes = [local.matrix3.x_axis, local.matrix3.y_axis, local.matrix3.z_axis];
    let [x, y, z] = axes.map(glam::DVec3::length);
    let range = SCALE_MAX.recip()..=SCALE_MAX;
    // Relative to its axes, so that a small thing is not taken for a flat one.
    let volume = local.matrix3.determinant().abs() / (x * y * z);
    let is_near = local.translation.length() <= SCALE_MAX;
    if is_near && [x, y, z].iter().all(|length| range.contains(length)) && volume > 1e-12 {
        return Ok(());
    }
    Err("its transform is singular or beyond 1e18: give each axis a length and a direction of its \
         own"
    .to_owned())
}

pub(super) fn check_text(what: &str, text: &str, bytes_max: usize) -> Result<(), String> {
    if text.len() > bytes_max {
        return Err(format!("{what} has {} bytes, where {bytes_max} can be", text.len()));
    }
    if text.chars().any(char::is_control) {
        return Err(format!("{what} has no control characters"));
    }
    Ok(())
}

/// The key of the attribute that tells of a camera of the author at a node: its name if it has
/// one, its kind and what it shows.
pub const CAMERA_KEY: &str = "camera";

/// Checks an attribute for a node that has those which are known.
///
/// # Errors
/// The limit that it breaks.
pub fn check_attribute(
    known: Option<&BTreeMap<String, Attribute>>,
    key: &str,
    value: Option<&Attribute>,
) -> Result<(), String> {
    if key.is_empty() {
        return Err("an attribute has a key".to_owned());
    }
    check_text("an attribute's key", key, NODE_NAME_BYTES_MAX)?;
    match value {
        None => return Ok(()),
        Some(Attribute::Number(number)) if !number.is_finite() => {
            return Err(format!("attribute {key} is {number}, not a finite number"));
        }
        Some(Attribute::Text(text)) if text.len() > ATTRIBUTE_BYTES_MAX => {
            let bytes = text.len();
            return Err(format!(
                "attribute {key} has {bytes} bytes, where {ATTRIBUTE_BYTES_MAX} can be"
            ));
        }
        Some(_) => {}
    }
    let count = known.map_or(0, BTreeMap::len);
    if count >= ATTRIBUTES_MAX && known.is_none_or(|known| !known.contains_key(key)) {
        return Err(format!("it has {ATTRIBUTES_MAX} attributes already; forget some first"));
    }
    Ok(())
}

pub(super) fn check_light(light: Option<&Light>) -> Result<(), String> {
    let Some(light) = light else { return Ok(()) };
    if !(light.color.is_finite() && light.color.min_element() >= 0.0) {
        return Err(format!("a light's color is 0 or more in all three, not {}", light.color));
    }
    if !(light.intensity.is_finite() && light.intensity >= 0.0) {
        return Err(format!("a light's intensity is 0 or more, not {}", light.intensity));
    }
    if light.range.is_some_and(|range| !(range.is_finite() && range > 0.0)) {
        return Err("a light's range is a number above 0".to_owned());
    }
    match light.kind {
        LightKind::Spot { inner_rad, outer_rad }
            if !(0.0 <= inner_rad
                && inner_rad < outer_rad
                && outer_rad <= std::f32::consts::FRAC_PI_2) =>
        {
            Err(format!(
                "a spot's half angles are 0 ≤ inner < outer ≤ π/2 rad, not {inner_rad} and \
                 {outer_rad}"
            ))
        }
        _ => Ok(()),
    }
}

/// Checks that a node can be put into a layer of this name.
pub(super) fn check_layer(layers: &Layers, name: &str) -> Result<(), String> {
    if name.is_empty() {
        return Err("a layer has a name".to_owned());
    }
    check_text("a layer's name", name, NODE_NAME_BYTES_MAX)?;
    if layers.count() >= LAYERS_MAX && !layers.has(name) {
        return Err(format!(
            "the scene has {LAYERS_MAX} layers, the most that there can be; use one of those, or \
             take all nodes out of one first"
        ));
    }
    Ok(())
}
