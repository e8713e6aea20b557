//! The wall on which scenes are measured: one plane screen ahead, cut into channels.

use std::path::Path;

use polyptych_wall::{ShadowFilter, Wall};

/// Half the angle that the screen fills from top to bottom, in degrees; as `configs/single.toml`.
const HALF_HEIGHT_DEGREES: f64 = 22.5;

/// Width of a pixel, in metres; without effect on what is drawn.
const PIXEL_M: f64 = 0.001;

/// Maximum time of a frame, in milliseconds: one that takes longer is an error, not a measurement.
const FRAME_TIME_MAX_MS: u32 = 60_000;

/// Maximum number of columns or rows of channels: 16 channels, of which each is still larger than
/// what one of them costs by itself.
pub(crate) const COLUMNS_MAX: u32 = 4;

/// A wall of one server.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BenchWall {
    /// Width and height of all channels together, in pixels.
    pub size: [u32; 2],
    /// A power of two; see [`grid_of`].
    pub channels: u32,
    /// Samples per pixel: 1 or 4.
    pub samples: u32,
    /// The edges of shadows.
    pub shadows: ShadowFilter,
}

/// Returns the columns and rows of so many channels: 1×1, 2×1, 2×2, 4×2 or 4×4; `None` for other
/// numbers.
pub(crate) fn grid_of(channels: u32) -> Option<[u32; 2]> {
    let doublings = channels.is_power_of_two().then(|| channels.trailing_zeros())?;
    let grid = [1 << doublings.div_ceil(2), 1 << (doublings / 2)];
    (grid[0] <= COLUMNS_MAX).then_some(grid)
}

impl BenchWall {
    /// Returns the wall. One server draws all channels, one after the other: their times add up
    /// to the work of a frame, where servers of their own would compete for one machine.
    ///
    /// # Errors
    /// A size or number of channels that no wall can have.
    pub fn to_wall(self) -> anyhow::Result<Wall> {
        let Self { size: [width, height], channels, samples, shadows } = self;
        let no_wall = |reason: String| {
            anyhow::anyhow!("{width}x{height} pixels, {channels} channels: {reason}")
        };
        let [columns, rows] = grid_of(channels).ok_or_else(|| no_wall("no such grid".into()))?;
        let [width_m, height_m] = [width, height].map(|side| f64::from(side) * PIXEL_M);
        let distance_m = height_m / 2.0 / HALF_HEIGHT_DEGREES.to_radians().tan();
        let text = format!(
            "[wall]\nname = \"bench\"\nsamples = {samples}\n\n\
             [[screen]]\nname = \"front\"\nsize = [{width_m:?}, {height_m:?}]\n\
             center = [0.0, 0.0, {:?}]\n\n\
             [screen.tiles]\ncolumns = {columns}\nrows = {rows}\npixels = [{}, {}]\n",
            -distance_m,
            width / columns,
            height / rows
        );
        let parsed = polyptych_wall_file::parse(&text, Path::new("bench.toml"));
        let mut wall = parsed.map_err(|error| no_wall(error.to_string()))?;
        for channel in &mut wall.channels {
            channel.server = "bench".into();
        }
        wall.shadows = shadows;
        wall.deadline.min_ms = FRAME_TIME_MAX_MS;
        wall.deadline.max_ms = FRAME_TIME_MAX_MS;
        wall.heartbeat_ms = FRAME_TIME_MAX_MS;
        wall.scenes.clear();
        Ok(wall)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SINGLE: BenchWall =
        BenchWall { size: [1920, 1080], channels: 1, samples: 1, shadows: ShadowFilter::Soft };

    #[test]
    fn channels_share_the_same_pixels_of_one_screen_and_one_server() {
        for channels in [1, 2, 4, 8, 16] {
            let wall = BenchWall { channels, ..SINGLE };
            let wall = wall.to_wall().expect("a wall");
            assert_eq!(wall.channels.len(), channels as usize);
            let pixels = |channel: &polyptych_wall::Channel| {
                u64::from(channel.display_size().x) * u64::from(channel.display_size().y)
            };
            assert_eq!(wall.channels.iter().map(pixels).sum::<u64>(), 1920 * 1080);
            assert!(wall.channels.iter().all(|channel| channel.server == "bench"));
        }
        for channels in [0, 3, 6, 32] {
            assert_eq!(grid_of(channels), None, "{channels}");
        }
    }

    #[test]
    fn a_wall_that_cannot_be_is_named_with_its_size() {
        let error = BenchWall { size: [100_000, 10], ..SINGLE }.to_wall();
        let said = error.expect_err("too wide").to_string();
        assert!(said.contains("100000x10"), "{said}");
    }
}
