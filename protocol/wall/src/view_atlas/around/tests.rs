//! Omnidirectional stereo against its closed form: rays of f64 that hit exact cylinders and
//! spheres.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, UVec2};

use super::super::ViewAtlas;
use super::*;
use crate::viewpoint::Around;
use crate::warp_mesh::TessellationOptions;

const RADIUS_M: f64 = 3.0;

/// Half the distance of the eyes.
const HALF_M: f64 = 0.0315;

/// A round screen: pixels, and where a ray from within meets it.
struct Round {
    size: UVec2,
    is_dome: bool,
}

impl Round {
    fn point(&self, pixel: DVec2) -> DVec3 {
        let uv = pixel / self.size.as_dvec2();
        let (sin, cos) = ((uv.x - 0.5) * TAU).sin_cos();
        if self.is_dome {
            let (up, flat) = ((1.0 - uv.y) * PI / 2.0).sin_cos();
            return DVec3::new(sin * flat, up, -cos * flat) * RADIUS_M;
        }
        DVec3::new(RADIUS_M * sin, 1.0 - 2.0 * uv.y, -RADIUS_M * cos)
    }

    fn pixel(&self, point: DVec3) -> DVec2 {
        let u = point.x.atan2(-point.z) / TAU + 0.5;
        let elevation = point.y.atan2(point.x.hypot(point.z));
        let v = if self.is_dome { 1.0 - elevation * 2.0 / PI } else { (1.0 - point.y) / 2.0 };
        DVec2::new(u, v) * self.size.as_dvec2()
    }

    /// Returns the point where the ray from an eye inside through a point leaves the screen.
    fn hit(&self, eye: DVec3, through: DVec3) -> DVec3 {
        let flat = |v: DVec3| if self.is_dome { v } else { DVec3::new(v.x, 0.0, v.z) };
        let (along, from) = (flat(through - eye), flat(eye));
        let (a, b) = (along.length_squared(), from.dot(along));
        let c = from.length_squared() - RADIUS_M * RADIUS_M;
        eye + (through - eye) * (((b * b - a * c).sqrt() - b) / a)
    }

    fn eyes(error_max_px: f64) -> [Viewpoint; 2] {
        [-HALF_M, HALF_M]
            .map(|offset_m| Viewpoint::Around(Around { head: DVec3::ZERO, offset_m, error_max_px }))
    }

    fn plan(&self, error_max_px: f64) -> (WarpMesh, ViewAtlas) {
        let eyes = Self::eyes(error_max_px);
        let point = |pixel| Some(self.point(pixel));
        let mesh =
            WarpMesh::new(self.size, TessellationOptions::default(), point).refined_for(&eyes);
        let plan = ViewAtlas::new(&mesh, &eyes, 0.1, 8192).expect("a plan");
        println!(
            "{} triangles, {} planes for each eye in {}, off by {:.3} px, density {:.2} to {:.2}",
            mesh.triangles.len(),
            plan.triangles.len(),
            plan.size,
            plan.stereo_error_px,
            plan.density_min,
            plan.density_max
        );
        (mesh, plan)
    }
}

fn ring() -> Round {
    Round { size: UVec2::new(3600, 382), is_dome: false }
}

/// From one place of the screen to another, in pixels of its widest row, which are square.
fn apart(round: &Round, a: DVec3, b: DVec3) -> f64 {
    a.distance(b) * f64::from(round.size.x) / (TAU * RADIUS_M)
}

/// Every triangle belongs to one plane, which holds all of it and looks from between its corners'
/// eyes; all that lies on the screen or behind it is where the plan says, by exact rays.
fn check(round: &Round, error_max_px: f64) -> ViewAtlas {
    let (mesh, plan) = round.plan(error_max_px);
    let eyes = Round::eyes(error_max_px);
    let mut owned: Vec<u32> = plan.triangles.iter().flatten().copied().collect();
    owned.sort_unstable();
    let has_area = |at: &u32| {
        let [a, b, c] = mesh.triangles[*at as usize].map(|at| mesh.vertices[at as usize].point);
        (b - a).cross(c - a) != DVec3::ZERO
    };
    let all: Vec<u32> = (0..mesh.triangles.len() as u32).filter(has_area).collect();
    assert_eq!(owned, all, "a triangle has no plane, or two");
    let mut worst = 0.0_f64;
    for (viewpoint, planes) in eyes.iter().zip(&plan.planes) {
        assert_eq!(planes.len(), plan.triangles.len());
        for (plane, triangles) in planes.iter().zip(&plan.triangles) {
            let corners = triangles.iter().flat_map(|at| mesh.triangles[*at as usize]);
            for vertex in corners.map(|at| mesh.vertices[at as usize]) {
                let texel = plane.texel(vertex.point - plane.eye).expect("in front");
                let [x, y, w, h] = plane.rect.map(f64::from);
                let (low, high) = (DVec2::new(x, y) + 2.0, DVec2::new(x + w, y + h) - 2.0);
                let is_inside = texel.cmpge(low - 1e-6).all() && texel.cmple(high + 1e-6).all();
                assert!(is_inside, "{texel} of {:?}", plane.rect);
                let eye = viewpoint.eye_for(vertex.point);
                for times in [1.0, 1.2, 2.0, 10.0, 1e7] {
                    let far = eye + (vertex.point - eye) * times;
                    let drawn = round.hit(plane.eye, far);
                    let off = apart(round, drawn, vertex.point);
                    let allowed = plan.stereo_error_px * (1.0 - 1.0 / times);
                    assert!(off <= allowed * 1.02 + 1e-3, "{off} px at {times}, {}", vertex.point);
                    worst = worst.max(off);
                }
            }
        }
    }
    println!("worst by rays: {worst:.3} px");
    assert!(worst > 0.5 * plan.stereo_error_px, "the bound of {worst} px is too wide");
    plan
}

#[test]
fn a_ring_keeps_its_error_with_few_planes() {
    let plan = check(&ring(), 0.25);
    assert!(plan.stereo_error_px <= 0.25, "{}", plan.stereo_error_px);
    assert!((20..=40).contains(&plan.triangles.len()), "{} planes", plan.triangles.len());
    // Up and down a part is off by s·sin δ·sin φ / 2p: half as much takes twice as many.
    let coarse = check(&ring(), 0.5);
    assert!(coarse.triangles.len() * 3 <= plan.triangles.len() * 2);
}

#[test]
fn a_dome_keeps_what_its_planes_suffice_for_and_says_it() {
    let dome = |side| Round { size: UVec2::new(side, side / 4), is_dome: true };
    let plan = check(&dome(1200), 0.5);
    assert_eq!(plan.triangles.len(), SOURCE_CELLS_MAX);
    assert!((0.5..1.5).contains(&plan.stereo_error_px), "{}", plan.stereo_error_px);
}

/// The azimuth at which an eye h to the right sees a point at azimuth α and distance d, both
/// level. With β = α − θ the point lies on the line from h·right(θ) through R·ahead(θ):
/// d sin β = h (1 − d cos β / R).
fn azimuth_of(h: f64, alpha: f64, d: f64) -> f64 {
    let slope = h / RADIUS_M;
    alpha - ((h / (d * (1.0 + slope * slope).sqrt())).asin() - slope.atan())
}

#[test]
fn disparities_are_those_of_the_closed_form_all_around() {
    let round = ring();
    let (mesh, plan) = round.plan(0.25);
    let holds = |triangles: &[u32], pixel: DVec2| {
        triangles.iter().any(|at| {
            let [a, b, c] = mesh.triangles[*at as usize].map(|at| mesh.vertices[at as usize].pixel);
            let side = |a: DVec2, b: DVec2| (b - a).perp_dot(pixel - a);
            let sides = [side(a, b), side(b, c), side(c, a)];
            sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
        })
    };
    let pixels_per_rad = f64::from(round.size.x) / TAU;
    for step in 0..90 {
        let alpha = (f64::from(step) * 4.0 - 180.0 + 0.7).to_radians();
        for d in [1.8, RADIUS_M, 4.0, 9.0, 1e3] {
            let point = DVec3::new(d * alpha.sin(), 0.0, -d * alpha.cos());
            let seen = |eye: usize| {
                let h = [-HALF_M, HALF_M][eye];
                let expected = azimuth_of(h, alpha, d);
                let found = plan.planes[eye].iter().zip(&plan.triangles);
                let at = found.filter_map(|(plane, triangles)| {
                    let pixel = round.pixel(round.hit(plane.eye, point));
                    holds(triangles, pixel).then_some(pixel.x / pixels_per_rad - PI)
                });
                let off = |at: f64| ((at - expected + PI).rem_euclid(TAU) - PI) * pixels_per_rad;
                let offs: Vec<f64> = at.map(off).collect();
                // Where two planes meet, both may show it, or none.
                for off in &offs {
                    let allowed = plan.stereo_error_px * (1.0 - RADIUS_M / d).abs();
                    assert!(off.abs() <= allowed + 0.01, "{off} px at {alpha}, {d} m");
                }
                offs.first().map(|off| expected + off / pixels_per_rad)
            };
            let (Some(left), Some(right)) = (seen(0), seen(1)) else { continue };
            let apart_m = (right - left) * RADIUS_M;
            // As of two eyes that look there: behind the screen to their own sides, before it
            // crossed, on it together.
            let expected_m = 2.0 * HALF_M * (1.0 - RADIUS_M / d);
            let pixel_m = RADIUS_M / pixels_per_rad;
            let allowed_m = 2.0 * plan.stereo_error_px * (1.0 - RADIUS_M / d).abs() * pixel_m;
            assert!((apart_m - expected_m).abs() <= allowed_m + 1e-4, "{apart_m} m at {alpha}");
            assert!(d <= RADIUS_M || apart_m > 0.0, "eyes are exchanged at {alpha}");
        }
    }
}

#[test]
fn a_middle_ray_of_each_plane_has_the_right_eye_at_the_right() {
    let (_, plan) = ring().plan(0.5);
    for (left, right) in plan.planes[0].iter().zip(&plan.planes[1]) {
        let ahead = -left.view_from_display.row(2);
        let to_the_right = ahead.cross(DVec3::Y).normalize();
        let apart = (right.eye - left.eye).dot(to_the_right);
        assert!((0.96..=1.0).contains(&(apart / (2.0 * HALF_M))), "{apart} m along {ahead}");
    }
}

#[test]
fn a_mesh_of_two_triangles_is_divided_and_one_for_a_fixed_eye_is_not() {
    let corner = |x: f64, y: f64| WarpVertex {
        pixel: DVec2::new((x + 1.0) * 500.0, (1.0 - y) * 300.0),
        point: DVec3::new(x * 2.0, y * 1.2, -1.5),
    };
    let vertices = vec![corner(-1.0, 1.0), corner(1.0, 1.0), corner(-1.0, -1.0), corner(1.0, -1.0)];
    let flat = WarpMesh { vertices, triangles: vec![[0, 2, 1], [1, 2, 3]] };
    let fixed = [Viewpoint::Fixed(DVec3::ZERO)];
    assert_eq!(flat.clone().refined_for(&fixed), flat);
    let eyes = Round::eyes(0.5);
    let fine = flat.refined_for(&eyes);
    assert!(fine.triangles.len() > 100, "{} triangles", fine.triangles.len());
    let plan = ViewAtlas::new(&fine, &eyes, 0.1, 8192).expect("a plan");
    println!("flat: {} planes, {} px", plan.triangles.len(), plan.stereo_error_px);
    assert!(plan.stereo_error_px <= 0.5, "{} px", plan.stereo_error_px);
}
