//! The visibility of nodes, the light of lights and the look of materials, as clips change them in
//! a scene as it stands.

use std::collections::BTreeMap;

use crate::animated_property::{AnimatedProperty, ChangedMaterial, MaterialProperty, PropertyKind};
use crate::scene_edits::SceneEdits;
use crate::variants::find_variant;
use crate::{Light, Scene};

/// The properties that clips change, by what has them: indices into those of the animations.
#[derive(Debug, Default)]
pub(super) struct Looks {
    /// By node of the file.
    nodes: BTreeMap<u32, Vec<usize>>,
    /// By light of the file.
    lights: BTreeMap<u32, Vec<usize>>,
    /// By material of the file.
    materials: BTreeMap<u32, Vec<usize>>,
}

impl Looks {
    /// Those of a scene with edits. A material that was edited stays as it was edited; one that a
    /// variant shows elsewhere is changed there.
    pub(super) fn new(base: &Scene, edits: &SceneEdits) -> Self {
        let mut looks = Self::default();
        for (at, of) in base.animations.properties.iter().enumerate() {
            let by = match of.kind {
                PropertyKind::Visible => &mut looks.nodes,
                PropertyKind::Light(_) => &mut looks.lights,
                PropertyKind::Material(_) => &mut looks.materials,
            };
            for target in &of.targets {
                by.entry(*target).or_insert_with(Vec::new).push(at);
            }
        }
        looks.replace_materials(base, edits);
        looks
    }

    fn replace_materials(&mut self, base: &Scene, edits: &SceneEdits) {
        if self.materials.is_empty() {
            return;
        }
        let names: Vec<&str> = base.variants.iter().map(|of| of.name.as_str()).collect();
        let variant = edits.variant().and_then(|wanted| find_variant(&names, wanted).ok());
        let of_file = self.materials.clone();
        for (slot, shown) in variant.map_or(&[][..], |at| &base.variants[at].materials) {
            match of_file.get(shown).filter(|_| !edits.has_material(*shown)) {
                Some(properties) => drop(self.materials.insert(*slot, properties.clone())),
                None => drop(self.materials.remove(slot)),
            }
        }
        self.materials.retain(|slot, _| !edits.has_material(*slot));
    }

    /// Returns whether clips change nothing of this kind.
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty() && self.lights.is_empty() && self.materials.is_empty()
    }

    /// The nodes of the file that are shown and hidden.
    pub(super) fn nodes(&self) -> impl Iterator<Item = u32> + '_ {
        self.nodes.keys().copied()
    }

    /// Returns whether clips change lights.
    pub(super) fn has_lights(&self) -> bool {
        !self.lights.is_empty()
    }

    /// Returns whether clips change a light of the file.
    pub(super) fn has_light(&self, light: u32) -> bool {
        self.lights.contains_key(&light)
    }

    /// Returns whether a node of the file is hidden itself while properties have these values.
    pub(super) fn hides(&self, node: u32, values: &[Vec<f64>]) -> bool {
        let is_off = |at: &usize| values[*at].first().is_some_and(|value| *value < 0.5);
        self.nodes.get(&node).is_some_and(|of| of.iter().any(is_off))
    }

    /// A light of the file as it shines while properties have these values.
    pub(super) fn light(&self, base: &Scene, light: u32, values: &[Vec<f64>]) -> Option<Light> {
        let properties = self.lights.get(&light)?;
        let mut made = base.lights.get(light as usize)?.clone();
        for at in properties {
            if let PropertyKind::Light(property) = base.animations.properties[*at].kind {
                made = made.with(property, &values[*at]);
            }
        }
        Some(made.with_rim())
    }

    /// The materials that clips change as they look while properties have these values.
    pub(super) fn materials(&self, base: &Scene, values: &[Vec<f64>]) -> Vec<ChangedMaterial> {
        let all: &[AnimatedProperty] = &base.animations.properties;
        let changed = |(&material, properties): (&u32, &Vec<usize>)| {
            let of = |at: &usize| match all[*at].kind {
                PropertyKind::Material(property) => Some((property, values[*at].clone())),
                _ => None,
            };
            ChangedMaterial { material, values: properties.iter().filter_map(of).collect() }
        };
        self.materials.iter().map(changed).collect()
    }

    /// Each material that clips change with each of its properties, rising by material.
    pub(super) fn changing(&self, base: &Scene) -> Vec<(u32, MaterialProperty)> {
        let all: &[AnimatedProperty] = &base.animations.properties;
        let each = self.materials.iter().flat_map(|(material, properties)| {
            properties.iter().map(|at| (*material, all[*at].kind))
        });
        let of = |(material, kind)| match kind {
            PropertyKind::Material(property) => Some((material, property)),
            _ => None,
        };
        each.filter_map(of).collect()
    }
}
