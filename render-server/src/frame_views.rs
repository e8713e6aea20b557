//! The views of a frame, as the renderer takes them.

use glam::{DMat3, DMat4, DVec3};
use polyptych_protocol::command::Frame;
use polyptych_renderer::{AllowedError, ViewDesc};
use polyptych_scene::{NodeId, Scene, SceneSubset};
use polyptych_wall::camera::Camera;
use polyptych_wall::limits::VIEWS_MAX;
use polyptych_wall::view::{View, ViewProjection, ViewRect};
use polyptych_wall::{ChannelId, Eye, Wall};

/// Views of a frame that have shadows, the first ones: a camera's maps take up to 256 MiB. Which
/// ones a channel shows does not matter, so that all channels agree.
const SHADOWED_VIEWS_MAX: usize = 4;

/// The eye of a channel or of a part of it, with the frustum and the pixels that it sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewTransform {
    /// In metres of display space.
    pub eye_in_display: DVec3,
    /// Turns a vector from the eye in display space into view space.
    pub view_from_display: DMat3,
    /// The matrix of [`ViewDesc::clip_from_view`].
    pub clip_from_view: DMat4,
    /// The canvas of [`ViewDesc::viewport`].
    pub viewport: [f64; 4],
    /// `true` if a channel of the wall is for one of the viewer's eyes.
    pub is_stereo_wall: bool,
}

/// Returns whether a channel of the wall is for one of the viewer's eyes.
pub(crate) fn is_stereo(wall: &Wall) -> bool {
    wall.channels.iter().any(|channel| *channel.eyes() != [Eye::Center])
}

impl ViewTransform {
    /// The view of this number of a frame from here, on all of the pixels.
    pub fn view(&self, (number, view): (usize, &View), frame: &Frame) -> ViewDesc {
        let camera = &view.camera;
        let allowed = frame.detail.allowed_in(number);
        let pixel = frame.detail.pixel_in(number);
        let none = AllowedError { follows_rate: frame.detail.follows_rate, ..AllowedError::NONE };
        let allowed_error = match view.projection {
            ViewProjection::Orthographic { .. } => {
                let [length, pixel] = [allowed, pixel].map(|of| of * camera.scale);
                AllowedError { length, pixel, ..none }
            }
            ViewProjection::Perspective { .. } => {
                AllowedError { angle_rad: allowed, pixel, ..none }
            }
            // The head's and not this channel's eye's, which may be the middle one, or, near a
            // dome's pole, nearer to it than others.
            ViewProjection::Wall => AllowedError {
                angle_rad: allowed,
                pixel,
                eye_offset: f64::from(u8::from(self.is_stereo_wall))
                    * frame.presentation.head.eye_separation_m
                    * 0.5
                    * camera.scale,
                ..none
            },
        };
        // World to display space, the eye being the origin of both, then to the screen's axes;
        // a view is in metres, whatever the world's unit.
        let display_from_world =
            DMat3::from_quat(camera.rotation).transpose() * camera.scale.recip();
        // A camera's own picture is the same for both eyes.
        let middle_eye = match view.projection {
            ViewProjection::Wall => frame.presentation.head.position,
            _ => self.eye_in_display,
        };
        ViewDesc {
            eye_in_world: camera.world_from_display(self.eye_in_display),
            middle_eye_in_world: camera.world_from_display(middle_eye),
            view_from_world: self.view_from_display * display_from_world,
            clip_from_view: self.clip_from_view,
            viewport: self.viewport,
            scissor: None,
            exposure: frame.presentation.exposure,
            tone: frame.presentation.tone,
            fog: frame.presentation.fog,
            glow: frame.presentation.glow,
            ambient_occlusion: frame.presentation.ambient_occlusion,
            depth_of_field: frame.presentation.depth_of_field,
            subset: SceneSubset { root: view.root.map(NodeId), layers: view.layers.clone() },
            allowed_error,
            has_shadows: number < SHADOWED_VIEWS_MAX,
        }
    }
}

/// Returns the rectangles of a channel and the view that each shows of a frame; none overlap.
///
/// # Errors
/// Too many of them, or what this server cannot draw.
pub(crate) fn view_rects(
    wall: &Wall,
    id: ChannelId,
    frame: &Frame,
) -> Result<Vec<ViewRect>, String> {
    check_frame(frame)?;
    wall.view_rects(id, &frame.presentation.all_views()).map_err(|error| error.to_string())
}

/// Checks that this server can draw the views of a frame.
///
/// # Errors
/// Too many of them, or more than it can.
pub(crate) fn check_frame(frame: &Frame) -> Result<(), String> {
    let views = frame.presentation.views.len() + 1;
    if views > VIEWS_MAX {
        return Err(format!(
            "the frame has {views} views, with that of the wall itself; the maximum is \
             {VIEWS_MAX}: take views away"
        ));
    }
    Ok(())
}

/// Returns the transform of a view on a channel, for an eye in metres of display space.
///
/// # Errors
/// A view that cannot be shown, an eye that no frustum can be made for.
pub(crate) fn view_transform(
    wall: &Wall,
    id: ChannelId,
    view: &View,
    eye_in_display: DVec3,
) -> Result<ViewTransform, String> {
    let frustum = wall.view_frustum(id, view, eye_in_display).map_err(|error| error.to_string())?;
    Ok(ViewTransform {
        is_stereo_wall: is_stereo(wall),
        eye_in_display: frustum.eye,
        view_from_display: frustum.view_from_display,
        clip_from_view: frustum.clip_from_view,
        viewport: frustum.viewport,
    })
}

/// The views of a frame that a channel shows, as the eye sees them that it is for. They do not lie
/// over each other: of each pixel only the last view is drawn that covers it.
///
/// # Errors
/// A view that cannot be shown, an eye that no frustum can be made for.
pub fn views(wall: &Wall, channel: ChannelId, frame: &Frame) -> Result<Vec<ViewDesc>, String> {
    let eye = wall.channel(channel).map_or_else(Eye::default, |c| c.adjustment.eye);
    let size = wall.channel(channel).map_or([0; 2], |channel| channel.size.to_array());
    let all = frame.presentation.all_views();
    let described = view_rects(wall, channel, frame)?.into_iter().map(|part| {
        let view = &all[part.view];
        let seen = view_transform(wall, channel, view, frame.presentation.head.eye(eye))?
            .view((part.view, view), frame);
        let scissor = (part.rect != [0, 0, size[0], size[1]]).then_some(part.rect);
        Ok(ViewDesc { scissor, ..seen })
    });
    described.collect()
}

/// The view with which a new scene is drawn once before anyone sees it: from its edge, so that
/// all of its pipelines are used.
pub fn warm_up_camera(scene: &Scene) -> Camera {
    let Some(bounds) = scene.bounds else { return Camera::IDENTITY };
    let back = DVec3::new(0.0, 0.5, 2.5) * bounds.radius().max(1e-9);
    Camera::look_at(bounds.center() + back, bounds.center(), DVec3::Y)
}
