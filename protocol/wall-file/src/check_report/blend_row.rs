//! The places where the light that channels share adds up worst.

use glam::DVec2;
use polyptych_wall::blend::{BlendModel, ChannelMasks};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::warp::Mask;
use polyptych_wall::{Channel, ChannelId, Eye};
use serde::Serialize;

use crate::coverage::{self, is_seen_by};

/// Places across and down a canvas that are looked at, if few channels share it.
const SIDE: u32 = 192;

/// Maximum number of times that a channel is asked what it shows.
const LOOKS_MAX: u32 = 1 << 20;

/// The place of a screen at which channels that share it give the least or the most light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlendRow {
    /// The name of the screen.
    pub screen: String,
    /// The eye that sees it.
    pub eye: Eye,
    /// In pixels of the screen's canvas.
    pub place: [f64; 2],
    /// The names of the channels that light it.
    pub channels: Vec<String>,
    /// The sum of their factors, weights and alpha masks: 1 is right.
    pub light: f64,
}

/// A channel that lights a screen.
struct Lit<'a> {
    id: ChannelId,
    channel: &'a Channel,
    masks: ChannelMasks<'a>,
}

/// The worst place of each screen and eye at which two channels or more share light.
pub(super) fn worst(of: ResolvedWall<'_>, maps: &CalibrationMaps) -> Vec<BlendRow> {
    let blend = BlendModel::new(of);
    if !blend.may_light_same() {
        return Vec::new();
    }
    let screens = 0..of.wall.screens.len();
    let eyes = screens.flat_map(|screen| {
        let on = move |channel: &&Channel| usize::from(channel.screen) == screen;
        coverage::eyes(of.wall.channels.iter().filter(on)).iter().map(move |eye| (screen, *eye))
    });
    eyes.filter_map(|(screen, eye)| of_screen(of, maps, &blend, screen, eye)).collect()
}

fn of_screen(
    of: ResolvedWall<'_>,
    maps: &CalibrationMaps,
    blend: &BlendModel<'_>,
    screen: usize,
    eye: Eye,
) -> Option<BlendRow> {
    let wall = of.wall;
    let on_screen =
        |channel: &Channel| usize::from(channel.screen) == screen && is_seen_by(channel, eye);
    let ids = wall.channel_ids().zip(&wall.channels).filter(|(_, channel)| on_screen(channel));
    // What mesh files say of light at corners, for each pixel.
    let corners: Vec<(ChannelId, &Channel, Option<Mask>)> = ids
        .filter_map(|(id, channel)| {
            let pixels = of.channel_mapping(id)?;
            let light = maps.mesh_light_mask(channel, &pixels);
            Some((id, channel, light))
        })
        .collect();
    let lit = corners.iter().map(|(id, channel, light)| {
        let masks = maps.masks(&channel.adjustment);
        let light = light.as_ref().and_then(Mask::texels);
        Lit { id: *id, channel, masks: ChannelMasks { light, ..masks } }
    });
    let lit: Vec<Lit<'_>> = lit.collect();
    let canvas = wall.screens[screen].canvas;
    let side = (LOOKS_MAX / lit.len().max(1) as u32).isqrt().clamp(16, SIDE);
    let steps = canvas.min(glam::UVec2::splat(side));
    let mut worst: Option<(f64, BlendRow)> = None;
    for (x, y) in (0..steps.y).flat_map(|y| (0..steps.x).map(move |x| (x, y))) {
        let place = (glam::UVec2::new(x, y).as_dvec2() + 0.5) / steps.as_dvec2();
        let place = place * canvas.as_dvec2();
        let Some((light, channels)) = light_at(blend, &lit, eye, place) else { continue };
        let off = (light - 1.0).abs();
        if worst.as_ref().is_none_or(|(most, _)| off > *most) {
            let screen = wall.screens[screen].name.clone();
            worst = Some((off, BlendRow { screen, eye, place: place.to_array(), channels, light }));
        }
    }
    worst.map(|(_, row)| row)
}

/// Returns the light of a place for an eye, and the channels that give it; `None` if fewer than two
/// channels do.
fn light_at(
    blend: &BlendModel<'_>,
    lit: &[Lit<'_>],
    eye: Eye,
    place: DVec2,
) -> Option<(f64, Vec<String>)> {
    let shown = lit.iter().filter_map(|lit| {
        let size = lit.channel.size.as_dvec2();
        let pixel = blend.pixel(lit.id, place)?;
        let is_on = pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all();
        is_on.then_some((lit, pixel))
    });
    let shown: Vec<(&Lit<'_>, DVec2)> = shown.collect();
    let (first, _) = shown.get(1).and(shown.first())?;
    // A channel for both eyes is weighed among those of the left one.
    let of_eye = shown.iter().find(|(lit, _)| lit.channel.adjustment.eye == eye);
    let weights = blend.weights(of_eye.map_or(first.id, |(lit, _)| lit.id), place);
    let of_channel = |(lit, pixel): &(&Lit<'_>, DVec2)| {
        let weight = weights.iter().find(|(id, _)| *id == lit.id).map_or(0.0, |(_, w)| *w);
        let [x, y] = pixel.as_uvec2().to_array();
        // Green is most of what is seen.
        let (alpha, _) = lit.masks.at(x, y, lit.channel.size, 1);
        weight * alpha
    };
    let light = shown.iter().map(of_channel).sum();
    let names = shown.iter().map(|(lit, _)| lit.channel.name.clone()).collect();
    Some((light, names))
}
