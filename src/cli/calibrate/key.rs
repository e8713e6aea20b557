//! `KEY=VALUE` as a change of a channel.

use polyptych_client::calibration_change::{CalibrationChange, Corner, Edge, Offset};
use polyptych_client::glam::{DMat3, DVec2, DVec3, UVec2};

/// The keys there are.
const KEYS: &str = "pin.CORNER, bend, bend.COLUMN.ROW, gain, gamma, leak, matrix and edge.SIDE";

/// The change that an argument asks for.
///
/// # Errors
/// What is wrong with it, and what would be right.
pub(super) fn change(text: &str) -> Result<CalibrationChange, String> {
    let (key, value) = text.split_once('=').ok_or("a change is KEY=VALUE, such as gamma=2.2")?;
    let parts: Vec<_> = key.split('.').collect();
    let made = match parts[..] {
        ["pin", name] => {
            let corner = Corner::ALL.into_iter().find(|corner| corner.name() == name);
            let names = || format!("the corners are {}", Corner::ALL.map(Corner::name).join(", "));
            corner
                .ok_or_else(names)
                .and_then(|corner| Ok(CalibrationChange::Pin { corner, to: moved(value)? }))
        }
        ["bend"] => grid(value),
        ["bend", column, row] => {
            let index = |text: &str| text.parse::<u32>();
            match (index(column), index(row)) {
                (Ok(column), Ok(row)) => {
                    moved(value).map(|to| CalibrationChange::Bend { column, row, to })
                }
                _ => Err("columns and rows count from 0, such as bend.2.3".into()),
            }
        }
        ["gain"] => light(value).map(CalibrationChange::Gain),
        ["gamma"] if value == "srgb" => Ok(CalibrationChange::Gamma(None)),
        ["gamma"] => light(value)
            .map(|gamma| CalibrationChange::Gamma(Some(gamma)))
            .map_err(|reason| format!("{reason}, or srgb")),
        ["leak"] if value == "auto" => Ok(CalibrationChange::Leak(None)),
        ["leak"] => light(value)
            .map(|leak| CalibrationChange::Leak(Some(leak)))
            .map_err(|reason| format!("{reason}, or auto")),
        ["matrix"] => numbers::<9>(value)
            .map(|rows| CalibrationChange::Matrix(DMat3::from_cols_array(&rows).transpose()))
            .ok_or_else(|| "write three rows of three numbers: 1,0,0,0,1,0,0,0,1".into()),
        ["edge", name] => {
            let side = Edge::ALL.into_iter().find(|side| side.name() == name);
            let names = || format!("the edges are {}", Edge::ALL.map(Edge::name).join(", "));
            side.ok_or_else(names)
                .and_then(|side| Ok(CalibrationChange::Edge { side, width: width(value)? }))
        }
        _ => Err(format!("there is no such key; there are {KEYS}")),
    };
    let name = if key.is_empty() { "KEY" } else { key };
    made.map_err(|reason| format!("{name}: {reason}"))
}

/// Two numbers: relative where one has a sign, absolute where none has or "@" stands before them.
fn moved(text: &str) -> Result<Offset, String> {
    let (absolute, rest) = text.strip_prefix('@').map_or((false, text), |rest| (true, rest));
    let [x, y] = numbers::<2>(rest)
        .ok_or("write two numbers of pixels, right and down: +1.5,-0.5 further, @-3,2 in all")?;
    let is_signed = rest.split(',').any(|number| number.trim().starts_with(['+', '-']));
    let to = DVec2::new(x, y);
    Ok(if is_signed && !absolute { Offset::By(to) } else { Offset::To(to) })
}

fn grid(text: &str) -> Result<CalibrationChange, String> {
    if text == "off" {
        return Ok(CalibrationChange::Grid(None));
    }
    let sides = text.split_once('x').and_then(|(x, y)| Some((x.parse().ok()?, y.parse().ok()?)));
    let points = sides.map(|(x, y)| CalibrationChange::Grid(Some(UVec2::new(x, y))));
    points.ok_or_else(|| "write the points across and down, such as 5x5, or off".into())
}

fn light(text: &str) -> Result<DVec3, String> {
    numbers::<3>(text)
        .map(DVec3::from_array)
        .or_else(|| numbers::<1>(text).map(|[gray]| DVec3::splat(gray)))
        .ok_or_else(|| "write a number, or three of red, green and blue".into())
}

fn width(text: &str) -> Result<Option<f64>, String> {
    if text == "auto" {
        return Ok(None);
    }
    let [width] = numbers::<1>(text).ok_or("write a number of pixels, or auto")?;
    Ok(Some(width))
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|number| number.trim().parse().ok().filter(|number: &f64| number.is_finite()))
        .collect();
    numbers?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_make_moves_relative() {
        let pin = |to| Ok(CalibrationChange::Pin { corner: Corner::UpperLeft, to });
        let (by, to) = (DVec2::new(1.5, -0.5), DVec2::new(-3.0, 2.0));
        assert_eq!(change("pin.upper-left=+1.5,-0.5"), pin(Offset::By(by)));
        assert_eq!(change("pin.upper-left=0,+2"), pin(Offset::By(DVec2::new(0.0, 2.0))));
        assert_eq!(change("pin.upper-left=3,2"), pin(Offset::To(DVec2::new(3.0, 2.0))));
        assert_eq!(change("pin.upper-left=@-3,2"), pin(Offset::To(to)));
        let to = Offset::By(DVec2::new(0.5, 0.0));
        assert_eq!(
            change("bend.2.3=+0.5,0"),
            Ok(CalibrationChange::Bend { column: 2, row: 3, to })
        );
    }

    #[test]
    fn every_key_has_its_values() {
        let rows = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 1.0]);
        for (text, meant) in [
            ("bend=5x4", CalibrationChange::Grid(Some(UVec2::new(5, 4)))),
            ("bend=off", CalibrationChange::Grid(None)),
            ("gain=1,0.9,1", CalibrationChange::Gain(DVec3::new(1.0, 0.9, 1.0))),
            ("gamma=2.2", CalibrationChange::Gamma(Some(DVec3::splat(2.2)))),
            ("gamma=srgb", CalibrationChange::Gamma(None)),
            ("leak=0.003", CalibrationChange::Leak(Some(DVec3::splat(0.003)))),
            ("leak=auto", CalibrationChange::Leak(None)),
            ("matrix=1,0.5,0,0,1,0,0,0,1", CalibrationChange::Matrix(rows)),
            ("edge.left=120", CalibrationChange::Edge { side: Edge::Left, width: Some(120.0) }),
            ("edge.bottom=auto", CalibrationChange::Edge { side: Edge::Bottom, width: None }),
        ] {
            assert_eq!(change(text), Ok(meant), "{text}");
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_what_would_be_right() {
        for (text, said) in [
            ("gamma", "a change is KEY=VALUE"),
            ("=", "KEY: there is no such key"),
            ("tint=1", "tint: there is no such key; there are pin.CORNER"),
            ("pin.top=1,1", "pin.top: the corners are upper-left"),
            ("pin.upper-left=1", "pin.upper-left: write two numbers"),
            ("pin.upper-left=1,nan", "pin.upper-left: write two numbers"),
            ("bend=5", "bend: write the points across and down"),
            ("bend.a.1=1,1", "bend.a.1: columns and rows"),
            ("bend.1.1=1", "bend.1.1: write two numbers"),
            ("gamma=bright", "gamma: write a number, or three of red, green and blue, or srgb"),
            ("matrix=1,2", "matrix: write three rows"),
            ("edge.inner=3", "edge.inner: the edges are left"),
            ("edge.left=wide", "edge.left: write a number of pixels, or auto"),
        ] {
            let refused = change(text).expect_err("refused");
            assert!(refused.starts_with(said), "{text}: {refused}");
        }
    }
}
