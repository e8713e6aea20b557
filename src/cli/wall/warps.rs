//! `polyptych wall fisheye`, `equirectangular`, `mirror` and `cube-map`: warp makers, whose wall
//! file stands in a folder with the maps that it needs.

use std::path::PathBuf;

use anyhow::bail;
use glam::{DVec2, DVec3};
use polyptych_text::counted;
use polyptych_wall::limits::CHANNEL_SIDE_MAX;

use super::super::say;
use super::made::{Made, MadeScreen, Shape};
use super::optics::{Ball, Fisheye, MirrorDome, cube_faces, places};
use super::{metres, pixels};

/// Points of the dome's light that are told to be few: a mirror that is hardly met.
const LIT_SHARE_MIN: f64 = 0.05;

/// What all of them have.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Folder {
    /// What to call the wall
    #[arg(long)]
    name: Option<String>,
    /// Where the viewer's eye is, in metres: x right, y up, the viewer looks along -z
    #[arg(long, value_name = "X,Y,Z", value_parser = point, default_value = "0,1.6,0",
          allow_hyphen_values = true)]
    eye: DVec3,
    /// The folder for wall.toml and the maps; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace a wall.toml and maps that are there
    #[arg(long)]
    force: bool,
}

/// A lens of one projector in the middle of a dome, or a dome master
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct FisheyeArguments {
    #[command(flatten)]
    folder: Folder,
    /// Pixels of the picture; its circle is as large as fits
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "2048x2048")]
    pixels: [u32; 2],
    /// The angle across the circle, in degrees, up to 360
    #[arg(long, value_name = "DEGREES", default_value_t = 180.0)]
    degrees: f64,
    /// How far the dome is tilted forward: at 0 the zenith is in the middle of the circle and what
    /// is ahead at its bottom, at 90 what is ahead is in the middle
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    tilt: f64,
    /// The dome's radius in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "5")]
    radius: f64,
    /// Where the eye is, from the middle of the dome, in metres
    #[arg(long, value_name = "X,Y,Z", value_parser = point, default_value = "0,0,0",
          allow_hyphen_values = true)]
    offset: DVec3,
}

/// A picture of all directions: longitude across, latitude up
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct EquirectangularArguments {
    #[command(flatten)]
    folder: Folder,
    /// Pixels of the picture
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "4096x2048")]
    pixels: [u32; 2],
    /// Which way its middle looks, in degrees to the right
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    yaw: f64,
    /// How far away what it shows is meant to be, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "5")]
    radius: f64,
}

/// Six pictures of 90 degrees each
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct CubeMapArguments {
    #[command(flatten)]
    folder: Folder,
    /// Pixels of a face, which is square
    #[arg(long, value_name = "PIXELS", default_value_t = 1024,
          value_parser = clap::value_parser!(u32).range(1..=CHANNEL_SIDE_MAX as i64))]
    side: u32,
    /// From the eye to the middle of a face, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "1")]
    distance: f64,
}

/// A projector that lights a dome over a spherical mirror
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct MirrorArguments {
    #[command(flatten)]
    folder: Folder,
    /// Pixels of the projector; they are square
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1920x1080")]
    pixels: [u32; 2],
    /// The dome's middle in metres [default: the eye]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    dome: Option<DVec3>,
    /// The dome's radius in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "5")]
    radius: f64,
    /// How far the dome is tilted forward, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    tilt: f64,
    /// The mirror's middle in metres, from the dome's
    #[arg(long, value_name = "X,Y,Z", value_parser = point, default_value = "0,-0.2,4.6",
          allow_hyphen_values = true)]
    mirror: DVec3,
    /// The mirror's radius in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "0.3")]
    mirror_radius: f64,
    /// Where the projector's light comes from, in metres, from the dome's middle
    #[arg(long, value_name = "X,Y,Z", value_parser = point, default_value = "0,-0.5,3.4",
          allow_hyphen_values = true)]
    projector: DVec3,
    /// The point in the middle of its picture, from the dome's middle [default: the upper part of
    /// the mirror]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    look_at: Option<DVec3>,
    /// The projector's throw ratio: distance by width of its picture
    #[arg(long, value_name = "RATIO", value_parser = metres, default_value = "1.6")]
    throw: f64,
    /// By what percent of its height lens shift moves the picture up
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, allow_hyphen_values = true)]
    lens_shift: f64,
}

impl Folder {
    fn write(
        &self,
        kind: &str,
        comments: Vec<String>,
        screens: Vec<MadeScreen>,
    ) -> anyhow::Result<()> {
        let name = self.name.clone().unwrap_or_else(|| kind.to_owned());
        let made = Made { name, eye: self.eye, comments, screens, ..Made::default() };
        made.write(&self.output, self.force)?;
        let path = self.output.join("wall.toml");
        say(format_args!("polyptych check {} prints it", path.display()))
    }
}

fn check_pixels(pixels: [u32; 2]) -> anyhow::Result<()> {
    if pixels.iter().any(|side| !(1..=CHANNEL_SIDE_MAX).contains(side)) {
        bail!("--pixels {}x{}: 1 to {CHANNEL_SIDE_MAX} would be right", pixels[0], pixels[1]);
    }
    Ok(())
}

impl FisheyeArguments {
    pub fn run(&self) -> anyhow::Result<()> {
        let Self { pixels, degrees, tilt, radius, .. } = *self;
        check_pixels(pixels)?;
        let comments = vec![format!(
            "A fisheye picture of {degrees} degrees for a dome of {radius} m radius, tilted by \
             {tilt} degrees."
        )];
        self.folder.write("fisheye", comments, vec![self.screen()?])
    }

    /// The dome, with a point for each pixel.
    fn screen(&self) -> anyhow::Result<MadeScreen> {
        let lens = Fisheye { degrees: self.degrees, tilt_degrees: self.tilt };
        lens.check()?;
        if self.offset.length() >= self.radius {
            bail!("--offset {}: within the dome's radius would be right", self.offset);
        }
        let center = self.folder.eye - self.offset;
        let size = DVec2::from(self.pixels.map(f64::from));
        let square = size / size.min_element();
        let point = |place: DVec2| {
            let place = ((place * 2.0 - 1.0) * square + 1.0) / 2.0;
            Some(center + lens.direction(place)? * self.radius)
        };
        let shape = Shape::cap(center, self.radius, self.degrees, self.tilt);
        let mut screen = MadeScreen::new("dome", shape, self.pixels);
        screen.warp = Some(places(self.pixels).map(point).collect());
        Ok(screen)
    }
}

impl EquirectangularArguments {
    pub fn run(&self) -> anyhow::Result<()> {
        check_pixels(self.pixels)?;
        if !(-360.0..=360.0).contains(&self.yaw) {
            bail!("--yaw {}: -360 to 360 degrees would be right", self.yaw);
        }
        // A wall file takes no more than a whole turn either way.
        let yaw = (self.yaw + 180.0).rem_euclid(360.0) - 180.0;
        let shape = Shape::Sphere {
            center: self.folder.eye,
            radius: self.radius,
            azimuth: [yaw - 180.0, yaw + 180.0],
            elevation: [-90.0, 90.0],
            tilt: 0.0,
        };
        let comments = vec![
            "All directions in one picture: longitude from left to right, latitude up.".to_owned(),
        ];
        let screens = vec![MadeScreen::new("sphere", shape, self.pixels)];
        self.folder.write("equirectangular", comments, screens)
    }
}

impl CubeMapArguments {
    pub fn run(&self) -> anyhow::Result<()> {
        let screen = |(name, turn): (&'static str, glam::DQuat)| {
            let corner = |x, y| self.folder.eye + turn * DVec3::new(x, y, -1.0) * self.distance;
            let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)];
            MadeScreen::new(name, Shape::Plane(corners), [self.side; 2])
        };
        let comments = vec![
            "A cube around the eye. The top's upper edge is behind, the bottom's ahead.".to_owned(),
        ];
        self.folder.write("cube-map", comments, cube_faces().map(screen).into())
    }
}

impl MirrorArguments {
    pub fn run(&self) -> anyhow::Result<()> {
        check_pixels(self.pixels)?;
        let mirror = self.optics();
        mirror.check()?;
        let points: Vec<Option<DVec3>> =
            places(self.pixels).map(|place| mirror.point(place)).collect();
        let lit = points.iter().flatten().count();
        let share = lit as f64 / points.len() as f64;
        if lit == 0 {
            bail!(
                "no light of the projector comes to the dome over the mirror; --look-at moves the \
                 picture to the mirror, --projector and --mirror stand below the dome's rim"
            );
        }
        let comments = vec![
            format!(
                "A projector at {} m whose light a mirror of {} m radius at {} m throws",
                mirror.projector, mirror.mirror.radius, mirror.mirror.center
            ),
            format!(
                "onto a dome of {} m radius around {} m: {} of {} light it.",
                self.radius,
                mirror.dome.center,
                lit,
                counted(points.len(), "pixel")
            ),
        ];
        let shape = Shape::cap(mirror.dome.center, self.radius, 180.0, self.tilt);
        let mut screen = MadeScreen::new("dome", shape, self.pixels);
        screen.warp = Some(points);
        self.folder.write("mirror", comments, vec![screen])?;
        if share < LIT_SHARE_MIN {
            say(format_args!("warning: only {:.1} % of its pixels light the dome", share * 100.0))?;
        }
        Ok(())
    }

    fn optics(&self) -> MirrorDome {
        let center = self.dome.unwrap_or(self.folder.eye);
        let mirror = Ball { center: center + self.mirror, radius: self.mirror_radius };
        let projector = center + self.projector;
        // Rays that meet the mirror there leave up and forward.
        let usual = mirror.center + DVec3::Y * (0.35 * mirror.radius);
        let half = 0.5 / self.throw;
        let aspect = f64::from(self.pixels[1]) / f64::from(self.pixels[0]);
        MirrorDome {
            projector,
            look_at: self.look_at.map_or(usual, |at| center + at),
            tangents: DVec2::new(half, half * aspect),
            shift: self.lens_shift / 100.0,
            mirror,
            dome: Ball { center, radius: self.radius },
            tilt_degrees: self.tilt,
        }
    }
}

/// A point in metres, as an argument: `0,1.6,-2`.
fn point(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let point = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    let fits = |point: &[f64; 3]| point.iter().all(|metres| metres.abs() <= 1000.0);
    let point = point.filter(fits).map(DVec3::from_array);
    point.ok_or_else(|| format!("{text:?} is no point; write X,Y,Z in metres"))
}

#[cfg(test)]
mod tests;
