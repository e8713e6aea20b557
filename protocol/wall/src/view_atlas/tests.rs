//! Planes that cover what an eye sees: their fit, their number and their density.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, Vec3Swizzles};

use super::*;
use crate::warp_mesh::TessellationOptions;

const NEAR_M: f64 = 0.1;

/// The mesh of a picture of a surface.
fn mesh(size: [u32; 2], point: impl Fn(DVec2) -> Option<DVec3>) -> WarpMesh {
    let size = UVec2::from(size);
    WarpMesh::new(size, TessellationOptions::default(), |pixel| point(pixel / size.as_dvec2()))
}

/// A patch of a cylinder of 3 m radius and 2 m height, `arc` wide, around the origin.
fn cylinder(arc: f64) -> impl Fn(DVec2) -> Option<DVec3> {
    move |uv: DVec2| {
        let angle = (uv.x - 0.5) * arc;
        Some(DVec3::new(3.0 * angle.sin(), 1.0 - 2.0 * uv.y, -3.0 * angle.cos()))
    }
}

/// A fisheye of `field` from edge to edge on a sphere of 3 m radius.
fn dome(field: f64) -> impl Fn(DVec2) -> Option<DVec3> {
    move |uv: DVec2| {
        let at = (uv - 0.5) * 2.0;
        let polar = at.length() * field / 2.0;
        let side = at.normalize_or_zero() * polar.sin();
        (at.length() <= 1.0).then(|| DVec3::new(side.x, -side.y, -polar.cos()) * 3.0)
    }
}

/// The plane that shows a point first, and where.
fn shown(plan: &ViewAtlas, ray: DVec3) -> Option<(usize, DVec2)> {
    plan.planes[0].iter().enumerate().find_map(|(index, plane)| {
        let [x, y, width, height] = plane.rect.map(f64::from);
        let guard = f64::from(SOURCE_GUARD) - 1e-6;
        let texel = plane.texel(ray)?;
        let is_inside = texel.cmpge(DVec2::new(x, y) + guard).all()
            && texel.cmple(DVec2::new(x + width, y + height) - guard).all();
        is_inside.then_some((index, texel))
    })
}

/// All points of a mesh are shown, none is undersampled, and the numbers of the plan are right.
fn check(name: &str, mesh: &WarpMesh, eye: DVec3) -> ViewAtlas {
    let plan = ViewAtlas::new(mesh, &[eye], NEAR_M, 8192).expect("a plan");
    println!(
        "{name}: {} planes in {}, density {:.3} to {:.3}, taps {}",
        plan.planes[0].len(),
        plan.size,
        plan.density_min,
        plan.density_max,
        plan.taps
    );
    assert_eq!(plan.cut, 1.0, "{name}");
    let mut least = f64::INFINITY;
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|index| mesh.vertices[index as usize]);
        let middle = (a.point + b.point + c.point) / 3.0 - eye;
        let (plane, _) = shown(&plan, middle).expect("a plane that shows it");
        let plane = plan.planes[0][plane];
        // By differences, independently of the plan's own derivatives.
        let texel = |point: DVec3| plane.texel(point - eye).expect("in front");
        let (p, q) = (b.pixel - a.pixel, c.pixel - a.pixel);
        let (s, t) = (texel(b.point) - texel(a.point), texel(c.point) - texel(a.point));
        let pixels = glam::DMat2::from_cols(p, q);
        let jacobian = glam::DMat2::from_cols(s, t) * pixels.inverse();
        let gram = jacobian.transpose() * jacobian;
        let (sum, product) = (gram.x_axis.x + gram.y_axis.y, gram.determinant());
        least = least.min(((sum - (sum * sum - 4.0 * product).max(0.0).sqrt()) / 2.0).sqrt());
    }
    assert!(least >= 0.97, "{name}: {least} source pixels for a pixel");
    assert!((1.0..1.5).contains(&plan.density_min), "{name}: {}", plan.density_min);
    plan
}

#[test]
fn a_patch_has_one_plane_whose_rows_are_its_own() {
    let turned = DQuat::from_rotation_z(0.7) * DQuat::from_rotation_y(1.1);
    let patch = cylinder(TAU / 14.0);
    let mesh = mesh([192, 216], |uv| patch(uv).map(|point| turned * point));
    let plan = check("one of fourteen", &mesh, DVec3::ZERO);
    let [plane] = plan.planes[0].as_slice() else { panic!("{} planes", plan.planes[0].len()) };
    let right = plane.view_from_display.row(0);
    assert!(right.distance(turned * DVec3::X) < 1e-5, "{right}");
    assert_eq!(plan.taps, UVec2::ONE);
    check("seen by a moved eye", &mesh, turned * DVec3::new(0.8, -0.3, -0.9));
}

#[test]
fn wide_surfaces_have_several_planes() {
    let whole = mesh([800, 100], cylinder(TAU));
    assert_eq!(check("all around", &whole, DVec3::new(0.4, 0.1, 0.2)).planes[0].len(), 4);
    let half = mesh([300, 300], dome(PI));
    assert_eq!(check("a half dome", &half, DVec3::ZERO).planes[0].len(), 4);
    let most = mesh([300, 300], dome(4.5));
    assert_eq!(check("nearly a sphere", &most, DVec3::ZERO).planes[0].len(), 6);
}

/// Returns the mesh that a projector in a sphere of 3 m radius lights.
fn thrown(size: [u32; 2], position: DVec3, rotation: DQuat, tangents: [f64; 4]) -> WarpMesh {
    let [left, right, bottom, top] = tangents;
    mesh(size, |uv| {
        let (x, y) = (left + (right - left) * uv.x, top + (bottom - top) * uv.y);
        let toward = (rotation * DVec3::new(x, y, -1.0)).normalize();
        let along = position.dot(toward);
        let reach = (along * along - position.length_squared() + 9.0).sqrt() - along;
        Some(position + toward * reach)
    })
}

/// Seen from where it stands, a projector's own picture is what to draw: with a lens shift too,
/// which a picture along the middle of its rays had eight times as many pixels for, in two planes.
#[test]
fn a_projector_is_drawn_as_it_throws() {
    // One in the middle of a dome, a steeper shift to both sides, and a turned one.
    let shifted: [([f64; 4], f64, f64, DVec3); 3] = [
        ([-1.35, 1.35, -0.48, 1.04], 25.0, 0.0, DVec3::ZERO),
        ([-0.3, 1.5, -0.2, 1.2], 40.0, 0.6, DVec3::ZERO),
        ([-0.9, 0.5, -1.3, 0.3], -20.0, -1.2, DVec3::new(0.4, -0.2, 0.5)),
    ];
    for (tangents, pitch, roll, position) in shifted {
        let rotation = DQuat::from_rotation_x(pitch.to_radians()) * DQuat::from_rotation_z(roll);
        let [left, right, bottom, top] = tangents;
        let height = (480.0 * (top - bottom) / (right - left)).round();
        let mesh = thrown([480, height as u32], position, rotation, tangents);
        let plan = check("a projector", &mesh, position);
        let [plane] = plan.planes[0].as_slice() else { panic!("{} planes", plan.planes[0].len()) };
        let own = DMat3::from_quat(rotation).transpose();
        let apart = (0..3).map(|row| own.row(row).distance(plane.view_from_display.row(row)));
        assert!(apart.fold(0.0, f64::max) < 0.01, "{own}, {}", plane.view_from_display);
        assert!(plan.density_max < 1.15 && plan.taps == UVec2::ONE, "{plan:?}");
    }
}

/// Whatever eye looks at whatever projector, no pixel is undersampled, and the pictures together
/// are not many times the channel's.
#[test]
fn no_eye_asks_for_more_than_it_gets() {
    for step in 0..24 {
        let turn = f64::from(step);
        let place = DVec3::new((turn * 1.7).sin(), (turn * 2.3).sin(), (turn * 3.1).sin());
        let rotation = DQuat::from_rotation_y(turn) * DQuat::from_rotation_x(0.7 * turn.sin());
        let shift = 0.4 * (turn * 0.9).sin();
        let tangents = [-1.1 + shift, 1.1 + shift, -0.7 - shift, 0.7 - shift];
        let mesh = thrown([320, 200], place.zyx(), rotation, tangents);
        let plan = check("anyhow", &mesh, place * 0.8);
        let own = f64::from(320 * 200);
        let pixels: f64 =
            plan.planes[0].iter().map(|plane| f64::from(plane.rect[2] * plane.rect[3])).sum();
        assert!(pixels < 7.0 * own, "{} times as many", pixels / own);
    }
}

#[test]
fn mirrored_pictures_have_planes_too() {
    let patch = cylinder(1.0);
    let mirrored = mesh([160, 120], |uv| patch(DVec2::new(1.0 - uv.x, uv.y)));
    check("from behind", &mirrored, DVec3::ZERO);
}

#[test]
fn two_eyes_share_an_atlas_without_overlap() {
    let mesh = mesh([160, 120], cylinder(1.0));
    let eyes = [DVec3::X * -0.03, DVec3::X * 0.03];
    let plan = ViewAtlas::new(&mesh, &eyes, NEAR_M, 8192).expect("a plan");
    let [left, right] = [0, 1].map(|eye: usize| plan.planes[eye][0].rect);
    assert!(left[0] + left[2] <= right[0] || left[1] + left[3] <= right[1], "{left:?} {right:?}");
}

#[test]
fn what_the_adapter_cannot_hold_is_cut_and_said() {
    let mesh = mesh([600, 400], cylinder(1.5));
    let plan = ViewAtlas::new(&mesh, &[DVec3::ZERO], NEAR_M, 256).expect("a plan");
    assert!(plan.size.max_element() <= 256, "{}", plan.size);
    assert!(plan.cut < 0.5 && plan.density_min < 0.6, "{plan:?}");
}

/// Each plane has at least one step of pixels, which may be more than the channel's share.
#[test]
fn few_pixels_that_see_all_around_have_a_plan() {
    for size in [[4, 1], [8, 1], [5, 2], [9, 9]] {
        let round = mesh(size, cylinder(TAU));
        let plan = ViewAtlas::new(&round, &[DVec3::ZERO], NEAR_M, 2048).expect("a plan");
        assert!(plan.planes[0].len() > 1 && plan.density_min > 0.99, "{size:?}: {plan:?}");
    }
}

#[test]
fn eyes_on_and_behind_surfaces_are_refused_by_name() {
    let plan = |point: &dyn Fn(DVec2) -> Option<DVec3>, eye| {
        ViewAtlas::new(&mesh([64, 64], point), &[eye], NEAR_M, 8192).unwrap_err().to_string()
    };
    let patch = cylinder(2.0);
    let on = patch(DVec2::ZERO).expect("a point");
    let said = plan(&patch, on);
    assert!(said.contains("is on the surface at pixel (0, 0)"), "{said}");
    // Seen from there, one side of a ring has its back to the eye.
    let said = plan(&cylinder(TAU), DVec3::new(0.0, 0.0, -5.0));
    assert!(said.contains("is behind the surface at pixel"), "{said}");
    let said = plan(&|_: DVec2| None, DVec3::ZERO);
    assert!(said.contains("none of its pixels"), "{said}");
}
