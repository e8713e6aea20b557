//! The level of detail of frames: one decision for all channels.

use std::collections::BTreeMap;

use polyptych_protocol::quality_bounds::{
    DetailBound, DrawnDetail, ERROR_PX_MAX, QualityBounds, RESOLUTION_STEPS_MAX, resolution_scale,
};
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::View;

use super::barrier::Barrier;
use super::rate_bound::budget_us;
use super::{Cluster, Micros, SessionId};

/// Maximum error that a server may report as a multiple of the bound in force, or in pixels if that
/// is 0: more than the pixels of the longest canvas.
const FRACTION_MAX: f32 = 65_536.0;

/// An error beyond the bound in force is told from here on, in pixels: less is not seen.
const TOLD_ERROR_PX: f64 = 0.05;

/// The pixel densities of views, which depend on the wall, the head and the views.
#[derive(Debug)]
pub(super) struct Densities {
    head: HeadPose,
    views: Vec<View>,
    /// By view.
    all: Vec<f64>,
}

/// Views of which only the camera differs have the same density.
fn without_cameras(views: &[View]) -> Vec<View> {
    let camera = polyptych_wall::camera::Camera::IDENTITY;
    views.iter().map(|view| View { camera, ..view.clone() }).collect()
}

impl Cluster {
    /// Bounds error and rate from the next frame on.
    pub(super) fn set_bounds(&mut self, bounds: QualityBounds) -> Result<(), String> {
        bounds.validate()?;
        let is_paused = self.pacer.pace().is_none();
        if self.rate_bound.set_rate(self.presentation.bounds.rate_fps, bounds.rate_fps, is_paused) {
            // What is drawn in full takes longer than what was.
            self.deadline.restart();
        }
        self.presentation.bounds = bounds;
        Ok(())
    }

    /// The error bound and the resolution in force for the next frame.
    pub(super) fn detail_bound(&mut self) -> DetailBound {
        let resolution_steps = self.rate_bound.resolution_steps(&self.presentation.bounds);
        let error_px = self.rate_bound.in_force_px(&self.presentation.bounds);
        let follows_rate = self.presentation.bounds.rate_fps.is_some();
        if error_px == 0.0 && self.wall.budget.gpu_mib.is_none() {
            return DetailBound { follows_rate, ..DetailBound::default() };
        }
        let head = self.presentation.head;
        let views = without_cameras(&self.presentation.all_views());
        let is_known = |of: &Densities| of.head == head && of.views == views;
        if !self.densities.as_ref().is_some_and(is_known) {
            let density = |view: &View| self.wall.pixel_density(view, &head);
            let all = views.iter().map(density).collect();
            self.densities = Some(Densities { head, views, all });
        }
        let densities = self.densities.as_ref().map(|of| of.all.clone());
        let densities = densities.unwrap_or_default();
        DetailBound { error_px, densities, resolution_steps, follows_rate }
    }

    /// Forgets the densities of a wall that is calibrated anew.
    pub(super) fn end_densities(&mut self) {
        self.densities = None;
    }

    /// The detail that a frame was drawn with.
    pub(super) fn drawn_detail(&self, barrier: &Barrier) -> DrawnDetail {
        // A server may say what it wants; NaN becomes 0. What a budget leaves out may be worse
        // than the bound, and is in pixels if the bound is 0.
        let is_limited = self.wall.budget.gpu_mib.is_some();
        let most = if is_limited { FRACTION_MAX } else { 1.0 };
        let fractions = barrier.drawn.values().map(|drawn| drawn.error_fraction.clamp(0.0, most));
        let largest = f64::from(fractions.fold(0.0, f32::max));
        let is_in_pixels = is_limited && barrier.error_px == 0.0;
        let unit_px = if is_in_pixels { 1.0 } else { barrier.error_px };
        let limiting = barrier.limiting_channel(&self.registry);
        let limiting = limiting.and_then(|id| self.wall.channel(id));
        DrawnDetail {
            error_in_force_px: barrier.error_px,
            largest_error_px: unit_px * largest,
            limiting_channel: limiting.map(|channel| channel.name.clone()),
            resolution_scale: resolution_scale(barrier.reduction.resolution_steps()),
            awaits_detail: self.awaits_detail(barrier.revision),
        }
    }

    /// The resolution of the next frame: pixels along each side, as a share of the wall's.
    pub(super) fn resolution_scale(&self) -> f64 {
        resolution_scale(self.rate_bound.resolution_steps(&self.presentation.bounds))
    }

    /// The warning that the budget of GPU memory holds less detail than was asked for, if so.
    pub(super) fn budget_warning(&self) -> Option<String> {
        let mib = self.wall.budget.gpu_mib?;
        let [in_force, drawn] = self.drawn_error_px;
        (drawn > in_force + TOLD_ERROR_PX).then(|| {
            format!(
                "the budget of {mib} MiB (budget.gpu_mib) holds detail of {drawn:.1} pixels only, \
                 where {in_force:.1} is the bound in force; raise the budget"
            )
        })
    }

    /// The warning that the rate bound costs resolution, or is not kept at all, if so.
    pub(super) fn rate_warning(&self) -> Option<String> {
        let bounds = &self.presentation.bounds;
        let rate = bounds.rate_fps?;
        if self.rate_bound.is_unmet(bounds) && budget_us(rate, self.undrawn_time()).is_none() {
            return Some(format!(
                "the rate bound of {rate} frames per second is not kept: the swap lead of {} ms \
                 (sync.swap_lead_ms) leaves no time to draw in; lower the bound, or the lead",
                self.wall.sync.swap_lead_ms
            ));
        }
        let (name, draw_us) = self.slowest_server().unwrap_or(("?", 0));
        // The same words for all numbers: what has other words is told as news.
        let who = format!("the server of channel {name}");
        let draw_ms = draw_us as f64 / 1000.0;
        if self.rate_bound.is_unmet(bounds) {
            let least = 100.0 * resolution_scale(RESOLUTION_STEPS_MAX);
            return Some(format!(
                "the rate bound of {rate} frames per second is not kept: {who} draws \
                 {draw_ms:.1} ms for all its channels even with an error of {ERROR_PX_MAX} pixels \
                 and {least} % of the pixels along each side; lower the bound, or the pixels of \
                 the channel"
            ));
        }
        let scale = self.resolution_scale();
        (scale < 1.0).then(|| {
            format!(
                "the wall draws {:.0} % of its pixels along each side to keep {rate} frames per \
                 second: {who} is the slowest, with {draw_ms:.1} ms for all its channels; \
                 lower the rate bound, or the pixels of the channel",
                100.0 * scale
            )
        })
    }

    /// The server that drew longest for all of its channels, one after another: the name of the
    /// one that took longest, and the time of all of them.
    fn slowest_server(&self) -> Option<(&str, Micros)> {
        let mut servers: BTreeMap<SessionId, Vec<(u32, &str)>> = BTreeMap::new();
        for (_, channel) in self.registry.channels() {
            if let (Some(server), Some(draw_us)) = (channel.server, channel.draw_us) {
                servers.entry(server).or_default().push((draw_us, channel.name.as_str()));
            }
        }
        let sums = servers.values().map(|channels| {
            let sum_us: Micros = channels.iter().map(|(draw_us, _)| Micros::from(*draw_us)).sum();
            (sum_us, channels)
        });
        let (sum_us, channels) = sums.max_by_key(|(sum_us, _)| *sum_us)?;
        let &(_, name) = channels.iter().max()?;
        Some((name, sum_us))
    }
}
