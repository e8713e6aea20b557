//! `polyptych wall cave`: the walls of a room.

use std::fmt::Write;

use super::{Common, head, metres, pixels, round};

/// The walls in the order in which they are built: three make a room, and so on.
const NAMES: [&str; 6] = ["left", "front", "right", "floor", "ceiling", "back"];

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many walls: left, front, right, floor, ceiling, back
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=6))]
    walls: u32,
    /// How wide and deep the room is, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "3")]
    size: f64,
    /// Pixels of an upright wall; they are square
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1080x1080")]
    pixels: [u32; 2],
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        let [width_px, height_px] = self.pixels;
        let half = self.size / 2.0;
        let height = self.size * f64::from(height_px) / f64::from(width_px.max(1));
        let comments = [
            format!("{} walls of a room of {:.3} m, {height:.3} m high.", self.walls, self.size),
            String::new(),
            "  seen from above    folded out, as the viewer sees them".to_owned(),
            String::new(),
            "   +-- front --+     +------+-------+-------+".to_owned(),
            "   |    -z     |     | left | front | right |".to_owned(),
            " left    |   right   +------+-------+-------+".to_owned(),
            "   |    eye    |            | floor |".to_owned(),
            "   +-----------+            +-------+".to_owned(),
        ];
        let eye = [0.0, self.common.eye_height, 0.0];
        let mut text = head(&self.common, "cave", &comments, eye);
        // Lower left, lower right and upper left corner, as the viewer sees them.
        let corners = [
            [[-half, 0.0, half], [-half, 0.0, -half], [-half, height, half]],
            [[-half, 0.0, -half], [half, 0.0, -half], [-half, height, -half]],
            [[half, 0.0, -half], [half, 0.0, half], [half, height, -half]],
            [[-half, 0.0, half], [half, 0.0, half], [-half, 0.0, -half]],
            [[-half, height, -half], [half, height, -half], [-half, height, half]],
            [[half, 0.0, half], [-half, 0.0, half], [half, height, half]],
        ];
        for (name, corners) in NAMES.into_iter().zip(corners).take(self.walls as usize) {
            writeln!(text, "[[screen]]\nname = {name:?}")?;
            for (key, corner) in ["lower_left", "lower_right", "upper_left"].iter().zip(corners) {
                writeln!(text, "{key} = {:?}", corner.map(round))?;
            }
            let is_flat = matches!(name, "floor" | "ceiling");
            let height_px = if is_flat { width_px } else { height_px };
            writeln!(text, "tiles.pixels = [{width_px}, {height_px}]\n")?;
        }
        Ok(text)
    }
}
