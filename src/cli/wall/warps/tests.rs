//! Warp makers against their optics.

use super::*;

fn mirror() -> MirrorDome {
    MirrorDome {
        projector: DVec3::new(0.0, 1.0, 3.4),
        look_at: DVec3::new(0.0, 1.5, 4.6),
        tangents: DVec2::new(0.3, 0.17),
        shift: 0.1,
        mirror: Ball { center: DVec3::new(0.0, 1.4, 4.6), radius: 0.3 },
        dome: Ball { center: DVec3::new(0.0, 1.6, 0.0), radius: 5.0 },
        tilt_degrees: 0.0,
    }
}

#[test]
fn light_leaves_the_mirror_at_the_angle_at_which_it_comes() {
    let optics = mirror();
    optics.check().expect("light can go there");
    let mut lit = 0;
    for place in places([64, 36]) {
        let Some(point) = optics.point(place) else { continue };
        lit += 1;
        assert!((point.distance(optics.dome.center) - 5.0).abs() < 1e-9, "{point}");
        // Fermat: of all ways over the mirror light takes the shortest. Newton's steps find it
        // from the point alone, without the law of reflection.
        let length = |on: DVec3| optics.projector.distance(on) + on.distance(point);
        let Ball { center, radius } = optics.mirror;
        let on_mirror = |angles: DVec2| {
            let (sin, cos) = angles.y.sin_cos();
            center + radius * DVec3::new(cos * angles.x.sin(), sin, -cos * angles.x.cos())
        };
        let mut best = (f64::INFINITY, DVec2::ZERO);
        let mut step = 0.2;
        let mut around = DVec2::ZERO;
        while step > 1e-9 {
            let grid = (-8..=8).flat_map(|x| (-8..=8).map(move |y| (f64::from(x), f64::from(y))));
            for (x, y) in grid {
                let angles = around + DVec2::new(x, y) * step;
                let found = length(on_mirror(angles));
                best = if found < best.0 { (found, angles) } else { best };
            }
            (around, step) = (best.1, step / 4.0);
        }
        // Its ray leaves the projector where the place is.
        let ray = on_mirror(best.1) - optics.projector;
        let ahead = (optics.look_at - optics.projector).normalize();
        let right = ahead.cross(DVec3::Y).normalize();
        let up = right.cross(ahead);
        let tangent = DVec2::new(ray.dot(right), ray.dot(up)) / ray.dot(ahead);
        let found = (tangent / optics.tangents - DVec2::new(0.0, 0.2) + 1.0) / 2.0;
        let off_px = (found - place) * DVec2::new(1920.0, 1080.0);
        assert!(off_px.length() < 0.01, "{place}: {off_px} pixels off");
    }
    assert!(lit > 300, "{lit}");
}

#[test]
fn mirrors_that_cannot_be_are_refused() {
    let says = |optics: MirrorDome, part: &str| {
        let error = optics.check().expect_err(part).to_string();
        assert!(error.contains(part), "{part}: {error}");
    };
    let optics = mirror();
    says(MirrorDome { projector: optics.mirror.center, ..optics }, "within the mirror");
    says(MirrorDome { projector: DVec3::Z * 9.0, ..optics }, "outside of the dome");
    says(MirrorDome { look_at: optics.projector + DVec3::Y, ..optics }, "looks nowhere");
    for degrees in [0.0, -10.0, 361.0, f64::NAN] {
        let lens = Fisheye { degrees, tilt_degrees: 0.0 };
        assert!(lens.check().is_err(), "{degrees}");
    }
}

#[test]
fn pictures_of_all_directions_are_turned_by_any_yaw() {
    for (yaw, azimuth) in [(270.0, "[-270.0, 90.0]"), (-360.0, "[-180.0, 180.0]")] {
        let output = tempfile::tempdir().expect("a folder");
        let path = output.path().to_owned();
        let folder = Folder { name: None, eye: DVec3::Y, output: path, force: false };
        let arguments = EquirectangularArguments { folder, pixels: [64, 32], yaw, radius: 5.0 };
        arguments.run().expect("a wall");
        let text = std::fs::read_to_string(output.path().join("wall.toml")).expect("a wall file");
        assert!(text.contains(&format!("azimuth = {azimuth}")), "{yaw}: {text}");
    }
}

#[test]
fn points_are_three_numbers() {
    assert_eq!(point("0, 1.5,-2"), Ok(DVec3::new(0.0, 1.5, -2.0)));
    for text in ["", "1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,1e9"] {
        assert!(point(text).is_err(), "{text}");
    }
}

#[test]
fn a_dome_beyond_what_maps_may_hold_is_refused_and_not_written() {
    let parent = tempfile::tempdir().expect("a folder");
    let output = parent.path().join("dome");
    for (eye, radius) in [(DVec3::Y, 1500.0), (DVec3::X * 998.0, 5.0)] {
        let folder = Folder { name: None, eye, output: output.clone(), force: false };
        let (pixels, offset) = ([64; 2], DVec3::ZERO);
        let lens = FisheyeArguments { folder, pixels, degrees: 180.0, tilt: 0.0, radius, offset };
        let error = lens.run().expect_err("too far").to_string();
        assert!(error.contains("screen dome") && error.contains("1000 m"), "{error}");
        assert!(!output.exists(), "it is written");
    }
}

#[test]
fn maps_that_a_person_made_are_kept_without_force() {
    let output = tempfile::tempdir().expect("a folder");
    let map = output.path().join("dome.pfm");
    std::fs::write(&map, b"measured").expect("written");
    let make = |force: bool| {
        let path = output.path().to_owned();
        let folder = Folder { name: None, eye: DVec3::Y, output: path, force };
        let (pixels, offset) = ([64; 2], DVec3::ZERO);
        FisheyeArguments { folder, pixels, degrees: 180.0, tilt: 0.0, radius: 5.0, offset }.run()
    };
    let error = make(false).expect_err("it is there").to_string();
    assert!(error.contains("dome.pfm is there already; --force"), "{error}");
    assert_eq!(std::fs::read(&map).expect("read"), b"measured");
    assert!(!output.path().join("wall.toml").exists(), "it is written");
    make(true).expect("it was asked for");
    make(true).expect("again");
    assert!(std::fs::read(&map).expect("read").starts_with(b"PF"));
}
