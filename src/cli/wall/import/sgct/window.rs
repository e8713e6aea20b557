//! Windows and viewports of SGCT's configurations: each viewport becomes a screen with a channel.

use glam::{DQuat, DVec2, DVec3, IVec2};
use polyptych_wall::limits::CHANNEL_SIDE_MAX;

use super::super::super::made::{MadeScreen, OneEye, Shape, plain_name};
use super::super::super::optics::{cube_faces, places};
use super::super::mask;
use super::super::mesh::{self, Frame, Mesh, Sample};
use super::super::tree::At;
use super::projection::{self, Found, Projection, RADIUS_DEFAULT_M};
use super::{Reader, User, known};

/// How far from a right angle corners may be to be those of a screen, as a cosine.
const RIGHT_ANGLE_COSINE_MAX: f64 = 1e-6;

/// Pixels of a window of XML that says nothing of them.
const PIXELS_DEFAULT: [u32; 2] = [640, 480];

/// Corners of a viewport that says nothing of them.
const PLANE_DEFAULT: [DVec3; 3] =
    [DVec3::new(-1.0, -1.0, -2.0), DVec3::new(-1.0, 1.0, -2.0), DVec3::new(1.0, 1.0, -2.0)];

/// What the viewports of a window have in common.
struct Frames<'r> {
    name: String,
    server: Option<&'r str>,
    /// Pixels of the display of one eye.
    size: [u32; 2],
    /// Width by height of the window, with both eyes' pictures where it has two.
    aspect: f64,
    /// Width by height of the pictures that are drawn, before they are stretched to the display.
    stretch: f64,
    adjust: Vec<String>,
}

/// A viewport on its window.
struct Viewport<'v, 't> {
    at: &'v At<'t>,
    name: String,
    position: DVec2,
    share: DVec2,
    /// Pixels on the display.
    size: [u32; 2],
    /// Width by height of its picture.
    aspect: f64,
    user: User,
    adjust: Vec<String>,
}

impl Reader<'_> {
    pub(super) fn window(
        &mut self,
        window: &At<'_>,
        index: usize,
        server: Option<&str>,
    ) -> anyhow::Result<()> {
        window.check_keys(known::WINDOW)?;
        window.leave_out(known::WINDOW_LEFT_OUT);
        for name in ["mpcdi", "scalablemesh"] {
            if let Some(at) = window.get(name).filter(|_| name == "mpcdi") {
                let remedy = "import that archive by polyptych wall import, and leave it out here";
                return Err(at.error("the window is described by another file", remedy));
            }
            if let Some(at) = window.get(name).filter(At::is_on) {
                return Err(at.error("a mesh of a window", "give it as mesh of its viewport"));
            }
        }
        let given = window.get("name").map_or(Ok(""), |name| name.text())?;
        let unnamed = match server {
            Some(server) => format!("{server}-window-{}", index + 1),
            None => format!("window-{}", index + 1),
        };
        let name = plain_name(given, &unnamed);
        if window.get("draw3d").map_or(Ok(true), |at| at.flag()).is_ok_and(|draws| !draws) {
            self.tree.note(format!("the window {name} draws no scene, and is left out"));
            return Ok(());
        }
        for name in ["msaa", "numberofsamples"] {
            if let Some(at) = window.get(name) {
                self.made.is_smooth |= at.integer(0..=255)? > 1;
            }
        }
        let (packing, mut adjust) = self.stereo(window, &name)?;
        let [x, y] = ["mirrorx", "mirrory"].map(|name| window.has(name));
        let (x, y) = (x? || window.has("mirror")?, y?);
        if x != y {
            adjust.push("mirror = true".to_owned());
        }
        if y {
            adjust.push("turn = \"half\"".to_owned());
        }
        let [size, drawn] = self.pixels(window)?;
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let size = [size[0] / packing[0], size[1] / packing[1]];
        let stretch = f64::from(drawn[0]) / f64::from(drawn[1]);
        let frames = Frames { name, server, size, aspect, stretch, adjust };
        let viewports = window.list("viewports", "viewport")?;
        if viewports.is_empty() {
            self.tree.warn(format!("the window {} has no viewport, and is left out", frames.name));
        }
        if viewports.len() > 1 {
            self.tree.note(format!(
                "the {} viewports of {} are channels, each with a window and a monitor of its own",
                viewports.len(),
                frames.name
            ));
        }
        for (at, viewport) in viewports.iter().enumerate() {
            let number = (viewports.len() > 1).then_some(at + 1);
            self.viewport(viewport, number, &frames)?;
        }
        Ok(())
    }

    /// Pixels of the display, and of the pictures that are drawn for it.
    fn pixels(&self, window: &At<'_>) -> anyhow::Result<[[u32; 2]; 2]> {
        let size = match side_pair(window, "size")? {
            Some(size) => size,
            None if self.tree.is_xml => PIXELS_DEFAULT,
            None => window.need("size").map(|_| PIXELS_DEFAULT)?,
        };
        let drawn = side_pair(window, "res")?.unwrap_or(size);
        if drawn != size {
            self.tree.note(
                "the resolution of frame buffers (res) is left out: a channel is drawn in the \
                 pixels of its display",
            );
        }
        Ok([size, drawn])
    }

    /// How many pictures lie side by side and above each other, and lines for the channel.
    fn stereo(&mut self, window: &At<'_>, name: &str) -> anyhow::Result<([u32; 2], Vec<String>)> {
        let Some(stereo) = window.get("stereo") else { return Ok(([1, 1], Vec::new())) };
        let stereo = stereo.get("type").unwrap_or(stereo);
        let kind = stereo.text()?.to_lowercase();
        let (packing, word, warning) = match kind.as_str() {
            "none" | "no_stereo" | "test" | "dummy" => return Ok(([1, 1], Vec::new())),
            "side_by_side" => ([2, 1], "side-by-side", ""),
            "side_by_side_inverted" => ([2, 1], "side-by-side", "the left eye is now on the left"),
            "top_bottom" => ([1, 2], "top-bottom", ""),
            "top_bottom_inverted" => ([1, 2], "top-bottom", "the left eye is now at the top"),
            "anaglyph_red_cyan" => ([1, 1], "anaglyph", ""),
            "anaglyph_amber_blue" | "anaglyph_wimmer" => {
                ([1, 1], "anaglyph", "red is now the left eye's, green and blue the right eye's")
            }
            "active"
            | "quadbuffer"
            | "checkerboard"
            | "checkerboard_inverted"
            | "vertical_interlaced"
            | "vertical_interlaced_inverted" => {
                self.tree.warn_of_stereo(&kind);
                self.has_stereo = true;
                return Ok(([1, 1], Vec::new()));
            }
            _ => {
                let remedy = "none, side_by_side, top_bottom and anaglyph_red_cyan are right";
                return Err(stereo.error(format!("there is no stereo {kind}"), remedy));
            }
        };
        if !warning.is_empty() {
            self.tree.warn(format!("stereo {kind} of {name} is not known: {warning}"));
        }
        self.has_stereo = true;
        Ok((packing, vec![format!("stereo = {word:?}")]))
    }

    fn viewport(
        &mut self,
        at: &At<'_>,
        number: Option<usize>,
        frames: &Frames<'_>,
    ) -> anyhow::Result<()> {
        at.check_keys(known::VIEWPORT)?;
        at.leave_out(&[("tracked", "tracking is left out: a program sends the head's pose")]);
        if at.get("overlay").is_some_and(|at| at.is_on()) {
            self.tree.warn(format!("the picture over {} (overlay) is left out", frames.name));
        }
        let position = at.get("pos").map_or(Ok(DVec2::ZERO), |at| at.pair())?;
        let share = at.get("size").map_or(Ok(DVec2::ONE), |at| at.pair())?;
        let all = DVec2::from(frames.size.map(f64::from));
        // SGCT cuts off what is behind the point.
        let low = (position * all).as_ivec2();
        let size = (share * all).as_ivec2();
        let side = IVec2::splat(CHANNEL_SIDE_MAX as i32);
        if size.cmplt(IVec2::ONE).any() || size.cmpgt(side).any() {
            let remedy = format!("1 to {CHANNEL_SIDE_MAX} would be right");
            return Err(at.error(format!("it has {} × {} pixels", size.x, size.y), remedy));
        }
        if low.cmplt(IVec2::ZERO).any() || (low + size).as_dvec2().cmpgt(all).any() {
            let name = &frames.name;
            self.tree.warn(format!("a viewport of {name} reaches out of its window; all is shown"));
        }
        let eye = match at.get("eye").map_or(Ok("center"), |at| at.text())?.to_lowercase().as_str()
        {
            "center" => None,
            "left" => Some(OneEye::Left),
            "right" => Some(OneEye::Right),
            eye => {
                let remedy = "center, left and right are right";
                return Err(at.need("eye")?.error(format!("there is no eye {eye}"), remedy));
            }
        };
        self.has_stereo |= eye.is_some();
        // A display of both eyes is not for one of them.
        let has_packing = frames.adjust.iter().any(|line| line.starts_with("stereo"));
        let eye = eye.filter(|_| !has_packing);
        let name = number.map_or_else(|| frames.name.clone(), |n| format!("{}-{n}", frames.name));
        let viewport = Viewport {
            at,
            name: self.free_name(&name)?,
            position,
            share,
            size: [size.x as u32, size.y as u32],
            aspect: frames.stretch * share.x / share.y,
            user: self.user(at)?,
            adjust: frames.adjust.clone(),
        };
        let screens = self.screens(&viewport, frames)?;
        for mut screen in screens {
            screen.server = frames.server.map(str::to_owned);
            screen.eye = eye;
            self.made.screens.push(screen);
        }
        Ok(())
    }

    /// The screens of a viewport: six for a cube, else one.
    fn screens(
        &self,
        viewport: &Viewport<'_, '_>,
        frames: &Frames<'_>,
    ) -> anyhow::Result<Vec<MadeScreen>> {
        let Viewport { at, name, user, .. } = viewport;
        let found = projection::read(at)?.unwrap_or_else(|| {
            self.tree.warn(format!(
                "{name} has no projection, and gets SGCT's own: 2 m wide, 2 m \
                                    ahead of the origin"
            ));
            let projection = Projection::Plane(PLANE_DEFAULT);
            Found::of(projection)
        });
        let eye = self.users[0].position;
        if user.position != eye {
            self.tree.warn(format!(
                "{name} is for the user {} at {}: its screen is moved so that the wall's one eye \
                 at {eye} sees the same",
                user.name, user.position
            ));
        }
        let frame = Frame {
            position: viewport.position,
            size: viewport.share,
            aspect: frames.aspect * viewport.share.x / viewport.share.y,
            is_texture: found.is_texture,
        };
        let mesh = at.get("mesh").filter(At::is_on);
        let is_bourke = mesh.as_ref().is_some_and(|mesh| {
            mesh.text().is_ok_and(|name| name.to_lowercase().ends_with(".data"))
        });
        let mesh = mesh.map(|at| mesh::read(&at, &frame)).transpose()?;
        let size = found.pixels.filter(|_| mesh.is_none()).unwrap_or(viewport.size);
        let mut projection = found.projection;
        let mut eye_of_user = user.position;
        if let Some(frustum) = mesh.as_ref().and_then(|mesh| mesh.frustum) {
            projection = projection::plane_of_mesh(&frustum)?;
            eye_of_user = frustum.eye.unwrap_or(eye_of_user);
        }
        if found.is_by_angles && mesh.as_ref().is_none_or(|mesh| mesh.frustum.is_none()) {
            self.warn_of_place(eye_of_user);
        }
        if let Projection::Cube { faces, rotation } = &projection {
            return Ok(self.cube(viewport, size, faces, *rotation));
        }
        let shift = eye - eye_of_user;
        let mut screen = if let Projection::Mirror { geometry, tilt } = &projection {
            mirror(viewport, geometry, *tilt, &frame, eye)?
        } else if let Some(shape) = shape(&projection, eye_of_user).filter(|_| mesh.is_none()) {
            MadeScreen::new(name, moved(shape, shift), size)
        } else {
            // A Bourke mesh takes the whole square of a fisheye.
            let aspect = if is_bourke { 1.0 } else { viewport.aspect };
            warped(name, &projection, mesh.as_ref(), size, aspect, [eye_of_user, shift])?
        };
        screen.adjust.clone_from(&viewport.adjust);
        self.masks(&mut screen, at)?;
        Ok(vec![screen])
    }

    /// Planes by angles stand around the origin, so that an eye elsewhere sees other angles.
    fn warn_of_place(&self, eye: DVec3) {
        if eye != DVec3::ZERO {
            self.tree.warn(format!(
                "planes by angles (fov) stand around the origin, as in SGCT; the eye at {eye} sees \
                 other angles, so put it at 0 0 0 if that is not meant"
            ));
        }
    }

    fn cube(
        &self,
        viewport: &Viewport<'_, '_>,
        size: [u32; 2],
        faces: &[&str],
        rotation: DQuat,
    ) -> Vec<MadeScreen> {
        let shown = cube_faces().into_iter().filter(|(face, _)| faces.contains(face));
        let screen = |(face, turn): (&str, DQuat)| {
            let corner = |x, y| self.users[0].position + rotation * turn * DVec3::new(x, y, -1.0);
            let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)];
            let name = format!("{}-{face}", viewport.name);
            let mut screen = MadeScreen::new(name, Shape::Plane(corners), size);
            screen.adjust.clone_from(&viewport.adjust);
            screen
        };
        shown.map(screen).collect()
    }

    /// Masks of light and of black.
    fn masks(&self, screen: &mut MadeScreen, at: &At<'_>) -> anyhow::Result<()> {
        if let Some(at) = at.get_any(&["blendmask", "mask"]).filter(At::is_on) {
            let mask = mask::read(&at, screen.size)?;
            screen.alpha = Some(match screen.alpha.take() {
                Some(alpha) => alpha.iter().zip(mask).map(|(a, b)| a * b).collect(),
                None => mask,
            });
        }
        if let Some(at) = at.get("blacklevelmask").filter(At::is_on) {
            screen.beta = Some(mask::read(&at, screen.size)?);
            self.tree.note("black level masks are added to the channel's light (beta)");
        }
        Ok(())
    }
}

/// Width and height in pixels.
fn side_pair(window: &At<'_>, name: &str) -> anyhow::Result<Option<[u32; 2]>> {
    let Some(at) = window.get(name) else { return Ok(None) };
    let side = |name: &str| at.need(name)?.integer(1..=65536);
    Ok(Some([side("x")? as u32, side("y")? as u32]))
}

/// The shape of a screen whose canvas is the picture, if there is one.
fn shape(projection: &Projection<'_>, eye: DVec3) -> Option<Shape> {
    match *projection {
        Projection::Plane([lower_left, upper_left, upper_right]) => {
            let (right, up) = (upper_right - upper_left, upper_left - lower_left);
            let cosine = right.normalize_or_zero().dot(up.normalize_or_zero());
            let corners = [lower_left, lower_left + right, upper_left];
            (cosine.abs() <= RIGHT_ANGLE_COSINE_MAX).then_some(Shape::Plane(corners))
        }
        Projection::Equirectangular => Some(Shape::all_around(eye, RADIUS_DEFAULT_M)),
        Projection::Cylinder { rotation, bottom, radius } => {
            // A wall file takes no more than a whole turn either way.
            let rotation = rotation.rem_euclid(360.0);
            Some(Shape::Cylinder {
                center: eye,
                radius,
                degrees: [-rotation, 360.0 - rotation],
                height: [bottom * radius, (bottom + 1.0) * radius],
            })
        }
        _ => None,
    }
}

fn moved(shape: Shape, by: DVec3) -> Shape {
    match shape {
        Shape::Plane(corners) => Shape::Plane(corners.map(|corner| corner + by)),
        Shape::Cylinder { center, radius, degrees, height } => {
            Shape::Cylinder { center: center + by, radius, degrees, height }
        }
        Shape::Sphere { center, radius, azimuth, elevation, tilt } => {
            Shape::Sphere { center: center + by, radius, azimuth, elevation, tilt }
        }
    }
}

/// A screen whose channel has a point for each pixel; `eyes` are the user's, and the way from it to
/// the wall's.
fn warped(
    name: &str,
    projection: &Projection<'_>,
    mesh: Option<&Mesh>,
    size: [u32; 2],
    aspect: f64,
    [eye, shift]: [DVec3; 2],
) -> anyhow::Result<MadeScreen> {
    let shape = match projection {
        Projection::Plane(corners) => Shape::Plane(rectangle(*corners)),
        Projection::Fisheye { lens, radius, offset, .. } => {
            Shape::cap(eye + offset * radius, *radius, lens.degrees, lens.tilt_degrees)
        }
        Projection::Cylinder { radius, .. } => Shape::all_around(eye, *radius),
        _ => Shape::all_around(eye, RADIUS_DEFAULT_M),
    };
    let mut screen = MadeScreen::new(name, moved(shape, shift), size);
    let show = |place: DVec2| Some(projection.point(place, aspect, eye)? + shift);
    let Some(mesh) = mesh else {
        screen.warp = Some(places(size).map(show).collect());
        return Ok(screen);
    };
    let samples = mesh.sample(size)?;
    screen.warp = Some(samples.iter().map(|sample| show((*sample)?.0)).collect());
    screen.alpha = light(&samples);
    Ok(screen)
}

/// The light of samples, if any is less than whole.
fn light(samples: &[Sample]) -> Option<Vec<f64>> {
    let light: Vec<f64> = samples.iter().map(|s| s.map_or(0.0, |(_, light)| light)).collect();
    let is_whole = samples.iter().flatten().all(|(_, light)| (light - 1.0).abs() < 1e-6);
    (!is_whole).then_some(light)
}

/// Lower left, lower right and upper left corner of the upright rectangle around a parallelogram.
fn rectangle([lower_left, upper_left, upper_right]: [DVec3; 3]) -> [DVec3; 3] {
    let right = upper_right - upper_left;
    let along = right.normalize_or_zero();
    let lean = (upper_left - lower_left).dot(along);
    let up = upper_left - lower_left - along * lean;
    let start = lower_left + along * lean.min(0.0);
    [start, start + right + along * lean.abs(), start + up]
}

/// Four meshes show faces of a cube that is tilted: the one ahead is half up.
fn mirror(
    viewport: &Viewport<'_, '_>,
    geometry: &At<'_>,
    tilt: f64,
    frame: &Frame,
    eye: DVec3,
) -> anyhow::Result<MadeScreen> {
    geometry.check_keys(&["bottom", "left", "right", "top"])?;
    let tilted = DQuat::from_rotation_x((45.0 - tilt).to_radians());
    let size = viewport.size;
    let mut screen =
        MadeScreen::new(&viewport.name, Shape::all_around(eye, RADIUS_DEFAULT_M), size);
    let mut points = vec![None; size[0] as usize * size[1] as usize];
    let mut samples: Vec<Sample> = vec![None; points.len()];
    let faces = cube_faces();
    for (name, face) in [("bottom", "front"), ("left", "left"), ("right", "right"), ("top", "top")]
    {
        let turn = faces.iter().find(|(name, _)| *name == face).map_or(DQuat::IDENTITY, |f| f.1);
        let mesh = mesh::read(&geometry.need(name)?, frame)?;
        for (at, sample) in mesh.sample(size)?.into_iter().enumerate() {
            let Some((place, _)) = sample else { continue };
            let side = place * 2.0 - 1.0;
            let direction = (tilted * turn * side.extend(-1.0)).normalize();
            points[at] = Some(eye + direction * RADIUS_DEFAULT_M);
            samples[at] = sample;
        }
    }
    screen.alpha = light(&samples);
    screen.warp = Some(points);
    Ok(screen)
}
