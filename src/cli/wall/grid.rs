//! `polyptych wall grid`: displays in columns and rows on one plane.

use std::fmt::Write;

use super::{Common, drawing, gaps, head, metres, pixels, round};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many side by side
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1024))]
    columns: u32,
    /// How many above each other
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1024))]
    rows: u32,
    /// Pixels of each
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1920x1080")]
    pixels: [u32; 2],
    /// How wide each is, in metres; pixels are square
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "1.2")]
    width: f64,
    /// From the eye to the plane, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "2.5")]
    distance: f64,
    /// Gaps between displays in metres, behind which the picture goes on
    #[arg(long, value_name = "AxD", value_parser = gaps, conflicts_with = "overlap")]
    bezel: Option<[f64; 2]>,
    /// Pixels that neighbours share, for projectors that blend
    #[arg(long, value_name = "AxD", value_parser = pixels)]
    overlap: Option<[u32; 2]>,
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        let Self { columns, rows, pixels, .. } = *self;
        let pitch = self.width / f64::from(pixels[0].max(1));
        let counts = [columns, rows].map(f64::from);
        let [bezel, overlap] =
            [self.bezel.unwrap_or_default(), self.overlap.unwrap_or_default().map(f64::from)];
        let side = |axis: usize| {
            let between = counts[axis] - 1.0;
            let lit = counts[axis] * f64::from(pixels[axis]) - between * overlap[axis];
            round(lit * pitch + between * bezel[axis])
        };
        let mut comments = vec![format!(
            "{columns} x {rows} displays of {} x {} pixels and {:.3} m width on one plane.",
            pixels[0], pixels[1], self.width
        )];
        comments.push(String::new());
        comments.extend(drawing(columns, rows));
        let mut text = head(&self.common, "grid", &comments, [0.0, self.common.eye_height, 0.0]);
        write!(
            text,
            "[[screen]]\nname = \"front\"\nsize = [{:?}, {:?}]   # metres\n\
             center = [0.0, {:?}, {:?}]\n\n[screen.tiles]\ncolumns = {columns}\nrows = {rows}\n\
             pixels = [{}, {}]\n",
            side(0),
            side(1),
            round(self.common.eye_height),
            round(-self.distance),
            pixels[0],
            pixels[1]
        )?;
        if let Some([across, down]) = self.bezel {
            writeln!(text, "bezel = [{across:?}, {down:?}]   # metres")?;
        }
        if let Some([across, down]) = self.overlap {
            writeln!(text, "overlap = [{across}, {down}]   # pixels")?;
        }
        Ok(text)
    }
}
