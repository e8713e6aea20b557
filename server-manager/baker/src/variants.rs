//! `KHR_materials_variants`: what a primitive looks like in each variant.
//!
//! A primitive that has mappings gets a material of its own, which chosen variants replace; those
//! with the same material and the same mappings share it. Its vertices have what any of its
//! materials needs.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use polyptych_scene::limits::NODE_NAME_BYTES_MAX;
use polyptych_scene::{Material, VARIANTS_MAX, Variant};

use super::BakeJob;
use super::document::Primitive;
use super::error::BakeError;
use super::material::{Palette, VertexRequirements};

/// The JSON path of the file's variants.
const LIST: &str = "extensions.KHR_materials_variants.variants";

/// Materials that variants replace.
#[derive(Debug, Default)]
pub(super) struct ReplacedMaterials {
    /// The place of each in the palette, by the material without a variant and those of variants.
    places: BTreeMap<(Option<u32>, BTreeMap<u32, u32>), u32>,
}

impl ReplacedMaterials {
    /// The material of a primitive in the scene, and what it and those in its place need.
    pub(super) fn material(
        &mut self,
        job: &mut BakeJob<'_>,
        palette: &mut Palette,
        primitive: &Primitive,
        is_lit: bool,
        place: &str,
    ) -> Result<(Option<u32>, VertexRequirements), BakeError> {
        let own = VertexRequirements::default();
        let (material, mut needs) =
            palette.material(job, primitive.material, is_lit, own.uv_sets, place)?;
        let mut looks: BTreeMap<u32, u32> = BTreeMap::new();
        for (i, mapping) in primitive.extensions.variants.mappings.iter().enumerate() {
            let place = format!("{place}.KHR_materials_variants.mappings[{i}]");
            let source = Some(mapping.material);
            let (other, more) = palette.material(job, source, is_lit, needs.uv_sets, &place)?;
            needs = joined(job, primitive, (needs, more), &place);
            let count = job.source.document.extensions.variants.variants.len();
            for &variant in &mapping.variants {
                if variant as usize >= count {
                    return Err(BakeError::beyond(&place, LIST, variant.into(), count));
                }
                // glTF: a variant stands at most once in the mappings of a primitive.
                match (looks.entry(variant), other) {
                    (Entry::Occupied(_), _) => {
                        job.warn(&format!("{place}: variant {variant} has a material already"));
                    }
                    (Entry::Vacant(look), Some(other)) => drop(look.insert(other)),
                    (Entry::Vacant(_), None) => {}
                }
            }
        }
        looks.retain(|variant, look| (*variant as usize) < VARIANTS_MAX && Some(*look) != material);
        if looks.is_empty() {
            return Ok((material, needs));
        }
        let known = self.places.entry((material, looks));
        let replaced = *known.or_insert_with(|| palette.copy_of(material));
        Ok((Some(replaced), needs))
    }

    /// The materials of parts without a variant of which there are copies to be replaced, each with
    /// a copy.
    pub(super) fn copies(&self) -> Vec<(u32, u32)> {
        let each = self.places.iter();
        each.filter_map(|((material, _), copy)| Some(((*material)?, *copy))).collect()
    }

    /// The variants of the file.
    pub(super) fn variants(self, job: &mut BakeJob<'_>) -> Vec<Variant> {
        let names = &job.source.document.extensions.variants.variants;
        // They stand in every list of variants.
        let name = |name: &str| name[..name.floor_char_boundary(NODE_NAME_BYTES_MAX)].to_owned();
        let named = names.iter().take(VARIANTS_MAX);
        let mut variants: Vec<Variant> =
            named.map(|of| Variant { name: name(&of.name), materials: Vec::new() }).collect();
        for ((_, looks), replaced) in self.places {
            for (variant, look) in looks {
                if let Some(variant) = variants.get_mut(variant as usize) {
                    variant.materials.push((replaced, look));
                }
            }
        }
        for variant in &mut variants {
            variant.materials.sort_unstable();
        }
        if names.len() > VARIANTS_MAX {
            let more = names.len() - VARIANTS_MAX;
            job.warn(&format!("{LIST}: the first {VARIANTS_MAX} can be chosen, and {more} not"));
        }
        let mut numbers: BTreeMap<&str, usize> = BTreeMap::new();
        for (at, of) in variants.iter().enumerate() {
            if of.name.is_empty() {
                job.warn(&format!("{LIST}[{at}]: it has no name; it is chosen by its number"));
            } else if let Some(first) = numbers.insert(&of.name, at) {
                numbers.insert(&of.name, first);
                job.warn(&format!(
                    "{LIST}[{at}]: it is named as an earlier one; it is chosen by its number"
                ));
            }
        }
        variants
    }
}

/// Returns the requirements of two materials of one primitive together; `more` has the sets of
/// `needs` too.
fn joined(
    job: &mut BakeJob<'_>,
    primitive: &Primitive,
    (needs, more): (VertexRequirements, VertexRequirements),
    place: &str,
) -> VertexRequirements {
    let has_tangents = primitive.attributes.contains_key("TANGENT");
    if let (Some(one), Some(other)) = (needs.tangents, more.tangents)
        && one != other
        && !has_tangents
    {
        job.warn(&format!(
            "{place}: its normal map lies otherwise than another of the part; it is lit by the \
             tangents of that"
        ));
    }
    VertexRequirements {
        uv_sets: more.uv_sets,
        tangents: needs.tangents.or(more.tangents),
        keeps_order: needs.keeps_order || more.keeps_order,
    }
}

impl Palette {
    /// A material of its own that looks as this one, glTF's default without one.
    fn copy_of(&mut self, material: Option<u32>) -> u32 {
        let of = material.and_then(|of| self.materials.get(of as usize));
        let copy = of.cloned().unwrap_or_else(Material::default);
        self.add(copy, VertexRequirements::default())
    }
}
