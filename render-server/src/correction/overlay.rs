//! Views that lie on a warped channel as on a sheet of paper: rectangles of its screen's canvas,
//! with a camera of their own or the wall's frusta. Each has a source of its own, and is drawn
//! over the channel's picture by the pixels that show it.

use glam::{DMat3, DVec2, DVec3};
use polyptych_protocol::quality_bounds::resolution_scale;
use polyptych_renderer::{AtlasViewDesc, Correction, CorrectionMesh, EyeAtlas, Gpu};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::view::{Area, CanvasRect, PointSpace, View, ViewProjection};
use polyptych_wall::view_atlas::MeshPart;
use polyptych_wall::view_atlas::overlay_view::OverlayView;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::warp_mesh::WarpMesh;
use polyptych_wall::{ChannelId, Viewpoint};

use super::eye_views::EyeViews;
use crate::frame_views::{self, ViewTransform};

/// A view's pixels on one channel. It stays while the view stays where it is, whatever its camera
/// sees.
#[derive(Debug)]
pub(super) struct Overlay {
    area: Area,
    is_own: bool,
    /// `None` where no pixel of the channel shows it.
    sheet: Option<OverlayMesh>,
}

/// The pixels of a view on one channel, with its source.
#[derive(Debug)]
pub(super) struct OverlayMesh {
    /// Its pixels.
    pub shape: CorrectionMesh,
    part: CanvasRect,
    mesh: WarpMesh,
    /// For a camera's own picture: the plan, with the steps by which its resolution is lowered.
    plan: Option<(OverlayView, u8)>,
    /// The pictures of the last eyes, for the wall's frusta.
    shots: Option<EyeViews>,
}

/// The context in which overlays are made.
#[derive(Clone, Copy, Debug)]
pub(super) struct OverlayContext<'a> {
    pub gpu: &'a Gpu,
    pub shaped: ResolvedWall<'a>,
    pub maps: &'a CalibrationMaps,
    pub channel: ChannelId,
}

impl Overlay {
    /// The pixels of a view on a channel with this correction.
    ///
    /// # Errors
    /// The channel's pixels have no place on its canvas.
    pub fn new(
        ground: OverlayContext<'_>,
        view: &View,
        correction: &Correction,
    ) -> Result<Self, String> {
        let OverlayContext { gpu, shaped, maps, channel: id } = ground;
        let wall = shaped.wall;
        let is_own = view.projection != ViewProjection::Wall;
        let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
        let named = |what: String| format!("channel {}: {what}", channel.name);
        let lay = |sheet| Self { area: view.area, is_own, sheet };
        if matches!(view.area, Area::Screen { screen, .. } if screen != channel.screen) {
            return Ok(lay(None));
        }
        let part = wall.canvas_rect(channel, &view.area).map_err(|error| error.to_string())?;
        let of = if is_own { PointSpace::Canvas } else { PointSpace::Surface };
        let mesh = shaped.overlay_mesh(maps, id, part, of).map_err(named)?;
        let mesh = if is_own { mesh } else { mesh.refined_for(&wall.viewpoints(channel)) };
        if mesh.triangles.is_empty() {
            return Ok(lay(None));
        }
        let side_max = gpu.info().texture_side_max;
        let plan = is_own.then(|| OverlayView::new(&mesh, side_max)).transpose();
        let plan = plan.map_err(|error| named(error.to_string()))?.map(|plan| (plan, 0));
        let shape = correction.shape(gpu, &mesh).map_err(|error| named(error.to_string()))?;
        Ok(lay(Some(OverlayMesh { shape, part, mesh, plan, shots: None })))
    }

    /// Returns whether it has the pixels of that view, wherever the view's camera is.
    pub fn matches(&self, view: &View) -> bool {
        self.area == view.area && self.is_own == (view.projection != ViewProjection::Wall)
    }

    /// Returns whether it lies on the whole wall, so that nothing beneath it is seen.
    pub fn is_whole(&self) -> bool {
        self.area == Area::Wall
    }

    /// Returns the number of the channel's pixels that it lies on.
    pub fn pixels(&self) -> f64 {
        self.sheet.as_ref().map_or(0.0, |sheet| pixels(&sheet.mesh))
    }

    /// Returns the share of it that none of these overlays covers, from 0 to 1.
    pub fn seen_share(&self, above: &[&Self]) -> f64 {
        let Some(sheet) = &self.sheet else { return 0.0 };
        let sheets = above.iter().filter_map(|over| over.sheet.as_ref());
        let covered: f64 = sheets.map(|over| common_share(&sheet.part, &over.part)).sum();
        (1.0 - covered).max(0.0)
    }

    /// Returns its mesh; `None` if no pixel of the channel shows the view.
    pub fn mesh(&mut self) -> Option<&mut OverlayMesh> {
        self.sheet.as_mut()
    }
}

impl OverlayMesh {
    /// Returns the planes that are drawn into its source for these eyes.
    ///
    /// # Errors
    /// An eye that sees no picture.
    pub fn eye_views(
        &mut self,
        ground: OverlayContext<'_>,
        view: &View,
        (eyes, resolution_steps): (&[Viewpoint], u8),
    ) -> Result<EyeViews, String> {
        let OverlayContext { gpu, shaped, channel: id, .. } = ground;
        let wall = shaped.wall;
        let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
        let side_max = gpu.info().texture_side_max;
        let Some((plan, steps)) = &mut self.plan else {
            let known = self.shots.take().filter(|shots| shots.matches(eyes, resolution_steps));
            let shots = if let Some(shots) = known {
                shots
            } else {
                let mesh = (&self.mesh, MeshPart::View);
                EyeViews::of_mesh(wall, id, mesh, eyes, (side_max, resolution_steps))?
            };
            return Ok(self.shots.insert(shots).clone());
        };
        if *steps != resolution_steps {
            let share = resolution_scale(resolution_steps);
            let reduced = OverlayView::reduced(&self.mesh, side_max, share);
            *plan = reduced.map_err(|error| format!("channel {}: {error}", channel.name))?;
            *steps = resolution_steps;
        }
        let rect = plan.plane.rect;
        let sight = ViewTransform {
            is_stereo_wall: frame_views::is_stereo(wall),
            eye_in_display: DVec3::ZERO,
            view_from_display: DMat3::IDENTITY,
            clip_from_view: wall.overlay_matrix(channel, view, &self.part, plan.part),
            viewport: rect.map(f64::from),
        };
        // Both eyes see the same, in the plane of the screen.
        let eye_in_display = DVec3::ZERO;
        let plane =
            AtlasViewDesc { eye_in_display, clip_from_eye: plan.plane.clip_from_eye(), rect };
        let eye = EyeAtlas { planes: vec![plane], triangles: None };
        let eyes = vec![eye; eyes.len()];
        let planes = vec![(sight, rect)];
        Ok(EyeViews::from_planes(plan.size.to_array(), eyes, plan.taps.to_array(), planes))
    }
}

/// Returns the number of a channel's pixels that a mesh lies on.
pub(super) fn pixels(mesh: &WarpMesh) -> f64 {
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|corner| mesh.vertices[corner as usize].pixel);
        0.5 * (b - a).perp_dot(c - a).abs()
    };
    mesh.triangles.iter().map(area).sum()
}

/// Returns the share of a part of a canvas that another part covers, from 0 to 1.
fn common_share(part: &CanvasRect, over: &CanvasRect) -> f64 {
    let common = part.end.min(over.end) - part.begin.max(over.begin);
    common.max(DVec2::ZERO).element_product() / (part.end - part.begin).element_product()
}
