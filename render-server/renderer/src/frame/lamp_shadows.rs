//! The maps of point and spot lights, and what shaders read of them.

use polyptych_scene::lamps_with_maps;
use polyptych_wall::ShadowFilter;

use super::shadow_map::ShadowMap;
use crate::lamp_map::{LampMap, LampShadowRecord, side_of};
use crate::scene::{Bounds, GpuScene};
use crate::view::ViewDesc;

/// The maps of the lamps of a view.
#[derive(Debug)]
pub(super) struct LampMaps {
    /// By layer.
    pub maps: Vec<ShadowMap>,
    /// Texels along each side of each.
    pub side: u32,
    /// By lamp.
    pub records: Vec<LampShadowRecord>,
}

impl LampMaps {
    /// The maps of a view of a scene with this extent; `None` if there are none. They are those of
    /// the lights that shine in the part of the scene that the view shows.
    pub fn new(
        scene: &GpuScene,
        view: &ViewDesc,
        extent: &Bounds,
        filter: ShadowFilter,
    ) -> Option<Self> {
        let part = scene.part(&view.subset);
        let lamps = scene.lamps();
        let wanted: Vec<_> = lamps
            .iter()
            .map(|lamp| {
                let brightness = lamp.on.color_in(lamp.intensity, part).max_element();
                (if brightness > 0.0 { lamp.map_count } else { 0 }, brightness)
            })
            .collect();
        let has_maps = lamps_with_maps(&wanted);
        let count = wanted.iter().zip(&has_maps).filter(|(_, has)| **has).map(|(of, _)| of.0).sum();
        let side = side_of(count);
        let mut maps = Vec::with_capacity(count);
        let records = lamps.iter().zip(&has_maps).map(|(lamp, has_maps)| {
            let own = if *has_maps { LampMap::all(lamp, extent, side, filter) } else { vec![] };
            let record = LampShadowRecord::new(maps.len() as u32, &own);
            maps.extend(own.into_iter().map(ShadowMap::Lamp));
            record
        });
        let records = records.collect();
        (!maps.is_empty()).then_some(Self { maps, side, records })
    }
}
