//! The passes of a frame, and how long the GPU takes for each.

use serde::{Deserialize, Serialize};

/// A part of a frame that the GPU draws; it exists only where the scene or an effect needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FramePass {
    /// The search for what others hide.
    HiddenItems,
    /// The maps of what suns and lamps reach that were drawn anew.
    Shadows,
    /// The search for ambient occlusion, with its depths.
    AmbientOcclusion,
    /// Depth of field, with its picture.
    DepthOfField,
    /// The pictures of what is behind glass.
    Glass,
    /// The light that spreads as glow, with its picture.
    Glow,
    /// The scene itself.
    Scene,
    /// Tone mapping of a scene that is drawn as light.
    ToneMapping,
    /// Warp, blend and colours of the display.
    Correction,
}

impl FramePass {
    /// All of them, in the order in which they are drawn.
    pub const ALL: [Self; 9] = [
        Self::HiddenItems,
        Self::Shadows,
        Self::AmbientOcclusion,
        Self::DepthOfField,
        Self::Glass,
        Self::Glow,
        Self::Scene,
        Self::ToneMapping,
        Self::Correction,
    ];

    /// Its name as people read it.
    pub fn name(self) -> &'static str {
        match self {
            Self::HiddenItems => "hidden items",
            Self::Shadows => "shadows",
            Self::AmbientOcclusion => "ambient occlusion",
            Self::DepthOfField => "depth of field",
            Self::Glass => "behind glass",
            Self::Glow => "glow",
            Self::Scene => "scene",
            Self::ToneMapping => "tone mapping",
            Self::Correction => "warp and blend",
        }
    }
}

/// The microseconds that the GPU took for each pass of a frame: 0 for those that the frame does not
/// have. All are 0 where they were not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PassTimes([u32; FramePass::ALL.len()]);

impl PassTimes {
    /// Returns whether they were measured.
    pub fn is_measured(&self) -> bool {
        self.0.iter().any(|us| *us > 0)
    }

    /// Adds microseconds to a pass.
    pub fn add(&mut self, pass: FramePass, us: u64) {
        let own = &mut self.0[pass as usize];
        *own = own.saturating_add(u32::try_from(us).unwrap_or(u32::MAX));
    }

    /// Adds microseconds to a pass, at least one, if the others were measured.
    pub fn add_if_measured(&mut self, pass: FramePass, us: u64) {
        if self.is_measured() {
            self.add(pass, us.max(1));
        }
    }

    /// Those of both, one after the other.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        for (pass, us) in other.iter() {
            self.add(pass, u64::from(us));
        }
        self
    }

    /// Each pass with its microseconds.
    pub fn iter(&self) -> impl Iterator<Item = (FramePass, u32)> {
        FramePass::ALL.into_iter().zip(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_a_pass_are_added_up_and_stay_its_own() {
        let mut times = PassTimes::default();
        times.add_if_measured(FramePass::Correction, 5);
        assert!(!times.is_measured());
        times.add(FramePass::Scene, 5);
        times.add(FramePass::Scene, u64::MAX);
        let mut other = PassTimes::default();
        other.add(FramePass::Correction, 7);
        let both: Vec<_> = times.and(other).iter().filter(|(_, us)| *us > 0).collect();
        assert_eq!(both, [(FramePass::Scene, u32::MAX), (FramePass::Correction, 7)]);
        for (at, (pass, _)) in times.iter().enumerate() {
            assert_eq!(pass as usize, at);
        }
    }
}
