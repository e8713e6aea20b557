//! From `[channel.NAME]` to a channel's [`ChannelCalibration`](polyptych_wall::ChannelCalibration).

use std::collections::BTreeMap;

use glam::{DMat3, DVec2, DVec3, UVec2};
use polyptych_text::counted;
use polyptych_wall::channel::is_monitor_name;
use polyptych_wall::channel_calibration::{BitDepth, BlendWidths, ControlGrid, TransferFunction};
use polyptych_wall::limits::{BEND_POINTS_MAX, CURVE_POINTS_MAX, LEAK_MAX, NAME_BYTES_MAX};
use polyptych_wall::{
    CalibrationFileKind, ChannelKind, Eye, FrustumMode, Ramps, StereoPacking, foldover,
};

use super::check::check_numbers;
use super::document::{AdjustSection, BendSection, EdgesSection, ScalarOrRgb, WarpObj, WarpZero};
use super::error::WallFileError;
use super::files::Files;
use super::screen::ChannelDraft;
use super::source::{SourceText, quoted};
use super::toml_error::suggest;

/// Farthest that a pin or a point of a bend moves anything: some channels' widths.
const MOVE_MAX_PX: f64 = 65_536.0;

/// Most that light is multiplied by.
const LIGHT_FACTOR_MAX: f64 = 1e3;

/// Most names that an error lists: the line is for people.
const NAMES_LISTED_MAX: usize = 12;

/// Gives every channel what its table says.
pub(super) fn channels(
    source: &SourceText<'_>,
    sections: &BTreeMap<String, AdjustSection>,
    drafts: &mut [ChannelDraft],
    files: &mut Files,
) -> Result<(), WallFileError> {
    let names: Vec<String> = drafts.iter().map(|draft| draft.channel.name.clone()).collect();
    let is_unknown = |name: &&String| !names.contains(name);
    if let Some(unknown) = sections.keys().find(is_unknown) {
        let what = format!("there is no channel {unknown:?}");
        let listed = &names[..names.len().min(NAMES_LISTED_MAX)];
        let remedy = suggest(unknown, listed, "channels");
        return Err(source.error(format!("channel.{}", quoted(unknown)), what, remedy));
    }
    for draft in &mut *drafts {
        let key = format!("channel.{}", quoted(&draft.channel.name));
        if let Some(section) = sections.get(&draft.channel.name) {
            Table { source, key, section }.apply(draft, files)?;
        }
        if draft.channel.cover == ChannelKind::Map && draft.channel.adjustment.warp.is_none() {
            let what = format!("nobody knows what channel {:?} shows", draft.channel.name);
            let remedy = "give origin or projector, or a warp file in [channel.NAME]";
            return Err(source.error(format!("{}.origin", draft.key), what, remedy));
        }
    }
    check_monitors(source, drafts)
}

/// Refuses two channels of one server on one monitor.
fn check_monitors(source: &SourceText<'_>, drafts: &[ChannelDraft]) -> Result<(), WallFileError> {
    let mut taken = BTreeMap::new();
    for channel in drafts.iter().map(|draft| &draft.channel) {
        let Some(monitor) = &channel.monitor else { continue };
        if let Some(other) = taken.insert((&channel.server, monitor), &channel.name) {
            let key = format!("channel.{}.monitor", quoted(&channel.name));
            let what = format!("channel {other:?} of the same server fills monitor {monitor:?}");
            return Err(source.error(key, what, "give each a monitor of its own"));
        }
    }
    Ok(())
}

/// One `[channel.NAME]`.
struct Table<'a> {
    source: &'a SourceText<'a>,
    key: String,
    section: &'a AdjustSection,
}

impl Table<'_> {
    fn error(&self, name: &str, what: impl Into<String>, remedy: &str) -> WallFileError {
        self.source.error(format!("{}.{name}", self.key), what, remedy)
    }

    fn apply(&self, draft: &mut ChannelDraft, files: &mut Files) -> Result<(), WallFileError> {
        let s = self.section;
        draft.channel.monitor = self.monitor()?;
        let size = draft.channel.size;
        let adjustment = &mut draft.channel.adjustment;
        adjustment.turn = s.turn.unwrap_or_default();
        adjustment.mirror = s.mirror.unwrap_or_default();
        adjustment.eye = s.eye.unwrap_or_default();
        adjustment.packing = s.stereo.unwrap_or_default();
        if adjustment.packing != StereoPacking::None && adjustment.eye != Eye::Center {
            let what = "a display that shows both eyes is not for one of them";
            return Err(self.error("eye", what, "leave out eye, or stereo"));
        }
        if let Some(edges) = &s.edges {
            adjustment.edges = self.edges(edges, size)?;
        }
        adjustment.bits = match s.bits {
            None | Some(8) => BitDepth::Eight,
            Some(10) => BitDepth::Ten,
            Some(other) => {
                let what = format!("codes of {other} bits are not possible");
                return Err(self.error("bits", what, "write 8 or 10"));
            }
        };
        adjustment.color.matrix = self.matrix()?;
        if let Some(gain) = s.gain {
            adjustment.color.gain = self.light("gain", gain)?;
        }
        adjustment.color.curve = self.curve()?;
        adjustment.color.leak = s.leak.map(|leak| self.leak(leak)).transpose()?;
        let mut file = |name: &str, path: &Option<String>, kind| {
            let key = format!("{}.{name}", self.key);
            path.as_ref().map(|path| files.index(self.source, &key, path, kind)).transpose()
        };
        adjustment.warp = file("warp", &s.warp, self.warp_kind()?)?;
        adjustment.alpha = file("alpha", &s.alpha, CalibrationFileKind::Alpha)?;
        adjustment.beta = file("beta", &s.beta, CalibrationFileKind::Beta)?;
        adjustment.ramps = self.ramps()?;
        if let Some(pin) = s.pin {
            for (index, pair) in pin.iter().enumerate() {
                let key = format!("{}.pin[{index}]", self.key);
                check_numbers(self.source, &key, &pair.0, MOVE_MAX_PX, "pixels")?;
            }
            adjustment.pin = pin.map(|pair| DVec2::from_array(pair.0));
        }
        if let Some(bend) = &s.bend {
            adjustment.bend = Some(self.bend(bend)?);
        }
        if let Some(fault) = foldover::fault(&draft.channel) {
            return Err(self.error(fault.key, fault.what, fault.remedy));
        }
        if s.warp.is_none() {
            return Ok(());
        }
        if let ChannelKind::Projector(_) = draft.channel.cover {
            let what = "where its pixels lie is given twice, by a warp file and by a projector";
            return Err(self.error("warp", what, "keep one of the two"));
        }
        // No canvas is shared with it.
        (draft.channel.cover, draft.channel.projection) = (ChannelKind::Map, FrustumMode::Own);
        Ok(())
    }

    /// Returns the kind of its warp file; plain if it has none.
    fn warp_kind(&self) -> Result<CalibrationFileKind, WallFileError> {
        let s = self.section;
        if s.warp_zero.is_some() && s.warp.is_none() {
            let what = "there is no warp whose points at (0, 0, 0) could be dark";
            return Err(self.error("warp_zero", what, "name a warp, or leave it out"));
        }
        if s.warp_obj.is_some() && s.warp.is_none() {
            let what = "there is no warp that could be an OBJ";
            return Err(self.error("warp_obj", what, "name a warp, or leave it out"));
        }
        match (s.warp_zero, s.warp_obj) {
            (Some(WarpZero::Dark), Some(WarpObj::Sgct)) => {
                let what = "an OBJ has no pixels that could be dark by warp_zero";
                Err(self.error("warp_obj", what, "keep one of the two"))
            }
            (Some(WarpZero::Dark), _) => Ok(CalibrationFileKind::WarpDarkZeros),
            (_, Some(WarpObj::Sgct)) => Ok(CalibrationFileKind::WarpSgct),
            _ => Ok(CalibrationFileKind::Warp),
        }
    }

    fn monitor(&self) -> Result<Option<String>, WallFileError> {
        let Some(monitor) = &self.section.monitor else { return Ok(None) };
        if !is_monitor_name(monitor) {
            let shown = monitor.chars().take(NAME_BYTES_MAX).collect::<String>();
            let what = format!("{shown:?} is not the name of a monitor");
            let remedy = format!(
                "write 1 to {NAME_BYTES_MAX} bytes, as `polyptych server --list-monitors` prints \
                 them"
            );
            return Err(self.error("monitor", what, &remedy));
        }
        Ok(Some(monitor.clone()))
    }

    fn ramps(&self) -> Result<Ramps, WallFileError> {
        let ramps = self.section.ramps.unwrap_or_default();
        if ramps == Ramps::Computed {
            return Ok(ramps);
        }
        if self.section.alpha.is_none() {
            let what = "there is no alpha file that says how its light fades";
            return Err(self.error("ramps", what, "give alpha, or leave out ramps"));
        }
        if self.section.edges.is_some() {
            let what = "how its light fades is given twice, by edges and by its alpha file";
            return Err(self.error("ramps", what, "keep one of the two"));
        }
        Ok(ramps)
    }

    fn edges(&self, edges: &EdgesSection, size: UVec2) -> Result<BlendWidths, WallFileError> {
        let given = [
            ("edges.left", edges.left, size.x),
            ("edges.right", edges.right, size.x),
            ("edges.top", edges.top, size.y),
            ("edges.bottom", edges.bottom, size.y),
        ];
        for (name, edge, side) in given {
            let side = f64::from(side);
            if let Some(edge) = edge.filter(|edge| !(0.0..=side).contains(edge)) {
                let what = format!("a ramp of {edge:?} pixels is not possible");
                let remedy = format!("write 0 to {side}, or leave it out for the whole overlap");
                return Err(self.error(name, what, &remedy));
            }
        }
        let EdgesSection { left, right, top, bottom } = *edges;
        Ok(BlendWidths { left, right, top, bottom })
    }

    fn matrix(&self) -> Result<DMat3, WallFileError> {
        let Some(rows) = self.section.matrix else { return Ok(DMat3::IDENTITY) };
        for (index, row) in rows.iter().enumerate() {
            let key = format!("{}.matrix[{index}]", self.key);
            check_numbers(self.source, &key, &row.0, LIGHT_FACTOR_MAX, "light")?;
        }
        Ok(DMat3::from_cols_array_2d(&rows.map(|row| row.0)).transpose())
    }

    /// Numbers from 0 by which light is multiplied.
    fn light(&self, name: &str, light: ScalarOrRgb) -> Result<DVec3, WallFileError> {
        let found = rgb(light);
        let odd = found.to_array().into_iter().find(|n| !(0.0..=LIGHT_FACTOR_MAX).contains(n));
        odd.map_or(Ok(found), |number| {
            let what = format!("light cannot be multiplied by {number:?}");
            Err(self.error(name, what, &format!("write 0 to {LIGHT_FACTOR_MAX}, such as 0.9")))
        })
    }

    /// Shares of white that black has.
    fn leak(&self, leak: ScalarOrRgb) -> Result<DVec3, WallFileError> {
        let found = rgb(leak);
        let odd = found.to_array().into_iter().find(|share| !(0.0..=LEAK_MAX).contains(share));
        odd.map_or(Ok(found), |share| {
            let what = format!("a display cannot leak {share:?} of its white");
            let remedy = format!("write a share from 0 to {LEAK_MAX}, such as 0.003");
            Err(self.error("leak", what, &remedy))
        })
    }

    fn curve(&self) -> Result<TransferFunction, WallFileError> {
        match (self.section.gamma, &self.section.curve) {
            (None, None) => Ok(TransferFunction::Srgb),
            (Some(_), Some(_)) => {
                let what = "how codes become light is given twice, by gamma and by curve";
                Err(self.error("curve", what, "keep one of the two"))
            }
            (Some(gamma), None) => {
                let gamma = rgb(gamma);
                let is_odd = |n: &f64| !(n.is_finite() && *n > 0.0);
                let odd = gamma.to_array().into_iter().find(is_odd);
                odd.map_or(Ok(TransferFunction::Gamma(gamma)), |number| {
                    let what = format!("a gamma of {number:?} is not possible");
                    Err(self.error("gamma", what, "write a number above 0, such as 2.2"))
                })
            }
            (None, Some(points)) => self.measured(points).map(TransferFunction::Measured),
        }
    }

    fn measured(&self, points: &[ScalarOrRgb]) -> Result<Vec<DVec3>, WallFileError> {
        let light: Vec<DVec3> = points.iter().map(|point| rgb(*point)).collect();
        if !(2..=CURVE_POINTS_MAX).contains(&light.len()) {
            let what = format!("a curve of {}", counted(light.len(), "point"));
            return Err(self.error("curve", what, &format!("write 2 to {CURVE_POINTS_MAX}")));
        }
        let rises = |pair: &[DVec3]| pair[0].cmple(pair[1]).all();
        let fall = light.windows(2).position(|pair| !rises(pair)).map(|at| at + 1);
        let last = light.len() - 1;
        let odd = [(0, DVec3::ZERO), (last, DVec3::ONE)].into_iter();
        let odd = odd.filter(|(at, end)| light[*at] != *end).map(|(at, _)| at).next().or(fall);
        odd.map_or(Ok(light), |at| {
            let what = "the curve does not rise from 0 to 1";
            let remedy = "measure the light of equally spaced codes, black being 0 and white 1";
            Err(self.error(&format!("curve[{at}]"), what, remedy))
        })
    }

    fn bend(&self, bend: &BendSection) -> Result<ControlGrid, WallFileError> {
        let points = UVec2::from_array(bend.points);
        let count = u64::from(points.x) * u64::from(points.y);
        if points.min_element() < 2 || count > BEND_POINTS_MAX as u64 {
            let what = format!("a grid of {}×{} points is not possible", points.x, points.y);
            let remedy = format!("write 2 or more each, {BEND_POINTS_MAX} together");
            return Err(self.error("bend.points", what, &remedy));
        }
        if bend.moves.len() as u64 != count {
            let moves = counted(bend.moves.len(), "move");
            let what = format!("found {moves} for {count} points");
            let remedy = format!("write {count} moves, row by row from the upper left");
            return Err(self.error("bend.moves", what, &remedy));
        }
        for (index, pair) in bend.moves.iter().enumerate() {
            let key = format!("{}.bend.moves[{index}]", self.key);
            check_numbers(self.source, &key, &pair.0, MOVE_MAX_PX, "pixels")?;
        }
        let moves = bend.moves.iter().map(|pair| DVec2::from_array(pair.0)).collect();
        Ok(ControlGrid { points, moves })
    }
}

fn rgb(light: ScalarOrRgb) -> DVec3 {
    match light {
        ScalarOrRgb::Gray(number) => DVec3::splat(number),
        ScalarOrRgb::Rgb(numbers) => DVec3::from_array(numbers),
    }
}
