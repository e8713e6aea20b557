//! Materials, and what they need of textures and vertices.
//!
//! Only materials that something drawn uses are converted, and only their textures are read. The
//! others are glTF's default: programs count on the numbers of the file.

use std::collections::BTreeMap;

use glam::{Affine2, Mat2, Vec2, Vec3, Vec4};
use gltf::json;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::validation::Checked;
use polyptych_scene::{AlphaMode, Material, TextureRef};

use super::BakeJob;
use super::error::BakeError;
use super::json::JsonError;

/// Largest factor, such as the brightest emission: what a half float can still hold.
pub(super) const FACTOR_MAX: f32 = 65504.0;

/// The content of a texture, which decides how it is filtered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum TextureKind {
    /// sRGB; alpha means nothing.
    Color,
    /// sRGB, weighted by alpha.
    ColorAlpha,
    /// sRGB, weighted by alpha, of a mask that draws what has at least this alpha.
    ColorMask(u8),
    /// Linear numbers.
    Data,
    /// Unit vectors.
    Normal,
    /// sRGB factors of an extension, and linear numbers in alpha.
    Tint,
    /// Glossiness in alpha, which becomes roughness in G; the factor in 65,520ths.
    Glossiness(u16),
}

impl TextureKind {
    /// The content of a material's base colour, whose factor it has already.
    pub(super) fn of_base_color(material: &Material) -> Self {
        let cutoff = match material.alpha_mode {
            AlphaMode::Opaque => return Self::Color,
            AlphaMode::Blend => return Self::ColorAlpha,
            AlphaMode::Mask(cutoff) => cutoff,
        };
        // A mask that draws every alpha, or none, has no share to keep.
        let least = (cutoff / material.base_color.w * 255.0).ceil();
        if (1.0..=255.0).contains(&least) { Self::ColorMask(least as u8) } else { Self::ColorAlpha }
    }
}

/// A texture of the file, as one of its materials uses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct TextureUse {
    /// An index into the file's textures.
    pub texture: u32,
    /// The content that it is read as.
    pub content: TextureKind,
}

/// The requirements of a material on vertices and triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct VertexRequirements {
    /// The number n of the `TEXCOORD_n` that each of the two sets holds; `None` if the set is not
    /// used.
    pub uv_sets: [Option<u32>; 2],
    /// Set of coordinates, and its transform, along which tangents lie; `None` without tangents.
    pub tangents: Option<(u8, Affine2)>,
    /// `true` if triangles must stay in order, because they are blended.
    pub keeps_order: bool,
}

/// A material of the file, whether it is lit, and the sets of uv that its vertices have.
type MaterialKey = (Option<u32>, bool, [Option<u32>; 2]);

/// The materials and textures of a scene.
#[derive(Debug, Default)]
pub(super) struct Palette {
    /// Those of the file in its order, as their first uses need them; behind them those of other
    /// uses, such as unlit ones of a material that is lit elsewhere.
    pub materials: Vec<Material>,
    /// Those that are used, in the order of first use.
    pub textures: Vec<TextureUse>,
    needs: Vec<VertexRequirements>,
    by_source: BTreeMap<MaterialKey, u32>,
    by_use: BTreeMap<TextureUse, u32>,
}

impl Palette {
    /// The palette of a file with so many materials.
    pub(super) fn new(count: usize) -> Self {
        let materials = vec![Material::default(); count];
        let needs = vec![VertexRequirements::default(); count];
        Self { materials, needs, ..Self::default() }
    }

    /// The scene's material for one of the file, which `place` names, and what it needs.
    /// A primitive that has no normals though it needs some is drawn unlit. Its vertices have these
    /// sets of uv already.
    pub(super) fn material(
        &mut self,
        job: &mut BakeJob<'_>,
        source: Option<u32>,
        is_lit: bool,
        uv_sets: [Option<u32>; 2],
        place: &str,
    ) -> Result<(Option<u32>, VertexRequirements), BakeError> {
        if source.is_none() && is_lit {
            return Ok((None, VertexRequirements { uv_sets, ..VertexRequirements::default() }));
        }
        if let Some(&index) = self.by_source.get(&(source, is_lit, uv_sets)) {
            return Ok((Some(index), self.needs[index as usize]));
        }
        let (mut material, needs) = match source {
            Some(index) => {
                let json = job.source.document.materials.at(index, place)?;
                self.convert(job, json, (index, is_lit), uv_sets)?
            }
            None => (
                Material::default(),
                VertexRequirements { uv_sets, ..VertexRequirements::default() },
            ),
        };
        material.unlit |= !is_lit;
        let known = self.by_source.range((source, false, [None; 2])..).next();
        let is_first = known.is_none_or(|((of, ..), _)| *of != source);
        let index = match source.filter(|_| is_first) {
            Some(own) => {
                self.materials[own as usize] = material;
                self.needs[own as usize] = needs;
                own
            }
            None => self.add(material, needs),
        };
        self.by_source.insert((source, is_lit, uv_sets), index);
        Ok((Some(index), needs))
    }

    /// The scene's materials of each of the file, rising, with copies that variants replace.
    pub(super) fn by_file(&self, copies: &[(u32, u32)]) -> BTreeMap<u32, Vec<u32>> {
        let mut by_file: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for ((source, ..), index) in &self.by_source {
            let Some(source) = source else { continue };
            let copies = copies.iter().filter(|(of, _)| of == index).map(|(_, copy)| *copy);
            by_file.entry(*source).or_default().extend(copies.chain([*index]));
        }
        for list in by_file.values_mut() {
            list.sort_unstable();
        }
        by_file
    }

    /// Appends a material; returns its index.
    pub(super) fn add(&mut self, material: Material, needs: VertexRequirements) -> u32 {
        self.materials.push(material);
        self.needs.push(needs);
        self.materials.len() as u32 - 1
    }

    fn convert(
        &mut self,
        job: &mut BakeJob<'_>,
        json: &json::Material,
        (index, is_lit): (u32, bool),
        uv_sets: [Option<u32>; 2],
    ) -> Result<(Material, VertexRequirements), BakeError> {
        let place = format!("materials[{index}]");
        let mut material = factors(json, &place)?;
        let pbr = &json.pbr_metallic_roughness;
        let needs = VertexRequirements { uv_sets, ..VertexRequirements::default() };
        let mut user = MaterialContext { palette: self, job, source: index, place, needs };
        // Unlit is the base colour alone: nothing else is read or kept.
        let is_lit = is_lit && !material.unlit;
        let mut converted = None;
        if !material.unlit {
            converted = user.specular_glossiness(json, &mut material, is_lit)?;
        }
        if let Some(info) = pbr.base_color_texture.as_ref().filter(|_| converted.is_none()) {
            let content = TextureKind::of_base_color(&material);
            material.base_color_texture = user.info(info, content)?;
        }
        if is_lit {
            let of_metal = pbr.metallic_roughness_texture.as_ref();
            if let Some(info) = of_metal.filter(|_| converted.is_none()) {
                material.metallic_roughness_texture = user.info(info, TextureKind::Data)?;
            }
            if let Some(info) = &json.emissive_texture {
                material.emissive_texture = user.info(info, TextureKind::Color)?;
            }
            if let Some(normal) = &json.normal_texture {
                material.normal_texture = user.normals(normal)?;
            }
            if let Some(occlusion) = &json.occlusion_texture {
                let others = occlusion.extensions.as_ref().map(|extensions| &extensions.others);
                let (index, set) = (occlusion.index.value(), occlusion.tex_coord);
                let transform = others.and_then(|others| others.get("KHR_texture_transform"));
                let transform = user.transform(transform)?;
                let used = user.texture(index, set, transform.as_ref(), TextureKind::Data)?;
                material.occlusion_texture = used;
            }
            material.extensions = user.extensions(json, converted)?;
        } else {
            user.note_unlit(json);
        }
        let mut needs = user.needs;
        needs.keeps_order = material.alpha_mode == AlphaMode::Blend;
        Ok((material, needs))
    }
}

/// Everything but textures. JSON numbers may overflow f32; every factor is brought to its range.
fn factors(json: &json::Material, place: &str) -> Result<Material, BakeError> {
    let alpha_mode = match json.alpha_mode {
        Checked::Valid(json::material::AlphaMode::Opaque) => AlphaMode::Opaque,
        Checked::Valid(json::material::AlphaMode::Mask) => {
            AlphaMode::Mask(limit(json.alpha_cutoff.unwrap_or_default().0, 0.0, FACTOR_MAX))
        }
        Checked::Valid(json::material::AlphaMode::Blend) => AlphaMode::Blend,
        Checked::Invalid => {
            let place = format!("{place}.alphaMode");
            let right = "OPAQUE, MASK or BLEND would be right";
            return Err(BakeError::at(place, "it does not exist", right));
        }
    };
    let pbr = &json.pbr_metallic_roughness;
    let extensions = json.extensions.as_ref();
    let strength = extensions.and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |strength| strength.emissive_strength.0);
    let emissive = |value: f32| limit(limit(value, 0.0, 1.0) * strength, 0.0, FACTOR_MAX);
    let unit = |value: f32| limit(value, 0.0, 1.0);
    let occlusion = json.occlusion_texture.as_ref();
    let normal = json.normal_texture.as_ref();
    Ok(Material {
        name: json.name.clone().unwrap_or_default(),
        base_color: Vec4::from(pbr.base_color_factor.0.map(unit)),
        metallic: unit(pbr.metallic_factor.0),
        roughness: unit(pbr.roughness_factor.0),
        emissive: Vec3::from(json.emissive_factor.0.map(emissive)),
        normal_scale: normal.map_or(1.0, |n| limit(n.scale, -FACTOR_MAX, FACTOR_MAX)),
        occlusion_strength: occlusion.map_or(1.0, |o| unit(o.strength.0)),
        alpha_mode,
        double_sided: json.double_sided,
        unlit: extensions.is_some_and(|e| e.unlit.is_some()),
        ..Material::default()
    })
}

pub(super) fn limit(value: f32, min: f32, max: f32) -> f32 {
    if value.is_nan() { min } else { value.clamp(min, max) }
}

/// A material while its textures are looked up.
pub(super) struct MaterialContext<'p, 'j, 'a> {
    palette: &'p mut Palette,
    pub job: &'j mut BakeJob<'a>,
    /// Its index in the file.
    pub source: u32,
    pub place: String,
    pub needs: VertexRequirements,
}

impl MaterialContext<'_, '_, '_> {
    pub(super) fn info(
        &mut self,
        info: &json::texture::Info,
        content: TextureKind,
    ) -> Result<Option<TextureRef>, BakeError> {
        let extensions = info.extensions.as_ref();
        let transform = extensions.and_then(|extensions| extensions.texture_transform.as_ref());
        self.texture(info.index.value(), info.tex_coord, transform, content)
    }

    /// Reads a normal map, and asks for its tangents unless another one has.
    pub(super) fn normals(
        &mut self,
        normal: &json::material::NormalTexture,
    ) -> Result<Option<TextureRef>, BakeError> {
        let others = normal.extensions.as_ref().map(|extensions| &extensions.others);
        let (index, set) = (normal.index.value(), normal.tex_coord);
        let transform = others.and_then(|others| others.get("KHR_texture_transform"));
        let transform = self.transform(transform)?;
        let used = self.texture(index, set, transform.as_ref(), TextureKind::Normal)?;
        if used.is_some() {
            self.tangents(used);
        }
        Ok(used)
    }

    /// Asks for tangents as a texture lies, or the first set of coordinates without one, unless
    /// others were asked for before.
    pub(super) fn tangents(&mut self, texture: Option<TextureRef>) {
        let asked = texture.map_or((0, Affine2::IDENTITY), |of| (of.uv_set, of.uv_transform));
        self.needs.tangents.get_or_insert(asked);
    }

    fn transform(
        &self,
        json: Option<&serde_json::Value>,
    ) -> Result<Option<TextureTransform>, BakeError> {
        let parsed = json.map(super::json::from_value).transpose();
        parsed.map_err(|JsonError { path, error }| {
            let what = format!("KHR_texture_transform.{path}: {error}");
            BakeError::at(&self.place, what, "offset, rotation, scale and texCoord can be given")
        })
    }

    fn texture(
        &mut self,
        index: usize,
        set: u32,
        transform: Option<&TextureTransform>,
        content: TextureKind,
    ) -> Result<Option<TextureRef>, BakeError> {
        let texture = u32::try_from(index).unwrap_or(u32::MAX);
        let document = &self.job.source.document;
        document.textures.at(texture, &self.place)?;
        let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(set);
        let Some(uv_set) = self.slot(set) else {
            let place = &self.place;
            self.job
                .warn(&format!("{place}: more than two sets of uv; TEXCOORD_{set} is left out"));
            return Ok(None);
        };
        let uv_transform = transform.map_or(Affine2::IDENTITY, affine);
        if !uv_transform.is_finite() {
            let what = "KHR_texture_transform overflows";
            return Err(BakeError::at(&self.place, what, "finite numbers would be right"));
        }
        let used = TextureUse { texture, content };
        let next = self.palette.textures.len() as u32;
        let texture = *self.palette.by_use.entry(used).or_insert(next);
        if texture == next {
            self.palette.textures.push(used);
        }
        Ok(Some(TextureRef { texture, uv_set, uv_transform }))
    }

    /// Returns the one of our two sets that stands for `TEXCOORD_set`: the set of that number if it
    /// is free, else the other one. `None` if both stand for others.
    fn slot(&mut self, set: u32) -> Option<u8> {
        let sets = &mut self.needs.uv_sets;
        if let Some(slot) = sets.iter().position(|&have| have == Some(set)) {
            return Some(slot as u8);
        }
        let wanted = if set == 1 { [1, 0] } else { [0, 1] };
        let slot = wanted.into_iter().find(|&slot| sets[slot].is_none())?;
        sets[slot] = Some(set);
        Some(slot as u8)
    }
}

/// Offset · rotation · scale; rotation is counter-clockwise as seen, with v downwards
/// (`KHR_texture_transform`).
fn affine(transform: &TextureTransform) -> Affine2 {
    let (sin, cos) = transform.rotation.0.sin_cos();
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let scale = Mat2::from_diagonal(Vec2::from(transform.scale.0));
    Affine2::from_mat2_translation(rotation * scale, Vec2::from(transform.offset.0))
}
