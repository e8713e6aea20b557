//! The presentation of the wall's state. Frames, the manager's memory and every status share it.

use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, LightEffects, ToneMapper};
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::View;
use serde::{Deserialize, Serialize};

use crate::calibration_marker::CalibrationMarker;
use crate::output_mode::OutputMode;
use crate::pattern::TestPattern;
use crate::quality_bounds::QualityBounds;

/// The camera, the head, and how the scene is shown. A picture depends on this, on the revision and
/// on scene time; on nothing else.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Presentation {
    /// The pose of display space in the scene, for the wall's own picture.
    pub camera: Camera,
    /// The pose of the viewer's head.
    pub head: HeadPose,
    /// Views over the wall's own picture, later ones over earlier ones.
    pub views: Vec<View>,
    /// Light is multiplied by this before tone mapping.
    pub exposure: f32,
    /// The content of displays once a frame is swapped.
    pub output_mode: OutputMode,
    /// The test pattern that channels draw instead of the scene, if any.
    pub pattern: Option<TestPattern>,
    /// The error and the rate that pictures are asked to keep.
    pub bounds: QualityBounds,
    /// The way from exposed light to what displays show.
    #[serde(default)]
    pub tone: ToneMapper,
    /// The manager sets the exposure by what the wall shows.
    #[serde(default)]
    pub is_exposure_automatic: bool,
    /// Fog between the eye and what it sees.
    #[serde(default)]
    pub fog: Option<Fog>,
    /// Light that spreads around what is bright.
    #[serde(default)]
    pub glow: Option<Glow>,
    /// Corners and gaps get less of the light from all around.
    #[serde(default)]
    pub ambient_occlusion: Option<AmbientOcclusion>,
    /// What is nearer or farther than a distance is blurred.
    #[serde(default)]
    pub depth_of_field: Option<DepthOfField>,
    /// A point that its channel lights over a pattern. It ends with the manager.
    #[serde(default)]
    pub marker: Option<CalibrationMarker>,
}

impl Presentation {
    /// Returns the effects that frames have.
    pub fn effects(&self) -> LightEffects {
        LightEffects {
            fog: self.fog.is_some(),
            glow: self.glow.is_some(),
            ambient_occlusion: self.ambient_occlusion.is_some(),
            depth_of_field: self.depth_of_field.is_some(),
        }
    }

    /// The scene's own place at the scene's own light, seen from here.
    pub fn new(head: HeadPose) -> Self {
        Self {
            camera: Camera::IDENTITY,
            head,
            views: Vec::new(),
            exposure: 1.0,
            output_mode: OutputMode::Normal,
            pattern: None,
            bounds: QualityBounds::FINEST,
            tone: ToneMapper::default(),
            is_exposure_automatic: false,
            fog: None,
            glow: None,
            ambient_occlusion: None,
            depth_of_field: None,
            marker: None,
        }
    }

    /// The wall's own picture, and what lies over it.
    pub fn all_views(&self) -> Vec<View> {
        let own = View::of_wall(self.camera);
        std::iter::once(own).chain(self.views.iter().cloned()).collect()
    }
}
