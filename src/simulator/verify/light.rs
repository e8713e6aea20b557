//! The light of a wall: what one channel's picture says before it was shared, and from how many
//! pixels it is drawn.

pub(super) mod weight_checker;

use anyhow::Context;
use glam::{DVec3, UVec2};
use polyptych_client::Image;
use polyptych_wall::blend::{BlendMap, BlendModel, ChannelMasks};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::light_composite::{LinearImage, StereoEye};
use polyptych_wall::limits::CHANNEL_SIDE_MAX;
use polyptych_wall::view_atlas::ViewAtlas;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::warp::Mask;
use polyptych_wall::{ChannelId, Eye, StereoPacking, Wall};

use super::marker::LuminanceImage;
use super::verification_report::{Bound, VerificationReport};

/// Least source pixels per pixel of a channel: what comes of rounding sides up to whole pixels.
const DENSITY_MIN: f64 = 0.999;

/// A weight below this says too little of the light that was weighted: half a level becomes two.
/// The neighbour, whose weight is the rest, tells more.
const WEIGHT_MIN: f64 = 0.25;

/// Returns the side from which an eye sees a wall; the middle of both sees what the left one does.
pub(super) fn side_of(eye: Eye) -> StereoEye {
    if eye == Eye::Right { StereoEye::Right } else { StereoEye::Left }
}

/// The correction of a channel's light.
#[derive(Clone, Debug)]
pub(super) struct Correction {
    /// The light of its corrected white.
    white: DVec3,
    /// The factors and addends of its light, from blends and files.
    map: Option<BlendMap>,
}

/// Returns the correction of each channel's light; made once, as it takes a while.
pub(super) fn corrections(shaped: ResolvedWall<'_>, files: &CalibrationMaps) -> Vec<Correction> {
    let blend = BlendModel::new(shaped);
    let map = |id: ChannelId| {
        let channel = shaped.wall.channel(id)?;
        let light =
            shaped.channel_mapping(id).and_then(|pixels| files.mesh_light_mask(channel, &pixels));
        let light = light.as_ref().and_then(Mask::texels);
        blend.blend_map(id, &ChannelMasks { light, ..files.masks(&channel.adjustment) })
    };
    let white = |id| blend.color(id).map_or(DVec3::ONE, |color| color.made() * DVec3::ONE);
    shaped.wall.channel_ids().map(|id| Correction { white: white(id), map: map(id) }).collect()
}

/// The wall that servers draw, and what each channel's light goes through.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drawn<'a> {
    pub wall: &'a Wall,
    pub corrections: &'a [Correction],
}

/// The light of a channel's picture for one of its eyes on the wall as it stands, upright and
/// before it was shared.
///
/// # Errors
/// A picture that is not of the display's size.
pub(super) fn of(
    Drawn { wall, corrections }: Drawn<'_>,
    built: &Wall,
    (id, eye): (ChannelId, Eye),
    picture: &Image,
) -> anyhow::Result<LuminanceImage> {
    let channel = wall.channel(id).context("the wall has no such channel")?;
    let side = side_of(eye);
    let shown = LinearImage::new(built, id, side, &picture.rgba);
    let shown = shown.with_context(|| format!("the picture of {} has no size", channel.name))?;
    let correction = corrections.get(usize::from(id.0));
    let Correction { white, map } = correction.context("a channel has no light")?;
    // Of an anaglyph's left eye only red is there.
    let is_red = channel.adjustment.packing == StereoPacking::Anaglyph && side == StereoEye::Left;
    let axis = usize::from(!is_red);
    let size = channel.size;
    let mut grey = Vec::with_capacity(size.x as usize * size.y as usize);
    for y in 0..size.y {
        for x in 0..size.x {
            let light = shown.pixel(UVec2::new(x, y))[axis];
            let [multiply, add] = map.as_ref().map_or([1.0, 0.0], |map| map.texel(x, y, axis));
            let own = (light - add) / multiply / white[axis];
            grey.push(if multiply < WEIGHT_MIN { f32::NAN } else { own as f32 });
        }
    }
    Ok(LuminanceImage { size, grey })
}

/// Proves from how many pixels channels are drawn that are warped.
///
/// # Errors
/// A channel that cannot be drawn at all.
pub(super) fn prove_sampling(
    shaped: ResolvedWall<'_>,
    table: &mut VerificationReport,
) -> anyhow::Result<()> {
    let wall = shaped.wall;
    let mut densities: Vec<(f64, f64, &str)> = Vec::new();
    let mut stereo: Vec<(f64, String)> = Vec::new();
    for id in wall.channel_ids() {
        let (Some(channel), Some(map)) = (wall.channel(id), shaped.channel_mapping(id)) else {
            continue;
        };
        if !super::geometry::is_warped(wall, channel) {
            continue;
        }
        let eyes = wall.viewpoints(channel);
        let mesh = map.drawn_mesh().refined_for(&eyes);
        if mesh.triangles.is_empty() {
            continue;
        }
        let plan = ViewAtlas::new(&mesh, &eyes, wall.near_m, CHANNEL_SIDE_MAX);
        let plan = plan.with_context(|| format!("channel {}", channel.name))?;
        densities.push((plan.density_min, plan.density_max, &channel.name));
        if !plan.triangles.is_empty() {
            let note = format!("{}, {} planes for each eye", channel.name, plan.triangles.len());
            stereo.push((plan.stereo_error_px, note));
        }
    }
    let Some(least) = densities.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(()) };
    let target = Some(Bound::AtLeast(DENSITY_MIN));
    table.add("source pixels per pixel, least", least.0, "", target, least.2);
    if let Some(most) = densities.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
        table.add("source pixels per pixel, most", most.1, "", None, most.2);
    }
    if let Some((error, note)) = stereo.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) {
        let most = Some(Bound::AtMost(wall.stereo.error_max_px));
        table.add("omnidirectional stereo, as planned", error, "px", most, note);
    }
    Ok(())
}
