//! From a channel's adjustment back to `[channel.NAME]`.

use glam::{DMat3, DVec2, DVec3};
use polyptych_wall::channel_calibration::{BitDepth, TransferFunction};
use polyptych_wall::{BlendWidths, CalibrationFileKind, Channel, Wall};

use crate::document::{
    AdjustSection, BendSection, EdgesSection, Pair, Row, ScalarOrRgb, WarpObj, WarpZero,
};

/// Returns a channel's table; `None` if it would be empty.
pub(super) fn section(wall: &Wall, channel: &Channel) -> Option<AdjustSection> {
    let adjustment = &channel.adjustment;
    let path = |index: Option<u16>| Some(wall.files.get(usize::from(index?))?.path.clone());
    let warp = adjustment.warp.and_then(|index| wall.files.get(usize::from(index)));
    let is_warp = |kind: CalibrationFileKind| warp.is_some_and(|file| file.kind == kind);
    let pair = |point: DVec2| Pair(point.to_array());
    let color = &adjustment.color;
    let (gamma, curve) = match &color.curve {
        TransferFunction::Srgb => (None, None),
        TransferFunction::Gamma(gamma) => (Some(light(*gamma)), None),
        TransferFunction::Measured(points) => {
            (None, Some(points.iter().copied().map(light).collect()))
        }
    };
    let section = AdjustSection {
        monitor: channel.monitor.clone(),
        turn: changed(adjustment.turn),
        mirror: changed(adjustment.mirror),
        eye: changed(adjustment.eye),
        stereo: changed(adjustment.packing),
        pin: changed(adjustment.pin).map(|pin| pin.map(pair)),
        bend: adjustment.bend.as_ref().map(|bend| BendSection {
            points: bend.points.to_array(),
            moves: bend.moves.iter().copied().map(pair).collect(),
        }),
        edges: changed(adjustment.edges).map(|BlendWidths { left, right, top, bottom }| {
            EdgesSection { left, right, top, bottom }
        }),
        gain: (color.gain != DVec3::ONE).then(|| light(color.gain)),
        matrix: (color.matrix != DMat3::IDENTITY)
            .then(|| color.matrix.transpose().to_cols_array_2d().map(Row)),
        gamma,
        curve,
        leak: color.leak.map(light),
        warp: path(adjustment.warp),
        warp_zero: is_warp(CalibrationFileKind::WarpDarkZeros).then_some(WarpZero::Dark),
        warp_obj: is_warp(CalibrationFileKind::WarpSgct).then_some(WarpObj::Sgct),
        alpha: path(adjustment.alpha),
        ramps: changed(adjustment.ramps),
        beta: path(adjustment.beta),
        bits: (adjustment.bits == BitDepth::Ten).then_some(10),
    };
    changed(section)
}

/// Returns the value; `None` if it is the default, which is not written.
fn changed<T: Default + PartialEq>(value: T) -> Option<T> {
    (value != T::default()).then_some(value)
}

fn light(rgb: DVec3) -> ScalarOrRgb {
    if rgb == DVec3::splat(rgb.x) {
        ScalarOrRgb::Gray(rgb.x)
    } else {
        ScalarOrRgb::Rgb(rgb.to_array())
    }
}
