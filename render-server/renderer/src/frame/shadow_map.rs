//! A map of shadows: all that its depths depend on, but for the scene.

use glam::{DAffine3, DVec3};

use crate::draw_list::{ShadowItems, VisibleItems};
use crate::error_tolerance::ErrorTolerance;
use crate::lamp_map::LampMap;
use crate::scene::GpuScene;
use crate::shadow_cascades::Cascade;
use crate::view::ViewDesc;

/// A map: all that its depths depend on, but for the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ShadowMap {
    Sun(Cascade),
    Lamp(LampMap),
}

impl ShadowMap {
    /// The view that draws the map, of what a camera shows.
    pub fn view(&self, camera: &ViewDesc) -> ViewDesc {
        match self {
            Self::Sun(cascade) => cascade.view(camera),
            Self::Lamp(map) => map.view(camera),
        }
    }

    /// A sphere around all places that the map is for, in world space.
    fn receivers(&self) -> (DVec3, f64) {
        match self {
            Self::Sun(cascade) => cascade.around,
            Self::Lamp(map) => map.reached(),
        }
    }

    /// Finds those of these items that it has, with the turns of billboards; returns also whether
    /// any of these items receives shadows from it.
    pub fn casting(
        &self,
        scene: &GpuScene,
        camera: &ViewDesc,
        (of, turns): (ShadowItems, &[DAffine3]),
    ) -> (VisibleItems, bool) {
        let (light, receivers) = (self.view(camera), self.receivers());
        let (tolerance, turns) = (ErrorTolerance::new(&light), turns.to_vec());
        let (mut casting, receives) =
            VisibleItems::casting(scene, (&light, of), (tolerance, turns), receivers);
        if let Self::Lamp(map) = self {
            casting.keep_casting(scene, map);
        }
        (casting, receives)
    }
}
