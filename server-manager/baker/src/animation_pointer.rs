//! `KHR_animation_pointer`: what of a file an animation changes, as a JSON pointer names it
//! (RFC 6901; the paths are those of glTF's object model).

use polyptych_scene::{AnimatedPath, LightProperty, MaterialProperty, PropertyKind};

use super::error::BakeError;
use super::uri;

/// The target of a channel of an animation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ChannelTarget {
    /// The place or the weights of a node of the file.
    Node(u32, AnimatedPath),
    /// A property of a node, a light or a material of the file.
    Property(PropertyKind, u32),
}

/// The texture slots of a material by their keys, in the order of the renderer's.
const SLOTS: [&str; 5] = [
    "pbrMetallicRoughness/baseColorTexture",
    "pbrMetallicRoughness/metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
    "emissiveTexture",
];

/// Factors of materials by their paths.
const FACTORS: [(&str, MaterialProperty); 29] = [
    ("pbrMetallicRoughness/baseColorFactor", MaterialProperty::BaseColor),
    ("pbrMetallicRoughness/metallicFactor", MaterialProperty::Metallic),
    ("pbrMetallicRoughness/roughnessFactor", MaterialProperty::Roughness),
    ("emissiveFactor", MaterialProperty::EmissiveColor),
    ("normalTexture/scale", MaterialProperty::NormalScale),
    ("occlusionTexture/strength", MaterialProperty::OcclusionStrength),
    ("alphaCutoff", MaterialProperty::AlphaCutoff),
    (
        "extensions/KHR_materials_emissive_strength/emissiveStrength",
        MaterialProperty::EmissiveStrength,
    ),
    ("extensions/KHR_materials_ior/ior", MaterialProperty::Ior),
    ("extensions/KHR_materials_specular/specularFactor", MaterialProperty::SpecularFactor),
    ("extensions/KHR_materials_specular/specularColorFactor", MaterialProperty::SpecularColor),
    ("extensions/KHR_materials_clearcoat/clearcoatFactor", MaterialProperty::ClearcoatFactor),
    (
        "extensions/KHR_materials_clearcoat/clearcoatRoughnessFactor",
        MaterialProperty::ClearcoatRoughness,
    ),
    (
        "extensions/KHR_materials_clearcoat/clearcoatNormalTexture/scale",
        MaterialProperty::ClearcoatNormalScale,
    ),
    ("extensions/KHR_materials_sheen/sheenColorFactor", MaterialProperty::SheenColor),
    ("extensions/KHR_materials_sheen/sheenRoughnessFactor", MaterialProperty::SheenRoughness),
    (
        "extensions/KHR_materials_transmission/transmissionFactor",
        MaterialProperty::TransmissionFactor,
    ),
    ("extensions/KHR_materials_volume/thicknessFactor", MaterialProperty::Thickness),
    ("extensions/KHR_materials_volume/attenuationDistance", MaterialProperty::AttenuationDistance),
    ("extensions/KHR_materials_volume/attenuationColor", MaterialProperty::AttenuationColor),
    ("extensions/KHR_materials_dispersion/dispersion", MaterialProperty::Dispersion),
    (
        "extensions/KHR_materials_anisotropy/anisotropyStrength",
        MaterialProperty::AnisotropyStrength,
    ),
    (
        "extensions/KHR_materials_anisotropy/anisotropyRotation",
        MaterialProperty::AnisotropyRotation,
    ),
    ("extensions/KHR_materials_iridescence/iridescenceFactor", MaterialProperty::IridescenceFactor),
    ("extensions/KHR_materials_iridescence/iridescenceIor", MaterialProperty::IridescenceIor),
    (
        "extensions/KHR_materials_iridescence/iridescenceThicknessMinimum",
        MaterialProperty::IridescenceThicknessMin,
    ),
    (
        "extensions/KHR_materials_iridescence/iridescenceThicknessMaximum",
        MaterialProperty::IridescenceThicknessMax,
    ),
    (
        "extensions/KHR_materials_diffuse_transmission/diffuseTransmissionFactor",
        MaterialProperty::DiffuseTransmissionFactor,
    ),
    (
        "extensions/KHR_materials_diffuse_transmission/diffuseTransmissionColorFactor",
        MaterialProperty::DiffuseTransmissionColor,
    ),
];

/// Reads a pointer.
///
/// # Errors
/// It is none, or names what is not changed here; `place` is where it stands.
pub(super) fn parse(pointer: &str, place: &str) -> Result<ChannelTarget, BakeError> {
    let fault = |what: &str, right: &str| {
        let what = format!("pointer '{}' {what}", uri::shorten(pointer));
        BakeError::at(place, what, right)
    };
    let Some(path) = pointer.strip_prefix('/') else {
        return Err(fault("begins without a slash", "/nodes/0/translation would be right"));
    };
    let tokens: Option<Vec<String>> = path.split('/').map(unescape).collect();
    let Some(tokens) = tokens else {
        return Err(fault("has a ~ that is neither ~0 nor ~1", "~0 for ~ and ~1 for / are right"));
    };
    let names: Vec<&str> = tokens.iter().map(String::as_str).collect();
    let unknown = || {
        let right = "places, weights and visibility of nodes, lights, and factors and transforms \
                     of materials can be";
        fault("names what no animation changes here", right)
    };
    let (list, index, rest) = match names[..] {
        ["extensions", "KHR_lights_punctual", "lights", index, ref rest @ ..] => {
            ("lights", index, rest)
        }
        [list, index, ref rest @ ..] => (list, index, rest),
        _ => return Err(unknown()),
    };
    let is_number = index.bytes().all(|byte| byte.is_ascii_digit());
    let is_plain = is_number && (index == "0" || !index.starts_with('0'));
    let Some(index) = index.parse().ok().filter(|_| is_plain) else {
        return Err(fault("has no index behind the list", "/nodes/0/translation would be right"));
    };
    let path = rest.join("/");
    let target = match list {
        "nodes" => of_node(&path, index),
        "lights" => of_light(&path).map(|of| (PropertyKind::Light(of), index)).map(property),
        "materials" => {
            of_material(&path).map(|of| (PropertyKind::Material(of), index)).map(property)
        }
        _ => None,
    };
    target.ok_or_else(unknown)
}

fn property((kind, index): (PropertyKind, u32)) -> ChannelTarget {
    ChannelTarget::Property(kind, index)
}

/// A token as it was before it stood in a pointer; `None` if it cannot be.
fn unescape(token: &str) -> Option<String> {
    let mut parts = token.split('~');
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (escaped, rest) = part.split_at_checked(1)?;
        text.push(match escaped {
            "0" => '~',
            "1" => '/',
            _ => return None,
        });
        text.push_str(rest);
    }
    Some(text)
}

fn of_node(path: &str, index: u32) -> Option<ChannelTarget> {
    Some(match path {
        "translation" => ChannelTarget::Node(index, AnimatedPath::Translation),
        "rotation" => ChannelTarget::Node(index, AnimatedPath::Rotation),
        "scale" => ChannelTarget::Node(index, AnimatedPath::Scale),
        "weights" => ChannelTarget::Node(index, AnimatedPath::Weights),
        "extensions/KHR_node_visibility/visible" => {
            ChannelTarget::Property(PropertyKind::Visible, index)
        }
        _ => return None,
    })
}

fn of_light(path: &str) -> Option<LightProperty> {
    Some(match path {
        "color" => LightProperty::Color,
        "intensity" => LightProperty::Intensity,
        "range" => LightProperty::Range,
        "spot/innerConeAngle" => LightProperty::InnerCone,
        "spot/outerConeAngle" => LightProperty::OuterCone,
        _ => return None,
    })
}

fn of_material(path: &str) -> Option<MaterialProperty> {
    if let Some((_, factor)) = FACTORS.iter().find(|(known, _)| *known == path) {
        return Some(*factor);
    }
    let (texture, of) = path.split_once("/extensions/KHR_texture_transform/")?;
    let slot = SLOTS.iter().position(|known| *known == texture)? as u8;
    Some(match of {
        "offset" => MaterialProperty::UvOffset(slot),
        "rotation" => MaterialProperty::UvRotation(slot),
        "scale" => MaterialProperty::UvScale(slot),
        _ => return None,
    })
}

/// The extension of a material without which a property changes nothing.
pub(super) fn extension_of(property: MaterialProperty) -> Option<&'static str> {
    let path = FACTORS.iter().find(|(_, known)| *known == property)?.0;
    let name = path.strip_prefix("extensions/")?.split('/').next()?;
    // The strength of emission is a part of the colour here.
    (name != "KHR_materials_emissive_strength").then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(pointer: &str) -> ChannelTarget {
        parse(pointer, "animations[0]").unwrap_or_else(|error| panic!("{pointer}: {error}"))
    }

    #[test]
    fn pointers_name_properties_of_nodes_lights_and_materials() {
        use MaterialProperty as Of;
        let material = |of, index| ChannelTarget::Property(PropertyKind::Material(of), index);
        let light = |of, index| ChannelTarget::Property(PropertyKind::Light(of), index);
        let transform = "extensions/KHR_texture_transform";
        for (pointer, wanted) in [
            ("/nodes/0/translation", ChannelTarget::Node(0, AnimatedPath::Translation)),
            ("/nodes/12/weights", ChannelTarget::Node(12, AnimatedPath::Weights)),
            (
                "/nodes/3/extensions/KHR_node_visibility/visible",
                ChannelTarget::Property(PropertyKind::Visible, 3),
            ),
            (
                "/extensions/KHR_lights_punctual/lights/1/spot/outerConeAngle",
                light(LightProperty::OuterCone, 1),
            ),
            ("/materials/2/emissiveFactor", material(Of::EmissiveColor, 2)),
            ("/materials/2/pbrMetallicRoughness/baseColorFactor", material(Of::BaseColor, 2)),
            ("/materials/0/alphaCutoff", material(Of::AlphaCutoff, 0)),
        ] {
            assert_eq!(parsed(pointer), wanted, "{pointer}");
        }
        let pointer = format!("/materials/7/normalTexture/{transform}/rotation");
        assert_eq!(parsed(&pointer), material(Of::UvRotation(2), 7));
        assert_eq!(extension_of(Of::Thickness), Some("KHR_materials_volume"));
        assert_eq!(extension_of(Of::EmissiveStrength), None);
        let film = "extensions/KHR_materials_iridescence";
        let pointer = format!("/materials/1/{film}/iridescenceThicknessMaximum");
        assert_eq!(parsed(&pointer), material(Of::IridescenceThicknessMax, 1));
        assert_eq!(extension_of(Of::AnisotropyRotation), Some("KHR_materials_anisotropy"));
    }

    #[test]
    fn pointers_that_are_none_or_name_something_else_are_refused() {
        for (pointer, part) in [
            ("", "begins without a slash"),
            ("nodes/0/translation", "begins without a slash"),
            ("/nodes/0/trans~2lation", "neither ~0 nor ~1"),
            ("/nodes/0/translation~", "neither ~0 nor ~1"),
            ("/nodes/0/~é", "neither ~0 nor ~1"),
            ("/nodes/-1/translation", "no index"),
            ("/nodes/00/translation", "no index"),
            ("/nodes/99999999999/translation", "no index"),
            ("/nodes//translation", "no index"),
            ("/nodes", "no animation changes"),
            ("/nodes/0", "no animation changes"),
            ("/nodes/0/matrix", "no animation changes"),
            ("/cameras/0/perspective/yfov", "no animation changes"),
            ("/materials/0/a~1b", "no animation changes"),
            ("/extensions/KHR_lights_punctual/lights", "no index"),
        ] {
            let error = parse(pointer, "animations[0]").expect_err(pointer).to_string();
            assert!(error.contains(part) && error.contains("animations[0]"), "{pointer}: {error}");
            assert!(error.contains(pointer), "{pointer}: {error}");
        }
    }
}
