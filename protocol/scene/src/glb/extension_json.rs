//! Extensions of materials in glTF's terms.

use std::io::Write;

use super::GlbWriter;
use super::material_json::texture_json;
use crate::{
    Anisotropy, BakedLight, Clearcoat, DiffuseTransmission, Iridescence, MaterialExtensions, Sheen,
    Specular, Transmission, Volume,
};

/// Returns the extensions as members of a material's `extensions`.
pub(super) fn members<W: Write>(of: &MaterialExtensions, file: &mut GlbWriter<W>) -> Vec<String> {
    let mut members = Vec::new();
    if let Some(specular) = &of.specular {
        members.extend(specular_members(specular, file));
    }
    members.extend(of.clearcoat.iter().map(|coat| clearcoat_member(coat, file)));
    members.extend(of.sheen.iter().map(|sheen| sheen_member(sheen, file)));
    members.extend(of.transmission.iter().map(|of| transmission_member(of, file)));
    members.extend(of.volume.iter().map(|of| volume_members(of, file)));
    members.extend(of.anisotropy.iter().map(|of| anisotropy_member(of, file)));
    members.extend(of.iridescence.iter().map(|of| iridescence_member(of, file)));
    members.extend(of.diffuse_transmission.iter().map(|of| diffuse_transmission_member(of, file)));
    members.extend(of.baked_light.iter().filter_map(|of| baked_light_member(of, file)));
    members
}

fn specular_members<W: Write>(of: &Specular, file: &mut GlbWriter<W>) -> Vec<String> {
    let mut members = Vec::new();
    let plain = Specular { ior: of.ior, ..Specular::default() };
    if of.ior != Specular::IOR_DEFAULT || *of == plain {
        let name = file.use_extension("KHR_materials_ior");
        members.push(format!(r#""{name}":{{"ior":{:?}}}"#, of.ior));
    }
    if *of != plain {
        let part = texture_json("specularTexture", of.texture, "", file);
        let color = texture_json("specularColorTexture", of.color_texture, "", file);
        let name = file.use_extension("KHR_materials_specular");
        let factors = format!(
            r#""specularFactor":{:?},"specularColorFactor":{:?}"#,
            of.factor,
            of.color.to_array()
        );
        members.push(format!(r#""{name}":{{{factors}{part}{color}}}"#));
    }
    members
}

fn clearcoat_member<W: Write>(of: &Clearcoat, file: &mut GlbWriter<W>) -> String {
    let part = texture_json("clearcoatTexture", of.texture, "", file);
    let roughness = texture_json("clearcoatRoughnessTexture", of.roughness_texture, "", file);
    let scale = format!(r#","scale":{:?}"#, of.normal_scale);
    let normal = texture_json("clearcoatNormalTexture", of.normal_texture, &scale, file);
    let name = file.use_extension("KHR_materials_clearcoat");
    let factors = format!(
        r#""clearcoatFactor":{:?},"clearcoatRoughnessFactor":{:?}"#,
        of.factor, of.roughness
    );
    format!(r#""{name}":{{{factors}{part}{roughness}{normal}}}"#)
}

fn sheen_member<W: Write>(of: &Sheen, file: &mut GlbWriter<W>) -> String {
    let color = texture_json("sheenColorTexture", of.color_texture, "", file);
    let roughness = texture_json("sheenRoughnessTexture", of.roughness_texture, "", file);
    let name = file.use_extension("KHR_materials_sheen");
    let factors = format!(
        r#""sheenColorFactor":{:?},"sheenRoughnessFactor":{:?}"#,
        of.color.to_array(),
        of.roughness
    );
    format!(r#""{name}":{{{factors}{color}{roughness}}}"#)
}

fn transmission_member<W: Write>(of: &Transmission, file: &mut GlbWriter<W>) -> String {
    let part = texture_json("transmissionTexture", of.texture, "", file);
    let name = file.use_extension("KHR_materials_transmission");
    format!(r#""{name}":{{"transmissionFactor":{:?}{part}}}"#, of.factor)
}

/// Returns `KHR_materials_volume`, and `KHR_materials_dispersion` if there is any.
fn volume_members<W: Write>(of: &Volume, file: &mut GlbWriter<W>) -> String {
    let texture = texture_json("thicknessTexture", of.thickness_texture, "", file);
    let name = file.use_extension("KHR_materials_volume");
    // JSON has no infinity, which is what is meant where the key is missing.
    let distance = if of.attenuation_distance.is_finite() {
        format!(r#","attenuationDistance":{:?}"#, of.attenuation_distance)
    } else {
        String::new()
    };
    let factors = format!(
        r#""thicknessFactor":{:?},"attenuationColor":{:?}{distance}"#,
        of.thickness,
        of.attenuation_color.to_array()
    );
    let volume = format!(r#""{name}":{{{factors}{texture}}}"#);
    if of.dispersion == 0.0 {
        return volume;
    }
    let name = file.use_extension("KHR_materials_dispersion");
    format!(r#"{volume},"{name}":{{"dispersion":{:?}}}"#, of.dispersion)
}

fn anisotropy_member<W: Write>(of: &Anisotropy, file: &mut GlbWriter<W>) -> String {
    let texture = texture_json("anisotropyTexture", of.texture, "", file);
    let name = file.use_extension("KHR_materials_anisotropy");
    let factors = format!(
        r#""anisotropyStrength":{:?},"anisotropyRotation":{:?}"#,
        of.strength, of.rotation_rad
    );
    format!(r#""{name}":{{{factors}{texture}}}"#)
}

fn iridescence_member<W: Write>(of: &Iridescence, file: &mut GlbWriter<W>) -> String {
    let part = texture_json("iridescenceTexture", of.texture, "", file);
    let thickness = texture_json("iridescenceThicknessTexture", of.thickness_texture, "", file);
    let name = file.use_extension("KHR_materials_iridescence");
    let film = format!(r#""iridescenceFactor":{:?},"iridescenceIor":{:?}"#, of.factor, of.ior);
    let range = format!(
        r#""iridescenceThicknessMinimum":{:?},"iridescenceThicknessMaximum":{:?}"#,
        of.thickness_min_nm, of.thickness_max_nm
    );
    format!(r#""{name}":{{{film},{range}{part}{thickness}}}"#)
}

fn diffuse_transmission_member<W: Write>(
    of: &DiffuseTransmission,
    file: &mut GlbWriter<W>,
) -> String {
    let part = texture_json("diffuseTransmissionTexture", of.texture, "", file);
    let color = texture_json("diffuseTransmissionColorTexture", of.color_texture, "", file);
    let name = file.use_extension("KHR_materials_diffuse_transmission");
    let factors = format!(
        r#""diffuseTransmissionFactor":{:?},"diffuseTransmissionColorFactor":{:?}"#,
        of.factor,
        of.color.to_array()
    );
    format!(r#""{name}":{{{factors}{part}{color}}}"#)
}

/// Returns the extension, which is a texture by itself.
fn baked_light_member<W: Write>(of: &BakedLight, file: &mut GlbWriter<W>) -> Option<String> {
    let name = "MOZ_lightmap";
    let intensity = format!(r#","intensity":{:?}"#, of.intensity);
    let texture = of.texture.map(|texture| texture_json(name, Some(texture), &intensity, file))?;
    file.use_extension(name);
    texture.strip_prefix(',').map(str::to_owned)
}
