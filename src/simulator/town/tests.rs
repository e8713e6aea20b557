//! The town's promises: the same bytes for ever, sound geometry, the size that was asked for.

use std::collections::BTreeMap;

use serde_json::Value;

use super::{TownError, TownExtras, TownOptions, generate};

/// Bytes and FNV-1a of the town of two blocks and seed 1. Whoever changes the town, or the version
/// of the PNG encoder, writes the new ones here, so that it does not happen unseen.
const PINNED: (usize, u64) = (2651168, 0xd93b_f9fd_0bca_5cf5);

/// Bytes and FNV-1a of the town of two blocks and seed 1 with all extras.
const PINNED_WITH_ALL: (usize, u64) = (2666492, 0x1159_83eb_536b_283d);

const ALL: TownExtras = TownExtras { has_open_sea: true, has_waves: true, is_dusk: true };

struct File {
    json: Value,
    buffer: Vec<u8>,
}

fn town(blocks: u32, seed: u64) -> Vec<u8> {
    generate(&TownOptions { blocks, seed, extras: TownExtras::default() }).unwrap()
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

fn parse(bytes: &[u8]) -> File {
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!(u32_at(bytes, 8), bytes.len());
    let text = u32_at(bytes, 12);
    let json = serde_json::from_slice(&bytes[20..20 + text]).unwrap();
    File { json, buffer: bytes[28 + text..].to_vec() }
}

fn number(value: &Value) -> usize {
    usize::try_from(value.as_u64().unwrap()).unwrap()
}

fn list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

impl File {
    /// The bytes of an accessor, whose end is checked against its view's.
    fn bytes(&self, accessor: &Value) -> &[u8] {
        let accessor = &self.json["accessors"][number(accessor)];
        let view = &self.json["bufferViews"][number(&accessor["bufferView"])];
        let component = if accessor["componentType"] == 5126 { 4 } else { 2 };
        let component = if accessor["componentType"] == 5121 { 1 } else { component };
        let width = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let length = number(&accessor["count"]) * component * width;
        let offset = number(&accessor["byteOffset"]);
        assert!(offset.is_multiple_of(4) && offset + length <= number(&view["byteLength"]));
        let start = number(&view["byteOffset"]) + offset;
        &self.buffer[start..start + length]
    }

    fn floats(&self, accessor: &Value) -> Vec<f32> {
        let bytes = self.bytes(accessor).chunks_exact(4);
        bytes.map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    fn indices(&self, accessor: &Value) -> Vec<usize> {
        let bytes = self.bytes(accessor).chunks_exact(2);
        bytes.map(|b| usize::from(u16::from_le_bytes([b[0], b[1]]))).collect()
    }

    fn primitives(&self) -> impl Iterator<Item = &Value> {
        list(&self.json, "meshes").iter().flat_map(|mesh| list(mesh, "primitives"))
    }

    /// Triangles, every instance counted.
    fn triangles(&self) -> usize {
        let count = |accessor: &Value| number(&self.json["accessors"][number(accessor)]["count"]);
        let of_mesh = |mesh: &Value| {
            let primitives = list(&self.json["meshes"][number(mesh)], "primitives").iter();
            primitives.map(|primitive| count(&primitive["indices"]) / 3).sum::<usize>()
        };
        let of_node = |node: &Value| {
            let places = &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
            let times = places.get("TRANSLATION").map_or(1, count);
            node.get("mesh").map_or(0, of_mesh) * times
        };
        list(&self.json, "nodes").iter().map(of_node).sum()
    }
}

/// Fowler, Noll and Vo, variant 1a, 64 bits.
fn fingerprint(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[test]
fn same_seed_gives_the_same_bytes_for_ever() {
    let bytes = town(2, 1);
    assert!(bytes == town(2, 1), "two runs differ");
    let found = (bytes.len(), fingerprint(&bytes));
    assert_eq!(found, PINNED, "the town has changed: if so intended, pin {found:#x?}");
}

#[test]
fn a_town_with_everything_gives_the_same_bytes_for_ever() {
    let town = || generate(&TownOptions { blocks: 2, seed: 1, extras: ALL }).unwrap();
    let bytes = town();
    assert!(bytes == town(), "two runs differ");
    let found = (bytes.len(), fingerprint(&bytes));
    assert_eq!(found, PINNED_WITH_ALL, "the town has changed: if so intended, pin {found:#x?}");
    assert!(bytes.len() < PINNED.0 + (64 << 10), "{} bytes more", bytes.len() - PINNED.0);
}

#[test]
fn boats_ride_on_waves_that_go_on_where_they_began() {
    let file = parse(&generate(&TownOptions { blocks: 3, seed: 1, extras: ALL }).unwrap());
    let [clip] = list(&file.json, "animations") else { panic!("one animation") };
    let nodes = list(&file.json, "nodes");
    let named = |node: &Value, part: &str| node["name"].as_str().unwrap().contains(part);
    let hulls = nodes.iter().filter(|node| named(node, "-hull")).count();
    assert!(hulls > 8, "{hulls} boats");
    let channels = list(clip, "channels");
    assert_eq!(channels.len(), 2 * hulls);
    for channel in channels {
        assert!(named(&nodes[number(&channel["target"]["node"])], "-hull"));
        let sampler = &list(clip, "samplers")[number(&channel["sampler"])];
        let times = file.floats(&sampler["input"]);
        assert!(times.is_sorted() && times[0] == 0.0 && times.last() == Some(&12.0));
        let values = file.floats(&sampler["output"]);
        let width = values.len() / times.len();
        assert_eq!(values[..width], values[values.len() - width..], "it ends as it begins");
        for value in values.chunks_exact(width) {
            if width == 3 {
                assert!(value.iter().all(|metres| metres.abs() < 0.1), "{value:?}");
            } else {
                let square: f32 = value.iter().map(|part| part * part).sum();
                assert!((square - 1.0).abs() < 1e-6 && value[3] > 0.999, "{value:?}");
            }
        }
    }
}

#[test]
fn the_open_sea_surrounds_the_tiles_to_the_horizon() {
    let town = |extras| parse(&generate(&TownOptions { blocks: 2, seed: 1, extras }).unwrap());
    let sea = TownExtras { has_open_sea: true, ..TownExtras::default() };
    let (with, without) = (town(sea), town(TownExtras::default()));
    assert!(list(&without.json, "meshes").iter().all(|mesh| mesh["name"] != "water-open"));
    let mut meshes = list(&with.json, "meshes").iter();
    let open = meshes.find(|mesh| mesh["name"] == "water-open").unwrap();
    let primitive = &open["primitives"][0];
    let points = with.floats(&primitive["attributes"]["POSITION"]);
    for axis in [0, 2] {
        let lines = || points.iter().skip(axis).step_by(3).copied();
        assert_eq!(lines().fold(f32::INFINITY, f32::min), -16384.0);
        assert_eq!(lines().fold(f32::NEG_INFINITY, f32::max), 16384.0);
    }
    // All but the middle of 7 by 7 cells, which faces up.
    assert_eq!(with.indices(&primitive["indices"]).len(), 48 * 6);
    for face in with.indices(&primitive["indices"]).chunks_exact(3) {
        let [a, b, c] =
            [face[0], face[1], face[2]].map(|at| glam::Vec3::from_slice(&points[at * 3..]));
        assert!((b - a).cross(c - a).y > 0.0, "{a} {b} {c}");
    }
}

#[test]
fn lamps_burn_along_the_quay_at_dusk_only() {
    let lamps = |extras| {
        let file = parse(&generate(&TownOptions { blocks: 3, seed: 1, extras }).unwrap());
        let is_lamp = |node: &&Value| node["name"].as_str().unwrap().starts_with("quay-lamp");
        list(&file.json, "nodes").iter().filter(is_lamp).count()
    };
    let dusk = TownExtras { is_dusk: true, ..TownExtras::default() };
    assert_eq!((lamps(dusk), lamps(TownExtras::default())), (6, 0));
}

#[test]
fn other_seed_gives_another_town() {
    assert!(town(1, 1) != town(1, 2));
}

#[test]
fn four_blocks_draw_about_a_hundred_thousand_triangles() {
    for seed in 1..=4 {
        let triangles = parse(&town(4, seed)).triangles();
        assert!((80_000..=120_000).contains(&triangles), "seed {seed}: {triangles}");
    }
}

#[test]
fn four_blocks_take_few_megabytes() {
    assert!(town(4, 1).len() <= 6 << 20);
}

#[test]
fn every_index_names_a_vertex() {
    let file = parse(&town(2, 7));
    for primitive in file.primitives() {
        let vertices = file.floats(&primitive["attributes"]["POSITION"]).len() / 3;
        let indices = file.indices(&primitive["indices"]);
        assert!(!indices.is_empty() && indices.len().is_multiple_of(3));
        assert!(indices.into_iter().all(|index| index < vertices));
    }
}

#[test]
fn every_triangle_has_area_and_faces_as_its_normals() {
    let file = parse(&town(2, 7));
    let masked = 10;
    for primitive in file.primitives() {
        let read = |name: &str| -> Vec<glam::Vec3> {
            let floats = file.floats(&primitive["attributes"][name]);
            floats.chunks_exact(3).map(glam::Vec3::from_slice).collect()
        };
        let (positions, normals) = (read("POSITION"), read("NORMAL"));
        for face in file.indices(&primitive["indices"]).chunks_exact(3) {
            let [a, b, c] = [face[0], face[1], face[2]].map(|n| positions[n]);
            let area = (b - a).cross(c - a);
            assert!(area.length() > 1e-6, "no area: {a} {b} {c}");
            // Leaf cards are lit as the crown that they are part of.
            if primitive["material"] != masked {
                let normal = normals[face[0]] + normals[face[1]] + normals[face[2]];
                assert!(area.dot(normal) > 0.0, "inside out: {a} {b} {c} {normal} {primitive}");
            }
        }
    }
}

#[test]
fn every_number_is_finite_and_every_normal_a_unit() {
    let file = parse(&town(2, 7));
    for primitive in file.primitives() {
        for (name, accessor) in primitive["attributes"].as_object().unwrap() {
            if name == "COLOR_0" {
                continue;
            }
            let floats = file.floats(accessor);
            assert!(floats.iter().all(|value| value.is_finite()), "{name}");
            if name == "NORMAL" {
                for n in floats.chunks_exact(3) {
                    let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
                    assert!((length - 1.0).abs() < 1e-4, "{n:?}");
                }
            }
        }
    }
}

#[test]
fn bounds_are_those_of_the_positions() {
    let file = parse(&town(1, 3));
    for primitive in file.primitives() {
        let accessor = &primitive["attributes"]["POSITION"];
        let floats = file.floats(accessor);
        let accessor = &file.json["accessors"][number(accessor)];
        for axis in 0..3 {
            let values = || floats.iter().skip(axis).step_by(3).copied();
            let least = values().fold(f32::INFINITY, f32::min);
            let most = values().fold(f32::NEG_INFINITY, f32::max);
            assert_eq!(accessor["min"][axis], f64::from(least));
            assert_eq!(accessor["max"][axis], f64::from(most));
            assert!((most - least) * 0.5 <= 50.0, "larger than 50 m: {primitive}");
        }
    }
}

#[test]
fn names_of_nodes_are_unique() {
    let file = parse(&town(3, 1));
    let mut seen = BTreeMap::new();
    for node in list(&file.json, "nodes") {
        *seen.entry(node["name"].as_str().unwrap()).or_insert(0) += 1;
    }
    let twice: Vec<_> = seen.iter().filter(|(_, count)| **count > 1).collect();
    assert!(twice.is_empty(), "{twice:?}");
}

#[test]
fn lamps_are_at_most_four_a_block() {
    let file = parse(&town(3, 1));
    let lights = |node: &&Value| node["extensions"].get("KHR_lights_punctual").is_some();
    let lit = list(&file.json, "nodes").iter().filter(lights).count();
    assert!((2..=3 * 3 * 4 + 1).contains(&lit), "{lit}");
}

#[test]
fn impossible_sizes_are_refused() {
    for blocks in [0, 129] {
        let refused = generate(&TownOptions { blocks, seed: 1, extras: ALL });
        assert!(matches!(refused, Err(TownError::Blocks { .. })));
        let said = refused.unwrap_err().to_string();
        assert!(said.contains("1 to 128"), "{said}");
    }
}

/// The reader that the baker uses accepts the file.
#[test]
fn the_gltf_crate_reads_it() {
    let bytes = town(2, 1);
    let file = gltf::Gltf::from_slice_without_validation(&bytes).unwrap();
    assert_eq!(file.materials().len(), 14);
    assert!(file.blob.is_some());
}
