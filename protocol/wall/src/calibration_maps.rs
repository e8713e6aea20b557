//! The decoded files of a wall, in the order of [`Wall::files`].

use std::sync::Arc;

use polyptych_files::blob::BlobHash;

use super::blend::ChannelMasks;
use super::channel_mapping::ChannelMapping;
use super::warp::{CalibrationMap, MapCoordinates, Mask, WarpGeometry, WarpMap};
use super::{CalibrationFile, CalibrationFileKind, Channel, ChannelCalibration, Surface, Wall};

/// The decoded files of a wall: each is present, valid, and of the kind that the wall states.
#[derive(Clone, Debug, Default)]
pub struct CalibrationMaps {
    files: Vec<Arc<CalibrationMap>>,
}

impl CalibrationMaps {
    /// The decoded files of this wall; `read` gives the map of a blob.
    ///
    /// # Errors
    /// The error of `read`, or that a file is of another kind, each behind the key that names the
    /// file in the wall file.
    pub fn load(
        wall: &Wall,
        mut read: impl FnMut(BlobHash) -> Result<Arc<CalibrationMap>, String>,
    ) -> Result<Self, String> {
        let load = |(index, file): (usize, &CalibrationFile)| {
            let about =
                |what: String| format!("{}: {}: {what}", wall.key_of_file(index), file.path);
            let blob = file.blob.ok_or_else(|| about("it was not baked".to_owned()))?;
            let map = read(blob).map_err(about)?;
            match mismatch(file.kind, &map) {
                None => Ok(map),
                Some(what) => Err(about(what.to_owned())),
            }
        };
        let files = wall.files.iter().enumerate().map(load).collect::<Result<_, _>>()?;
        Ok(Self { files })
    }

    /// The file of this index.
    pub fn get(&self, file: u16) -> Option<&Arc<CalibrationMap>> {
        self.files.get(usize::from(file))
    }

    /// The warp map or mesh of this index.
    pub fn warp(&self, file: u16) -> Option<&WarpMap> {
        match self.get(file)?.as_ref() {
            CalibrationMap::Warp(warp) => Some(warp),
            CalibrationMap::Mask(_) => None,
        }
    }

    /// The masks of a channel.
    pub fn masks(&self, adjustment: &ChannelCalibration) -> ChannelMasks<'_> {
        let mask = |file: Option<u16>| match self.get(file?)?.as_ref() {
            CalibrationMap::Mask(mask) => mask.texels(),
            CalibrationMap::Warp(_) => None,
        };
        ChannelMasks { alpha: mask(adjustment.alpha), beta: mask(adjustment.beta), light: None }
    }

    /// The light that a channel's warp mesh says at its corners, for each of its pixels; `None`
    /// where it is all of it. It belongs to the channel's [`masks`](Self::masks).
    pub fn mesh_light_mask(&self, channel: &Channel, pixels: &ChannelMapping<'_>) -> Option<Mask> {
        self.warp(channel.adjustment.warp?)?.light_mask(channel.size, pixels)
    }

    /// Returns the number of files.
    pub fn len(&self) -> usize {
        self.files.len()
    }

    /// Returns whether there are no files.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }
}

/// Returns the reason why a map does not suit this use, if it does not.
fn mismatch(kind: CalibrationFileKind, map: &CalibrationMap) -> Option<&'static str> {
    match (kind, map) {
        (
            CalibrationFileKind::Warp
            | CalibrationFileKind::WarpDarkZeros
            | CalibrationFileKind::WarpSgct,
            CalibrationMap::Warp(_),
        )
        | (CalibrationFileKind::Alpha | CalibrationFileKind::Beta, CalibrationMap::Mask(_)) => None,
        (CalibrationFileKind::ScreenMesh, CalibrationMap::Warp(warp)) => {
            let is_surface = matches!(warp.shape, WarpGeometry::Mesh(_));
            let is_in_room = warp.space == MapCoordinates::Display;
            (!is_surface || !is_in_room).then_some("it is no mesh of points in metres")
        }
        (CalibrationFileKind::Alpha | CalibrationFileKind::Beta, CalibrationMap::Warp(_)) => {
            Some("it is no mask")
        }
        (_, CalibrationMap::Mask(_)) => Some("it is a mask"),
    }
}

impl Wall {
    /// The key of the wall file that names the file of this index: "channel.left.warp".
    pub fn key_of_file(&self, index: usize) -> String {
        let is_it = |file: Option<u16>| file.is_some_and(|file| usize::from(file) == index);
        let of_channel = self.channels.iter().find_map(|channel| {
            let adjustment = &channel.adjustment;
            let keys =
                [("warp", adjustment.warp), ("alpha", adjustment.alpha), ("beta", adjustment.beta)];
            let (key, _) = keys.into_iter().find(|(_, file)| is_it(*file))?;
            Some(format!("channel.{}.{key}", channel.name))
        });
        let of_screen = || {
            let is_it = |surface: &Surface| matches!(surface, Surface::Mesh(f) if is_it(Some(*f)));
            let screen = self.screens.iter().find(|screen| is_it(&screen.surface))?;
            Some(format!("screen.{}.mesh", screen.name))
        };
        of_channel.or_else(of_screen).unwrap_or_else(|| format!("file {index}"))
    }

    /// Blobs that servers need of a wall, beside those of its scene.
    pub fn blobs(&self) -> impl Iterator<Item = BlobHash> + '_ {
        self.files.iter().filter_map(|file| file.blob)
    }
}

#[cfg(test)]
mod tests {
    use glam::{UVec2, Vec3};

    use super::super::Screen;
    use super::super::warp::WarpGrid;
    use super::*;

    fn warp() -> CalibrationMap {
        let grid = WarpGrid::new(UVec2::ONE, vec![Vec3::ZERO]);
        CalibrationMap::Warp(WarpMap {
            space: MapCoordinates::Canvas,
            shape: WarpGeometry::Grid(grid),
        })
    }

    fn mask() -> CalibrationMap {
        CalibrationMap::Mask(Mask { size: UVec2::ONE, components: 1, texels: vec![7] })
    }

    fn wall(kind: CalibrationFileKind) -> Wall {
        let mut channel = Channel::tile("left", 0, UVec2::ZERO, UVec2::ONE);
        let mut wall = Wall::new("w", Vec::new(), Vec::new());
        let mut surface = Surface::Mesh(0);
        match kind {
            CalibrationFileKind::Warp
            | CalibrationFileKind::WarpDarkZeros
            | CalibrationFileKind::WarpSgct => {
                channel.adjustment.warp = Some(0);
            }
            CalibrationFileKind::Alpha => channel.adjustment.alpha = Some(0),
            CalibrationFileKind::Beta => channel.adjustment.beta = Some(0),
            CalibrationFileKind::ScreenMesh => {}
        }
        if kind != CalibrationFileKind::ScreenMesh {
            surface = Surface::Mesh(9);
        }
        wall.screens.push(Screen::new("hill", surface, UVec2::ONE));
        wall.channels.push(channel);
        wall.files.push(CalibrationFile {
            path: "x".into(),
            kind,
            blob: Some(BlobHash([3; 32])),
            is_for_one_eye: false,
            front: Vec::new(),
        });
        wall
    }

    #[test]
    fn a_file_is_what_the_wall_says_or_is_refused_by_its_key() {
        let load = |kind, map: CalibrationMap| {
            CalibrationMaps::load(&wall(kind), |_| Ok(Arc::new(map.clone())))
        };
        let maps = load(CalibrationFileKind::Warp, warp()).expect("a warp");
        assert_eq!((maps.len(), maps.warp(0), maps.warp(1)), (1, maps.warp(0), None));
        assert!(maps.warp(0).is_some());
        let maps = load(CalibrationFileKind::Beta, mask()).expect("a mask");
        let masks = maps.masks(&wall(CalibrationFileKind::Beta).channels[0].adjustment);
        assert!(masks.beta.is_some() && masks.alpha.is_none());
        let refused = |kind, map| load(kind, map).expect_err("refused");
        assert_eq!(
            refused(CalibrationFileKind::Warp, mask()),
            "channel.left.warp: x: it is a mask"
        );
        assert_eq!(
            refused(CalibrationFileKind::Alpha, warp()),
            "channel.left.alpha: x: it is no mask"
        );
        assert_eq!(
            refused(CalibrationFileKind::Beta, warp()),
            "channel.left.beta: x: it is no mask"
        );
        let line = refused(CalibrationFileKind::ScreenMesh, warp());
        assert_eq!(line, "screen.hill.mesh: x: it is no mesh of points in metres");
    }

    #[test]
    fn a_file_that_was_not_baked_is_refused() {
        let mut wall = wall(CalibrationFileKind::Warp);
        assert_eq!(wall.blobs().collect::<Vec<_>>(), [BlobHash([3; 32])]);
        wall.files[0].blob = None;
        let line = CalibrationMaps::load(&wall, |_| Ok(Arc::new(warp()))).expect_err("refused");
        assert_eq!(line, "channel.left.warp: x: it was not baked");
        assert_eq!(wall.blobs().count(), 0);
    }
}
