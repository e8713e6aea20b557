//! Properties of lights, materials and nodes that clips change beside the places of nodes
//! (`KHR_animation_pointer`).

use std::collections::BTreeSet;

use glam::{Affine2, DMat2, DVec2, Mat2, Vec3};
use serde::{Deserialize, Serialize};

use crate::{
    AlphaMode, Animations, Light, LightKind, Material, MaterialExtensions, Scene, TextureRef,
};

/// Largest factor of a material: the largest number of a half float.
const FACTOR_MAX: f64 = 65504.0;

/// Minimum width of a spot's soft rim, in radians: a division by it stays finite.
const RIM_RAD_MIN: f64 = 1e-3;

/// A property that clips change, as it is without.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AnimatedProperty {
    /// The property.
    pub kind: PropertyKind,
    /// The nodes, lights or materials that have it: indices into the scene's lists.
    pub targets: Vec<u32>,
    /// Its value without any clip: [`PropertyKind::width`] numbers.
    pub rest: Vec<f64>,
}

/// A property that a clip can change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum PropertyKind {
    /// The visibility of nodes, with all that hangs from them: shown from 0.5 on, else hidden.
    Visible,
    /// A factor of lights.
    Light(LightProperty),
    /// A property of materials.
    Material(MaterialProperty),
}

/// A property of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum LightProperty {
    /// Linear RGB.
    Color,
    /// Lux or candela.
    Intensity,
    /// World units; 0 for one without end.
    Range,
    /// Half angle in radians.
    InnerCone,
    /// Half angle in radians.
    OuterCone,
}

/// A property of a material. Slots are those of [`Material::texture_slots`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum MaterialProperty {
    /// Linear RGBA.
    BaseColor,
    /// 0 to 1.
    Metallic,
    /// 0 to 1.
    Roughness,
    /// Linear RGB before the strength is multiplied in; the strength comes with it.
    EmissiveColor,
    /// Multiplies the colour, which comes with it.
    EmissiveStrength,
    /// Multiplies x and y of the normal map.
    NormalScale,
    /// 0 to 1.
    OcclusionStrength,
    /// The cutoff of a masked material.
    AlphaCutoff,
    /// Offset of the coordinates of a slot's texture; rotation and scale come with it.
    UvOffset(u8),
    /// Rotation of them in radians, counter-clockwise as seen.
    UvRotation(u8),
    /// Scale of them.
    UvScale(u8),
    /// Index of refraction.
    Ior,
    /// Part of the reflection.
    SpecularFactor,
    /// Linear RGB.
    SpecularColor,
    /// Part of the layer.
    ClearcoatFactor,
    /// Roughness of the layer.
    ClearcoatRoughness,
    /// Multiplies x and y of the layer's normal map.
    ClearcoatNormalScale,
    /// Linear RGB.
    SheenColor,
    /// Roughness of the fibres.
    SheenRoughness,
    /// Part of the light that passes.
    TransmissionFactor,
    /// In units of the mesh.
    Thickness,
    /// In units of the world.
    AttenuationDistance,
    /// Linear RGB.
    AttenuationColor,
    /// 20 over the Abbe number.
    Dispersion,
    /// 0 to 1.
    AnisotropyStrength,
    /// In radians, counter-clockwise from the tangent.
    AnisotropyRotation,
    /// Part of the reflection that the film changes.
    IridescenceFactor,
    /// Index of refraction of the film.
    IridescenceIor,
    /// In nanometres.
    IridescenceThicknessMin,
    /// In nanometres.
    IridescenceThicknessMax,
    /// Part of the light that passes diffusely.
    DiffuseTransmissionFactor,
    /// Linear RGB.
    DiffuseTransmissionColor,
}

/// The properties of a material at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct ChangedMaterial {
    /// An index into the scene's materials.
    pub material: u32,
    /// Properties with their values, in the order of the properties.
    pub values: Vec<(MaterialProperty, Vec<f64>)>,
}

impl PropertyKind {
    /// Numbers of a value.
    pub fn width(self) -> usize {
        use MaterialProperty::{
            AttenuationColor, BaseColor, DiffuseTransmissionColor, EmissiveColor, SheenColor,
            SpecularColor, UvOffset, UvScale,
        };
        match self {
            Self::Material(BaseColor) => 4,
            Self::Light(LightProperty::Color)
            | Self::Material(
                EmissiveColor
                | SpecularColor
                | SheenColor
                | AttenuationColor
                | DiffuseTransmissionColor,
            ) => 3,
            Self::Material(UvOffset(_) | UvScale(_)) => 2,
            _ => 1,
        }
    }

    /// The number of things in a scene that can have it.
    fn target_count(self, scene: &Scene) -> usize {
        match self {
            Self::Visible => scene.nodes.len(),
            Self::Light(_) => scene.lights.len(),
            Self::Material(_) => scene.materials.len(),
        }
    }
}

impl AnimatedProperty {
    /// Returns whether its targets are there and its value is one.
    pub(crate) fn is_sound(&self, scene: &Scene) -> bool {
        let count = self.kind.target_count(scene);
        let is_slot = match self.kind {
            PropertyKind::Material(
                MaterialProperty::UvOffset(slot)
                | MaterialProperty::UvRotation(slot)
                | MaterialProperty::UvScale(slot),
            ) => slot < 5,
            _ => true,
        };
        is_slot
            && self.targets.iter().all(|target| (*target as usize) < count)
            && self.targets.is_sorted_by(|a, b| a < b)
            && self.rest.len() == self.kind.width()
            && self.rest.iter().all(|number| number.is_finite())
    }
}

impl Animations {
    /// The nodes of the file that clips show and hide, and that are hidden while no clip is played.
    pub fn hidden_at_rest(&self) -> BTreeSet<u32> {
        let is_hidden = |of: &&AnimatedProperty| {
            of.kind == PropertyKind::Visible && of.rest.first().is_some_and(|value| *value < 0.5)
        };
        self.properties.iter().filter(is_hidden).flat_map(|of| of.targets.iter().copied()).collect()
    }
}

impl Light {
    /// The light with another value of a property, which is brought to its range.
    #[must_use]
    pub(crate) fn with(mut self, property: LightProperty, value: &[f64]) -> Self {
        let first = value.first().copied().unwrap_or_default();
        match (property, &mut self.kind) {
            (LightProperty::Color, _) => self.color = color(value, f64::from(f32::MAX)),
            (LightProperty::Intensity, _) => {
                self.intensity = first.clamp(0.0, f64::from(f32::MAX)) as f32;
            }
            (LightProperty::Range, _) => {
                let range = Some(first as f32);
                self.range = range.filter(|range| range.is_finite() && *range > 0.0);
            }
            (LightProperty::InnerCone, LightKind::Spot { inner_rad, .. }) => {
                *inner_rad = first as f32;
            }
            (LightProperty::OuterCone, LightKind::Spot { outer_rad, .. }) => {
                *outer_rad = first as f32;
            }
            (LightProperty::InnerCone | LightProperty::OuterCone, _) => {}
        }
        self
    }

    /// The light with a cone that has a rim: 0 ≤ inner < outer ≤ π/2.
    #[must_use]
    pub(crate) fn with_rim(mut self) -> Self {
        if let LightKind::Spot { inner_rad, outer_rad } = &mut self.kind {
            let rim = RIM_RAD_MIN as f32;
            *outer_rad = outer_rad.clamp(rim, std::f32::consts::FRAC_PI_2);
            *inner_rad = inner_rad.clamp(0.0, (*outer_rad - rim).max(0.0));
        }
        self
    }
}

/// A colour of which no part is negative or larger than `max`.
fn color(value: &[f64], max: f64) -> Vec3 {
    let part = |at: usize| value.get(at).map_or(0.0, |part| part.clamp(0.0, max) as f32);
    Vec3::new(part(0), part(1), part(2))
}

impl ChangedMaterial {
    /// Changes a material to what it is at the moment. Numbers are brought to their ranges; a
    /// property of an extension or a texture that it does not have changes nothing.
    pub fn apply_to(&self, of: &mut Material) {
        let (mut emission, mut strength) = (None, 1.0);
        let mut transforms = [None; 5];
        for (property, value) in &self.values {
            let first = value.first().copied().unwrap_or_default();
            let pair = || DVec2::new(first, value.get(1).copied().unwrap_or_default());
            let mut transform = |slot: u8, set: &dyn Fn(&mut UvParts)| {
                if let Some(slot) = transforms.get_mut(usize::from(slot)) {
                    set(slot.get_or_insert_default());
                }
            };
            match *property {
                MaterialProperty::EmissiveColor => emission = Some(color(value, 1.0)),
                MaterialProperty::EmissiveStrength => strength = first,
                MaterialProperty::UvOffset(slot) => transform(slot, &|of| of.offset = pair()),
                MaterialProperty::UvScale(slot) => transform(slot, &|of| of.scale = pair()),
                MaterialProperty::UvRotation(slot) => transform(slot, &|of| of.rotation = first),
                other => set_factor(of, other, value),
            }
        }
        if let Some(emission) = emission {
            let brightened = emission.as_dvec3() * strength.max(0.0);
            of.emissive = color(&brightened.to_array(), FACTOR_MAX);
        }
        for (texture, parts) in of.own_textures_mut().into_iter().zip(transforms) {
            if let (Some(texture), Some(parts)) = (texture, parts) {
                texture.uv_transform = parts.affine().unwrap_or(texture.uv_transform);
            }
        }
    }
}

/// Sets a factor that stands alone.
fn set_factor(of: &mut Material, property: MaterialProperty, value: &[f64]) {
    use MaterialProperty as Of;
    let first = value.first().copied().unwrap_or_default();
    let part = first.clamp(0.0, 1.0) as f32;
    let amount = first.clamp(0.0, FACTOR_MAX) as f32;
    let scale = first.clamp(-FACTOR_MAX, FACTOR_MAX) as f32;
    match property {
        Of::BaseColor => {
            let alpha = value.get(3).map_or(1.0, |alpha| alpha.clamp(0.0, 1.0) as f32);
            of.base_color = color(value, 1.0).extend(alpha);
        }
        Of::Metallic => of.metallic = part,
        Of::Roughness => of.roughness = part,
        Of::NormalScale => of.normal_scale = scale,
        Of::OcclusionStrength => of.occlusion_strength = part,
        Of::AlphaCutoff => {
            if let AlphaMode::Mask(cutoff) = &mut of.alpha_mode {
                *cutoff = amount;
            }
        }
        _ => {}
    }
    let Some(of) = of.extensions.as_deref_mut() else { return };
    if let Some(of) = &mut of.specular {
        match property {
            // 0 is an index without end.
            Of::Ior if first == 0.0 => of.ior = 0.0,
            Of::Ior => of.ior = amount.max(1.0),
            Of::SpecularFactor => of.factor = part,
            Of::SpecularColor => of.color = color(value, FACTOR_MAX),
            _ => {}
        }
    }
    if let Some(of) = &mut of.clearcoat {
        match property {
            Of::ClearcoatFactor => of.factor = part,
            Of::ClearcoatRoughness => of.roughness = part,
            Of::ClearcoatNormalScale => of.normal_scale = scale,
            _ => {}
        }
    }
    if let Some(of) = &mut of.sheen {
        match property {
            Of::SheenColor => of.color = color(value, 1.0),
            Of::SheenRoughness => of.roughness = part,
            _ => {}
        }
    }
    if let (Of::TransmissionFactor, Some(of)) = (property, &mut of.transmission) {
        of.factor = part;
    }
    if let Some(of) = &mut of.volume {
        match property {
            Of::Thickness => of.thickness = amount,
            Of::AttenuationDistance => of.attenuation_distance = endless(first),
            Of::AttenuationColor => of.attenuation_color = color(value, 1.0),
            Of::Dispersion => of.dispersion = amount,
            _ => {}
        }
    }
    set_further_factor(of, property, value);
}

/// Sets a factor of anisotropy, iridescence or diffuse transmission.
fn set_further_factor(of: &mut MaterialExtensions, property: MaterialProperty, value: &[f64]) {
    use MaterialProperty as Of;
    let first = value.first().copied().unwrap_or_default();
    let part = first.clamp(0.0, 1.0) as f32;
    let amount = first.clamp(0.0, FACTOR_MAX) as f32;
    if let Some(of) = &mut of.anisotropy {
        match property {
            Of::AnisotropyStrength => of.strength = part,
            Of::AnisotropyRotation => of.rotation_rad = first as f32,
            _ => {}
        }
    }
    if let Some(of) = &mut of.iridescence {
        match property {
            Of::IridescenceFactor => of.factor = part,
            Of::IridescenceIor => of.ior = amount.max(1.0),
            Of::IridescenceThicknessMin => of.thickness_min_nm = amount,
            Of::IridescenceThicknessMax => of.thickness_max_nm = amount,
            _ => {}
        }
    }
    if let Some(of) = &mut of.diffuse_transmission {
        match property {
            Of::DiffuseTransmissionFactor => of.factor = part,
            Of::DiffuseTransmissionColor => of.color = color(value, 1.0),
            _ => {}
        }
    }
}

/// A distance; one that is not above 0 stands for one without end.
fn endless(distance: f64) -> f32 {
    if distance > 0.0 { (distance as f32).max(f32::MIN_POSITIVE) } else { f32::INFINITY }
}

/// A transform of texture coordinates in its parts.
#[derive(Clone, Copy, Debug)]
struct UvParts {
    offset: DVec2,
    rotation: f64,
    scale: DVec2,
}

impl Default for UvParts {
    fn default() -> Self {
        Self { offset: DVec2::ZERO, rotation: 0.0, scale: DVec2::ONE }
    }
}

impl UvParts {
    /// Offset · rotation · scale; the rotation is counter-clockwise as seen, with v downwards
    /// (`KHR_texture_transform`). `None` if it overflows.
    fn affine(self) -> Option<Affine2> {
        let (sin, cos) = libm::sincos(self.rotation);
        let rotation = DMat2::from_cols(DVec2::new(cos, -sin), DVec2::new(sin, cos));
        let matrix = rotation * DMat2::from_diagonal(self.scale);
        let [x, y] = [matrix.x_axis.as_vec2(), matrix.y_axis.as_vec2()];
        let affine = Affine2::from_mat2_translation(Mat2::from_cols(x, y), self.offset.as_vec2());
        Some(affine).filter(Affine2::is_finite)
    }
}

impl MaterialProperty {
    /// Changes a material to one that asks of a renderer all that any value of the property may
    /// ask of it.
    pub fn ask_for_most(self, of: &mut Material) {
        match self {
            Self::EmissiveColor | Self::EmissiveStrength => of.emissive = Vec3::ONE,
            Self::UvOffset(slot) | Self::UvRotation(slot) | Self::UvScale(slot) => {
                let texture = of.own_textures_mut().into_iter().nth(usize::from(slot)).flatten();
                if let Some(texture) = texture {
                    // That of each slot is another one, so that no two are taken for the same.
                    let offset = glam::Vec2::splat(f32::from(slot) + 1.0);
                    texture.uv_transform = Affine2::from_translation(offset);
                }
            }
            Self::Dispersion => {
                let volume = of.extensions.as_mut().and_then(|of| of.volume.as_mut());
                if let Some(volume) = volume {
                    volume.dispersion = 1.0;
                }
            }
            _ => {}
        }
    }
}

impl Material {
    /// Its own textures in the order of [`Self::texture_slots`], to change them.
    fn own_textures_mut(&mut self) -> [Option<&mut TextureRef>; 5] {
        [
            self.base_color_texture.as_mut(),
            self.metallic_roughness_texture.as_mut(),
            self.normal_texture.as_mut(),
            self.occlusion_texture.as_mut(),
            self.emissive_texture.as_mut(),
        ]
    }
}

#[cfg(test)]
mod tests;
