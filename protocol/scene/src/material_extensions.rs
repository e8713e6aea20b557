//! The properties that glTF's extensions add to the metallic-roughness model.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::TextureRef;

/// Textures of extensions that a material can have beside its own five: those of one image with
/// one set of coordinates and one transform count once. Shaders can read 16 textures together by
/// the default limits of wgpu; the rest are those of the frame and of the material itself.
pub const EXTENSION_TEXTURES_MAX: usize = 5;

/// Slots of textures that all extensions together have.
pub const EXTENSION_SLOTS: usize = 15;

/// The extensions of a material. Factors multiply the textures; all are linear.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MaterialExtensions {
    /// The reflection of what is not metal.
    pub specular: Option<Specular>,
    /// A clear layer above everything else.
    pub clearcoat: Option<Clearcoat>,
    /// Fibres above the surface, below the clear coat.
    pub sheen: Option<Sheen>,
    /// Light that passes through the surface.
    pub transmission: Option<Transmission>,
    /// The substance below a surface that transmits light, diffusely or not; a thin wall if `None`.
    pub volume: Option<Volume>,
    /// Reflections that are longer in one direction.
    pub anisotropy: Option<Anisotropy>,
    /// A film so thin that light interferes in it.
    pub iridescence: Option<Iridescence>,
    /// Light that passes through the surface and is scattered evenly.
    pub diffuse_transmission: Option<DiffuseTransmission>,
    /// Light that was computed before and is kept in a texture.
    pub baked_light: Option<BakedLight>,
}

/// `KHR_materials_ior` and `KHR_materials_specular`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Specular {
    /// Index of refraction: 1 or more; 0 for one without end, so that the colour alone says what
    /// is reflected.
    pub ior: f32,
    /// Part of the reflection that is there: 0 to 1.
    pub factor: f32,
    /// Linear RGB that tints what is reflected from the front; may be larger than 1.
    pub color: Vec3,
    /// The part in A.
    pub texture: Option<TextureRef>,
    /// sRGB.
    pub color_texture: Option<TextureRef>,
}

/// `KHR_materials_clearcoat`: a layer of an index of refraction of 1.5.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clearcoat {
    /// Part of the layer that is there: 0 to 1.
    pub factor: f32,
    /// Perceptual; its square is GGX's α.
    pub roughness: f32,
    /// Multiplies x and y of the normal map.
    pub normal_scale: f32,
    /// The part in R.
    pub texture: Option<TextureRef>,
    /// Roughness in G.
    pub roughness_texture: Option<TextureRef>,
    /// Tangent-space normals, +Y up. Without it the layer is as smooth as the mesh, whatever
    /// normal map the material has.
    pub normal_texture: Option<TextureRef>,
}

/// `KHR_materials_sheen`: fibres that stand along the normal, as those of velvet.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sheen {
    /// Linear RGB that the fibres reflect: 0 to 1.
    pub color: Vec3,
    /// Perceptual; its square is the α of the distribution of fibres.
    pub roughness: f32,
    /// sRGB.
    pub color_texture: Option<TextureRef>,
    /// Roughness in A.
    pub roughness_texture: Option<TextureRef>,
}

/// `KHR_materials_transmission`: light that passes through instead of being reflected diffusely,
/// tinted by the base colour.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transmission {
    /// Part of the light below the surface that passes: 0 to 1.
    pub factor: f32,
    /// The part in R.
    pub texture: Option<TextureRef>,
}

/// `KHR_materials_volume` and `KHR_materials_dispersion`: refraction by [`Specular::ior`], and
/// light that is absorbed on its way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Volume {
    /// Length of the way through the volume, in units of the mesh: 0 or more.
    pub thickness: f32,
    /// Units of the world after which light has [`Self::attenuation_color`]: more than 0, and
    /// infinite where nothing is absorbed.
    pub attenuation_distance: f32,
    /// Linear RGB: 0 to 1.
    pub attenuation_color: Vec3,
    /// 20 over the Abbe number: 0 where all wavelengths are refracted alike.
    pub dispersion: f32,
    /// Factor of the thickness in G.
    pub thickness_texture: Option<TextureRef>,
}

/// `KHR_materials_anisotropy`: highlights that are stretched along a direction of the surface, as
/// those of brushed metal. Vertices need tangents.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Anisotropy {
    /// Part of the way from the roughness to 1 along the direction, as a square root: 0 to 1.
    pub strength: f32,
    /// Angle of the direction from the tangent towards the bitangent, in radians.
    pub rotation_rad: f32,
    /// The direction in R and G, from -1 to 1 along tangent and bitangent, and a factor of the
    /// strength in B.
    pub texture: Option<TextureRef>,
}

/// `KHR_materials_diffuse_transmission`: light of the other side that is scattered evenly, as by a
/// leaf or paper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiffuseTransmission {
    /// Part of the light below the surface that passes: 0 to 1.
    pub factor: f32,
    /// Linear RGB of the light that passes: 0 to 1.
    pub color: Vec3,
    /// The part in A.
    pub texture: Option<TextureRef>,
    /// sRGB.
    pub color_texture: Option<TextureRef>,
}

/// `MOZ_lightmap`: the diffuse light on a surface, occlusion and all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakedLight {
    /// Factor of the texels: 0 or more.
    pub intensity: f32,
    /// Irradiance as linear RGB, in the unit of directional lights (lux); no light if `None`.
    pub texture: Option<TextureRef>,
}

impl Anisotropy {
    /// Returns the direction as parts along tangent and bitangent, of length 1, by sines that do
    /// not depend on the machine; the tangent if the rotation is not finite.
    pub fn direction(&self) -> Vec2 {
        let (sin, cos) = libm::sincos(f64::from(self.rotation_rad));
        let direction = Vec2::new(cos as f32, sin as f32);
        if direction.is_finite() { direction } else { Vec2::X }
    }
}

impl Default for DiffuseTransmission {
    /// No light, of any colour.
    fn default() -> Self {
        let (texture, color_texture) = (None, None);
        Self { factor: 0.0, color: Vec3::ONE, texture, color_texture }
    }
}

/// `KHR_materials_iridescence`: a film on the surface whose colour depends on the angle, as that of
/// a soap bubble.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Iridescence {
    /// Part of the reflection that the film changes: 0 to 1.
    pub factor: f32,
    /// Index of refraction of the film: 1 or more.
    pub ior: f32,
    /// Thickness in nanometres where the texture is 0: 0 or more.
    pub thickness_min_nm: f32,
    /// Thickness in nanometres where the texture is 1, and without a texture: 0 or more.
    pub thickness_max_nm: f32,
    /// The part in R.
    pub texture: Option<TextureRef>,
    /// The thickness in G, from the minimum to the maximum.
    pub thickness_texture: Option<TextureRef>,
}

impl Default for Iridescence {
    /// Nothing of a film as glTF's default has it.
    fn default() -> Self {
        let (texture, thickness_texture) = (None, None);
        let (factor, ior, thickness_min_nm, thickness_max_nm) = (0.0, 1.3, 100.0, 400.0);
        Self { factor, ior, thickness_min_nm, thickness_max_nm, texture, thickness_texture }
    }
}

impl Default for Volume {
    /// A clear volume without thickness.
    fn default() -> Self {
        Self {
            thickness: 0.0,
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
            dispersion: 0.0,
            thickness_texture: None,
        }
    }
}

impl Volume {
    /// Least colour of which the absorption is finite: e⁻¹⁴, less than any display shows.
    const COLOR_MIN: f32 = 8e-7;

    /// Returns the part of light that is absorbed per unit of the world, as the σ of Beer's law
    /// e^(−σ x): −ln(colour) / distance, by `KHR_materials_volume`.
    pub fn absorption(&self) -> Vec3 {
        let color = self.attenuation_color.max(Vec3::splat(Self::COLOR_MIN));
        color.map(|of| -of.ln() / self.attenuation_distance)
    }
}

impl Default for Clearcoat {
    /// Nothing of a smooth layer.
    fn default() -> Self {
        let [texture, roughness_texture, normal_texture] = [None; 3];
        let (factor, roughness, normal_scale) = (0.0, 0.0, 1.0);
        Self { factor, roughness, normal_scale, texture, roughness_texture, normal_texture }
    }
}

impl Default for Specular {
    fn default() -> Self {
        let (texture, color_texture) = (None, None);
        Self { ior: Self::IOR_DEFAULT, factor: 1.0, color: Vec3::ONE, texture, color_texture }
    }
}

impl Specular {
    /// The index of refraction of a material without the extension.
    pub const IOR_DEFAULT: f32 = 1.5;

    /// Returns the reflectance from the front that the index of refraction alone makes.
    pub fn reflectance(&self) -> f32 {
        let ratio = (self.ior - 1.0) / (self.ior + 1.0);
        ratio * ratio
    }
}

impl MaterialExtensions {
    /// Returns its textures in the order in which shaders name them: the part of the reflection,
    /// its colour; the part of the clear coat, its roughness, its normals; the colour of
    /// the sheen, its roughness; the part that passes, the thickness; the anisotropy; the part of
    /// the film, its thickness; the part that passes diffusely, its colour; the baked light.
    pub fn texture_slots(&self) -> [Option<TextureRef>; EXTENSION_SLOTS] {
        let specular = self.specular.as_ref();
        let coat = self.clearcoat.as_ref();
        [
            specular.and_then(|of| of.texture),
            specular.and_then(|of| of.color_texture),
            coat.and_then(|of| of.texture),
            coat.and_then(|of| of.roughness_texture),
            coat.and_then(|of| of.normal_texture),
            self.sheen.as_ref().and_then(|of| of.color_texture),
            self.sheen.as_ref().and_then(|of| of.roughness_texture),
            self.transmission.as_ref().and_then(|of| of.texture),
            self.volume.as_ref().and_then(|of| of.thickness_texture),
            self.anisotropy.as_ref().and_then(|of| of.texture),
            self.iridescence.as_ref().and_then(|of| of.texture),
            self.iridescence.as_ref().and_then(|of| of.thickness_texture),
            self.diffuse_transmission.as_ref().and_then(|of| of.texture),
            self.diffuse_transmission.as_ref().and_then(|of| of.color_texture),
            self.baked_light.as_ref().and_then(|of| of.texture),
        ]
    }

    /// The slots of those extensions that it has, to change them, in the same order.
    pub fn slots_mut(&mut self) -> impl Iterator<Item = &mut Option<TextureRef>> {
        let specular = self.specular.iter_mut();
        let specular = specular.flat_map(|of| [&mut of.texture, &mut of.color_texture]);
        let coat = self
            .clearcoat
            .iter_mut()
            .flat_map(|of| [&mut of.texture, &mut of.roughness_texture, &mut of.normal_texture]);
        let sheen = self.sheen.iter_mut();
        let sheen = sheen.flat_map(|of| [&mut of.color_texture, &mut of.roughness_texture]);
        let transmission = self.transmission.iter_mut().map(|of| &mut of.texture);
        let volume = self.volume.iter_mut().map(|of| &mut of.thickness_texture);
        let anisotropy = self.anisotropy.iter_mut().map(|of| &mut of.texture);
        let film = self.iridescence.iter_mut();
        let film = film.flat_map(|of| [&mut of.texture, &mut of.thickness_texture]);
        let layers = specular.chain(coat).chain(sheen).chain(transmission).chain(volume);
        let through = self.diffuse_transmission.iter_mut();
        let through = through.flat_map(|of| [&mut of.texture, &mut of.color_texture]);
        let baked = self.baked_light.iter_mut().map(|of| &mut of.texture);
        layers.chain(anisotropy).chain(film).chain(through).chain(baked)
    }

    /// Returns whether light that passes goes through a volume.
    pub fn has_volume(&self) -> bool {
        let passes = self.transmission.is_some() || self.diffuse_transmission.is_some();
        passes && self.volume.is_some()
    }

    /// Returns its different textures, in the order of the slots. Shaders read no more than the
    /// first [`EXTENSION_TEXTURES_MAX`].
    pub fn distinct_textures(&self) -> Vec<TextureRef> {
        let mut distinct = Vec::new();
        for texture in self.texture_slots().into_iter().flatten() {
            if !distinct.contains(&texture) {
                distinct.push(texture);
            }
        }
        distinct
    }

    /// Returns what is wrong with its numbers, if anything.
    pub fn fault(&self) -> Option<String> {
        let specular = self.specular.as_ref().and_then(specular_fault);
        let coat = || self.clearcoat.as_ref().and_then(clearcoat_fault);
        let sheen = || self.sheen.as_ref().and_then(sheen_fault);
        let transmission = || self.transmission.as_ref().and_then(transmission_fault);
        let volume = || self.volume.as_ref().and_then(volume_fault);
        let anisotropy = || self.anisotropy.as_ref().and_then(anisotropy_fault);
        let glass = || transmission().or_else(volume);
        let film = || self.iridescence.as_ref().and_then(iridescence_fault);
        let layers = specular.or_else(coat).or_else(sheen).or_else(glass);
        let through = || self.diffuse_transmission.as_ref().and_then(diffuse_transmission_fault);
        let baked = || {
            let intensity = self.baked_light.as_ref().map(|of| of.intensity);
            intensity.and_then(|of| amount_fault("baked_light.intensity", of))
        };
        layers.or_else(anisotropy).or_else(film).or_else(through).or_else(baked)
    }
}

fn specular_fault(of: &Specular) -> Option<String> {
    let is_index = of.ior == 0.0 || (of.ior >= 1.0 && of.ior.is_finite());
    let ior = (!is_index).then(|| format!("specular.ior is 0, or 1 or more, not {}", of.ior));
    let color = || color_fault("specular.color", of.color);
    ior.or_else(color).or_else(|| share_fault("specular.factor", of.factor))
}

fn clearcoat_fault(of: &Clearcoat) -> Option<String> {
    let scale = of.normal_scale;
    let scale = (!scale.is_finite()).then(|| format!("clearcoat.normal_scale is {scale}"));
    let roughness = || share_fault("clearcoat.roughness", of.roughness);
    share_fault("clearcoat.factor", of.factor).or_else(roughness).or(scale)
}

fn sheen_fault(of: &Sheen) -> Option<String> {
    let [r, g, b] = of.color.to_array().map(|part| share_fault("sheen.color", part));
    r.or(g).or(b).or_else(|| share_fault("sheen.roughness", of.roughness))
}

fn transmission_fault(of: &Transmission) -> Option<String> {
    share_fault("transmission.factor", of.factor)
}

fn volume_fault(of: &Volume) -> Option<String> {
    let distance = of.attenuation_distance;
    let distance = (distance.is_nan() || distance <= 0.0)
        .then(|| format!("volume.attenuation_distance is more than 0, not {distance}"));
    let [r, g, b] =
        of.attenuation_color.to_array().map(|part| share_fault("volume.attenuation_color", part));
    let thickness = || amount_fault("volume.thickness", of.thickness);
    let dispersion = || amount_fault("volume.dispersion", of.dispersion);
    distance.or(r).or(g).or(b).or_else(thickness).or_else(dispersion)
}

fn anisotropy_fault(of: &Anisotropy) -> Option<String> {
    let angle = of.rotation_rad;
    let angle =
        (!angle.is_finite()).then(|| format!("anisotropy.rotation_rad is finite, not {angle}"));
    share_fault("anisotropy.strength", of.strength).or(angle)
}

fn iridescence_fault(of: &Iridescence) -> Option<String> {
    let is_index = of.ior >= 1.0 && of.ior.is_finite();
    let ior = (!is_index).then(|| format!("iridescence.ior is 1 or more, not {}", of.ior));
    let min = || amount_fault("iridescence.thickness_min_nm", of.thickness_min_nm);
    let max = || amount_fault("iridescence.thickness_max_nm", of.thickness_max_nm);
    share_fault("iridescence.factor", of.factor).or(ior).or_else(min).or_else(max)
}

fn diffuse_transmission_fault(of: &DiffuseTransmission) -> Option<String> {
    let color = of.color.to_array().map(|part| share_fault("diffuse_transmission.color", part));
    let [r, g, b] = color;
    r.or(g).or(b).or_else(|| share_fault("diffuse_transmission.factor", of.factor))
}

fn amount_fault(what: &str, value: f32) -> Option<String> {
    let is_amount = value >= 0.0 && value.is_finite();
    (!is_amount).then(|| format!("{what} is 0 or more, not {value}"))
}

fn share_fault(what: &str, value: f32) -> Option<String> {
    let is_share = (0.0..=1.0).contains(&value);
    (!is_share).then(|| format!("{what} is 0 to 1, not {value}"))
}

fn color_fault(what: &str, color: Vec3) -> Option<String> {
    let is_color = color.is_finite() && color.min_element() >= 0.0;
    (!is_color).then(|| format!("{what} is 0 or more in all three, not {color}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_their_range_are_named() {
        let brushed = |strength, rotation_rad| MaterialExtensions {
            anisotropy: Some(Anisotropy { strength, rotation_rad, texture: None }),
            ..MaterialExtensions::default()
        };
        let filmy = |ior, thickness_max_nm| MaterialExtensions {
            iridescence: Some(Iridescence { ior, thickness_max_nm, ..Iridescence::default() }),
            ..MaterialExtensions::default()
        };
        let translucent = |factor, red| MaterialExtensions {
            diffuse_transmission: Some(DiffuseTransmission {
                factor,
                color: Vec3::new(red, 0.5, 1.0),
                ..DiffuseTransmission::default()
            }),
            ..MaterialExtensions::default()
        };
        let baked = |intensity| MaterialExtensions {
            baked_light: Some(BakedLight { intensity, texture: None }),
            ..MaterialExtensions::default()
        };
        for sound in [brushed(1.0, -40.0), filmy(1.0, 0.0), translucent(1.0, 0.0), baked(99.0)] {
            assert_eq!(sound.fault(), None);
        }
        for (wrong, part) in [
            (brushed(1.5, 0.0), "anisotropy.strength is 0 to 1, not 1.5"),
            (brushed(f32::NAN, 0.0), "anisotropy.strength is 0 to 1"),
            (brushed(1.0, f32::INFINITY), "anisotropy.rotation_rad is finite, not inf"),
            (filmy(0.9, 1.0), "iridescence.ior is 1 or more, not 0.9"),
            (filmy(f32::INFINITY, 1.0), "iridescence.ior is 1 or more"),
            (filmy(1.3, -1.0), "iridescence.thickness_max_nm is 0 or more, not -1"),
            (translucent(-0.1, 0.0), "diffuse_transmission.factor is 0 to 1, not -0.1"),
            (translucent(1.0, 2.0), "diffuse_transmission.color is 0 to 1, not 2"),
            (baked(-1.0), "baked_light.intensity is 0 or more, not -1"),
            (baked(f32::NAN), "baked_light.intensity is 0 or more"),
        ] {
            let fault = wrong.fault().unwrap_or_default();
            assert!(fault.contains(part), "{fault}: not {part}");
        }
    }

    #[test]
    fn every_texture_is_in_a_slot_and_can_be_changed() {
        let texture = |texture| {
            Some(TextureRef { texture, uv_set: 0, uv_transform: glam::Affine2::IDENTITY })
        };
        let mut all = MaterialExtensions {
            specular: Some(Specular {
                texture: texture(0),
                color_texture: texture(1),
                ..Specular::default()
            }),
            clearcoat: Some(Clearcoat {
                texture: texture(2),
                roughness_texture: texture(3),
                normal_texture: texture(4),
                ..Clearcoat::default()
            }),
            sheen: Some(Sheen {
                color_texture: texture(5),
                roughness_texture: texture(6),
                ..Sheen::default()
            }),
            transmission: Some(Transmission { factor: 1.0, texture: texture(7) }),
            volume: Some(Volume { thickness_texture: texture(8), ..Volume::default() }),
            anisotropy: Some(Anisotropy { texture: texture(9), ..Anisotropy::default() }),
            iridescence: Some(Iridescence {
                texture: texture(10),
                thickness_texture: texture(11),
                ..Iridescence::default()
            }),
            diffuse_transmission: Some(DiffuseTransmission {
                texture: texture(12),
                color_texture: texture(13),
                ..DiffuseTransmission::default()
            }),
            baked_light: Some(BakedLight { intensity: 1.0, texture: texture(14) }),
        };
        let slots = all.texture_slots();
        assert!(slots.iter().zip(0..).all(|(slot, at)| *slot == texture(at)), "{slots:?}");
        let changed: Vec<_> = all.slots_mut().map(|slot| *slot).collect();
        assert_eq!(changed, slots, "in the same order");
    }
}
