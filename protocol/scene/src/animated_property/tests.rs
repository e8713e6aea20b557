//! Values of properties at times against formulas in f64, and what they make of materials and
//! lights.

use std::sync::Arc;

use glam::{DAffine3, Vec2, Vec4};

use super::*;
use crate::animation::{AnimatedPath, Animations, Channel, Clip, ClipTime, Interpolation};
use crate::{
    AssetManifests, Edit, MaterialExtensions, Motion, Node, NodeId, PlacedNodes, SceneEdits,
    Specular, Variant,
};

fn property_of(kind: PropertyKind, targets: &[u32], rest: &[f64]) -> AnimatedProperty {
    AnimatedProperty { kind, targets: targets.to_vec(), rest: rest.to_vec() }
}

/// A channel of the property at this place, from one value to another in 2 s.
fn channel(target: u32, interpolation: Interpolation, from: &[f32], to: &[f32]) -> Channel {
    let values = [from, to].concat();
    let path = AnimatedPath::Property;
    Channel { target, path, interpolation, times: vec![0.0, 2.0], values }
}

fn texture() -> TextureRef {
    TextureRef { texture: 0, uv_set: 0, uv_transform: Affine2::IDENTITY }
}

/// The properties that its clip changes.
fn properties() -> Vec<AnimatedProperty> {
    use LightProperty as L;
    use MaterialProperty as M;
    let of_material =
        |property, rest: &[f64]| property_of(PropertyKind::Material(property), &[0, 1], rest);
    let of_light =
        |property, at, rest: &[f64]| property_of(PropertyKind::Light(property), &[at], rest);
    vec![
        property_of(PropertyKind::Visible, &[1], &[1.0]),
        of_light(L::Color, 0, &[1.0; 3]),
        of_light(L::Intensity, 0, &[2.0]),
        of_light(L::Range, 0, &[0.0]),
        of_light(L::InnerCone, 1, &[0.1]),
        of_light(L::OuterCone, 1, &[0.5]),
        of_material(M::BaseColor, &[1.0; 4]),
        of_material(M::EmissiveColor, &[0.5; 3]),
        of_material(M::EmissiveStrength, &[1.0]),
        of_material(M::UvOffset(0), &[0.0; 2]),
        of_material(M::UvRotation(0), &[0.0]),
        of_material(M::UvScale(0), &[1.0; 2]),
        of_material(M::AlphaCutoff, &[0.5]),
        of_material(M::Ior, &[1.5]),
    ]
}

/// A root with a lamp and a spot below it; three materials, of which the second is a copy of the
/// first that a variant replaces by the third.
fn scene() -> Scene {
    let node = |parent, light| Node { parent, light, ..Node::default() };
    let spot = LightKind::Spot { inner_rad: 0.1, outer_rad: 0.5 };
    let light = |kind| Light { kind, color: Vec3::ONE, intensity: 2.0, range: None };
    let specular = Some(Specular::default());
    let extensions = Some(Box::new(MaterialExtensions { specular, ..Default::default() }));
    let material = Material {
        alpha_mode: AlphaMode::Mask(0.5),
        base_color_texture: Some(texture()),
        extensions,
        ..Material::default()
    };
    let linear = Interpolation::Linear;
    let channels = vec![
        channel(0, Interpolation::Step, &[1.0], &[0.0]),
        channel(1, linear, &[1.0, 0.0, 0.0], &[0.0, 0.5, -1.0]),
        channel(2, linear, &[1.0], &[9.0]),
        channel(3, linear, &[0.0], &[4.0]),
        channel(4, linear, &[0.0], &[3.0]),
        channel(5, linear, &[0.2], &[1.0]),
        channel(6, linear, &[0.0, 1.0, 0.5, 1.0], &[1.0, 0.0, 0.5, 0.0]),
        channel(8, linear, &[0.0], &[8.0]),
        channel(9, linear, &[0.0, 1.0], &[2.0, 0.0]),
        channel(10, linear, &[0.0], &[3.0]),
        channel(12, linear, &[0.0], &[1.0]),
        channel(13, linear, &[0.5], &[2.5]),
    ];
    let clip = Clip { name: "all".into(), channels };
    let texture = crate::Texture {
        blob: polyptych_files::blob::BlobHash([0; 32]),
        format: crate::TextureFormat::Rgba8Srgb,
        width: 1,
        height: 1,
        mip_count: 1,
        sampler: crate::Sampler::default(),
    };
    Scene {
        nodes: vec![
            Node::default(),
            Node { local: DAffine3::from_scale(glam::DVec3::splat(2.0)), ..node(Some(0), Some(0)) },
            node(Some(1), Some(1)),
        ],
        lights: vec![light(LightKind::Point), light(spot)],
        materials: vec![material.clone(), material, Material::default()],
        textures: vec![texture],
        variants: vec![Variant { name: "Other".into(), materials: vec![(1, 2)] }],
        animations: Animations {
            clips: vec![clip],
            properties: properties(),
            ..Animations::default()
        },
        ..Scene::default()
    }
}

fn motion(edits: &[Edit]) -> Motion {
    let base = Arc::new(scene());
    assert_eq!(base.fault(), None);
    let mut all = SceneEdits::default();
    for edit in edits {
        all.apply(edit.clone());
    }
    let (placed, ids) = all.apply_to(&base, &AssetManifests::new());
    Motion::new(&base, &PlacedNodes::new(&placed.nodes, ids, all.clone()), &all).expect("moves")
}

fn played(time_s: f64) -> [ClipTime; 1] {
    [ClipTime { clip: 0, time_s, weight: 1.0 }]
}

#[test]
fn values_at_twenty_times_are_those_of_their_formulas() {
    let motion = motion(&[]);
    for step in 0..20 {
        let time_s = f64::from(step) * 0.11;
        let t = (time_s / 2.0).min(1.0);
        let moment = motion.at(&played(time_s));
        assert_eq!(moment.hidden, if time_s < 2.0 { vec![] } else { vec![1, 2] }, "{time_s}");
        let [(1, lamp), (2, spot)] = &moment.lights[..] else { panic!("{:?}", moment.lights) };
        let near = |got: f32, wanted: f64| {
            let off = (f64::from(got) - wanted).abs();
            assert!(off <= 1e-6 * wanted.abs().max(1.0), "{got} for {wanted} at {time_s}");
        };
        near(lamp.color.x, 1.0 - t);
        near(lamp.color.y, 0.5 * t);
        assert_eq!(lamp.color.z, 0.0, "no light is negative");
        near(lamp.intensity, 1.0 + 8.0 * t);
        match lamp.range {
            None => assert_eq!(step, 0, "0 is without end"),
            Some(range) => near(range, 4.0 * t),
        }
        let LightKind::Spot { inner_rad, outer_rad } = spot.kind else { panic!("a spot") };
        near(outer_rad, 0.2 + 0.8 * t);
        near(inner_rad, (3.0 * t).min(0.2 + 0.8 * t - 1e-3));
        for at in 0..2 {
            let mut material = motion.base().materials[at].clone();
            assert_eq!(moment.materials[at].material, at as u32);
            moment.materials[at].apply_to(&mut material);
            near(material.base_color.x, t);
            near(material.base_color.w, 1.0 - t);
            near(material.emissive.y, 0.5 * 8.0 * t);
            assert_eq!(material.alpha_mode, AlphaMode::Mask(t as f32));
            let ior = material.extensions.and_then(|of| of.specular).map(|of| of.ior);
            near(ior.expect("it has one"), (0.5 + 2.0 * t).max(1.0));
            // u and v of a corner, turned and moved by the formulas of KHR_texture_transform.
            let transform = material.base_color_texture.expect("a texture").uv_transform;
            let got = transform.transform_point2(Vec2::new(0.3, 0.7));
            let (sin, cos) = (3.0 * t).sin_cos();
            near(got.x, cos * 0.3 + sin * 0.7 + 2.0 * t);
            near(got.y, -sin * 0.3 + cos * 0.7 + 1.0 - t);
        }
    }
}

#[test]
fn without_a_clip_all_is_as_the_file_has_it_and_parts_mix() {
    let motion = motion(&[]);
    assert!(motion.is_moved_by(&[]), "looks are those of a moment");
    let still = motion.at(&[]);
    assert_eq!(still.hidden, [] as [u32; 0]);
    let mut material = motion.base().materials[0].clone();
    still.materials[0].apply_to(&mut material);
    assert_eq!(material.base_color, Vec4::ONE);
    assert_eq!(material.emissive, Vec3::splat(0.5));
    let half = [ClipTime { clip: 0, time_s: 2.0, weight: 0.5 }];
    assert_eq!(motion.at(&half).lights[0].1.intensity, 0.5 * 9.0 + 0.5 * 2.0);
    // Hidden from less than a half on.
    assert_eq!(motion.at(&half).hidden, [] as [u32; 0]);
    let more = [ClipTime { weight: 0.6, ..half[0] }];
    assert_eq!(motion.at(&more).hidden, [1, 2]);
}

#[test]
fn what_was_edited_stays_and_variants_take_their_looks_with_them() {
    let materials = |motion: &Motion| -> Vec<u32> {
        motion.at(&[]).materials.iter().map(|of| of.material).collect()
    };
    assert_eq!(materials(&motion(&[])), [0, 1]);
    let set = |material| Edit::SetMaterial { material, to: Box::default() };
    assert_eq!(materials(&motion(&[set(0)])), [1]);
    let other = Edit::SetVariant(Some("Other".into()));
    assert_eq!(materials(&motion(&[other])), [0], "the other one does not change");
    let own = Light { kind: LightKind::Point, color: Vec3::X, intensity: 1.0, range: None };
    let lit = Edit::SetLight { node: NodeId(1), light: Some(own) };
    let lights = motion(&[lit]).at(&[]).lights;
    assert_eq!(lights.iter().map(|(node, _)| *node).collect::<Vec<_>>(), [2]);
    let mut traits = crate::NodeTraits::default();
    motion(&[]).add_traits(&mut traits);
    assert_eq!((traits.changing_lights, traits.moving), (vec![1, 2], vec![1, 2]));
}

#[test]
fn what_may_change_asks_for_all_that_it_may_need() {
    let mut traits = crate::NodeTraits::default();
    motion(&[]).add_traits(&mut traits);
    let plain = scene().materials.remove(0);
    let most = traits.with_changes(0, &plain);
    assert!(most.emissive == Vec3::ONE);
    assert_ne!(most.base_color_texture, plain.base_color_texture);
    assert_eq!(*traits.with_changes(2, &plain), plain, "no clip changes the third");
}

#[test]
fn properties_that_lie_are_refused() {
    let with = |change: &dyn Fn(&mut AnimatedProperty)| {
        let mut scene = scene();
        change(&mut scene.animations.properties[9]);
        scene.fault()
    };
    assert_eq!(with(&|_| ()), None);
    let faults: [&dyn Fn(&mut AnimatedProperty); 5] = [
        &|of| of.targets = vec![0, 3],
        &|of| of.targets = vec![1, 0],
        &|of| of.rest = vec![0.0],
        &|of| of.rest[0] = f64::NAN,
        &|of| of.kind = PropertyKind::Material(MaterialProperty::UvOffset(5)),
    ];
    for (at, fault) in faults.into_iter().enumerate() {
        assert!(with(fault).is_some(), "{at}");
    }
    let mut scene = scene();
    scene.animations.clips[0].channels[0].target = 99;
    assert!(scene.fault().is_some());
}
