//! Materials and lights that clips change and nodes that they hide: what is drawn is as in a scene
//! that has the values of the moment, bit for bit.

use std::sync::Arc;

use glam::{Affine2, DAffine3, DVec3, Vec2, Vec3, Vec4};
use polyptych_scene::{
    ChangedMaterial, Clearcoat, Highlight, Light, LightKind, Material, MaterialExtensions,
    MaterialProperty, NodeStyle, NodeTraits, Shading, TextureRef,
};

use super::harness::{MeshFixture, SceneFixture, differences, draw, gpu, look, matt};
use crate::{GpuScene, MovedNode, SceneBuilder, SceneLayout};

const SIZE: [u32; 2] = [96, 64];

/// A textured panel with a coat, another of its material that is drawn unlit, a lamp before them,
/// and a ball; the ball stands last.
fn scene(change: impl FnOnce(&mut Material), light: Light, has_ball: bool) -> SceneFixture {
    let mut stage = SceneFixture::new();
    let texture = stage.checkers(16, true);
    let clearcoat = Some(Clearcoat { roughness: 0.3, ..Clearcoat::default() });
    let extensions = MaterialExtensions { clearcoat, ..MaterialExtensions::default() };
    let mut material = Material {
        metallic: 0.0,
        base_color_texture: Some(TextureRef {
            texture,
            uv_set: 0,
            uv_transform: Affine2::IDENTITY,
        }),
        extensions: Some(Box::new(extensions)),
        ..Material::default()
    };
    change(&mut material);
    let material = stage.material(material);
    let panel = stage.mesh(&MeshFixture::rectangle(0.9, 0.8), Some(material));
    stage.node(panel, DAffine3::from_translation(DVec3::new(-1.0, 0.0, 0.0)));
    stage.node(panel, DAffine3::from_translation(DVec3::new(1.0, 0.0, 0.0)));
    stage.light(light, DAffine3::from_translation(DVec3::new(0.0, 0.5, 1.5)));
    if has_ball {
        let ball = stage.mesh(&MeshFixture::sphere(6), None);
        stage.node(ball, DAffine3::from_translation(DVec3::new(0.2, 0.0, 0.5)));
    }
    stage
}

fn lamp(intensity: f32) -> Light {
    Light { kind: LightKind::Point, color: Vec3::ONE, intensity, range: None }
}

/// The things that clips may change: the lamp, and these properties of the material.
fn traits(nodes: usize, properties: &[MaterialProperty]) -> NodeTraits {
    let unlit = NodeStyle { shading: Some(Shading::Unlit), ..NodeStyle::default() };
    let mut styles = vec![NodeStyle::default(); nodes];
    styles[1] = unlit;
    NodeTraits {
        styles,
        moving: (2..nodes as u32).collect(),
        changing_lights: vec![2],
        changing_materials: properties.iter().map(|of| (0, *of)).collect(),
        ..NodeTraits::of_file(nodes)
    }
}

#[test]
fn values_of_a_moment_are_drawn_as_those_of_a_scene_that_has_them() {
    use MaterialProperty as Of;
    let values = vec![
        (Of::BaseColor, vec![0.25, 0.5, 1.0, 1.0]),
        (Of::Roughness, vec![0.5]),
        (Of::EmissiveColor, vec![0.5, 0.25, 0.0]),
        (Of::EmissiveStrength, vec![2.0]),
        (Of::UvOffset(0), vec![0.25, 0.5]),
        (Of::UvRotation(0), vec![0.0]),
        (Of::UvScale(0), vec![2.0, 0.5]),
        (Of::ClearcoatFactor, vec![1.0]),
    ];
    let properties: Vec<MaterialProperty> = values.iter().map(|(of, _)| *of).collect();
    let set = |material: &mut Material| {
        material.base_color = Vec4::new(0.25, 0.5, 1.0, 1.0);
        (material.roughness, material.emissive) = (0.5, Vec3::new(1.0, 0.5, 0.0));
        let texture = material.base_color_texture.as_mut().expect("a texture");
        texture.uv_transform =
            Affine2::from_scale_angle_translation(Vec2::new(2.0, 0.5), 0.0, Vec2::new(0.25, 0.5));
        let coat = material.extensions.as_mut().and_then(|of| of.clearcoat.as_mut());
        coat.expect("a coat").factor = 1.0;
    };
    let still = scene(|_| (), lamp(2.0), true);
    let still_scene = still.build_with(&traits(4, &properties));
    let wanted = scene(set, lamp(9.0), false);
    let wanted = wanted.build_with(&traits(3, &properties));

    let worlds = still.desc.world_from_nodes();
    let light = lamp(9.0);
    let nodes = |is_hidden: bool, light| {
        [
            MovedNode { light, ..MovedNode::new(2, worlds[2], &[]) },
            MovedNode { is_hidden, ..MovedNode::new(3, worlds[3], &[]) },
        ]
    };
    let changed = [ChangedMaterial { material: 0, values }];
    let at = |nodes: &[MovedNode<'_>], changed: &[ChangedMaterial]| {
        still_scene.at_moment(gpu(), nodes, &[], changed).expect("it moves")
    };
    let view = look(DVec3::new(0.3, 0.4, 3.0), DVec3::ZERO, SIZE);
    let picture = |scene: &GpuScene| draw(scene, SIZE, &view);
    let before = picture(&still_scene);
    let wanted = picture(&wanted);
    assert!(differences(&before, &wanted)[2] > 1000, "the moment differs from what is still");
    let moment = at(&nodes(true, Some(&light)), &changed);
    assert_eq!(differences(&picture(&moment), &wanted), [0; 3]);

    // As it was again, in the same buffers.
    let rest = vec![
        (Of::BaseColor, vec![1.0; 4]),
        (Of::Roughness, vec![1.0]),
        (Of::EmissiveColor, vec![0.0; 3]),
        (Of::EmissiveStrength, vec![1.0]),
        (Of::UvOffset(0), vec![0.0; 2]),
        (Of::UvRotation(0), vec![0.0]),
        (Of::UvScale(0), vec![1.0; 2]),
        (Of::ClearcoatFactor, vec![0.0]),
    ];
    let again = at(&nodes(false, None), &[ChangedMaterial { material: 0, values: rest }]);
    assert_eq!(differences(&picture(&again), &before), [0; 3]);
    // A lamp that is hidden gives no light.
    let dark = [MovedNode { is_hidden: true, ..MovedNode::new(2, worlds[2], &[]) }];
    let dark = picture(&at(&dark, &[]));
    let black = scene(|_| (), lamp(0.0), true).build_with(&traits(4, &properties));
    assert_eq!(differences(&dark, &picture(&black)), [0; 3]);
}

#[test]
fn a_material_that_clips_change_no_more_has_its_own_values_again() {
    let still = scene(|_| (), lamp(2.0), true);
    let changing = still.build_with(&traits(4, &[MaterialProperty::BaseColor]));
    let values = vec![(MaterialProperty::BaseColor, vec![0.1, 0.5, 1.0, 1.0])];
    let changed = [ChangedMaterial { material: 0, values }];
    let ball = [MovedNode::new(3, still.desc.world_from_nodes()[3], &[])];
    let moment = changing.at_moment(gpu(), &ball, &[], &changed).expect("it moves");
    // Somebody wrote the values of the file into it, which clips leave alone from then on.
    let edited = traits(4, &[]);
    let layout = SceneLayout::with_traits(still.desc.clone(), &edited, &|| false).expect("sound");
    let after = changing.with_layout(gpu(), Arc::new(layout), None).expect("the same scene");
    let view = look(DVec3::new(0.3, 0.4, 3.0), DVec3::ZERO, SIZE);
    let [during, after, wanted] =
        [&moment, &after, &still.build_with(&edited)].map(|scene| draw(scene, SIZE, &view));
    assert!(differences(&during, &wanted)[2] > 300, "clips had changed it");
    assert_eq!(differences(&after, &wanted), [0; 3]);
}

#[test]
fn materials_that_stay_as_they_are_keep_their_bindings_beside_others() {
    let mut stage = scene(|_| (), lamp(2.0), true);
    let second = stage.material(matt(0.2, 0.6, 0.9));
    let tile = MeshFixture::rectangle(0.4, 0.4);
    let mesh = stage.mesh(&tile, Some(second));
    stage.node(mesh, DAffine3::from_translation(DVec3::new(0.0, -1.0, 0.5)));
    let styled = |stage: &SceneFixture| traits(stage.desc.nodes.len(), &[]);
    let first = stage.build_with(&styled(&stage));
    let is_shared = |scene: &GpuScene, number: u32, now: u32| {
        let [before, now] = [first.materials.get(number), scene.materials.get(now)];
        std::ptr::eq(before.expect("it is drawn"), now.expect("it is drawn"))
    };
    let view = look(DVec3::new(0.3, 0.4, 4.0), DVec3::ZERO, SIZE);
    let check = |stage: &SceneFixture, scene: &GpuScene| {
        let wanted = draw(&stage.build_with(&styled(stage)), SIZE, &view);
        assert_eq!(differences(&draw(scene, SIZE, &view), &wanted), [0; 3]);
    };
    let layout = |stage: &SceneFixture| {
        let layout = SceneLayout::with_traits(stage.desc.clone(), &styled(stage), &|| false);
        Arc::new(layout.expect("sound"))
    };
    // One of them is edited; the default material and a styled one stand behind both.
    stage.desc.materials[1] = matt(0.9, 0.2, 0.1);
    let edited = first.with_layout(gpu(), layout(&stage), None).expect("the same scene");
    assert_eq!([0, 1, 2, 3].map(|at| is_shared(&edited, at, at)), [true, false, true, true]);
    check(&stage, &edited);

    // Another one is added, and moves the default one, which the ball has, to another number.
    let third = stage.material(matt(0.5, 0.5, 0.1));
    let mesh = stage.mesh(&tile, Some(third));
    stage.node(mesh, DAffine3::from_translation(DVec3::new(0.0, 1.0, 0.5)));
    let mut builder = SceneBuilder::of(gpu(), layout(&stage)).expect("room").sharing(&first);
    builder.upload_primitive(gpu(), mesh as usize, 0, &tile.bytes()).expect("uploaded");
    let added = builder.finish(gpu()).expect("all is there");
    assert!(
        [(0, 0), (2, 3), (3, 4)].into_iter().all(|(number, now)| is_shared(&added, number, now))
    );
    check(&stage, &added);
}

#[test]
fn each_of_many_tints_is_found_in_another_layout() {
    let mut stage = SceneFixture::new();
    let materials = [matt(0.2, 0.6, 0.9), matt(0.9, 0.2, 0.1)].map(|of| stage.material(of));
    let meshes = materials.map(|of| stage.mesh(&MeshFixture::rectangle(0.4, 0.4), Some(of)));
    for node in 0..600 {
        stage.node(meshes[node % 2], DAffine3::IDENTITY);
    }
    // Tints that come more than once, and unlit ones beside them.
    let style = |node: usize, of: usize| {
        let color = Vec3::new((of % 19) as f32, (of % 7) as f32, 1.0) / 19.0;
        let highlight = Some(Highlight::Tint { color, share: 0.5 });
        let shading = node.is_multiple_of(3).then_some(Shading::Unlit);
        NodeStyle { highlight, shading, ..NodeStyle::default() }
    };
    let layout = |first: usize| {
        let styles: Vec<_> = (0..600).map(|node| style(node, first + node % 100)).collect();
        let traits = NodeTraits { styles: styles.clone(), ..NodeTraits::of_file(600) };
        let layout = SceneLayout::with_traits(stage.desc.clone(), &traits, &|| false);
        (layout.expect("sound"), styles)
    };
    let ((one, styles), (other, others)) = (layout(0), layout(50));
    let number = |of: &SceneLayout, node: usize| of.batches[of.items[node].batch as usize].material;
    let mut found = 0;
    for (node, style) in styles.iter().enumerate() {
        let is_it = |at: &usize| others[*at] == *style && at % 2 == node % 2;
        let wanted = (0..600).find(is_it).map(|at| number(&other, at));
        assert_eq!(one.same_material(number(&one, node), &other), wanted, "node {node}");
        found += usize::from(wanted.is_some());
    }
    assert!((1..600).contains(&found), "{found} of 600");
}
