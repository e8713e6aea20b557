//! Omnidirectional stereo as it is drawn, against rays in f64 that have an eye for each pixel.

use polyptych_wall::limits::CHANNEL_SIDE_MAX;
use polyptych_wall::projector::Projector;
use polyptych_wall::view_atlas::ViewAtlas;
use polyptych_wall::{StereoMode, StereoRule};

use super::*;

/// Off by no more than this on the screen, in pixels, however many pictures it is drawn from.
const SCREEN_MAX_PX: f64 = 0.05;

/// A wall for both eyes, which are far apart, so that much is seen.
fn around(surface: Surface, size: [u32; 2], error_max_px: f64) -> Wall {
    let mut wall = wall(surface, size);
    wall.stereo = StereoRule { mode: StereoMode::Omnidirectional, error_max_px };
    wall.eye_separation_m = 0.3;
    wall
}

/// Returns the light that each pixel of the display should show, if it has an eye of its own.
fn ideal(wall: &Wall, spot: &Spot) -> Vec<f64> {
    let map = wall.channel_mapping(ChannelId(0)).expect("a map");
    let viewpoint = wall.viewpoints(&wall.channels[0])[0];
    let size = wall.channels[0].size;
    let pixels = (0..size.y).flat_map(|y| (0..size.x).map(move |x| UVec2::new(x, y)));
    let light = |pixel: UVec2| {
        let point = map.display_from_pixel(pixel.as_dvec2() + 0.5)?;
        let eye = viewpoint.eye_for(point);
        Some(spot.light(eye, point - eye))
    };
    pixels.map(|pixel| light(pixel).unwrap_or(0.0)).collect()
}

/// Draws all spots at once, and returns where each is for each eye. The screen is 3 m away: spots
/// there lie on it.
fn places(name: &str, wall: &Wall, spots: &[Spot]) -> Vec<[DVec2; 2]> {
    let mut found = vec![[DVec2::ZERO; 2]; spots.len()];
    for (side, eye) in [Eye::Left, Eye::Right].into_iter().enumerate() {
        let mut wall = wall.clone();
        wall.channels[0].adjustment.eye = eye;
        let plan =
            CorrectionPlan::new(&wall, &CalibrationMaps::default(), ChannelId(0)).expect("a plan");
        let plan = plan.expect("a correction");
        let mut corrector = Corrector::new(gpu(), plan, &wall, None).expect("a corrector");
        let mut renderer = Renderer::new(gpu(), 1).expect("a renderer");
        let scene = scene(spots);
        renderer.prepare_for(gpu(), &scene, ImageEncoding::Light);
        let mut output = ChannelOutput::new("curve".into(), None, None);
        let frame = frame(wall.head());
        let drawing = (&mut renderer, &scene);
        corrector.draw(gpu(), drawing, &wall, &frame, &mut output).expect("drawn");
        let shots = corrector.shots.as_ref().expect("shots");
        println!("{name}: {} planes, source {:?}", shots.eyes[0].planes.len(), shots.size);
        assert!(shots.eyes[0].planes.len() > 6, "{name}: one eye for too much");
        let bytes = read_picture(gpu(), output.picture().expect("a picture")).expect("read");
        let light: Vec<f64> =
            bytes.chunks(4).map(|code| linear_from_srgb(f64::from(code[0]) / 255.0)).collect();
        // Where the parts do not suffice, the plan says what they come to.
        let mesh = corrector.plan.warp.as_ref().expect("a mesh");
        let eyes = wall.viewpoints(&wall.channels[0]);
        let planned = ViewAtlas::new(mesh, &eyes, wall.near_m, CHANNEL_SIDE_MAX).expect("a plan");
        let planned_px = planned.stereo_error_px;
        assert!(planned_px < 1.0, "{name}: {planned_px} px");
        let (mut on_screen, mut off_screen) = (0f64, 0f64);
        for (spot, found) in spots.iter().zip(&mut found) {
            let wanted = ideal(&wall, spot);
            let width = wall.channels[0].size.x as usize;
            let (is, should) = (measure(&light, &wanted, width), measure(&wanted, &wanted, width));
            assert!(should.sum > 5.0, "{name}: the spot at {} is not shown", spot.place);
            let off = is.middle.distance(should.middle);
            let is_on = (spot.place.length() - 3.0).abs() < 0.1;
            let worst = if is_on { &mut on_screen } else { &mut off_screen };
            *worst = worst.max(off);
            // Where parts meet whose eyes differ, a strip is shown twice, or not at all, of a spot
            // that is about as wide as a disk of as much light.
            let (light, width_px) = (is.sum / should.sum, 2.0 * (should.sum / PI).sqrt());
            assert!(
                (light - 1.0).abs() < 0.03 + planned_px / width_px,
                "{name}: {} has {light}",
                spot.place
            );
            found[side] = is.middle;
        }
        println!("{name}, {eye:?}: on the screen {on_screen:.4}, off it {off_screen:.4} px");
        assert!(on_screen <= SCREEN_MAX_PX, "{name}: off by {on_screen} px on the screen");
        assert!(off_screen <= planned_px + SCREEN_MAX_PX, "{name}: off by {off_screen} px");
    }
    found
}

#[test]
fn a_ring_has_depth_in_all_directions() {
    let ring = cylinder(TAU, DQuat::IDENTITY);
    // Behind the viewer too, but not across the edges of the picture there.
    let azimuths = [-2.8, -2.1, -1.4, -0.7, 0.0, 0.7, 1.4, 2.1, 2.8];
    for (distance, half) in [(3.0, 0.4), (9.0, 1.2), (1.8, 0.25)] {
        let spots: Vec<_> = azimuths
            .iter()
            .map(|azimuth| Spot { place: toward(*azimuth, 0.1, distance), half })
            .collect();
        let size = [1200, 128];
        let wall = around(ring.clone(), size, 0.25);
        let found = places(&format!("ring, {distance} m"), &wall, &spots);
        // Two eyes that look there are 0.3 m apart: on the screen by as much less as it is near.
        let pixel_m = TAU * 3.0 / f64::from(size[0]);
        let level = distance * 0.1f64.cos();
        let expected = 0.3 * (1.0 - 3.0 / level) / pixel_m;
        for [left, right] in found {
            let apart = right.x - left.x;
            assert!((apart - expected).abs() < 0.7, "{apart} px, not {expected}, at {left}");
        }
    }
}

#[test]
fn a_dome_has_nearly_none_at_its_top() {
    let dome = Surface::Sphere(Sphere {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-PI, PI],
        elevation_rad: [0.0, PI / 2.0],
    });
    let spots: Vec<_> = [(-2.5, 0.95), (-1.0, 0.95), (0.5, 0.95), (2.0, 0.95), (2.7, 1.5)]
        .map(|(azimuth, elevation)| Spot { place: toward(azimuth, elevation, 9.0), half: 0.9 })
        .into();
    let mut wall = around(dome, [1024, 256], 0.5);
    // As far apart as people's: no number of parts is enough for five times that.
    wall.eye_separation_m = 0.063;
    wall.channels[0].size = UVec2::new(220, 220);
    wall.channels[0].cover = ChannelKind::Projector(Box::new(Projector {
        position: DVec3::new(0.1, 0.0, 0.05),
        rotation: DQuat::from_rotation_x(PI / 2.0),
        tangents: [-1.0, 1.0, -1.0, 1.0],
    }));
    let found = places("dome", &wall, &spots);
    for ([left, right], spot) in found[..4].iter().zip(&spots) {
        // The picture's upper edge is behind the viewer, its right edge at the right.
        let to_the_right = DVec2::new(-spot.place.z, -spot.place.x).normalize();
        let apart = (*right - *left).dot(to_the_right);
        assert!(apart > 0.8, "{apart} px, {left}, {right} of {}", spot.place);
    }
    let [left, right] = found[4];
    // Each eye may be off by what the plan says.
    assert!(left.distance(right) < 0.5, "{left}, {right}");
}

#[test]
fn a_flat_tile_has_eyes_of_its_own_in_each_part() {
    let plane = Surface::Plane(Plane::upright(DVec3::NEG_Z * 2.9, DVec2::new(6.0, 2.0)));
    let spots: Vec<_> = [-0.6, -0.1, 0.5]
        .map(|azimuth| Spot { place: toward(azimuth, 0.0, 9.0), half: 1.1 })
        .into();
    let found = places("tile", &around(plane, [480, 160], 0.25), &spots);
    assert!(found.iter().all(|[left, right]| right.x > left.x + 4.0), "{found:?}");
}
