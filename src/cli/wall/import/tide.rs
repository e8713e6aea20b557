//! Configurations of Tide and DisplayCluster: tiles of one plane, in pixels alone.
//!
//! Keys are those of the `examples/` of both: `surfaces` with `numScreensX` (later `screenCountX`),
//! `displaysPerScreenX`, `displayWidth` and `bezelWidth` (pixels; less than 0 where displays
//! overlap), and older XML with `dimensions`.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::super::made::{Made, plain_name};
use super::tree::{At, Tree};

/// Names of the same number in Tide and in DisplayCluster.
const ACROSS: [&[&str]; 4] = [
    &["numscreensx", "screencountx", "numtileswidth"],
    &["displaywidth", "screenwidth"],
    &["bezelwidth", "mullionwidth"],
    &["displaysperscreenx"],
];
const DOWN: [&[&str]; 4] = [
    &["numscreensy", "screencounty", "numtilesheight"],
    &["displayheight", "screenheight"],
    &["bezelheight", "mullionheight"],
    &["displaysperscreeny"],
];

/// The displays of a process: its surface, whose eye, its column and row.
type Place = (i64, String, i64, i64);

/// Returns whether a tree is such a configuration.
pub(super) fn is_tide(tree: &Tree, root: &str) -> bool {
    let at = tree.at();
    match root {
        "" => at.get("surfaces").is_some(),
        root => root == "configuration" && at.get("dimensions").is_some(),
    }
}

/// Reads a configuration; its first surface is as wide and as far away as these metres say.
pub(super) fn read(tree: &Tree, width_m: f64, distance_m: f64) -> anyhow::Result<Made> {
    let root = tree.at();
    let surfaces = match root.get("surfaces") {
        Some(list) => list.items()?,
        None => vec![root.need("dimensions")?],
    };
    if surfaces.is_empty() {
        return Err(root.error("it has no surface", "add one with its displays"));
    }
    let stem = tree.path.file_stem().unwrap_or_default().to_string_lossy();
    let mut made = Made { name: plain_name(&stem, "wall"), ..Made::default() };
    let servers = servers(&root, &mut made)?;
    tree.note("it says nothing of metres: put the screens and the eye where they are");
    root.leave_out(&[
        ("background", "backgrounds and content are left out"),
        ("dock", "backgrounds and content are left out"),
        ("webservice", "web and user interfaces are left out"),
        ("webbrowser", "web and user interfaces are left out"),
        ("launcher", "web and user interfaces are left out"),
    ]);
    let mut pitch_m = None;
    let mut left_m = -width_m / 2.0;
    for (index, surface) in surfaces.iter().enumerate() {
        let [across, down] = [ACROSS, DOWN].map(|names| numbers(surface, names));
        let ([columns, width, gap_x], [rows, height, gap_y]) = (across?, down?);
        let pixels = |count: i64, side: i64, gap: i64| (count * side + (count - 1) * gap) as f64;
        let (all_x, all_y) = (pixels(columns, width, gap_x), pixels(rows, height, gap_y));
        if all_x < 1.0 || all_y < 1.0 || (gap_x.min(gap_y) < 0 && gap_x.max(gap_y) > 0) {
            return Err(surface.error("its bezels leave no picture", "give them in pixels"));
        }
        let pitch = *pitch_m.get_or_insert(width_m / all_x);
        let size = [all_x * pitch, all_y * pitch];
        let center = left_m + size[0] / 2.0;
        left_m += size[0] + 0.5;
        let number = index as i64;
        let grid = Grid {
            name: format!("surface-{}", index + 1),
            surface: number,
            has_stereo: servers.keys().any(|place| place.0 == number && place.1 != "mono"),
            counts: [columns, rows],
            side: [width, height],
            gap: [gap_x, gap_y],
        };
        let _ = write!(
            made.raw,
            "\n[[screen]]\nname = {:?}\nsize = {size:?}\ncenter = [{center:?}, 0.0, {:?}]\n\
             pixels = [{all_x}, {all_y}]\n",
            grid.name, -distance_m
        );
        grid.put_hidden(&mut made.raw);
        for eye in ["mono", "left", "right"] {
            grid.put(&mut made, eye, &servers);
        }
    }
    Ok(made)
}

/// The displays of a surface: how many across and down, their pixels, and those between them.
struct Grid {
    name: String,
    /// Its number, from 0.
    surface: i64,
    /// It has displays for one eye.
    has_stereo: bool,
    counts: [i64; 2],
    side: [i64; 2],
    gap: [i64; 2],
}

impl Grid {
    /// Writes the parts of the canvas that lie between displays.
    fn put_hidden(&self, text: &mut String) {
        let Self { counts: [columns, rows], side: [width, height], gap: [x, y], .. } = *self;
        let mut put = |at: [i64; 2], size: [i64; 2]| {
            let _ = write!(text, "[[screen.hidden]]\norigin = {at:?}\npixels = {size:?}\n");
        };
        for j in (1..rows).filter(|_| y > 0) {
            put([0, j * (height + y) - y], [columns * (width + x) - x, y]);
        }
        for (i, j) in (1..columns).filter(|_| x > 0).flat_map(|i| (0..rows).map(move |j| (i, j))) {
            put([i * (width + x) - x, j * (height + y)], [x, height]);
        }
    }

    /// Returns whether a tile has displays for each eye: as its processes say, and as others of
    /// the surface do where it has none.
    fn is_stereo(&self, [i, j]: [i64; 2], servers: &BTreeMap<Place, String>) -> bool {
        let has = |eye: &str| servers.contains_key(&(self.surface, eye.to_owned(), i, j));
        has("left") || has("right") || (self.has_stereo && !has("mono"))
    }

    /// Writes the channels for an eye.
    fn put(&self, made: &mut Made, eye: &str, servers: &BTreeMap<Place, String>) {
        let Self { name, counts: [columns, rows], side: [width, height], gap: [x, y], .. } = self;
        let tiles = (0..*rows).flat_map(|j| (0..*columns).map(move |i| (j, i)));
        let is_mono = eye == "mono";
        for (j, i) in tiles.filter(|(j, i)| self.is_stereo([*i, *j], servers) != is_mono) {
            let suffix = if is_mono { String::new() } else { format!("-{eye}") };
            let name = format!("{name}-{}-{}{suffix}", i + 1, j + 1);
            let at = [i * (width + x), j * (height + y)];
            let _ = write!(
                made.raw,
                "[[screen.channel]]\nname = {name:?}\norigin = {at:?}\n\
                 pixels = [{width}, {height}]\n"
            );
            if let Some(server) = servers.get(&(self.surface, eye.to_owned(), i, j)) {
                let _ = writeln!(made.raw, "server = {server:?}");
            }
            if !is_mono {
                let _ = write!(made.tail, "\n[channel.{name:?}]\neye = {eye:?}\n");
            }
            made.raw_channels += 1;
        }
    }
}

/// Screens, pixels of each and pixels between them, in one direction. A screen of several displays
/// has the pixels between those too (`SurfaceConfig::getScreenWidth` of Tide).
fn numbers(surface: &At<'_>, [count, side, gap, per]: [&[&str]; 4]) -> anyhow::Result<[i64; 3]> {
    let side = match surface.get_any(side) {
        Some(at) => at,
        None => surface.need(side[0])?,
    };
    let count = surface.get_any(count).map_or(Ok(1), |at| at.integer(1..=64))?;
    let gap = surface.get_any(gap).map_or(Ok(0), |at| at.integer(-4096..=4096))?;
    let per = surface.get_any(per).map_or(Ok(1), |at| at.integer(1..=64))?;
    let pixels = side.integer(1..=8192)? * per + (per - 1) * gap;
    if !(1..=8192).contains(&pixels) {
        let what = format!("a screen of {per} displays has {pixels} pixels");
        return Err(side.error(what, "1 to 8192 would be right"));
    }
    Ok([count, pixels, gap])
}

/// The server of each display: one for each process.
fn servers(root: &At<'_>, made: &mut Made) -> anyhow::Result<BTreeMap<Place, String>> {
    let mut servers = BTreeMap::new();
    for (index, process) in root.list("processes", "process")?.iter().enumerate() {
        let server = format!("process-{}", index + 1);
        if let Some(host) = process.get("host") {
            made.comments.push(format!("{server} is on {}", host.text()?));
        }
        for screen in process.list("screens", "screen")? {
            let number = |name: &str| screen.get(name).map_or(Ok(0), |at| at.integer(0..=63));
            // In older XML a process may say it for its screens.
            let stereo = screen.get("stereo").or_else(|| process.get("stereo"));
            let eye = stereo.as_ref().map_or(Ok("mono"), At::text)?.to_lowercase();
            let eye = if eye.is_empty() { "mono".to_owned() } else { eye };
            let is_known = ["mono", "left", "right"].contains(&eye.as_str());
            if let Some(at) = stereo.filter(|_| !is_known) {
                return Err(at.error(format!("there is no eye {eye}"), "left or right are right"));
            }
            let place = (number("surface")?, eye, number("i")?, number("j")?);
            if servers.insert(place, server.clone()).is_some() {
                return Err(screen.error("two screens show the same tile", "change i or j of one"));
            }
        }
    }
    for ((surface, eye, i, j), server) in &servers {
        let has = |eye: &str| servers.contains_key(&(*surface, eye.to_owned(), *i, *j));
        if eye == "mono" && (has("left") || has("right")) {
            root.tree.note(format!(
                "a display of {server} is left out: it shows without stereo what others show to \
                 each eye"
            ));
        }
    }
    Ok(servers)
}
