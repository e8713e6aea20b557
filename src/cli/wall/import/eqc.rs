//! Configurations of Equalizer: words, numbers, texts in quotes, lists in brackets, sections in
//! braces; `#` begins a comment. Channels of canvases are read, and where their walls stand.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::anyhow;
use glam::{DQuat, DVec3};

use super::super::made::{Made, MadeScreen, OneEye, Shape, plain_name};
use super::tree::{At, DEPTH_MAX, Node, Spot, Tree, Value};

/// A wall that a configuration says nothing of (`eq/fabric/wall.cpp`).
const WALL_DEFAULT: [DVec3; 3] =
    [DVec3::new(-0.8, -0.5, -1.0), DVec3::new(0.8, -0.5, -1.0), DVec3::new(-0.8, 0.5, -1.0)];

/// The viewport of what does not say it: x, y, width and height in shares.
const WHOLE: [f64; 4] = [0.0, 0.0, 1.0, 1.0];

/// Distance of a projection that does not say it (`eq/fabric/projection.cpp`).
const DISTANCE_DEFAULT: f64 = 1.0;

/// Degrees across and up of a projection that does not say them: those of the wall above.
const FOV_DEFAULT: [f64; 2] = [77.3196, 53.1301];

/// From the left eye to the right one where a configuration does not say it, in metres
/// (`eq/server/global.cpp`).
const EYE_BASE_DEFAULT_M: f64 = 0.05;

/// Words for the eyes that a segment shows; the last one is between the two.
const EYES: [&str; 3] = ["left", "right", "cyclop"];

/// Pixels of the display of a window where neither it nor its pipe says them.
const PIXELS_DEFAULT: [f64; 2] = [1920.0, 1080.0];

/// Reads the text of a configuration.
pub(super) fn parse(path: &Path, text: &str) -> anyhow::Result<Tree> {
    let mut words = words(text);
    words.reverse();
    let root = section(&mut words, 0, true).map_err(|(Spot { line, column }, what)| {
        anyhow!("{}:{line}:{column}: file: {what}; mend it there", path.display())
    })?;
    // A section may stand any number of times, as in XML.
    Ok(Tree::new(path, true, root))
}

/// The words of a text, and where each stands.
fn words(text: &str) -> Vec<(Spot, String)> {
    let mut words = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let mut letters = line.char_indices().peekable();
        while let Some((column, letter)) = letters.next() {
            let spot = Spot { line: at as u32 + 1, column: column as u32 + 1 };
            match letter {
                '#' => break,
                '/' if line[column..].starts_with("//") => break,
                '"' => {
                    let mut word = String::from('"');
                    word.extend(letters.by_ref().map(|(_, c)| c).take_while(|c| *c != '"'));
                    words.push((spot, word));
                }
                '{' | '}' | '[' | ']' | '(' | ')' => words.push((spot, letter.into())),
                letter if letter.is_whitespace() => {}
                letter => {
                    let mut word = String::from(letter);
                    while let Some((_, c)) =
                        letters.next_if(|(_, c)| !c.is_whitespace() && !"{}[]()#\"".contains(*c))
                    {
                        word.push(c);
                    }
                    words.push((spot, word));
                }
            }
        }
    }
    words
}

type Fault = (Spot, String);

/// Names and values up to the end of a section; `words` are in reverse order.
fn section(words: &mut Vec<(Spot, String)>, depth: usize, is_root: bool) -> Result<Node, Fault> {
    let start = words.last().map_or(Spot { line: 1, column: 1 }, |word| word.0);
    if depth > DEPTH_MAX {
        return Err((start, format!("sections lie in each other more than {DEPTH_MAX} deep")));
    }
    let mut entries = Vec::new();
    loop {
        let Some((spot, name)) = words.pop() else {
            if is_root {
                return Ok(Node { spot: start, value: Value::Object(entries) });
            }
            return Err((start, "the section that begins here is not closed".to_owned()));
        };
        if name == "}" {
            if is_root {
                return Err((spot, "there is one } too many".to_owned()));
            }
            return Ok(Node { spot: start, value: Value::Object(entries) });
        }
        let next = words.last().map(|(_, word)| word.clone()).unwrap_or_default();
        let name = name.to_lowercase();
        let node = match next.as_str() {
            "{" => {
                words.pop();
                section(words, depth + 1, false)?
            }
            "[" | "(" => {
                words.pop();
                list(words, spot)?
            }
            "}" | "" => Node { spot, value: Value::Null },
            _ => {
                let word = words.pop().map(|(_, word)| word).unwrap_or_default();
                Node { spot, value: Value::Text(word.trim_start_matches('"').to_owned()) }
            }
        };
        entries.push((name, node));
    }
}

fn list(words: &mut Vec<(Spot, String)>, start: Spot) -> Result<Node, Fault> {
    let mut items = Vec::new();
    while let Some((spot, word)) = words.pop() {
        match word.as_str() {
            "]" | ")" => return Ok(Node { spot: start, value: Value::List(items) }),
            "{" | "}" | "[" | "(" => break,
            _ => {
                let value = Value::Text(word.trim_start_matches('"').to_owned());
                items.push(Node { spot, value });
            }
        }
    }
    Err((start, "the list that begins here is not closed".to_owned()))
}

/// Returns whether a text is such a configuration.
pub(super) fn is_eqc(text: &str) -> bool {
    text.lines().take(64).any(|line| {
        let line = line.trim_start();
        line.starts_with("#Equalizer") || line.starts_with("server") || line.starts_with("config")
    })
}

/// Reads the canvases of a configuration.
pub(super) fn read(tree: &Tree) -> anyhow::Result<Made> {
    let root = tree.at();
    let server = root.get("server").unwrap_or_else(|| root.clone());
    let config = server.need("config")?;
    let stem = tree.path.file_stem().unwrap_or_default().to_string_lossy();
    let mut made = Made { name: plain_name(&stem, "wall"), ..Made::default() };
    let (eye, separation) = observed(&root, &config)?;
    (made.eye, made.eye_separation) = (eye, Some(separation));
    let mut channels = BTreeMap::new();
    let nodes = [config.list("", "appnode")?, config.list("", "node")?].concat();
    for (index, node) in nodes.iter().enumerate() {
        windows(node, &format!("node-{}", index + 1), &mut channels)?;
    }
    tree.note("compounds and load balancing are left out: each server draws its own channels");
    tree.note("views and layouts are left out: the wall shows one scene");
    let stereo = Stereo::new(&root, &config)?;
    let segments = segments(&config)?;
    for segment in &segments {
        let name = segment.at.need("channel")?;
        let name_text = name.text()?;
        let Some(channel) = channels.get(name_text) else {
            let what = format!("there is no channel {name_text:?}");
            return Err(name.error(what, "name one of a window"));
        };
        if segment.is_mono_of(&segments) {
            tree.note(format!(
                "the channel {name_text:?} is left out: it shows without stereo what others show \
                 to each eye"
            ));
            continue;
        }
        let mut wanted = plain_name(name_text, "channel");
        while made.screens.iter().any(|screen| screen.name == wanted) {
            wanted.push_str("-2");
        }
        let mut screen = MadeScreen::new(wanted, Shape::Plane(segment.corners), channel.size);
        screen.server = (nodes.len() > 1).then(|| channel.server.clone());
        screen.eye = segment.one_eye();
        if segment.eyes[..2] == [true; 2] {
            if stereo.is_anaglyph {
                screen.adjust.push("stereo = \"anaglyph\"".to_owned());
            } else if stereo.is_on || channel.has_stereo.unwrap_or(stereo.has_windows) {
                tree.warn_of_stereo("quadbuffer");
            }
        }
        made.screens.push(screen);
    }
    if made.screens.is_empty() {
        let remedy = "add a canvas with segments: walls of compounds are not read";
        return Err(config.error("it has no segment of a canvas", remedy));
    }
    Ok(made)
}

/// The point between the eyes of the first observer, and how far these are apart, in metres.
fn observed(root: &At<'_>, config: &At<'_>) -> anyhow::Result<(DVec3, f64)> {
    let own = config.get("attributes").and_then(|at| at.get("eye_base"));
    let global = root.get("global").and_then(|at| at.get("eq_config_fattr_eye_base"));
    let base = own.or(global).map_or(Ok(EYE_BASE_DEFAULT_M), |metres| metres.number())?;
    let observers = config.list("", "observer")?;
    let eyes = observers.iter().map(|at| eyes_of(at, base));
    let eyes: Vec<_> = eyes.collect::<anyhow::Result<_>>()?;
    let Some(first) = eyes.first() else { return Ok((DVec3::ZERO, base)) };
    if eyes.iter().any(|other| other != first) {
        config.tree.warn("observers have different eyes: the wall has those of the first");
    }
    Ok(*first)
}

/// The same of an observer, whose eyes are so many metres apart if it does not say it. The head
/// is at the origin until it is tracked.
fn eyes_of(observer: &At<'_>, base: f64) -> anyhow::Result<(DVec3, f64)> {
    let base = observer.number_or("eye_base", base)?;
    let point = |name: &str, default: DVec3| {
        numbers_or(observer, name, default.to_array()).map(DVec3::from_array)
    };
    let left = point("eye_left", DVec3::X * (-base / 2.0))?;
    let right = point("eye_right", DVec3::X * (base / 2.0))?;
    Ok((point("eye_cyclop", (left + right) / 2.0)?, left.distance(right)))
}

/// The stereo of channels that show both eyes.
struct Stereo {
    /// By the colours of glasses.
    is_anaglyph: bool,
    /// A view begins with it.
    is_on: bool,
    /// Windows that do not say it have buffers for both eyes.
    has_windows: bool,
}

impl Stereo {
    fn new(root: &At<'_>, config: &At<'_>) -> anyhow::Result<Self> {
        let global = |name: &str| root.get("global").and_then(|at| at.get(name));
        let is_anaglyph = says(global("eq_compound_iattr_stereo_mode"), "anaglyph");
        let mut views = Vec::new();
        for layout in config.list("", "layout")? {
            views.extend(layout.list("", "view")?);
        }
        Ok(Self {
            is_anaglyph: is_anaglyph || has_anaglyph(config)?,
            is_on: views.iter().any(|view| says(view.get("mode"), "stereo")),
            has_windows: says(global("eq_window_iattr_hint_stereo"), "on"),
        })
    }
}

/// Returns whether a compound in this section, or in another one in it, shows eyes by colours.
fn has_anaglyph(section: &At<'_>) -> anyhow::Result<bool> {
    for compound in section.list("", "compound")? {
        let mode = compound.get("attributes").and_then(|at| at.get("stereo_mode"));
        if says(mode, "anaglyph") || has_anaglyph(&compound)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Returns whether a value is there and is this word, in large or small letters.
fn says(value: Option<At<'_>>, word: &str) -> bool {
    value.is_some_and(|at| at.text().is_ok_and(|text| text.eq_ignore_ascii_case(word)))
}

/// A part of a canvas, or a wall of its own, that a channel shows.
struct Segment<'t> {
    at: At<'t>,
    /// Lower left, lower right and upper left.
    corners: [DVec3; 3],
    /// Eyes that it shows, in the order of [`EYES`].
    eyes: [bool; 3],
}

impl Segment<'_> {
    /// The one eye that it shows: between the eyes (CYCLOP) it is drawn without stereo.
    fn one_eye(&self) -> Option<OneEye> {
        match self.eyes {
            [true, false, _] => Some(OneEye::Left),
            [false, true, _] => Some(OneEye::Right),
            _ => None,
        }
    }

    /// Returns whether it shows only without stereo what others of the same place show in stereo.
    fn is_mono_of(&self, all: &[Segment<'_>]) -> bool {
        let is_shown = |eye: usize| {
            let shows = |other: &Segment<'_>| other.eyes[eye] && other.eyes != [true; 3];
            all.iter().any(|other| other.corners == self.corners && shows(other))
        };
        self.eyes == [false, false, true] && is_shown(0) && is_shown(1)
    }
}

/// The segments of all canvases.
fn segments<'t>(config: &At<'t>) -> anyhow::Result<Vec<Segment<'t>>> {
    let mut segments = Vec::new();
    for (index, canvas) in config.list("", "canvas")?.iter().enumerate() {
        let of_canvas = wall(canvas)?;
        for at in canvas.list("", "segment")? {
            let share = viewport(&at)?.unwrap_or(WHOLE);
            let of_all = || match of_canvas {
                Some(corners) => Ok(Some(corners)),
                None => wall_of_views(config, canvas, share),
            };
            let corners = match wall(&at)? {
                Some(corners) => corners,
                None => part(of_all()?.unwrap_or_else(|| usual_wall(canvas, index)), share),
            };
            segments.push(Segment { corners, eyes: eyes(&at)?, at });
        }
    }
    Ok(segments)
}

/// The wall of a canvas by its first layout: a wall of a view spans the view, and here that one
/// counts in which the middle of this part of the canvas lies.
fn wall_of_views(
    config: &At<'_>,
    canvas: &At<'_>,
    [x, y, w, h]: [f64; 4],
) -> anyhow::Result<Option<[DVec3; 3]>> {
    let layouts = config.list("", "layout")?;
    let mut layout = layouts.first();
    if let Some(name) = canvas.get("layout") {
        let name = name.text()?;
        let has_name =
            |at: &&At<'_>| at.get("name").is_some_and(|own| own.text().ok() == Some(name));
        let by_number = || layouts.get(name.parse::<usize>().ok()?);
        layout = layouts.iter().find(has_name).or_else(by_number);
    }
    let Some(layout) = layout else { return Ok(None) };
    for view in layout.list("", "view")? {
        let [left, low, width, height] = viewport(&view)?.unwrap_or(WHOLE);
        let is_here = (left..left + width).contains(&(x + w / 2.0))
            && (low..low + height).contains(&(y + h / 2.0));
        if is_here && let Some(corners) = wall(&view)? {
            let all = [-left / width, -low / height, 1.0 / width, 1.0 / height];
            return Ok(Some(part(corners, all)));
        }
    }
    Ok(None)
}

/// Equalizer's own wall for a canvas without one, and tells so.
fn usual_wall(canvas: &At<'_>, index: usize) -> [DVec3; 3] {
    let name = canvas.get("name").and_then(|name| name.text().ok());
    let name = name.map_or_else(|| (index + 1).to_string(), str::to_owned);
    canvas.tree.warn(format!(
        "the canvas {name} has no wall, and gets Equalizer's own: 1.6 m wide, 1 m ahead of the \
         origin"
    ));
    WALL_DEFAULT
}

/// A part of a window that segments may name.
struct Channel {
    /// In pixels.
    size: [u32; 2],
    server: String,
    /// The window has buffers for both eyes, if it says so.
    has_stereo: Option<bool>,
}

/// The channels of a node by name.
fn windows(
    node: &At<'_>,
    server: &str,
    channels: &mut BTreeMap<String, Channel>,
) -> anyhow::Result<()> {
    for pipe in node.list("", "pipe")? {
        // In pixels, even where those of its windows are in shares of it.
        let of_pipe = viewport(&pipe)?;
        for window in pipe.list("", "window")? {
            let [_, _, width, height] = viewport(&window)?.unwrap_or(WHOLE);
            let has_pixels = width > 1.0 || height > 1.0;
            let of_display = match of_pipe {
                _ if has_pixels => [1.0; 2],
                Some([_, _, w, h]) => [w, h],
                None => {
                    let what = "a window does not say its pixels: those of a display of 1920 × \
                                1080 are taken";
                    window.tree.warn(what);
                    PIXELS_DEFAULT
                }
            };
            let all = [width * of_display[0], height * of_display[1]];
            let hint = window.get("attributes").and_then(|at| at.get("hint_stereo"));
            let has_stereo = hint.map(|hint| says(Some(hint), "on"));
            for channel in window.list("", "channel")? {
                let [_, _, w, h] = viewport(&channel)?.unwrap_or(WHOLE);
                let is_share = w <= 1.0 && h <= 1.0;
                let size = if is_share { [w * all[0], h * all[1]] } else { [w, h] };
                if size.iter().any(|side| !(1.0..=8192.0).contains(side)) {
                    let what = format!("it has {} × {} pixels", size[0], size[1]);
                    return Err(channel.error(what, "1 to 8192 would be right"));
                }
                let name = channel.get("name").map_or(Ok(""), |at| at.text())?.to_owned();
                let size = size.map(|side| side.round() as u32);
                channels.insert(name, Channel { size, server: server.to_owned(), has_stereo });
            }
        }
    }
    Ok(())
}

/// The eyes that a segment shows, in the order of [`EYES`]: all where it says nothing of them.
fn eyes(segment: &At<'_>) -> anyhow::Result<[bool; 3]> {
    let Some(list) = segment.get("eye") else { return Ok([true; 3]) };
    let mut eyes = [false; 3];
    for word in list.items()? {
        let text = word.text()?;
        let Some(at) = EYES.iter().position(|eye| text.eq_ignore_ascii_case(eye)) else {
            let what = format!("there is no eye {text}");
            return Err(word.error(what, "LEFT, RIGHT and CYCLOP are right"));
        };
        eyes[at] = true;
    }
    Ok(eyes)
}

/// x, y, width and height of `viewport`.
fn viewport(at: &At<'_>) -> anyhow::Result<Option<[f64; 4]>> {
    at.get("viewport").map(|at| numbers(&at)).transpose()
}

fn numbers<const N: usize>(at: &At<'_>) -> anyhow::Result<[f64; N]> {
    let numbers: Vec<f64> = at.items()?.iter().map(At::number).collect::<anyhow::Result<_>>()?;
    let count = numbers.len();
    numbers.try_into().map_err(|_| at.error(format!("{count} numbers"), format!("{N} are right")))
}

/// The numbers of this name, or others where there are none.
fn numbers_or<const N: usize>(
    at: &At<'_>,
    name: &str,
    default: [f64; N],
) -> anyhow::Result<[f64; N]> {
    at.get(name).map_or(Ok(default), |at| numbers(&at))
}

/// Lower left, lower right and upper left corner of `wall` or `projection`, if there is one.
fn wall(at: &At<'_>) -> anyhow::Result<Option<[DVec3; 3]>> {
    if let Some(wall) = at.get("wall") {
        if wall.get("type").is_some_and(|at| at.text().is_ok_and(|kind| kind == "HMD")) {
            wall.tree.warn("a wall moves with the head (HMD); it stands still now");
        }
        let mut corners = WALL_DEFAULT;
        for (name, corner) in ["bottom_left", "bottom_right", "top_left"].iter().zip(&mut corners) {
            *corner = DVec3::from_array(numbers_or(&wall, name, corner.to_array())?);
        }
        return Ok(Some(corners));
    }
    let Some(projection) = at.get("projection") else { return Ok(None) };
    let origin = DVec3::from_array(numbers_or(&projection, "origin", [0.0; 3])?);
    let distance = projection.number_or("distance", DISTANCE_DEFAULT)?;
    let angles = numbers_or(&projection, "fov", FOV_DEFAULT)?;
    if angles.iter().any(|angle| !(0.1..=179.0).contains(angle)) || distance <= 0.0 {
        let fov = projection.get("fov").unwrap_or(projection);
        return Err(fov.error("the projection spans no picture", "0.1 to 179 degrees are right"));
    }
    let hpr = numbers_or(&projection, "hpr", [0.0; 3])?;
    if hpr[1] != 0.0 || hpr[2] != 0.0 {
        let what = "pitch and roll of a projection (hpr) are taken as up and as counter-clockwise; \
                    look at the picture";
        projection.tree.warn(what);
    }
    let [heading, pitch, roll] = hpr.map(f64::to_radians);
    let turn = DQuat::from_rotation_y(heading)
        * DQuat::from_rotation_x(pitch)
        * DQuat::from_rotation_z(roll);
    let [x, y] = angles.map(|angle| (angle.to_radians() / 2.0).tan());
    let corner = |x: f64, y: f64| origin + turn * DVec3::new(x, y, -1.0) * distance;
    Ok(Some([corner(-x, -y), corner(x, -y), corner(-x, y)]))
}

/// A part of a wall: x, y, width and height in shares, from the lower left.
fn part([lower_left, lower_right, upper_left]: [DVec3; 3], [x, y, w, h]: [f64; 4]) -> [DVec3; 3] {
    let (right, up) = (lower_right - lower_left, upper_left - lower_left);
    let start = lower_left + right * x + up * y;
    [start, start + right * w, start + up * h]
}
