//! Extensions of materials.

use glam::Vec3;
use gltf::json;
use polyptych_scene::{
    Anisotropy, BakedLight, Clearcoat, DiffuseTransmission, EXTENSION_TEXTURES_MAX, Iridescence,
    MaterialExtensions, Sheen, Specular, Transmission, Volume,
};
use serde::Deserialize;

use super::error::BakeError;
use super::json::JsonError;
use super::material::{FACTOR_MAX, MaterialContext, TextureKind, limit};

/// `KHR_materials_ior`.
#[derive(Deserialize)]
#[serde(default)]
struct IorJson {
    ior: f32,
}

impl Default for IorJson {
    fn default() -> Self {
        Self { ior: Specular::IOR_DEFAULT }
    }
}

/// `KHR_materials_specular`.
#[derive(Deserialize)]
#[serde(default)]
struct SpecularJson {
    #[serde(rename = "specularFactor")]
    factor: f32,
    #[serde(rename = "specularTexture")]
    texture: Option<json::texture::Info>,
    #[serde(rename = "specularColorFactor")]
    color_factor: [f32; 3],
    #[serde(rename = "specularColorTexture")]
    color_texture: Option<json::texture::Info>,
}

impl Default for SpecularJson {
    fn default() -> Self {
        Self { factor: 1.0, texture: None, color_factor: [1.0; 3], color_texture: None }
    }
}

/// `KHR_materials_clearcoat`.
#[derive(Deserialize, Default)]
#[serde(default)]
struct ClearcoatJson {
    #[serde(rename = "clearcoatFactor")]
    factor: f32,
    #[serde(rename = "clearcoatTexture")]
    texture: Option<json::texture::Info>,
    #[serde(rename = "clearcoatRoughnessFactor")]
    roughness: f32,
    #[serde(rename = "clearcoatRoughnessTexture")]
    roughness_texture: Option<json::texture::Info>,
    #[serde(rename = "clearcoatNormalTexture")]
    normal_texture: Option<json::material::NormalTexture>,
}

/// `KHR_materials_sheen`.
#[derive(Deserialize, Default)]
#[serde(default)]
struct SheenJson {
    #[serde(rename = "sheenColorFactor")]
    color_factor: [f32; 3],
    #[serde(rename = "sheenColorTexture")]
    color_texture: Option<json::texture::Info>,
    #[serde(rename = "sheenRoughnessFactor")]
    roughness: f32,
    #[serde(rename = "sheenRoughnessTexture")]
    roughness_texture: Option<json::texture::Info>,
}

/// `KHR_materials_transmission`.
#[derive(Deserialize, Default)]
#[serde(default)]
struct TransmissionJson {
    #[serde(rename = "transmissionFactor")]
    factor: f32,
    #[serde(rename = "transmissionTexture")]
    texture: Option<json::texture::Info>,
}

/// `KHR_materials_volume`.
#[derive(Deserialize)]
#[serde(default)]
struct VolumeJson {
    #[serde(rename = "thicknessFactor")]
    thickness: f32,
    #[serde(rename = "thicknessTexture")]
    thickness_texture: Option<json::texture::Info>,
    #[serde(rename = "attenuationDistance")]
    attenuation_distance: f32,
    #[serde(rename = "attenuationColor")]
    attenuation_color: [f32; 3],
}

impl Default for VolumeJson {
    fn default() -> Self {
        Self {
            thickness: 0.0,
            thickness_texture: None,
            attenuation_distance: f32::INFINITY,
            attenuation_color: [1.0; 3],
        }
    }
}

/// `KHR_materials_dispersion`.
#[derive(Deserialize, Default)]
#[serde(default)]
struct DispersionJson {
    dispersion: f32,
}

/// `KHR_materials_anisotropy`.
#[derive(Deserialize, Default)]
#[serde(default)]
struct AnisotropyJson {
    #[serde(rename = "anisotropyStrength")]
    strength: f32,
    #[serde(rename = "anisotropyRotation")]
    rotation_rad: f32,
    #[serde(rename = "anisotropyTexture")]
    texture: Option<json::texture::Info>,
}

/// `KHR_materials_iridescence`.
#[derive(Deserialize)]
#[serde(default)]
struct IridescenceJson {
    #[serde(rename = "iridescenceFactor")]
    factor: f32,
    #[serde(rename = "iridescenceTexture")]
    texture: Option<json::texture::Info>,
    #[serde(rename = "iridescenceIor")]
    ior: f32,
    #[serde(rename = "iridescenceThicknessMinimum")]
    thickness_min: f32,
    #[serde(rename = "iridescenceThicknessMaximum")]
    thickness_max: f32,
    #[serde(rename = "iridescenceThicknessTexture")]
    thickness_texture: Option<json::texture::Info>,
}

impl Default for IridescenceJson {
    fn default() -> Self {
        let of = Iridescence::default();
        let (thickness_min, thickness_max) = (of.thickness_min_nm, of.thickness_max_nm);
        let (texture, thickness_texture) = (None, None);
        let (factor, ior) = (of.factor, of.ior);
        Self { factor, texture, ior, thickness_min, thickness_max, thickness_texture }
    }
}

/// `KHR_materials_diffuse_transmission`.
#[derive(Deserialize)]
#[serde(default)]
struct DiffuseTransmissionJson {
    #[serde(rename = "diffuseTransmissionFactor")]
    factor: f32,
    #[serde(rename = "diffuseTransmissionTexture")]
    texture: Option<json::texture::Info>,
    #[serde(rename = "diffuseTransmissionColorFactor")]
    color_factor: [f32; 3],
    #[serde(rename = "diffuseTransmissionColorTexture")]
    color_texture: Option<json::texture::Info>,
}

impl Default for DiffuseTransmissionJson {
    fn default() -> Self {
        Self { factor: 0.0, texture: None, color_factor: [1.0; 3], color_texture: None }
    }
}

/// `MOZ_lightmap`: a texture with an intensity. Unlike that of other textures, its set of
/// coordinates is the second one if it names none.
#[derive(Deserialize)]
struct BakedLightJson {
    index: json::Index<json::Texture>,
    #[serde(rename = "texCoord")]
    tex_coord: Option<u32>,
    extensions: Option<json::extensions::texture::Info>,
    intensity: Option<f32>,
}

/// The name of the extension of baked light.
const LIGHT_MAP: &str = "MOZ_lightmap";

impl MaterialContext<'_, '_, '_> {
    /// Reads an extension of the material; `None` where it has none.
    pub(super) fn extension<T: for<'de> Deserialize<'de>>(
        &self,
        json: &json::Material,
        name: &str,
    ) -> Result<Option<T>, BakeError> {
        let value = json.extensions.as_ref().and_then(|extensions| extensions.others.get(name));
        let read = value.map(super::json::from_value).transpose();
        read.map_err(|JsonError { path, error }| {
            let dot = if path.is_empty() { "" } else { "." };
            let place = format!("{}.extensions.{name}{dot}{path}", self.place);
            BakeError::at(
                place,
                error.to_string(),
                "what the extension's schema has would be right",
            )
        })
    }

    /// Returns whether an animation changes a property of one of its extensions, which is kept then
    /// also where nothing of it is seen without.
    fn is_changed(&self, name: &'static str) -> bool {
        self.job.clips.change_extension(self.source, name)
    }

    /// Reads all extensions that add something to the material; `None` where nothing of them can
    /// be seen. Textures that shaders cannot hold are left out, with a note. `converted` stands for
    /// the extensions of its reflection, if given.
    pub(super) fn extensions(
        &mut self,
        json: &json::Material,
        converted: Option<Specular>,
    ) -> Result<Option<Box<MaterialExtensions>>, BakeError> {
        let specular = converted.map_or_else(|| self.specular(json), |of| Ok(Some(of)))?;
        let (clearcoat, sheen) = (self.clearcoat(json)?, self.sheen(json)?);
        let transmission = self.transmission(json)?;
        let diffuse_transmission = self.diffuse_transmission(json)?;
        let passes = transmission.is_some() || diffuse_transmission.is_some();
        let volume = self.volume(json)?.filter(|_| passes);
        let anisotropy = self.anisotropy(json)?;
        let iridescence = self.iridescence(json)?;
        let baked_light = self.baked_light(json)?;
        let mut made = MaterialExtensions {
            specular,
            clearcoat,
            sheen,
            transmission,
            volume,
            anisotropy,
            iridescence,
            diffuse_transmission,
            baked_light,
        };
        self.leave_out_textures(&mut made);
        let is_plain = made == MaterialExtensions::default();
        Ok((!is_plain).then(|| Box::new(made)))
    }

    pub(super) fn leave_out_textures(&mut self, of: &mut MaterialExtensions) {
        let distinct = of.distinct_textures();
        let Some(further) = distinct.get(EXTENSION_TEXTURES_MAX..).filter(|of| !of.is_empty())
        else {
            return;
        };
        for slot in of.slots_mut() {
            *slot = slot.take().filter(|used| !further.contains(used));
        }
        of.baked_light = of.baked_light.take().filter(|of| of.texture.is_some());
        let place = &self.place;
        self.job.warn(&format!(
            "{place}: drawn without some textures of extensions, which are more than \
             {EXTENSION_TEXTURES_MAX}; join them in the channels of fewer images"
        ));
    }

    pub(super) fn optional(
        &mut self,
        info: Option<&json::texture::Info>,
        content: TextureKind,
    ) -> Result<Option<polyptych_scene::TextureRef>, BakeError> {
        info.map_or(Ok(None), |info| self.info(info, content))
    }

    /// An index of refraction below 1, which glTF forbids but for 0, becomes 1.
    fn specular(&mut self, json: &json::Material) -> Result<Option<Specular>, BakeError> {
        let ior = self.extension::<IorJson>(json, "KHR_materials_ior")?;
        let read = self.extension::<SpecularJson>(json, "KHR_materials_specular")?;
        // What an animation changes must be there.
        let is_kept = (ior.is_some() && self.is_changed("KHR_materials_ior"))
            || (read.is_some() && self.is_changed("KHR_materials_specular"));
        let (ior, read) = (ior.unwrap_or_default().ior, read.unwrap_or_default());
        let made = Specular {
            ior: if ior == 0.0 { 0.0 } else { limit(ior, 1.0, FACTOR_MAX) },
            factor: limit(read.factor, 0.0, 1.0),
            color: Vec3::from(read.color_factor.map(|of| limit(of, 0.0, FACTOR_MAX))),
            texture: self.optional(read.texture.as_ref(), TextureKind::Tint)?,
            color_texture: self.optional(read.color_texture.as_ref(), TextureKind::Tint)?,
        };
        Ok((is_kept || made != Specular::default()).then_some(made))
    }

    fn clearcoat(&mut self, json: &json::Material) -> Result<Option<Clearcoat>, BakeError> {
        let read = self.extension::<ClearcoatJson>(json, "KHR_materials_clearcoat")?;
        let is_kept = self.is_changed("KHR_materials_clearcoat");
        let read = read.filter(|read| is_kept || read.factor > 0.0);
        let Some(read) = read else { return Ok(None) };
        let scale = read.normal_texture.as_ref().map_or(1.0, |normal| normal.scale);
        Ok(Some(Clearcoat {
            factor: limit(read.factor, 0.0, 1.0),
            roughness: limit(read.roughness, 0.0, 1.0),
            normal_scale: limit(scale, -FACTOR_MAX, FACTOR_MAX),
            texture: self.optional(read.texture.as_ref(), TextureKind::Data)?,
            roughness_texture: self.optional(read.roughness_texture.as_ref(), TextureKind::Data)?,
            normal_texture: read
                .normal_texture
                .as_ref()
                .map_or(Ok(None), |normal| self.normals(normal))?,
        }))
    }

    fn sheen(&mut self, json: &json::Material) -> Result<Option<Sheen>, BakeError> {
        let read = self.extension::<SheenJson>(json, "KHR_materials_sheen")?;
        let Some(read) = read else { return Ok(None) };
        let color = Vec3::from(read.color_factor.map(|of| limit(of, 0.0, 1.0)));
        if color == Vec3::ZERO && !self.is_changed("KHR_materials_sheen") {
            return Ok(None);
        }
        Ok(Some(Sheen {
            color,
            roughness: limit(read.roughness, 0.0, 1.0),
            color_texture: self.optional(read.color_texture.as_ref(), TextureKind::Tint)?,
            roughness_texture: self.optional(read.roughness_texture.as_ref(), TextureKind::Tint)?,
        }))
    }

    fn transmission(&mut self, json: &json::Material) -> Result<Option<Transmission>, BakeError> {
        let read = self.extension::<TransmissionJson>(json, "KHR_materials_transmission")?;
        let is_kept = self.is_changed("KHR_materials_transmission");
        let read = read.filter(|read| is_kept || read.factor > 0.0);
        let Some(read) = read else { return Ok(None) };
        Ok(Some(Transmission {
            factor: limit(read.factor, 0.0, 1.0),
            texture: self.optional(read.texture.as_ref(), TextureKind::Data)?,
        }))
    }

    /// Without thickness nothing is refracted or absorbed. A distance that glTF forbids stands for
    /// a volume that absorbs nothing, as a missing one does.
    fn volume(&mut self, json: &json::Material) -> Result<Option<Volume>, BakeError> {
        let read = self.extension::<VolumeJson>(json, "KHR_materials_volume")?;
        let spread = self.extension::<DispersionJson>(json, "KHR_materials_dispersion")?;
        let is_kept = self.is_changed("KHR_materials_volume");
        let read = read.filter(|read| is_kept || read.thickness > 0.0);
        let Some(read) = read else { return Ok(None) };
        let distance = read.attenuation_distance;
        let distance = if distance > 0.0 { distance } else { f32::INFINITY };
        Ok(Some(Volume {
            thickness: limit(read.thickness, 0.0, FACTOR_MAX),
            attenuation_distance: distance.max(f32::MIN_POSITIVE),
            attenuation_color: Vec3::from(read.attenuation_color.map(|of| limit(of, 0.0, 1.0))),
            dispersion: limit(spread.unwrap_or_default().dispersion, 0.0, FACTOR_MAX),
            thickness_texture: self.optional(read.thickness_texture.as_ref(), TextureKind::Data)?,
        }))
    }

    /// Its direction is that of the tangents, which a texture of it asks for, too, unless a normal
    /// map does. A direction that is not a number is that of the tangent.
    fn anisotropy(&mut self, json: &json::Material) -> Result<Option<Anisotropy>, BakeError> {
        let read = self.extension::<AnisotropyJson>(json, "KHR_materials_anisotropy")?;
        let is_kept = self.is_changed("KHR_materials_anisotropy");
        let read = read.filter(|read| is_kept || read.strength > 0.0);
        let Some(read) = read else { return Ok(None) };
        let texture = self.optional(read.texture.as_ref(), TextureKind::Data)?;
        self.tangents(texture);
        let rotation_rad = if read.rotation_rad.is_finite() { read.rotation_rad } else { 0.0 };
        Ok(Some(Anisotropy { strength: limit(read.strength, 0.0, 1.0), rotation_rad, texture }))
    }

    /// An index of refraction below 1, which glTF forbids, becomes 1.
    fn iridescence(&mut self, json: &json::Material) -> Result<Option<Iridescence>, BakeError> {
        let read = self.extension::<IridescenceJson>(json, "KHR_materials_iridescence")?;
        let is_kept = self.is_changed("KHR_materials_iridescence");
        let read = read.filter(|read| is_kept || read.factor > 0.0);
        let Some(read) = read else { return Ok(None) };
        Ok(Some(Iridescence {
            factor: limit(read.factor, 0.0, 1.0),
            ior: limit(read.ior, 1.0, FACTOR_MAX),
            thickness_min_nm: limit(read.thickness_min, 0.0, FACTOR_MAX),
            thickness_max_nm: limit(read.thickness_max, 0.0, FACTOR_MAX),
            texture: self.optional(read.texture.as_ref(), TextureKind::Data)?,
            thickness_texture: self.optional(read.thickness_texture.as_ref(), TextureKind::Data)?,
        }))
    }

    fn diffuse_transmission(
        &mut self,
        json: &json::Material,
    ) -> Result<Option<DiffuseTransmission>, BakeError> {
        let name = "KHR_materials_diffuse_transmission";
        let read = self.extension::<DiffuseTransmissionJson>(json, name)?;
        let is_kept = self.is_changed(name);
        let read = read.filter(|read| is_kept || read.factor > 0.0);
        let Some(read) = read else { return Ok(None) };
        Ok(Some(DiffuseTransmission {
            factor: limit(read.factor, 0.0, 1.0),
            color: Vec3::from(read.color_factor.map(|of| limit(of, 0.0, 1.0))),
            texture: self.optional(read.texture.as_ref(), TextureKind::Tint)?,
            color_texture: self.optional(read.color_texture.as_ref(), TextureKind::Tint)?,
        }))
    }

    fn baked_light(&mut self, json: &json::Material) -> Result<Option<BakedLight>, BakeError> {
        let Some(read) = self.extension::<BakedLightJson>(json, LIGHT_MAP)? else {
            return Ok(None);
        };
        let intensity = limit(read.intensity.unwrap_or(1.0), 0.0, FACTOR_MAX);
        if intensity == 0.0 {
            return Ok(None);
        }
        let (index, tex_coord) = (read.index, read.tex_coord.unwrap_or(1));
        let extras = json::Extras::default();
        let info = json::texture::Info { index, tex_coord, extensions: read.extensions, extras };
        let texture = self.info(&info, TextureKind::Data)?;
        Ok(texture.map(|texture| BakedLight { intensity, texture: Some(texture) }))
    }

    /// Notes baked light on a material that takes no light.
    pub(super) fn note_unlit(&mut self, json: &json::Material) {
        if json.extensions.as_ref().is_some_and(|of| of.others.contains_key(LIGHT_MAP)) {
            let place = &self.place;
            self.job.warn(&format!("{place}: drawn without its {LIGHT_MAP}, since it is unlit"));
        }
    }
}
