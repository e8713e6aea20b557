//! `KHR_materials_pbrSpecularGlossiness`, in the terms of the metallic-roughness model.
//!
//! Nothing of it is metal: a matt colour lies below a layer that reflects `specularFactor` from the
//! front, all at a grazing angle, and takes its largest channel from what is below. That is
//! `KHR_materials_specular` above an index of refraction without end (`ior` 0), which
//! `KHR_materials_ior` has for this use, so the conversion is exact for factors and for textures,
//! whatever their sizes and coordinates. Khronos' converter looks for a metal instead, per texel;
//! that has no coloured reflection of what is not metal, and needs both images in one place.
//! Only the roughness needs an image of its own: 1 less the glossiness in alpha.

use glam::{Vec3, Vec4};
use gltf::json;
use polyptych_scene::{Material, Specular};
use serde::Deserialize;

use super::error::BakeError;
use super::material::{FACTOR_MAX, MaterialContext, TextureKind, limit};
use super::mip::Rgba8Image;

/// The extension's name.
const NAME: &str = "KHR_materials_pbrSpecularGlossiness";

/// Steps in which a factor of glossiness is kept from 0 to 1.
const STEPS: f32 = 65520.0;

/// The extension.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct SpecularGlossinessJson {
    diffuse_factor: [f32; 4],
    diffuse_texture: Option<json::texture::Info>,
    specular_factor: [f32; 3],
    glossiness_factor: f32,
    specular_glossiness_texture: Option<json::texture::Info>,
}

impl Default for SpecularGlossinessJson {
    fn default() -> Self {
        Self {
            diffuse_factor: [1.0; 4],
            diffuse_texture: None,
            specular_factor: [1.0; 3],
            glossiness_factor: 1.0,
            specular_glossiness_texture: None,
        }
    }
}

impl MaterialContext<'_, '_, '_> {
    /// Gives a material the colours of the extension in the place of its own, if it has it, and
    /// returns its reflection. What is not lit has only the base colour.
    pub(super) fn specular_glossiness(
        &mut self,
        json: &json::Material,
        material: &mut Material,
        is_lit: bool,
    ) -> Result<Option<Specular>, BakeError> {
        let Some(read) = self.extension::<SpecularGlossinessJson>(json, NAME)? else {
            return Ok(None);
        };
        let unit = |value: f32| limit(value, 0.0, 1.0);
        let glossiness = unit(read.glossiness_factor);
        let image = read.specular_glossiness_texture.as_ref().filter(|_| is_lit);
        let converted = TextureKind::Glossiness((glossiness * STEPS).round() as u16);
        let specular = Specular {
            ior: 0.0,
            color: Vec3::from(read.specular_factor.map(|of| limit(of, 0.0, FACTOR_MAX))),
            color_texture: self.optional(image, TextureKind::Tint)?,
            ..Specular::default()
        };
        material.base_color = Vec4::from(read.diffuse_factor.map(unit));
        let content = TextureKind::of_base_color(material);
        material.base_color_texture = self.optional(read.diffuse_texture.as_ref(), content)?;
        material.metallic = 0.0;
        material.roughness = if image.is_some() { 1.0 } else { 1.0 - glossiness };
        material.metallic_roughness_texture = self.optional(image, converted)?;
        Ok(Some(specular))
    }
}

/// Makes the roughness of an image whose alpha, times a factor in 65,520ths, is glossiness.
pub(super) fn roughness_image(mut image: Rgba8Image, factor: u16) -> Rgba8Image {
    let part = f32::from(factor) / STEPS;
    for texel in image.rgba.as_chunks_mut::<4>().0 {
        let roughness = 255.0 - part * f32::from(texel[3]);
        *texel = [255, roughness.round() as u8, 0, 255];
    }
    image
}
