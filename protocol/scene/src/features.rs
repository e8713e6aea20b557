//! The renderer features that a scene needs: passes and pipelines exist only for these.

use serde::{Deserialize, Serialize};

use super::{AlphaMode, Scene, Topology};

/// Derived from the manifest when a scene is opened, logged, and reported.
///
/// It is a pure function of the scene, so every channel of a wall derives the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneFeatures {
    /// Materials of mode blend: a float target and a tone-mapping pass of its own.
    pub blend: bool,
    /// Materials of mode mask.
    pub mask: bool,
    /// Normal maps.
    pub normal_maps: bool,
    /// Any texture.
    pub textures: bool,
    /// Colours at vertices.
    pub vertex_colors: bool,
    /// Unlit materials.
    pub unlit: bool,
    /// Lights of its own; without any, baked light and surroundings, the default sun shines.
    pub lights: bool,
    /// A mesh that stands in more than one place.
    pub instances: bool,
    /// Points or lines.
    pub points_or_lines: bool,
    /// Directional lights of its own: maps of what they reach.
    #[serde(default)]
    pub sun_shadows: bool,
    /// Point or spot lights of its own: maps of what they reach.
    #[serde(default)]
    pub lamp_shadows: bool,
    /// Materials with `KHR_materials_ior` or `KHR_materials_specular`.
    #[serde(default)]
    pub specular: bool,
    /// Materials with `KHR_materials_clearcoat`.
    #[serde(default)]
    pub clearcoat: bool,
    /// Materials with `KHR_materials_sheen`.
    #[serde(default)]
    pub sheen: bool,
    /// Materials with `KHR_materials_transmission`: a picture of what is behind them.
    #[serde(default)]
    pub transmission: bool,
    /// Materials that refract and absorb, with `KHR_materials_volume`.
    #[serde(default)]
    pub volume: bool,
    /// Materials with `KHR_materials_dispersion`.
    #[serde(default)]
    pub dispersion: bool,
    /// Materials with `KHR_materials_anisotropy`.
    #[serde(default)]
    pub anisotropy: bool,
    /// Materials with `KHR_materials_iridescence`.
    #[serde(default)]
    pub iridescence: bool,
    /// Materials with `KHR_materials_diffuse_transmission`.
    #[serde(default)]
    pub diffuse_transmission: bool,
    /// Materials with `MOZ_lightmap`.
    #[serde(default)]
    pub baked_light: bool,
    /// Surroundings: those of the scene's own, or on a server those that are shown.
    #[serde(default)]
    pub environment: bool,
}

impl SceneFeatures {
    /// Returns the features that this scene needs.
    pub fn from_scene(scene: &Scene) -> Self {
        let any = |test: fn(&super::Material) -> bool| scene.materials.iter().any(test);
        let extends = |test: fn(&super::MaterialExtensions) -> bool| {
            scene.materials.iter().flat_map(|of| &of.extensions).any(|of| test(of))
        };
        let primitives = || scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let placed = || scene.nodes.iter().filter_map(|node| node.light);
        let lights = || placed().filter_map(|light| scene.lights.get(light as usize));
        let mut uses = vec![0usize; scene.meshes.len()];
        for node in &scene.nodes {
            if let Some(count) = node.mesh.and_then(|mesh| uses.get_mut(mesh as usize)) {
                *count += node.instances.len().max(1);
            }
        }
        Self {
            blend: any(|m| m.alpha_mode == AlphaMode::Blend),
            mask: any(|m| matches!(m.alpha_mode, AlphaMode::Mask(_))),
            normal_maps: any(super::Material::has_normal_map),
            textures: any(|m| m.textures().next().is_some()),
            vertex_colors: primitives().any(|p| p.layout.color),
            unlit: any(|m| m.unlit),
            lights: scene.nodes.iter().any(|node| node.light.is_some()),
            instances: uses.iter().any(|&count| count > 1),
            points_or_lines: primitives().any(|p| p.topology != Topology::Triangles),
            specular: extends(|of| of.specular.is_some()),
            clearcoat: extends(|of| of.clearcoat.is_some()),
            sheen: extends(|of| of.sheen.is_some()),
            transmission: extends(|of| of.transmission.is_some()),
            volume: extends(super::MaterialExtensions::has_volume),
            dispersion: extends(|of| {
                of.transmission.is_some()
                    && of.volume.as_ref().is_some_and(|of| of.dispersion > 0.0)
            }),
            anisotropy: extends(|of| of.anisotropy.is_some()),
            iridescence: extends(|of| of.iridescence.is_some()),
            diffuse_transmission: extends(|of| of.diffuse_transmission.is_some()),
            baked_light: any(super::Material::has_baked_light),
            environment: scene.surroundings.is_some(),
            sun_shadows: lights().any(|of| of.casts_shadows() && of.lamp_map_count() == 0),
            lamp_shadows: lights().any(|of| of.lamp_map_count() > 0),
        }
    }

    /// The names of what is needed, as reports give them.
    pub fn names(&self) -> Vec<&'static str> {
        [
            (self.blend, "blend"),
            (self.mask, "mask"),
            (self.normal_maps, "normal_maps"),
            (self.textures, "textures"),
            (self.vertex_colors, "vertex_colors"),
            (self.unlit, "unlit"),
            (self.lights, "lights"),
            (self.instances, "instances"),
            (self.points_or_lines, "points_or_lines"),
            (self.sun_shadows, "sun_shadows"),
            (self.lamp_shadows, "lamp_shadows"),
            (self.specular, "specular"),
            (self.clearcoat, "clearcoat"),
            (self.sheen, "sheen"),
            (self.transmission, "transmission"),
            (self.volume, "volume"),
            (self.dispersion, "dispersion"),
            (self.anisotropy, "anisotropy"),
            (self.iridescence, "iridescence"),
            (self.diffuse_transmission, "diffuse_transmission"),
            (self.baked_light, "baked_light"),
            (self.environment, "environment"),
        ]
        .into_iter()
        .filter_map(|(needed, name)| needed.then_some(name))
        .collect()
    }
}
