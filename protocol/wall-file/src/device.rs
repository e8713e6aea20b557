//! Trackers, wands and pads: from their sections to [`Device`]s.

use std::net::SocketAddr;

use glam::DVec3;
use polyptych_wall::device::{
    Control, Device, DeviceSource, EulerOrder, FlyControls, HeadInput, HeadTracking, RotationForm,
    SignedAxis, TrackerFrame,
};
use polyptych_wall::head::HEAD_REACH_MAX_M;
use polyptych_wall::limits::{DEVICES_MAX, PATH_BYTES_MAX};

use super::check::{check_name, check_numbers};
use super::control::control;
use super::document::{
    DeviceKind, DeviceSection, FlySection, FormChoice, FrameSection, HeadSection,
};
use super::error::WallFileError;
use super::rotation::rotation;
use super::source::SourceText;

/// Metres in a unit of a tracker: from micrometres to kilometres.
const UNIT_RANGE_M: (f64, f64) = (1e-6, 1e3);

/// Maximum distance between a sensor and the eyes, in metres: a wand that stands for a head.
const EYES_MAX_M: f64 = 10.0;

/// Maximum prediction in milliseconds: a head does something else by then.
const PREDICTION_MS_MAX: u32 = 100;

/// Silence after which a device is lost, in milliseconds.
const LOST_MS: (u32, u32) = (20, 60_000);

/// Maximum time for which a pose is held, in milliseconds.
const HOLD_MS_MAX: u32 = 600_000;

/// Time in which a head is eased, in milliseconds.
const EASE_MS: (u32, u32) = (10, 60_000);

/// Speeds of heads and flights, in metres per second.
const SPEED_RANGE: (f64, f64) = (1e-3, 1e3);

/// Jumps of heads, in metres.
const JUMP_RANGE_M: (f64, f64) = (1e-3, 1e3);

/// Turns of flights, in degrees per second.
const TURN_RANGE: (f64, f64) = (0.1, 3600.0);

/// Maximum dead zone: beyond it nothing of an axis is left.
const DEAD_ZONE_MAX: f64 = 0.9;

/// Maximum length of an OSC address or of a tracker's name, in bytes.
const ADDRESS_BYTES_MAX: usize = 255;

/// The devices of a wall file.
pub(super) fn devices(
    source: &SourceText<'_>,
    sections: &[DeviceSection],
) -> Result<Vec<Device>, WallFileError> {
    if sections.len() > DEVICES_MAX {
        let what = format!("the wall has {} devices", sections.len());
        return Err(source.error("device", what, format!("{DEVICES_MAX} are possible")));
    }
    let mut devices: Vec<Device> = Vec::with_capacity(sections.len());
    for (index, section) in sections.iter().enumerate() {
        let entry = DeviceEntry { source, key: format!("device[{index}]"), section };
        let device = entry.device()?;
        entry.check_others(&device, &devices)?;
        devices.push(device);
    }
    Ok(devices)
}

/// A section with its place in the file.
struct DeviceEntry<'a> {
    source: &'a SourceText<'a>,
    key: String,
    section: &'a DeviceSection,
}

impl DeviceEntry<'_> {
    fn error(
        &self,
        key: &str,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> WallFileError {
        self.source.error(format!("{}.{key}", self.key), what, remedy)
    }

    fn device(&self) -> Result<Device, WallFileError> {
        let section = self.section;
        check_name(self.source, &format!("{}.name", self.key), &section.name)?;
        self.check_whole("lost_ms", section.lost_ms, LOST_MS, 500)?;
        let head = section.head.as_ref().map(|head| self.head(head)).transpose()?;
        let fly = section.fly.as_ref().map(|fly| self.fly(fly)).transpose()?;
        if head.is_none() && fly.is_none() {
            let what = format!("device {} moves nothing", section.name);
            return Err(self.error("head", what, "add [device.head] or [device.fly] below it"));
        }
        Ok(Device {
            name: section.name.clone(),
            source: self.source()?,
            lost_ms: section.lost_ms,
            frame: self.frame(&section.frame)?,
            head,
            fly,
        })
    }

    /// Refuses what two devices cannot share.
    fn check_others(&self, device: &Device, others: &[Device]) -> Result<(), WallFileError> {
        let is_named = |other: &&Device| other.name.eq_ignore_ascii_case(&device.name);
        if let Some(other) = others.iter().find(is_named) {
            let what = format!("two devices are called {:?}", other.name);
            return Err(self.error("name", what, "give each a name of its own"));
        }
        if let Some(other) = others.iter().find(|other| other.source == device.source) {
            let what = format!("device {} reads {} already", other.name, device.source.place());
            let key = self.place_key();
            return Err(self.error(key, what, "write both into one [[device]], or another place"));
        }
        let is_tracked = |other: &&Device| other.head.is_some() && device.head.is_some();
        if let Some(other) = others.iter().find(is_tracked) {
            let what = format!("device {} tracks the head already", other.name);
            return Err(self.error("head", what, "leave [device.head] to one of them"));
        }
        Ok(())
    }

    /// The key of the source's place.
    fn place_key(&self) -> &'static str {
        match self.section.kind {
            DeviceKind::Osc => "listen",
            DeviceKind::Vrpn => "server",
            DeviceKind::Joystick | DeviceKind::Spacenav => "path",
        }
    }

    fn source(&self) -> Result<DeviceSource, WallFileError> {
        let DeviceSection { listen, server, path, .. } = self.section;
        let kind = ["osc", "vrpn", "joystick", "spacenav"][self.section.kind as usize];
        let wanted = self.place_key();
        let places = [("listen", listen), ("server", server), ("path", path)];
        let odd = places.iter().find(|(key, place)| *key != wanted && place.is_some());
        if let Some((key, _)) = odd {
            let what = format!("a device of kind {kind:?} has no {key}");
            return Err(self.error(key, what, format!("take it away, or write {wanted} instead")));
        }
        let place =
            places.into_iter().find_map(|(key, place)| place.clone().filter(|_| key == wanted));
        let Some(place) = place else {
            let remedy = match self.section.kind {
                DeviceKind::Osc => "add listen = \"127.0.0.1:9000\"",
                DeviceKind::Vrpn => "add server = \"HOST:3883\"",
                DeviceKind::Joystick => "add path = \"/dev/input/js0\"",
                DeviceKind::Spacenav => "add path = \"/var/run/spnav.sock\"",
            };
            return Err(self.error(wanted, "the key is missing", remedy));
        };
        match self.section.kind {
            DeviceKind::Osc if place.parse::<SocketAddr>().is_err() => {
                let what = format!("{place:?} is no address with a port");
                Err(self.error(wanted, what, "write ADDRESS:PORT, such as \"0.0.0.0:9000\""))
            }
            DeviceKind::Vrpn if !is_host_and_port(&place) => {
                let what = format!("{place:?} is no host with a port");
                Err(self.error(wanted, what, "write HOST:PORT, such as \"tracker-pc:3883\""))
            }
            DeviceKind::Joystick | DeviceKind::Spacenav
                if place.is_empty() || place.contains('\0') || place.len() > PATH_BYTES_MAX =>
            {
                let what = format!("{:?} is no path", place.chars().take(80).collect::<String>());
                Err(self.error(wanted, what, "write a path that begins with \"/\""))
            }
            DeviceKind::Osc => Ok(DeviceSource::Osc { listen: place }),
            DeviceKind::Vrpn => Ok(DeviceSource::Vrpn { server: place }),
            DeviceKind::Joystick => Ok(DeviceSource::Joystick { path: place }),
            DeviceKind::Spacenav => Ok(DeviceSource::Spacenav { path: place }),
        }
    }

    fn frame(&self, section: &FrameSection) -> Result<TrackerFrame, WallFileError> {
        let mut axes = [SignedAxis { index: 0, is_negative: false }; 3];
        for (index, text) in section.axes.iter().enumerate() {
            let (is_negative, letter) = match text.strip_prefix('-') {
                Some(letter) => (true, letter),
                None => (false, text.strip_prefix('+').unwrap_or(text)),
            };
            let found = ["x", "y", "z"].iter().position(|name| *name == letter);
            let is_new =
                found.filter(|at| axes[..index].iter().all(|a| usize::from(a.index) != *at));
            let Some(at) = is_new else {
                let what = match found {
                    Some(_) => format!("the axis {letter} stands twice, so this is no rotation"),
                    None => format!("{text:?} is no axis"),
                };
                let remedy = "write each of x, y and z once, \"-\" before it for its opposite";
                return Err(self.error(&format!("frame.axes[{index}]"), what, remedy));
            };
            axes[index] = SignedAxis { index: at as u8, is_negative };
        }
        self.check_number(
            "frame.unit",
            section.unit,
            UNIT_RANGE_M,
            "1.0, or 0.001 for millimetres",
        )?;
        let key = format!("{}.frame", self.key);
        let reach = HEAD_REACH_MAX_M;
        check_numbers(self.source, &format!("{key}.origin"), &section.origin, reach, "metres")?;
        Ok(TrackerFrame {
            axes,
            unit_m: section.unit,
            origin: DVec3::from_array(section.origin),
            rotation: rotation(self.source, &format!("{key}.rotation"), section.rotation)?,
        })
    }

    fn head(&self, section: &HeadSection) -> Result<HeadTracking, WallFileError> {
        let key = |name: &str| format!("{}.head.{name}", self.key);
        let input = self.head_input(section)?;
        check_numbers(self.source, &key("eyes"), &section.eyes, EYES_MAX_M, "metres")?;
        self.check_whole("head.prediction_ms", section.prediction_ms, (0, PREDICTION_MS_MAX), 20)?;
        self.check_whole("head.hold_ms", section.hold_ms, (0, HOLD_MS_MAX), 2000)?;
        self.check_whole("head.ease_ms", section.ease_ms, EASE_MS, 1000)?;
        self.check_number("head.speed_max", section.speed_max, SPEED_RANGE, "5.0")?;
        self.check_number("head.jump", section.jump, JUMP_RANGE_M, "0.3")?;
        let bounds = section.bounds.map(|corners| corners.map(|row| row.0));
        for (index, corner) in bounds.iter().flatten().enumerate() {
            let key = format!("{}[{index}]", key("bounds"));
            check_numbers(self.source, &key, corner, HEAD_REACH_MAX_M, "metres")?;
        }
        let bounds = bounds.map(|corners| corners.map(DVec3::from_array));
        if let Some([low, high]) = bounds.filter(|[low, high]| low.cmpge(*high).any()) {
            let what = format!("the corner {low} is not below {high} along each axis");
            let remedy = "write the corner with the lower coordinates first";
            return Err(self.error("head.bounds", what, remedy));
        }
        Ok(HeadTracking {
            input,
            mount: rotation(self.source, &key("mount"), section.mount)?,
            eyes: DVec3::from_array(section.eyes),
            prediction_ms: section.prediction_ms,
            speed_max: section.speed_max,
            jump_m: section.jump,
            hold_ms: section.hold_ms,
            ease_ms: section.ease_ms,
            bounds,
        })
    }

    fn head_input(&self, section: &HeadSection) -> Result<HeadInput, WallFileError> {
        let HeadSection { pose, position, rotation, form, order, tracker, sensor, .. } = section;
        let of_osc = [
            ("pose", pose.is_some()),
            ("position", position.is_some()),
            ("rotation", rotation.is_some()),
            ("form", form.is_some()),
            ("order", order.is_some()),
        ];
        let of_vrpn = [("tracker", tracker.is_some()), ("sensor", sensor.is_some())];
        let (kind, wrong): (_, &[_]) = match self.section.kind {
            DeviceKind::Osc => ("osc", &of_vrpn),
            DeviceKind::Vrpn => ("vrpn", &of_osc),
            DeviceKind::Joystick | DeviceKind::Spacenav => {
                let what = "a joystick or 3D mouse tracks no head";
                return Err(self.error("head", what, "use kind = \"osc\" or \"vrpn\""));
            }
        };
        if let Some((key, _)) = wrong.iter().find(|(_, is_there)| *is_there) {
            let what = format!("a head by {kind} has no {key}");
            return Err(self.error(&format!("head.{key}"), what, "take it away"));
        }
        if self.section.kind == DeviceKind::Vrpn {
            let tracker = tracker.clone().unwrap_or_default();
            if !is_tracker_name(&tracker) {
                let what = format!("{tracker:?} is no name of a tracker");
                let remedy = "write the name at the server, such as tracker = \"Tracker0\"";
                return Err(self.error("head.tracker", what, remedy));
            }
            return Ok(HeadInput::Vrpn { tracker, sensor: sensor.unwrap_or(0) });
        }
        let (key, first) = match (pose, position) {
            (Some(pose), None) => ("pose", pose),
            (None, Some(position)) => ("position", position),
            (Some(_), Some(_)) => {
                let what = "there is a pose already, which has a position";
                return Err(self.error("head.position", what, "write one of both"));
            }
            (None, None) => {
                let what = "nothing says where the head is";
                return Err(self.error("head.pose", what, "add pose = \"/ADDRESS\", or position"));
            }
        };
        self.check_address(&format!("head.{key}"), first)?;
        if let (Some(_), Some(_)) = (pose, rotation) {
            let what = "there is a pose already, which has a rotation";
            return Err(self.error("head.rotation", what, "write position instead of pose"));
        }
        if let Some(rotation) = rotation {
            self.check_address("head.rotation", rotation)?;
            if rotation == first {
                let what = format!("{rotation} is the address of the position already");
                let remedy = "write pose instead of both if one message has both";
                return Err(self.error("head.rotation", what, remedy));
            }
        }
        let has_rotation = pose.is_some() || rotation.is_some();
        if !has_rotation {
            self.refuse_rotation_keys(section)?;
        }
        let form = has_rotation.then(|| self.form(*form, order.as_deref()));
        Ok(HeadInput::Osc {
            position: first.clone(),
            rotation: rotation.clone(),
            form: form.transpose()?,
        })
    }

    /// Refuses what needs a tracked rotation, where there is none.
    fn refuse_rotation_keys(&self, section: &HeadSection) -> Result<(), WallFileError> {
        let keys = [
            ("form", section.form.is_some()),
            ("order", section.order.is_some()),
            ("mount", section.mount.is_some()),
        ];
        let Some((key, _)) = keys.iter().find(|(_, is_there)| *is_there) else { return Ok(()) };
        let what = format!("there is no rotation, which {key} needs");
        let remedy = "add rotation = \"/ADDRESS\", write pose instead of position, or take it away";
        Err(self.error(&format!("head.{key}"), what, remedy))
    }

    fn form(
        &self,
        form: Option<FormChoice>,
        order: Option<&str>,
    ) -> Result<RotationForm, WallFileError> {
        let is_degrees = match form {
            Some(FormChoice::EulerDegrees) => true,
            Some(FormChoice::EulerRadians) => false,
            _ if order.is_some() => {
                let what = "only angles have an order";
                return Err(self.error("head.order", what, "add form = \"euler-degrees\""));
            }
            Some(FormChoice::Matrix) => return Ok(RotationForm::Matrix),
            Some(FormChoice::QuaternionWxyz) => return Ok(RotationForm::QuaternionWxyz),
            Some(FormChoice::Quaternion) | None => return Ok(RotationForm::Quaternion),
        };
        let order = order.unwrap_or("yxz");
        let axis = |letter: char| "xyz".find(letter).map(|at| at as u8);
        let axes: Option<Vec<u8>> = order.chars().map(axis).collect();
        let axes = axes.and_then(|axes| <[u8; 3]>::try_from(axes).ok());
        // Two turns about one axis without another between are one turn.
        if let Some(axes) = axes.filter(|[a, b, c]| a != b && b != c) {
            return Ok(RotationForm::Euler { order: EulerOrder(axes), is_degrees });
        }
        let what = format!("{order:?} is no order of axes");
        Err(self.error("head.order", what, "write three of x, y and z, such as \"yxz\""))
    }

    fn fly(&self, section: &FlySection) -> Result<FlyControls, WallFileError> {
        let FlySection { right, up, forward, turn, pitch, .. } = section;
        let one = |name: &str, text: &Option<String>| -> Result<Option<Control>, WallFileError> {
            let Some(text) = text else { return Ok(None) };
            let found = control(self.section.kind, text);
            let found = found.map(Some);
            found.map_err(|(what, remedy)| self.error(&format!("fly.{name}"), what, remedy))
        };
        let controls = FlyControls {
            right: one("right", right)?,
            up: one("up", up)?,
            forward: one("forward", forward)?,
            turn: one("turn", turn)?,
            pitch: one("pitch", pitch)?,
            speed: section.speed,
            turn_speed: section.turn_speed.to_radians(),
            dead_zone: section.dead_zone,
        };
        if controls.controls().iter().all(Option::is_none) {
            let remedy = "add right, up, forward, turn or pitch";
            return Err(self.error("fly", "no control moves anything", remedy));
        }
        self.check_number("fly.speed", section.speed, SPEED_RANGE, "1.0")?;
        self.check_number("fly.turn_speed", section.turn_speed, TURN_RANGE, "60.0")?;
        self.check_number("fly.dead_zone", section.dead_zone, (0.0, DEAD_ZONE_MAX), "0.1")?;
        Ok(controls)
    }

    fn check_address(&self, key: &str, address: &str) -> Result<(), WallFileError> {
        if is_osc_address(address) {
            return Ok(());
        }
        let what = format!("{:?} is no OSC address", address.chars().take(80).collect::<String>());
        Err(self.error(key, what, "write \"/\" and names, such as \"/head/pose\""))
    }

    fn check_whole(
        &self,
        key: &str,
        found: u32,
        (low, high): (u32, u32),
        such_as: u32,
    ) -> Result<(), WallFileError> {
        if (low..=high).contains(&found) {
            return Ok(());
        }
        let what = format!("{found} milliseconds are not possible");
        Err(self.error(key, what, format!("write {low} to {high}, such as {such_as}")))
    }

    fn check_number(
        &self,
        key: &str,
        found: f64,
        (low, high): (f64, f64),
        such_as: &str,
    ) -> Result<(), WallFileError> {
        if (low..=high).contains(&found) {
            return Ok(());
        }
        let what = format!("{found:?} is not possible");
        Err(self.error(
            key,
            what,
            format!("write a number from {low} to {high}, such as {such_as}"),
        ))
    }
}

/// Returns whether this is an address that OSC 1.0 messages can have: no pattern.
pub(super) fn is_osc_address(address: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_graphic() && !"#*,?[]{}".contains(c);
    (2..=ADDRESS_BYTES_MAX).contains(&address.len())
        && address.starts_with('/')
        && address.chars().all(is_plain)
}

/// Returns whether a VRPN server can have a tracker of this name, such as "Rigid Body 1": in VRPN
/// the host follows a "@".
fn is_tracker_name(name: &str) -> bool {
    let is_plain = |c: char| !c.is_control() && c != '@';
    (1..=ADDRESS_BYTES_MAX).contains(&name.len())
        && name.trim() == name
        && name.chars().all(is_plain)
}

fn is_host_and_port(place: &str) -> bool {
    let Some((host, port)) = place.rsplit_once(':') else { return false };
    let letters = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '.' | ':' | '[' | ']');
    let is_host = (1..=253).contains(&host.len()) && host.chars().all(letters);
    is_host && port.parse::<u16>().is_ok_and(|port| port > 0)
}
