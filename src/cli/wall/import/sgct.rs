//! Configurations of SGCT and OpenSpace, JSON (`sgct.schema.json`) and the older XML.
//!
//! Display space is the same: metres, x right, y up, −z ahead. What keys mean and their defaults
//! are as in SGCT's documentation (`configuration/*.md` of sgct-docs) and its `readconfig.cpp`.

mod known;
mod projection;
#[cfg(test)]
mod tests;
mod window;

use anyhow::bail;
use glam::{DMat4, DQuat, DVec3};
use polyptych_wall::EYE_SEPARATION_DEFAULT_M;

use super::super::made::{Made, plain_name};
use super::tree::{At, Tree, Value};

/// From the left eye to the right one where a configuration does not say it, in metres.
const SEPARATION_DEFAULT_M: f64 = 0.06;

/// Somebody who looks at the wall.
#[derive(Clone, Debug)]
struct User {
    /// Empty for the one whose eye is the wall's.
    name: String,
    position: DVec3,
    separation: f64,
}

/// The wall that becomes of a configuration, as far as it is read.
#[derive(Debug)]
struct Reader<'t> {
    tree: &'t Tree,
    users: Vec<User>,
    made: Made,
    has_stereo: bool,
}

/// Reads a configuration whose root is a cluster.
pub(super) fn read(tree: &Tree) -> anyhow::Result<Made> {
    let root = tree.at();
    root.check_keys(known::CLUSTER)?;
    root.leave_out(known::CLUSTER_LEFT_OUT);
    if let Some(version) = root.get("version") {
        version.integer(1..=1)?;
    }
    if root.get("masteraddress").is_none() {
        root.need("masteraddress")?;
    }
    scene(&root)?;
    if let Some(settings) = root.get("settings") {
        settings.check_keys(known::SETTINGS)?;
        settings.leave_out(known::SETTINGS_LEFT_OUT);
    }
    let users = users(&root)?;
    let eye = users[0].position;
    let stem = tree.path.file_stem().unwrap_or_default().to_string_lossy();
    let made = Made { name: plain_name(&stem, "wall"), eye, ..Made::default() };
    let mut reader = Reader { tree, users, made, has_stereo: false };
    let nodes = root.list("nodes", "node")?;
    if nodes.is_empty() {
        return Err(root.error("it has no node", "add nodes with windows and viewports"));
    }
    for (index, node) in nodes.iter().enumerate() {
        reader.node(node, index, nodes.len())?;
    }
    if reader.made.screens.is_empty() {
        return Err(root.error("no window draws a scene", "give one a viewport with a projection"));
    }
    let separation = reader.users[0].separation;
    if reader.has_stereo || (separation - EYE_SEPARATION_DEFAULT_M).abs() > 1e-9 {
        reader.made.eye_separation = Some(separation);
    }
    if nodes.len() > 1 {
        tree.note(
            "the manager listens on its own machine only: set listen of [network], and make keys \
             with polyptych keys, before nodes elsewhere start",
        );
    }
    Ok(reader.made)
}

/// A scene that is moved, turned or scaled is the application's affair here.
fn scene(root: &At<'_>) -> anyhow::Result<()> {
    let Some(scene) = root.get("scene") else { return Ok(()) };
    scene.check_keys(&["offset", "orientation", "scale"])?;
    let offset = scene.vector_or_zero("offset")?;
    let rotation = scene.get("orientation").map_or(Ok(DQuat::IDENTITY), |at| orientation(&at))?;
    let scale = match scene.get("scale") {
        Some(at) => at.get("value").unwrap_or(at).number()?,
        None => 1.0,
    };
    if offset != DVec3::ZERO || rotation.angle_between(DQuat::IDENTITY) > 1e-6 || scale != 1.0 {
        let (axis, radians) = rotation.to_axis_angle();
        root.tree.warn(format!(
            "the scene is moved by {offset} m, turned by {:.3} degrees about {axis:.3} and scaled \
             by {scale}; a wall file says nothing of the scene: move the camera or the scene so",
            radians.to_degrees()
        ));
    }
    Ok(())
}

/// All users, first the one whose eye is the wall's: the one without a name.
fn users(root: &At<'_>) -> anyhow::Result<Vec<User>> {
    let usual =
        User { name: String::new(), position: DVec3::ZERO, separation: SEPARATION_DEFAULT_M };
    let mut users = vec![usual];
    for at in root.list("users", "user")? {
        at.check_keys(known::USER)?;
        let name = at.get("name").map_or(Ok(""), |name| name.text())?.to_owned();
        let mut position = at.vector_or_zero("pos")?;
        if let Some(matrix) = at.get("matrix") {
            position = place_of(&matrix)?;
        }
        let separation = at.number_or("eyeseparation", SEPARATION_DEFAULT_M)?;
        if !(0.0..=10.0).contains(&separation) {
            let at = at.need("eyeseparation")?;
            return Err(at.error(format!("found {separation}"), "0 to 10 metres would be right"));
        }
        if let Some(at) = at.get("orientation")
            && orientation(&at)?.angle_between(DQuat::IDENTITY) > 1e-6
        {
            let what = "a user's head is turned; the wall's own head is upright until a program \
                        that tracks it says otherwise";
            at.tree.warn(what);
        }
        at.leave_out(&[("tracking", "trackers are left out: a program sends the head's pose")]);
        let user = User { name: name.clone(), position, separation };
        if name.is_empty() || name == "default" {
            users[0] = user;
        } else {
            users.push(user);
        }
    }
    Ok(users)
}

/// Where a user's matrix puts the eye: in JSON 16 numbers by columns, in XML by name.
fn place_of(matrix: &At<'_>) -> anyhow::Result<DVec3> {
    let mut numbers = [0.0; 16];
    if let Value::List(_) = matrix.node.value {
        let items = matrix.items()?;
        if items.len() != numbers.len() {
            return Err(matrix.error(format!("{} numbers", items.len()), "16 would be right"));
        }
        for (number, item) in numbers.iter_mut().zip(items) {
            *number = item.number()?;
        }
    } else {
        for (at, number) in numbers.iter_mut().enumerate() {
            *number =
                matrix.need(&format!("{}{}", ["x", "y", "z", "w"][at % 4], at / 4))?.number()?;
        }
    }
    let columns = DMat4::from_cols_array(&numbers);
    let columns = if matrix.has("transpose")? { columns.transpose() } else { columns };
    Ok(columns.w_axis.truncate())
}

/// A quaternion, angles about x, y and z in that order, or yaw, pitch and roll in degrees: yaw to
/// the right, pitch up, roll clockwise are positive, and roll is done first.
fn orientation(at: &At<'_>) -> anyhow::Result<DQuat> {
    const ANGLES: [&[&str]; 3] =
        [&["yaw", "heading", "azimuth"], &["pitch", "elevation"], &["roll", "bank"]];
    let known: Vec<&str> = ANGLES.concat().into_iter().chain(["x", "y", "z", "w"]).collect();
    at.check_keys(&known)?;
    if let Some(w) = at.get("w") {
        let quat = DQuat::from_xyzw(
            at.number_or("x", 0.0)?,
            at.number_or("y", 0.0)?,
            at.number_or("z", 0.0)?,
            w.number()?,
        );
        if quat.length() < 1e-6 {
            return Err(at.error("the quaternion is 0", "0, 0, 0, 1 is upright"));
        }
        return Ok(quat.normalize());
    }
    let angle = |names: &[&str]| -> anyhow::Result<f64> {
        let Some(at) = at.get_any(names) else { return Ok(0.0) };
        let degrees = at.number()?;
        if degrees.abs() > 360.0 {
            return Err(at.error(format!("found {degrees}"), "-360 to 360 degrees would be right"));
        }
        Ok(degrees.to_radians())
    };
    let [x, y, z] = [angle(&["x"])?, angle(&["y"])?, angle(&["z"])?];
    let about =
        |x, y, z| [DQuat::from_rotation_x(x), DQuat::from_rotation_y(y), DQuat::from_rotation_z(z)];
    if [x, y, z] != [0.0; 3] {
        let [x, y, z] = about(x, y, z);
        return Ok(x * y * z);
    }
    let [yaw, pitch, roll] = ANGLES.map(angle);
    let [x, y, z] = about(pitch?, -yaw?, -roll?);
    Ok(y * x * z)
}

impl Reader<'_> {
    fn node(&mut self, node: &At<'_>, index: usize, count: usize) -> anyhow::Result<()> {
        node.check_keys(known::NODE)?;
        let address = match node.get_any(&["address", "ip"]) {
            Some(at) => at.text()?,
            None => node.need("address")?.text()?,
        };
        if self.tree.is_xml || node.get("port").is_some() {
            node.need("port")?.integer(0..=65535)?;
        }
        node.leave_out(known::NODE_LEFT_OUT);
        let server = (count > 1).then(|| format!("node-{}", index + 1));
        if let Some(server) = &server {
            self.made.comments.push(format!("{server} is {address}"));
        }
        let windows = node.list("windows", "window")?;
        for (index, window) in windows.iter().enumerate() {
            self.window(window, index, server.as_deref())?;
        }
        Ok(())
    }

    /// The user of a viewport.
    fn user(&self, viewport: &At<'_>) -> anyhow::Result<User> {
        let Some(at) = viewport.get("user") else { return Ok(self.users[0].clone()) };
        let name = at.text()?;
        let found = self.users.iter().find(|user| user.name == name || name == "default");
        let names: Vec<&str> = self.users.iter().map(|user| user.name.as_str()).collect();
        let Some(user) = found else {
            let remedy = format!("these are: {}", names.join(", "));
            return Err(at.error(format!("there is no user {name:?}"), remedy));
        };
        Ok(user.clone())
    }

    /// A name that no other screen has.
    fn free_name(&self, wanted: &str) -> anyhow::Result<String> {
        let is_free = |name: &String| self.made.screens.iter().all(|screen| screen.name != *name);
        let mut names = (1..=self.made.screens.len() + 1).map(|count| match count {
            1 => wanted.to_owned(),
            _ => format!("{wanted}-{count}"),
        });
        let Some(name) = names.find(is_free) else { bail!("no name is left for {wanted}") };
        Ok(name)
    }
}
