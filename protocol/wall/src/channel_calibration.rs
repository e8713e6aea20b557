//! Corrections of a channel's picture for its display: form, light and colour.
//!
//! A display's pixel is corrected in this order: packed eyes apart, turn and mirror undone (the
//! *upright* picture), corner pins and bends undone (the channel's pixel), then its light: colour
//! matrix and gains, blend weight and masks, curve, dither.

use std::ops::Deref;
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, UVec2};
use serde::{Deserialize, Serialize};

use crate::limits::{BEND_POINTS_MAX, CURVE_POINTS_MAX, LEAK_MAX};

/// The differences of a channel from a tile that is shown as it is drawn. The default is none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChannelCalibration {
    /// The orientation of the display.
    pub turn: Orientation,
    /// Left and right are exchanged, as for projection from behind, before it is turned.
    pub mirror: bool,
    /// The eye that it is for.
    pub eye: Eye,
    /// The layout of both eyes' pictures on one display.
    pub packing: StereoPacking,
    /// By how many pixels, x right and y down, the corners are moved: upper left, upper right,
    /// lower left, lower right. The picture follows by the homography of the four.
    pub pin: [DVec2; 4],
    /// A grid of points that are moved, after the pins.
    pub bend: Option<ControlGrid>,
    /// The widths of its blends.
    pub edges: BlendWidths,
    /// The source of its ramps where others light the same places.
    pub ramps: Ramps,
    /// Its light.
    pub color: ColorCorrection,
    /// An index into [`Wall::files`](super::Wall::files): where each of its pixels lies.
    pub warp: Option<u16>,
    /// An index into [`Wall::files`](super::Wall::files): multiplies its light.
    pub alpha: Option<u16>,
    /// An index into [`Wall::files`](super::Wall::files): its least light.
    pub beta: Option<u16>,
    /// The bit depth of its display.
    pub bits: BitDepth,
}

/// How a display hangs: by which turn its upper side went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Orientation {
    /// Upright.
    #[default]
    None,
    /// Its upper side is at the viewer's left.
    Left,
    /// Its upper side is at the viewer's right.
    Right,
    /// It hangs upside down.
    Half,
}

impl Orientation {
    /// Returns the size of a picture of this width and height once it is turned.
    pub fn turned(self, size: UVec2) -> UVec2 {
        match self {
            Self::None | Self::Half => size,
            Self::Left | Self::Right => UVec2::new(size.y, size.x),
        }
    }
}

/// Who says how a channel's light fades where others light the same places.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Ramps {
    /// The geometry of all of them. A channel that a warp file places and that has an alpha file or
    /// light at its mesh's corners, but no widths of edges, goes by its files.
    #[default]
    Computed,
    /// Its alpha file alone; nothing is computed for it, and others share no light with it.
    Alpha,
}

/// Bits of each of a display's red, green and blue codes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BitDepth {
    /// 256 codes.
    #[default]
    Eight,
    /// 1,024 codes, where the display takes them; 256 where not.
    Ten,
}

/// Whose eye a channel is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Eye {
    /// The middle of both.
    #[default]
    Center,
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// How the pictures of both eyes share one display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StereoPacking {
    /// There is one picture.
    #[default]
    None,
    /// The left eye's picture in the left half of the display's own pixels, however it hangs: the
    /// display takes them apart there.
    SideBySide,
    /// The left eye's picture in the upper half of the display's own pixels, however it hangs.
    TopBottom,
    /// Red of the left eye's, green and blue of the right eye's.
    Anaglyph,
}

impl StereoPacking {
    /// Returns the number of eyes whose pictures share the display: 1 or 2.
    pub fn eyes(self) -> usize {
        if self == Self::None { 1 } else { 2 }
    }

    /// Returns how many pictures lie beside each other, and how many above each other.
    pub fn parts(self) -> UVec2 {
        match self {
            Self::None | Self::Anaglyph => UVec2::ONE,
            Self::SideBySide => UVec2::new(2, 1),
            Self::TopBottom => UVec2::new(1, 2),
        }
    }
}

/// A grid of control points over the channel's picture, moved by pixels; between them the move is
/// a Catmull-Rom spline's, which passes through each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlGrid {
    /// Points across and down, from edge to edge; 2 or more each.
    pub points: UVec2,
    /// By how many pixels each is moved, row by row from the upper left.
    pub moves: Moves,
}

/// The moves of a bend's points. Copies share them until one is changed, and compare at once: the
/// manager copies a wall for every point that is dragged.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(from = "Vec<DVec2>", into = "Vec<DVec2>")]
pub struct Moves(Arc<Vec<DVec2>>);

impl Moves {
    /// The moves, to be changed.
    pub fn make_mut(&mut self) -> &mut [DVec2] {
        Arc::<Vec<DVec2>>::make_mut(&mut self.0)
    }
}

impl Deref for Moves {
    type Target = [DVec2];

    fn deref(&self) -> &[DVec2] {
        &self.0
    }
}

impl From<Vec<DVec2>> for Moves {
    fn from(moves: Vec<DVec2>) -> Self {
        Self(Arc::new(moves))
    }
}

impl FromIterator<DVec2> for Moves {
    fn from_iter<I: IntoIterator<Item = DVec2>>(moves: I) -> Self {
        Vec::from_iter(moves).into()
    }
}

impl From<Moves> for Vec<DVec2> {
    fn from(moves: Moves) -> Self {
        moves.to_vec()
    }
}

impl PartialEq for Moves {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.0 == other.0
    }
}

/// The widths of the ramps at a channel's edges, in its pixels; `None`: the width of the overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BlendWidths {
    /// At the left edge.
    pub left: Option<f64>,
    /// At the right edge.
    pub right: Option<f64>,
    /// At the upper edge.
    pub top: Option<f64>,
    /// At the lower edge.
    pub bottom: Option<f64>,
}

/// The correction of a channel's light before it becomes codes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorCorrection {
    /// Linear light is multiplied by it first.
    pub matrix: DMat3,
    /// Then red, green and blue by these.
    pub gain: DVec3,
    /// The display's transfer function from codes to light.
    pub curve: TransferFunction,
    /// The display's black level, as a share of its white, in its red, green and blue; `None`: that
    /// of the wall's projectors ([`BlendConfig::leak`](super::BlendConfig)).
    pub leak: Option<DVec3>,
}

/// The transfer function of a display from codes to light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum TransferFunction {
    /// IEC 61966-2-1.
    #[default]
    Srgb,
    /// code^γ, of red, green and blue.
    Gamma(DVec3),
    /// Measured light of equally spaced codes from 0 to 1; rising from 0 to 1.
    Measured(Vec<DVec3>),
}

impl Default for ColorCorrection {
    fn default() -> Self {
        Self {
            matrix: DMat3::IDENTITY,
            gain: DVec3::ONE,
            curve: TransferFunction::Srgb,
            leak: None,
        }
    }
}

impl ChannelCalibration {
    /// Returns whether the picture is shown as it was drawn, except for light that others share.
    pub fn is_identity(&self) -> bool {
        *self == Self { eye: self.eye, edges: self.edges, ..Self::default() }
    }

    /// The display's own width and height, for an upright picture of this size.
    pub fn display_size(&self, upright: UVec2) -> UVec2 {
        self.turn.turned(upright) * self.packing.parts()
    }

    /// Returns the size of the upright picture for a display of this width and height: the inverse
    /// of [`Self::display_size`]. `None` if two pictures would have to share an odd side.
    pub fn upright_size(&self, display: UVec2) -> Option<UVec2> {
        let parts = self.packing.parts();
        (display % parts == UVec2::ZERO).then(|| self.turn.turned(display / parts))
    }

    /// Returns the fault of numbers that came over the wire, if any.
    pub(super) fn fault(&self, file_count: usize) -> Option<String> {
        let files = [self.warp, self.alpha, self.beta];
        if files.into_iter().flatten().any(|index| usize::from(index) >= file_count) {
            return Some("it names a file that the wall does not have".into());
        }
        if !self.pin.iter().all(|pin| pin.is_finite()) {
            return Some("a corner pin is not finite".into());
        }
        if let Some(bend) = &self.bend {
            let count = u64::from(bend.points.x) * u64::from(bend.points.y);
            if bend.points.min_element() < 2
                || count > BEND_POINTS_MAX as u64
                || count != bend.moves.len() as u64
                || !bend.moves.iter().all(|offset| offset.is_finite())
            {
                return Some("its bend is no grid of finite numbers".into());
            }
        }
        if self.ramps == Ramps::Alpha && self.alpha.is_none() {
            return Some("its alpha file is to say how its light fades, and there is none".into());
        }
        let edges = [self.edges.left, self.edges.right, self.edges.top, self.edges.bottom];
        if edges.into_iter().flatten().any(|edge| !(edge.is_finite() && edge >= 0.0)) {
            return Some("the width of a blend is no number from 0".into());
        }
        if self.ramps == Ramps::Alpha && edges.iter().any(Option::is_some) {
            return Some(
                "how its light fades is given twice, by edges and by its alpha file".into(),
            );
        }
        self.color.fault()
    }
}

impl ColorCorrection {
    fn fault(&self) -> Option<String> {
        let is_light = |light: DVec3| light.is_finite() && light.cmpge(DVec3::ZERO).all();
        if !(self.matrix.is_finite() && is_light(self.gain)) {
            return Some("its colour matrix or gain is out of range".into());
        }
        let is_share = |leak: &DVec3| is_light(*leak) && leak.cmple(DVec3::splat(LEAK_MAX)).all();
        if let Some(leak) = self.leak.filter(|leak| !is_share(leak)) {
            return Some(format!("a leak of {leak}, where 0 to {LEAK_MAX} can be"));
        }
        match &self.curve {
            TransferFunction::Srgb => None,
            TransferFunction::Gamma(gamma) => (!gamma.is_finite()
                || gamma.cmple(DVec3::ZERO).any())
            .then(|| format!("a gamma of {gamma}, where numbers above 0 can be")),
            TransferFunction::Measured(light) => {
                let rises = light.windows(2).all(|pair| pair[0].cmple(pair[1]).all());
                let ends = (light.first(), light.last()) == (Some(&DVec3::ZERO), Some(&DVec3::ONE));
                let is_good = (2..=CURVE_POINTS_MAX).contains(&light.len()) && rises && ends;
                (!is_good).then(|| "its curve does not rise from 0 to 1".into())
            }
        }
    }
}
