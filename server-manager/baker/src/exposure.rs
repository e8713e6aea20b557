//! The exposure of scenes whose lights have real units: thousands of lux would all be white.
//!
//! Surfaces are sampled on a grid in the box of each primitive. The geometric mean of those that
//! are lit is what a photographer would meter (E. Reinhard et al., *Photographic Tone
//! Reproduction for Digital Images*, 2002). Emission counts as the illuminance that makes a white
//! surface as bright. At the suggested exposure a mid-grey surface in that light has middle
//! brightness.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::{Light, LightKind, Node, Primitive, Scene};

/// Least mean illuminance, in lux, that is taken for real units. Artists give suns 1 to 10, and a
/// mid-grey surface in so much light is shown as white; living rooms have more.
const REAL_LUX_MIN: f64 = 50.0;

/// Illuminance of a scene without lights, in lux: that of the default sun.
const DEFAULT_LUX: f64 = 3.0;

/// Primitives that are sampled, evenly chosen among all, and lights, the brightest: some
/// milliseconds.
const BOXES_MAX: usize = 2048;
const LIGHTS_MAX: usize = 128;

/// Instances of a node that are sampled.
const INSTANCES_MAX: usize = 8;

/// Places in a box along each axis, in half sides from its middle.
const GRID: [f64; 3] = [-2.0 / 3.0, 0.0, 2.0 / 3.0];

/// Least emission that is taken for real units, in candela per square metre: artists' strengths
/// seldom reach it, screens and sky do.
const REAL_EMISSION_MIN: f64 = 50.0;

/// Share of the area whose illuminance is the brightest that counts: a bulb itself does not.
const BRIGHTEST: f64 = 0.01;

/// Least illuminance that is metered, as a share of the brightest: what no lamp reaches is dark.
const DARK: f64 = 0.02;

/// Share of an emissive factor that counts where a texture says which parts glow.
const TEXTURED: f64 = 0.2;

/// The exposure that suits a scene without its `hidden` nodes, rounded to two digits; `None` for
/// scenes that look right at 1.
pub(super) fn suggest(scene: &Scene, hidden: &[bool]) -> Option<f32> {
    let places = scene.nodes.iter().zip(scene.world_from_nodes()).zip(hidden);
    let shown = places.filter(|(_, is_hidden)| !**is_hidden).map(|(place, _)| place);
    let shown: Vec<(&Node, DAffine3)> = shown.collect();
    let mut lamps: Vec<Lamp> = Vec::new();
    for (node, world) in &shown {
        let light = node.light.and_then(|light| scene.lights.get(light as usize));
        lamps.extend(light.map(|light| Lamp::new(light, world)).filter(|lamp| lamp.strength > 0.0));
    }
    let has_lights = shown.iter().any(|(node, _)| node.light.is_some());
    lamps.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    lamps.truncate(LIGHTS_MAX);
    let boxes: Vec<Box> = boxes(scene, &shown);
    let step = boxes.len().div_ceil(BOXES_MAX).max(1);
    let mut samples = Vec::new();
    for of in boxes.iter().step_by(step) {
        let constant = of.emission + if has_lights { 0.0 } else { DEFAULT_LUX };
        for place in of.places() {
            samples.push((of.area, constant + illuminance(&lamps, place, of.near)));
        }
    }
    let middle = scene.bounds.map_or(DVec3::ZERO, |bounds| bounds.center());
    samples.extend(lamps.iter().filter_map(|lamp| lamp.aimed_at(middle)));
    let lux = metered(&mut samples)?;
    let exposure = (PI / lux).max(1e-9);
    let digits = format!("{exposure:.1e}").parse::<f32>().ok();
    digits.filter(|_| lux > REAL_LUX_MIN)
}

/// The geometric mean of the illuminance of places that are lit, given with their areas.
fn metered(samples: &mut [(f64, f64)]) -> Option<f64> {
    samples.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    let area: f64 = samples.iter().map(|(area, _)| area).sum();
    let mut passed = 0.0;
    let brightest = samples.iter().find(|(of, _)| {
        passed += of;
        passed >= area * BRIGHTEST
    });
    let least = brightest.map(|(_, lux)| lux * DARK).filter(|least| *least > 0.0)?;
    let lit = || samples.iter().take_while(|(_, lux)| *lux >= least);
    let area: f64 = lit().map(|(area, _)| area).sum();
    let mean = (lit().map(|(of, lux)| of * lux.ln()).sum::<f64>() / area).exp();
    (mean.is_finite() && mean > 0.0).then_some(mean)
}

/// A light where it stands.
struct Lamp {
    kind: LightKind,
    position: DVec3,
    /// A vector of length 1.
    direction: DVec3,
    /// Lux of a directional light, candela of others; of the light that is seen (BT.709).
    strength: f64,
    range: f64,
}

impl Lamp {
    fn new(light: &Light, world: &DAffine3) -> Self {
        let forward = world.transform_vector3(DVec3::NEG_Z);
        Self {
            kind: light.kind,
            position: world.translation,
            direction: forward.try_normalize().unwrap_or(DVec3::NEG_Z),
            strength: luminance(light.color) * f64::from(light.intensity),
            range: light.range.map_or(f64::INFINITY, f64::from),
        }
    }

    /// The area that a spot lights, level with the middle of the scene, and its illuminance there.
    fn aimed_at(&self, middle: DVec3) -> Option<(f64, f64)> {
        let LightKind::Spot { outer_rad, .. } = self.kind else { return None };
        let distance = (middle - self.position).dot(self.direction);
        let radius = distance * f64::from(outer_rad).tan();
        let lux = self.lights(self.position + self.direction * distance, 0.0).length();
        (distance > 0.0 && radius.is_finite() && lux > 0.0).then_some((PI * radius * radius, lux))
    }

    /// The light that falls on a surface there that faces it, in lux, along its direction.
    fn lights(&self, place: DVec3, near: f64) -> DVec3 {
        if self.kind == LightKind::Directional {
            return self.direction * self.strength;
        }
        let away = place - self.position;
        let distance = away.length().max(near);
        let window = (1.0 - (distance / self.range).powi(4)).max(0.0);
        let toward = away.try_normalize().unwrap_or(self.direction);
        let cone = match self.kind {
            LightKind::Spot { outer_rad, .. } => {
                let is_within = toward.dot(self.direction) >= f64::from(outer_rad).cos();
                if is_within { 1.0 } else { 0.0 }
            }
            _ => 1.0,
        };
        toward * (self.strength * window * cone / (distance * distance))
    }
}

/// Relative luminance of linear RGB (ITU-R BT.709).
fn luminance(color: Vec3) -> f64 {
    f64::from(color.dot(Vec3::new(0.2126, 0.7152, 0.0722)))
}

/// The light on a surface that is turned to where most of it comes from, in lux.
fn illuminance(lamps: &[Lamp], place: DVec3, near: f64) -> f64 {
    let (mut sum, mut most) = (DVec3::ZERO, 0.0f64);
    for lamp in lamps {
        let light = lamp.lights(place, near);
        sum += light;
        most = most.max(light.length());
    }
    sum.length().max(most)
}

/// The box around a primitive that light falls on.
struct Box {
    world: DAffine3,
    middle: DVec3,
    half: DVec3,
    /// Area in square units of the world, up to a factor; never 0.
    area: f64,
    /// No lamp counts as nearer than this: the surface is somewhere in the box.
    near: f64,
    /// In lux on white.
    emission: f64,
}

impl Box {
    fn places(&self) -> impl Iterator<Item = DVec3> + '_ {
        let all = GRID.into_iter().flat_map(|x| GRID.into_iter().map(move |y| (x, y)));
        let all = all.flat_map(|(x, y)| GRID.into_iter().map(move |z| DVec3::new(x, y, z)));
        all.map(|at| self.world.transform_point3(self.middle + self.half * at))
    }
}

fn boxes(scene: &Scene, shown: &[(&Node, DAffine3)]) -> Vec<Box> {
    let mut boxes = Vec::new();
    for (node, world) in shown {
        let mesh = node.mesh.and_then(|mesh| scene.meshes.get(mesh as usize));
        for primitive in mesh.iter().flat_map(|mesh| &mesh.primitives) {
            let material = primitive.material.and_then(|of| scene.materials.get(of as usize));
            if material.is_some_and(|material| material.unlit) {
                continue;
            }
            let share = material.map_or(0.0, |material| match material.emissive_texture {
                Some(_) => TEXTURED,
                None => 1.0,
            });
            let emission = material.map_or(0.0, |material| luminance(material.emissive));
            let counted = if emission >= REAL_EMISSION_MIN { emission } else { 0.0 };
            let emission = share * PI * counted;
            boxes.extend(placements(node, *world).map(|at| bounding(primitive, at, emission)));
        }
    }
    boxes
}

/// Returns the transforms with which a node draws its mesh, in world space: a sample of its
/// instances if they are many.
fn placements(node: &Node, world: DAffine3) -> impl Iterator<Item = DAffine3> + '_ {
    let copies = node.instances.iter().step_by(node.instances.len().div_ceil(INSTANCES_MAX).max(1));
    let copies = copies.map(move |copy| {
        let (scale, rotation) = (copy.scale.as_dvec3(), copy.rotation.as_dquat().normalize());
        let translation = copy.translation.as_dvec3();
        world * DAffine3::from_scale_rotation_translation(scale, rotation, translation)
    });
    copies.chain(node.instances.is_empty().then_some(world))
}

fn bounding(primitive: &Primitive, world: DAffine3, emission: f64) -> Box {
    let (min, max) = (primitive.min.as_dvec3(), primitive.max.as_dvec3());
    let half = (max - min) * 0.5;
    let axes = [world.x_axis * half.x, world.y_axis * half.y, world.z_axis * half.z];
    let [x, y, z] = axes.map(DVec3::length);
    let radius = DVec3::new(x, y, z).length();
    Box {
        world,
        middle: primitive.origin + min + half,
        half,
        area: (x * y + y * z + z * x).max(radius * radius * 1e-3).max(f64::MIN_POSITIVE),
        near: radius / 3.0,
        emission,
    }
}
