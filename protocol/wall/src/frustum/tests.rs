//! Frusta against published numbers, against each other, and at their limits.

use glam::{DMat3, DVec2, DVec3, UVec2};
use proptest::prelude::*;

use super::{FrustumError, ScreenFrustum};
use crate::surface::{Plane, Surface};
use crate::{Channel, ChannelId, FrustumMode, Screen, Wall};

const WHOLE: ChannelId = ChannelId(0);
const SHARED: ChannelId = ChannelId(1);
const OWN: ChannelId = ChannelId(2);

/// A wall of one screen that is shown whole, and its lower right quarter twice: with the shared
/// matrix and with its own.
fn wall(a: DVec3, b: DVec3, c: DVec3, canvas: UVec2) -> Wall {
    let plane = Plane { lower_left: a, lower_right: b, upper_left: c };
    let screen = Screen::new("s", Surface::Plane(plane), canvas);
    let middle = canvas / 2;
    let whole = Channel::tile("whole", 0, UVec2::ZERO, canvas);
    let shared = Channel::tile("shared", 0, middle, canvas - middle);
    let own = Channel { name: "own".into(), projection: FrustumMode::Own, ..shared.clone() };
    Wall { near_m: 0.1, ..Wall::new("w", vec![screen], vec![whole, shared, own]) }
}

/// Width 2, height 1, one metre before the origin.
fn plain() -> Wall {
    wall(
        DVec3::new(-1.0, -0.5, -1.0),
        DVec3::new(1.0, -0.5, -1.0),
        DVec3::new(-1.0, 0.5, -1.0),
        UVec2::new(2000, 1000),
    )
}

fn near(found: f64, expected: f64, within: f64) -> bool {
    (found - expected).abs() <= within
}

#[test]
fn kooimas_numbers() {
    let eye = DVec3::new(0.3, -0.2, 0.5);
    let seen: ScreenFrustum = plain().screens[0].frustum(eye).unwrap();
    assert!(near(seen.distance_m, 1.5, 1e-12));
    let expected = [-0.0866667, 0.0466667, -0.02, 0.0466667];
    for (found, expected) in seen.near_edges_m(0.1).into_iter().zip(expected) {
        assert!(near(found, expected, 1e-6), "{found} is not {expected}");
    }
    // The same numbers are in the matrix: (r + l) / (r − l) and 2n / (r − l).
    let [left, right, bottom, top] = seen.near_edges_m(0.1);
    let matrix = plain().frustum(WHOLE, eye).unwrap().clip_from_view;
    assert!(near(matrix.x_axis.x, 0.2 / (right - left), 1e-12));
    assert!(near(matrix.y_axis.y, 0.2 / (top - bottom), 1e-12));
    assert!(near(matrix.z_axis.x, (right + left) / (right - left), 1e-12));
    assert!(near(matrix.z_axis.y, (top + bottom) / (top - bottom), 1e-12));
}

#[test]
fn depth_falls_from_one_at_the_near_plane_to_zero_at_infinity() {
    let frustum = plain().frustum(WHOLE, DVec3::ZERO).unwrap();
    let depth = |distance: f64| {
        let clip = frustum.clip_from_view * DVec3::new(0.3, 0.2, -distance).extend(1.0);
        clip.z / clip.w
    };
    assert!(near(depth(0.1), 1.0, 1e-15));
    let depths: Vec<f64> = (0..60).map(|step| depth(0.1 * 2.0_f64.powi(step))).collect();
    assert!(depths.is_sorted_by(|nearer, farther| nearer > farther));
    assert!(depth(1e300) >= 0.0 && depth(1e300) < 1e-300);
}

#[test]
fn pixel_rows_go_down_where_up_goes_up() {
    let wall = plain();
    let pixel = |point| wall.pixel_from_display(WHOLE, DVec3::ZERO, point).unwrap();
    assert!(pixel(DVec3::new(-1.0, 0.5, -1.0)).distance(DVec2::ZERO) < 1e-9);
    assert!(pixel(DVec3::new(1.0, -0.5, -1.0)).distance(DVec2::new(2000.0, 1000.0)) < 1e-9);
    // Twice as far is seen half as far from the middle.
    assert!(pixel(DVec3::new(1.0, 0.5, -2.0)).distance(DVec2::new(1500.0, 250.0)) < 1e-9);
}

#[test]
fn points_beside_and_behind_the_eye_have_no_pixel() {
    let wall = plain();
    for point in [DVec3::Z, DVec3::X, DVec3::ZERO, DVec3::splat(f64::NAN)] {
        assert_eq!(wall.pixel_from_display(WHOLE, DVec3::ZERO, point), None);
    }
}

#[test]
fn viewports_are_the_canvas_shifted_or_the_target() {
    let wall = plain();
    let viewport = |channel| wall.frustum(channel, DVec3::ZERO).unwrap().viewport;
    assert_eq!(viewport(SHARED), [-1000.0, -500.0, 2000.0, 1000.0]);
    assert_eq!(viewport(OWN), [0.0, 0.0, 1000.0, 500.0]);
}

#[test]
fn an_eye_in_the_plane_or_behind_it_is_an_error_that_names_all() {
    let in_plane = plain().frustum(OWN, DVec3::new(0.0, 0.0, -1.0)).unwrap_err();
    assert_eq!(
        in_plane.to_string(),
        "channel own: the eye [0, 0, -1] m is in the plane of screen s"
    );
    let behind = plain().frustum(OWN, DVec3::new(0.0, 0.0, -1.25)).unwrap_err();
    let text = "channel own: the eye [0, 0, -1.25] m is 0.250000 m behind screen s";
    assert_eq!(behind.to_string(), text);
    let on_corner = plain().frustum(WHOLE, DVec3::new(1.0, -0.5, -1.0)).unwrap_err();
    assert!(matches!(on_corner, FrustumError::EyeInPlane { .. }));
}

#[test]
fn a_micrometre_before_the_screen_is_enough() {
    let wall = plain();
    let eye = DVec3::new(0.1, 0.2, -1.0 + 1e-6);
    let foot = wall.pixel_from_display(WHOLE, eye, DVec3::new(0.1, 0.2, -1.0)).unwrap();
    assert!(foot.distance(DVec2::new(1100.0, 300.0)) < 1e-6, "{foot}");
}

#[test]
fn eyes_and_screens_that_are_none_are_errors() {
    let mut wall = plain();
    for eye in [DVec3::splat(f64::NAN), DVec3::splat(f64::INFINITY), DVec3::splat(1e308)] {
        let error = wall.frustum(WHOLE, eye).unwrap_err();
        assert!(matches!(error, FrustumError::EyeTooFar { .. }), "{eye}: {error}");
    }
    assert_eq!(wall.frustum(ChannelId(9), DVec3::ZERO), Err(FrustumError::NoChannel(ChannelId(9))));
    let plane = *wall.screens[0].plane().unwrap();
    let flat = Plane { upper_left: plane.lower_right, ..plane };
    wall.screens[0].surface = Surface::Plane(flat);
    let error = wall.frustum(WHOLE, DVec3::ZERO).unwrap_err();
    assert!(matches!(error, FrustumError::NoRectangle { .. }), "{error}");
    wall.screens.clear();
    assert_eq!(wall.frustum(WHOLE, DVec3::ZERO), Err(FrustumError::NoChannel(WHOLE)));
}

#[test]
fn a_screen_rolled_by_180_degrees_shows_the_picture_turned() {
    let canvas = UVec2::new(2000, 1000);
    let rolled = wall(
        DVec3::new(1.0, 0.5, -1.0),
        DVec3::new(-1.0, 0.5, -1.0),
        DVec3::new(1.0, -0.5, -1.0),
        canvas,
    );
    let (eye, point) = (DVec3::new(0.2, 0.1, 0.4), DVec3::new(0.7, -0.3, -4.0));
    let upright = plain().pixel_from_display(WHOLE, eye, point).unwrap();
    let turned = rolled.pixel_from_display(WHOLE, eye, point).unwrap();
    assert!((upright + turned).distance(canvas.as_dvec2()) < 1e-9, "{upright} and {turned}");
}

#[test]
fn a_one_pixel_channel_and_a_16384_pixel_canvas() {
    let mut wall = plain();
    wall.screens[0].canvas = UVec2::new(16_384, 8192);
    wall.channels[2].origin = UVec2::new(16_383, 8191);
    wall.channels[2].size = UVec2::ONE;
    let corner = wall.screens[0].display_from_canvas(DVec2::new(16_384.0, 8192.0)).unwrap();
    let pixel = wall.pixel_from_display(OWN, DVec3::new(0.9, 0.1, 3.0), corner).unwrap();
    assert!(pixel.distance(DVec2::ONE) < 1e-9, "{pixel}");
}

#[test]
fn neighbours_at_a_right_angle_agree_on_their_edge() {
    // A cube of 3 m: front at z = −1.5, left at x = −1.5; they share the edge x = −1.5, z = −1.5.
    let canvas = UVec2::new(1000, 1000);
    let (low, high) = (-1.5, 1.5);
    let edge_foot = DVec3::new(low, low, low);
    let front = wall(edge_foot, DVec3::new(high, low, low), DVec3::new(low, high, low), canvas);
    let left = wall(DVec3::new(low, low, high), edge_foot, DVec3::new(low, high, high), canvas);
    let eye = DVec3::new(0.2, 0.1, 0.4);
    for step in 0..=20 {
        // A point far beyond the edge, in the plane of the eye and the edge.
        let on_edge = edge_foot + DVec3::Y * 3.0 * f64::from(step) / 20.0;
        let point = eye + (on_edge - eye) * 70.0;
        let on_front = front.pixel_from_display(WHOLE, eye, point).unwrap();
        let on_left = left.pixel_from_display(WHOLE, eye, point).unwrap();
        assert!(near(on_front.x, 0.0, 1e-9) && near(on_left.x, 1000.0, 1e-9));
        assert!(near(on_front.y, on_left.y, 1e-9), "{on_front} and {on_left}");
    }
}

/// A screen anywhere, any way up, and an eye before it.
fn random_wall() -> impl Strategy<Value = (Wall, DVec3)> {
    let angle = -3.2..3.2;
    let place = prop::array::uniform3(-50.0..50.0);
    let size = (0.01..20.0, 0.01..20.0);
    let canvas = (2u32..8192, 2u32..8192);
    let eye = (-10.0..10.0, -10.0..10.0, 0.01..30.0);
    (prop::array::uniform3(angle), place, size, canvas, eye).prop_map(
        |([x, y, z], place, (width, height), (columns, rows), eye)| {
            let turn =
                DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x) * DMat3::from_rotation_z(z);
            let a = DVec3::from_array(place);
            let (b, c) = (a + turn.x_axis * width, a + turn.y_axis * height);
            let eye = a + turn * DVec3::from(eye);
            (wall(a, b, c, UVec2::new(columns, rows)), eye)
        },
    )
}

/// Returns a configuration with 1,000 cases that writes no files beside the sources.
fn thousand() -> ProptestConfig {
    ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(thousand())]

    #[test]
    fn corners_land_on_the_corners_of_the_clip_space((wall, eye) in random_wall()) {
        let frustum = wall.frustum(WHOLE, eye).unwrap();
        let screen = &wall.screens[0];
        let plane = screen.plane().unwrap();
        let upper_right = plane.upper_left + plane.lower_right - plane.lower_left;
        let corners = [
            (plane.lower_left, DVec2::new(-1.0, -1.0)),
            (plane.lower_right, DVec2::new(1.0, -1.0)),
            (plane.upper_left, DVec2::new(-1.0, 1.0)),
            (upper_right, DVec2::new(1.0, 1.0)),
        ];
        for (corner, expected) in corners {
            let view = frustum.view_from_display * (corner - eye);
            let clip = frustum.clip_from_view * view.extend(1.0);
            let ndc = DVec2::new(clip.x, clip.y) / clip.w;
            prop_assert!(ndc.distance(expected) < 1e-7, "{ndc} is not {expected}");
        }
    }

    #[test]
    fn shared_and_own_show_a_point_at_the_same_pixel(
        (wall, eye) in random_wall(),
        (x, y, beyond) in (0.0..1.0, 0.0..1.0, 0.2..1e4),
    ) {
        let screen = &wall.screens[0];
        let canvas = screen.canvas.as_dvec2();
        let at = screen.display_from_canvas(DVec2::new(x, y) * canvas).unwrap();
        let point = eye + (at - eye) * beyond;
        let shared = wall.pixel_from_display(SHARED, eye, point).unwrap();
        let own = wall.pixel_from_display(OWN, eye, point).unwrap();
        // The larger the frustum's slant, the more digits its edges cancel.
        let seen = screen.frustum(eye).unwrap();
        let slant = seen.edges_m.iter().fold(1.0, |most: f64, e| most.max(e.abs()))
            / screen.size_m().min_element();
        prop_assert!(shared.distance(own) < 1e-9 * slant.max(1.0), "{shared} and {own}");
    }
}
