//! Degenerate input gives a picture without holes and NaN, wrong input an error that says why.

use glam::{Affine2, DAffine3, DMat3, DVec3, Vec3};
use polyptych_scene::{AlphaMode, Glow, Instance, Light, LightKind, Material, TextureRef};

use super::harness::{MeshFixture, SceneFixture, draw, drawn, gpu, look, matt, pixel};
use crate::{
    AllowedError, DrawError, Renderer, SceneBuilder, SceneError, SceneLayout, Target, ViewDesc,
};

const SIZE: [u32; 2] = [96, 96];

/// Draws a stage twice, tone-mapped inline and through the float target, and asserts that no
/// pixel is broken: NaN would come out black, and nothing here is.
fn check_no_black(stage: &mut SceneFixture, view: &ViewDesc) {
    for alpha_mode in [AlphaMode::Opaque, AlphaMode::Blend] {
        for material in &mut stage.desc.materials {
            material.alpha_mode = alpha_mode;
        }
        let scene = stage.build();
        let pixels = draw(&scene, SIZE, view);
        let black = pixels.iter().filter(|p| p[..3].iter().all(|&c| c < 3)).count();
        assert_eq!(black, 0, "{alpha_mode:?}");
    }
}

#[test]
fn degenerate_shapes_and_matrices_do_no_harm() {
    let mut stage = SceneFixture::new();
    let normals = stage.checkers(16, false);
    let normals = TextureRef { texture: normals, uv_set: 0, uv_transform: Affine2::IDENTITY };
    let material = stage.material(Material {
        normal_texture: Some(normals),
        roughness: 0.0,
        ..matt(0.9, 0.8, 0.7)
    });
    let sphere = stage.mesh(&MeshFixture::sphere(12), Some(material));
    let mut bare = MeshFixture::sphere(12);
    for vertex in &mut bare.vertices {
        vertex[3..10].fill(0.0);
    }
    let bare = stage.mesh(&bare, Some(material));
    let sliver = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
    let sliver = stage.mesh(&MeshFixture::triangle(sliver, Vec3::Y), Some(material));
    let scaled = |x: f64, y: f64, z: f64, at: DVec3| {
        DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(x, y, z)), at)
    };
    stage.node(sphere, scaled(0.0, 0.0, 0.0, DVec3::ZERO));
    stage.node(sphere, scaled(1.0, 1.0, 0.0, DVec3::X * -2.0));
    stage.node(sphere, scaled(1.0, 0.0, 0.0, DVec3::X));
    stage.node(sphere, scaled(-1.0, 0.3, 1.0, DVec3::X * 2.0));
    stage.node(sphere, scaled(1e-7, 1e-7, 1e-7, DVec3::Y));
    stage.node(bare, scaled(0.5, 0.5, 0.5, DVec3::Y * -1.0));
    stage.node(sliver, DAffine3::IDENTITY);
    let view = look(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, SIZE);
    check_no_black(&mut stage, &view);
    assert!(drawn(&draw(&stage.build(), SIZE, &view)) > 400);
}

#[test]
fn lamps_at_the_surface_and_closed_cones_do_no_harm() {
    let mut stage = SceneFixture::new();
    let material = stage.material(matt(0.9, 0.8, 0.7));
    let floor = stage.mesh(&MeshFixture::rectangle(5.0, 5.0), Some(material));
    stage.node(floor, DAffine3::IDENTITY);
    let lamp = |kind, range| Light { kind, color: Vec3::ONE, intensity: 30.0, range };
    let closed = LightKind::Spot { inner_rad: 0.0, outer_rad: 0.0 };
    stage.light(lamp(LightKind::Point, Some(3.0)), DAffine3::IDENTITY);
    stage.light(lamp(LightKind::Point, None), DAffine3::from_translation(DVec3::Z * 1e-9));
    stage.light(lamp(LightKind::Point, None), DAffine3::from_translation(DVec3::Z * 0.5));
    stage.light(lamp(closed, None), DAffine3::from_translation(DVec3::Z * 2.0));
    stage.light(lamp(LightKind::Point, Some(0.0)), DAffine3::from_scale(DVec3::ZERO));
    stage.light(lamp(closed, Some(1.0)), DAffine3::from_scale(DVec3::ZERO));
    let view = look(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, SIZE);
    check_no_black(&mut stage, &view);
    let middle = pixel(&draw(&stage.build(), SIZE, &view), SIZE, 48, 48);
    assert!(middle[0] > 200, "under the lamp: {middle:?}");
}

#[test]
fn infinite_light_stays_within_the_target() {
    let mut stage = SceneFixture::new();
    let material =
        stage.material(Material { emissive: Vec3::splat(f32::INFINITY), ..matt(0.9, 0.8, 0.7) });
    let sphere = stage.mesh(&MeshFixture::sphere(12), Some(material));
    stage.node(sphere, DAffine3::IDENTITY);
    let view = look(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, SIZE);
    check_no_black(&mut stage, &view);
    let middle = pixel(&draw(&stage.build(), SIZE, &view), SIZE, 48, 48);
    assert!(middle[..3].iter().all(|&c| c > 250), "{middle:?}");
}

#[test]
fn a_sun_straight_above_lights_as_one_aslant_does() {
    // A frame of reference for light must not need an "up" that the sun is not parallel to.
    let lit = |turn: DAffine3| {
        let mut stage = SceneFixture::new();
        let material = stage.material(matt(0.5, 0.5, 0.5));
        let mesh = stage.mesh(&MeshFixture::rectangle(2.0, 2.0), Some(material));
        stage.node(mesh, turn);
        let sun =
            Light { kind: LightKind::Directional, color: Vec3::ONE, intensity: 2.0, range: None };
        stage.light(sun, turn);
        stage.desc.sky = Vec3::ZERO;
        let eye = turn.transform_point3(DVec3::Z * 3.0);
        pixel(&draw(&stage.build(), SIZE, &look(eye, DVec3::ZERO, SIZE)), SIZE, 48, 48)
    };
    let aslant = lit(DAffine3::from_rotation_x(-0.4));
    assert!(aslant[0] > 60, "{aslant:?}");
    for up in [-1.0, 1.0] {
        let along_up = lit(DAffine3::from_rotation_x(up * std::f64::consts::FRAC_PI_2));
        let most = along_up.iter().zip(aslant).map(|(a, b)| a.abs_diff(b)).max();
        assert!(most <= Some(1), "{along_up:?} instead of {aslant:?}");
    }
}

#[test]
fn a_black_frame_stays_black_under_any_exposure() {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::ZERO;
    let black = Material { unlit: true, ..matt(0.0, 0.0, 0.0) };
    for alpha_mode in [AlphaMode::Opaque, AlphaMode::Blend] {
        let material = stage.material(Material { alpha_mode, ..black.clone() });
        let sphere = stage.mesh(&MeshFixture::sphere(12), Some(material));
        stage.node(sphere, DAffine3::IDENTITY);
        let scene = stage.build();
        for exposure in [0.0, 1.0, 1e30, f32::MAX] {
            let view = ViewDesc { exposure, ..look(DVec3::Z * 3.0, DVec3::ZERO, SIZE) };
            let pixels = draw(&scene, SIZE, &view);
            assert!(pixels.iter().all(|p| p[..3] == [0; 3]), "{alpha_mode:?} at {exposure}");
        }
    }
}

#[test]
fn up_parallel_to_the_view_is_a_view() {
    let mut stage = SceneFixture::new();
    let material = stage.material(matt(0.9, 0.8, 0.7));
    let sphere = stage.mesh(&MeshFixture::sphere(12), Some(material));
    stage.node(sphere, DAffine3::IDENTITY);
    check_no_black(&mut stage, &look(DVec3::Y * 4.0, DVec3::ZERO, SIZE));
}

#[test]
fn wrong_uploads_say_both_sizes_and_the_index() {
    let mut stage = SceneFixture::new();
    stage.checkers(4, true);
    let shape = MeshFixture::rectangle(1.0, 1.0);
    let mesh = stage.mesh(&shape, None);
    stage.node(mesh, DAffine3::IDENTITY);
    let mut builder = SceneBuilder::new(gpu(), stage.desc.clone()).unwrap();
    let error = builder.upload_texture(gpu(), 0, &[0; 12]).unwrap_err();
    assert_eq!(error.to_string(), "texture 0 has 12 bytes, where its description says 84");
    let error = builder.upload_primitive(gpu(), 0, 0, &[0; 12]).unwrap_err();
    assert!(error.to_string().contains("has 12 bytes, where its description says 216"), "{error}");
    let mut beyond = shape.clone();
    beyond.indices[4] = 4;
    let error = builder.upload_primitive(gpu(), 0, 0, &beyond.bytes()).unwrap_err();
    assert_eq!(error.to_string(), "primitive 0 of mesh 0 has the index 4, but only 4 vertices");
    assert!(builder.upload_texture(gpu(), 1, &[]).is_err());
    builder.upload_texture(gpu(), 0, &[0; 84]).unwrap();
    let Err(SceneError::Missing(what)) = builder.finish(gpu()) else { panic!("not missed") };
    assert_eq!(what, "primitive 0 of mesh 0");
    assert_eq!(gpu().take_error(), None);
}

#[test]
fn wrong_meshlets_and_coarser_indices_are_refused_by_name() {
    let shape = MeshFixture { coarser_indices: vec![0, 1, 2], ..MeshFixture::rectangle(1.0, 1.0) };
    let shape = shape.with_meshlets(1);
    let check = |spoil: fn(&mut MeshFixture), wanted: &str| {
        let mut shape = shape.clone();
        spoil(&mut shape);
        let mut stage = SceneFixture::new();
        stage.mesh(&shape, None);
        let mut builder = SceneBuilder::new(gpu(), stage.desc.clone()).unwrap();
        let error = builder.upload_primitive(gpu(), 0, 0, &shape.bytes()).unwrap_err().to_string();
        assert!(error.contains("primitive 0 of mesh 0") && error.contains(wanted), "{error}");
    };
    check(|s| s.coarser_indices[2] = 4, "has the index 4, but only 4 vertices");
    check(|s| s.meshlets[1].error = f32::NAN, "meshlet 1: its errors are not in order");
    check(|s| s.meshlets[1].first_index = 9, "meshlet 1: its indices are not whole triangles");
    check(|s| s.meshlets.truncate(1), "the finest level has 3 indices");
    assert_eq!(gpu().take_error(), None);
}

#[test]
fn equal_contents_are_uploaded_once() {
    let mut stage = SceneFixture::new();
    let shape = MeshFixture::rectangle(1.0, 1.0);
    let (a, b) = (stage.mesh(&shape, None), stage.mesh(&shape, None));
    for mesh in [a, b] {
        stage.node(mesh, DAffine3::from_translation(DVec3::X * f64::from(mesh)));
    }
    let mut builder = SceneBuilder::new(gpu(), stage.desc.clone()).unwrap();
    builder.upload_primitive(gpu(), 1, 0, &shape.bytes()).unwrap();
    let scene = builder.finish(gpu()).unwrap();
    assert_eq!((scene.item_count(), scene.layout.batches.len(), scene.geometries.len()), (2, 1, 1));
}

#[test]
fn indices_that_point_nowhere_are_refused() {
    let check = |spoil: fn(&mut SceneFixture), wanted: &str| {
        let mut stage = SceneFixture::new();
        let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), None);
        stage.node(mesh, DAffine3::IDENTITY);
        spoil(&mut stage);
        let error = SceneBuilder::new(gpu(), stage.desc).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    check(|s| s.desc.nodes[0].mesh = Some(1), "node 0 names a mesh");
    check(|s| s.desc.nodes[0].parent = Some(0), "stands before its parent");
    check(|s| s.desc.nodes[0].local.translation.x = f64::NAN, "not finite");
    check(|s| s.desc.meshes[0].primitives[0].material = Some(0), "names a material");
    check(|s| s.desc.meshes[0].primitives[0].index_count = 0, "of nothing");
}

#[test]
fn what_is_larger_than_a_gpu_holds_is_named_with_the_limit_and_the_way_out() {
    let mut stage = SceneFixture::new();
    let (small, large) = (stage.checkers(4, true), stage.checkers(64, true));
    assert_eq!((small, large), (0, 1));
    let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), None);
    stage.node(mesh, DAffine3::IDENTITY);
    stage.desc.meshes[0].name = "tower".into();
    let bytes = stage.desc.meshes[0].primitives[0].geometry_bytes();
    let layout = SceneLayout::new(stage.desc, &|| false).expect("sound");
    assert_eq!(layout.size_fault(64, bytes), None);
    let fault = layout.size_fault(63, bytes).expect("a texture is too large");
    let holds = "where this server's GPU holds";
    let way_out = "or draw it with another GPU";
    let wanted = format!(
        "texture 1 has 64 × 64 pixels, {holds} 63 a side; give it a smaller image, {way_out}"
    );
    assert_eq!(SceneError::TooLarge(fault).to_string(), wanted);
    let fault = layout.size_fault(64, bytes - 1).expect("a primitive is too large");
    let limit = bytes - 1;
    let wanted = format!(
        "mesh 0 (\"tower\") has a primitive of {bytes} bytes, {holds} {limit} in a buffer; divide \
         it, {way_out}"
    );
    assert_eq!(fault, wanted);
}

#[test]
fn what_does_not_fit_together_is_an_error() {
    assert!(Target::new(gpu(), [0, 5], 1, false).is_err());
    assert!(Target::new(gpu(), [5, 1 << 20], 1, false).is_err());
    assert!(Target::new(gpu(), [5, 5], 2, false).is_err());
    let mut stage = SceneFixture::new();
    let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), None);
    stage.node(mesh, DAffine3::IDENTITY);
    let scene = stage.build();
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    let mut target = Target::new(gpu(), SIZE, 1, false).unwrap();
    let view = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
    let views = std::slice::from_ref(&view);
    let error = renderer.draw(gpu(), &scene, &mut target, views).unwrap_err();
    assert!(matches!(error, DrawError::NotPrepared), "{error}");
    renderer.prepare(gpu(), &scene);
    let broken = ViewDesc { exposure: f32::NAN, ..view.clone() };
    let error = renderer.draw(gpu(), &scene, &mut target, &[view.clone(), broken]).unwrap_err();
    assert!(error.to_string().contains("view 1"), "{error}");
    for wrong in [f64::NAN, f64::INFINITY, -1e-9] {
        let allowed_error = AllowedError { angle_rad: 0.0, length: wrong, ..AllowedError::NONE };
        let view = ViewDesc { allowed_error, ..view.clone() };
        let error = renderer.draw(gpu(), &scene, &mut target, &[view]).unwrap_err();
        assert!(error.to_string().contains("allowed error"), "{error}");
    }
    let glow = Some(Glow { strength: 0.5, width_degrees: 4.0 });
    let glowing = ViewDesc { glow, ..view.clone() };
    let error = renderer.draw(gpu(), &scene, &mut target, &[glowing]).unwrap_err();
    assert!(matches!(error, DrawError::Target), "{error}");
    let stats = renderer.draw(gpu(), &scene, &mut target, &[]).unwrap();
    assert_eq!(stats.draw_calls, 0);
    renderer.draw(gpu(), &scene, &mut target, views).unwrap();
}

#[test]
fn leaves_out_the_largest_levels_of_textures_but_not_all_of_them() {
    let mut stage = SceneFixture::new();
    let texture = stage.checkers(256, true);
    // The level of 256 pixels is white, that of 128 red, that of 64 green, and all others black.
    let sides = [(256, [255; 4]), (128, [255, 0, 0, 255]), (64, [0, 255, 0, 255])];
    let levels = sides.iter().flat_map(|(side, color)| color.repeat(side * side));
    let mut bytes: Vec<u8> = levels.collect();
    bytes.resize(stage.textures[0].len(), 0);
    stage.textures[0] = bytes;
    let uses = TextureRef { texture, uv_set: 0, uv_transform: Affine2::IDENTITY };
    let material = stage.material(Material {
        base_color_texture: Some(uses),
        unlit: true,
        ..matt(1.0, 1.0, 1.0)
    });
    let shape = MeshFixture::rectangle(1.0, 1.0);
    let mesh = stage.mesh(&shape, Some(material));
    stage.node(mesh, DAffine3::IDENTITY);
    // So near that no smaller level is chosen.
    let view = look(DVec3::Z * 0.4, DVec3::ZERO, SIZE);
    for (left_out, side) in [(0, 0), (1, 1), (2, 2), (4, 2)] {
        let builder = SceneBuilder::new(gpu(), stage.desc.clone()).unwrap();
        let mut builder = builder.without_levels(left_out);
        builder.upload_texture(gpu(), 0, &stage.textures[0]).unwrap();
        builder.upload_primitive(gpu(), 0, 0, &shape.bytes()).unwrap();
        let scene = builder.finish(gpu()).unwrap();
        let seen = pixel(&draw(&scene, SIZE, &view), SIZE, 48, 48);
        assert_eq!(seen[..3], sides[side].1[..3], "{left_out} levels left out");
    }
    assert_eq!(gpu().take_error(), None);
}

#[test]
fn a_heavy_scene_leaves_its_memory_when_another_one_is_drawn() {
    let scene = |copies: usize| {
        let mut stage = SceneFixture::new();
        let mesh = stage.mesh(&MeshFixture::rectangle(0.01, 0.01), None);
        let node = stage.node(mesh, DAffine3::IDENTITY) as usize;
        let (rotation, scale) = (glam::Quat::IDENTITY, Vec3::ONE);
        let copy = Instance { translation: Vec3::ZERO, rotation, scale, crowd: 0.0 };
        stage.desc.nodes[node].instances = vec![copy; copies];
        stage.build()
    };
    let (heavy, light) = (scene(100_000), scene(10));
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    let mut target = Target::new(gpu(), SIZE, 1, false).unwrap();
    let views = [look(DVec3::Z * 3.0, DVec3::ZERO, SIZE)];
    let mut held = Vec::new();
    for scene in [&heavy, &light, &heavy, &light] {
        renderer.prepare(gpu(), scene);
        let stats = renderer.draw(gpu(), scene, &mut target, &views).unwrap();
        assert_eq!(stats.visible as usize, scene.item_count());
        held.push(renderer.frames.held_bytes());
    }
    assert!(held[0] > 20_000_000 && held[2] == held[0], "{held:?}");
    assert!(held[1] < 2_000_000 && held[3] < 2_000_000, "{held:?}");
}
