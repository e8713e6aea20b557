//! Changes of a channel: what they make, and what is refused with its key.

use glam::{DMat3, DVec2, DVec3, UVec2};

use super::*;
use crate::surface::Plane;
use crate::{Screen, Surface};

fn wall() -> Wall {
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(2.0, 1.0));
    let screens = vec![Screen::new("front", Surface::Plane(plane), UVec2::new(640, 240))];
    let size = UVec2::new(320, 240);
    let channels = vec![
        Channel::tile("left", 0, UVec2::ZERO, size),
        Channel::tile("right", 0, UVec2::new(320, 0), size),
    ];
    Wall::new("test", screens, channels)
}

fn pin(corner: Corner, to: Offset) -> CalibrationChange {
    CalibrationChange::Pin { corner, to }
}

fn grid(x: u32, y: u32) -> CalibrationChange {
    CalibrationChange::Grid(Some(UVec2::new(x, y)))
}

#[test]
fn moves_are_absolute_or_add_up_and_touch_no_other_channel() {
    let by = pin(Corner::UpperRight, Offset::By(DVec2::new(1.5, -0.5)));
    let once = apply_changes(&wall(), "left", std::slice::from_ref(&by)).expect("tuned");
    let twice = apply_changes(&once, "left", &[by]).expect("tuned");
    let adjustment = &twice.channels[0].adjustment;
    assert_eq!(adjustment.pin, [DVec2::ZERO, DVec2::new(3.0, -1.0), DVec2::ZERO, DVec2::ZERO]);
    assert_eq!(twice.channels[1], wall().channels[1]);
    let back = pin(Corner::UpperRight, Offset::To(DVec2::ZERO));
    assert_eq!(apply_changes(&twice, "left", &[back]).expect("tuned"), wall());
}

#[test]
fn a_finer_grid_lies_on_the_present_bend() {
    let changes = [
        grid(3, 3),
        CalibrationChange::Bend { column: 1, row: 1, to: Offset::To(DVec2::new(6.0, -4.0)) },
    ];
    let coarse = apply_changes(&wall(), "left", &changes).expect("tuned");
    let fine = apply_changes(&coarse, "left", &[grid(5, 9)]).expect("tuned");
    let bend = |wall: &Wall| wall.channels[0].adjustment.bend.clone().expect("a bend");
    assert_eq!(bend(&fine).moves[4 * 5 + 2], DVec2::new(6.0, -4.0), "the point in the middle");
    for place in [DVec2::new(0.25, 0.125), DVec2::new(0.75, 0.5), DVec2::ONE] {
        let error = bend(&fine).offset(place).distance(bend(&coarse).offset(place));
        assert!(error < 1e-12, "{place}: {error}");
    }
    let none = apply_changes(&fine, "left", &[CalibrationChange::Grid(None)]).expect("tuned");
    assert_eq!(none, wall());
}

#[test]
fn light_and_edges_are_set() {
    let changes = [
        CalibrationChange::Gain(DVec3::new(1.0, 0.9, 1.0)),
        CalibrationChange::Leak(Some(DVec3::new(0.01, 0.0, 0.2))),
        CalibrationChange::Gamma(Some(DVec3::splat(2.2))),
        CalibrationChange::Matrix(DMat3::from_diagonal(DVec3::new(0.9, 1.0, 1.0))),
        CalibrationChange::Edge { side: Edge::Right, width: Some(120.0) },
    ];
    let wall = apply_changes(&wall(), "left", &changes).expect("tuned");
    let adjustment = &wall.channels[0].adjustment;
    assert_eq!(adjustment.color.gain, DVec3::new(1.0, 0.9, 1.0));
    assert_eq!(adjustment.color.leak, Some(DVec3::new(0.01, 0.0, 0.2)));
    assert_eq!(adjustment.color.curve, TransferFunction::Gamma(DVec3::splat(2.2)));
    assert_eq!((adjustment.edges.right, adjustment.edges.left), (Some(120.0), None));
    let changes = [
        CalibrationChange::Gamma(None),
        CalibrationChange::Edge { side: Edge::Right, width: None },
    ];
    let wall = apply_changes(&wall, "left", &changes).expect("tuned");
    assert_eq!(wall.channels[0].adjustment.color.curve, TransferFunction::Srgb);
    assert_eq!(wall.channels[0].adjustment.edges, crate::BlendWidths::default());
}

#[test]
fn what_cannot_be_is_refused_by_its_key() {
    let bend =
        |x: f64| CalibrationChange::Bend { column: 1, row: 0, to: Offset::To(DVec2::new(x, 0.0)) };
    let far = DVec2::new(300.0, 200.0);
    for (change, said) in [
        (
            vec![pin(Corner::UpperLeft, Offset::To(far))],
            "left: pin.upper-left: the pins fold the picture",
        ),
        (vec![pin(Corner::LowerLeft, Offset::By(DVec2::NAN))], "left: pin.lower-left: a point"),
        (
            vec![pin(Corner::LowerLeft, Offset::By(DVec2::X * 321.0))],
            "left: pin.lower-left: a point",
        ),
        (vec![bend(1.0)], "left: bend.1.0: there is no bend yet"),
        (vec![grid(1, 5)], "left: bend: 2x2 to 1024"),
        (vec![grid(u32::MAX, u32::MAX)], "left: bend: 2x2 to 1024"),
        (
            vec![grid(4, 2), bend(150.0)],
            "left: bend.1.0: the bend folds the picture, or nearly; move its points by less",
        ),
        (vec![CalibrationChange::Gain(DVec3::NEG_ONE)], "left: gain: 0 to 16"),
        (vec![CalibrationChange::Leak(Some(DVec3::ONE))], "left: leak: 0 to 0.2 of white"),
        (vec![CalibrationChange::Gamma(Some(DVec3::ZERO))], "left: gamma: numbers above"),
        (
            vec![CalibrationChange::Matrix(DMat3::from_diagonal(DVec3::NAN))],
            "left: matrix: −16 to 16",
        ),
        (
            vec![CalibrationChange::Edge { side: Edge::Top, width: Some(241.0) }],
            "left: edge.top: 0 to 240 pixels",
        ),
    ] {
        let refused = apply_changes(&wall(), "left", &change).expect_err("refused");
        assert!(refused.starts_with(said), "{refused}");
    }
    let across = |corner, x: f64| pin(corner, Offset::To(DVec2::new(x, 0.0)));
    let turned_over = [
        across(Corner::UpperLeft, 200.0),
        across(Corner::LowerLeft, 200.0),
        across(Corner::UpperRight, -200.0),
        across(Corner::LowerRight, -200.0),
    ];
    let refused = apply_changes(&wall(), "left", &turned_over).expect_err("refused");
    assert!(refused.starts_with("left: pin.lower-right: the pins fold"), "{refused}");
    let refused = apply_changes(&wall(), "middle", &[]).expect_err("refused");
    assert_eq!(refused, "this wall has no channel \"middle\"; it has left, right");
    assert!(apply_changes(&wall(), "left", &[grid(4, 2), bend(30.0)]).is_ok(), "a fair bend");
}

#[test]
fn tunings_come_back_and_only_on_their_channels() {
    let file = wall();
    let changes = [pin(Corner::LowerRight, Offset::To(DVec2::ONE)), grid(2, 2)];
    let now = apply_changes(&file, "right", &changes).expect("tuned");
    let tunings = diff(&file, &now);
    assert_eq!(tunings.len(), 1);
    assert_eq!(reapply(&file, &tunings), Ok(now.clone()));
    let mut other = tunings.clone();
    other[0].0 = "middle".into();
    assert!(reapply(&file, &other).is_err());
    other = tunings;
    other[0].1.mirror = true;
    assert!(reapply(&file, &other).is_err_and(|reason| reason.contains("hangs otherwise")));
    other[0].1.mirror = false;
    other[0].1.pin[0] = DVec2::splat(1e9);
    assert!(reapply(&file, &other).is_err());
}
