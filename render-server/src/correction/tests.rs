//! Pictures of curved screens against f64: Gaussian spots in the world, whose places on the
//! display are integrated from rays.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3, UVec2, Vec3};
use polyptych_protocol::ids::{Epoch, FrameId, Revision};
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::quality_bounds::DetailBound;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::color::linear_from_srgb;
use polyptych_wall::surface::{Cylinder, Plane, Sphere};
use polyptych_wall::view::View;
use polyptych_wall::{Channel, Screen, Surface};

mod around;
#[expect(dead_code, reason = "the renderer's own tests use the rest")]
#[path = "../../renderer/src/tests/harness.rs"]
pub(crate) mod harness;
mod lays;

use harness::{MeshFixture, SceneFixture, gpu, matt};

use super::*;
use polyptych_renderer::read_picture;
use polyptych_scene::{LightKind, Material, TextureRef};

/// A bright spot that faces the origin: where it is, and its half side, in metres.
#[derive(Clone, Copy)]
struct Spot {
    place: DVec3,
    half: f64,
}

/// The position of a spot's light on the display, and its sum.
#[derive(Clone, Copy, Debug)]
struct Light {
    middle: DVec2,
    sum: f64,
}

impl Spot {
    fn rotation(&self) -> DQuat {
        DQuat::from_rotation_arc(DVec3::Z, -self.place.normalize())
    }

    /// Display light along a ray: a Gaussian of a third of the half side, tone-mapped.
    fn light(&self, eye: DVec3, ray: DVec3) -> f64 {
        let inverse = self.rotation().inverse();
        let (from, along) = (inverse * (eye - self.place), inverse * ray);
        let t = -from.z / along.z;
        let at = (from + along * t).truncate() / self.half;
        if t < 0.0 || at.abs().max_element() > 1.0 {
            return 0.0;
        }
        tone(gauss(at))
    }
}

fn gauss(at: DVec2) -> f64 {
    0.7 * (-at.length_squared() * 4.5).exp()
}

/// PBR Neutral of a grey below its shoulder.
fn tone(light: f64) -> f64 {
    if light < 0.08 { 6.25 * light * light } else { light - 0.04 }
}

/// Spots in the dark.
fn scene(spots: &[Spot]) -> GpuScene {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::ZERO;
    let texture = stage.grey(128, |u, v| gauss(DVec2::new(u, v) * 2.0 - 1.0));
    let used = TextureRef { texture, uv_set: 0, uv_transform: glam::Affine2::IDENTITY };
    let material = stage.material(Material {
        emissive: Vec3::ONE,
        emissive_texture: Some(used),
        ..matt(0.0, 0.0, 0.0)
    });
    // Without any light there would be the default sun.
    let dark = polyptych_scene::Light {
        kind: LightKind::Directional,
        color: Vec3::ZERO,
        intensity: 0.0,
        range: None,
    };
    stage.light(dark, DAffine3::IDENTITY);
    let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(material));
    for spot in spots {
        let place = DAffine3::from_scale_rotation_translation(
            DVec3::splat(spot.half),
            spot.rotation(),
            spot.place,
        );
        stage.node(mesh, place);
    }
    stage.build()
}

fn wall(surface: Surface, size: [u32; 2]) -> Wall {
    let screens = vec![Screen::new("curve", surface, UVec2::from(size))];
    let channels = vec![Channel::tile("curve", 0, UVec2::ZERO, UVec2::from(size))];
    Wall { near_m: 0.1, ..Wall::new("test", screens, channels) }
}

fn frame(head: HeadPose) -> Frame {
    Frame {
        epoch: Epoch(1),
        frame: FrameId(1),
        time_s: 0.0,
        revision: Revision(1),
        presentation: Presentation::new(head),
        capture: None,
        detail: DetailBound::default(),
        clips: Vec::new(),
        is_metered: false,
    }
}

/// The channel's picture as linear light of its red.
fn drawn(wall: &Wall, scene: &GpuScene, eyes: &[DVec3]) -> Vec<Vec<f64>> {
    let plan = CorrectionPlan::new(wall, &CalibrationMaps::default(), ChannelId(0))
        .expect("a plan")
        .expect("a correction");
    let mut corrector = Corrector::new(gpu(), plan, wall, None).expect("a corrector");
    let mut renderer = Renderer::new(gpu(), 1).expect("a renderer");
    renderer.prepare_for(gpu(), scene, ImageEncoding::Light);
    let mut output = ChannelOutput::new("curve".into(), None, None);
    let mut draw = |eye: &DVec3| {
        let frame = frame(HeadPose::facing_forward(*eye, 0.0));
        let drawing = (&mut renderer, scene);
        corrector.draw(gpu(), drawing, wall, &frame, &mut output).expect("drawn");
        let shots = corrector.shots.as_ref().expect("shots");
        println!("eye {eye}: {} planes, source {:?}", shots.eyes[0].planes.len(), shots.size);
        let bytes = read_picture(gpu(), output.picture().expect("a picture")).expect("read");
        let linear = |code: &[u8]| linear_from_srgb(f64::from(code[0]) / 255.0);
        bytes.chunks(4).map(linear).collect()
    };
    eyes.iter().map(&mut draw).collect()
}

/// Returns the light that each pixel of the display should show, by a ray through its middle.
fn expected(wall: &Wall, spot: &Spot, eye: DVec3) -> Vec<f64> {
    let map = wall.channel_mapping(ChannelId(0)).expect("a map");
    let size = wall.channels[0].size;
    let pixels = (0..size.y).flat_map(|y| (0..size.x).map(move |x| UVec2::new(x, y)));
    let light = |pixel: UVec2| {
        let point = map.display_from_pixel(pixel.as_dvec2() + 0.5)?;
        Some(spot.light(eye, point - eye))
    };
    pixels.map(|pixel| light(pixel).unwrap_or(0.0)).collect()
}

/// The middle of the light where the expected picture has some.
fn measure(light: &[f64], expected: &[f64], width: usize) -> Light {
    let (mut sum, mut first) = (0.0, DVec2::ZERO);
    for (at, light) in light.iter().enumerate().filter(|(at, _)| expected[*at] > 1e-4) {
        sum += light;
        first += DVec2::new((at % width) as f64, (at / width) as f64) * light;
    }
    Light { middle: first / sum, sum }
}

/// All spots are where they should be, and as bright; gives the largest error in pixels.
fn check(name: &str, wall: &Wall, spots: &[Spot], eyes: &[DVec3]) -> f64 {
    let pictures = drawn(wall, &scene(spots), eyes);
    let width = wall.channels[0].size.x as usize;
    let (mut most, mut dimmest, mut brightest) = (0f64, 1f64, 1f64);
    for (eye, picture) in eyes.iter().zip(&pictures) {
        for spot in spots {
            let wanted = expected(wall, spot, *eye);
            let (is, should) = (measure(picture, &wanted, width), measure(&wanted, &wanted, width));
            assert!(should.sum > 5.0, "{name}: the spot at {} is not on the display", spot.place);
            most = most.max(is.middle.distance(should.middle));
            dimmest = dimmest.min(is.sum / should.sum);
            brightest = brightest.max(is.sum / should.sum);
        }
    }
    println!("{name}: off by {most:.4} px; light {dimmest:.4} to {brightest:.4}");
    assert!(most <= 0.05, "{name}: off by {most} px");
    assert!(dimmest > 0.98 && brightest < 1.02, "{name}: light {dimmest} to {brightest}");
    most
}

fn cylinder(arc: f64, turned: DQuat) -> Surface {
    Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: turned,
        radius_m: 3.0,
        azimuth_rad: [-arc / 2.0, arc / 2.0],
        height_m: [-1.0, 1.0],
    })
}

/// A direction by azimuth and elevation, at a distance.
fn toward(azimuth: f64, elevation: f64, distance: f64) -> DVec3 {
    let (sin, cos) = azimuth.sin_cos();
    DVec3::new(sin * elevation.cos(), elevation.sin(), -cos * elevation.cos()) * distance
}

const EYES: [DVec3; 3] = [DVec3::ZERO, DVec3::new(0.4, -0.2, -0.3), DVec3::new(-0.35, 0.1, 0.5)];

#[test]
fn a_cylinder_shows_the_world_where_it_is() {
    let turned = DQuat::from_rotation_z(0.3) * DQuat::from_rotation_y(0.9);
    let spots: Vec<_> = [(-0.33, -0.1), (0.0, 0.12), (0.2, -0.15), (0.36, 0.05)]
        .map(|(azimuth, elevation)| Spot {
            place: turned * toward(azimuth, elevation, 5.0),
            half: 0.45,
        })
        .into();
    check("cylinder", &wall(cylinder(1.0, turned), [200, 134]), &spots, &EYES);
}

#[test]
fn a_dome_shows_the_world_where_it_is() {
    let dome = Surface::Sphere(Sphere {
        center: DVec3::ZERO,
        rotation: DQuat::from_rotation_x(0.2),
        radius_m: 4.0,
        azimuth_rad: [-0.7, 0.7],
        elevation_rad: [0.0, 0.9],
    });
    let spots: Vec<_> = [(-0.4, 0.4), (0.0, 0.6), (0.3, 0.75), (0.5, 0.5)]
        .map(|(azimuth, elevation)| Spot { place: toward(azimuth, elevation, 6.0), half: 0.6 })
        .into();
    check("dome", &wall(dome, [220, 150]), &spots, &EYES);
}

#[test]
fn no_seam_shows_between_the_planes_of_a_ring() {
    let ring = wall(cylinder(TAU, DQuat::IDENTITY), [640, 68]);
    // On the seams, beside them, and between.
    let azimuths = [-PI / 2.0, 0.0, PI / 2.0, -1.26, PI / 4.0, -2.5];
    let spots: Vec<_> =
        azimuths.map(|azimuth| Spot { place: toward(azimuth, 0.03, 5.0), half: 0.7 }).into();
    check("ring", &ring, &spots, &[DVec3::ZERO, DVec3::new(0.3, 0.1, -0.2)]);
}

#[test]
fn pins_move_a_corner_and_the_picture_with_it() {
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(3.2, 1.8));
    let mut pinned = wall(Surface::Plane(plane), [192, 108]);
    pinned.channels[0].adjustment.pin[0] = DVec2::new(20.0, 12.0);
    pinned.channels[0].adjustment.pin[3] = DVec2::new(-9.0, -5.0);
    let spots: Vec<_> = [(-0.3, 0.1), (0.25, -0.1)]
        .map(|(azimuth, elevation)| Spot { place: toward(azimuth, elevation, 4.0), half: 0.5 })
        .into();
    check("pins", &pinned, &spots, &EYES[..2]);
}

#[test]
fn tiles_that_are_shown_as_they_are_drawn_have_no_plan() {
    let plane = || Surface::Plane(Plane::upright(DVec3::NEG_Z, DVec2::new(3.2, 1.8)));
    let mut flat = wall(plane(), [64, 36]);
    flat.dither = true;
    let names = ["curve".to_owned(), "elsewhere".to_owned()];
    assert!(
        correction_plans(&flat, &CalibrationMaps::default(), &names, None)
            .expect("plans")
            .is_empty()
    );
    flat.channels[0].adjustment.color.gain.x = 0.9;
    let planned =
        correction_plans(&flat, &CalibrationMaps::default(), &names, None).expect("plans");
    let plan = &planned["curve"];
    assert!(plan.warp.is_none(), "its pixels stay where they are");
    assert_eq!(plan.desc.dither, Some(0));
    // A warp whose file is not there lights nothing.
    flat.channels[0].cover = ChannelKind::Map;
    let said =
        correction_plans(&flat, &CalibrationMaps::default(), &names, None).expect_err("refused");
    assert_eq!(said, "channel curve: none of its pixels lies on its screen");
}

#[test]
fn a_tuning_leaves_what_it_does_not_change() {
    let plane = Surface::Plane(Plane::upright(DVec3::NEG_Z, DVec2::new(3.2, 1.8)));
    let mut row = wall(plane, [640, 36]);
    row.blend.leak = 0.003;
    row.channels = [("left", 0), ("middle", 48), ("right", 576)]
        .map(|(name, x)| Channel::tile(name, 0, UVec2::new(x, 0), UVec2::new(64, 36)))
        .into();
    row.channels[0].adjustment.pin[3] = DVec2::ONE;
    let names = ["left".to_owned(), "right".to_owned()];
    let planned = |wall: &Wall, known: Option<&CorrectionPlans>| {
        correction_plans(wall, &CalibrationMaps::default(), &names, known).expect("plans")
    };
    let is_same = |a: &CorrectionPlan, b: &CorrectionPlan| {
        let (a_map, b_map) = (a.desc.light_map.as_ref(), b.desc.light_map.as_ref());
        let has_same_map = Arc::ptr_eq(a_map.expect("a map"), b_map.expect("a map"));
        let pair = a.warp.as_ref().zip(b.warp.as_ref());
        (has_same_map, pair.is_some_and(|(a, b)| Arc::ptr_eq(a, b)))
    };
    let before = planned(&row, None);
    row.channels[0].adjustment.color.gain = DVec3::new(0.8, 0.9, 1.0);
    let gained = planned(&row, Some(&before));
    // A projector with a gain leaks otherwise; one that does not leak has the same light map.
    assert_eq!(is_same(&before["left"], &gained["left"]), (false, true));
    assert_ne!(before["left"].desc.color, gained["left"].desc.color);
    let mut tight = row.clone();
    tight.blend.leak = 0.0;
    let before = planned(&tight, None);
    tight.channels[0].adjustment.color.gain = DVec3::new(0.7, 0.9, 1.0);
    let again = planned(&tight, Some(&before));
    assert_eq!(is_same(&before["left"], &again["left"]), (true, true));
    assert_ne!(before["left"].desc.color, again["left"].desc.color);
    row.channels[0].adjustment.pin[0] = DVec2::ONE;
    let pinned = planned(&row, Some(&gained));
    assert_eq!(is_same(&gained["left"], &pinned["left"]), (false, false));
    assert!(is_same(&gained["right"], &pinned["right"]).0, "they do not meet");
    row.channels[1].adjustment.edges.left = Some(5.0);
    let widened = planned(&row, Some(&pinned));
    assert_eq!(is_same(&pinned["left"], &widened["left"]), (false, true));
    // As if nothing had been known.
    let afresh = planned(&row, None);
    for name in &names {
        assert_eq!(widened[name].desc, afresh[name].desc, "{name}");
    }
}

#[test]
fn tiles_that_overlap_share_their_light() {
    let plane = Surface::Plane(Plane::upright(DVec3::NEG_Z, DVec2::new(3.2, 1.8)));
    let mut shared = wall(plane, [96, 36]);
    shared.channels = [("left", 0), ("right", 32)]
        .map(|(name, x)| Channel::tile(name, 0, UVec2::new(x, 0), UVec2::new(64, 36)))
        .into();
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::splat(0.5);
    let scene = stage.build();
    let mut renderer = Renderer::new(gpu(), 1).expect("a renderer");
    renderer.prepare_for(gpu(), &scene, ImageEncoding::Light);
    let pictures = [0, 1].map(|id| {
        let plan = CorrectionPlan::new(&shared, &CalibrationMaps::default(), ChannelId(id))
            .expect("a plan")
            .expect("a correction");
        let mut corrector = Corrector::new(gpu(), plan, &shared, None).expect("a corrector");
        let mut output = ChannelOutput::new("curve".into(), None, None);
        let frame = frame(HeadPose::facing_forward(DVec3::ZERO, 0.0));
        let drawing = (&mut renderer, &scene);
        corrector.draw(gpu(), drawing, &shared, &frame, &mut output).expect("drawn");
        let bytes = read_picture(gpu(), output.picture().expect("a picture")).expect("read");
        bytes
            .chunks(4)
            .map(|code| linear_from_srgb(f64::from(code[0]) / 255.0))
            .collect::<Vec<f64>>()
    });
    // Of a sky of one light, two projectors together show as much as one alone.
    let alone = pictures[0][0];
    for x in 0..96usize {
        let light = |channel: usize, x: Option<usize>| {
            x.filter(|x| *x < 64).map_or(0.0, |x| pictures[channel][64 * 10 + x])
        };
        let both = light(0, Some(x)) + light(1, x.checked_sub(32));
        // Half a code of each, at most, where codes are steepest.
        assert!((both - alone).abs() <= 0.005, "column {x}: {both}, where alone {alone}");
        assert!(light(0, Some(x)) < alone || x <= 32, "column {x} has a ramp");
    }
}

#[test]
fn an_eye_behind_a_curve_is_refused_by_name() {
    let ring = wall(cylinder(1.0, DQuat::IDENTITY), [64, 36]);
    let plan = CorrectionPlan::new(&ring, &CalibrationMaps::default(), ChannelId(0))
        .expect("a plan")
        .expect("a correction");
    let mut corrector = Corrector::new(gpu(), plan, &ring, None).expect("a corrector");
    // In the surface's tangent plane beside it: one half shows its front, the other its back.
    let behind = frame(HeadPose::facing_forward(DVec3::new(4.0, 0.0, -3.2), 0.0));
    let said = corrector.views(gpu(), &ring, &behind).expect_err("refused");
    assert!(said.starts_with("channel curve: the eye"), "{said}");
}
