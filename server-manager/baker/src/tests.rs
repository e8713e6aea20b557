//! Whole bakes: of scenes made in code, of broken ones, and of the assets that may lie beside.

mod animation;
mod animation_pointer;
mod baked_light;
mod broken;
mod buffers;
pub(crate) mod builder;
mod compressed;
mod exposure;
mod extras;
mod image_based_light;
mod image_formats;
mod levels;
mod lods;
mod materials;
mod missing;
mod numbers;
mod pose;
mod scene_choice;
mod variants;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use builder::{Builder, png};
use glam::{DVec3, Vec3};
use polyptych_scene::{IndexFormat, LightKind, Scene};
use serde_json::json;

use super::{BakeCache, BakeError, Baked, Progress, bake, bake_added, bake_scene};

/// A folder with a scene and a store.
struct BakeFixture {
    folder: tempfile::TempDir,
    store: BakeCache,
}

impl BakeFixture {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = BakeCache::open(folder.path().join("store")).expect("a store");
        Self { folder, store }
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(&path, bytes).expect("written");
        path
    }

    fn bake(&self, path: &Path) -> Result<Baked, BakeError> {
        bake(path, &self.store, &mut |_| {}, &AtomicBool::new(false))
    }

    fn scene(&self, baked: &Baked) -> Scene {
        scene_of(&self.store, baked)
    }
}

fn scene_of(store: &BakeCache, baked: &Baked) -> Scene {
    let bytes = store.blobs().read(baked.manifest).expect("read").expect("there");
    let scene: Scene = polyptych_scene::decode(&bytes).expect("a manifest");
    assert_eq!(scene.fault(), None);
    scene
}

fn bake_builder(builder: &Builder) -> (BakeFixture, Baked, Scene) {
    let place = BakeFixture::new();
    let path = place.write("scene.glb", &builder.glb());
    let baked = place.bake(&path).expect("baked");
    let scene = place.scene(&baked);
    (place, baked, scene)
}

/// The floats of a primitive's vertices, a row for each.
fn vertices(place: &BakeFixture, scene: &Scene, mesh: usize, primitive: usize) -> Vec<Vec<f32>> {
    let primitive = &scene.meshes[mesh].primitives[primitive];
    let bytes = place.store.blobs().read(primitive.blob).expect("read").expect("there");
    assert_eq!(bytes.len() as u64, primitive.bytes());
    let float = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let rows =
        bytes[..primitive.vertex_bytes() as usize].chunks(primitive.layout.stride() as usize);
    rows.map(|row| row.chunks(4).map(float).collect()).collect()
}

#[test]
fn far_nodes_keep_their_place() {
    let mut builder = Builder::triangle();
    let far = 1e7 + 0.25;
    builder.json["nodes"][0]["translation"] = json!([far, 0.0, -far]);
    let (_place, _, scene) = bake_builder(&builder);
    assert_eq!(scene.nodes[0].local.translation, DVec3::new(far, 0.0, -far));
    let bounds = scene.bounds.expect("bounds");
    assert_eq!(bounds.min, DVec3::new(far, 0.0, -far));
    assert_eq!(bounds.max, DVec3::new(far + 1.0, 1.0, -far));
}

#[test]
fn overviews_leave_out_a_ground_that_is_far_larger_than_all_else() {
    let mut builder = Builder::triangle();
    let ground = [-40.0, 0.0, -40.0, 0.0, 0.0, 40.0, 40.0, 0.0, -40.0];
    let positions = builder.floats("VEC3", &ground);
    builder.mesh(&json!({ "attributes": { "POSITION": positions } }));
    builder.json["nodes"][1]["name"] = json!("ground");
    let (_place, baked, scene) = bake_builder(&builder);
    let bounds = scene.bounds.expect("bounds");
    assert_eq!((bounds.min, bounds.max), (DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0)));
    assert_eq!(baked.warnings, ["the overview leaves out 'ground': 80 times as long as all else"]);

    // In pieces, as everything that is so large.
    let mut positions: Vec<f32> = Vec::new();
    for (row, column) in (0..9).flat_map(|row| (0..9).map(move |column| (row, column))) {
        positions.extend([column as f32 * 1e3 - 4e3, 0.0, row as f32 * 1e3 - 4e3]);
    }
    let mut corners = Vec::new();
    for (row, column) in (0..8).flat_map(|row| (0..8).map(move |column| (row, column))) {
        let at = row * 9 + column;
        corners.extend([at, at + 9, at + 1, at + 1, at + 9, at + 10]);
    }
    let mut sea = Builder::triangle();
    let [positions, corners] = [sea.floats("VEC3", &positions), sea.indices(&corners)];
    sea.mesh(&json!({ "attributes": { "POSITION": positions }, "indices": corners }));
    let (_place, _, scene) = bake_builder(&sea);
    assert!(scene.meshes.iter().any(|mesh| mesh.primitives.len() > 1));
    assert_eq!(scene.bounds.map(|of| of.max), Some(DVec3::new(1.0, 1.0, 0.0)));

    // Not far larger.
    builder.json["nodes"][1]["scale"] = json!([0.1, 0.1, 0.1]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(scene.bounds.map(|of| of.min), Some(DVec3::new(-4.0, 0.0, -4.0)));
    assert!(baked.warnings.is_empty());
}

#[test]
fn missing_normals_are_flat_and_shared_vertices_part() {
    let mut builder = Builder::empty();
    // Two triangles of a tent, over one ridge.
    let ridge = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]];
    let positions = builder.floats("VEC3", ridge.as_flattened());
    let indices = builder.indices(&[0, 1, 2, 1, 0, 3]);
    builder.mesh(&json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    let (place, baked, scene) = bake_builder(&builder);
    assert_eq!((baked.triangles, scene.meshes[0].primitives[0].vertex_count), (2, 6));
    for vertex in vertices(&place, &scene, 0, 0) {
        let normal = Vec3::new(vertex[3], vertex[4], vertex[5]);
        assert!((normal.length() - 1.0).abs() < 1e-6 && normal.y > 0.7, "{normal}");
    }
}

#[test]
fn normal_maps_get_tangents() {
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([{ "normalTexture": { "index": 0 } }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.image(&png(4, 4, |_, _| [128, 128, 255, 255]));
    let (place, _, scene) = bake_builder(&builder);
    let layout = scene.meshes[0].primitives[0].layout;
    assert!(layout.tangent && layout.uv0 && !layout.uv1 && !layout.color);
    let rows = vertices(&place, &scene, 0, 0);
    assert_eq!(rows.len(), 4, "corners that agree are one vertex");
    for row in rows {
        // u goes along +x and v down, so the bitangent goes up with the picture: w is +1.
        assert_eq!(row[6..10], [1.0, 0.0, 0.0, 1.0]);
    }
}

/// FlightHelmet brings tangents; without them, ours must agree with its author's.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn tangents_agree_with_an_authored_asset() {
    let asset =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/assets/FlightHelmet.glb");
    let mut bytes = fs::read(asset).expect("an asset");
    let place = BakeFixture::new();
    let rows_of = |bytes: &[u8]| {
        let baked = place.bake(&place.write("helmet.glb", bytes)).expect("baked");
        let scene = place.scene(&baked);
        let meshes = 0..scene.meshes.len();
        meshes.flat_map(|mesh| vertices(&place, &scene, mesh, 0)).collect::<Vec<_>>()
    };
    let authored = rows_of(&bytes);
    while let Some(at) = bytes.windows(9).position(|window| window == b"\"TANGENT\"") {
        bytes[at + 1] = b'_';
    }
    let key =
        |row: &[f32]| [&row[..6], &row[10..12]].concat().iter().map(|f| f.to_bits()).collect();
    let made: std::collections::HashMap<Vec<u32>, Vec<f32>> =
        rows_of(&bytes).into_iter().map(|row| (key(&row), row)).collect();
    let agrees = |row: &&Vec<f32>| {
        made.get::<Vec<u32>>(&key(row)).is_some_and(|made| {
            let dot: f32 = (6..9).map(|i| row[i] * made[i]).sum();
            dot > 0.9 && row[9] == made[9]
        })
    };
    let share = authored.iter().filter(agrees).count() as f64 / authored.len() as f64;
    assert!(share > 0.95, "{share} of the tangents agree");
}

#[test]
fn broken_normals_and_uvs_are_mended() {
    let mut builder = Builder::quad();
    let normals = builder.floats("VEC3", &[f32::NAN; 12]);
    let uvs = builder.floats("VEC2", &[f32::INFINITY; 8]);
    let attributes = &mut builder.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["NORMAL"] = json!(normals);
    attributes["TEXCOORD_0"] = json!(uvs);
    builder.json["materials"] =
        json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.image(&png(1, 1, |_, _| [1, 2, 3, 255]));
    let (place, _, scene) = bake_builder(&builder);
    for row in vertices(&place, &scene, 0, 0) {
        assert_eq!(row[3..8], [0.0, 0.0, 1.0, 0.0, 0.0]);
    }
}

#[test]
fn equal_primitives_share_a_blob() {
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([{}, { "doubleSided": true }]);
    let mut primitive = builder.json["meshes"][0]["primitives"][0].clone();
    primitive["material"] = json!(1);
    builder.json["meshes"][0]["primitives"] = json!([primitive.clone(), primitive.clone()]);
    primitive["material"] = json!(0);
    builder.mesh(&primitive);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!((scene.meshes.len(), scene.materials.len()), (2, 2));
    let first = scene.meshes[0].primitives[0].blob;
    assert!(scene.blobs().all(|blob| blob == first));
    assert!(baked.bytes < 1000, "{}", baked.bytes);
}

#[test]
fn large_meshes_are_split_and_keep_their_vertices() {
    let side = 100u32;
    let mut builder = Builder::empty();
    let at = |i: u32| [(i % (side + 1)) as f32 * 20.0, 0.0, (i / (side + 1)) as f32 * 20.0];
    let positions: Vec<[f32; 3]> = (0..(side + 1) * (side + 1)).map(at).collect();
    let positions = builder.floats("VEC3", positions.as_flattened());
    let normals = vec![[0.0f32, 1.0, 0.0]; ((side + 1) * (side + 1)) as usize];
    let normals = builder.floats("VEC3", normals.as_flattened());
    let quad = |i: u32| {
        let at = i / side * (side + 1) + i % side;
        [at, at + side + 1, at + 1, at + 1, at + side + 1, at + side + 2]
    };
    let indices: Vec<u32> = (0..side * side).flat_map(quad).collect();
    let indices = builder.indices(&indices);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals });
    builder.mesh(&json!({ "attributes": attributes, "indices": indices }));
    let (place, baked, scene) = bake_builder(&builder);
    assert_eq!(baked.triangles, 20_000);
    let pieces = &scene.meshes[0].primitives;
    assert_eq!(pieces.len(), 16, "pieces of about 1,000 triangles");
    for (i, piece) in pieces.iter().enumerate() {
        assert!(piece.triangles() >= 1000 && piece.index_format == IndexFormat::U16);
        assert_eq!(piece.origin, DVec3::ZERO);
        let rows = vertices(&place, &scene, 0, i);
        let is_given = |row: &Vec<f32>| row[0] % 20.0 == 0.0 && row[2] % 20.0 == 0.0;
        assert!(rows.iter().all(is_given), "a vertex was rounded");
        let least = rows.iter().fold(Vec3::MAX, |m, r| m.min(Vec3::new(r[0], r[1], r[2])));
        assert_eq!(least, piece.min);
    }
    let bounds = scene.bounds.expect("bounds");
    assert_eq!((bounds.min, bounds.max), (DVec3::ZERO, DVec3::new(2000.0, 0.0, 2000.0)));

    // The same in millimetres is 2 m wide and stays whole.
    builder.json["nodes"][0]["scale"] = json!([0.001, 0.001, 0.001]);
    let (_place, _, scene) = bake_builder(&builder);
    assert_eq!(scene.meshes[0].primitives.len(), 1);
}

#[test]
fn instances_and_quantised_meshes_are_drawn() {
    let mut builder = Builder::triangle();
    let shorts: Vec<u8> = [0i16, 0, 0, 0, 100, 0, 0, 0, 0, 100, 0, 0]
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let positions = builder.accessor("VEC3", 5122, 3, &shorts, Some(8));
    builder.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(positions);
    let places = builder.floats("VEC3", &[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]);
    builder.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } });
    builder.json["extensionsRequired"] =
        json!(["KHR_mesh_quantization", "EXT_mesh_gpu_instancing"]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!((baked.triangles, scene.nodes[0].instances.len()), (2, 2));
    assert_eq!(scene.bounds.expect("bounds").max, DVec3::new(105.0, 100.0, 0.0));
}

#[test]
fn copies_and_nodes_in_a_row_are_one_crowd_and_what_is_apart_is_none() {
    let mut builder = Builder::quad();
    let places: Vec<f32> = (0..40_u8).flat_map(|at| [f32::from(at), 0.0, 0.0]).collect();
    let places = builder.floats("VEC3", &places);
    let copies = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } });
    builder.json["nodes"] = json!([
        { "mesh": 0, "extensions": copies },
        { "mesh": 0, "translation": [40, 0, 0] },
        { "mesh": 0, "translation": [0, 9, 0] },
    ]);
    builder.json["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
    builder.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    let (_place, _, scene) = bake_builder(&builder);
    // From the middle of the first to the end of 41 units: 40.5, where its own radius is 0.71.
    let [row, end, apart] = [0, 1, 2].map(|at: usize| scene.nodes[at].crowd);
    assert!((57.0..58.0).contains(&row) && (57.0..58.0).contains(&end), "{row}, {end}");
    assert_eq!(apart, 0.0);
}

#[test]
fn each_copy_of_a_node_has_its_own_crowd() {
    let mut builder = Builder::quad();
    // A row of twenty, five that stand alone, and a small one.
    let mut places: Vec<f32> = (0..20_u8).flat_map(|at| [f32::from(at), 0.0, 0.0]).collect();
    places.extend((0..6_u8).flat_map(|at| [f32::from(at) * 10.0, 0.0, 50.0]));
    let mut scales = vec![1.0; places.len()];
    scales[75..].fill(0.001);
    let [places, scales] = [places, scales].map(|of| builder.floats("VEC3", &of));
    builder.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": {
        "attributes": { "TRANSLATION": places, "SCALE": scales }
    } });
    builder.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    let (_place, _, scene) = bake_builder(&builder);
    let node = &scene.nodes[0];
    let crowds: Vec<f32> = node.instances.iter().map(|copy| copy.crowd).collect();
    // From the middle of a mesh whose radius is 0.71 to the end of the row: 10.5 to 19.5 units.
    assert!(crowds[..20].iter().all(|crowd| (14.0..29.0).contains(crowd)), "{crowds:?}");
    assert!(crowds[0] > 1.3 * crowds[10], "it reaches farther from its ends: {crowds:?}");
    assert_eq!(crowds[20..], [0.0; 6]);
    let largest = crowds.iter().copied().fold(0.0, f32::max);
    assert_eq!((node.crowd, node.crowd_of(25), node.crowd_of(26)), (largest, 0.0, largest));
}

#[test]
fn domes_are_skies_and_halls_and_hills_are_none() {
    // An octahedron of eight triangles around a triangle of one metre.
    let is_sky = |scale: f32, height: f32, material: &serde_json::Value| {
        let mut builder = Builder::triangle();
        let mut corners = Vec::new();
        for signs in 0..8_u8 {
            let sign = |axis: u8| if signs >> axis & 1 == 1 { scale } else { -scale };
            corners.extend([sign(0), 0.0, 0.0, 0.0, sign(1) * height, 0.0, 0.0, 0.0, sign(2)]);
        }
        let positions = builder.floats("VEC3", &corners);
        builder.json["materials"] = json!([material]);
        builder.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
        let uvs = builder.floats("VEC2", &[0.0; 48]);
        let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
        builder.mesh(&json!({ "attributes": attributes, "material": 0 }));
        builder.image(b"broken");
        let (_place, _, scene) = bake_builder(&builder);
        assert!(!scene.nodes[0].is_sky, "what is within is no sky");
        // A hidden one is the same, since it may be shown later.
        let hidden = json!({ "KHR_node_visibility": { "visible": false } });
        builder.json["nodes"][1]["extensions"] = hidden;
        let (_place, baked, of_hidden) = bake_builder(&builder);
        assert!(!baked.warnings.iter().any(|note| note.contains("overview")));
        assert_eq!(of_hidden.nodes[1].is_sky, scene.nodes[1].is_sky);
        scene.nodes[1].is_sky
    };
    let (lit, glowing) = (json!({}), json!({ "emissiveFactor": [1, 1, 1] }));
    let unlit = json!({ "extensions": { "KHR_materials_unlit": {} } });
    // Blender exports an emission so; it does not glow where its picture is missing.
    let mut emission = glowing.clone();
    emission["pbrMetallicRoughness"] = json!({ "baseColorFactor": [0, 0, 0, 1] });
    let mut dark = emission.clone();
    dark["emissiveTexture"] = json!({ "index": 0 });
    let materials = [&lit, &glowing, &dark, &emission, &unlit];
    let domes = materials.map(|material| is_sky(200.0, 1.0, material));
    let halls = materials.map(|material| is_sky(20.0, 1.0, material));
    let hills = materials.map(|material| is_sky(200.0, 0.1, material));
    let rooms = materials.map(|material| is_sky(4.0, 1.0, material));
    assert_eq!(domes, [true; 5]);
    assert_eq!(halls, [false, false, false, true, true]);
    assert_eq!(hills, [false, false, false, false, true]);
    assert_eq!(rooms, [false; 5]);
}

#[test]
fn lights_are_brought_into_range() {
    let mut builder = Builder::triangle();
    let lights = json!([
        { "type": "point", "intensity": 5.0 },
        { "type": "spot", "intensity": -1.0, "range": 0.0,
          "spot": { "innerConeAngle": 0.9, "outerConeAngle": 0.5 } },
    ]);
    builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    builder.json["nodes"][0]["extensions"] = json!({ "KHR_lights_punctual": { "light": 1 } });
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!((scene.lights.len(), scene.nodes[0].light, baked.warnings.len()), (1, Some(0), 3));
    let light = &scene.lights[0];
    assert_eq!((light.intensity, light.range), (0.0, None));
    let LightKind::Spot { inner_rad, outer_rad } = light.kind else { panic!("{:?}", light.kind) };
    assert!(0.0 < inner_rad && inner_rad < outer_rad && outer_rad == 0.5);
}

#[test]
fn lights_without_maps_of_shadows_are_noted() {
    let warnings = |count: usize| {
        let mut builder = Builder::triangle();
        let lights = json!([{ "type": "point", "intensity": 5.0 }]);
        builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
        let lamp = json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } });
        let mut nodes = builder.json["nodes"].as_array().cloned().unwrap_or_default();
        let first = nodes.len();
        nodes.extend(std::iter::repeat_n(lamp, count));
        builder.json["scenes"] = json!([{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }]);
        builder.json["scene"] = json!(0);
        builder.json["nodes"] = json!(nodes);
        assert_eq!(first, 1);
        // Besides, it is noted that they shine in real units.
        let mut warnings = bake_builder(&builder).1.warnings;
        warnings.retain(|of| of.starts_with("lights:"));
        warnings
    };
    assert_eq!(warnings(10), [] as [String; 0]);
    let noted = warnings(12);
    assert!(noted.len() == 1 && noted[0].starts_with("lights: 2 of 12 point and"), "{noted:?}");
}

#[test]
fn a_bake_is_reused_until_a_file_changes() {
    let place = BakeFixture::new();
    let mut builder = Builder::quad();
    builder.json["materials"] =
        json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.json["images"] = json!([{ "uri": "a%20b.png" }]);
    builder.json["textures"] = json!([{ "source": 0 }]);
    place.write("a b.png", &png(2, 2, |_, _| [10, 20, 30, 255]));
    let path = place.write("scene.gltf", &builder.gltf("scene.bin"));
    place.write("scene.bin", &builder.bin);
    let first = place.bake(&path).expect("baked");
    let again = place.bake(&path).expect("baked");
    assert!(!first.reused && again.reused);
    assert_eq!(again, Baked { reused: true, ..first.clone() });

    place.write("a b.png", &png(2, 2, |_, _| [10, 20, 31, 255]));
    let changed = place.bake(&path).expect("baked");
    assert!(!changed.reused && changed.manifest != first.manifest);

    let blob = place.scene(&changed).textures[0].blob;
    fs::write(place.store.blobs().path_of(blob), b"cut").expect("written");
    assert!(!place.bake(&path).expect("baked").reused, "a damaged blob is made anew");
    assert!(place.bake(&path).expect("baked").reused);
}

#[test]
fn a_cancelled_bake_leaves_a_store_that_works() {
    let place = BakeFixture::new();
    let path = place.write("scene.glb", &Builder::quad().glb());
    for stage in ["reading", "nodes", "meshes", "levels", "textures", "manifest"] {
        let cancel = AtomicBool::new(false);
        let mut watch = |progress: Progress| {
            cancel.fetch_or(progress.stage == stage, Ordering::Relaxed);
        };
        let result = bake(&path, &place.store, &mut watch, &cancel);
        assert!(matches!(result, Err(BakeError::Cancelled)), "{stage}: {result:?}");
    }
    assert!(!place.bake(&path).expect("baked").reused);
}

#[test]
fn empty_and_absent_scenes_are_fine() {
    let place = BakeFixture::new();
    let text = br#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{}]}"#;
    let baked = place.bake(&place.write("empty.gltf", text)).expect("baked");
    assert_eq!((baked.nodes, place.scene(&baked).bounds), (0, None));
    let text = br#"{"asset":{"version":"2.0"},"nodes":[{"children":[1]},{"name":"leaf"}]}"#;
    let baked = place.bake(&place.write("none.gltf", text)).expect("baked");
    assert_eq!((baked.nodes, baked.warnings.len()), (2, 2));
    assert!(baked.warnings[1].contains("nothing is drawn"), "{:?}", baked.warnings);
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn assets_bake_or_say_why_not() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/assets");
    let mut files = Vec::new();
    let mut folders = vec![root];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            match path.extension().and_then(|extension| extension.to_str()) {
                _ if path.is_dir() => folders.push(path),
                Some("gltf" | "glb") => files.push(path),
                _ => {}
            }
        }
    }
    assert!(!files.is_empty(), "no assets");
    files.sort();
    let place = BakeFixture::new();
    for file in files {
        let start = Instant::now();
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match place.bake(&file) {
            Ok(baked) => {
                let scene = place.scene(&baked);
                let pieces: usize = scene.meshes.iter().map(|mesh| mesh.primitives.len()).sum();
                println!(
                    "{name} | ok, {} ms | {} triangles, {} pieces, {} textures, {} KiB | {}",
                    start.elapsed().as_millis(),
                    baked.triangles,
                    pieces,
                    baked.textures,
                    baked.bytes / 1024,
                    baked.warnings.join("; ")
                );
            }
            Err(BakeError::Source { file: named, place, what, right }) => {
                assert_eq!(named, file);
                println!("{name} | refused | {place}: {what}; {right}");
            }
            Err(error) => panic!("{name}: {error}"),
        }
    }
}

#[test]
fn progress_rises_to_a_hundred_percent() {
    let place = BakeFixture::new();
    let path = place.write("town.glb", &Builder::triangle().glb());
    let mut percents = Vec::new();
    let cancel = AtomicBool::new(false);
    bake(&path, &place.store, &mut |progress| percents.push(progress.percent()), &cancel)
        .expect("baked");
    assert!(percents.is_sorted(), "{percents:?}");
    assert_eq!((percents.first(), percents.last()), (Some(&0), Some(&100)));
}
