//! Compressed files against the same files without compression.

use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, Mesh, MeshEncoder,
    PointAttribute, PointIndex,
};
use glam::Vec3;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::builder::Builder;
use super::{BakeFixture, bake_builder, vertices};

/// Vertices along each side of the grid.
const SIDE: u32 = 9;

fn positions() -> Vec<[f32; 3]> {
    let row =
        |y: u32| (0..SIDE).map(move |x| [x as f32, y as f32 * 0.5, (x * x + 3 * y) as f32 / 64.0]);
    (0..SIDE).flat_map(row).collect()
}

fn indices() -> Vec<u32> {
    let cell = |x: u32, y: u32| {
        let at = y * SIDE + x;
        [at, at + 1, at + SIDE, at + 1, at + SIDE + 1, at + SIDE]
    };
    (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).flat_map(move |x| cell(x, y))).collect()
}

fn plain() -> Builder {
    let mut builder = Builder::empty();
    let positions = builder.floats("VEC3", positions().as_flattened());
    let indices = builder.indices(&indices());
    builder.mesh(&json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    builder
}

/// The corners of all triangles, in an order of their own.
fn triangles(builder: &Builder) -> Vec<Vec<[i64; 3]>> {
    let (place, baked, scene) = bake_builder(builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let primitive = &scene.meshes[0].primitives[0];
    let rows = vertices(&place, &scene, 0, 0);
    let bytes = place.store.blobs().read(primitive.blob).expect("read").expect("there");
    let indices = primitive.finest_indices_of(&bytes);
    let indices: Vec<u32> = primitive.index_format.numbers(&indices).collect();
    let corner = |index: u32| {
        let at = Vec3::from_slice(&rows[index as usize]).as_dvec3() + primitive.origin;
        (at * 4096.0).round().as_i64vec3().to_array()
    };
    let turned = |corners: &[u32]| {
        let mut corners: Vec<[i64; 3]> = corners.iter().map(|index| corner(*index)).collect();
        let least = (0..3).min_by_key(|at| corners[*at]).unwrap_or(0);
        corners.rotate_left(least);
        corners
    };
    let mut all: Vec<_> = indices.chunks(3).map(turned).collect();
    all.sort();
    all
}

/// Compresses the view of an accessor, whose uncompressed bytes are given as well, and leaves
/// nothing of those in the file.
fn compress(builder: &mut Builder, accessor: usize, encoded: &[u8], mut extension: Value) {
    let packed = builder.view(encoded, None);
    let view = builder.json["bufferViews"][packed].take();
    builder.json["bufferViews"].as_array_mut().expect("a list").pop();
    extension["buffer"] = json!(0);
    extension["byteOffset"] = view["byteOffset"].clone();
    extension["byteLength"] = view["byteLength"].clone();
    let at = builder.json["accessors"][accessor]["bufferView"].as_u64().expect("a view") as usize;
    let view = &mut builder.json["bufferViews"][at];
    (view["buffer"], view["byteOffset"]) = (json!(1), json!(0));
    view["extensions"] = json!({ "EXT_meshopt_compression": extension });
}

/// Names the buffers, of which the second has no bytes.
fn with_fallback(mut builder: Builder) -> Builder {
    let fallback = json!({ "EXT_meshopt_compression": { "fallback": true } });
    builder.json["buffers"] = json!([
        { "byteLength": builder.bin.len() },
        { "byteLength": 100_000, "extensions": fallback },
    ]);
    builder.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    builder
}

fn meshopt_grid(mode: &str) -> Builder {
    let mut builder = plain();
    let (positions, indices) = (positions(), indices());
    let count = positions.len();
    let encoded = meshopt::encode_vertex_buffer(&positions).expect("encoded");
    let extension = json!({ "byteStride": 12, "count": count, "mode": "ATTRIBUTES" });
    compress(&mut builder, 0, &encoded, extension);
    let encoded = match mode {
        "TRIANGLES" => meshopt::encode_index_buffer(&indices, count),
        _ => meshopt::encode_index_sequence(&indices, count),
    };
    let extension = json!({ "byteStride": 4, "count": indices.len(), "mode": mode });
    compress(&mut builder, 1, &encoded.expect("encoded"), extension);
    with_fallback(builder)
}

#[test]
fn views_of_meshoptimizer_are_the_triangles_of_the_plain_file() {
    let expected = triangles(&plain());
    assert_eq!(expected.len(), indices().len() / 3);
    for mode in ["TRIANGLES", "INDICES"] {
        let mut grid = meshopt_grid(mode);
        assert_eq!(triangles(&grid), expected, "{mode}");
        // The tag of the buffer that views are unpacked to is optional, and so is its file.
        grid.json["buffers"][1]["uri"] = json!("fallback.bin");
        assert_eq!(triangles(&grid), expected, "{mode} without the file");
        grid.json["buffers"][1] = json!({ "byteLength": 100_000 });
        assert_eq!(triangles(&grid), expected, "{mode} without the tag");
    }
}

#[test]
fn filtered_normals_are_as_near_as_their_bits() {
    let direction = |at: usize| {
        let (turn, height) = (at as f32 * 0.7, (at as f32 / 40.0 - 1.0).clamp(-1.0, 1.0));
        let across = (1.0 - height * height).sqrt();
        Vec3::new(turn.cos() * across, turn.sin() * across, height)
    };
    let normals: Vec<[f32; 4]> =
        (0..positions().len()).map(|at| direction(at).extend(0.0).to_array()).collect();
    for (stride, component, tolerance) in [(4, 5120, 0.02), (8, 5122, 1e-4)] {
        let encoded = if stride == 4 {
            meshopt::encode_vertex_buffer(&meshopt::encode_filter_oct::<i8>(&normals, 8))
        } else {
            meshopt::encode_vertex_buffer(&meshopt::encode_filter_oct::<i16>(&normals, 16))
        };
        let mut builder = plain();
        let zeros = vec![0; normals.len() * stride];
        let accessor = builder.accessor("VEC3", component, normals.len(), &zeros, Some(4));
        builder.json["accessors"][accessor]["normalized"] = json!(true);
        let view = builder.json["accessors"][accessor]["bufferView"].as_u64().expect("a view");
        builder.json["bufferViews"][view as usize]["byteStride"] = json!(stride);
        let extension = json!({
            "byteStride": stride, "count": normals.len(), "mode": "ATTRIBUTES",
            "filter": "OCTAHEDRAL",
        });
        compress(&mut builder, accessor, &encoded.expect("encoded"), extension);
        builder.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(accessor);
        let builder = with_fallback(builder);
        let (place, _, scene) = bake_builder(&builder);
        let origin = scene.meshes[0].primitives[0].origin;
        for row in vertices(&place, &scene, 0, 0) {
            let position = Vec3::from_slice(&row).as_dvec3() + origin;
            let near = |at: &[f32; 3]| (Vec3::from(*at).as_dvec3() - position).length() < 1e-5;
            let at = positions().iter().position(near).expect("a vertex of the grid");
            let off = (Vec3::from_slice(&row[3..]) - direction(at)).length();
            assert!(off < tolerance, "{off} of {stride} bytes at {at}");
        }
    }
}

/// A stream of the grid; levels 0 to 10, of which the last is the smallest.
fn draco_stream(level: i32) -> Vec<u8> {
    draco_stream_of(&positions(), &indices(), (level, 20))
}

/// A stream of a level of a mesh whose positions stand on a grid of so many bits.
pub(super) fn draco_stream_of(
    positions: &[[f32; 3]],
    indices: &[u32],
    (level, bits): (i32, i32),
) -> Vec<u8> {
    let mut mesh = Mesh::new();
    let mut attribute = PointAttribute::new();
    let count = positions.len();
    attribute.init(GeometryAttributeType::Position, 3, DataType::Float32, false, count);
    for (at, value) in positions.iter().enumerate() {
        let bytes: Vec<u8> = value.iter().flat_map(|number| number.to_le_bytes()).collect();
        attribute.buffer_mut().write(at * 12, &bytes);
    }
    mesh.add_attribute(attribute);
    mesh.set_num_faces(indices.len() / 3);
    for (at, corners) in (0u32..).zip(indices.as_chunks::<3>().0) {
        mesh.set_face(FaceIndex(at), corners.map(PointIndex));
    }
    let mut options = EncoderOptions::new();
    options.set_compression_level(level);
    options.set_attribute_quantization(0, bits);
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut out = EncoderBuffer::new();
    encoder.encode(&options, &mut out).expect("encoded");
    out.data().to_vec()
}

fn draco_grid(stream: &[u8]) -> Builder {
    let mut builder = plain();
    let view = builder.view(stream, None);
    for accessor in builder.json["accessors"].as_array_mut().expect("a list") {
        accessor.as_object_mut().expect("an object").remove("bufferView");
    }
    builder.json["meshes"][0]["primitives"][0]["extensions"] = json!({
        "KHR_draco_mesh_compression": { "bufferView": view, "attributes": { "POSITION": 0 } } });
    builder.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    builder
}

#[test]
fn streams_of_draco_are_the_triangles_of_the_plain_file() {
    let expected = triangles(&plain());
    // One after the other, by edges, and by the valence of edges.
    for level in [0, 5, 10] {
        let unpacked = triangles(&draco_grid(&draco_stream(level)));
        assert_eq!(unpacked.len(), expected.len(), "{level}");
        for (corners, of_plain) in unpacked.iter().flatten().zip(expected.iter().flatten()) {
            // 20 bits of 8 m are 1/131,072 m: at most one step of 1/4,096 m apart.
            let off = (0..3).map(|axis| (corners[axis] - of_plain[axis]).abs()).max();
            assert!(off <= Some(1), "{corners:?} {of_plain:?}");
        }
    }
}

fn refusal(builder: &Builder) -> String {
    let place = BakeFixture::new();
    let path = place.write("scene.glb", &builder.glb());
    place.bake(&path).expect_err("refused").to_string()
}

#[test]
fn numbers_that_do_not_go_together_are_refused_with_their_key() {
    let name = "bufferViews[0].extensions.EXT_meshopt_compression";
    for (key, value, parts) in [
        ("mode", json!("WAVES"), ["mode", "WAVES"]),
        ("filter", json!("COFFEE"), ["filter", "COFFEE"]),
        ("filter", json!("QUATERNION"), ["byteStride", "12"]),
        ("byteStride", json!(13), ["byteStride", "13"]),
        ("byteStride", json!(0), ["byteStride", "0"]),
        ("byteStride", json!(260), ["byteStride", "260"]),
        ("count", json!(1u64 << 60), ["unpacks to", "can be unpacked"]),
        ("count", json!(820), ["can't be unpacked", "meshoptimizer"]),
        ("buffer", json!(9), ["buffers[9]", ""]),
        ("byteOffset", json!(u64::MAX), ["reach out of buffers[0]", ""]),
        ("byteLength", json!(7), ["can't be unpacked", ""]),
    ] {
        let mut builder = meshopt_grid("TRIANGLES");
        builder.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][key] = value;
        let message = refusal(&builder);
        assert!(message.contains(name), "{key}: {message}");
        for part in parts {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    }
    let mut builder = meshopt_grid("TRIANGLES");
    builder.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]["count"] = json!(385);
    assert!(refusal(&builder).contains("triples"));
}

#[test]
fn a_part_whose_stream_lies_is_left_out_with_the_reason() {
    let stream = draco_stream(5);
    let mut builder = draco_grid(&stream[..stream.len() / 2]);
    assert!(refusal(&builder).contains("can't be unpacked"));
    builder = draco_grid(&stream);
    let key = "KHR_draco_mesh_compression";
    builder.json["meshes"][0]["primitives"][0]["extensions"][key]["attributes"]["POSITION"] =
        json!(7);
    let quad = Builder::quad().json["meshes"][0]["primitives"][0].clone();
    assert!(refusal(&builder).contains("no attribute 7"));
    // A part that can be drawn stays.
    let shift = builder.json["accessors"].as_array().expect("a list").len();
    let mut other = Builder::empty();
    other.bin = builder.bin.clone();
    other.json = builder.json.clone();
    let positions = other.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    assert_eq!(positions, shift);
    let mut part = quad;
    part["attributes"] = json!({ "POSITION": positions });
    part.as_object_mut().expect("an object").remove("indices");
    other.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(part);
    let (_place, baked, _) = bake_builder(&other);
    assert_eq!(baked.triangles, 1);
    assert!(baked.warnings.join("\n").contains("no attribute 7"), "{:?}", baked.warnings);
}

#[test]
fn required_extensions_of_appearance_are_noted_and_drawn_without() {
    let mut builder = Builder::quad();
    let name = "KHR_materials_volume_scatter";
    builder.json["materials"] =
        json!([{ "extensions": { name: { "multiscatterColor": [1, 0, 0] } } }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.json["extensionsUsed"] = json!([name]);
    builder.json["extensionsRequired"] = json!([name]);
    let (_place, baked, _) = bake_builder(&builder);
    assert_eq!(baked.triangles, 2);
    assert!(baked.warnings.iter().any(|note| note.contains(name)), "{:?}", baked.warnings);
}

proptest! {
    #[test]
    fn damaged_streams_are_drawn_or_refused(
        draco in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut builder =
            if draco { draco_grid(&draco_stream(5)) } else { meshopt_grid("TRIANGLES") };
        let plain = positions().len() * 12 + indices().len() * 4;
        let streams = &mut builder.bin[plain..];
        for (at, value) in changes {
            let at = at.index(streams.len());
            streams[at] = value;
        }
        let place = BakeFixture::new();
        let path = place.write("scene.glb", &builder.glb());
        if let Err(error) = place.bake(&path) {
            prop_assert!(error.to_string().contains("scene.glb"));
        }
    }
}
