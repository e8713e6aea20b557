//! Points on surfaces, there and back, and rays that meet them.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DQuat, DVec2, DVec3};

use super::{Cylinder, Plane, Sphere, Surface};

fn surfaces() -> Vec<Surface> {
    let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.3, -0.2, 0.1);
    let center = DVec3::new(0.4, 1.1, -0.2);
    let inside = Cylinder {
        center,
        rotation,
        radius_m: 3.0,
        azimuth_rad: [-PI / 3.0, PI / 2.0],
        height_m: [-0.5, 1.5],
    };
    let dome = Sphere {
        center,
        rotation,
        radius_m: 4.0,
        azimuth_rad: [-1.0, 1.2],
        elevation_rad: [-0.1, 1.0],
    };
    vec![
        Surface::Plane(Plane {
            lower_left: DVec3::new(-1.0, 0.0, -2.0),
            lower_right: DVec3::new(1.0, 0.0, -3.0),
            upper_left: DVec3::new(-1.0, 1.5, -2.0),
        }),
        Surface::Cylinder(inside),
        Surface::Cylinder(Cylinder { azimuth_rad: [PI / 3.0, -PI / 2.0], ..inside }),
        Surface::Sphere(dome),
        Surface::Sphere(Sphere { azimuth_rad: [1.2, -1.0], ..dome }),
    ]
}

fn places() -> impl Iterator<Item = DVec2> {
    (0..=6).flat_map(|x| (0..=6).map(move |y| DVec2::new(f64::from(x), f64::from(y)) / 6.0))
}

#[test]
fn places_of_a_surface_come_back() {
    for surface in surfaces() {
        assert_eq!(surface.fault(0), None);
        for uv in places() {
            let point = surface.display_from_uv(uv).unwrap();
            let back = surface.uv_from_display(point).unwrap();
            assert!((back - uv).length() < 1e-12, "{surface:?} {uv} {back}");
        }
    }
}

#[test]
fn rays_meet_the_side_that_is_seen() {
    for surface in surfaces() {
        for uv in places() {
            let point = surface.display_from_uv(uv).unwrap();
            let step = 1e-6;
            let right = surface.display_from_uv(uv + DVec2::X * step).unwrap() - point;
            let down = surface.display_from_uv(uv + DVec2::Y * step).unwrap() - point;
            // As the viewer sees it, x to the right and y down: z, away from the viewer.
            let toward = down.cross(right).normalize();
            let normal = surface.normal(uv).unwrap();
            assert!(normal.distance(toward) < 1e-5, "{surface:?} {uv}: {normal}, not {toward}");
            let from = point + toward * 0.5;
            let hit = surface.hit(from, (point - from) * 0.1).expect("met");
            assert!(hit.distance(point) < 1e-9, "{surface:?} {uv}: {hit}, not {point}");
            assert_eq!(surface.hit(from, from - point), None, "the other way");
        }
    }
}

#[test]
fn a_whole_turn_has_its_seam_behind_the_viewer() {
    let round = Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-PI, PI],
        height_m: [0.0, 2.0],
    });
    assert_eq!(round.fault(0), None);
    let ahead = round.display_from_uv(DVec2::new(0.5, 1.0)).unwrap();
    assert!(ahead.distance(DVec3::new(0.0, 0.0, -3.0)) < 1e-12);
    let right = round.display_from_uv(DVec2::new(0.75, 0.0)).unwrap();
    assert!(right.distance(DVec3::new(3.0, 2.0, 0.0)) < 1e-12);
    assert!((round.size_m().x - 6.0 * PI).abs() < 1e-12);
    for u in [0.001, 0.25, 0.999] {
        let back = round.uv_from_display(round.display_from_uv(DVec2::new(u, 0.5)).unwrap());
        assert!((back.unwrap().x - u).abs() < 1e-12);
    }
}

#[test]
fn the_pole_of_a_dome_is_one_point() {
    let dome = Sphere {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 2.0,
        azimuth_rad: [-PI, PI],
        elevation_rad: [0.0, FRAC_PI_2],
    };
    for u in [0.0, 0.3, 1.0] {
        let pole = dome.display_from_uv(DVec2::new(u, 0.0));
        assert!(pole.distance(DVec3::Y * 2.0) < 1e-12);
    }
}

#[test]
fn numbers_that_are_no_surface_are_refused() {
    let cylinder = Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 1.0,
        azimuth_rad: [0.0, 1.0],
        height_m: [0.0, 1.0],
    };
    for bad in [
        Cylinder { radius_m: 0.0, ..cylinder },
        Cylinder { azimuth_rad: [0.5, 0.5], ..cylinder },
        Cylinder { azimuth_rad: [0.0, 7.0], ..cylinder },
        Cylinder { height_m: [1.0, 1.0], ..cylinder },
        Cylinder { center: DVec3::NAN, ..cylinder },
        Cylinder { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), ..cylinder },
    ] {
        assert!(Surface::Cylinder(bad).fault(0).is_some(), "{bad:?}");
    }
    assert!(Surface::Mesh(0).fault(0).is_some() && Surface::Mesh(0).fault(1).is_none());
}
