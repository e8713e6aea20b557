//! Meshes of pixels: their error, their borders and their holes.

use super::*;

const SIZE: UVec2 = UVec2::new(640, 360);

/// A patch of a cylinder of 3 m radius, with pixels of 5 mm.
#[expect(clippy::unnecessary_wraps, reason = "as meshes ask for points")]
fn cylinder(pixel: DVec2) -> Option<DVec3> {
    let angle = (pixel.x - 320.0) * 0.005 / 3.0;
    Some(DVec3::new(3.0 * angle.sin(), (180.0 - pixel.y) * 0.005, -3.0 * angle.cos()))
}

/// Half a sphere of 2 m radius as a fisheye shows it; nothing outside of its circle.
fn dome(pixel: DVec2) -> Option<DVec3> {
    let at = (pixel - DVec2::new(320.0, 180.0)) / 170.0;
    let polar = at.length() * std::f64::consts::FRAC_PI_2;
    let side = at.normalize_or_zero() * polar.sin();
    (at.length() <= 1.0).then(|| DVec3::new(side.x, -side.y, -polar.cos()) * 2.0)
}

/// The largest error at the middles of all pixels, and how many differ in being lit.
fn compare(mesh: &WarpMesh, point: impl Fn(DVec2) -> Option<DVec3>, pitch: f64) -> (f64, usize) {
    let mut found = vec![None; (SIZE.x * SIZE.y) as usize];
    for triangle in &mesh.triangles {
        let corners = triangle.map(|index| mesh.vertices[index as usize]);
        let low = corners.iter().fold(DVec2::INFINITY, |low, v| low.min(v.pixel)).floor();
        let high = corners.iter().fold(DVec2::NEG_INFINITY, |high, v| high.max(v.pixel)).ceil();
        let one = WarpMesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 2]] };
        for y in low.y as u32..high.y as u32 {
            for x in low.x as u32..high.x as u32 {
                let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let slot = &mut found[(y * SIZE.x + x) as usize];
                *slot = slot.or(one.point_at(pixel));
            }
        }
    }
    let (mut most, mut wrong) = (0.0, 0);
    for (index, found) in (0..).zip(found) {
        let pixel = DVec2::new(f64::from(index % SIZE.x), f64::from(index / SIZE.x)) + 0.5;
        match (found, point(pixel)) {
            (Some(a), Some(b)) => most = a.distance(b).max(most),
            (None, None) => {}
            _ => wrong += 1,
        }
    }
    (most / pitch, wrong)
}

#[test]
fn every_pixel_is_where_it_should_be() {
    let pitch = 2.0 * std::f64::consts::FRAC_PI_2 / 170.0;
    for rule in [
        TessellationOptions::default(),
        TessellationOptions { error_px: 0.005, ..TessellationOptions::default() },
    ] {
        let mesh = WarpMesh::new(SIZE, rule, cylinder);
        let (off, wrong) = compare(&mesh, cylinder, 0.005);
        println!("cylinder, {rule:?}: {off:.5} px, {} points", mesh.vertices.len());
        assert!(off <= rule.error_px && wrong == 0, "{off} px, {wrong} pixels wrongly lit or dark");
        let mesh = WarpMesh::new(SIZE, rule, dome);
        let (off, wrong) = compare(&mesh, dome, pitch);
        println!("dome, {rule:?}: {off:.5} px, {} points", mesh.vertices.len());
        assert!(off <= rule.error_px && wrong == 0, "{off} px, {wrong} pixels wrongly lit or dark");
    }
}

#[test]
fn a_coarse_grid_is_off_by_what_theory_says() {
    // The sagitta of a chord, s²/8r, in pixels; the diagonals are no longer across.
    for step_px in [8, 16, 32, 64] {
        let mesh =
            WarpMesh::new(SIZE, TessellationOptions { step_px, error_px: f64::INFINITY }, cylinder);
        let (off, _) = compare(&mesh, cylinder, 0.005);
        let sagitta = f64::from(step_px).powi(2) * 0.005 / 8.0 / 3.0;
        assert!((0.9..=1.01).contains(&(off / sagitta)), "{step_px}: {off} px, {sagitta} expected");
    }
}

#[test]
fn single_pixels_and_nothing_are_meshes_too() {
    let one = |pixel: DVec2| (pixel.floor() == DVec2::new(100.0, 50.0)).then_some(DVec3::NEG_Z);
    let rule = TessellationOptions { step_px: 1, ..TessellationOptions::default() };
    assert_eq!(WarpMesh::new(SIZE, rule, one).triangles.len(), 2);
    assert_eq!(WarpMesh::new(SIZE, rule, |_| None), WarpMesh::default());
    assert_eq!(WarpMesh::new(SIZE, rule, |_| Some(DVec3::NAN)), WarpMesh::default());
}

#[test]
fn noise_ends_in_a_mesh_of_bounded_size() {
    let mut state = 1u32;
    let rough = |pixel: DVec2| {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        Some((pixel * 0.001).extend(-2.0 + f64::from(state >> 16) * 1e-6))
    };
    let rule = TessellationOptions::default();
    let mesh = WarpMesh::within(20_000, (SIZE, rule), rough, |_| false);
    assert!((4..=20_000).contains(&mesh.vertices.len()), "{}", mesh.vertices.len());
}

#[test]
fn borders_that_find_no_room_cost_no_shape() {
    let curved = |pixel: DVec2| Some(pixel.extend(-2000.0 - (pixel.x * 0.01).sin() * 50.0));
    let rule = TessellationOptions::default();
    let plain = WarpMesh::new(SIZE, rule, curved);
    let limit = plain.vertices.len() + 100;
    let speckled = WarpMesh::within(limit, (SIZE, rule), curved, |_| true);
    assert_eq!(speckled.vertices.len(), plain.vertices.len());
}
