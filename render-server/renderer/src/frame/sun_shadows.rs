//! The maps of directional lights: all channels that show a scene from one place have the same.

use glam::Vec3;

use super::shadow_map::ShadowMap;
use crate::scene::{Bounds, GpuScene};
use crate::shadow_cascades::{CASCADES_MAX, Cascade};
use crate::view::ViewDesc;

/// Maximum number of maps of suns for one camera: 256 MiB on the GPU. A scene with three or four
/// suns has fewer for each.
const SHADOW_MAPS_MAX: usize = 16;

/// The maps of each directional light of a view: the layer of the widest one and all of them,
/// widest first; `None` of one that casts no shadow.
#[derive(Debug)]
pub(super) struct SunMaps(pub Vec<Option<(u32, Vec<Cascade>)>>);

impl SunMaps {
    /// The maps of a view of a scene with this extent; `None` if there are none.
    pub fn new(scene: &GpuScene, view: &ViewDesc, extent: &Bounds) -> Option<Self> {
        let part = scene.part(&view.subset);
        let suns = scene.suns();
        let casts: Vec<bool> = suns
            .iter()
            .map(|sun| sun.casts_shadows && sun.on.color_in(sun.irradiance, part) != Vec3::ZERO)
            .collect();
        let count = casts.iter().filter(|casts| **casts).count();
        if count == 0 {
            return None;
        }
        let each_max = CASCADES_MAX.min(SHADOW_MAPS_MAX / count);
        let mut base = 0;
        let maps = suns.iter().zip(&casts).map(|(sun, casts)| {
            let cascades = casts
                .then(|| Cascade::all(sun.toward.as_dvec3(), extent, view, each_max))
                .filter(|cascades| !cascades.is_empty())?;
            let first = base;
            base += cascades.len() as u32;
            Some((first, cascades))
        });
        let maps = maps.collect();
        (base > 0).then_some(Self(maps))
    }

    /// All maps, by layer.
    pub fn by_layer(&self) -> Vec<ShadowMap> {
        let cascades = self.0.iter().flatten().flat_map(|(_, cascades)| cascades);
        cascades.map(|cascade| ShadowMap::Sun(*cascade)).collect()
    }
}
