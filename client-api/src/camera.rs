//! Where to stand to see a whole scene.

use glam::DVec3;
use polyptych_protocol::camera::Camera;
use polyptych_protocol::scene::Bounds;
use polyptych_protocol::wall::Wall;

/// How far above the horizon an overview stands: high enough to see behind the first row.
const ELEVATION_RAD: f64 = 0.35;

/// A camera that shows all of `bounds` on the screen in front of the eye, from `heading_rad`
/// around +Y (0 sees the scene from its +Z side, a quarter turn from +X) and a little above.
///
/// The centre of the scene comes to stand in the centre of that screen, and the scale is chosen
/// so that its bounding sphere, as the wall's eye sees it, fits the screen's shorter side: what
/// the wall shows then lies at the depth of the wall. Bounds without extent count as one unit.
pub fn overview(wall: &Wall, bounds: &Bounds, heading_rad: f64) -> Camera {
    let (sin_h, cos_h) = heading_rad.sin_cos();
    let (sin_e, cos_e) = ELEVATION_RAD.sin_cos();
    let outward = DVec3::new(sin_h * cos_e, sin_e, cos_h * cos_e);
    let rotation = Camera::look_at(outward, DVec3::ZERO, DVec3::Y).rotation;
    let radius = Some(bounds.radius()).filter(|r| r.is_finite() && *r > 0.0).unwrap_or(1.0);

    let (middle_in_display, half_side_m) = front_screen(wall);
    let distance_m = (middle_in_display - wall.eye).length();
    // The sphere touches the cone of half angle a where radius = distance * sin a.
    let half_angle = half_side_m.atan2(distance_m);
    let radius_m = distance_m * half_angle.sin();
    let scale = if radius_m > 0.0 { radius / radius_m } else { radius };
    let position = bounds.center() - rotation * (scale * middle_in_display);
    Camera { position, rotation, scale }
}

/// The centre of the screen that stands most in front of the eye (towards −Z; the first of equal
/// ones), and half of its shorter side, in metres of display space.
fn front_screen(wall: &Wall) -> (DVec3, f64) {
    let mut front = (wall.eye + DVec3::NEG_Z, 0.5);
    let mut most_ahead = f64::NEG_INFINITY;
    for screen in &wall.screens {
        let Some(middle) = screen.display_from_canvas(screen.canvas.as_dvec2() / 2.0) else {
            continue;
        };
        let ahead = (middle - wall.eye).try_normalize().map_or(0.0, |toward| -toward.z);
        // Two screens side by side are equally far ahead but for rounding.
        if ahead > most_ahead + 1e-9 {
            most_ahead = ahead;
            front = (middle, screen.size_m().min_element() * 0.5);
        }
    }
    front
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::wall::file;

    use super::*;

    /// A screen of 4 m by 2 m around (0, 1.5, -1).
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
        let mut wall = file::parse(text, "lab.toml".as_ref()).expect("a wall");
        wall.eye = DVec3::new(0.3, 1.6, 2.0);
        wall
    }

    #[test]
    fn the_scene_fills_the_front_screen_at_the_depth_of_the_wall() {
        let wall = wall();
        let bounds = Bounds { min: DVec3::splat(1e6), max: DVec3::splat(1e6 + 0.5) };
        for heading in [0.0, 1.0, 4.0] {
            let camera = overview(&wall, &bounds, heading);
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
    fn a_scene_stands_in_the_middle_of_screens_of_every_shape() {
        let bounds = Bounds { min: DVec3::splat(-2.0), max: DVec3::splat(3.0) };
        let configs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        for (name, middle) in [
            ("cylinder-360.toml", DVec3::new(0.0, 1.6, -3.0)),
            ("panoramic-3.toml", DVec3::new(0.0, 1.4, -3.0)),
            ("powerwall-overlap.toml", DVec3::new(0.0, 0.0, -3.0)),
            // Half way up to the zenith.
            ("dome-5.toml", DVec3::new(0.0, 1.6 + 8.0_f64.sqrt(), -8.0_f64.sqrt())),
        ] {
            let wall = file::load(&configs.join(name)).expect("a wall");
            let camera = overview(&wall, &bounds, 0.3);
            assert_eq!(camera.fault(), None, "{name}");
            let shown = camera.world_from_display(middle);
            assert!((shown - bounds.center()).length() < 1e-9, "{name}: {shown}");
        }
    }

    #[test]
    fn no_screen_and_no_extent_give_a_camera_still() {
        let bare = Wall { screens: Vec::new(), ..wall() };
        let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        assert_eq!(overview(&bare, &point, 0.0).fault(), None);
        let nothing = Bounds { min: DVec3::splat(f64::NAN), max: DVec3::ONE };
        assert!(overview(&bare, &nothing, 0.0).fault().is_some());
    }
}
