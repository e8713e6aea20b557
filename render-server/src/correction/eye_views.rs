//! The planar pictures that a corrected channel's source is made of, for the eyes of one frame.

use std::sync::Arc;

use glam::DMat4;
use polyptych_protocol::command::Frame;
use polyptych_protocol::quality_bounds::resolution_scale;
use polyptych_renderer::{AtlasViewDesc, EyeAtlas, ViewDesc};
use polyptych_wall::view::View;
use polyptych_wall::view_atlas::{MeshPart, ViewAtlas};
use polyptych_wall::warp_mesh::WarpMesh;
use polyptych_wall::{ChannelId, Viewpoint, Wall};

use crate::frame_views::{self, ViewTransform};

/// The planes that are drawn into a source, and the way in which it is read.
#[derive(Clone, Debug)]
pub(crate) struct EyeViews {
    /// The size of the source in pixels.
    pub size: [u32; 2],
    /// The viewpoints of the eyes that see it.
    viewpoints: Vec<Viewpoint>,
    /// The steps by which its resolution is lowered.
    resolution_steps: u8,
    /// Each with its planes.
    pub eyes: Vec<EyeAtlas>,
    /// Samples of the source for each display pixel, across and down.
    pub taps: [u32; 2],
    /// The transform that each plane is drawn with, and its rectangle of the source.
    planes: Vec<(ViewTransform, [u32; 4])>,
}

impl EyeViews {
    /// The pictures of a channel that these eyes see, with fewer pixels if it is warped: else its
    /// pixels are those of the channel.
    ///
    /// # Errors
    /// An eye that sees no picture, by its channel's name.
    pub fn new(
        wall: &Wall,
        id: ChannelId,
        warp: Option<&WarpMesh>,
        eyes: &[Viewpoint],
        limits: (u32, u8),
    ) -> Result<Self, String> {
        match warp {
            Some(mesh) => Self::of_mesh(wall, id, (mesh, MeshPart::Whole), eyes, limits),
            None => Self::exact(wall, id, eyes),
        }
    }

    /// The pictures of a warped channel, or of a view on it, that these eyes see, from the
    /// adapter's largest texture and the steps by which the resolution is lowered.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn of_mesh(
        wall: &Wall,
        id: ChannelId,
        mesh: (&WarpMesh, MeshPart),
        eyes: &[Viewpoint],
        (side_max, resolution_steps): (u32, u8),
    ) -> Result<Self, String> {
        let scale = resolution_scale(resolution_steps);
        let plan = ViewAtlas::reduced(mesh, eyes, wall.near_m, side_max, scale);
        let plan = plan.map_err(|error| {
            let name = wall.channel(id).map_or("", |channel| &channel.name);
            format!("channel {name}: {error}")
        })?;
        Ok(Self { resolution_steps, ..Self::planar(wall, plan, eyes) })
    }

    fn planar(wall: &Wall, plan: ViewAtlas, eyes: &[Viewpoint]) -> Self {
        let triangles = (!plan.triangles.is_empty()).then(|| Arc::new(plan.triangles));
        let mut shots = Self {
            size: plan.size.to_array(),
            viewpoints: eyes.to_vec(),
            resolution_steps: 0,
            eyes: Vec::with_capacity(eyes.len()),
            taps: plan.taps.to_array(),
            planes: Vec::new(),
        };
        for planes in &plan.planes {
            let of = |plane: &polyptych_wall::view_atlas::AtlasView| AtlasViewDesc {
                eye_in_display: plane.eye,
                clip_from_eye: plane.clip_from_eye(),
                rect: plane.rect,
            };
            let planes_of = planes.iter().map(of).collect();
            shots.eyes.push(EyeAtlas { planes: planes_of, triangles: triangles.clone() });
            shots.planes.extend(planes.iter().map(|plane| {
                let sight = ViewTransform {
                    is_stereo_wall: frame_views::is_stereo(wall),
                    eye_in_display: plane.eye,
                    view_from_display: plane.view_from_display,
                    clip_from_view: plane.clip_from_view,
                    viewport: plane.rect.map(f64::from),
                };
                (sight, plane.rect)
            }));
        }
        shots
    }

    /// Pixels of the source are those of the channel: drawn as a tile is.
    fn exact(wall: &Wall, id: ChannelId, eyes: &[Viewpoint]) -> Result<Self, String> {
        let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
        let [width, height] = channel.size.to_array();
        let mut shots = Self {
            size: [width * eyes.len() as u32, height],
            viewpoints: eyes.to_vec(),
            resolution_steps: 0,
            eyes: Vec::with_capacity(eyes.len()),
            taps: [1, 1],
            planes: Vec::new(),
        };
        for (slot, eye) in (0..).zip(eyes.iter().map(Viewpoint::middle)) {
            let frustum = wall.frustum(id, eye).map_err(|error| error.to_string())?;
            let rect = [slot * width, 0, width, height];
            let [x, y, w, h] = frustum.viewport;
            let sight = ViewTransform {
                is_stereo_wall: frame_views::is_stereo(wall),
                eye_in_display: eye,
                view_from_display: frustum.view_from_display,
                clip_from_view: frustum.clip_from_view,
                viewport: [x + f64::from(rect[0]), y, w, h],
            };
            let clip_from_eye =
                frustum.clip_from_view * DMat4::from_mat3(frustum.view_from_display);
            let planes = vec![AtlasViewDesc { eye_in_display: eye, clip_from_eye, rect }];
            shots.eyes.push(EyeAtlas { planes, triangles: None });
            shots.planes.push((sight, rect));
        }
        Ok(shots)
    }

    /// Pictures of this size that hold these planes.
    pub fn from_planes(
        size: [u32; 2],
        eyes: Vec<EyeAtlas>,
        taps: [u32; 2],
        planes: Vec<(ViewTransform, [u32; 4])>,
    ) -> Self {
        Self { size, viewpoints: Vec::new(), resolution_steps: 0, eyes, taps, planes }
    }

    /// Returns whether these are the eyes that see it, with this resolution.
    pub fn matches(&self, eyes: &[Viewpoint], resolution_steps: u8) -> bool {
        self.viewpoints == eyes && self.resolution_steps == resolution_steps
    }

    /// Returns the views that the renderer draws for one view: one for each plane.
    pub fn view_descs(&self, view: (usize, &View), frame: &Frame) -> Vec<ViewDesc> {
        let drawn = |(seen, rect): &(ViewTransform, [u32; 4])| ViewDesc {
            scissor: Some(*rect),
            ..seen.view(view, frame)
        };
        self.planes.iter().map(drawn).collect()
    }

    /// Returns the views that the renderer draws for a frame of a channel whose pixels are the
    /// source's.
    ///
    /// # Errors
    /// Those of [`crate::frame_views::views`].
    pub fn unwarped_views(
        &self,
        wall: &Wall,
        id: ChannelId,
        frame: &Frame,
    ) -> Result<Vec<ViewDesc>, String> {
        let (all, mut views) = (frame.presentation.all_views(), Vec::new());
        for part in frame_views::view_rects(wall, id, frame)? {
            let view = &all[part.view];
            for (seen, rect) in &self.planes {
                let [x, y, width, height] = part.rect;
                let mut own = frame_views::view_transform(wall, id, view, seen.eye_in_display)?;
                own.viewport[0] += f64::from(rect[0]);
                let scissor = Some([rect[0] + x, rect[1] + y, width, height]);
                views.push(ViewDesc { scissor, ..own.view((part.view, view), frame) });
            }
        }
        Ok(views)
    }
}
