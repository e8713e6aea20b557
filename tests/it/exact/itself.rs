//! The reference against numbers that can be checked by hand, and its halves against each other.

use glam::{DQuat, DVec2, DVec3};

use crate::reference::clip::clip;
use crate::reference::facet::{Corner, Facet};
use crate::reference::raster::{self, Projected};
use crate::reference::tone;
use crate::reference::view::{HomogeneousPixel, Pose, ScreenView, View};

/// A screen of 2 × 1 m, a metre before the eye, of 200 × 100 pixels.
fn view() -> View {
    let seat = ScreenView {
        corners: [
            DVec3::new(-1.0, -0.5, -1.0),
            DVec3::new(1.0, -0.5, -1.0),
            DVec3::new(-1.0, 0.5, -1.0),
        ],
        canvas: [200, 100],
        origin: [0, 0],
        size: [200, 100],
        eye: DVec3::ZERO,
        near_m: 0.1,
    };
    let pose = Pose { position: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: 1.0 };
    View::new(&seat, &pose).expect("in front")
}

fn facet(corners: [[f64; 3]; 3]) -> Facet {
    let corners = corners.map(|place| Corner {
        place: DVec3::from(place),
        color: DVec3::ONE,
        uv: DVec2::ZERO,
    });
    Facet { corners, picture: None, is_double_sided: false }
}

#[test]
fn points_are_seen_where_the_lines_cross_the_screen() {
    let view = view();
    let pixel = |x: f64, y: f64, z: f64| view.pixel(DVec3::new(x, y, z));
    assert_eq!(pixel(-1.0, 0.5, -1.0), Some(DVec2::ZERO));
    // Twice as far: half as far from the middle.
    assert_eq!(pixel(1.0, -0.5, -2.0), Some(DVec2::new(150.0, 75.0)));
    assert_eq!(pixel(0.0, 0.0, 1.0), None, "behind the eye");
    assert_eq!(pixel(0.0, 0.0, -0.09), None, "before the near plane");
    let point = view.world(DVec2::new(30.0, 80.0), 7.0);
    assert!(view.pixel(point).unwrap().distance(DVec2::new(30.0, 80.0)) < 1e-12);
    assert!((view.see(point).w - 7.0).abs() < 1e-12);
}

#[test]
fn poses_turn_move_and_scale() {
    let seat = ScreenView {
        corners: [DVec3::new(-1.0, -1.0, -1.0), DVec3::new(1.0, -1.0, -1.0), DVec3::NEG_ONE],
        canvas: [100, 100],
        origin: [0, 0],
        size: [100, 100],
        eye: DVec3::ZERO,
        near_m: 0.1,
    };
    let seat = ScreenView {
        corners: [seat.corners[0], seat.corners[1], DVec3::new(-1.0, 1.0, -1.0)],
        ..seat
    };
    // A quarter turn to the left: ahead is −x. A metre of the room is two of the world.
    let rotation = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let pose = Pose { position: DVec3::new(1e7, 0.0, 0.0), rotation, scale: 2.0 };
    let view = View::new(&seat, &pose).expect("in front");
    let pixel = view.pixel(DVec3::new(1e7 - 4.0, 2.0, -2.0)).expect("seen");
    assert!(pixel.distance(DVec2::new(75.0, 25.0)) < 1e-6, "{pixel}");
    let behind = ScreenView { eye: DVec3::new(0.0, 0.0, -1.5), ..seat };
    assert!(View::new(&behind, &pose).unwrap_err().contains("0.5 m behind"));
}

#[test]
fn a_vertex_in_the_plane_of_the_eye_needs_no_division() {
    let seen = [
        HomogeneousPixel { x: 0.0, y: 50.0, w: 1.0 },
        HomogeneousPixel { x: 300.0, y: 40.0, w: 0.0 },
        HomogeneousPixel { x: 100.0, y: 90.0, w: 1.0 },
    ];
    let polygon = clip(seen, [200, 100], 0.1);
    assert!(polygon.len() >= 4 && polygon.iter().all(|p| p.w >= 0.1 - 1e-15), "{polygon:?}");
    let inside = |p: &HomogeneousPixel| p.x >= -1e-9 && p.x <= 200.0 * p.w + 1e-9;
    assert!(polygon.iter().all(inside), "{polygon:?}");
    assert!(clip(seen.map(|p| HomogeneousPixel { w: -1.0, ..p }), [200, 100], 0.1).is_empty());
}

/// The clipped polygon must cover exactly the pixels whose rays hit the whole triangle.
#[test]
fn clipped_polygons_cover_what_the_edge_functions_say() {
    let view = view();
    let mut random = fastrand::Rng::with_seed(4);
    let mut around_the_eye = 0;
    for _ in 0..300 {
        let corner = |random: &mut fastrand::Rng| {
            [random.f64() * 4.0 - 2.0, random.f64() * 4.0 - 2.0, random.f64() * 4.0 - 3.0]
        };
        let facet = facet([corner(&mut random), corner(&mut random), corner(&mut random)]);
        let facet = Facet { is_double_sided: true, ..facet };
        around_the_eye += usize::from(facet.corners.iter().any(|c| c.place.z > 0.0));
        let Some(projected) = Projected::new(&view, &facet) else { continue };
        for y in 0..100 {
            for x in 0..200 {
                let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let (w, _) = projected.at(center);
                // A ray through the pixel, and the plane of the triangle, by another way.
                let ray = view.world(center, 1.0);
                let [a, b, c] = facet.corners.map(|corner| corner.place);
                let normal = (b - a).cross(c - a);
                let hit = ray * (normal.dot(a) / normal.dot(ray));
                let outward = |p: DVec3, q: DVec3| normal.cross(q - p).dot(hit - p);
                let is_hit = -hit.z >= 0.1
                    && [outward(a, b), outward(b, c), outward(c, a)].iter().all(|&d| d >= 0.0);
                if projected.margin(center).abs() > 1e-6 {
                    assert_eq!(projected.covers(center), is_hit, "{x}, {y} of {facet:?}");
                }
                if is_hit {
                    assert!((w + hit.z).abs() < 1e-6 * w, "{w} and {hit}");
                }
            }
        }
    }
    assert!(around_the_eye > 100);
}

#[test]
fn triangles_that_share_an_edge_share_no_pixel_and_miss_none() {
    let view = view();
    let mut random = fastrand::Rng::with_seed(9);
    for round in 0..200 {
        // Corners on pixel centres are the hard ones.
        let mut corner = || {
            let part = if round % 2 == 0 { 0.5 } else { random.f64() };
            let (x, y) = (f64::from(random.u32(20..180)), f64::from(random.u32(10..90)));
            view.world(DVec2::new(x + part, y + part), 1.0 + f64::from(random.u32(0..3)))
        };
        let middle = corner();
        let mut ring = [corner(), corner(), corner(), corner(), corner()];
        let at = view.pixel(middle).expect("seen");
        let angle = |p: &DVec3| {
            let away = view.pixel(*p).expect("seen") - at;
            away.y.atan2(away.x)
        };
        ring.sort_by(|p, q| angle(p).total_cmp(&angle(q)));
        let facets: Vec<Facet> = (0..5)
            .map(|i| facet([middle, ring[(i + 1) % 5], ring[i]].map(|p| p.to_array())))
            .collect();
        let fan: Vec<Projected> =
            facets.iter().filter_map(|facet| Projected::new(&view, facet)).collect();
        for (x, y) in (0..100).flat_map(|y| (0..200).map(move |x| (x, y))) {
            let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let count = fan.iter().filter(|projected| projected.covers(center)).count();
            assert!(count <= 1, "{count} triangles cover {x}, {y} in round {round}");
        }
        // Around the middle, where all of them meet, none may be missing.
        let is_around = fan.len() == 5;
        if is_around {
            let center = at.floor() + 0.5;
            let count = fan.iter().filter(|projected| projected.covers(center)).count();
            let is_within = fan.iter().any(|projected| projected.margin(center) > -1e-9);
            assert!(!is_within || count == 1, "{count} at the middle in round {round}");
        }
    }
}

#[test]
fn colours_follow_the_perspective() {
    let view = view();
    // A floor from 1 m to 10 m; the middle of its picture is nearer to the far end than 5.5 m.
    let mut floor = facet([[-1.0, -0.4, -1.0], [1.0, -0.4, -1.0], [0.0, -0.4, -10.0]]);
    for corner in &mut floor.corners {
        corner.color = DVec3::splat(-corner.place.z / 10.0);
    }
    let samples = raster::draw(&view, &[floor], DVec3::ZERO);
    let mut seen = 0;
    for (index, sample) in samples.iter().enumerate().filter(|(_, s)| s.facet.is_some()) {
        let down = (index / 200) as f64 + 0.5 - 50.0;
        let z = 0.4 * 100.0 / down;
        assert!((sample.w - z).abs() < 1e-9 && (sample.light.x - z / 10.0).abs() < 1e-9);
        seen += 1;
    }
    assert!(seen > 500, "{seen}");
}

#[test]
fn codes_of_the_tone_curve() {
    let near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-6;
    // 0.5 less the offset of 0.04 is 0.46, whose sRGB code is 180.634.
    assert!((tone::codes(DVec3::splat(0.5), 1.0).x - 180.634).abs() < 0.001);
    assert!(near(tone::codes(DVec3::splat(0.25), 2.0).x, tone::codes(DVec3::splat(0.5), 1.0).x));
    assert!(tone::codes(DVec3::splat(1e9), 1.0).x <= 255.0);
    assert!(near(tone::linear(255), 1.0) && near(tone::linear(0), 0.0));
    for code in 0..=255 {
        let shown = tone::unlit_codes(DVec3::splat(tone::linear(code)));
        assert!((shown.x - f64::from(code)).abs() < 0.01, "{shown} instead of {code}");
    }
}
