//! Street lamps: one mesh and one light, shared by all.

use glam::{Vec3, vec3};
use serde_json::{Value, json};

use super::color::Color;
use super::material::Material;
use super::surface::Model;

/// Height of the light above the pavement, in metres. The mesh hangs below its origin, so that one
/// node carries both the mesh and the light.
pub(super) const LAMP_HEIGHT: f32 = 4.0;

/// The post and its lantern; the origin is where the light is.
pub(super) fn model() -> Model {
    let mut model = Model::default();
    let foot = vec3(0.0, -LAMP_HEIGHT, 0.0);
    let color = Color::ONE;
    let post = [
        (0.17, -0.3, color),
        (0.17, 0.25, color),
        (0.075, 0.45, color),
        (0.05, LAMP_HEIGHT - 0.42, color),
        (0.14, LAMP_HEIGHT - 0.32, color),
    ];
    model.lathe(Material::Iron, foot, 5, &post);
    let glass = [(0.13, -0.30, color), (0.20, 0.18, color)];
    model.lathe(Material::Lantern, Vec3::ZERO, 6, &glass);
    let hood = [(0.0, 0.16, color), (0.26, 0.17, color), (0.07, 0.36, color), (0.0, 0.48, color)];
    model.lathe(Material::Iron, Vec3::ZERO, 6, &hood);
    model
}

/// Warm, as by sodium; it ends after 12 m, and at dusk, when eyes are used to less, after 20 m.
pub(super) fn light(is_dusk: bool) -> Value {
    let (intensity, range) = if is_dusk { (28.0, 20.0) } else { (14.0, 12.0) };
    json!({
        "color": [1.0, 0.625, 0.25],
        "intensity": intensity,
        "name": "street-lamp",
        "range": range,
        "type": "point",
    })
}

/// The sun of a late morning, or one that is about to set; it shines along -Z of its node.
pub(super) fn sun(is_dusk: bool) -> Value {
    let color = if is_dusk { [1.0, 0.5, 0.25] } else { [1.0, 0.9375, 0.8125] };
    json!({
        "color": color,
        "intensity": if is_dusk { 0.75 } else { 3.25 },
        "name": "sun",
        "type": "directional",
    })
}
