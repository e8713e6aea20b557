//! The whole box is seen on every wall, and no larger one would be.

use std::path::Path;

use polyptych_wall::Surface;

use super::*;

/// A screen of 4 m by 2 m around (0, 1.5, -1), seen from beside its middle.
fn wall() -> Wall {
    let text = r#"
        [wall]
        name = "lab"
        [[screen]]
        name = "front"
        size = [4.0, 2.0]
        center = [0.0, 1.5, -1.0]
        [screen.tiles]
        pixels = [1920, 960]
    "#;
    let mut wall = polyptych_wall_file::parse(text, "lab.toml".as_ref()).expect("a wall");
    wall.eye = DVec3::new(0.3, 1.6, 2.0);
    wall
}

fn config(name: &str) -> Wall {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    polyptych_wall_file::load(&configs.join(name)).expect("a wall")
}

/// Boxes of all proportions: cubes, plates, towers, rods, lines, points; tiny, huge and far away.
fn boxes() -> Vec<Bounds> {
    let sizes = [
        [1.0, 1.0, 1.0],
        [1000.0, 5.0, 800.0],
        [0.001, 0.4, 0.002],
        [1.0, 400.0, 2.0],
        [300.0, 0.0, 0.0],
        [0.0, 0.0, 7.0],
        [0.0, 2.0, 0.0],
        [5.0, 0.0, 5.0],
        [0.0, 3.0, 4.0],
        [1e-6, 1e-6, 2e-6],
        [4e7, 1e7, 4e7],
        [0.0, 0.0, 0.0],
    ];
    let centers = [DVec3::ZERO, DVec3::new(-6.4e6, 250.0, 1e6)];
    let all = sizes.iter().flat_map(|size| centers.map(|center| (DVec3::from(*size), center)));
    // A box far away is as exact as f64 is there.
    let is_exact =
        |(size, center): &(DVec3, DVec3)| *center == DVec3::ZERO || size.max_element() > 1e-3;
    let boxes = all.filter(is_exact);
    boxes.map(|(s, c)| Bounds { min: c - s / 2.0, max: c + s / 2.0 }).collect()
}

fn corners(bounds: &Bounds) -> impl Iterator<Item = DVec3> {
    // A point counts as a cube of one unit.
    let is_point = bounds.radius() == 0.0;
    let half = if is_point { DVec3::splat(1.0 / 3.0_f64.sqrt()) } else { DVec3::ZERO };
    let (min, max) = (bounds.min - half, bounds.max + half);
    (0..8).map(move |i| {
        let pick = |bit: usize, axis: usize| if i & bit == 0 { min[axis] } else { max[axis] };
        DVec3::new(pick(1, 0), pick(2, 1), pick(4, 2))
    })
}

/// Returns whether a box is so long that only its end would be seen from near.
fn is_rod(bounds: &Bounds) -> bool {
    let mut size = (bounds.max - bounds.min).to_array();
    size.sort_by(f64::total_cmp);
    size[1] < 0.1 * size[2]
}

/// The place in display space at which a point of the world is drawn.
fn display_from_world(camera: &Camera, world: DVec3) -> DVec3 {
    camera.rotation.inverse() * (world - camera.position) / camera.scale
}

/// The least and the greatest place on the canvas at which the corners are seen, in shares of it.
fn extent(wall: &Wall, screen: usize, camera: &Camera, bounds: &Bounds) -> (DVec2, DVec2) {
    let screen = &wall.screens[screen];
    let seen = corners(bounds).map(|corner| {
        let ray = display_from_world(camera, corner) - wall.eye;
        let point = screen.surface.hit(wall.eye, ray).expect("in front of the eye");
        screen.canvas_from_display(point).expect("a place") / screen.canvas.as_dvec2()
    });
    seen.fold((DVec2::MAX, DVec2::MIN), |(min, max), at| (min.min(at), max.max(at)))
}

#[test]
fn overview_touches_two_edges_of_a_planar_wall_and_leaves_none() {
    let walls = ["single.toml", "wall-2x2.toml", "wall-3x1.toml", "bezel-2x2.toml"]
        .into_iter()
        .chain(["powerwall-overlap.toml", "cave-4.toml", "panoramic-3.toml"])
        .map(config)
        .chain([wall()]);
    for wall in walls {
        let front = wall.screens.iter().position(|screen| screen.name == "front").unwrap_or(0);
        for bounds in boxes() {
            for heading in [0.0, 0.52, 1.9, 3.3, 5.0] {
                let camera = fit_bounds(&wall, &bounds, heading);
                let label = format!("{}, {bounds:?}, heading {heading}", wall.name);
                assert_eq!(camera.fault(), None, "{label}");
                let (min, max) = extent(&wall, front, &camera, &bounds);
                let slack = 1e-6;
                assert!(min.min_element() > -slack, "{label}: {min}");
                assert!(max.max_element() < 1.0 + slack, "{label}: {max}");
                let touches = min.min_element() < slack || max.max_element() > 1.0 - slack;
                assert!(touches, "{label}: {min} to {max}");
                if is_rod(&bounds) {
                    continue;
                }
                let size = max - min;
                assert!(size.max_element() > 0.999, "{label}: {size}");
                // Centred across the other direction.
                let margin = (min + max - 1.0).abs().max_element();
                assert!(margin < 1e-5, "{label}: {min} to {max}");
                let nearest = corners(&bounds)
                    .map(|corner| -(display_from_world(&camera, corner) - wall.eye).z)
                    .fold(f64::MAX, f64::min);
                assert!(nearest > wall.near_m, "{label}: {nearest} m is cut off");
            }
        }
    }
}

#[test]
fn overview_of_a_flat_city_spans_the_width_of_a_wall() {
    let wall = config("wall-3x1.toml");
    let city = Bounds { min: DVec3::new(-400.0, 0.0, -300.0), max: DVec3::new(400.0, 20.0, 300.0) };
    for heading in 0..12 {
        let camera = fit_bounds(&wall, &city, f64::from(heading) * 0.52);
        let (min, max) = extent(&wall, 0, &camera, &city);
        assert!(max.x - min.x > 0.999, "heading {heading}: {min} to {max}");
    }
}

#[test]
fn overview_stays_within_curved_screens() {
    for name in ["cylinder-360.toml", "dome-5.toml"] {
        let wall = config(name);
        for bounds in boxes() {
            for heading in [0.0, 0.52, 1.9, 3.3, 5.0] {
                let camera = fit_bounds(&wall, &bounds, heading);
                let label = format!("{name}, {bounds:?}, heading {heading}");
                assert_eq!(camera.fault(), None, "{label}");
                let (min, max) = extent(&wall, 0, &camera, &bounds);
                assert!(min.min_element() > -1e-6, "{label}: {min}");
                assert!(max.max_element() < 1.0 + 1e-6, "{label}: {max}");
                // In front of the viewer, and large: a fifth of the circle or half of the height.
                let size = max - min;
                assert!(size.x > 0.19 || size.y > 0.5, "{label}: {size}");
                let middle = (min + max) / 2.0;
                assert!((middle.x - 0.5).abs() < 0.15, "{label}: {middle}");
            }
        }
    }
}

#[test]
fn screens_of_one_plane_count_as_one_unless_there_is_a_gap() {
    let text = |apart: f64| {
        format!(
            r#"
            [wall]
            name = "two"
            eye = [0.0, 0.0, 0.0]
            [[screen]]
            name = "left"
            size = [1.6, 0.9]
            center = [-{apart}, 0.0, -2.0]
            tiles.pixels = [1600, 900]
            [[screen]]
            name = "right"
            size = [1.6, 0.9]
            center = [{apart}, 0.0, -2.0]
            tiles.pixels = [1600, 900]
            "#
        )
    };
    let plate = Bounds { min: DVec3::new(-5.0, 0.0, -5.0), max: DVec3::new(5.0, 0.1, 5.0) };
    let width_m = |apart: f64| {
        let wall = polyptych_wall_file::parse(&text(apart), "two.toml".as_ref()).expect("a wall");
        let camera = fit_bounds(&wall, &plate, 0.0);
        let seen: Vec<f64> = corners(&plate)
            .map(|corner| display_from_world(&camera, corner))
            .map(|at| -2.0 * at.x / at.z)
            .collect();
        let (min, max) = seen.iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
        (min, max)
    };
    let (min, max) = width_m(0.81);
    assert!((min + 1.61).abs() < 1e-6 && (max - 1.61).abs() < 1e-6, "{min} to {max}");
    // Two metres of nothing between them: one screen shows all of it.
    let (min, max) = width_m(1.8);
    assert!((min + 2.6).abs() < 1e-6 && (max + 1.0).abs() < 1e-6, "{min} to {max}");
}

#[test]
fn overview_uses_only_what_tiles_light_of_a_screen() {
    let mut wall = config("wall-3x1.toml");
    wall.channels.truncate(2);
    let plate = Bounds { min: DVec3::new(-5.0, 0.0, -5.0), max: DVec3::new(5.0, 0.1, 5.0) };
    let camera = fit_bounds(&wall, &plate, 0.3);
    let (min, max) = extent(&wall, 0, &camera, &plate);
    assert!(min.x.abs() < 1e-6 && (max.x - 2.0 / 3.0).abs() < 1e-6, "{min} to {max}");
}

#[test]
fn orbit_keeps_the_sphere_around_the_scene_in_the_middle_of_the_front_screen() {
    let wall = wall();
    let bounds = Bounds { min: DVec3::splat(1e6), max: DVec3::splat(1e6 + 0.5) };
    for heading in [0.0, 1.0, 4.0] {
        let camera = orbit(&wall, &bounds, heading);
        assert_eq!(camera.fault(), None);
        let shown = camera.world_from_display(DVec3::new(0.0, 1.5, -1.0));
        assert!((shown - bounds.center()).length() < 1e-6);
        // From the eye, the sphere takes the angle of the screen's shorter side.
        let eye = camera.world_from_display(wall.eye);
        let sine = bounds.radius() / (eye - bounds.center()).length();
        let middle = DVec3::new(0.0, 1.5, -1.0) - wall.eye;
        assert!((sine - 1.0_f64.atan2(middle.length()).sin()).abs() < 1e-6);
        assert!(eye.y > bounds.center().y, "the eye stands above the scene");
    }
}

#[test]
fn orbit_puts_a_scene_in_the_middle_of_screens_of_every_shape() {
    let bounds = Bounds { min: DVec3::splat(-2.0), max: DVec3::splat(3.0) };
    for (name, middle) in [
        ("cylinder-360.toml", DVec3::new(0.0, 1.6, -3.0)),
        ("panoramic-3.toml", DVec3::new(0.0, 1.4, -3.0)),
        ("powerwall-overlap.toml", DVec3::new(0.0, 0.0, -3.0)),
        // Half way up to the zenith.
        ("dome-5.toml", DVec3::new(0.0, 2.6 + 8.0_f64.sqrt(), -8.0_f64.sqrt())),
    ] {
        let camera = orbit(&config(name), &bounds, 0.3);
        assert_eq!(camera.fault(), None, "{name}");
        let shown = camera.world_from_display(middle);
        assert!((shown - bounds.center()).length() < 1e-9, "{name}: {shown}");
    }
}

#[test]
fn walls_without_a_surface_and_eyes_behind_a_screen_give_a_camera_still() {
    let bare = Wall { screens: Vec::new(), ..wall() };
    let mut mesh = wall();
    mesh.screens[0].surface = Surface::Mesh(0);
    let behind = Wall { eye: DVec3::new(0.0, 1.5, -3.0), ..wall() };
    let in_plane = Wall { eye: DVec3::new(0.0, 1.5, -1.0), ..wall() };
    let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
    for wall in [&bare, &mesh, &behind, &in_plane] {
        for bounds in boxes().iter().chain([&point]) {
            assert_eq!(fit_bounds(wall, bounds, 0.0).fault(), None, "{bounds:?}");
        }
    }
    let nothing = Bounds { min: DVec3::splat(f64::NAN), max: DVec3::ONE };
    assert!(fit_bounds(&bare, &nothing, 0.0).fault().is_some());
    assert!(orbit(&bare, &nothing, 0.0).fault().is_some());
}
