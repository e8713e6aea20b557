//! Materials: glTF's metallic-roughness model with its five textures.

use glam::{Affine2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use super::MaterialExtensions;

/// A surface. Factors multiply the textures; all are linear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// The source's name; may be empty.
    pub name: String,
    /// Linear RGBA.
    pub base_color: Vec4,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// Perceptual; its square is GGX's α.
    pub roughness: f32,
    /// Linear RGB radiance, any strength multiplied in.
    pub emissive: Vec3,
    /// Multiplies x and y of the normal map.
    pub normal_scale: f32,
    /// 0 no occlusion, 1 as the texture says.
    pub occlusion_strength: f32,
    /// The use of alpha.
    pub alpha_mode: AlphaMode,
    /// `true` if back faces are drawn, with the normal turned.
    pub double_sided: bool,
    /// `true` if the base colour is shown as it is, without light (`KHR_materials_unlit`).
    pub unlit: bool,
    /// sRGB colour and alpha.
    pub base_color_texture: Option<TextureRef>,
    /// Roughness in G, metallic in B.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normals, +Y up.
    pub normal_texture: Option<TextureRef>,
    /// Occlusion in R, of indirect light only.
    pub occlusion_texture: Option<TextureRef>,
    /// sRGB radiance.
    pub emissive_texture: Option<TextureRef>,
    /// The properties that extensions add; `None` if there are none.
    pub extensions: Option<Box<MaterialExtensions>>,
}

/// The use of alpha.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum AlphaMode {
    /// Not at all.
    Opaque,
    /// Below this cutoff nothing is drawn.
    Mask(f32),
    /// Drawn over what lies behind, far to near.
    Blend,
}

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureRef {
    /// An index into the scene's textures.
    pub texture: u32,
    /// The set of texture coordinates: 0 or 1.
    pub uv_set: u8,
    /// Applied to the coordinates (`KHR_texture_transform`); the identity where there is none.
    pub uv_transform: Affine2,
}

impl Default for Material {
    /// glTF's default material: white, metallic and rough 1, opaque.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            metallic: 1.0,
            roughness: 1.0,
            emissive: Vec3::ZERO,
            normal_scale: 1.0,
            occlusion_strength: 1.0,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            occlusion_texture: None,
            emissive_texture: None,
            extensions: None,
        }
    }
}

impl Material {
    /// Its textures in the order in which shaders bind them: base colour, metallic-roughness,
    /// normal, occlusion, emissive. Those of extensions are not among them.
    pub fn texture_slots(&self) -> [Option<TextureRef>; 5] {
        [
            self.base_color_texture,
            self.metallic_roughness_texture,
            self.normal_texture,
            self.occlusion_texture,
            self.emissive_texture,
        ]
    }

    /// Returns whether it, or a layer of it, has a normal map.
    pub fn has_normal_map(&self) -> bool {
        let coat = self.extensions.as_ref().and_then(|of| of.clearcoat.as_ref());
        self.normal_texture.is_some() || coat.is_some_and(|of| of.normal_texture.is_some())
    }

    /// Returns whether its vertices need tangents.
    pub fn needs_tangents(&self) -> bool {
        let extensions = self.extensions.as_ref();
        self.has_normal_map() || extensions.is_some_and(|of| of.anisotropy.is_some())
    }

    /// Returns whether light passes through it.
    pub fn transmits(&self) -> bool {
        let extensions = self.extensions.as_ref().filter(|_| !self.unlit);
        extensions.is_some_and(|of| of.transmission.is_some())
    }

    /// Returns whether baked light lies on it.
    pub fn has_baked_light(&self) -> bool {
        let extensions = self.extensions.as_ref().filter(|_| !self.unlit);
        extensions.is_some_and(|of| of.baked_light.is_some())
    }

    /// The textures that it has, to change them: those of extensions last.
    pub fn textures_mut(&mut self) -> impl Iterator<Item = &mut TextureRef> {
        [
            &mut self.base_color_texture,
            &mut self.metallic_roughness_texture,
            &mut self.normal_texture,
            &mut self.occlusion_texture,
            &mut self.emissive_texture,
        ]
        .into_iter()
        .flatten()
        .chain(self.extensions.iter_mut().flat_map(|of| of.slots_mut()).flatten())
    }

    /// The textures that it has: those of extensions last.
    pub fn textures(&self) -> impl Iterator<Item = TextureRef> {
        let further = self.extensions.iter().flat_map(|of| of.texture_slots());
        self.texture_slots().into_iter().chain(further).flatten()
    }
}
