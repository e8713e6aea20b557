//! Random scenes, written as files and baked again.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::atomic::AtomicBool;

use fastrand::Rng;
use glam::{Affine2, DAffine3, DQuat, DVec3, Mat2, Quat, Vec2, Vec3, Vec4};
use polyptych_baker::{BakeCache, bake};
use polyptych_core::EditedScene;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_manager::scene_export;
use polyptych_protocol::state_log::SceneRef;
use polyptych_scene::{
    AlphaMode, Anisotropy, AssetManifests, Attribute, BakedLight, Clearcoat, DiffuseTransmission,
    Filter, IndexFormat, Instance, Iridescence, Light, LightKind, Material, MaterialExtensions,
    Mesh, MipFilter, Node, NodeExtras, NodeId, Primitive, Sampler, Scene, SceneEdits, Sheen,
    Specular, Texture, TextureFormat, TextureRef, Topology, Transmission, VertexLayout, Volume,
    Wrap,
};

/// Scenes that are tried.
const SCENES: u64 = 40;

fn unit(random: &mut Rng) -> f32 {
    random.f32()
}

fn signed(random: &mut Rng) -> f32 {
    random.f32() * 20.0 - 10.0
}

fn vector(random: &mut Rng) -> Vec3 {
    Vec3::new(signed(random), signed(random), signed(random))
}

fn name(random: &mut Rng) -> String {
    let names = ["", "door", "Tür \"1\"", "a\\b", "line\nbreak", "\u{1}", "門", "door"];
    random.choice(names).unwrap_or_default().to_owned()
}

fn direction(random: &mut Rng) -> Vec3 {
    let raw = vector(random) + Vec3::new(0.0, 0.0, 0.01);
    raw.try_normalize().unwrap_or(Vec3::X)
}

/// A texture whose levels below the largest one are black: a bake makes them anew.
fn texture(random: &mut Rng, store: &BlobStore, format: TextureFormat) -> Texture {
    let (width, height) = (random.u32(1..9), random.u32(1..9));
    let filter = |random: &mut Rng| if random.bool() { Filter::Nearest } else { Filter::Linear };
    let mip = [MipFilter::None, MipFilter::Nearest, MipFilter::Linear][random.usize(0..3)];
    let wrap = |random: &mut Rng| [Wrap::Clamp, Wrap::Mirror, Wrap::Repeat][random.usize(0..3)];
    let mut texture = Texture {
        blob: BlobHash([0; 32]),
        format,
        width,
        height,
        mip_count: if mip == MipFilter::None { 1 } else { width.max(height).ilog2() + 1 },
        sampler: Sampler {
            mag: filter(random),
            min: filter(random),
            mip,
            wrap_u: wrap(random),
            wrap_v: wrap(random),
        },
    };
    let largest = (width * height * 4) as usize;
    let levels =
        (0..texture.bytes() as usize).map(|at| if at < largest { random.u8(..) } else { 0 });
    texture.blob = store.write(&levels.collect::<Vec<_>>()).expect("written");
    texture
}

fn material(random: &mut Rng, scene: &mut Scene, store: &BlobStore) {
    let mut slot = |random: &mut Rng, format| {
        random.bool().then(|| {
            scene.textures.push(texture(random, store, format));
            let (sin, cos) = if random.bool() { (0.0, 1.0) } else { signed(random).sin_cos() };
            let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
            let scale = Vec2::new(signed(random), signed(random));
            let offset = Vec2::new(signed(random), signed(random));
            let moved =
                Affine2::from_mat2_translation(rotation * Mat2::from_diagonal(scale), offset);
            let uv_transform = if random.bool() { moved } else { Affine2::IDENTITY };
            let texture = scene.textures.len() as u32 - 1;
            TextureRef { texture, uv_set: random.u8(0..2), uv_transform }
        })
    };
    let (color, data) = (TextureFormat::Rgba8Srgb, TextureFormat::Rgba8Linear);
    let unlit = random.u8(0..4) == 0;
    let base_color_texture = slot(random, color);
    let mut lit = |random: &mut Rng, format| slot(random, format).filter(|_| !unlit);
    let normal_texture = lit(random, data);
    let occlusion_texture = lit(random, data);
    let made = Material {
        name: name(random),
        base_color: Vec4::new(unit(random), unit(random), unit(random), unit(random)),
        metallic: unit(random),
        roughness: unit(random),
        // Dim, so that no bake takes them for real units.
        emissive: Vec3::splat(unit(random) * random.f32() * 10.0) * direction(random).abs(),
        normal_scale: normal_texture.map_or(1.0, |_| signed(random)),
        occlusion_strength: occlusion_texture.map_or(1.0, |_| unit(random)),
        alpha_mode: match random.u8(0..3) {
            0 => AlphaMode::Opaque,
            1 => AlphaMode::Mask(unit(random)),
            _ => AlphaMode::Blend,
        },
        double_sided: random.bool(),
        unlit,
        base_color_texture,
        metallic_roughness_texture: lit(random, data),
        normal_texture,
        occlusion_texture,
        emissive_texture: lit(random, color),
        extensions: {
            let extensions = extensions(random, &mut lit);
            (!unlit && random.bool()).then(|| Box::new(extensions))
        },
    };
    scene.materials.push(made);
}

/// Extensions of a material, whose textures are made by the function.
fn extensions(
    random: &mut Rng,
    texture_of: &mut impl FnMut(&mut Rng, TextureFormat) -> Option<TextureRef>,
) -> MaterialExtensions {
    let (color, data) = (TextureFormat::Rgba8Srgb, TextureFormat::Rgba8Linear);
    let texture = texture_of(random, color);
    let specular = Specular {
        ior: [0.0, 1.0 + unit(random)][random.usize(0..2)],
        factor: unit(random),
        color: direction(random).abs() * 3.0,
        texture,
        color_texture: texture_of(random, color),
    };
    let mut made = MaterialExtensions { specular: Some(specular), ..MaterialExtensions::default() };
    // Not all: a material can have five textures of extensions.
    let which = random.usize(0..7);
    if which == 0 {
        let normal_texture = texture_of(random, data);
        made.clearcoat = Some(Clearcoat {
            factor: unit(random),
            roughness: unit(random),
            normal_scale: normal_texture.map_or(1.0, |_| signed(random)),
            texture: texture_of(random, data),
            roughness_texture: texture_of(random, data),
            normal_texture,
        });
    } else if which == 1 {
        made.sheen = Some(Sheen {
            color: direction(random).abs(),
            roughness: unit(random),
            color_texture: texture_of(random, color),
            roughness_texture: texture_of(random, color),
        });
    } else if which == 4 {
        made.diffuse_transmission = Some(DiffuseTransmission {
            factor: unit(random).max(0.01),
            color: direction(random).abs(),
            texture: texture_of(random, color),
            color_texture: texture_of(random, color),
        });
        made.volume = random.bool().then(|| volume(random, None));
    } else if which == 3 {
        made.iridescence = Some(Iridescence {
            factor: unit(random).max(0.01),
            ior: 1.0 + unit(random),
            thickness_min_nm: unit(random) * 1000.0,
            thickness_max_nm: unit(random) * 1000.0,
            texture: texture_of(random, data),
            thickness_texture: texture_of(random, data),
        });
    } else if which == 5 {
        let intensity = unit(random).max(0.01);
        let texture = texture_of(random, data);
        made.baked_light = texture.is_some().then_some(BakedLight { intensity, texture });
    } else if which == 2 {
        made.anisotropy = Some(Anisotropy {
            strength: unit(random).max(0.01),
            rotation_rad: signed(random),
            texture: texture_of(random, data),
        });
    } else {
        (made.transmission, made.volume) = glass(random, |random| texture_of(random, data));
    }
    made
}

/// Glass with a texture each.
fn glass(
    random: &mut Rng,
    mut texture_of: impl FnMut(&mut Rng) -> Option<TextureRef>,
) -> (Option<Transmission>, Option<Volume>) {
    let transmission = Transmission { factor: unit(random).max(0.01), texture: texture_of(random) };
    let is_thick = random.bool();
    let thickness_texture = texture_of(random).filter(|_| is_thick);
    let volume = volume(random, thickness_texture);
    (Some(transmission), is_thick.then_some(volume))
}

fn volume(random: &mut Rng, thickness_texture: Option<TextureRef>) -> Volume {
    Volume {
        thickness: unit(random) + 0.01,
        attenuation_distance: [f32::INFINITY, unit(random) + 0.1][random.usize(0..2)],
        attenuation_color: direction(random).abs(),
        dispersion: [0.0, unit(random)][random.usize(0..2)],
        thickness_texture,
    }
}

fn primitive(random: &mut Rng, scene: &Scene, store: &BlobStore) -> Primitive {
    let material = Some(random.u32(0..=scene.materials.len() as u32));
    let material = material.filter(|at| (*at as usize) < scene.materials.len());
    let own = material.map(|at| &scene.materials[at as usize]);
    let has_set = |set| own.is_some_and(|own| own.textures().any(|of| of.uv_set == set));
    let layout = VertexLayout {
        tangent: own.is_some_and(Material::needs_tangents),
        uv0: has_set(0),
        uv1: has_set(1),
        color: random.bool(),
    };
    let topology = [Topology::Triangles, Topology::Lines, Topology::Points][random.usize(0..3)];
    // Normals, which make lines and points lit as the material says.
    let vertex_count = random.u32(3..20);
    let (mut min, mut max, mut bytes) = (Vec3::MAX, Vec3::MIN, Vec::new());
    for _ in 0..vertex_count {
        let (position, normal) = (vector(random), direction(random));
        (min, max) = (min.min(position), max.max(position));
        let mut floats = [position.to_array(), normal.to_array()].concat();
        if layout.tangent {
            // Only triangles have their own; a bake gives lines and points this one.
            let is_surface = topology == Topology::Triangles;
            let own = normal.any_orthonormal_vector().extend(1.0);
            floats.extend(if is_surface { own.to_array() } else { [1.0, 0.0, 0.0, 1.0] });
        }
        let uvs = 2 * (usize::from(layout.uv0) + usize::from(layout.uv1));
        floats.extend((0..uvs).map(|_| signed(random)));
        floats.extend((0..if layout.color { 4 } else { 0 }).map(|_| unit(random)));
        bytes.extend(floats.into_iter().flat_map(f32::to_le_bytes));
    }
    let each = [1, 2, 3][topology as usize];
    // Every vertex once at least: others are left out.
    let mut indices: Vec<u16> = (0..vertex_count as u16).collect();
    while !indices.len().is_multiple_of(each) || random.bool() {
        indices.push(random.u16(0..vertex_count as u16));
    }
    bytes.extend(indices.iter().flat_map(|index| index.to_le_bytes()));
    Primitive {
        blob: store.write(&bytes).expect("written"),
        layout,
        vertex_count,
        index_count: indices.len() as u32,
        coarser_index_count: 0,
        meshlet_count: 0,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: None,
        index_format: IndexFormat::U16,
        topology,
        material,
        origin: DVec3::ZERO,
        min,
        max,
    }
}

fn light(random: &mut Rng) -> Light {
    let inner_rad = unit(random);
    let kind = match random.u8(0..3) {
        0 => LightKind::Directional,
        1 => LightKind::Point,
        _ => LightKind::Spot { inner_rad, outer_rad: inner_rad + 0.01 + unit(random) * 0.5 },
    };
    let range = random.bool().then(|| 0.1 + unit(random));
    let color = Vec3::new(unit(random), unit(random), unit(random));
    // Dim, so that no bake takes them for real units.
    Light { kind, color, intensity: unit(random) * 0.01, range }
}

fn local(random: &mut Rng) -> DAffine3 {
    let mut wide = || (random.f64() - 0.5) * 2e7;
    let translation = DVec3::new(wide(), wide(), wide());
    let at = DAffine3::from_translation(translation);
    match random.u8(0..3) {
        0 => DAffine3::IDENTITY,
        1 => at,
        _ => {
            let axis = direction(random).as_dvec3();
            let turned = DAffine3::from_quat(DQuat::from_axis_angle(axis.normalize(), 1.1));
            // Sheared too, as a parent's scale would.
            at * DAffine3::from_scale(DVec3::new(1.0, 2.5, 0.3)) * turned
        }
    }
}

fn node(random: &mut Rng, scene: &mut Scene) {
    let pick = |random: &mut Rng, len: usize| random.u32(0..=len as u32);
    let index = scene.nodes.len();
    let parent = Some(pick(random, index)).filter(|at| (*at as usize) < index);
    let mesh = Some(pick(random, scene.meshes.len()));
    let mesh = mesh.filter(|at| (*at as usize) < scene.meshes.len());
    let light = Some(pick(random, scene.lights.len()));
    let light = light.filter(|at| (*at as usize) < scene.lights.len());
    let count = if mesh.is_some() && random.u8(0..4) == 0 { 3 } else { 0 };
    let instance = |random: &mut Rng| Instance {
        translation: vector(random),
        rotation: Quat::from_axis_angle(direction(random), 0.8),
        scale: vector(random),
        crowd: 0.0,
    };
    let instances = (0..count).map(|_| instance(random)).collect();
    let (name_of, local) = (name(random), local(random));
    let made = Node { name: name_of, parent, local, mesh, light, instances, ..Node::default() };
    scene.nodes.push(made);
    let attributes: BTreeMap<String, Attribute> = (0..random.usize(0..3))
        .map(|at| {
            let value = match random.u8(0..3) {
                0 => Attribute::Bool(random.bool()),
                1 => Attribute::Number(random.f64() * 1e300 * f64::from(signed(random))),
                _ => Attribute::Text(name(random)),
            };
            (format!("key \"{at}\""), value)
        })
        .collect();
    let is_hidden = random.u8(0..5) == 0;
    if is_hidden || !attributes.is_empty() {
        scene.extras.push(NodeExtras { node: index as u32, is_hidden, attributes });
    }
}

fn scene(random: &mut Rng, store: &BlobStore) -> Scene {
    let mut scene = Scene { name: "scene".into(), ..Scene::default() };
    (0..random.usize(0..4)).for_each(|_| material(random, &mut scene, store));
    for _ in 0..random.usize(1..4) {
        let primitives =
            (0..random.usize(1..4)).map(|_| primitive(random, &scene, store)).collect();
        scene.meshes.push(Mesh { name: name(random), primitives });
    }
    scene.lights = (0..random.usize(0..3)).map(|_| light(random)).collect();
    (0..random.usize(2..12)).for_each(|_| node(random, &mut scene));
    // Something is drawn, or the file would be refused or noted.
    scene.nodes.push(Node { mesh: Some(0), ..Node::default() });
    scene
}

/// A float as a person would compare it: f32 that were normalised again differ in the last bits.
fn rounded(values: impl IntoIterator<Item = f32>) -> Vec<i64> {
    values.into_iter().map(|value| (f64::from(value) * 1e4).round() as i64).collect()
}

/// Elements of a primitive with the bytes of their vertices, whatever their order; each begins with
/// its least vertex, and turns as before.
fn elements(of: &Primitive, store: &BlobStore) -> Vec<Vec<Vec<u8>>> {
    let blob = store.read(of.blob).expect("read").expect("there");
    let vertices = &blob[..of.vertex_bytes() as usize];
    let indices = &*of.finest_indices_of(&blob);
    let stride = of.layout.stride() as usize;
    let vertex = |index: &[u8]| {
        let index = usize::from(u16::from_le_bytes([index[0], index[1]]));
        vertices[index * stride..(index + 1) * stride].to_vec()
    };
    let corners: Vec<Vec<u8>> = indices.chunks(2).map(vertex).collect();
    let mut elements: Vec<Vec<Vec<u8>>> = corners
        .chunks([1, 2, 3][of.topology as usize])
        .map(|element| {
            let turns = (0..element.len()).map(|by| {
                let mut turned = element.to_vec();
                turned.rotate_left(by);
                turned
            });
            if element.len() == 3 { turns.min().unwrap_or_default() } else { element.to_vec() }
        })
        .collect();
    elements.sort();
    elements
}

fn material_text(scene: &Scene, store: &BlobStore, material: Option<u32>) -> String {
    let Some(material) = material.map(|at| &scene.materials[at as usize]) else {
        return "none".into();
    };
    let mut own = material.clone();
    let mut textures = Vec::new();
    for of in own.textures_mut() {
        let texture = &scene.textures[of.texture as usize];
        let blob = store.read(texture.blob).expect("read").expect("there");
        let pixels = &blob[..(texture.width * texture.height * 4) as usize];
        let Texture { format, width, height, mip_count, sampler, .. } = texture;
        let transform = rounded(of.uv_transform.to_cols_array());
        textures.push(format!(
            "{format:?} {width} {height} {mip_count} {sampler:?} {transform:?} {}",
            BlobHash::of(pixels)
        ));
        (of.texture, of.uv_transform) = (0, Affine2::IDENTITY);
    }
    format!("{own:?} {textures:?}")
}

/// All that is known of a scene, in lines that do not depend on numbers of nodes, meshes,
/// materials, textures and lights, nor on the order of triangles.
fn described(scene: &Scene, ids: &[NodeId], edits: &SceneEdits, store: &BlobStore) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    let mut paths: Vec<String> = Vec::new();
    for (node, id) in scene.nodes.iter().zip(ids) {
        let path = node.parent.map_or_else(String::new, |at| paths[at as usize].clone());
        let mesh = node.mesh.map(|at| &scene.meshes[at as usize]);
        let mesh = mesh.map(|mesh| {
            let primitive = |of: &Primitive| {
                let material = material_text(scene, store, of.material);
                let geometry = BlobHash::of(format!("{:?}", elements(of, store)).as_bytes());
                let (layout, topology) = (of.layout, of.topology);
                format!("{layout:?} {topology:?} {} {} {geometry} {material}", of.min, of.max)
            };
            (mesh.name.clone(), mesh.primitives.iter().map(primitive).collect::<Vec<_>>())
        });
        let instance = |of: &Instance| {
            (of.translation.to_string(), rounded(of.rotation.to_array()), of.scale.to_string())
        };
        let instances: Vec<_> = node.instances.iter().map(instance).collect();
        let light = node.light.map(|at| &scene.lights[at as usize]);
        let own = edits.node(*id);
        let (hidden, attributes) =
            (own.is_some_and(|own| own.is_hidden), own.map(|own| own.attributes.clone()));
        let attributes = attributes.unwrap_or_default();
        let at = node.local.to_cols_array().map(f64::to_bits);
        let path = format!(
            "{path}/{:?} {at:?} {mesh:?} {light:?} {instances:?} {hidden} {attributes:?}",
            node.name
        );
        lines.push(path.clone());
        paths.push(path);
    }
    lines.sort();
    lines
}

#[test]
fn random_scenes_come_back_as_they_were() {
    let folder = tempfile::tempdir().expect("a folder");
    let cache = BakeCache::open(folder.path()).expect("a store");
    let store = cache.blobs();
    let file = folder.path().join("scene.glb");
    for seed in 0..SCENES {
        let mut random = Rng::with_seed(seed);
        let made = scene(&mut random, store);
        assert_eq!(made.fault(), None, "seed {seed}");
        let manifest = store.write(&polyptych_codec::encode(&made)).expect("written");
        let edits = made.first_edits();
        let (whole, ids) = edits.apply_with_hidden(&made, &AssetManifests::new());
        let expected = described(&whole, &ids, &edits, store);
        let scene = SceneRef { name: made.name.clone(), manifest };
        let edited = EditedScene { scene, edits, next_node: 0 };
        let written = scene_export::write(&edited, store, folder.path(), &mut |_| true);
        let (about, mut bytes) = written.expect("exported");
        assert!(about.notes.is_empty(), "seed {seed}: {:?}", about.notes);
        let mut glb = Vec::new();
        bytes.read_to_end(&mut glb).expect("read");
        std::fs::write(&file, &glb).expect("written");

        let baked = bake(&file, &cache, &mut |_| {}, &AtomicBool::new(false));
        let baked = baked.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        assert_eq!(baked.warnings, [] as [String; 0], "seed {seed}");
        let bytes = store.read(baked.manifest).expect("read").expect("there");
        let again = polyptych_scene::decode(&bytes).expect("a manifest");
        let edits = again.first_edits();
        let (whole, ids) = edits.apply_with_hidden(&again, &AssetManifests::new());
        let found = described(&whole, &ids, &edits, store);
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found, expected, "seed {seed}");
        }
        assert_eq!(found.len(), expected.len(), "seed {seed}");
    }
}
