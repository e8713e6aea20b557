//! Pixels of walls, the rays that they show, and where these rays are drawn.

use std::path::Path;

use glam::{DQuat, DVec2, DVec3, DVec4};
use polyptych_wall::camera::Camera;
use polyptych_wall::pick_ray::PickError;
use polyptych_wall::region::RegionTest;
use polyptych_wall::view::{Area, View, ViewProjection};
use polyptych_wall::{ChannelId, Eye, Wall};

fn camera() -> Camera {
    Camera {
        position: DVec3::new(1e5, -3.0, 40.0),
        rotation: DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(-0.3),
        scale: 2.5,
    }
}

/// Returns the place where a channel draws a point of the world, in pixels of its screen.
fn drawn(wall: &Wall, id: ChannelId, view: &View, eye: DVec3, world: DVec3) -> DVec2 {
    let frustum = wall.view_frustum(id, view, eye).expect("a frustum");
    let Camera { position, rotation, scale } = view.camera;
    let display = rotation.inverse() * (world - position) / scale;
    let seen = frustum.view_from_display * (display - frustum.eye);
    let clip: DVec4 = frustum.clip_from_view * seen.extend(1.0);
    let ndc = DVec2::new(clip.x, clip.y) / clip.w;
    let [x, y, width, height] = frustum.viewport;
    let at = DVec2::new(x + (ndc.x * 0.5 + 0.5) * width, y + (0.5 - ndc.y * 0.5) * height);
    at + wall.channel(id).expect("a channel").origin.as_dvec2()
}

/// Every shipped wall whose channels lie on their screens, and so are drawn by one frustum.
fn walls() -> Vec<Wall> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    ["single", "wall-2x2", "wall-3x1", "bezel-2x2", "cave-4", "powerwall-overlap"]
        .map(|name| {
            let path = configs.join(format!("{name}.toml"));
            polyptych_wall_file::load(&path).expect("a wall")
        })
        .into()
}

#[test]
fn a_pixel_of_the_wall_is_where_its_ray_is_drawn() {
    let (mut worst, mut count) = (0.0f64, 0);
    for wall in walls() {
        let head = wall.head();
        for id in wall.channel_ids() {
            let channel = wall.channel(id).expect("a channel");
            let screen = &wall.screen_of(channel).name;
            let own = View::of_wall(camera());
            let (origin, size) = (channel.origin.as_dvec2(), channel.size.as_dvec2());
            for step in 0..500u32 {
                let part = DVec2::new(f64::from(step * 37 % 101), f64::from(step * 59 % 97));
                let pixel = origin + size * part / 101.0;
                let ray =
                    wall.pick_ray(std::slice::from_ref(&own), &head, screen, pixel).expect("a ray");
                let far = ray.at(0.5 + f64::from(step));
                let eye = head.eye(Eye::Center);
                worst = worst.max(drawn(&wall, id, &own, eye, far).distance(pixel));
                count += 1;
            }
        }
    }
    println!("{count} pixels, worst {worst:.2e} px");
    assert!(count >= 10_000 && worst < 0.01, "{count} pixels, worst {worst} px");
}

#[test]
fn cameras_of_their_own_are_picked_through_their_windows() {
    let wall = polyptych_wall_file::load(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/wall-2x2.toml"),
    )
    .expect("a wall");
    let screen = &wall.screens[0].name;
    let area = Area::Screen { screen: 0, rect: [100, 50, 700, 400] };
    for projection in [
        ViewProjection::Perspective { fov_y_rad: 0.9 },
        ViewProjection::Orthographic { height_m: 12.0 },
    ] {
        let view = View { area, projection, ..View::of_wall(camera()) };
        let views = [View::of_wall(Camera::IDENTITY), view.clone()];
        for pixel in [DVec2::new(100.5, 50.5), DVec2::new(444.0, 300.0), DVec2::new(799.0, 449.0)] {
            let ray = wall.pick_ray(&views, &wall.head(), screen, pixel).expect("a ray");
            let back = drawn(&wall, ChannelId(0), &view, DVec3::ZERO, ray.at(7.0));
            assert!(back.distance(pixel) < 1e-6, "{projection:?} {pixel}: {back}");
        }
        let beside = DVec2::new(99.0, 60.0);
        let ray = wall.pick_ray(&views, &wall.head(), screen, beside).expect("a ray");
        assert_eq!(ray.origin, wall.head().position, "the wall's own picture");
    }
}

#[test]
fn a_rectangle_of_the_wall_shows_its_region() {
    let wall = walls().remove(1);
    let (head, screen) = (wall.head(), &wall.screens[0].name);
    let area = Area::Screen { screen: 0, rect: [100, 50, 700, 400] };
    let own = View::of_wall(camera());
    let laid = |projection| View { area, projection, ..View::of_wall(camera()) };
    for view in [
        own.clone(),
        laid(ViewProjection::Perspective { fov_y_rad: 0.9 }),
        laid(ViewProjection::Orthographic { height_m: 12.0 }),
    ] {
        let views = [own.clone(), view.clone()];
        let [begin, end] = [DVec2::new(150.0, 60.0), DVec2::new(800.0, 300.0)];
        let region = wall.pick_region(&views, &head, screen, [begin, end]).expect("a region");
        let test = RegionTest::new(&region).expect("a sound region");
        let pixels = [150.1, 400.0, 799.9].map(|x| [60.1, 299.9].map(|y| DVec2::new(x, y)));
        for pixel in pixels.as_flattened() {
            let ray = wall.pick_ray(&views, &head, screen, *pixel).expect("a ray");
            assert!(test.touches(&[ray.at(3.0); 3]), "{pixel} {:?}", view.projection);
            assert!(!test.touches(&[ray.at(-3.0); 3]), "behind the eye: {:?}", view.projection);
        }
        for pixel in [DVec2::new(149.9, 100.0), DVec2::new(200.0, 59.9), DVec2::new(200.0, 300.1)] {
            let ray = wall.pick_ray(&views, &head, screen, pixel).expect("a ray");
            assert!(!test.touches(&[ray.at(3.0); 3]), "{pixel} {:?}", view.projection);
        }
    }
    let views = [own, laid(ViewProjection::Orthographic { height_m: 12.0 })];
    let corners = |end: f64| [DVec2::splat(60.0), DVec2::splat(end)];
    let several = wall.pick_region(&views, &head, screen, corners(300.0));
    assert_eq!(several, Err(PickError::SeveralViews));
    let empty = wall.pick_region(&views, &head, screen, corners(60.0));
    assert!(matches!(empty, Err(PickError::EmptyRectangle { .. })));
    let nowhere = wall.pick_region(&views, &head, "roof", corners(70.0));
    assert!(matches!(nowhere, Err(PickError::NoScreen { .. })));
    let round = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/cylinder-360.toml");
    let round = polyptych_wall_file::load(&round).expect("a wall");
    let name = &round.screens[0].name;
    let curved = round.pick_region(&[], &round.head(), name, corners(70.0));
    assert_eq!(curved, Err(PickError::Curved(name.clone())));
}

#[test]
fn what_is_not_on_the_wall_is_told() {
    let wall = walls().remove(0);
    let head = wall.head();
    let pick = |screen: &str, pixel| wall.pick_ray(&[], &head, screen, pixel);
    let said = pick("roof", DVec2::ZERO).expect_err("no screen").to_string();
    assert!(said.contains("no screen \"roof\"; it has "), "{said}");
    let name = &wall.screens[0].name;
    for pixel in [DVec2::new(-1.0, 0.0), DVec2::splat(1e9), DVec2::splat(f64::NAN)] {
        assert!(matches!(pick(name, pixel), Err(PickError::OffScreen { .. })), "{pixel}");
    }
}
