//! The mesh that a server draws a channel with, or the reason why it cannot: the same for checking
//! a wall beforehand and for drawing it.

use glam::DVec3;

use super::calibration_maps::CalibrationMaps;
use super::view_atlas::{AtlasError, ViewAtlas};
use super::wall_geometry::ResolvedWall;
use super::warp_mesh::WarpMesh;
use super::{ChannelKind, Surface};
use crate::ChannelId;
use crate::limits::CHANNEL_SIDE_MAX;

impl ResolvedWall<'_> {
    /// The mesh that a channel is drawn through, with its pins and bends: nothing of it lies
    /// beside the channel's picture, and nothing of a projector's beside its screen.
    ///
    /// # Errors
    /// The reason why nothing of the channel can be drawn.
    pub fn drawn_mesh(&self, maps: &CalibrationMaps, id: ChannelId) -> Result<WarpMesh, String> {
        let map = self.channel_mapping(id).ok_or("its corner pins leave no picture")?;
        let channel = self.wall.channel(id).ok_or("the wall has no such channel")?;
        let screen = self.wall.screen_of(channel);
        let ground = self.shapes.screen(screen);
        let mesh = match (channel.adjustment.warp, &screen.surface) {
            (Some(file), _) => {
                let warp = maps.warp(file).ok_or("its warp file is not there")?;
                warp.channel_mesh(channel, &ground, &map)
            }
            (None, Surface::Mesh(file)) if channel.cover == ChannelKind::Tile => {
                let surface = maps.warp(*file).ok_or("its screen's file is not there")?;
                surface.screen_mesh(channel, &ground, &map)
            }
            _ => map.drawn_mesh(),
        };
        if mesh.triangles.is_empty() {
            return Err("none of its pixels lies on its screen".to_owned());
        }
        let has_area = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| mesh.vertices[corner as usize].point);
            (b - a).cross(c - a) != DVec3::ZERO
        };
        if !mesh.triangles.iter().any(has_area) {
            return Err("its pixels lie on a point or a line".to_owned());
        }
        Ok(mesh)
    }

    /// Checks that servers can draw every channel that files place. The files must be the wall's.
    ///
    /// # Errors
    /// The key that names the file of the first channel that cannot be drawn, the file, the reason
    /// and the fix.
    pub fn check_files(&self, maps: &CalibrationMaps) -> Result<(), String> {
        let wall = self.wall;
        for (id, channel) in wall.channel_ids().zip(&wall.channels) {
            let file = match (channel.adjustment.warp, &wall.screen_of(channel).surface) {
                (Some(file), _) | (None, &Surface::Mesh(file)) => usize::from(file),
                _ => continue,
            };
            let about = |why: String, remedy: &str| {
                let key = wall.key_of_file(file);
                let path = wall.files.get(file).map_or("", |file| &file.path);
                format!("{key}: {path}: channel {} cannot be drawn: {why}; {remedy}", channel.name)
            };
            let units = "check the units, the origin and the places of the file, pins and bends";
            let mesh = self.drawn_mesh(maps, id).map_err(|why| about(why, units))?;
            let eyes = wall.viewpoints(channel);
            let plan = ViewAtlas::new(&mesh, &eyes, wall.near_m, CHANNEL_SIDE_MAX);
            plan.map_err(|error| {
                let remedy = match error {
                    AtlasError::EyeOnSurface { .. } => {
                        "move wall.eye; if pixels at (0, 0, 0) are meant to be dark, write \
                         warp_zero = \"dark\" or NaN"
                    }
                    AtlasError::EyeBehind { .. } => "move wall.eye, or mend the file",
                    AtlasError::Nothing | AtlasError::Coarse(_) => units,
                };
                about(error.to_string(), remedy)
            })?;
        }
        Ok(())
    }
}
