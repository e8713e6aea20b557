//! Windows on tiles against one window, and what lies over what.

use super::*;
use crate::camera::Camera;
use crate::surface::Plane;
use crate::{StereoPacking, Surface};

const WHOLE: [u32; 4] = [0, 0, 64, 32];

/// Two by two tiles of 32 × 16 pixels on a screen of 2 m × 1 m.
fn tiled() -> Wall {
    let plane = Plane::upright(DVec3::new(0.5, 1.0, -2.0), DVec2::new(2.0, 1.0));
    let screen = Screen::new("front", Surface::Plane(plane), UVec2::new(64, 32));
    let tile = |x: u32, y: u32| {
        let (origin, size) = (UVec2::new(x * 32, y * 16), UVec2::new(32, 16));
        Channel::tile(&format!("t{x}{y}"), 0, origin, size)
    };
    Wall::new("test", vec![screen], vec![tile(0, 0), tile(1, 0), tile(0, 1), tile(1, 1)])
}

fn own(rect: [u32; 4], projection: ViewProjection) -> View {
    let area = Area::Screen { screen: 0, rect };
    View { area, projection, ..View::of_wall(Camera::IDENTITY) }
}

fn lenses() -> [ViewProjection; 2] {
    [
        ViewProjection::Perspective { fov_y_rad: 0.9 },
        ViewProjection::Orthographic { height_m: 12.0 },
    ]
}

/// The pixel of the window that shows a point before the camera, by hand.
fn by_hand(projection: ViewProjection, size: DVec2, point: DVec3) -> DVec2 {
    let per_pixel = match projection {
        ViewProjection::Perspective { fov_y_rad } => 2.0 * (fov_y_rad / 2.0).tan() * -point.z,
        ViewProjection::Orthographic { height_m } => height_m,
        ViewProjection::Wall => f64::NAN,
    } / size.y;
    size / 2.0 + DVec2::new(point.x, -point.y) / per_pixel
}

#[test]
fn tiles_of_a_window_show_what_one_display_of_its_size_shows() {
    let wall = tiled();
    for (rect, projection) in [WHOLE, [6, 4, 40, 20], [40, 2, 10, 8]]
        .into_iter()
        .flat_map(|rect| lenses().map(|projection| (rect, projection)))
    {
        let view = own(rect, projection);
        let size = DVec2::new(f64::from(rect[2]), f64::from(rect[3]));
        for turn in 0..40 {
            let t = f64::from(turn);
            let point = DVec3::new(t.sin() * 3.0, (t * 2.1).cos() * 2.0, -0.5 - t * 0.7);
            let expected = by_hand(projection, size, point);
            for (id, channel) in wall.channel_ids().zip(&wall.channels) {
                let frustum = wall.view_frustum(id, &view, DVec3::new(0.3, 0.1, 0.0));
                let seen = frustum.expect("a frustum").pixel_from_display(point).expect("ahead");
                let on_screen = seen + channel.origin.as_dvec2();
                let in_window = on_screen - DVec2::new(f64::from(rect[0]), f64::from(rect[1]));
                assert!(in_window.distance(expected) < 1e-9, "{in_window} {expected} {view:?}");
            }
        }
    }
}

#[test]
fn tiles_share_the_matrix_of_a_window_and_own_frusta_agree() {
    let wall = tiled();
    let mut apart = tiled();
    apart.channels.iter_mut().for_each(|channel| channel.projection = FrustumMode::Own);
    let point = DVec3::new(0.4, 0.2, -3.0);
    for projection in lenses() {
        let view = own([6, 4, 40, 20], projection);
        let first = wall.view_frustum(ChannelId(0), &view, DVec3::ZERO).expect("a frustum");
        for id in wall.channel_ids() {
            let frustum = wall.view_frustum(id, &view, DVec3::ZERO).expect("a frustum");
            assert_eq!(frustum.clip_from_view, first.clip_from_view);
            assert_eq!(frustum.viewport[..2].iter().map(|x| x.fract()).sum::<f64>(), 0.0);
            let own = apart.view_frustum(id, &view, DVec3::ZERO).expect("a frustum");
            assert_eq!(own.viewport, [0.0, 0.0, 32.0, 16.0]);
            let [a, b] = [frustum, own].map(|f| f.pixel_from_display(point).expect("ahead"));
            assert!(a.distance(b) < 1e-9, "{a} {b}");
        }
    }
}

#[test]
fn depth_is_reversed_and_begins_at_the_near_plane() {
    let wall = tiled();
    for projection in lenses() {
        let view = own(WHOLE, projection);
        let clip = wall.view_frustum(ChannelId(0), &view, DVec3::ZERO).expect("it").clip_from_view;
        let depth = |z: f64| {
            let clip = clip * DVec4::new(0.1, 0.1, z, 1.0);
            clip.z / clip.w
        };
        assert!((depth(-wall.near_m) - 1.0).abs() < 1e-12);
        assert!(depth(-1.0) > depth(-2.0) && depth(-2.0) > 0.0);
    }
}

#[test]
fn a_camera_before_a_screen_sees_what_an_eye_there_sees_through_it() {
    let mut wall = tiled();
    let fov_y_rad = 2.0 * (0.5_f64 / 1.25).atan();
    let view = own(WHOLE, ViewProjection::Perspective { fov_y_rad });
    // The eye before the middle of the screen, at the distance of that angle.
    wall.eye = DVec3::new(0.5, 1.0, -0.75);
    for id in wall.channel_ids() {
        let own = wall.view_frustum(id, &view, wall.eye).expect("own");
        let through = wall.frustum(id, wall.eye).expect("through the wall");
        let apart = (own.clip_from_view - through.clip_from_view).abs_diff_eq(DMat4::ZERO, 1e-12);
        assert!(apart && own.viewport == through.viewport, "{own:?} {through:?}");
    }
}

#[test]
fn screens_of_one_plane_are_one_window() {
    let mut wall = tiled();
    // The same wall as two screens side by side.
    let half = |x: f64| {
        let plane = Plane::upright(DVec3::new(x, 1.0, -2.0), DVec2::new(1.0, 1.0));
        Screen::new(&format!("at {x}"), Surface::Plane(plane), UVec2::new(32, 32))
    };
    let whole = tiled();
    wall.screens = vec![half(0.0), half(1.0)];
    for channel in &mut wall.channels {
        channel.screen = u16::from(channel.origin.x > 0);
        channel.origin.x = 0;
    }
    for projection in lenses() {
        let view = View { projection, ..View::of_wall(Camera::IDENTITY) };
        assert_eq!(wall.check_views(std::slice::from_ref(&view)), Ok(()));
        for id in wall.channel_ids() {
            let [one, two] = [&whole, &wall]
                .map(|wall| wall.view_frustum(id, &view, DVec3::ZERO).expect("a frustum"));
            let point = DVec3::new(0.2, 0.4, -3.0);
            let [one, two] = [one, two].map(|f| f.pixel_from_display(point).expect("ahead"));
            assert!(one.distance(two) < 1e-9, "{one} {two}");
        }
        let mut cave = wall.clone();
        let corner = DVec3::new(0.5, 0.5, -2.0);
        cave.screens[1].surface = Surface::Plane(Plane {
            lower_left: corner,
            lower_right: corner + DVec3::Z,
            upper_left: corner + DVec3::Y,
        });
        let error = cave.check_views(&[view]).expect_err("an edge").to_string();
        assert!(error.contains("at 0") && error.contains("name one"), "{error}");
    }
}

#[test]
fn later_views_lie_over_earlier_ones() {
    let wall = tiled();
    let base = View::of_wall(Camera::IDENTITY);
    let views = [
        base.clone(),
        own([10, 4, 40, 20], lenses()[0]),
        own([20, 0, 44, 10], lenses()[1]),
        own(WHOLE, lenses()[0]),
    ];
    for count in 1..=views.len() {
        for (id, channel) in wall.channel_ids().zip(&wall.channels) {
            let parts = wall.view_rects(id, &views[..count]).expect("parts");
            for (x, y) in (0..32).flat_map(|x| (0..16).map(move |y| (x, y))) {
                let holds = |[left, top, width, height]: [u32; 4], x: u32, y: u32| {
                    (left..left + width).contains(&x) && (top..top + height).contains(&y)
                };
                let on = channel.origin + UVec2::new(x, y);
                let expected = views[..count].iter().rposition(|view| match view.area {
                    Area::Wall => true,
                    Area::Screen { rect, .. } => holds(rect, on.x, on.y),
                });
                let shown: Vec<_> = parts.iter().filter(|part| holds(part.rect, x, y)).collect();
                assert_eq!(shown.len(), 1, "one view at ({x}, {y})");
                assert_eq!(Some(shown[0].view), expected, "at ({x}, {y})");
            }
        }
    }
    // What is wholly covered is not drawn.
    assert_eq!(wall.view_rects(ChannelId(1), &views).expect("parts").len(), 1);
}

#[test]
fn views_that_cannot_be_are_refused_with_what_would_be_right() {
    let wall = tiled();
    let refused = |wall: &Wall, view: View, parts: &[&str]| {
        let error = wall.check_views(&[view]).expect_err("refused").to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{parts:?} are not in {error}");
    };
    let plan = lenses()[1];
    for rect in [[0, 0, 65, 32], [0, 0, 0, 4], [60, 0, u32::MAX, 4], [0, 32, 1, 1]] {
        refused(&wall, own(rect, plan), &["not on screen front", "64 × 32"]);
    }
    let elsewhere = Area::Screen { screen: 3, rect: WHOLE };
    refused(&wall, View { area: elsewhere, ..own(WHOLE, plan) }, &["1 screen", "number 3"]);
    for fov_y_rad in [0.0, -1.0, 3.2, f64::NAN] {
        refused(&wall, own(WHOLE, ViewProjection::Perspective { fov_y_rad }), &["field of view"]);
    }
    for height_m in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        refused(&wall, own(WHOLE, ViewProjection::Orthographic { height_m }), &["above 0"]);
    }
    let camera = Camera { scale: 0.0, ..Camera::IDENTITY };
    refused(&wall, View { camera, ..own(WHOLE, plan) }, &["scale"]);
    let mut pinned = tiled();
    pinned.channels[2].adjustment.pin[1] = DVec2::X;
    assert_eq!(pinned.check_views(&[own(WHOLE, plan)]), Ok(()), "it lies on the canvas");
    let mut hidden = tiled();
    hidden.screens[0].surface = Surface::Mesh(0);
    assert_eq!(hidden.check_views(&[own(WHOLE, plan)]), Ok(()), "its file has a canvas");
    hidden.channels[2].cover = ChannelKind::Map;
    refused(&hidden, own(WHOLE, plan), &["channel t01", "screen front", "a warp of u, v"]);
    assert_eq!(hidden.check_views(&[View::of_wall(Camera::IDENTITY)]), Ok(()));
    let mut packed = tiled();
    packed.channels[2].adjustment.packing = StereoPacking::SideBySide;
    assert_eq!(packed.check_views(&[own(WHOLE, plan)]), Ok(()), "both eyes see the same");
    let many = vec![own(WHOLE, plan); VIEWS_MAX + 1];
    assert_eq!(wall.check_views(&many), Err(ViewError::TooMany(VIEWS_MAX + 1)));
}

/// A rectangle high up on a dome is narrower than one at its foot, and as high.
#[test]
fn a_window_on_a_dome_has_the_sides_of_its_middle() {
    use crate::surface::Sphere;
    let sphere = Sphere {
        center: DVec3::ZERO,
        rotation: glam::DQuat::IDENTITY,
        radius_m: 2.0,
        azimuth_rad: [-1.0, 1.0],
        elevation_rad: [0.0, 1.2],
    };
    let screen = Screen::new("dome", Surface::Sphere(sphere), UVec2::new(200, 120));
    for (y, elevation) in [(0, 1.1f64), (100, 0.1)] {
        let part = CanvasRect {
            begin: DVec2::new(50.0, f64::from(y)),
            end: DVec2::new(70.0, f64::from(y) + 20.0),
        };
        let due = DVec2::new(0.2 * elevation.cos(), 0.2) * 2.0;
        let found = screen.part_size_m(&part);
        assert!(found.distance(due) < 1e-12, "{found} {due}");
    }
}

#[test]
fn a_channel_in_too_many_pieces_is_refused() {
    let mut wall = tiled();
    wall.screens[0].canvas = UVec2::new(512, 512);
    wall.channels.truncate(1);
    wall.channels[0].size = UVec2::new(512, 512);
    // A net of rows and columns, seen through by every view below.
    let strips = (0..31u32).flat_map(|n| [[n * 16, 0, 4, 512], [0, n * 16, 512, 4]]);
    let mut views = vec![View::of_wall(Camera::IDENTITY)];
    views.extend(strips.map(|rect| own(rect, lenses()[0])));
    assert!(views.len() <= VIEWS_MAX);
    let error = wall.check_views(&views).expect_err("too many").to_string();
    assert!(error.contains("t00") && error.contains("256"), "{error}");
    let mut bent = wall.clone();
    bent.channels[0].adjustment.pin[0] = DVec2::X;
    assert_eq!(bent.check_views(&views), Ok(()), "each has a picture of its own there");
    views.truncate(12);
    assert_eq!(wall.check_views(&views), Ok(()));
}
