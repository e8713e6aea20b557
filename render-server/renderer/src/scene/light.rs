//! Lights as placed in the world, and which items each can reach.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::limits::LIT_DRAWS_MAX;
use polyptych_scene::{DEFAULT_SUN_TOWARD, Light, LightKind, Material, NodeTraits, Scene};
use polyptych_wall::ShadowFilter;

use super::SceneError;
use super::draw_item::Bounds;
use super::lamp_grid::{GRID_LAMPS_MIN, IN_CELLS, LampGrid};
use super::lamp_search::LampSearch;
use super::moved_items::MovedNode;
use super::subset::{Selection, layer_bit};
use crate::view::SUNS_MAX;

/// Shines where a scene has no light of its own, no baked light and no surroundings with a sun: a
/// little warm. Given as the direction towards it, and lux.
const DEFAULT_SUN: DirectionalLight = DirectionalLight {
    toward: DEFAULT_SUN_TOWARD,
    irradiance: Vec3::new(3.1, 2.95, 2.7),
    on: Condition::StandIn(0),
    casts_shadows: false,
};

/// Radiance from below as a factor of the sky's, where a scene does not say: a matt, warm ground.
pub(crate) const GROUND: Vec3 = Vec3::new(0.36, 0.32, 0.28);

/// Maximum number of entries of all lists of lamps: 64 MiB here and on the GPU, and as much again
/// while they are made.
pub(super) const LAMP_INDICES_MAX: usize = 16 << 20;

/// Widens the reach of a lamp by more than the shader's rounding.
const REACH_SLACK: f64 = 1.0 + 1e-5;

/// Widens the cone of a lamp, in radians, by more than the cosines of its edge round in f32, also
/// where the cone is narrow.
const CONE_SLACK_RAD: f64 = 2e-3;

/// The parts of a scene that a light shines in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Condition {
    Always,
    /// Those that show the layer of this bit.
    With(u64),
    /// Those that show none of the layers of these bits, in surroundings without a sun.
    StandIn(u64),
}

impl Condition {
    fn of_layer(bit: u64) -> Self {
        if bit == 0 { Self::Always } else { Self::With(bit) }
    }

    /// The colour of a light in a part of a scene: black where it does not shine.
    pub fn color_in(self, color: Vec3, part: Selection) -> Vec3 {
        let is_on = match self {
            Self::Always => true,
            Self::With(bit) => part.has_layer(bit),
            Self::StandIn(bits) => !part.has_sun() && (bits == 0 || !part.has_layer(bits)),
        };
        if is_on { color } else { Vec3::ZERO }
    }
}

/// A directional light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DirectionalLight {
    /// Unit vector towards it, in world axes.
    pub toward: Vec3,
    /// Lux, as linear RGB.
    pub irradiance: Vec3,
    pub on: Condition,
    /// Surfaces that it does not reach lie in shadow: set for every light of the file, but not for
    /// the default sun.
    pub casts_shadows: bool,
}

/// A light that is not among the first directional ones: its place is looked up per item.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalLight {
    pub position: DVec3,
    /// Unit vector along which it shines.
    pub direction: Vec3,
    /// Candela as linear RGB; lux where directional.
    pub intensity: Vec3,
    /// 0 for an unlimited one.
    pub inverse_range: f32,
    /// Scale and offset of the cone, applied to the cosine; 0 and 1 for a point light.
    /// `KHR_lights_punctual`, "Inner and Outer Cone Angles".
    pub cone: [f32; 2],
    pub directional: bool,
    pub on: Condition,
    /// Maps that its shadows take; 0 if it casts none.
    pub map_count: usize,
    /// Half of the angle of the cone, in radians, if it is a spot light.
    pub outer_rad: Option<f64>,
    range: Option<f64>,
}

/// A light whose node may move.
#[derive(Clone, Debug)]
struct MovingLight {
    /// An index into the scene's nodes.
    node: u32,
    is_sun: bool,
    /// An index into [`Lights::suns`] or [`Lights::lamps`].
    slot: usize,
    light: Light,
}

/// The lights of a scene at a moment.
#[derive(Clone, Debug)]
pub(crate) struct MovedLights {
    /// The like of [`Lights::suns`].
    pub suns: Vec<DirectionalLight>,
    /// The like of [`Lights::lamps`].
    pub lamps: Vec<LocalLight>,
}

/// The lights of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lights {
    /// At most [`SUNS_MAX`]: these are in the frame's uniforms and shine on everything.
    pub suns: Vec<DirectionalLight>,
    /// All others.
    pub lamps: Vec<LocalLight>,
    /// A point or spot light casts shadows, or may at another moment.
    pub has_lamp_shadows: bool,
    /// Lists of lamps: those of the cells of the grid, then others, of which each item has a range.
    pub indices: Vec<u32>,
    /// The grid, if many lamps have a reach.
    pub grid: Option<LampGrid>,
    moving: Vec<MovingLight>,
    search: LampSearch,
    /// Pairs of a lamp and a box that were looked at for the items.
    pairs: u64,
    known: HashMap<Vec<u32>, [u32; 2]>,
}

impl Lights {
    /// All lights of the scene, and the default sun if there may be none: each can be in a layer
    /// that is not shown. Baked light is light; surroundings change while the lights stay.
    pub fn new(desc: &Scene, world: &[DAffine3], traits: &NodeTraits) -> Self {
        let mut lights = Self::default();
        let is_baked = desc.materials.iter().any(Material::has_baked_light);
        let (mut layers, mut is_lit) = (0, is_baked);
        for (index, (node, world_from_node)) in desc.nodes.iter().zip(world).enumerate() {
            let Some(light) = node.light.map(|light| &desc.lights[light as usize]) else {
                continue;
            };
            let layer = layer_bit(traits, index);
            (layers, is_lit) = (layers | layer, is_lit || layer == 0);
            let mut lamp = LocalLight::new(light, world_from_node, Condition::of_layer(layer));
            if traits.is_moving(index) {
                // It may come near anything; the shader ends it where it ends.
                lamp.range = None;
                let is_sun = lamp.directional && lights.suns.len() < SUNS_MAX;
                let slot = if is_sun { lights.suns.len() } else { lights.lamps.len() };
                let (node, light) = (index as u32, light.clone());
                lights.moving.push(MovingLight { node, is_sun, slot, light });
            }
            let may_shine = lamp.intensity != Vec3::ZERO || traits.has_changing_light(index);
            lights.add(lamp, may_shine);
        }
        // As bright in the picture, however bright the lights were that set the exposure.
        let irradiance = DEFAULT_SUN.irradiance / desc.exposure.unwrap_or(1.0);
        let sun = DirectionalLight { irradiance, ..DEFAULT_SUN };
        if !is_lit && layers == 0 {
            lights.suns.push(sun);
        } else if !is_lit {
            lights.add(LocalLight::of_sun(&sun, Condition::StandIn(layers)), false);
        }
        if let Some((grid, lists)) = LampGrid::new(&lights.lamps) {
            (lights.grid, lights.indices) = (Some(grid), lists);
        }
        lights.search = LampSearch::new(&lights.lamps);
        lights
    }

    /// The lights where some nodes have moved; `None` where all stay as they are. `find` gives a
    /// node that has moved, is hidden, or has another light.
    pub fn moved<'a>(
        &self,
        find: impl Fn(u32) -> Option<&'a MovedNode<'a>>,
    ) -> Option<MovedLights> {
        let (mut suns, mut lamps) = (self.suns.clone(), self.lamps.clone());
        let mut is_moved = false;
        for MovingLight { node, is_sun, slot, light } in &self.moving {
            let Some(moved) = find(*node) else { continue };
            is_moved = true;
            let on = if *is_sun { suns[*slot].on } else { lamps[*slot].on };
            let light = moved.light.unwrap_or(light);
            let mut lamp = LocalLight::new(light, &moved.world_from_node, on);
            if moved.is_hidden {
                lamp.intensity = Vec3::ZERO;
            }
            if *is_sun {
                let sun = &mut suns[*slot];
                (sun.toward, sun.irradiance) = (-lamp.direction, lamp.intensity);
            } else {
                lamps[*slot] = LocalLight { range: None, ..lamp };
            }
        }
        is_moved.then_some(MovedLights { suns, lamps })
    }

    fn add(&mut self, lamp: LocalLight, casts_shadows: bool) {
        if lamp.directional && self.suns.len() < SUNS_MAX {
            let (toward, irradiance) = (-lamp.direction, lamp.intensity);
            self.suns.push(DirectionalLight { toward, irradiance, on: lamp.on, casts_shadows });
        } else {
            self.has_lamp_shadows |= casts_shadows && !lamp.directional;
            self.lamps.push(lamp);
        }
    }

    /// Returns whether a directional light casts shadows.
    pub fn cast_shadows(&self) -> bool {
        self.suns.iter().any(|sun| sun.casts_shadows)
    }

    /// Returns whether a light casts shadows.
    pub fn has_shadows(&self) -> bool {
        self.cast_shadows() || self.has_lamp_shadows
    }

    /// The filter of the maps of a scene's shadows, if it has any.
    pub fn shadow_filter(&self) -> ShadowFilter {
        if self.has_shadows() { ShadowFilter::default() } else { ShadowFilter::Off }
    }

    /// Returns start and count of the list of the lamps that reach a box, as
    /// [`Self::lamps_reaching`] gives it. Equal lists are shared.
    ///
    /// # Errors
    /// All lists together would be longer than [`LAMP_INDICES_MAX`], or take minutes to make.
    pub fn lights_affecting(&mut self, bounds: &Bounds) -> Result<[u32; 2], SceneError> {
        let near = self.search.near(bounds);
        self.pairs += near.len() as u64;
        if self.pairs > LIT_DRAWS_MAX {
            return Err(SceneError::Description(format!(
                "lights reach primitives more than {LIT_DRAWS_MAX} times; give the lights shorter \
                 ranges, or draw fewer primitives"
            )));
        }
        let (list, in_cells) = self.listed(near, bounds);
        if let Some(&[start, count]) = self.known.get(&list) {
            return Ok([start, count | in_cells]);
        }
        if self.indices.len() + list.len() > LAMP_INDICES_MAX {
            return Err(SceneError::Description(format!(
                "the lists of lights that reach each primitive have more than {LAMP_INDICES_MAX} \
                 entries; give the lights shorter ranges"
            )));
        }
        let [start, count] = [self.indices.len() as u32, list.len() as u32];
        self.indices.extend_from_slice(&list);
        self.known.insert(list, [start, count]);
        Ok([start, count | in_cells])
    }

    /// Returns the lamps that reach a box, in order, and 0. If many of them are in the grid, these
    /// are left out, and the number is [`IN_CELLS`].
    pub fn lamps_reaching(&self, bounds: &Bounds) -> (Vec<u32>, u32) {
        self.listed(self.search.near(bounds), bounds)
    }

    /// The same, of the lamps that may reach the box.
    fn listed(&self, mut list: Vec<u32>, bounds: &Bounds) -> (Vec<u32>, u32) {
        list.retain(|&index| self.lamps[index as usize].reaches(bounds));
        let Some(grid) = &self.grid else { return (list, 0) };
        if list.iter().filter(|lamp| grid.holds(**lamp)).count() < GRID_LAMPS_MIN {
            return (list, 0);
        }
        list.retain(|lamp| !grid.holds(*lamp));
        (list, IN_CELLS)
    }

    /// Forgets which lists are equal, once all are made: that takes as much memory as the lists.
    pub fn seal(&mut self) {
        self.known = HashMap::new();
    }
}

impl LocalLight {
    fn of_sun(sun: &DirectionalLight, on: Condition) -> Self {
        Self {
            position: DVec3::ZERO,
            direction: -sun.toward,
            intensity: sun.irradiance,
            inverse_range: 0.0,
            cone: [0.0, 1.0],
            directional: true,
            on,
            map_count: 0,
            outer_rad: None,
            range: None,
        }
    }

    pub(super) fn new(light: &Light, world_from_node: &DAffine3, on: Condition) -> Self {
        let along = world_from_node.transform_vector3(DVec3::NEG_Z);
        let direction = along.try_normalize().unwrap_or(DVec3::NEG_Z).as_vec3();
        let cone = match light.kind {
            LightKind::Spot { inner_rad, outer_rad } => {
                let (inner, outer) = (inner_rad.cos(), outer_rad.cos());
                let scale = 1.0 / (inner - outer).max(0.001);
                [scale, -outer * scale]
            }
            LightKind::Point | LightKind::Directional => [0.0, 1.0],
        };
        let range = light.finite_range();
        Self {
            position: world_from_node.translation,
            direction,
            intensity: light.color * light.intensity,
            inverse_range: range.map_or(0.0, f32::recip),
            cone,
            directional: light.kind == LightKind::Directional,
            on,
            map_count: light.lamp_map_count(),
            outer_rad: match light.kind {
                LightKind::Spot { outer_rad, .. } => Some(f64::from(outer_rad)),
                LightKind::Point | LightKind::Directional => None,
            },
            range: range.map(f64::from),
        }
    }

    /// The distance at which it ends, in units of the world; infinite of an unlimited one.
    pub fn reach(&self) -> f64 {
        f64::from(self.inverse_range).recip()
    }

    /// The distance beyond which the shader's falloff is 0, in units of the world; `None` if it has
    /// no end or the light may move.
    pub(super) fn bounded_reach(&self) -> Option<f64> {
        self.range.filter(|_| !self.directional).map(|range| range * REACH_SLACK)
    }

    /// Returns whether it may have light in a box whose sphere its cone meets. Of a cone of half
    /// angle α around an axis, a point at h along the axis and r beside it is r cos α − h sin α
    /// away.
    pub(super) fn shines_towards(&self, bounds: &Bounds) -> bool {
        let Some(outer) = self.outer_rad.filter(|outer| *outer < FRAC_PI_2) else { return true };
        let way = bounds.center() - self.position;
        let along = way.dot(self.direction.as_dvec3());
        let beside = (way.length_squared() - along * along).max(0.0).sqrt();
        let (sin, cos) = (outer + CONE_SLACK_RAD).sin_cos();
        let is_outside = beside * cos - along * sin > bounds.half().length();
        !is_outside
    }

    /// Exact, because the shader's falloff is 0 from the range on.
    pub(super) fn reaches(&self, bounds: &Bounds) -> bool {
        let Some(reach) = self.bounded_reach() else { return true };
        // Written so that a box that is not finite is reached.
        let beyond = bounds.distance_squared(self.position) > reach * reach;
        !beyond
    }
}
