//! Materials in glTF's terms.

use std::fmt::Write as _;
use std::io::Write;

use glam::{Affine2, Mat2, Vec2, Vec3};

use super::{GlbWriter, quoted};
use crate::{AlphaMode, Material, TextureRef};

/// Largest difference of a texture transform from its parts, relative to its largest number.
const DECOMPOSED_TOLERANCE: f32 = 1e-5;

/// Returns a material as glTF has it; its textures are indices into the file's own.
pub fn material_json<W: Write>(of: &Material, file: &mut GlbWriter<W>) -> String {
    let mut slot =
        |key: &str, of: Option<TextureRef>, more: &str| texture_json(key, of, more, file);
    let base_color = slot("baseColorTexture", of.base_color_texture, "");
    let metallic_roughness = slot("metallicRoughnessTexture", of.metallic_roughness_texture, "");
    let scale = format!(r#","scale":{:?}"#, of.normal_scale);
    let normal = slot("normalTexture", of.normal_texture, &scale);
    let strength = format!(r#","strength":{:?}"#, of.occlusion_strength);
    let occlusion = slot("occlusionTexture", of.occlusion_texture, &strength);
    let emissive = slot("emissiveTexture", of.emissive_texture, "");

    let mut json = String::from("{");
    if !of.name.is_empty() {
        let _ = write!(json, r#""name":{},"#, quoted(&of.name));
    }
    let factors = format!(
        r#""baseColorFactor":{:?},"metallicFactor":{:?},"roughnessFactor":{:?}"#,
        of.base_color.to_array(),
        of.metallic,
        of.roughness,
    );
    let _ = write!(
        json,
        r#""pbrMetallicRoughness":{{{factors}{base_color}{metallic_roughness}}}{normal}{occlusion}"#
    );
    // A power of two, so that factor times strength is what it was, to the last bit; but for the
    // largest, whose power of two would be infinite.
    let strength = of.emissive.max_element().max(1.0).log2().ceil().exp2().min(f32::MAX);
    let Vec3 { x, y, z } = of.emissive / strength;
    let _ = write!(
        json,
        r#"{emissive},"emissiveFactor":[{x:?},{y:?},{z:?}],"doubleSided":{}"#,
        of.double_sided
    );
    match of.alpha_mode {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            let _ = write!(json, r#","alphaMode":"MASK","alphaCutoff":{cutoff:?}"#);
        }
        AlphaMode::Blend => json.push_str(r#","alphaMode":"BLEND""#),
    }
    let mut extensions = Vec::new();
    if of.unlit {
        extensions.push(format!(r#""{}":{{}}"#, file.use_extension("KHR_materials_unlit")));
    }
    if strength > 1.0 {
        let name = file.use_extension("KHR_materials_emissive_strength");
        extensions.push(format!(r#""{name}":{{"emissiveStrength":{strength:?}}}"#));
    }
    if let Some(further) = &of.extensions {
        extensions.extend(super::extension_json::members(further, file));
    }
    if !extensions.is_empty() {
        let _ = write!(json, r#","extensions":{{{}}}"#, extensions.join(","));
    }
    json + "}"
}

/// Returns a texture as a member `key`, after a comma, with what `more` says of it; nothing for
/// none.
pub(super) fn texture_json<W: Write>(
    key: &str,
    of: Option<TextureRef>,
    more: &str,
    file: &mut GlbWriter<W>,
) -> String {
    let Some(TextureRef { texture, uv_set, uv_transform }) = of else { return String::new() };
    let mut moved = String::new();
    if uv_transform != Affine2::IDENTITY {
        let (scale, rotation, offset) = parts(&uv_transform);
        let name = file.use_extension("KHR_texture_transform");
        let (offset, scale) = (offset.to_array(), scale.to_array());
        let transform =
            format!(r#"{{"offset":{offset:?},"rotation":{rotation:?},"scale":{scale:?}}}"#);
        moved = format!(r#","extensions":{{"{name}":{transform}}}"#);
    }
    format!(r#","{key}":{{"index":{texture},"texCoord":{uv_set}{more}{moved}}}"#)
}

/// Scale, rotation in radians and offset of a texture transform (`KHR_texture_transform`: the
/// offset times the rotation times the scale, and v points downwards).
fn parts(of: &Affine2) -> (Vec2, f32, Vec2) {
    let (x, y) = (of.matrix2.x_axis, of.matrix2.y_axis);
    if x.y == 0.0 && y.x == 0.0 {
        return (Vec2::new(x.x, y.y), 0.0, of.translation);
    }
    // In f64, where no product overflows.
    let (x, y) = (x.as_dvec2(), y.as_dvec2());
    let length = x.length();
    let height = if length > 0.0 { x.perp_dot(y) / length } else { y.length() };
    let rotation = if length > 0.0 { (-x.y).atan2(x.x) } else { y.x.atan2(y.y) };
    let [length, height] =
        [length, height].map(|of| of.clamp(f32::MIN.into(), f32::MAX.into()) as f32);
    (Vec2::new(length, height), rotation as f32, of.translation)
}

/// Returns whether glTF has a texture transform such as this one, which does not shear.
pub fn is_decomposable(of: &Affine2) -> bool {
    let (scale, rotation, _) = parts(of);
    let (sin, cos) = rotation.sin_cos();
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let difference = of.matrix2 - rotation * Mat2::from_diagonal(scale);
    let largest = |of: Mat2| of.to_cols_array().into_iter().fold(0.0f32, |a, b| a.max(b.abs()));
    largest(difference) <= largest(of.matrix2) * DECOMPOSED_TOLERANCE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_transforms_come_in_parts() {
        for (scale, angle) in [((2.0, 3.0), 0.0), ((-1.0, 1.0), 0.0), ((1.5, -0.25), 0.7)] {
            let scale = Vec2::from(scale);
            let (sin, cos) = f32::sin_cos(angle);
            let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
            let matrix = rotation * Mat2::from_diagonal(scale);
            let of = Affine2::from_mat2_translation(matrix, Vec2::new(0.5, -4.0));
            let (found, rotation, offset) = parts(&of);
            assert!(is_decomposable(&of) && offset == of.translation);
            assert!((found - scale).length() < 1e-6 && (rotation - angle).abs() < 1e-6, "{found}");
        }
        let sheared = Mat2::from_cols(Vec2::new(1.0, 0.0), Vec2::new(0.5, 1.0));
        assert!(!is_decomposable(&Affine2::from_mat2(sheared)));
    }

    #[test]
    fn a_default_material_is_short_and_emission_stays_exact() {
        let mut file = GlbWriter::new(Vec::new());
        let json = material_json(&Material::default(), &mut file);
        assert_eq!(
            json,
            "{\"pbrMetallicRoughness\":{\"baseColorFactor\":[1.0, 1.0, 1.0, 1.0],\
             \"metallicFactor\":1.0,\"roughnessFactor\":1.0},\
             \"emissiveFactor\":[0.0,0.0,0.0],\"doubleSided\":false}"
        );
        let emissive = Vec3::new(5.3, 0.1, 1000.7);
        let json = material_json(&Material { emissive, ..Material::default() }, &mut file);
        assert!(json.contains("\"emissiveStrength\":1024.0"), "{json}");
        assert!((emissive / 1024.0) * 1024.0 == emissive);
    }

    #[test]
    fn the_largest_numbers_stay_finite() {
        let mut file = GlbWriter::new(Vec::new());
        let matrix = Mat2::from_cols(Vec2::new(3e38, 3e38), Vec2::new(-3e38, 3e38));
        let uv_transform = Affine2::from_mat2(matrix);
        let used = TextureRef { texture: 0, uv_set: 0, uv_transform };
        let emissive = Vec3::new(3e38, 0.0, 0.0);
        let of = Material { base_color_texture: Some(used), emissive, ..Material::default() };
        let json = material_json(&of, &mut file);
        assert!(json.contains("\"emissiveStrength\":3.4028235e38"), "{json}");
        assert!(json.contains("\"scale\":[3.4028235e38, 3.4028235e38]"), "{json}");
        assert!(!json.contains("inf") && !json.contains("NaN"), "{json}");
    }
}
