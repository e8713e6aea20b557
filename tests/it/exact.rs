//! Pictures against the reference in f64: points, whole pictures, and cases that are hard for
//! numbers. The reference and the program have only their input in common.

mod hard_cases;
mod itself;
mod planes;
mod points;
mod shapes;

use glam::DVec3;
use polyptych_client::{Camera, Wall};
use polyptych_wall::ChannelId;

use crate::harness::model::Model;
use crate::harness::stage::{RenderFixture, reference_view};
use crate::reference::raster::{self, Sample};
use crate::reference::tone;

/// The sky that the baker gives to scenes which bring none.
const SKY: DVec3 = DVec3::new(0.2, 0.32, 0.5);

/// Codes of 255 by which a drawn colour may differ: one, and rounding.
const LEVELS_MAX: f64 = 1.5;

/// The comparison of a channel's picture with the reference.
#[derive(Clone, Copy, Debug, Default)]
struct Verdict {
    /// Pixels whose colour the reference is sure of.
    sure: usize,
    /// Sure pixels of another colour.
    wrong: usize,
    /// Pixels of which the reference is sure, and in which something other than the sky shows.
    covered: usize,
    unsure: usize,
}

/// Draws a channel both ways.
fn verdict(
    stage: &mut RenderFixture,
    model: &Model,
    wall: &Wall,
    id: ChannelId,
    at: Camera,
) -> Verdict {
    let view = reference_view(wall, id, at).expect("an eye in front of the screen");
    let sky = DVec3::from_array(SKY.to_array().map(|light| f64::from(light as f32)));
    let expected = raster::draw(&view, &model.facets(), sky);
    let drawn = stage.channel(wall, id, at);
    let mut verdict = Verdict::default();
    let mut first_wrong = None;
    for (index, (pixel, sample)) in drawn.pixels().zip(&expected).enumerate() {
        let Sample { facet, light, is_sure, w } = *sample;
        if !is_sure {
            verdict.unsure += 1;
            continue;
        }
        verdict.sure += 1;
        verdict.covered += usize::from(facet.is_some());
        // All surfaces of these scenes are unlit; the sky is light.
        let codes =
            if facet.is_some() { tone::unlit_codes(light) } else { tone::codes(light, 1.0) };
        let levels = (0..3).map(|i| (codes[i] - f64::from(pixel.0[i])).abs());
        if levels.fold(0.0, f64::max) > LEVELS_MAX {
            verdict.wrong += 1;
            let place = [index as u32 % drawn.width(), index as u32 / drawn.width()];
            first_wrong.get_or_insert((place, pixel.0, codes, facet, w));
        }
    }
    if let Some((place, drawn, wanted, facet, w)) = first_wrong {
        println!("wrong at {place:?}: {drawn:?} instead of {wanted:.1} of {facet:?} at {w} m");
    }
    verdict
}

/// Asserts that all pixels which the reference is sure of are right, that there are such, and that
/// it is sure of nearly all.
#[track_caller]
fn assert_right(name: &str, verdict: Verdict) {
    println!("{name}: {verdict:?}");
    assert_eq!(verdict.wrong, 0, "{name}: {verdict:?}");
    assert!(verdict.covered > 0, "{name}: nothing is seen: {verdict:?}");
    assert!(verdict.unsure * 20 < verdict.sure, "{name}: too little is sure: {verdict:?}");
}

/// The channels of a wall.
fn channels(wall: &Wall) -> impl Iterator<Item = ChannelId> + use<> {
    wall.channel_ids()
}
