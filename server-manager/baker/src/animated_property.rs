//! Properties that animations change beside the places of nodes: which things of the scene have
//! them, and what they are without any animation.

use std::collections::BTreeMap;

use gltf::json;
use gltf::json::extensions::texture::TextureTransform;
use polyptych_scene::{
    AlphaMode, AnimatedProperty, Light, LightKind, LightProperty, Material, MaterialProperty,
    PropertyKind,
};

use super::BakeJob;
use super::error::BakeError;
use super::json::from_value;

/// The things of the scene that stand for those of the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct SceneParts<'a> {
    /// The place of each node.
    pub place_of: &'a [Option<u32>],
    /// The places of what each node hides, of those that animations hide.
    pub hidden_with: &'a BTreeMap<u32, Vec<u32>>,
    /// By light of the file.
    pub light_of: &'a BTreeMap<u32, u32>,
    pub lights: &'a [Light],
    /// By material of the file.
    pub materials_of: &'a BTreeMap<u32, Vec<u32>>,
    pub materials: &'a [Material],
}

impl SceneParts<'_> {
    /// Returns a property of a thing of the file. `None` if it is not in the scene.
    ///
    /// # Errors
    /// The file has no such thing, or the thing no such property; `place` is where it was asked.
    pub(super) fn property(
        &self,
        job: &BakeJob<'_>,
        kind: PropertyKind,
        source: u32,
        place: &str,
    ) -> Result<Option<AnimatedProperty>, BakeError> {
        let document = &job.source.document;
        let (targets, rest) = match kind {
            PropertyKind::Visible => {
                let node = document.nodes.at(source, place)?;
                let targets = self.hidden_with.get(&source).cloned().unwrap_or_default();
                let is_visible = node.extensions.visibility.visible;
                (targets, Some(vec![if is_visible { 1.0 } else { 0.0 }]))
            }
            PropertyKind::Light(property) => {
                document.extensions.lights.lights.at(source, place)?;
                let light = self.light_of.get(&source).copied();
                let rest = light.and_then(|at| of_light(&self.lights[at as usize], property));
                (light.into_iter().collect(), rest)
            }
            PropertyKind::Material(property) => {
                let json = document.materials.at(source, place)?;
                let all = self.materials_of.get(&source).map_or(&[][..], Vec::as_slice);
                let (mut targets, mut rest) = (Vec::new(), None);
                // Copies may be unlit, or have no room for a texture: they stay as they are.
                for &copy in all {
                    let Some(material) = self.materials.get(copy as usize) else { continue };
                    if let Some(value) = of_material(material, json, property, place)? {
                        targets.push(copy);
                        rest.get_or_insert(value);
                    }
                }
                // That none has it is a fault, unless the material is not in the scene.
                (if rest.is_some() { targets } else { all.to_vec() }, rest)
            }
        };
        if targets.is_empty() {
            return Ok(None);
        }
        let Some(rest) = rest else {
            let what = "what it names has no such property, or none that is drawn";
            return Err(BakeError::at(place, what, "a property that is there would be right"));
        };
        Ok(Some(AnimatedProperty { kind, targets, rest }))
    }
}

/// The properties that are not used without others: a colour and its strength, and the parts of a
/// transform.
pub(super) fn together(kind: PropertyKind) -> Vec<PropertyKind> {
    use MaterialProperty as Of;
    let PropertyKind::Material(property) = kind else { return vec![kind] };
    let all = match property {
        Of::EmissiveColor | Of::EmissiveStrength => vec![Of::EmissiveColor, Of::EmissiveStrength],
        Of::UvOffset(slot) | Of::UvRotation(slot) | Of::UvScale(slot) => {
            vec![Of::UvOffset(slot), Of::UvRotation(slot), Of::UvScale(slot)]
        }
        other => vec![other],
    };
    all.into_iter().map(PropertyKind::Material).collect()
}

fn of_light(light: &Light, property: LightProperty) -> Option<Vec<f64>> {
    let one = |number: f32| Some(vec![f64::from(number)]);
    match (property, light.kind) {
        (LightProperty::Color, _) => Some(light.color.as_dvec3().to_array().to_vec()),
        (LightProperty::Intensity, _) => one(light.intensity),
        (LightProperty::Range, _) => one(light.range.unwrap_or_default()),
        (LightProperty::InnerCone, LightKind::Spot { inner_rad, .. }) => one(inner_rad),
        (LightProperty::OuterCone, LightKind::Spot { outer_rad, .. }) => one(outer_rad),
        (LightProperty::InnerCone | LightProperty::OuterCone, _) => None,
    }
}

/// The value of a property of a material; `None` if it has none, or is drawn without it.
fn of_material(
    of: &Material,
    json: &json::Material,
    property: MaterialProperty,
    place: &str,
) -> Result<Option<Vec<f64>>, BakeError> {
    use MaterialProperty as Of;
    let one = |number: f32| Some(vec![f64::from(number)]);
    let is_textured =
        |slot: u8| of.texture_slots().get(usize::from(slot)).is_some_and(Option::is_some);
    if of.unlit {
        let is_seen = matches!(property, Of::BaseColor | Of::AlphaCutoff)
            || matches!(property, Of::UvOffset(0) | Of::UvRotation(0) | Of::UvScale(0));
        if !is_seen {
            return Ok(None);
        }
    }
    let own = match property {
        Of::BaseColor => Some(of.base_color.as_dvec4().to_array().to_vec()),
        Of::Metallic => one(of.metallic),
        Of::Roughness => one(of.roughness),
        Of::EmissiveColor => Some(json.emissive_factor.0.map(f64::from).to_vec()),
        Of::EmissiveStrength => {
            let strength = json.extensions.as_ref().and_then(|of| of.emissive_strength.as_ref());
            one(strength.map_or(1.0, |strength| strength.emissive_strength.0))
        }
        Of::NormalScale if is_textured(2) => one(of.normal_scale),
        Of::OcclusionStrength if is_textured(3) => one(of.occlusion_strength),
        Of::AlphaCutoff => match of.alpha_mode {
            AlphaMode::Mask(cutoff) => one(cutoff),
            AlphaMode::Opaque | AlphaMode::Blend => None,
        },
        Of::UvOffset(slot) | Of::UvRotation(slot) | Of::UvScale(slot) if is_textured(slot) => {
            let transform = transform_of(json, slot, place)?;
            Some(match property {
                Of::UvOffset(_) => transform.offset.0.map(f64::from).to_vec(),
                Of::UvScale(_) => transform.scale.0.map(f64::from).to_vec(),
                _ => vec![f64::from(transform.rotation.0)],
            })
        }
        _ => of_extensions(of, property),
    };
    Ok(own.filter(|value| value.iter().all(|number| number.is_finite())))
}

fn of_extensions(of: &Material, property: MaterialProperty) -> Option<Vec<f64>> {
    use MaterialProperty as Of;
    let of = of.extensions.as_deref()?;
    let (specular, coat, sheen) = (of.specular.as_ref(), of.clearcoat.as_ref(), of.sheen.as_ref());
    let (volume, grain) = (of.volume.as_ref(), of.anisotropy.as_ref());
    let (film, through) = (of.iridescence.as_ref(), of.diffuse_transmission.as_ref());
    let color = |color: glam::Vec3| color.as_dvec3().to_array().to_vec();
    let number = match property {
        Of::SpecularColor => return Some(color(specular?.color)),
        Of::SheenColor => return Some(color(sheen?.color)),
        Of::AttenuationColor => return Some(color(volume?.attenuation_color)),
        Of::DiffuseTransmissionColor => return Some(color(through?.color)),
        Of::Ior => specular?.ior,
        Of::SpecularFactor => specular?.factor,
        Of::ClearcoatFactor => coat?.factor,
        Of::ClearcoatRoughness => coat?.roughness,
        Of::ClearcoatNormalScale => coat?.normal_scale,
        Of::SheenRoughness => sheen?.roughness,
        Of::TransmissionFactor => of.transmission.as_ref()?.factor,
        Of::Thickness => volume?.thickness,
        Of::Dispersion => volume?.dispersion,
        Of::AnisotropyStrength => grain?.strength,
        Of::AnisotropyRotation => grain?.rotation_rad,
        Of::IridescenceFactor => film?.factor,
        Of::IridescenceIor => film?.ior,
        Of::IridescenceThicknessMin => film?.thickness_min_nm,
        Of::IridescenceThicknessMax => film?.thickness_max_nm,
        Of::DiffuseTransmissionFactor => through?.factor,
        // 0 stands for one without end.
        Of::AttenuationDistance => {
            Some(volume?.attenuation_distance).filter(|of| of.is_finite()).unwrap_or_default()
        }
        _ => return None,
    };
    Some(vec![f64::from(number)])
}

/// The transform of a texture's coordinates as the file has it.
fn transform_of(
    json: &json::Material,
    slot: u8,
    place: &str,
) -> Result<TextureTransform, BakeError> {
    let pbr = &json.pbr_metallic_roughness;
    let of_info = |info: Option<&json::texture::Info>| {
        info.and_then(|info| info.extensions.as_ref()).and_then(|of| of.texture_transform.clone())
    };
    let name = "KHR_texture_transform";
    let others = match slot {
        2 => {
            json.normal_texture.as_ref().and_then(|of| of.extensions.as_ref()).map(|of| &of.others)
        }
        3 => json
            .occlusion_texture
            .as_ref()
            .and_then(|of| of.extensions.as_ref())
            .map(|of| &of.others),
        _ => None,
    };
    let read = match slot {
        0 => of_info(pbr.base_color_texture.as_ref()),
        1 => of_info(pbr.metallic_roughness_texture.as_ref()),
        4 => of_info(json.emissive_texture.as_ref()),
        _ => {
            let value = others.and_then(|others| others.get(name));
            value.map(from_value).transpose().map_err(|error: super::json::JsonError| {
                BakeError::at(place, error.error.to_string(), format!("{name} would be right"))
            })?
        }
    };
    Ok(read.unwrap_or_default())
}
