//! Shadows of point and spot lights, against rays that are cast from each pixel in f64.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, DVec4, Vec3, Vec4};
use polyptych_scene::{AlphaMode, LAMP_MAPS_MAX, Light, LightKind, Material, NodeTraits};
use polyptych_wall::ShadowFilter;

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, gpu, look, pixel,
};
use super::shadows::{
    PENUMBRAS, Stage, boxes, cube, entry, grey, shadowed, shown, tile_differences, town,
};
use crate::pass::opaque;
use crate::scene::Bounds;
use crate::shader::{Interface, surface};
use crate::{GpuScene, MovedItems, MovedNode, SceneLayout, ViewDesc};

pub(super) const SIZE: [u32; 2] = [320, 240];

/// A light at a place that shines along a direction.
#[derive(Clone, Copy)]
pub(super) struct Lamp {
    pub at: DVec3,
    along: DVec3,
    /// Half of the angle of the cone, in degrees; `None` of a point light.
    pub outer_deg: Option<f64>,
    candela: f64,
    range: Option<f32>,
}

impl Lamp {
    pub fn point(at: DVec3, candela: f64) -> Self {
        Self { at, along: DVec3::NEG_Z, outer_deg: None, candela, range: None }
    }

    /// A spot light that shines towards a point.
    pub fn spot(at: DVec3, to: DVec3, outer_deg: f64, candela: f64) -> Self {
        Self { at, along: (to - at).normalize(), outer_deg: Some(outer_deg), candela, range: None }
    }

    fn light(&self) -> Light {
        let kind = self.outer_deg.map_or(LightKind::Point, |degrees| {
            let outer_rad = degrees.to_radians() as f32;
            LightKind::Spot { inner_rad: outer_rad * 0.999, outer_rad }
        });
        Light { kind, color: Vec3::ONE, intensity: self.candela as f32, range: self.range }
    }

    fn place(&self) -> DAffine3 {
        let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, self.along);
        DAffine3::from_rotation_translation(turn, self.at)
    }
}

/// Boxes within a room that is seen from inside; the room is the first node.
pub(super) struct Room {
    pub walls: Bounds,
    pub boxes: Vec<Bounds>,
}

impl Room {
    /// Boxes on a floor, far from walls.
    pub fn hall() -> Self {
        let walls =
            Bounds { min: DVec3::new(-30.0, 0.0, -30.0), max: DVec3::new(30.0, 20.0, 30.0) };
        Self { walls, boxes: boxes() }
    }

    /// Boxes around the middle, on all sides of it and where the faces of a cube meet.
    pub fn chamber() -> Self {
        let around = |at: DVec3, half: f64| Bounds { min: at - half, max: at + half };
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let mut boxes: Vec<_> =
            axes.iter().flat_map(|axis| [*axis, -*axis]).map(|at| around(at * 1.7, 0.3)).collect();
        for signs in 0..4 {
            let sign = |bit: u32| if signs >> bit & 1 == 1 { 1.3 } else { -1.3 };
            boxes.push(around(DVec3::new(sign(0), sign(1), 0.0), 0.2));
            boxes.push(around(DVec3::new(0.0, sign(0), sign(1)), 0.2));
            boxes.push(around(DVec3::new(sign(0), 0.0, sign(1)), 0.2));
            boxes.push(around(DVec3::new(sign(0), sign(1), sign(0) * sign(1)), 0.15));
        }
        Self { walls: Bounds { min: DVec3::splat(-4.0), max: DVec3::splat(4.0) }, boxes }
    }

    pub fn stage(&self, lamps: &[Lamp]) -> SceneFixture {
        let mut stage = SceneFixture::new();
        stage.desc.sky = Vec3::ZERO;
        let inside = stage.material(Material { double_sided: true, ..grey() });
        let solid = stage.material(grey());
        let walls = stage.mesh(&cube(), Some(inside));
        let shape = stage.mesh(&cube(), Some(solid));
        let place = |of: &Bounds| {
            DAffine3::from_scale_rotation_translation(of.half(), DQuat::IDENTITY, of.center())
        };
        stage.node(walls, place(&self.walls));
        for of in &self.boxes {
            stage.node(shape, place(of));
        }
        for lamp in lamps {
            stage.light(lamp.light(), lamp.place());
        }
        stage
    }

    /// The first surface along a ray from inside: its place, and its normal.
    pub fn hit(&self, origin: DVec3, ray: DVec3) -> (DVec3, DVec3) {
        let (a, b) = ((self.walls.min - origin) / ray, (self.walls.max - origin) / ray);
        let far = a.max(b);
        let mut normal = DVec3::ZERO;
        normal[far.min_position()] = -ray[far.min_position()].signum();
        let mut nearest = (far.min_element(), normal);
        for of in &self.boxes {
            let Some(along) = entry(of, origin, ray).filter(|along| *along < nearest.0) else {
                continue;
            };
            let from = (origin + ray * along - of.center()) / of.half();
            let axis = from.abs().max_position();
            let mut normal = DVec3::ZERO;
            normal[axis] = from[axis].signum();
            nearest = (along, normal);
        }
        (origin + ray * nearest.0, nearest.1)
    }

    /// The light of a pixel: `None` where it is dark whatever is in its way.
    fn is_lit(&self, view: &ViewDesc, lamp: &Lamp, at: [u32; 2]) -> Option<bool> {
        let (at, normal) = self.hit(view.eye_in_world, ray(view, at));
        let way = lamp.at - (at + normal * 1e-6);
        let blocks = |of: &Bounds| entry(of, lamp.at - way, way).is_some_and(|along| along < 1.0);
        let outer = lamp.outer_deg.map_or(PI, f64::to_radians);
        let is_inside = (-way.normalize()).dot(lamp.along) > outer.cos() + 1e-3;
        let is_facing = normal.dot(way) > 1e-6 * way.length();
        (is_facing && (is_inside || lamp.outer_deg.is_none()))
            .then(|| !self.boxes.iter().any(blocks))
    }

    /// The distance of the surface of a pixel to the wall that is nearest beside its own.
    fn edge_distance(&self, view: &ViewDesc, at: [u32; 2]) -> f64 {
        let (place, _) = self.hit(view.eye_in_world, ray(view, at));
        let [low, high] = [place - self.walls.min, self.walls.max - place];
        let mut ways = [low.to_array(), high.to_array()].concat();
        ways.sort_by(f64::total_cmp);
        ways[1]
    }

    /// Pixels that are wrong, and those that a lamp could light, in some views.
    fn wrong(&self, lamp: &Lamp, views: &[ViewDesc], filter: ShadowFilter) -> [usize; 2] {
        let mut stage = Stage::new(self.stage(&[*lamp]).build(), SIZE, filter);
        let mut counts = [0; 2];
        for view in views {
            let got = stage.draw(view).0;
            let bright = stage.draw(&ViewDesc { has_shadows: false, ..view.clone() }).0;
            for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
                let Some(wanted) = self.is_lit(view, lamp, [x, y]) else { continue };
                let [got, bright] = [&got, &bright].map(|of| f64::from(pixel(of, SIZE, x, y)[0]));
                if bright < 30.0 {
                    continue;
                }
                // The code of half of the light.
                counts[0] += usize::from(wanted != (got > 0.73 * bright));
                counts[1] += 1;
            }
        }
        counts
    }

    /// The shares of wrong pixels with hard and soft shadows, which are asserted to be small.
    fn check(&self, name: &str, lamp: &Lamp, views: &[ViewDesc]) -> [f64; 2] {
        let [hard, soft, _] = self.shares(name, lamp, views);
        [hard, soft]
    }

    fn shares(&self, name: &str, lamp: &Lamp, views: &[ViewDesc]) -> [f64; 3] {
        use ShadowFilter::{ContactHardening, Hard, Soft};
        [(Hard, 0.01), (Soft, 0.015), (ContactHardening, 0.015)].map(|(filter, most)| {
            let [wrong, all] = self.wrong(lamp, views, filter);
            println!("{filter:?} {name}: {wrong} of {all}");
            assert!(all > 4000, "{name}: only {all} pixels could be lit");
            let share = wrong as f64 / all as f64;
            assert!(share <= most, "{filter:?} {name}: {share} of the pixels are wrong");
            share
        })
    }
}

/// The ray through the middle of a pixel.
pub(super) fn ray(view: &ViewDesc, at: [u32; 2]) -> DVec3 {
    let [x, y] = [0, 1].map(|axis| (f64::from(at[axis]) + 0.5) / f64::from(SIZE[axis]));
    let ndc = DVec4::new(x * 2.0 - 1.0, 1.0 - y * 2.0, 1.0, 1.0);
    let in_view = view.clip_from_view.inverse() * ndc;
    view.view_from_world.transpose() * (in_view.truncate() / in_view.w)
}

fn hall_view() -> ViewDesc {
    look(DVec3::new(3.0, 5.0, 11.0), DVec3::new(0.0, 0.5, -1.0), SIZE)
}

/// Views of all walls of the chamber, and of its corners.
pub(super) fn chamber_views() -> Vec<ViewDesc> {
    let eye = DVec3::new(0.9, 0.6, 0.8);
    let corners = [DVec3::new(4.0, 3.9, 4.0), DVec3::new(-4.0, -3.9, 3.9)];
    let axes = [DVec3::X, DVec3::Z].into_iter().flat_map(|axis| [axis * 4.0, axis * -4.0]);
    let up = [DVec3::new(0.1, 4.0, 0.0), DVec3::new(0.1, -4.0, 0.0)];
    axes.chain(up).chain(corners).map(|at| look(eye, at, SIZE)).collect()
}

#[test]
fn spot_shadows_are_where_rays_find_them() {
    let hall = Room::hall();
    let mut worst = [0f64; 2];
    for outer in [20.0, 45.0, 59.0, 75.0] {
        for elevation in [85.0f64, 50.0, 25.0] {
            for azimuth in [20.0f64, 140.0, 260.0] {
                let (up, across) = elevation.to_radians().sin_cos();
                let (x, z) = azimuth.to_radians().sin_cos();
                let at = DVec3::new(x * across, up, z * across) * 11.0;
                let lamp = Lamp::spot(at, DVec3::new(0.3, 0.0, -0.4), outer, 150.0);
                let name = format!("spot of {outer}°, {elevation}° high, {azimuth}°");
                let shares = hall.check(&name, &lamp, &[hall_view()]);
                worst = [worst[0].max(shares[0]), worst[1].max(shares[1])];
            }
        }
    }
    println!("spots: hard and soft at most {:.3} % and {:.3} %", worst[0] * 1e2, worst[1] * 1e2);
}

#[test]
fn point_shadows_are_where_rays_find_them() {
    let chamber = Room::chamber();
    let mut worst = [0f64; 2];
    for at in [DVec3::ZERO, DVec3::new(0.31, -0.23, 0.17), DVec3::new(-0.7, 0.4, -0.6)] {
        let lamp = Lamp::point(at, 25.0);
        let shares = chamber.check(&format!("point at {at}"), &lamp, &chamber_views());
        worst = [worst[0].max(shares[0]), worst[1].max(shares[1])];
    }
    println!("points: hard and soft at most {:.3} % and {:.3} %", worst[0] * 1e2, worst[1] * 1e2);
}

#[test]
fn a_spot_of_half_of_all_directions_has_the_faces_of_a_cube() {
    let chamber = Room::chamber();
    let down = DVec3::new(0.1, -0.3, 0.05);
    for along in [DVec3::new(0.0, -1.0, 0.0), DVec3::new(0.5, 0.3, -0.7)] {
        let lamp = Lamp { along: along.normalize(), ..Lamp::spot(down, down, 90.0, 25.0) };
        chamber.check(&format!("spot of 90° along {along}"), &lamp, &chamber_views());
        let (_, stats) = draw_sampled(&chamber.stage(&[lamp]).build(), SIZE, 1, &chamber_views());
        assert_eq!(stats.shadow_maps, 5);
    }
}

#[test]
fn any_range_and_a_lamp_inside_of_a_box_have_the_shadows_of_rays() {
    let (hall, view) = (Room::hall(), hall_view());
    let at = DVec3::new(-4.0, 6.0, 4.0);
    for range in [0.0, 40.0, 1e30, f32::MAX, f32::INFINITY] {
        let lamp = Lamp { range: Some(range), ..Lamp::point(at, 60.0) };
        hall.check(&format!("range {range}"), &lamp, std::slice::from_ref(&view));
    }
    // In the middle of the largest box: nothing outside has any light.
    let inside = Lamp::point(DVec3::new(0.0, 1.0, 0.0), 60.0);
    hall.check("inside", &inside, std::slice::from_ref(&view));
    let dark = draw(&hall.stage(&[inside]).build(), SIZE, &view);
    assert!(dark.iter().all(|pixel| pixel[0] == 0), "light comes through a wall");
    // A shade that is open below, as near as lamps have them.
    let around = DVec3::new(0.0, 9.0, 0.0);
    let mut shaded = Room { walls: hall.walls, boxes: Vec::new() };
    let lid = DVec3::new(0.03, 0.001, 0.03);
    let top = around + DVec3::Y * 0.004;
    shaded.boxes.push(Bounds { min: top - lid, max: top + lid });
    let lamp = Lamp::point(around, 150.0);
    let down = look(DVec3::new(20.0, 1.0, 20.0), DVec3::new(-3.0, 9.0, -3.0), SIZE);
    shaded.check("shade", &lamp, &[down]);
}

#[test]
fn what_a_lamp_meets_first_has_no_shadow_of_its_own() {
    let bare = |size: f64| Room {
        walls: Bounds { min: DVec3::splat(-size), max: DVec3::splat(size) },
        boxes: Vec::new(),
    };
    // Near the middle, near a wall, and in a corner, where light grazes; rooms of 0.2 m to 2 km.
    for (size, place) in [(4.0, 0.1), (4.0, 0.95), (0.1, 0.6), (1000.0, 0.6), (1000.0, 0.999)] {
        let at = DVec3::new(0.2, place, -place) * size;
        let lamps = [
            Lamp::point(at, 10.0 * size * size),
            Lamp::spot(at, DVec3::new(-size, 0.0, 0.0), 50.0, 10.0 * size * size),
        ];
        for lamp in lamps {
            let room = bare(size);
            let scene = room.stage(&[lamp]);
            let mut at_edges = [0; 2];
            let views = chamber_views();
            let views = views.iter().flat_map(|view| PENUMBRAS.map(|filter| (filter, view)));
            // A lamp of 5 cm would fill the smallest room.
            let fits = |filter| size > 1.0 || filter == ShadowFilter::Soft;
            for (filter, view) in views.filter(|(filter, _)| fits(*filter)) {
                let scale = size / 4.0;
                let eye = view.eye_in_world * scale;
                let view = ViewDesc { eye_in_world: eye, middle_eye_in_world: eye, ..view.clone() };
                let off = ViewDesc { has_shadows: false, ..view.clone() };
                let [got, wanted] = [&view, &off].map(|view| shown(&scene, filter, view, SIZE));
                let of = (filter, size, place, lamp.outer_deg);
                for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
                    let [got, wanted] = [&got, &wanted].map(|of| pixel(of, SIZE, x, y)[0]);
                    if got.abs_diff(wanted) > 1 {
                        // Filters reach around corners, by a few texels.
                        let edge = room.edge_distance(&view, [x, y]);
                        assert!(edge < 0.012 * size, "{of:?}: {got}, not {wanted}: {x}, {y}");
                        at_edges[usize::from(filter != ShadowFilter::Soft)] += 1;
                    }
                }
            }
            println!("{:?}: {at_edges:?} pixels at edges", (size, place, lamp.outer_deg));
            assert!(at_edges.iter().all(|of| *of < 1000), "{at_edges:?}");
        }
    }
    // A ball that is seen from the lamp: all of its light is there but at the edge.
    let mut stage = bare(4.0).stage(&[Lamp::point(DVec3::new(0.0, 0.0, 3.0), 8.0)]);
    let ball = stage.mesh(&MeshFixture::sphere(48), Some(1));
    stage.node(ball, DAffine3::IDENTITY);
    let scene = stage.build();
    let near = look(DVec3::new(0.0, 0.0, 2.5), DVec3::ZERO, SIZE);
    let off = ViewDesc { has_shadows: false, ..near.clone() };
    let changed = differences(&draw(&scene, SIZE, &near), &draw(&scene, SIZE, &off));
    println!("ball: {changed:?} of {}", SIZE[0] * SIZE[1]);
    assert!(changed[2] < 1500, "{changed:?}");
}

#[test]
fn tiles_have_the_shadows_of_one_camera_and_lamps() {
    let above = DVec3::new(-4.0, 6.0, 4.0);
    let lamps = [
        Lamp::point(above, 60.0),
        Lamp::spot(DVec3::new(6.0, 7.0, 3.0), DVec3::ZERO, 40.0, 60.0),
        Lamp::spot(DVec3::new(2.0, 5.0, -6.0), DVec3::ZERO, 85.0, 30.0),
    ];
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    let chamber = [Lamp::point(DVec3::new(0.31, -0.23, 0.17), 25.0)];
    let corner = chamber_views().pop().unwrap();
    for (scene, view) in
        [(Room::hall().stage(&lamps), hall_view()), (Room::chamber().stage(&chamber), corner)]
    {
        for filter in PENUMBRAS {
            let total = tile_differences((&scene, filter), &view, SIZE);
            println!("{filter:?}: {total:?} of {pixels}");
            assert!(total[0] * 200 <= pixels, "{total:?}: more than 0.5 % differ");
            assert!(total[2] * 50_000 <= pixels, "{total:?}: more than 20 ppm by more than 8");
        }
    }
}

#[test]
fn a_caster_beside_the_channel_casts_its_shadow_into_it() {
    // The hovering plate, with a lamp above it; only the floor below is in the picture.
    let lamp = Lamp::spot(DVec3::new(-1.0, 12.0, -3.0), DVec3::new(-1.0, 0.0, -3.0), 30.0, 130.0);
    let scene = Room::hall().stage(&[lamp]).build();
    let down = look(DVec3::new(-1.0, 3.0, -3.0), DVec3::new(-1.0, 0.0, -3.01), SIZE);
    let (lit, stats) = draw_sampled(&scene, SIZE, 1, std::slice::from_ref(&down));
    assert_eq!(stats.visible, 1, "only the walls are seen");
    let dark = lit.iter().filter(|of| of[0] == 0).count();
    let bright = lit.iter().filter(|of| of[0] > 60).count();
    println!("{dark} dark and {bright} bright of {}", lit.len());
    assert!(dark * 5 > lit.len() && bright * 10 > lit.len(), "{dark} and {bright}");
}

/// A scene with a node in another place: by an edit that lays it out anew, or as clips move it.
fn moved(of: &SceneFixture, node: usize, place: DAffine3, by_clip: bool) -> GpuScene {
    let scene = of.build();
    let mut desc = of.desc.clone();
    let mut traits = NodeTraits::of_file(desc.nodes.len());
    traits.moving.extend(by_clip.then_some(node as u32));
    let mut moved = None;
    if !by_clip {
        desc.nodes[node].local = place;
    }
    let layout = Arc::new(SceneLayout::with_traits(desc, &traits, &|| false).unwrap());
    if by_clip {
        let node = MovedNode::new(node as u32, place, &[]);
        moved = Some(Arc::new(MovedItems::new(&layout, [node].into_iter()).unwrap()));
    }
    scene.with_layout(gpu(), layout, moved).unwrap()
}

#[test]
fn maps_stay_until_the_scene_changes_whoever_looks() {
    let hall = Room::hall();
    let lamps = [
        Lamp::point(DVec3::new(-4.0, 6.0, 4.0), 60.0),
        Lamp::spot(DVec3::new(6.0, 7.0, 3.0), DVec3::ZERO, 40.0, 60.0),
    ];
    let fixture = hall.stage(&lamps);
    let mut stage = Stage::new(fixture.build(), SIZE, ShadowFilter::Soft);
    let (first, stats) = stage.draw(&hall_view());
    assert_eq!(stats.shadow_maps, 7);
    // Wherever the viewer is, and whatever error is allowed.
    for step in 1..4 {
        let eye = DVec3::new(3.0, 5.0, 11.0) + DVec3::X * f64::from(step);
        let mut view = look(eye, DVec3::ZERO, SIZE);
        view.allowed_error.angle_rad = f64::from(step) * 0.001;
        assert_eq!(stage.draw(&view).1.shadow_maps, 0, "step {step}");
    }
    assert_eq!(differences(&stage.draw(&hall_view()).0, &first), [0; 3]);
    // A box, then a lamp, are turned: as a renderer draws them that has seen nothing else.
    let [box_node, lamp_node] = [2, 1 + hall.boxes.len() + 1];
    let turn = DAffine3::from_rotation_y(0.3);
    let moves = [box_node, lamp_node].into_iter().flat_map(|node| [(node, false), (node, true)]);
    for (node, by_clip) in moves {
        let mut fresh = hall.stage(&lamps);
        let place = turn * fresh.desc.nodes[node].local;
        fresh.desc.nodes[node].local = place;
        stage.scene = moved(&fixture, node, place, by_clip);
        let (got, stats) = stage.draw(&hall_view());
        assert_eq!(stats.shadow_maps, 7, "node {node}");
        assert_eq!(stage.draw(&hall_view()).1.shadow_maps, 0, "node {node}");
        let [_, _, changed] = differences(&got, &first);
        assert!(changed > 100, "node {node}: only {changed} pixels differ");
        assert_eq!(differences(&got, &draw(&fresh.build(), SIZE, &hall_view())), [0; 3]);
    }
}

#[test]
fn the_brightest_of_too_many_lamps_have_shadows() {
    let hall = Room::hall();
    let lamps = |count: u32| -> Vec<Lamp> {
        let lamp = |of: u32| {
            let (z, x) = (f64::from(of) * 0.7).sin_cos();
            // The last one is the brightest.
            let candela = if of + 1 == count { 60.0 } else { 3.0 };
            Lamp::point(DVec3::new(x * 6.0, 6.0, z * 6.0), candela)
        };
        (0..count).map(lamp).collect()
    };
    let view = hall_view();
    for (count, maps) in [(2, 12), (10, 60), (14, 60)] {
        let scene = hall.stage(&lamps(count)).build();
        let (pixels, stats) = draw_sampled(&scene, SIZE, 1, std::slice::from_ref(&view));
        assert_eq!(stats.shadow_maps, maps, "{count} lamps");
        assert!(maps as usize <= LAMP_MAPS_MAX);
        let off = ViewDesc { has_shadows: false, ..view.clone() };
        let [_, _, changed] = differences(&pixels, &draw(&scene, SIZE, &off));
        assert!(changed > 500, "{count} lamps: {changed}");
    }
    // The brightest one alone has the same edges as among all.
    let many = draw(&hall.stage(&lamps(14)).build(), SIZE, &view);
    let own = hall.stage(&lamps(14)[13..]).build();
    let one = draw(&own, SIZE, &view);
    let bright = draw(&own, SIZE, &ViewDesc { has_shadows: false, ..view });
    let dark = (0..one.len()).filter(|&at| one[at][0] == 0 && bright[at][0] > 60);
    let [all, still_lit] = dark
        .fold([0, 0], |[all, lit], at| [all + 1, lit + usize::from(many[at][0] >= bright[at][0])]);
    println!("{still_lit} of {all} pixels in the brightest lamp's shadow are as bright without it");
    assert!(all > 300 && still_lit == 0, "{still_lit} of {all}");
}

#[test]
fn masks_cast_where_they_are_and_blends_cast_nothing() {
    let lamp = Lamp::point(DVec3::new(-5.0, 7.0, 5.0), 300.0);
    let with = |alpha_mode, alpha: f32, unlit: bool| {
        let base_color = Vec4::new(0.6, 0.6, 0.6, alpha);
        let material = Material { base_color, alpha_mode, unlit, ..grey() };
        let mut stage = town(DVec3::ZERO, material, &[]);
        stage.light(lamp.light(), lamp.place());
        shadowed(&stage.build(), &hall_view())
    };
    let solid = with(AlphaMode::Opaque, 1.0, false);
    assert!(solid > 500, "{solid}");
    assert_eq!(with(AlphaMode::Mask(0.5), 0.6, false), solid);
    assert_eq!(with(AlphaMode::Mask(0.5), 0.4, false), 0);
    assert_eq!(with(AlphaMode::Blend, 0.9, false), 0);
    assert_eq!(with(AlphaMode::Opaque, 1.0, true), 0);
}

#[test]
fn shadows_of_suns_and_lamps_stand_beside_each_other() {
    let toward = DVec3::new(0.6, 0.7, 0.3).normalize();
    let lamp = Lamp::spot(DVec3::new(-6.0, 7.0, 3.0), DVec3::ZERO, 50.0, 90.0);
    let view = hall_view();
    let sun_alone = town(DVec3::ZERO, grey(), &[toward]);
    let mut both = town(DVec3::ZERO, grey(), &[toward]);
    both.light(lamp.light(), lamp.place());
    let mut lamp_alone = town(DVec3::ZERO, grey(), &[]);
    lamp_alone.light(lamp.light(), lamp.place());
    let [sun, both, lamp] = [sun_alone, both, lamp_alone].map(|of| draw(&of.build(), SIZE, &view));
    // Where one is dark, the picture is that of the other, but for less light than a code.
    let mut counts = [0; 2];
    for ((sun, both), lamp) in sun.iter().zip(&both).zip(&lamp) {
        if sun[0] == 0 && lamp[0] > 0 {
            counts[0] += 1;
            assert!(both[0].abs_diff(lamp[0]) <= 4, "{both:?} and {lamp:?}");
        }
        if lamp[0] == 0 && sun[0] > 0 {
            counts[1] += 1;
            assert!(both[0].abs_diff(sun[0]) <= 4, "{both:?} and {sun:?}");
        }
    }
    assert!(counts[0] > 300 && counts[1] > 3000, "{counts:?}");
}

#[test]
fn what_has_no_shadows_of_lamps_draws_as_if_there_were_none() {
    let black = Lamp::point(DVec3::Y, 0.0);
    let hall = Room::hall();
    let dark = hall.stage(&[black]).build();
    assert!(dark.layout.keys.iter().all(|key| !key.has_shadows() && !key.lamp_shadows));
    assert_eq!(draw_sampled(&dark, SIZE, 1, &[hall_view()]).1.shadow_maps, 0);
    let lamp = Lamp::point(DVec3::new(-4.0, 6.0, 4.0), 60.0);
    let scene = hall.stage(&[lamp]).build();
    let off = ViewDesc { has_shadows: false, ..hall_view() };
    let wanted = draw(&scene, SIZE, &off);
    let mut stage = Stage::new(scene, SIZE, ShadowFilter::Off);
    let (got, stats) = stage.draw(&hall_view());
    assert_eq!((stats.shadow_maps, differences(&got, &wanted)), (0, [0; 3]));
    for shadows in [false, true] {
        let interface = Interface { lit: true, lamps: true, shadows, ..Interface::default() };
        let text = surface(interface, opaque::SOURCE);
        assert!(!text.contains("lamp_shadow") && !text.contains("lamp_maps"), "{text}");
    }
}

#[test]
fn what_glows_around_a_lamp_lets_its_light_out() {
    let dark = |glow: f32, lantern_at: DVec3| {
        let mut stage = SceneFixture::new();
        let floor = stage.material(grey());
        let glass = stage.material(Material { emissive: Vec3::splat(glow), ..grey() });
        let wide = stage.mesh(&MeshFixture::rectangle(9.0, 9.0), Some(floor));
        let lantern = stage.mesh(&cube(), Some(glass));
        stage.node(wide, DAffine3::from_rotation_x(-PI / 2.0));
        let small = DAffine3::from_scale(DVec3::splat(0.3));
        stage.node(lantern, DAffine3::from_translation(lantern_at) * small);
        let lamp = Lamp::point(DVec3::Y * 2.0, 40.0);
        stage.light(lamp.light(), lamp.place());
        // The floor below the lamp, from beside it.
        shadowed(&stage.build(), &look(DVec3::new(3.0, 3.0, 0.0), DVec3::new(1.5, 0.0, 0.0), SIZE))
    };
    let around = DVec3::Y * 2.0;
    assert!(dark(0.0, around) > 5000, "glass that does not glow is a lid");
    assert_eq!(dark(0.2, around), 0, "the glass of a lantern is none");
    let beside = DVec3::new(0.6, 1.0, 0.0);
    assert!(dark(0.2, beside) > 500, "what glows elsewhere casts its shadow");
}

/// A hall of one primitive, of which a texture says what glows.
#[test]
fn what_glows_and_is_no_lantern_casts_shadows_of_lamps_within() {
    let dark = |glow: f32, lamp: &Lamp| {
        let mut hall = MeshFixture::rectangle(9.0, 9.0);
        for height in [1.0, 8.0] {
            let (first, cube) = (hall.vertices.len() as u32, cube());
            hall.vertices.extend(cube.vertices.into_iter().map(|mut vertex| {
                vertex[2] += height;
                vertex
            }));
            hall.indices.extend(cube.indices.iter().map(|index| index + first));
        }
        let mut stage = SceneFixture::new();
        let of = stage.material(Material { emissive: Vec3::splat(glow), ..grey() });
        let hall = stage.mesh(&hall, Some(of));
        stage.node(hall, DAffine3::from_rotation_x(-PI / 2.0));
        stage.light(lamp.light(), lamp.place());
        shadowed(&stage.build(), &look(DVec3::new(3.0, 5.0, 4.0), DVec3::X * 2.0, SIZE))
    };
    let within = Lamp::point(DVec3::new(-3.0, 3.0, 0.0), 60.0);
    let in_corner = Lamp::point(DVec3::new(-8.5, 8.5, -8.5), 1500.0);
    for lamp in [within, in_corner] {
        let plain = dark(0.0, &lamp);
        assert!(plain > 1000, "{}: the cube on the floor has a shadow: {plain}", lamp.at);
        let glowing = dark(0.01, &lamp);
        assert!(glowing > 1000, "{}: it has one where parts glow, too: {glowing}", lamp.at);
    }
}
