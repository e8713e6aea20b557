//! WGSL from its parts: joined as they stand, less the lines that an interface does not need.

use polyptych_scene::VertexLayout;

const FRAME: &str = include_str!("include/frame.wgsl");
const VERTEX: &str = include_str!("include/vertex.wgsl");
const MATERIAL: &str = include_str!("include/material.wgsl");
const EXTENSION: &str = include_str!("include/extension.wgsl");
const LAYERS: &str = include_str!("include/layers.wgsl");
const CLEARCOAT: &str = include_str!("include/clearcoat.wgsl");
const SHEEN: &str = include_str!("include/sheen.wgsl");
const ANISOTROPY: &str = include_str!("include/anisotropy.wgsl");
const IRIDESCENCE: &str = include_str!("include/iridescence.wgsl");
const DIFFUSE_TRANSMISSION: &str = include_str!("include/diffuse_transmission.wgsl");
const BAKED_LIGHT: &str = include_str!("include/baked_light.wgsl");
const TRANSMISSION: &str = include_str!("include/transmission.wgsl");
const SHADOW: &str = include_str!("include/shadow.wgsl");
const SHADOW_FILTER: &str = include_str!("include/shadow_filter.wgsl");
const PENUMBRA: &str = include_str!("include/penumbra.wgsl");
/// Stands for it where lights have no size: GLSL cannot read depths that it compares with, too.
const NO_PENUMBRA: &str = "
fn penumbra_radius(place: vec3<f32>, layer: u32, spread: f32, slant: vec2<f32>, most: f32) -> f32 {
    return 0.0;
}

fn area_visibility(place: vec3<f32>, layer: u32, spread: f32, slant: vec2<f32>, r: f32) -> f32 {
    return 1.0;
}
";
const SUN_SHADOW: &str = include_str!("include/sun_shadow.wgsl");
const LAMP_SHADOW: &str = include_str!("include/lamp_shadow.wgsl");
/// Stands for the three where no light casts shadows.
const NO_SHADOW: &str = "
fn sun_visibility(sun: u32, position: vec3<f32>, normal: vec3<f32>) -> f32 {
    return 1.0;
}
";
const AMBIENT_OCCLUSION: &str = include_str!("include/ambient_occlusion.wgsl");
const FOG: &str = include_str!("include/fog.wgsl");
const SURFACE: &str = include_str!("include/surface.wgsl");
const ENVIRONMENT: &str = include_str!("include/environment.wgsl");
const ENVIRONMENT_LIGHT: &str = include_str!("include/environment_light.wgsl");
const TONE: &str = include_str!("include/tone.wgsl");
const SCREEN: &str = include_str!("include/screen.wgsl");

/// The data that vertices pass to fragments. Override constants cannot take away an attribute, and
/// each costs time per vertex and per triangle, so these select lines of text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Interface {
    /// The attributes that are read; may be fewer than the vertices have.
    pub attributes: VertexLayout,
    /// Positions and normals are needed for light.
    pub lit: bool,
    /// Each item has a list of lamps.
    pub lamps: bool,
    /// Lights have maps of what they reach.
    pub shadows: bool,
    /// Among them are point or spot lights; only with `shadows`.
    pub lamp_shadows: bool,
    /// Lights have a size; only with `shadows`.
    pub penumbras: bool,
    /// Light comes from all around, by a map.
    pub environment: bool,
    /// Fog lies between the eye and what it sees.
    pub fog: bool,
    /// A map has the part of the light from all around that gets to a place.
    pub ambient_occlusion: bool,
    /// The extensions of the material.
    pub extensions: ExtensionSet,
}

/// The extensions of a material that change its light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct ExtensionSet {
    /// `KHR_materials_ior` or `KHR_materials_specular`; iridescence changes what these say.
    pub specular: bool,
    /// `KHR_materials_clearcoat`.
    pub clearcoat: bool,
    /// `KHR_materials_sheen`.
    pub sheen: bool,
    /// `KHR_materials_transmission`.
    pub transmission: bool,
    /// `KHR_materials_volume`, of a surface that transmits light, diffusely or not.
    pub volume: bool,
    /// `KHR_materials_dispersion`, of such a volume.
    pub dispersion: bool,
    /// `KHR_materials_anisotropy`, where vertices have tangents.
    pub anisotropy: bool,
    /// `KHR_materials_iridescence`.
    pub iridescence: bool,
    /// `KHR_materials_diffuse_transmission`.
    pub diffuse_transmission: bool,
    /// `MOZ_lightmap`.
    pub baked_light: bool,
}

impl ExtensionSet {
    /// Returns whether the material has none.
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }

    /// Returns whether shaders have the numbers of anisotropy and of what was added after it.
    fn has_further_numbers(self) -> bool {
        self.anisotropy || self.iridescence || self.diffuse_transmission
    }

    /// Returns whether layers lie above the material.
    fn has_layers(self) -> bool {
        self.clearcoat || self.sheen
    }

    /// Returns the text that draws it; none where it is empty.
    fn text(self) -> String {
        [
            (!self.is_empty(), EXTENSION),
            (self.has_layers(), LAYERS),
            (self.clearcoat, CLEARCOAT),
            (self.sheen, SHEEN),
            (self.transmission, TRANSMISSION),
            (self.anisotropy, ANISOTROPY),
            (self.iridescence, IRIDESCENCE),
            (self.diffuse_transmission, DIFFUSE_TRANSMISSION),
            (self.baked_light, BAKED_LIGHT),
        ]
        .into_iter()
        .filter_map(|(is_there, text)| is_there.then_some(text))
        .collect()
    }
}

impl Interface {
    fn has(self, name: &str) -> bool {
        match name {
            "lit" => self.lit,
            "placed" => self.lit || self.fog,
            "fog" => self.fog,
            "ambient_occlusion" => self.ambient_occlusion,
            "tangent" => self.attributes.tangent,
            "uv0" => self.attributes.uv0,
            "uv1" => self.attributes.uv1,
            "color" => self.attributes.color,
            "lamps" => self.lamps,
            "lamp_shadows" => self.has_lamp_shadows(),
            "environment" => self.environment,
            "extended" => !self.extensions.is_empty(),
            "specular" => self.extensions.specular,
            "clearcoat" => self.extensions.clearcoat,
            "sheen" => self.extensions.sheen,
            "transmission" => self.extensions.transmission,
            "volume" => self.extensions.volume,
            "dispersion" => self.extensions.dispersion,
            "anisotropy" => self.extensions.anisotropy,
            "iridescence" => self.extensions.iridescence,
            "unfilmed" => self.extensions.specular && !self.extensions.iridescence,
            "diffuse_transmission" => self.extensions.diffuse_transmission,
            "baked_light" => self.extensions.baked_light,
            "further" => self.extensions.has_further_numbers(),
            "layers" => self.extensions.has_layers(),
            _ => false,
        }
    }

    fn has_lamp_shadows(self) -> bool {
        self.shadows && self.lamp_shadows
    }

    /// Returns the text that says which part of the light of lamps arrives.
    fn shadow_text(self) -> String {
        if !self.shadows {
            return NO_SHADOW.to_owned();
        }
        let penumbra = if self.penumbras { PENUMBRA } else { NO_PENUMBRA };
        let filter = [SHADOW_FILTER, penumbra].concat();
        let suns = [SHADOW, &filter, SUN_SHADOW].concat();
        if !self.lamp_shadows {
            return suns;
        }
        let filter = filter
            .replace("shadow_maps", "lamp_maps")
            .replace("_visibility", "_lamp_visibility")
            .replace("penumbra_radius", "lamp_penumbra_radius")
            .replace("lit_part", "lit_lamp_part");
        [&suns, "\n", LAMP_SHADOW, "\n", &filter].concat()
    }

    fn select(self, text: &str) -> String {
        select(text, |name| self.has(name))
    }
}

/// Keeps the lines that have no mark `//? name`, or whose name holds; `!` negates, `&` joins.
fn select(text: &str, holds: impl Fn(&str) -> bool) -> String {
    let keep = |line: &&str| match line.split_once("//? ") {
        Some((_, mark)) => mark.split(" & ").all(|mark| match mark.strip_prefix('!') {
            Some(absent) => !holds(absent),
            None => holds(mark),
        }),
        None => true,
    };
    text.lines().filter(keep).flat_map(|line| [line, "\n"]).collect()
}

/// The tone mappers: the one in force is in the uniforms of a frame, or else a constant.
fn tone(has_frame: bool) -> String {
    select(TONE, |name| name == "frame" && has_frame)
}

/// A pass over the scene: `pass` holds its fragment stage.
pub(crate) fn surface(interface: Interface, pass: &str) -> String {
    let (vertex, surface) = (interface.select(VERTEX), interface.select(SURFACE));
    let shadow = interface.shadow_text();
    let [map, light] =
        if interface.environment { [ENVIRONMENT, ENVIRONMENT_LIGHT] } else { [""; 2] };
    let light = &interface.select(light);
    let extension = interface.select(&interface.extensions.text());
    let fog = if interface.fog { FOG } else { "" };
    let occlusion = if interface.ambient_occlusion { AMBIENT_OCCLUSION } else { "" };
    let tone = &tone(true);
    let before = [FRAME, map, &vertex, MATERIAL, &extension, &shadow, fog, occlusion];
    [&before.concat()[..], &surface, light, tone, pass].concat()
}

/// A pass over the pixels behind everything, which show an environment, or the sky behind fog.
pub(crate) fn surroundings(pass: &str, has_environment: bool, has_fog: bool) -> String {
    let map = if has_environment { ENVIRONMENT } else { "" };
    let fog = if has_fog { FOG } else { "" };
    let pass = select(pass, |name| match name {
        "environment" => has_environment,
        _ => name == "fog" && has_fog,
    });
    [FRAME, map, SCREEN, &tone(true), fog, &pass].concat()
}

/// A pass over the pixels of a picture.
pub(crate) fn screen(pass: &str) -> String {
    [SCREEN, &tone(false), pass].concat()
}

/// A pass over the depth of a picture, of one sample or of several for each pixel.
pub(crate) fn depth(pass: &str, is_multisampled: bool) -> String {
    let pass = select(pass, |name| (name == "many") == is_multisampled);
    [SCREEN, &pass].concat()
}
