//! Levels of detail in blobs: of meshes with several primitives, and of the assets that may lie
//! beside.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use polyptych_scene::meshlet::{self, Meshlet};
use polyptych_scene::{IndexFormat, Mesh, Primitive, Topology};
use serde_json::{Value, json};

use super::builder::Builder;
use super::compressed::draco_stream_of;
use super::{BakeFixture, bake_builder};
use crate::levels::tests::distance::sampled;

/// Triangles from which samples are taken, of one primitive at one error.
const SAMPLED_TRIANGLES: usize = 300;

/// The levels of a primitive, as its blob has them.
struct BlobLevels {
    positions: Vec<DVec3>,
    indices: Vec<u32>,
    meshlets: Vec<Meshlet>,
}

impl BlobLevels {
    fn read(place: &BakeFixture, primitive: &Primitive) -> Self {
        let bytes = place.store.blobs().read(primitive.blob).expect("read").expect("there");
        assert_eq!(bytes.len() as u64, primitive.bytes());
        let (geometry, records) = bytes.split_at(primitive.first_meshlet_byte() as usize);
        let (vertices, indices) = geometry.split_at(primitive.vertex_bytes() as usize);
        let position = |row: &[u8]| {
            let float =
                |at: usize| f32::from_le_bytes(row[at..at + 4].try_into().expect("4 bytes"));
            DVec3::new(float(0).into(), float(4).into(), float(8).into())
        };
        let count = primitive.index_count_of_all() as usize;
        let indices: Vec<u32> = match primitive.index_format {
            IndexFormat::U16 => {
                let words = indices.as_chunks::<2>().0.iter();
                words.map(|word| u16::from_le_bytes(*word).into()).take(count).collect()
            }
            IndexFormat::U32 => {
                let words = indices.as_chunks::<4>().0.iter();
                words.map(|word| u32::from_le_bytes(*word)).take(count).collect()
            }
        };
        let records = records.as_chunks::<{ Meshlet::BYTES }>().0.iter();
        let mut meshlets: Vec<Meshlet> = records.map(Meshlet::from_bytes).collect();
        assert_eq!(meshlets.len(), primitive.meshlet_count as usize);
        check_order(primitive, &meshlets, &indices);
        let given: BTreeSet<u32> = meshlets.iter().map(|meshlet| meshlet.first_index).collect();
        let places = meshlet::put_in_draw_order(&mut meshlets);
        assert!(meshlets.iter().map(|meshlet| meshlet.first_index).eq(given));
        let in_blob = |(of, at): (&Meshlet, &u64)| {
            indices[*at as usize..*at as usize + of.index_count as usize].to_vec()
        };
        let drawn = || meshlets.iter().zip(&places).flat_map(in_blob);
        let indices = if meshlets.is_empty() { indices } else { drawn().collect() };
        assert_eq!(meshlet::fault(&meshlets, primitive.index_count, count as u32), None);
        let rows = vertices.chunks_exact(primitive.layout.stride() as usize);
        Self { positions: rows.map(position).collect(), indices, meshlets }
    }

    /// The triangles at an allowed error.
    fn drawn(&self, limit: f32) -> Vec<[DVec3; 3]> {
        let is_drawn = |meshlet: &&Meshlet| meshlet.error <= limit && meshlet.coarser_error > limit;
        let drawn = self.meshlets.iter().filter(is_drawn);
        let ranges = drawn.map(|meshlet| {
            let first = meshlet.first_index as usize;
            first..first + meshlet.index_count as usize
        });
        // What has no meshlets is drawn whole.
        let whole = self.meshlets.is_empty().then_some(0..self.indices.len());
        let runs = ranges.chain(whole).flat_map(|range| self.indices[range].as_chunks::<3>().0);
        runs.map(|corners| corners.map(|vertex| self.positions[vertex as usize])).collect()
    }

    /// The triangles of a cut.
    fn cut_at(&self, primitive: &Primitive, level: u32) -> Vec<[DVec3; 3]> {
        let cut = primitive.cut_at(level);
        // Those that nothing replaces up to the level, by the rule that cuts are made by.
        let replaced = |of: &Meshlet| {
            let by = self.meshlets.iter().filter(|other| {
                other.level > of.level
                    && (other.error, other.sphere) == (of.coarser_error, of.coarser_sphere)
            });
            by.map(|other| other.level).min().is_some_and(|by| by <= level)
        };
        let drawn = self.meshlets.iter().filter(|of| of.level <= level && !replaced(of));
        let ranges =
            drawn.map(|of| of.first_index as usize..(of.first_index + of.index_count) as usize);
        let runs = ranges.flat_map(|range| self.indices[range].as_chunks::<3>().0);
        let triangles: Vec<[DVec3; 3]> =
            runs.map(|corners| corners.map(|vertex| self.positions[vertex as usize])).collect();
        assert_eq!(triangles.len() as u32 * 3, cut.index_count);
        triangles
    }

    /// Finite errors at which something is replaced, in ascending order.
    fn errors(&self) -> Vec<f32> {
        let errors = self.meshlets.iter().map(|meshlet| meshlet.coarser_error);
        let mut errors: Vec<f32> = errors.filter(|error| error.is_finite()).collect();
        errors.sort_by(f32::total_cmp);
        errors.dedup();
        errors
    }
}

/// Checks the cuts of a primitive against its blob: each names the vertices that it has, and is one
/// whole surface.
fn check_order(primitive: &Primitive, meshlets: &[Meshlet], indices: &[u32]) {
    for cut in &primitive.cuts {
        let held = &meshlets[..cut.meshlet_count as usize];
        let surface = || held.iter().filter(|of| of.level <= cut.level);
        assert_eq!(cut.index_count, surface().map(|of| of.index_count).sum::<u32>());
        assert_eq!(
            cut.index_count_of_all() as u32,
            held.iter().map(|of| of.index_count).sum::<u32>()
        );
        let error = surface().map(|of| of.error).fold(0.0, f32::max);
        assert!(cut.error >= error, "{cut:?}");
        let named = indices[..cut.index_count_of_all() as usize].iter().max();
        assert_eq!(named.map(|last| last + 1), Some(cut.vertex_count));
    }
}

/// A mesh of two primitives, the halves of one bumpy sheet.
fn halves() -> Builder {
    let mut builder = Builder::empty();
    let side = 41_u32;
    let at = |column: u32, row: u32| {
        let height = f64::from((column * 7919 + row * 104_729) % 31) / 100.0;
        [column as f32, row as f32, height as f32]
    };
    let positions: Vec<f32> = (0..side * side).flat_map(|i| at(i % side, i / side)).collect();
    let half = |columns: std::ops::Range<u32>| -> Vec<u32> {
        let cells = (0..side - 1).flat_map(|row| columns.clone().map(move |column| (column, row)));
        let corners = cells.flat_map(|(column, row)| {
            let first = row * side + column;
            [first, first + 1, first + side, first + 1, first + side + 1, first + side]
        });
        corners.collect()
    };
    let positions = builder.floats("VEC3", &positions);
    let normals = builder.floats("VEC3", &[0.0, 0.0, 1.0].repeat((side * side) as usize));
    let primitives = [half(0..20), half(20..40)].map(|half| {
        let indices = builder.indices(&half);
        let attributes = json!({ "POSITION": positions, "NORMAL": normals });
        json!({ "attributes": attributes, "indices": indices })
    });
    builder.mesh(&primitives[0]);
    builder.json["meshes"][0]["primitives"] = json!(primitives);
    builder
}

#[test]
fn cuts_are_whole_surfaces_that_meet_between_primitives() {
    let (place, _, scene) = bake_builder(&halves());
    let primitives = &scene.meshes[0].primitives;
    let cuts = &primitives[0].cuts;
    assert!(cuts.len() > 1 && cuts.last().expect("one").error > 0.0, "{cuts:?}");
    for cut in cuts {
        let mut edges: BTreeMap<[[u64; 3]; 2], u32> = BTreeMap::new();
        for primitive in primitives {
            assert!(primitive.limited_to(&primitive.cut_at(cut.level)).bytes() < primitive.bytes());
            for [a, b, c] in BlobLevels::read(&place, primitive).cut_at(primitive, cut.level) {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    let mut edge = [from, to].map(|at| at.to_array().map(f64::to_bits));
                    edge.sort_unstable();
                    *edges.entry(edge).or_default() += 1;
                }
            }
        }
        // A corner of the sheet may be cut off.
        let is_outside = |at: &[u64; 3]| {
            let [x, y, _] = at.map(f64::from_bits);
            [x, y].into_iter().any(|along| along == 0.0 || along == 40.0)
        };
        let is_border = |edge: &[[u64; 3]; 2]| edge.iter().all(is_outside);
        let open = edges.iter().filter(|(edge, count)| **count == 1 && !is_border(edge)).count();
        assert_eq!(open, 0, "edges without a neighbour at level {}", cut.level);
    }
}

/// The points of triangles where the halves of the sheet meet.
fn seam(triangles: &[[DVec3; 3]]) -> BTreeSet<[u64; 3]> {
    let points = triangles.iter().flatten().filter(|point| point.x == 20.0);
    points.map(|point| point.to_array().map(f64::to_bits)).collect()
}

#[test]
fn primitives_of_a_mesh_meet_at_every_level() {
    let (place, baked, scene) = bake_builder(&halves());
    assert!(baked.levels.len() > 3, "{:?}", baked.levels);
    let [one, two] = [0, 1].map(|at| BlobLevels::read(&place, &scene.meshes[0].primitives[at]));
    let finest = seam(&one.drawn(0.0));
    assert_eq!(finest.len(), 41);
    let mut errors = [one.errors(), two.errors()].concat();
    errors.sort_by(f32::total_cmp);
    let mut fewest = finest.len();
    for limit in errors {
        let [left, right] = [one.drawn(limit), two.drawn(limit)];
        // A half that is as small as the error is gone.
        if !left.is_empty() && !right.is_empty() {
            assert_eq!(seam(&left), seam(&right), "at {limit}");
            fewest = fewest.min(seam(&left).len());
        }
    }
    assert!(fewest < 10, "{fewest} of 41 points of the border are left");
}

/// Two meshes on two nodes, whose grounds meet where x is 20 in the world.
fn tiles() -> Builder {
    let mut builder = Builder::empty();
    let side = 21_u32;
    for (number, first) in [0_u32, 20].into_iter().enumerate() {
        let at = |column: u32, row: u32| {
            let seed = (column + first) * 7919 + row * 104_729;
            [column as f32, row as f32, f64::from(seed % 31) as f32 / 100.0]
        };
        let positions: Vec<f32> = (0..side * side).flat_map(|i| at(i % side, i / side)).collect();
        let cells = (0..20 * 20).map(|i| i / 20 * side + i % 20);
        let corners =
            cells.flat_map(|at| [at, at + 1, at + side, at + 1, at + side + 1, at + side]);
        let indices = builder.indices(&corners.collect::<Vec<u32>>());
        let positions = builder.floats("VEC3", &positions);
        let normals = builder.floats("VEC3", &[0.0, 0.0, 1.0].repeat((side * side) as usize));
        let attributes = json!({ "POSITION": positions, "NORMAL": normals });
        builder.mesh(&json!({ "attributes": attributes, "indices": indices }));
        builder.json["nodes"][number]["translation"] = json!([first, 0, 0]);
    }
    builder
}

/// The tiles, far from the origin and from another ground.
fn far_tiles() -> Builder {
    let mut builder = tiles();
    builder.mesh(&builder.json["meshes"][0]["primitives"][0].clone());
    for (number, x) in [6_400_000, 6_400_020].into_iter().enumerate() {
        builder.json["nodes"][number]["translation"] = json!([x, 0, 0]);
    }
    builder
}

#[test]
fn tiles_of_a_ground_meet_at_every_level() {
    check_tiles(&tiles());
}

#[test]
fn tiles_far_from_another_ground_keep_only_the_border_where_they_meet() {
    check_tiles(&far_tiles());
}

fn check_tiles(tiles: &Builder) {
    let (place, _, scene) = bake_builder(tiles);
    let [one, two] = [0, 1].map(|at| BlobLevels::read(&place, &scene.meshes[at].primitives[0]));
    let border = |triangles: &[[DVec3; 3]], x: f64| -> BTreeSet<[u64; 2]> {
        let points = triangles.iter().flatten().filter(|point| point.x == x);
        points.map(|point| [point.y.to_bits(), point.z.to_bits()]).collect()
    };
    let errors = [one.errors(), two.errors()].concat();
    assert!(errors.len() > 6, "{errors:?}");
    for limit in errors {
        let [left, right] = [one.drawn(limit), two.drawn(limit)];
        assert_eq!(border(&left, 20.0), border(&right, 0.0), "at {limit}");
        assert_eq!(border(&left, 20.0).len(), 21, "at {limit}");
    }
    // A border that nothing meets is simplified like the rest.
    let coarsest = one.drawn(*one.errors().last().expect("an error"));
    assert!(border(&coarsest, 0.0).len() < 10, "{}", border(&coarsest, 0.0).len());
}

/// The bytes of an accessor of words, which has none from then on.
fn take_words(builder: &mut Builder, accessor: &Value) -> Vec<[u8; 4]> {
    let number = |value: &Value| value.as_u64().expect("a number") as usize;
    let json = builder.json["accessors"][number(accessor)].as_object_mut().expect("an object");
    let view = json.remove("bufferView").expect("a view");
    let view = &builder.json["bufferViews"][number(&view)];
    let [start, count] = ["byteOffset", "byteLength"].map(|key| number(&view[key]));
    builder.bin[start..start + count].as_chunks::<4>().0.to_vec()
}

/// The tiles, each packed by Draco on a grid of its own: the second one is wider.
fn packed_tiles() -> Builder {
    let mut builder = tiles();
    for (number, width) in [1.0, 1.25].into_iter().enumerate() {
        let part = builder.json["meshes"][number]["primitives"][0].clone();
        let words = take_words(&mut builder, &part["attributes"]["POSITION"]);
        let floats: Vec<f32> = words.into_iter().map(f32::from_le_bytes).collect();
        let place = |&[x, y, z]: &[f32; 3]| [x * width, y, z];
        let positions: Vec<[f32; 3]> = floats.as_chunks::<3>().0.iter().map(place).collect();
        let words = take_words(&mut builder, &part["indices"]);
        let indices: Vec<u32> = words.into_iter().map(u32::from_le_bytes).collect();
        // 14 bits are what most writers take.
        let view = builder.view(&draco_stream_of(&positions, &indices, (0, 14)), None);
        builder.json["meshes"][number]["primitives"][0]["extensions"] = json!({
            "KHR_draco_mesh_compression": { "bufferView": view, "attributes": { "POSITION": 0 } }
        });
    }
    builder.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    builder
}

#[test]
fn tiles_that_draco_has_rounded_keep_the_border_where_they_meet() {
    let (place, baked, scene) = bake_builder(&packed_tiles());
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let [one, two] = [0, 1].map(|at| BlobLevels::read(&place, &scene.meshes[at].primitives[0]));
    // Half a step of each grid, 20 and 25 m of 14 bits, and what f32 rounds.
    let near = 22.5 / 16_383.0 + 1e-5;
    let border = |triangles: &[[DVec3; 3]], x: f64| -> BTreeMap<i64, f64> {
        let points = triangles.iter().flatten().filter(|point| (point.x - x).abs() < near);
        let row = |point: &DVec3| {
            assert!((point.y - point.y.round()).abs() < near, "{point}");
            (point.y.round() as i64, point.z)
        };
        points.map(row).collect()
    };
    let errors = [one.errors(), two.errors()].concat();
    assert!(errors.len() > 6, "{errors:?}");
    for limit in errors {
        let [left, right] = [border(&one.drawn(limit), 20.0), border(&two.drawn(limit), 0.0)];
        assert!(left.keys().copied().eq(0..=20), "{left:?} at {limit}");
        assert!(right.keys().copied().eq(0..=20), "{right:?} at {limit}");
        let mut heights = left.values().zip(right.values());
        assert!(heights.all(|(one, two)| (one - two).abs() < near), "{left:?} {right:?}");
    }
    // A border that nothing meets is simplified like the rest.
    let coarsest = one.drawn(*one.errors().last().expect("an error"));
    assert!(border(&coarsest, 0.0).len() < 10, "{:?}", border(&coarsest, 0.0));
}

#[test]
fn a_road_that_is_one_quad_wide_meets_its_ground_at_every_level() {
    let mut builder = tiles();
    let (rows, x) = (21_u32, 20.0);
    let height = |row: u32| f64::from((20 * 7919 + row * 104_729) % 31) as f32 / 100.0;
    // Its one side is the border of the first ground, node 0.
    let at = |i: u32| [x + (i / rows) as f32, (i % rows) as f32, height(i % rows)];
    let positions: Vec<f32> = (0..2 * rows).flat_map(at).collect();
    let quads = (0..rows - 1).flat_map(|i| [i, i + rows, i + 1, i + 1, i + rows, i + rows + 1]);
    let indices = builder.indices(&quads.collect::<Vec<u32>>());
    let positions = builder.floats("VEC3", &positions);
    builder.json["meshes"][1]["primitives"] =
        json!([{ "attributes": { "POSITION": positions }, "indices": indices }]);
    builder.json["nodes"][1]["translation"] = json!([0, 0, 0]);
    let (place, _, scene) = bake_builder(&builder);
    let ground = BlobLevels::read(&place, &scene.meshes[0].primitives[0]);
    let coarsest = ground.drawn(*ground.errors().last().expect("an error"));
    let points = coarsest.iter().flatten().filter(|point| point.x == 20.0);
    let kept: BTreeSet<[u64; 2]> =
        points.map(|point| [point.y.to_bits(), point.z.to_bits()]).collect();
    assert_eq!(kept.len(), 21);
}

#[test]
fn blended_primitives_keep_their_order() {
    let mut builder = halves();
    builder.json["materials"] = json!([{ "alphaMode": "BLEND" }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.json["meshes"][0]["primitives"].as_array_mut().expect("a list").pop();
    let (place, _, scene) = bake_builder(&builder);
    let blended = BlobLevels::read(&place, &scene.meshes[0].primitives[0]);
    assert!(blended.meshlets.iter().any(|meshlet| meshlet.error > 0.0));
    // Vertices are numbered by their first use, so the order is that of the source's places.
    let drawn = blended.drawn(0.0);
    let expected = (0..1600).map(|at| ((at / 2 % 20) as f64, (at / 40) as f64));
    for (triangle, (column, row)) in drawn.iter().zip(expected) {
        let least = triangle.iter().fold(DVec3::INFINITY, |low, point| low.min(*point));
        assert_eq!((least.x, least.y), (column, row));
    }
}

/// The pieces of a large blended primitive have levels too, each its own.
#[test]
fn blended_primitives_of_a_mesh_meet_at_every_level() {
    let mut builder = halves();
    builder.json["materials"] = json!([{ "alphaMode": "BLEND" }]);
    for half in 0..2_usize {
        builder.json["meshes"][0]["primitives"][half]["material"] = json!(0);
    }
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.levels.len() > 1, "{:?}", baked.levels);
    let [one, two] = [0, 1].map(|at| BlobLevels::read(&place, &scene.meshes[0].primitives[at]));
    assert!(!one.errors().is_empty() && !two.errors().is_empty(), "both have coarser levels");
    for limit in [one.errors(), two.errors()].concat() {
        let [left, right] = [one.drawn(limit), two.drawn(limit)];
        assert!(left.len() + right.len() < 3200, "{} and {}", left.len(), right.len());
        assert_eq!(seam(&left), seam(&right), "at {limit}");
        assert_eq!(seam(&left).len(), 41, "at {limit}");
    }
}

fn assets() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/assets");
    let (mut files, mut folders) = (Vec::new(), vec![root]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "glb" || end == "gltf") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// Takes the mesh with the largest primitive of each file, at three errors.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn stated_errors_hold_on_assets() {
    let place = BakeFixture::new();
    let mut checked = 0;
    for file in assets() {
        // Files that are broken on purpose are other tests' matter.
        let Ok(baked) = place.bake(&file) else { continue };
        let scene = place.scene(&baked);
        let largest = |mesh: &&Mesh| {
            let with_levels = mesh.primitives.iter().filter(|of| of.coarser_index_count > 0);
            with_levels.map(|primitive| primitive.index_count).max()
        };
        let meshes = scene.meshes.iter().filter(|mesh| largest(mesh).is_some());
        let Some(mesh) = meshes.max_by_key(largest) else { continue };
        // Surfaces that are removed as a whole are near those that are left.
        let surfaces = mesh.primitives.iter().filter(|of| of.topology == Topology::Triangles);
        let levels: Vec<_> = surfaces.map(|of| BlobLevels::read(&place, of)).collect();
        let drawn = |limit| levels.iter().flat_map(|of| of.drawn(limit)).collect::<Vec<_>>();
        let mut errors: Vec<f32> = levels.iter().flat_map(BlobLevels::errors).collect();
        errors.sort_by(f32::total_cmp);
        let finest = drawn(0.0);
        for limit in [0, errors.len() / 2, errors.len() - 1].map(|at| errors[at]) {
            let coarser = drawn(limit);
            let every = |of: &[[DVec3; 3]]| of.len().div_ceil(SAMPLED_TRIANGLES);
            let some =
                |of: &[[DVec3; 3]]| -> Vec<_> { of.iter().step_by(every(of)).copied().collect() };
            let there = sampled(&some(&finest), &coarser, 2);
            let back = sampled(&some(&coarser), &finest, 2);
            let found = there.max(back);
            assert!(found <= f64::from(limit), "{}: {found} > {limit}", file.display());
        }
        checked += 1;
    }
    println!("{checked} assets have levels");
    assert!(checked >= 20, "only {checked} assets have levels");
}
