//! Every shader is valid, and every uniform has the layout of its Rust twin.

use std::mem::offset_of;

use polyptych_scene::VertexLayout;
use wgpu::naga;

use crate::environment::EnvironmentUniform;
use crate::guarded_region::{BehindUniform, LEVELS, RegionRecord};
use crate::lamp_map::LampShadowRecord;
use crate::pass::ambient_occlusion::{OcclusionPlace, OcclusionUniform};
use crate::pass::background::{self, BackgroundUniform};
use crate::pass::correct::{CellRecord, CorrectionUniform, EyeRecord, PlaneRecord};
use crate::pass::depth_of_field::LensUniform;
use crate::pass::glow::GlowUniform;
use crate::pass::{
    ambient_occlusion, behind, depth_of_field, glow, occluder, opaque, shadow, transparent,
};
use crate::scene::{ExtensionUniform, MaterialUniform};
use crate::shader::{ExtensionSet, Interface, depth, screen, surface, surroundings};
use crate::shadow_uniform::{CascadeRecord, ShadowUniform, SunShadowRecord};
use crate::view::{DirectionalLightRecord, FrameUniform, LocalLightRecord};

fn module(name: &str, text: &str) -> naga::Module {
    let module = naga::front::wgsl::parse_str(text)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(text)));
    let mut validator = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::default() | naga::valid::Capabilities::MULTISAMPLED_SHADING,
    );
    if let Err(error) = validator.validate(&module) {
        panic!("{name}: {}", error.emit_to_string(text));
    }
    module
}

fn interfaces() -> impl Iterator<Item = Interface> {
    // Shadows of lamps only where there are lamps, light and shadows.
    let is_there = |bits: &u32| *bits < 512 || bits >> 4 & 7 == 7;
    (0..1024u32).filter(is_there).map(|bits| {
        let bit = |at: u32| bits >> at & 1 == 1;
        let attributes = VertexLayout { tangent: bit(0), uv0: bit(1), uv1: bit(2), color: bit(3) };
        let (shadows, environment, fog) = (bit(6), bit(7), bit(8));
        let extensions = ExtensionSet::default();
        let (lit, lamps, lamp_shadows, penumbras) = (bit(4), bit(5), bit(9), shadows && bit(0));
        // With others of every kind, as their parity is theirs.
        let ambient_occlusion = lit && bits.count_ones() % 2 == 0;
        Interface {
            attributes,
            lit,
            lamps,
            shadows,
            lamp_shadows,
            penumbras,
            environment,
            fog,
            ambient_occlusion,
            extensions,
        }
    })
}

/// All sets of extensions.
fn extension_sets() -> impl Iterator<Item = ExtensionSet> {
    (0..128u32).map(|bits| {
        let bit = |at: u32| bits >> at & 1 == 1;
        // A volume is one that transmits light, and one that disperses it has a volume.
        let glass = bits >> 3 & 3;
        // With others of every kind, as its parity is theirs.
        let diffuse_transmission = bits.count_ones() % 2 == 1;
        let baked_light = (bits >> 1).count_ones() % 2 == 1;
        let (transmission, volume, dispersion) = (glass > 0, glass > 1, glass > 2);
        let (clearcoat, sheen, iridescence) = (bit(1), bit(2), bit(6));
        // Iridescence changes what index of refraction and specular say.
        let specular = bit(0) || iridescence;
        ExtensionSet {
            specular,
            clearcoat,
            sheen,
            transmission,
            volume,
            dispersion,
            anisotropy: bit(5),
            iridescence,
            diffuse_transmission,
            baked_light,
        }
    })
}

#[test]
fn every_shader_validates() {
    for interface in interfaces() {
        module("opaque", &surface(interface, opaque::SOURCE));
        module("transparent", &surface(interface, transparent::SOURCE));
        module("occluder/vertices", &surface(interface, ""));
        module("shadow", &surface(interface, shadow::SOURCE));
    }
    for extensions in extension_sets() {
        for bits in 0..4 {
            let (lamps, environment, fog) = (bits & 1 == 1, bits & 2 == 2, bits & 1 == 1);
            let attributes = VertexLayout { tangent: true, uv0: true, ..VertexLayout::default() };
            let with = Interface {
                attributes,
                lit: true,
                lamps,
                shadows: lamps,
                lamp_shadows: lamps,
                penumbras: lamps && environment,
                environment,
                fog,
                ambient_occlusion: bits < 2,
                extensions,
            };
            module("opaque", &surface(with, opaque::SOURCE));
            module("transparent", &surface(with, transparent::SOURCE));
            module("shadow", &surface(with, shadow::SOURCE));
        }
    }
    for (environment, fog) in [(true, false), (true, true), (false, true)] {
        module("background", &surroundings(background::SOURCE, environment, fog));
    }
    module("behind", &screen(behind::SOURCE));
    module("glow", &screen(glow::SOURCE));
    module("ambient_occlusion", &screen(ambient_occlusion::SOURCE));
    module("tonemap", &screen(include_str!("../pass/tonemap.wgsl")));
    module("enlarge", &screen(include_str!("../pass/enlarge.wgsl")));
    module("reduce", &screen(include_str!("../pass/reduce.wgsl")));
    module("output", &screen(include_str!("../pass/output.wgsl")));
    module("correct", include_str!("../pass/correct.wgsl"));
    for is_multisampled in [false, true] {
        let text = depth(occluder::SOURCE, is_multisampled);
        module("occluder", &text);
        assert!(text.contains(&format!("CELL_SIDE: u32 = {}u;", occluder::CELL_SIDE)));
        let text = depth(depth_of_field::SOURCE, is_multisampled);
        module("depth_of_field", &text);
        assert!(text.contains(&format!("const LEVELS: u32 = {LEVELS}u;")));
    }
}

/// The interface of a surface that uses all that a scene can ask for.
fn of_all() -> Interface {
    let extensions = extension_sets().last().unwrap_or_default();
    let attributes = VertexLayout { tangent: true, ..VertexLayout::default() };
    Interface {
        attributes,
        lit: true,
        lamps: true,
        shadows: true,
        lamp_shadows: true,
        penumbras: true,
        ambient_occlusion: true,
        extensions,
        ..Interface::default()
    }
}

#[test]
fn depths_of_shadows_are_read_for_penumbras_alone() {
    // GLSL cannot read textures that shaders compare with.
    for penumbras in [false, true] {
        let text = surface(Interface { penumbras, ..of_all() }, opaque::SOURCE);
        for maps in ["shadow_maps", "lamp_maps"] {
            assert_eq!(text.contains(&format!("textureLoad({maps}")), penumbras, "{maps}");
        }
    }
}

/// Checks the size of a type of shaders, and the places of its members.
fn check_layout(modules: &[naga::Module], name: &str, size: usize, offsets: &[(&str, usize)]) {
    let mut types = modules.iter().flat_map(|module| module.types.iter());
    let found = types.find(|(_, ty)| ty.name.as_deref() == Some(name));
    let (_, ty) = found.unwrap_or_else(|| panic!("no {name}"));
    let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("{name}") };
    assert_eq!(*span as usize, size, "size of {name}");
    let got: Vec<(&str, usize)> = members
        .iter()
        .map(|member| (member.name.as_deref().unwrap_or(""), member.offset as usize))
        .filter(|(name, _)| !name.starts_with("pad"))
        .collect();
    assert_eq!(got, offsets, "offsets in {name}");
}

#[test]
fn uniforms_match_their_twins() {
    let opaque = module("opaque", &surface(of_all(), opaque::SOURCE));
    let behind = module("background", &surroundings(background::SOURCE, true, true));
    let glow = module("glow", &screen(glow::SOURCE));
    let occlusion = module("ambient_occlusion", &screen(ambient_occlusion::SOURCE));
    let correct = module("correct", include_str!("../pass/correct.wgsl"));
    let lens = module("depth_of_field", &depth(depth_of_field::SOURCE, true));
    let modules = [opaque, glow, correct, behind, occlusion, lens];
    macro_rules! twin {
        ($wgsl:literal, $rust:ty, $($field:ident),+) => {{
            let offsets = [$((stringify!($field), offset_of!($rust, $field))),+];
            check_layout(&modules, $wgsl, size_of::<$rust>(), &offsets);
        }};
    }
    twin!("Environment", EnvironmentUniform, diffuse);
    twin!("Background", BackgroundUniform, first, right, down, corner);
    twin!("SourcePlane", PlaneRecord, across, down, depth, inner);
    twin!("Cell", CellRecord, position, across, down, depth);
    twin!("Eye", EyeRecord, position, clip_x, clip_y, upright_x, upright_y);
    twin! { "Correction", CorrectionUniform, eyes, planes, red, green, blue, light_scale,
    inverse_gamma, even_weights, texel }
    twin! { "Frame", FrameUniform, clip_from_eye, sky, exposure, ground, fog_fall, eye, fog,
    lamp_origin, cells_per_unit, lamp_cells, surroundings, occlusion,
    tone_mapper, suns }
    twin!("OcclusionPlace", OcclusionPlace, offset, texels_per_pixel, relative, absolute);
    twin! { "Occlusion", OcclusionUniform, eye_from_texel, eye, depths, to_depth, radius, share,
    texels, relative, absolute }
    twin!("Glow", GlowUniform, corner, place, size, texels_per_pixel, strength);
    twin! { "Lens", LensUniform, eye_from_texel, eye_from_pixel, texel_from_eye, part,
    to_picture, offset, texels_per_pixel, focus_inverse, aperture_half, texels_per_radian,
    radius_max, texels_max }
    twin!("Sun", DirectionalLightRecord, toward, irradiance);
    twin! { "Lamp", LocalLightRecord, position, inverse_range, intensity, directional, direction,
    cone }
    twin!("Shadows", ShadowUniform, middle, error, suns);
    twin!("SunShadow", SunShadowRecord, right, count, up, toward, radius4, radii, cascades);
    twin! { "LampShadow", LampShadowRecord, right, count, up, layer, near, scale, texel,
    spread };
    twin!("Cascade", CascadeRecord, offset, scale, radius, texel, layer, spread);
    twin!(
        "Material",
        MaterialUniform,
        base_color,
        emissive,
        roughness,
        metallic,
        normal_scale,
        occlusion_strength,
        alpha_cutoff,
        highlight,
        uv_transforms
    );
    twin!(
        "Extension",
        ExtensionUniform,
        uv_transforms,
        specular,
        clearcoat,
        sheen,
        transmission,
        absorption,
        anisotropy,
        film,
        through
    );
    twin!("Region", RegionRecord, corner, place, size, scale, reach);
    twin!("Behind", BehindUniform, sharp, wide, pixels, pixels_per_radian, detail_max, bounds);
}
