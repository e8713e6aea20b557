//! Variants of a scene: other materials for some of its parts (`KHR_materials_variants`).

use serde::{Deserialize, Serialize};

use crate::{Material, Scene};

/// Maximum number of variants of a scene: a list that a person reads.
pub const VARIANTS_MAX: usize = 1024;

/// Names of variants that a message lists at most.
const LISTED_MAX: usize = 16;

/// One look of a scene. Each part that looks otherwise in any of them has a material of its own,
/// which the chosen variant replaces by another.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Variant {
    /// The source's name; may be empty or stand twice.
    pub name: String,
    /// A material that is replaced, and the one in its place: indices into [`Scene::materials`],
    /// in rising order of the first.
    pub materials: Vec<(u32, u32)>,
}

/// The index of a variant by its name or, where none has that, by its number from 0 on.
///
/// # Errors
/// There is none; the text says which there are.
pub fn find_variant<T: AsRef<str>>(names: &[T], wanted: &str) -> Result<usize, String> {
    let by_name = names.iter().position(|name| name.as_ref() == wanted);
    let by_number = || wanted.parse().ok().filter(|number| *number < names.len());
    by_name.or_else(by_number).ok_or_else(|| {
        if names.is_empty() {
            return "the scene has no variants".to_owned();
        }
        let title = |(at, name): (usize, &T)| match name.as_ref() {
            "" => at.to_string(),
            name => format!("{at} ({name})"),
        };
        let list = names.iter().enumerate().map(title).take(LISTED_MAX).collect::<Vec<_>>();
        let more = if names.len() > LISTED_MAX { ", …" } else { "" };
        format!("there is no variant {wanted}; there are {}{more}", list.join(", "))
    })
}

impl Scene {
    /// Replaces materials as a variant does, by its name or number; leaves all as it is where there
    /// is no such variant. What is replaced but was changed by itself stays, as `is_kept` says.
    pub(super) fn show_variant(&mut self, wanted: &str, is_kept: impl Fn(u32) -> bool) {
        let names: Vec<&str> = self.variants.iter().map(|of| of.name.as_str()).collect();
        let Ok(at) = find_variant(&names, wanted) else { return };
        let of = |material: u32| self.materials.get(material as usize).cloned();
        let replaced = self.variants[at].materials.iter().filter(|(from, _)| !is_kept(*from));
        let replaced: Vec<(u32, Option<Material>)> =
            replaced.map(|(from, to)| (*from, of(*to))).collect();
        for (from, material) in replaced {
            if let (Some(slot), Some(material)) = (self.materials.get_mut(from as usize), material)
            {
                *slot = material;
            }
        }
    }

    /// Returns what is wrong with its variants, if anything.
    pub(super) fn variants_fault(&self) -> Option<String> {
        if self.variants.len() > VARIANTS_MAX {
            return Some(format!("it has more than {VARIANTS_MAX} variants"));
        }
        let is_there = |material: u32| (material as usize) < self.materials.len();
        let at = self.variants.iter().position(|of| {
            !of.materials.iter().all(|(from, to)| is_there(*from) && is_there(*to))
                || !of.materials.is_sorted_by(|a, b| a.0 < b.0)
        })?;
        Some(format!("variant {at} names a material that is not there, or one twice"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::Edit;
    use crate::scene_edits::{AssetManifests, SceneEdits};

    fn scene() -> Scene {
        let named = |name: &str| Material { name: name.into(), ..Material::default() };
        let variant = |name: &str, materials: &[(u32, u32)]| Variant {
            name: name.into(),
            materials: materials.to_vec(),
        };
        Scene {
            materials: ["seat", "frame", "red", "blue"].map(named).to_vec(),
            variants: vec![
                variant("Red", &[(0, 2), (1, 3)]),
                variant("Blue", &[(0, 3)]),
                variant("", &[]),
            ],
            ..Scene::default()
        }
    }

    fn looks(scene: &Scene, edits: &[Edit]) -> String {
        let mut all = SceneEdits::default();
        for edit in edits {
            all.apply(edit.clone());
        }
        let (shown, _) = all.apply_to(scene, &AssetManifests::new());
        let names: Vec<&str> = shown.materials.iter().map(|of| of.name.as_str()).collect();
        names.join(" ")
    }

    fn choose(name: &str) -> Edit {
        Edit::SetVariant(Some(name.into()))
    }

    #[test]
    fn a_variant_replaces_materials_and_another_replaces_it() {
        let scene = scene();
        assert_eq!(scene.fault(), None);
        assert_eq!(looks(&scene, &[]), "seat frame red blue");
        assert_eq!(looks(&scene, &[choose("Red")]), "red blue red blue");
        assert_eq!(looks(&scene, &[choose("Red"), choose("Blue")]), "blue frame red blue");
        assert_eq!(looks(&scene, &[choose("1")]), "blue frame red blue", "by number");
        assert_eq!(looks(&scene, &[choose("Red"), choose("2")]), "seat frame red blue");
        assert_eq!(looks(&scene, &[choose("Red"), Edit::SetVariant(None)]), "seat frame red blue");
        assert_eq!(looks(&scene, &[choose("gone")]), "seat frame red blue");
    }

    #[test]
    fn edited_materials_show_through_variants_and_edited_parts_stay() {
        let set = |material: u32, name: &str| Edit::SetMaterial {
            material,
            to: Box::new(Material { name: name.into(), ..Material::default() }),
        };
        let edits = [choose("Red"), set(2, "crimson"), set(1, "steel")];
        assert_eq!(looks(&scene(), &edits), "crimson steel crimson blue");
    }

    #[test]
    fn edits_with_a_variant_fold_to_the_same_and_are_told_apart() {
        let mut edits = SceneEdits::default();
        edits.apply(choose("Red"));
        assert!(!edits.is_empty());
        let copy: SceneEdits =
            polyptych_codec::decode_within::<_, 4096>(&polyptych_codec::encode(&edits))
                .expect("its own bytes");
        assert_eq!(copy, edits);
        assert_eq!((copy.fingerprint(), copy.bytes()), (edits.fingerprint(), edits.bytes()));
        let before = edits.clone();
        edits.apply(choose("Blue"));
        assert_ne!(before.fingerprint(), edits.fingerprint());
        assert_eq!(edits.moved_since(&before), None, "more than places differs");
        edits.apply(Edit::SetVariant(None));
        assert_eq!(edits, SceneEdits::default());
    }

    #[test]
    fn a_name_that_is_not_there_is_answered_with_those_that_are() {
        let names = ["Red", "", "1"];
        assert_eq!(find_variant(&names, "Red"), Ok(0));
        assert_eq!(find_variant(&names, "1"), Ok(2), "a name comes before a number");
        assert_eq!(find_variant(&names, "2"), Ok(2));
        let told = find_variant(&names, "green").expect_err("not there");
        assert_eq!(told, "there is no variant green; there are 0 (Red), 1, 2 (1)");
        let none: [&str; 0] = [];
        assert_eq!(find_variant(&none, "0"), Err("the scene has no variants".to_owned()));
        let many: Vec<String> = (0..40).map(|i| format!("v{i}")).collect();
        assert!(find_variant(&many, "x").expect_err("not there").ends_with("15 (v15), …"));
    }

    #[test]
    fn manifests_whose_variants_point_nowhere_are_refused() {
        for materials in [vec![(0, 4)], vec![(4, 0)], vec![(1, 2), (1, 3)], vec![(1, 2), (0, 2)]] {
            let mut scene = scene();
            scene.variants[1].materials = materials;
            let fault = scene.fault().expect("a fault");
            assert!(fault.starts_with("variant 1 names a material"), "{fault}");
        }
    }
}
