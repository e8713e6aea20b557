//! Screens and channels from damaged but sound maps of walls: their points are valid or missing.

use std::sync::Arc;

use polyptych_files::blob::BlobHash;
use polyptych_wall::blend::{ChannelMasks, blend_map};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::light_composite::{DisplayImage, LightComposite, StereoEye};
use polyptych_wall::wall_geometry::{ResolvedWall, WallGeometry};
use polyptych_wall::warp::{CalibrationMap, Mask};
use polyptych_wall::{CalibrationFile, CalibrationFileKind, ChannelId, ChannelKind};

const WALL: &str = r#"
[wall]
name = "w"
[[screen]]
name = "s"
size = [4.0, 2.0]
center = [0.0, 0.0, -2.0]
pixels = [64, 32]
[[screen.channel]]
name = "a"
origin = [0, 0]
pixels = [40, 32]
[[screen.channel]]
name = "b"
origin = [24, 0]
pixels = [40, 32]
"#;

/// Lets one of two channels lie where the map says, and counts the pixels of the screen that it
/// lights; `None` of a mask.
pub fn lit(map: &CalibrationMap) -> Option<usize> {
    let mut wall = polyptych_wall_file::parse(WALL, "w.toml".as_ref()).expect("a wall");
    let CalibrationMap::Warp(warp) = map else { return None };
    let (path, blob, front) = ("x".to_owned(), Some(BlobHash([0; 32])), warp.surface_samples());
    wall.files.push(CalibrationFile {
        path,
        kind: CalibrationFileKind::Warp,
        blob,
        is_for_one_eye: false,
        front,
    });
    wall.channels[1].cover = ChannelKind::Map;
    wall.channels[1].adjustment.warp = Some(0);
    assert_eq!(wall.fault(), None, "what its file says of its front is sound");
    let maps = CalibrationMaps::load(&wall, |_| Ok(Arc::new(map.clone()))).expect("a warp");
    let shapes = WallGeometry::new(&wall, &maps);
    let shaped = ResolvedWall { wall: &wall, shapes: &shapes };
    let pixels = shaped.channel_mapping(ChannelId(1)).expect("no pins");
    let light = maps.mesh_light_mask(&wall.channels[1], &pixels);
    let masks =
        ChannelMasks { light: light.as_ref().and_then(Mask::texels), ..ChannelMasks::default() };
    for (id, masks) in [(ChannelId(0), ChannelMasks::default()), (ChannelId(1), masks)] {
        let Some(map) = blend_map(shaped, id, &masks) else { continue };
        let all = (0..32).flat_map(|y| (0..40).map(move |x| (x, y)));
        let is_share = |light: f64| (0.0..=1.0).contains(&light);
        assert!(all.into_iter().all(|(x, y)| is_share(map.texel(x, y, 0)[0])));
    }
    let rgba = vec![255; 4 * 40 * 32];
    let picture = [DisplayImage { channel: ChannelId(1), rgba: &rgba }];
    let shown = LightComposite::new(shaped, 0, StereoEye::Left, &picture);
    let rows = (0..32).flat_map(|y| shown.row(y));
    Some(rows.flatten().filter(|light| light.is_finite()).count())
}
