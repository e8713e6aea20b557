//! Extensions that a file uses, counted where they stand, and what is said of those that are not
//! drawn.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::Value;

use super::container::EXTENSIONS;
use super::uri;

/// Maximum number of different extensions that are counted.
const NAMES_MAX: usize = 256;

/// Extensions that are not read and of which nothing can be seen, and those of which other notes
/// say what is missing: bytes and images that are stored in another way, and what moves.
const SAID_ELSEWHERE: [&str; 21] = [
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_mesh_primitive_restart",
    "EXT_meshopt_compression",
    "EXT_structural_metadata",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "FB_geometry_metadata",
    "GODOT_single_root",
    "KHR_audio_emitter",
    "KHR_draco_mesh_compression",
    "KHR_meshopt_compression",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics_rigid_bodies",
    "KHR_texture_basisu",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MOZ_texture_rgbe",
    "MSFT_texture_dds",
];

/// Extensions of materials with the keys that must differ from these values to be seen: each is a
/// number, or the value of all numbers of a list.
const NEUTRAL: [(&str, &[(&str, f64)]); 1] =
    [("KHR_materials_volume_scatter", &[("multiscatterColor", 0.0)])];

/// Counts of the extensions in a file, by name and top-level list.
#[derive(Debug, Default)]
pub(super) struct ExtensionUses(BTreeMap<String, BTreeMap<Host, u64>>);

/// The kind of object that an extension extends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Host {
    Material,
    Node,
    Part,
    Texture,
    Other,
}

impl Host {
    fn of_list(key: &str) -> Self {
        match key {
            "materials" => Self::Material,
            "nodes" => Self::Node,
            "meshes" => Self::Part,
            "textures" => Self::Texture,
            _ => Self::Other,
        }
    }

    /// The note of so many of these that have an extension.
    fn note(self, count: u64, name: &str) -> String {
        let be = if count == 1 { "is" } else { "are" };
        let (list, counted) = match self {
            Self::Material => ("materials", format!("{count} {be}")),
            Self::Node => ("nodes", format!("{count} {be}")),
            Self::Texture => ("textures", format!("{count} {be}")),
            Self::Part if count == 1 => ("meshes", "1 part is".into()),
            Self::Part => ("meshes", format!("{count} parts are")),
            Self::Other => return format!("extensions: {name} is not drawn"),
        };
        format!("{list}: {counted} drawn without {name}")
    }
}

impl ExtensionUses {
    /// Counts the extensions of a glTF file's JSON. Where the JSON is none, those before that.
    pub(super) fn of_json(text: &[u8]) -> Self {
        let mut uses = Self::default();
        let walk = Walk { uses: &mut uses, host: None, is_extensions: false };
        // Who reads the document says what is wrong with it.
        let _ = walk.deserialize(&mut serde_json::Deserializer::from_slice(text));
        uses
    }

    /// Returns a note for each extension that is used or declared, and not drawn.
    pub(super) fn notes(&self, declared: &[String]) -> Vec<String> {
        let is_missing =
            |name: &str| !EXTENSIONS.contains(&name) && !SAID_ELSEWHERE.contains(&name);
        let used = self.0.iter().filter(|(name, _)| is_missing(name));
        let used = used.filter(|(_, hosts)| hosts.values().any(|&count| count > 0));
        let used = used.map(|(name, hosts)| {
            // The first that has a list of its own; what the file as a whole has is beside it.
            let host = hosts.iter().find(|(_, count)| **count > 0);
            let (host, count) = host.map_or((Host::Other, 0), |(host, count)| (*host, *count));
            host.note(count, &uri::shorten(name))
        });
        let unused = declared.iter().filter(|name| is_missing(name) && !self.0.contains_key(*name));
        let unused =
            unused.map(|name| format!("extensionsUsed: {} is not supported", uri::shorten(name)));
        used.chain(unused).collect()
    }

    fn add(&mut self, name: &str, host: Host, count: u64) {
        if let Some(hosts) = self.0.get_mut(name) {
            *hosts.entry(host).or_default() += count;
        } else if self.0.len() < NAMES_MAX {
            self.0.insert(name.to_owned(), BTreeMap::from([(host, count)]));
        }
    }
}

/// A walk through a value of the JSON.
struct Walk<'a> {
    uses: &'a mut ExtensionUses,
    /// `None` for the whole document.
    host: Option<Host>,
    /// The value is an object whose keys are extensions.
    is_extensions: bool,
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            let host = self.host.unwrap_or(Host::Other);
            if self.is_extensions && host == Host::Material && is_of_material(&key) {
                let value = map.next_value::<Value>()?;
                self.uses.add(&key, host, u64::from(!is_neutral(&key, &value)));
                continue;
            }
            // Bytes are no pictures, and what programs keep beside a scene is theirs.
            let is_skipped = match key.as_str() {
                "accessors" | "bufferViews" | "buffers" => self.host.is_none(),
                "extras" => !self.is_extensions,
                _ => false,
            };
            if is_skipped {
                map.next_value::<IgnoredAny>()?;
                continue;
            }
            if self.is_extensions {
                self.uses.add(&key, host, 1);
            }
            let host = self.host.unwrap_or_else(|| Host::of_list(&key));
            let is_extensions = !self.is_extensions && key == "extensions";
            map.next_value_seed(Walk { uses: &mut *self.uses, host: Some(host), is_extensions })?;
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        loop {
            let walk = Walk { uses: &mut *self.uses, host: self.host, is_extensions: false };
            if seq.next_element_seed(walk)?.is_none() {
                return Ok(());
            }
        }
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }
}

fn is_of_material(name: &str) -> bool {
    NEUTRAL.iter().any(|(known, _)| *known == name)
}

/// Returns whether a material looks the same with this extension and without it.
fn is_neutral(name: &str, value: &Value) -> bool {
    let keys = NEUTRAL.iter().find(|(known, _)| *known == name).map_or(&[][..], |(_, keys)| keys);
    keys.iter().all(|(key, neutral)| match value.get(key) {
        None => true,
        Some(Value::Array(list)) => list.iter().all(|number| number.as_f64() == Some(*neutral)),
        Some(number) => number.as_f64() == Some(*neutral),
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn notes(json: &Value, declared: &[&str]) -> Vec<String> {
        let declared: Vec<String> = declared.iter().map(ToString::to_string).collect();
        ExtensionUses::of_json(json.to_string().as_bytes()).notes(&declared)
    }

    #[test]
    fn says_once_how_many_have_an_extension_that_is_not_drawn() {
        let milk = json!({ "KHR_materials_volume_scatter": { "multiscatterColor": [1, 1, 0] } });
        let milk = json!({ "extensions": milk });
        let other =
            json!({ "extensions": { "ACME_fog": {} }, "extras": { "extensions": { "X": 1 } } });
        let json = json!({
            "materials": [milk, milk, { "extensions": { "KHR_materials_unlit": {} } }],
            "nodes": [other],
            "meshes": [{ "primitives": [{ "extensions": { "ACME_fur": {} } }, other] }],
            "scenes": [{ "extensions": { "EXT_lights_ies": { "light": 0 } } }],
            "extensions": { "EXT_lights_ies": { "lights": [] } },
        });
        assert_eq!(
            notes(&json, &["KHR_materials_volume_scatter", "ACME_smell", "EXT_mesh_features"]),
            [
                "nodes: 1 is drawn without ACME_fog",
                "meshes: 1 part is drawn without ACME_fur",
                "extensions: EXT_lights_ies is not drawn",
                "materials: 2 are drawn without KHR_materials_volume_scatter",
                "extensionsUsed: ACME_smell is not supported",
            ]
        );
    }

    #[test]
    fn says_nothing_of_extensions_that_change_nothing() {
        let neutral = json!({
            "KHR_materials_volume_scatter": { "multiscatterColor": [0, 0.0, 0] },
            "KHR_materials_dispersion": { "dispersion": 0.0 },
            "KHR_materials_emissive_strength": { "emissiveStrength": 3 },
        });
        let declared: Vec<&str> =
            neutral.as_object().expect("an object").keys().map(String::as_str).collect();
        let json = |extensions: &Value| json!({ "materials": [{ "extensions": extensions }] });
        assert_eq!(notes(&json(&neutral), &declared), [] as [String; 0]);
        let milk = json!({ "KHR_materials_volume_scatter": { "multiscatterColor": [0, 0.1, 0] } });
        assert_eq!(notes(&json(&milk), &[]).len(), 1);
    }

    #[test]
    fn bounds_what_a_file_can_make_it_count() {
        let extensions: BTreeMap<String, Value> =
            (0..NAMES_MAX * 2).map(|i| (format!("X_{i}"), json!({}))).collect();
        assert_eq!(notes(&json!({ "extensions": extensions }), &[]).len(), NAMES_MAX);
        assert_eq!(notes(&json!({ "nodes": [[[[3]]], "x", null] }), &[]), [] as [String; 0]);
    }
}
