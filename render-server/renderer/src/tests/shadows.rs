//! Shadows of directional lights, against rays that are cast from each pixel in f64.

use glam::{DAffine3, DQuat, DVec3, DVec4, Vec2, Vec3, Vec4};
use polyptych_renderer::{DrawStats, Renderer, Target, read_pixels};
use polyptych_scene::{AlphaMode, Light, LightKind, Material, NodeId, SceneSubset};
use polyptych_wall::ShadowFilter;

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, gpu, look, matt, pixel,
};
use crate::scene::Bounds;
use crate::{GpuScene, ViewDesc};

const SIZE: [u32; 2] = [320, 240];

/// The shadows whose edges are no steps.
pub(super) const PENUMBRAS: [ShadowFilter; 2] =
    [ShadowFilter::Soft, ShadowFilter::ContactHardening];

/// Half of the floor's side, in metres.
const FLOOR: f64 = 60.0;

/// A cube of half sides 1 around its origin.
pub(super) fn cube() -> MeshFixture {
    let mut shape = MeshFixture::default();
    for (n, t) in [
        (Vec3::X, Vec3::Y),
        (Vec3::NEG_X, Vec3::Z),
        (Vec3::Y, Vec3::Z),
        (Vec3::NEG_Y, Vec3::X),
        (Vec3::Z, Vec3::X),
        (Vec3::NEG_Z, Vec3::Y),
    ] {
        let first = shape.vertices.len() as u32;
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            shape.push(n + t * x + n.cross(t) * y, n, t, Vec2::ZERO);
        }
        shape.indices.extend([0, 1, 2, 0, 2, 3].map(|at| first + at));
    }
    shape
}

/// Boxes on a floor, and one that hovers.
pub(super) fn boxes() -> Vec<Bounds> {
    let around = |center: [f64; 3], half: [f64; 3]| {
        let (center, half) = (DVec3::from(center), DVec3::from(half));
        Bounds { min: center - half, max: center + half }
    };
    vec![
        around([0.0, 1.0, 0.0], [1.0, 1.0, 1.0]),
        around([3.5, 2.0, -2.0], [0.4, 2.0, 0.4]),
        around([-3.0, 0.6, 1.5], [0.6, 0.6, 1.2]),
        around([-1.0, 4.0, -3.0], [2.0, 0.1, 1.0]),
        around([14.0, 3.0, -12.0], [1.0, 3.0, 1.0]),
    ]
}

/// The direction towards a sun so high over the horizon.
pub(super) fn toward(elevation_deg: f64, azimuth_deg: f64) -> DVec3 {
    let (up, across) = elevation_deg.to_radians().sin_cos();
    let (x, z) = azimuth_deg.to_radians().sin_cos();
    DVec3::new(x * across, up, z * across)
}

pub(super) fn sun(stage: &mut SceneFixture, toward: DVec3) {
    let light =
        Light { kind: LightKind::Directional, color: Vec3::ONE, intensity: 3.0, range: None };
    stage.light(light, DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::NEG_Z, -toward)));
}

/// Boxes of a material on a matt floor, without light but that of a sun; the floor is the first
/// node, and all of it stands around a place.
pub(super) fn town(place: DVec3, of_boxes: Material, suns: &[DVec3]) -> SceneFixture {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::ZERO;
    let grey = stage.material(matt(0.6, 0.6, 0.6));
    let of_boxes = stage.material(of_boxes);
    let floor = stage.mesh(&MeshFixture::rectangle(FLOOR as f32, FLOOR as f32), Some(grey));
    let shape = stage.mesh(&cube(), Some(of_boxes));
    let flat = DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    stage.node(floor, DAffine3::from_translation(place) * flat);
    for of in boxes() {
        let (half, at) = (of.half(), place + of.center());
        stage.node(shape, DAffine3::from_scale_rotation_translation(half, DQuat::IDENTITY, at));
    }
    for toward in suns {
        sun(&mut stage, *toward);
    }
    stage
}

pub(super) fn grey() -> Material {
    matt(0.6, 0.6, 0.6)
}

fn view(place: DVec3) -> ViewDesc {
    look(place + DVec3::new(3.0, 5.0, 11.0), place + DVec3::new(0.0, 0.5, -1.0), SIZE)
}

/// The distance along a ray at which it enters a box.
pub(super) fn entry(of: &Bounds, origin: DVec3, ray: DVec3) -> Option<f64> {
    let (a, b) = ((of.min - origin) / ray, (of.max - origin) / ray);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    (near <= far && near > 0.0).then_some(near)
}

/// The first surface along a ray: its place, and its normal.
fn hit(origin: DVec3, ray: DVec3) -> Option<(DVec3, DVec3)> {
    let floor = Some(-origin.y / ray.y).filter(|along| *along > 0.0);
    let floor = floor.map(|along| (along, DVec3::Y));
    let floor = floor.filter(|(along, _)| (origin + ray * *along).abs().max_element() <= FLOOR);
    let boxes = boxes().into_iter().filter_map(|of| {
        let along = entry(&of, origin, ray)?;
        let from = (origin + ray * along - of.center()) / of.half();
        let axis = from.abs().max_position();
        let mut normal = DVec3::ZERO;
        normal[axis] = from[axis].signum();
        Some((along, normal))
    });
    let nearest = boxes.chain(floor).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map(|(along, normal)| (origin + ray * along, normal))
}

/// The light of a pixel that a ray finds: `None` where it is dark whatever is in its way.
fn is_lit(view: &ViewDesc, place: DVec3, toward: DVec3, [x, y]: [u32; 2]) -> Option<bool> {
    let [width, height] = SIZE.map(f64::from);
    let ndc = [(f64::from(x) + 0.5) / width * 2.0 - 1.0, 1.0 - (f64::from(y) + 0.5) / height * 2.0];
    let in_view = view.clip_from_view.inverse() * DVec4::new(ndc[0], ndc[1], 1.0, 1.0);
    let ray = view.view_from_world.transpose() * (in_view.truncate() / in_view.w);
    let (at, normal) = hit(view.eye_in_world - place, ray)?;
    let above = at + normal * 1e-6;
    let is_free = || boxes().iter().all(|of| entry(of, above, toward).is_none());
    (normal.dot(toward) > 1e-6).then(is_free)
}

/// Pixels that are wrong, and those that a sun could light.
fn wrong(toward: DVec3, place: DVec3, filter: ShadowFilter) -> [usize; 2] {
    let mut stage = Stage::new(town(place, grey(), &[toward]).build(), SIZE, filter);
    let view = view(place);
    let got = stage.draw(&view).0;
    let bright = stage.draw(&ViewDesc { has_shadows: false, ..view.clone() }).0;
    let mut counts = [0; 2];
    for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
        let Some(wanted) = is_lit(&view, place, toward, [x, y]) else { continue };
        let [got, bright] = [&got, &bright].map(|of| f64::from(pixel(of, SIZE, x, y)[0]));
        // The code of half of the light.
        counts[0] += usize::from(wanted != (got > 0.73 * bright));
        counts[1] += 1;
    }
    counts
}

#[test]
fn shadows_are_where_rays_find_them() {
    for (filter, most) in [
        (ShadowFilter::Hard, 0.004),
        (ShadowFilter::Soft, 0.0075),
        (ShadowFilter::ContactHardening, 0.0075),
    ] {
        let (mut worst, mut report) = (0.0f64, Vec::new());
        for elevation in [90.0, 75.0, 50.0, 30.0, 15.0] {
            for azimuth in [20.0, 140.0, 260.0] {
                let [wrong, all] = wrong(toward(elevation, azimuth), DVec3::ZERO, filter);
                let share = wrong as f64 / all as f64;
                report.push(format!("{filter:?} {elevation}° {azimuth}°: {wrong} of {all}"));
                worst = worst.max(share);
            }
        }
        let report = report.join("\n");
        println!("{report}\n{filter:?}: at most {:.3} %", worst * 100.0);
        assert!(worst < most, "{report}\n{filter:?}: {worst} of the pixels are wrong");
    }
}

#[test]
fn what_the_sun_meets_first_has_no_shadow_of_its_own() {
    let cases = [90.0, 60.0, 30.0, 10.0, 4.0].map(|of| PENUMBRAS.map(|filter| (of, filter)));
    for (elevation, filter) in cases.into_iter().flatten() {
        let mut stage = SceneFixture::new();
        stage.desc.sky = Vec3::ZERO;
        let grey = stage.material(grey());
        let floor = stage.mesh(&MeshFixture::rectangle(FLOOR as f32, FLOOR as f32), Some(grey));
        let ball = stage.mesh(&MeshFixture::sphere(48), Some(grey));
        let toward = toward(elevation, 140.0);
        stage.node(floor, DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2));
        sun(&mut stage, toward);
        let changed = |stage: &SceneFixture, view: ViewDesc| {
            let off = ViewDesc { has_shadows: false, ..view.clone() };
            let [view, off] = [view, off].map(|view| shown(stage, filter, &view, SIZE));
            differences(&view, &off)
        };
        let plane = changed(&stage, view(DVec3::ZERO));
        assert_eq!(plane[1], 0, "{filter:?}, {elevation}°: a plane has stripes: {plane:?}");
        // A ball over it, seen from the sun's side: all of its light is there but at the edge.
        stage.node(ball, DAffine3::from_translation(DVec3::Y * 3.0));
        let eye = DVec3::Y * 3.0 + toward * 3.0;
        let [_, _, round] = changed(&stage, look(eye, DVec3::Y * 3.0, SIZE));
        println!("{filter:?}, {elevation}°: {round} of {}", SIZE[0] * SIZE[1]);
        assert!(round < 800, "{filter:?}, {elevation}°: {round}");
    }
}

/// One renderer, one target, frame after frame.
pub(super) struct Stage {
    renderer: Renderer,
    target: Target,
    pub scene: GpuScene,
}

impl Stage {
    pub fn new(scene: GpuScene, size: [u32; 2], shadows: ShadowFilter) -> Self {
        let mut renderer = Renderer::new(gpu(), 1).unwrap();
        renderer.set_shadows(shadows);
        renderer.prepare(gpu(), &scene);
        let target = Target::new(gpu(), size, 1, scene.has_transparency()).unwrap();
        Self { renderer, target, scene }
    }

    pub fn draw(&mut self, view: &ViewDesc) -> (Vec<[u8; 4]>, DrawStats) {
        let views = std::slice::from_ref(view);
        let stats = self.renderer.draw(gpu(), &self.scene, &mut self.target, views).unwrap();
        let pixels = read_pixels(gpu(), &self.target).unwrap();
        (pixels.as_chunks::<4>().0.to_vec(), stats)
    }
}

/// The picture of a scene with shadows of some kind.
pub(super) fn shown(
    fixture: &SceneFixture,
    filter: ShadowFilter,
    view: &ViewDesc,
    size: [u32; 2],
) -> Vec<[u8; 4]> {
    Stage::new(fixture.build(), size, filter).draw(view).0
}

/// Pixels of the four tiles of a picture that differ from the whole one; see [`differences`].
pub(super) fn tile_differences(
    (fixture, filter): (&SceneFixture, ShadowFilter),
    view: &ViewDesc,
    size: [u32; 2],
) -> [usize; 3] {
    let whole = shown(fixture, filter, view, size);
    let tile = [size[0] / 2, size[1] / 2];
    let mut total = [0; 3];
    for [x, y] in [[0, 0], [tile[0], 0], [0, tile[1]], tile] {
        let [width, height] = size.map(f64::from);
        let viewport = [-f64::from(x), -f64::from(y), width, height];
        let got = shown(fixture, filter, &ViewDesc { viewport, ..view.clone() }, tile);
        let places = (0..tile[1]).flat_map(|row| (0..tile[0]).map(move |column| [column, row]));
        let wanted: Vec<_> =
            places.map(|[left, top]| pixel(&whole, size, x + left, y + top)).collect();
        for (sum, count) in total.iter_mut().zip(differences(&got, &wanted)) {
            *sum += count;
        }
    }
    total
}

#[test]
fn tiles_have_the_shadows_of_one_camera() {
    let place = DVec3::ZERO;
    let scene = town(place, grey(), &[toward(35.0, 140.0), toward(60.0, 250.0)]);
    for filter in PENUMBRAS {
        let total = tile_differences((&scene, filter), &view(place), SIZE);
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        println!("{filter:?}: {total:?} of {pixels}");
        assert!(total[0] * 200 <= pixels, "{total:?}: more than 0.5 % differ");
        assert!(total[2] * 50_000 <= pixels, "{total:?}: more than 20 ppm by more than 8");
    }
}

#[test]
fn what_is_beside_the_channel_casts_its_shadow_into_it() {
    // The pole at the back, with a low sun behind it: only its shadow is in the picture.
    let place = DVec3::ZERO;
    let low = DVec3::new(14.0, 6.0, -12.0) - DVec3::new(7.0, 0.0, -6.0);
    let scene = town(place, grey(), &[low.normalize()]).build();
    let down = look(DVec3::new(9.0, 3.0, -7.7), DVec3::new(9.0, 0.0, -7.71), SIZE);
    let (lit, stats) = draw_sampled(&scene, SIZE, 1, std::slice::from_ref(&down));
    assert_eq!(stats.visible, 1, "only the floor is seen");
    let dark = lit.iter().filter(|of| of[0] == 0).count();
    let bright = lit.iter().filter(|of| of[0] > 100).count();
    println!("{dark} dark and {bright} bright of {}", lit.len());
    assert!(dark * 20 > lit.len() && bright * 5 > lit.len(), "{dark} and {bright}");
}

#[test]
fn a_viewer_who_moves_changes_no_edge() {
    let place = DVec3::new(1234.5, 10.0, -777.7);
    let scene = town(place, grey(), &[toward(35.0, 140.0)]);
    for filter in PENUMBRAS {
        let mut stage = Stage::new(scene.build(), SIZE, filter);
        let (first, stats) = stage.draw(&view(place));
        assert!(stats.shadow_maps >= 2, "{stats:?}");
        let (mut flickering, mut anew) = (0, 0);
        for step in 0..40 {
            // The picture stays; only the viewer whom the maps surround moves, at first by less
            // than a texel, then through cells.
            let by = 0.003 * 1.25f64.powi(step);
            let eye = view(place).eye_in_world + DVec3::new(0.3, 0.1, -0.5) * by.min(1.0);
            let moved = ViewDesc { middle_eye_in_world: eye, ..view(place) };
            let (got, stats) = stage.draw(&moved);
            anew += stats.shadow_maps;
            let is_class = |of: &[u8; 4]| of[0] > 100;
            // Where two maps are mixed, the part of each goes with the distance.
            let pairs = got.iter().zip(&first);
            flickering += pairs.filter(|(a, b)| is_class(a) != is_class(b)).count();
        }
        println!("{filter:?}: {flickering} flickering, {anew} maps drawn anew");
        assert!(anew > 0, "no cell was left");
        assert_eq!(flickering, 0);
    }
}

#[test]
fn maps_are_kept_while_nothing_changes_and_do_not_depend_on_the_past() {
    let place = DVec3::ZERO;
    let stage = town(place, grey(), &[toward(50.0, 20.0)]);
    let mut one = Stage::new(stage.build(), SIZE, ShadowFilter::Soft);
    let (first, stats) = one.draw(&view(place));
    assert!(stats.shadow_maps > 0);
    let (again, stats) = one.draw(&view(place));
    assert_eq!((stats.shadow_maps, differences(&again, &first)), (0, [0; 3]));
    // A walk, and back again; another renderer has never been elsewhere.
    for step in 1..6 {
        let to = DVec3::new(f64::from(step), 0.0, 0.0);
        one.draw(&ViewDesc { eye_in_world: view(place).eye_in_world + to, ..view(place) });
        let moved = ViewDesc { middle_eye_in_world: view(place).eye_in_world + to, ..view(place) };
        let got = one.draw(&moved).0;
        assert_eq!(differences(&got, &draw(&stage.build(), SIZE, &moved)), [0; 3], "step {step}");
    }
    assert_eq!(differences(&one.draw(&view(place)).0, &first), [0; 3]);
    // A head that is tracked, and a bound that follows the rate, change what is allowed.
    for step in 0..4 {
        let mut view = view(place);
        view.allowed_error.angle_rad = f64::from(step) * 0.001;
        view.allowed_error.follows_rate = step < 2;
        let drawn = one.draw(&view).1.shadow_maps;
        assert_eq!(drawn > 0, step == 0, "step {step} has drawn {drawn}");
    }
    // Another scene on the same renderer.
    let mut higher = town(place, grey(), &[toward(50.0, 20.0)]);
    higher.desc.nodes[1].local.translation.y += 1.0;
    one.scene = higher.build();
    let (got, stats) = one.draw(&view(place));
    assert!(stats.shadow_maps > 0 && differences(&got, &first)[2] > 100);
    let off = ViewDesc { has_shadows: false, ..view(place) };
    assert_eq!(one.draw(&off).1.shadow_maps, 0);
}

#[test]
fn maps_of_a_viewer_who_comes_nearer_do_not_pile_up() {
    let suns = [20.0, 110.0, 200.0, 290.0].map(|azimuth| toward(50.0, azimuth));
    let fixture = town(DVec3::ZERO, grey(), &suns);
    let mut stage = Stage::new(fixture.build(), SIZE, ShadowFilter::Soft);
    // The nearer, the more maps, and none has been in a set of so many before.
    for (height, maps) in [(100.0, 4), (20.0, 8), (6.0, 12), (20.0, 0)] {
        let view = look(DVec3::new(0.0, height, 0.1), DVec3::ZERO, SIZE);
        let (pixels, stats) = stage.draw(&view);
        assert!(stats.shadow_maps >= maps, "{height} m: {stats:?}");
        let [of_suns, of_lamps] = stage.renderer.shadows.held_bytes();
        assert!(of_suns <= 256 << 20 && of_lamps == 0, "{height} m: {of_suns} bytes");
        assert!(of_suns >= u64::from(maps) << 24, "{height} m: {of_suns} bytes");
        assert_eq!(differences(&pixels, &draw(&fixture.build(), SIZE, &view)), [0; 3]);
    }
}

#[test]
fn channels_of_two_cameras_keep_more_maps_than_those_of_one() {
    let suns = [20.0, 110.0, 200.0, 290.0].map(|azimuth| toward(50.0, azimuth));
    let scene = town(DVec3::ZERO, grey(), &suns).build();
    // 8 maps and 12, of 16 MiB each.
    let views = [20.0, 6.0].map(|height| look(DVec3::new(0.0, height, 0.1), DVec3::ZERO, SIZE));
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.set_shadows(ShadowFilter::Soft);
    renderer.prepare(gpu(), &scene);
    let is_light = scene.has_transparency();
    let mut targets = [0; 2].map(|_| Target::new(gpu(), SIZE, 1, is_light).unwrap());
    for round in 0..3 {
        let begin = |(view, target): (&ViewDesc, &mut Target)| {
            renderer.begin(gpu(), &scene, target, std::slice::from_ref(view)).unwrap()
        };
        let begun: Vec<_> = views.iter().zip(&mut targets).map(begin).collect();
        let submit = |(begun, target)| renderer.submit(gpu(), &scene, target, begun).unwrap();
        let submitted: Vec<_> = begun.into_iter().zip(&mut targets).map(submit).collect();
        let finish = |(frame, target)| renderer.finish(gpu(), target, frame).unwrap().shadow_maps;
        let drawn: u32 = submitted.into_iter().zip(&mut targets).map(finish).sum();
        assert_eq!(drawn >= 20, round == 0, "round {round}: {drawn} maps");
        assert!(round == 0 || drawn == 0, "round {round}: {drawn} maps");
        assert!(renderer.shadows.held_bytes()[0] >= 20 << 24);
    }
}

#[test]
fn scenes_without_suns_of_their_own_have_no_maps() {
    let dark = town(DVec3::ZERO, grey(), &[]).build();
    assert!(dark.layout.keys.iter().all(|key| !key.has_shadows()));
    let (pixels, stats) = draw_sampled(&dark, SIZE, 1, &[view(DVec3::ZERO)]);
    assert_eq!(stats.shadow_maps, 0);
    let off = ViewDesc { has_shadows: false, ..view(DVec3::ZERO) };
    assert_eq!(differences(&pixels, &draw(&dark, SIZE, &off)), [0; 3]);
}

/// Pixels that are darker than without shadows.
pub(super) fn shadowed(scene: &GpuScene, view: &ViewDesc) -> usize {
    let off = ViewDesc { has_shadows: false, ..view.clone() };
    let (got, bright) = (draw(scene, SIZE, view), draw(scene, SIZE, &off));
    got.iter().zip(&bright).filter(|(got, bright)| bright[1].saturating_sub(got[1]) > 50).count()
}

#[test]
fn masks_cast_where_they_are_and_blends_cast_nothing() {
    let with = |alpha_mode, alpha: f32| {
        let base_color = Vec4::new(0.6, 0.6, 0.6, alpha);
        let material = Material { base_color, alpha_mode, ..grey() };
        shadowed(&town(DVec3::ZERO, material, &[toward(40.0, 140.0)]).build(), &view(DVec3::ZERO))
    };
    let solid = with(AlphaMode::Opaque, 1.0);
    assert!(solid > 2000, "{solid}");
    assert_eq!(with(AlphaMode::Mask(0.5), 0.6), solid);
    assert_eq!(with(AlphaMode::Mask(0.5), 0.4), 0);
    assert_eq!(with(AlphaMode::Blend, 0.9), 0);
}

#[test]
fn what_a_view_does_not_show_casts_no_shadow_in_it() {
    let scene = town(DVec3::ZERO, grey(), &[toward(40.0, 140.0)]).build();
    let all = view(DVec3::ZERO);
    let only = SceneSubset { root: Some(NodeId(0)), layers: None };
    let floor = ViewDesc { subset: only, ..all.clone() };
    assert!(shadowed(&scene, &all) > 2000);
    assert_eq!(shadowed(&scene, &floor), 0);
    // Side by side in one picture, of one eye: each has its own.
    let [left, right] = [[0, 0, 160, 240], [160, 0, 160, 240]].map(Some);
    let halves =
        [ViewDesc { scissor: left, ..all.clone() }, ViewDesc { scissor: right, ..floor.clone() }];
    let both = draw_sampled(&scene, SIZE, 1, &halves).0;
    let [all, floor] = [all, floor].map(|view| draw(&scene, SIZE, &view));
    for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
        let wanted = pixel(if x < 160 { &all } else { &floor }, SIZE, x, y);
        assert_eq!(pixel(&both, SIZE, x, y), wanted, "{x}, {y}");
    }
}

#[test]
fn shadows_far_from_the_origin_look_the_same() {
    let toward = toward(35.0, 140.0);
    let at = |place| draw(&town(place, grey(), &[toward]).build(), SIZE, &view(place));
    let (near, far) = (at(DVec3::ZERO), at(DVec3::new(1e7, -2.5e6, 0.75e7)));
    // The grid of the maps stands elsewhere under the scene: edges differ by parts of a texel.
    let [_, _, more_than_8] = differences(&near, &far);
    println!("{more_than_8} of {} by more than 8 levels", near.len());
    assert!(more_than_8 * 200 <= near.len(), "{more_than_8}");
}

/// A town in a light, in a dome of a material and a radius.
fn domed(is_sun: bool, dome: Option<(Material, f64)>) -> SceneFixture {
    let suns = [toward(40.0, 140.0)];
    let mut stage = town(DVec3::ZERO, grey(), if is_sun { &suns[..] } else { &[] });
    if !is_sun {
        let light =
            Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 300.0, range: None };
        stage.light(light, DAffine3::from_translation(DVec3::new(-5.0, 7.0, 5.0)));
    }
    if let Some((material, radius)) = dome {
        let material = stage.material(Material { double_sided: true, ..material });
        let dome = stage.mesh(&MeshFixture::sphere(24), Some(material));
        stage.node(dome, DAffine3::from_scale(DVec3::splat(radius)));
    }
    stage
}

#[test]
fn a_sky_casts_no_shadow_and_leaves_those_of_its_scene() {
    // Nothing of the dome is seen.
    let down = look(DVec3::new(3.0, 14.0, 9.0), DVec3::new(0.0, 0.0, -1.0), SIZE);
    for (is_sun, radius) in [(true, 1e5), (false, 1e6)] {
        let glowing = Material { emissive: Vec3::splat(0.2), ..matt(0.0, 0.0, 0.0) };
        let mut stage = domed(is_sun, Some((glowing, radius)));
        let plain = draw(&domed(is_sun, None).build(), SIZE, &down);
        let before = stage.build();
        if is_sun {
            let lit = draw(&before, SIZE, &down).iter().filter(|pixel| pixel[0] > 60).count();
            assert_eq!(lit, 0, "what is no sky is before the sun");
        } else {
            assert_eq!(shadowed(&before, &down), 0, "all is as near to the lamp as its bulb");
        }
        stage.desc.nodes.last_mut().unwrap().is_sky = true;
        let scene = stage.build();
        assert_eq!(differences(&draw(&scene, SIZE, &down), &plain), [0; 3]);
        assert!(shadowed(&scene, &down) > 500, "the boxes have shadows");
    }
}

#[test]
fn a_sky_that_takes_light_has_it_behind_its_scene() {
    let mut stage = domed(true, Some((grey(), 1e5)));
    stage.desc.nodes.last_mut().unwrap().is_sky = true;
    // The part that faces the sun, over the floor.
    let from_sun = -toward(40.0, 140.0);
    let ahead = DVec3::new(from_sun.x, 0.5, from_sun.z);
    let eye = DVec3::Y * 2.0 + DVec3::Z * 6.0;
    let pixels = draw(&stage.build(), SIZE, &look(eye, eye + ahead, SIZE));
    let above = pixel(&pixels, SIZE, SIZE[0] / 2, SIZE[1] / 2)[0];
    assert!(above > 60, "{above}: the sky is dark");
}

#[test]
fn a_viewer_who_is_far_from_a_scene_sees_its_shadows() {
    let mut stage = SceneFixture::new();
    let grey = stage.material(grey());
    let floor = stage.mesh(&MeshFixture::rectangle(3.0, 3.0), Some(grey));
    let shape = stage.mesh(&cube(), Some(grey));
    stage.node(floor, DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    stage.node(shape, DAffine3::from_translation(DVec3::Y));
    sun(&mut stage, toward(45.0, 200.0));
    let scene = stage.build();
    let dark_at = |away: f64| {
        let view = look(DVec3::new(0.3, 0.5, 1.0).normalize() * away, DVec3::ZERO, SIZE);
        let bright = draw(&scene, SIZE, &ViewDesc { has_shadows: false, ..view.clone() });
        let dark = draw(&scene, SIZE, &view);
        differences(&dark, &bright)[2] as f64 * away * away
    };
    // By rays in f64 122,000 and 107,200 at 20 and 40: what is nearer to the viewer looks larger.
    let near = dark_at(20.0);
    for away in [30.0, 40.0] {
        let far = dark_at(away);
        assert!((far / near - 1.0).abs() < 0.2, "{far} instead of {near} at {away}");
    }
}
