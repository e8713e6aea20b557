//! Matrices as they are given: shears, mirrors, flat ones, and chains of them.

use glam::{DMat3, DMat4, DVec3, Vec3};
use polyptych_client::Camera;

use super::hard_cases::shrunk;
use super::{assert_right, channels, verdict};
use crate::harness::model::{Model, Part};
use crate::harness::stage::RenderFixture;

/// A box of six colours around the origin, counter-clockwise from outside.
pub fn cube(place: DMat4) -> Part {
    let colors = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.7, 0.7, 0.0), Vec3::ONE * 0.3, Vec3::ONE];
    let axes = [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)];
    let sides = axes.iter().flat_map(|&(right, up)| [(right, up), (up, right)]);
    let mut sides = sides.zip(colors).map(|((right, up), color)| {
        let outward = right.cross(up);
        Part::rectangle(place, outward * 0.5, right * 0.5, up * 0.5, color).plain()
    });
    let mut whole = sides.next().expect("six sides");
    sides.for_each(|side| whole.join(&side));
    whole
}

/// Draws cubes in a row, each below these nodes, in every channel of a wall.
fn check(name: &str, chain: &[DMat3], place: DVec3) {
    let wall = shrunk("wall-2x2.toml", 6);
    let mut model = Model::default();
    for x in -1..=1 {
        let at = DMat4::from_translation(place + DVec3::new(f64::from(x) * 1.6, 0.0, -3.0));
        let turned = DMat4::from_rotation_y(0.4 + f64::from(x)) * DMat4::from_rotation_x(0.5);
        let mut part = cube(at);
        part.chain.push(turned);
        part.chain.extend(chain.iter().map(|matrix| DMat4::from_mat3(*matrix)));
        model.parts.push(part);
    }
    let mut stage = RenderFixture::of(&model.gltf());
    for id in channels(&wall) {
        let camera = Camera { position: place, ..Camera::IDENTITY };
        assert_right(name, verdict(&mut stage, &model, &wall, id, camera));
    }
}

fn diagonal(x: f64, y: f64, z: f64) -> DMat3 {
    DMat3::from_diagonal(DVec3::new(x, y, z))
}

/// A matrix that no translation, rotation and scale can express.
fn shear() -> DMat3 {
    DMat3::from_cols(DVec3::X, DVec3::new(0.8, 1.0, 0.0), DVec3::new(0.0, -0.6, 1.0))
}

#[test]
fn sheared_matrices_are_drawn_as_they_are() {
    check("sheared", &[shear()], DVec3::ZERO);
    check("sheared far away", &[shear()], DVec3::new(6_378_137.123_456, -1e6, 3e6));
    // A rotation between scales is a shear that no node says itself.
    let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 0.9);
    check(
        "shear of a chain",
        &[diagonal(1.5, 0.4, 1.0), turn, diagonal(0.6, 1.0, 1.4)],
        DVec3::ZERO,
    );
}

#[test]
fn negative_scales_turn_the_winding_and_two_of_them_do_not() {
    check("mirrored", &[diagonal(-1.0, 1.0, 1.0)], DVec3::ZERO);
    check("mirrored and sheared", &[shear(), diagonal(1.0, -0.7, 1.0)], DVec3::ZERO);
    check("mirrored twice", &[diagonal(-1.0, 1.0, 1.0), diagonal(1.0, 1.0, -1.0)], DVec3::ZERO);
    check("turned inside out", &[diagonal(-1.0, -1.0, -1.0)], DVec3::ZERO);
}

#[test]
fn scales_that_are_not_uniform_are_drawn_as_they_are() {
    check("flat and long", &[diagonal(1.5, 0.02, 0.7)], DVec3::ZERO);
    check("tiny in huge", &[diagonal(1e9, 1e9, 1e9), diagonal(1e-9, 2e-10, 1e-9)], DVec3::ZERO);
}

#[test]
fn a_cube_under_a_singular_matrix_is_its_shadow() {
    // Two faces lie in one plane then, of which the one that faces the eye shows; the others
    // have no area.
    let wall = shrunk("wall-2x2.toml", 6);
    for flat in [diagonal(1.0, 1.0, 0.0), shear() * diagonal(1.0, 1.0, 0.0)] {
        let at = DMat4::from_translation(DVec3::new(0.1, 0.2, -3.0)) * DMat4::from_mat3(flat);
        let mut part = cube(at);
        part.indices.truncate(12);
        let model = Model::of(vec![part]);
        let mut stage = RenderFixture::of(&model.gltf());
        let verdicts: Vec<_> = channels(&wall)
            .map(|id| verdict(&mut stage, &model, &wall, id, Camera::IDENTITY))
            .collect();
        println!("singular: {verdicts:?}");
        assert!(verdicts.iter().all(|v| v.wrong == 0), "{verdicts:?}");
        assert!(verdicts.iter().any(|v| v.covered > 500), "{verdicts:?}");
    }
    // A line, a point: nothing is drawn, and nothing breaks.
    for nothing in [diagonal(1.0, 0.0, 0.0), diagonal(0.0, 0.0, 0.0)] {
        let at = DMat4::from_translation(DVec3::new(0.0, 0.0, -3.0)) * DMat4::from_mat3(nothing);
        let seen = DMat4::from_translation(DVec3::new(0.5, 0.3, -3.0));
        let model = Model::of(vec![cube(at), cube(seen)]);
        let mut stage = RenderFixture::of(&model.gltf());
        for id in channels(&wall) {
            let verdict = verdict(&mut stage, &model, &wall, id, Camera::IDENTITY);
            assert_eq!(verdict.wrong, 0, "{verdict:?}");
        }
    }
}
