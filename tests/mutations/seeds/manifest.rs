//! A manifest with everything in it.

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_scene::deformation::{DeformedPrimitive, Joint, Skin};
use polyptych_scene::{
    AlphaMode, AnimatedNode, AnimatedPath, AnimatedProperty, Animations, Anisotropy, Attribute,
    BakedLight, Bounds, Channel, Clearcoat, Clip, Deformation, DiffuseTransmission, IndexFormat,
    Instance, Interpolation, Iridescence, LevelCut, Light, LightKind, Material, MaterialExtensions,
    MaterialProperty, Mesh, Node, NodeExtras, Primitive, PropertyKind, Sampler, Scene, Sheen,
    Specular, Texture, TextureFormat, TextureRef, Topology, Transmission, Variant, VertexLayout,
    Volume,
};

/// Returns the primitive with levels of detail, which one that clips bend does not have.
fn with_levels(primitive: &Primitive) -> Primitive {
    let cut = LevelCut {
        level: 1,
        vertex_count: 3,
        index_count: 3,
        coarser_index_count: 0,
        meshlet_count: 1,
        error: 0.5,
    };
    let (coarser_index_count, meshlet_count, cuts) = (3, 2, vec![cut]);
    Primitive { coarser_index_count, meshlet_count, cuts, deformed: None, ..primitive.clone() }
}

/// A part of a mesh that clips bend.
fn primitive() -> Primitive {
    let layout = VertexLayout { tangent: true, uv0: true, uv1: false, color: true };
    Primitive {
        blob: BlobHash([2; 32]),
        layout,
        vertex_count: 3,
        index_count: 3,
        coarser_index_count: 0,
        meshlet_count: 0,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: Some(DeformedPrimitive {
            blob: BlobHash([4; 32]),
            bytes: 300,
            joint_sets: 1,
            joint_count: 2,
            target_count: 1,
            is_flat: false,
        }),
        index_format: IndexFormat::U16,
        topology: Topology::Triangles,
        material: Some(0),
        origin: DVec3::ONE,
        min: Vec3::NEG_ONE,
        max: Vec3::ONE,
    }
}

/// All extensions of a material, each with the same texture.
fn extensions(texture: TextureRef) -> MaterialExtensions {
    let slot = Some(texture);
    MaterialExtensions {
        specular: Some(Specular { ior: 1.8, texture: slot, ..Specular::default() }),
        clearcoat: Some(Clearcoat { factor: 0.5, texture: slot, ..Clearcoat::default() }),
        sheen: Some(Sheen { color: Vec3::ONE, roughness: 0.5, ..Sheen::default() }),
        transmission: Some(Transmission { factor: 0.5, texture: slot }),
        volume: Some(Volume { thickness: 2.0, ..Volume::default() }),
        anisotropy: Some(Anisotropy { strength: 0.5, rotation_rad: 1.0, texture: slot }),
        iridescence: Some(Iridescence { factor: 0.5, texture: slot, ..Iridescence::default() }),
        diffuse_transmission: Some(DiffuseTransmission {
            factor: 0.5,
            texture: slot,
            ..DiffuseTransmission::default()
        }),
        baked_light: Some(BakedLight { intensity: 2.0, texture: slot }),
    }
}

/// A manifest with everything in it once.
pub fn scene() -> Scene {
    let texture = TextureRef { texture: 0, uv_set: 0, uv_transform: glam::Affine2::IDENTITY };
    let material = Material {
        alpha_mode: AlphaMode::Mask(0.5),
        base_color_texture: Some(texture),
        normal_texture: Some(texture),
        extensions: Some(Box::new(extensions(texture))),
        ..Material::default()
    };
    let (translation, rotation) = (Vec3::X, Quat::IDENTITY);
    let instance = Instance { translation, rotation, scale: Vec3::splat(2.0), crowd: 1.5 };
    let node = |parent, light, instances| Node {
        name: "node".into(),
        parent,
        local: DAffine3::from_translation(DVec3::new(1e7, 0.0, 0.0)),
        mesh: Some(0),
        light,
        instances,
        crowd: 1.5,
        is_sky: true,
    };
    let kind = LightKind::Spot { inner_rad: 0.1, outer_rad: 0.5 };
    let light = Light { kind, color: Vec3::ONE, intensity: 3.0, range: Some(10.0) };
    Scene {
        name: "town".into(),
        nodes: vec![node(None, None, Vec::new()), node(Some(0), Some(0), vec![instance; 2])],
        meshes: vec![
            Mesh { name: "mesh".into(), primitives: vec![primitive()] },
            Mesh { name: "levels".into(), primitives: vec![with_levels(&primitive())] },
        ],
        materials: vec![material],
        textures: vec![Texture {
            blob: BlobHash([3; 32]),
            format: TextureFormat::Rgba8Srgb,
            width: 8,
            height: 4,
            mip_count: 4,
            sampler: Sampler::default(),
        }],
        lights: vec![light],
        sky: Vec3::ONE,
        surroundings: Some(BlobHash([4; 32])),
        bounds: Some(Bounds { min: DVec3::ZERO, max: DVec3::ONE }),
        notes: vec!["animations: 1 is not played".into()],
        exposure: Some(0.5),
        extras: vec![NodeExtras {
            node: 1,
            is_hidden: true,
            attributes: [("kind".to_owned(), Attribute::Text("sail".into()))].into(),
        }],
        animations: animations(),
        deformations: vec![deformation()],
        variants: vec![Variant { name: "Day".into(), materials: vec![(0, 0)] }],
    }
}

fn animations() -> Animations {
    let channel = Channel {
        target: 0,
        path: AnimatedPath::Weights,
        interpolation: Interpolation::CubicSpline,
        times: vec![0.5],
        values: vec![0.0, 1.0, 0.0],
    };
    let (rotation, scale) = (DQuat::IDENTITY, DVec3::ONE);
    let translation = DVec3::new(1e7, 0.0, 0.0);
    let node = AnimatedNode { node: 1, translation, rotation, scale, weights: vec![0.5] };
    Animations {
        clips: vec![Clip { name: "walk".into(), channels: vec![channel] }],
        nodes: vec![node],
        properties: vec![AnimatedProperty {
            kind: PropertyKind::Material(MaterialProperty::UvOffset(0)),
            targets: vec![0],
            rest: vec![0.0, 0.25],
        }],
    }
}

fn deformation() -> Deformation {
    let joint = Joint { node: 1, inverse_bind: DAffine3::IDENTITY };
    let skin = Skin { top: Some(0), joints: vec![joint; 2], rigid: None };
    Deformation { mesh: 0, node: 1, skin: Some(skin), weights: vec![0.5], weights_of: Some(0) }
}
