//! From a screen's section to a surface that is no rectangle: cylinder, sphere or mesh.

use glam::DVec3;
use polyptych_wall::surface::{Cylinder, Sphere};
use polyptych_wall::{CalibrationFileKind, Surface};

use super::check::{COORDINATE_MAX_M, check_numbers};
use super::document::{CylinderSection, SphereSection};
use super::error::WallFileError;
use super::files::Files;
use super::rotation::rotation;
use super::screen::{PlacedSection, SCREEN_SIDE_MIN_M};

/// Fewest degrees that a patch spans: less is a slip of the unit, and nearly a plane.
const SWEEP_DEGREES_MIN: f64 = 0.01;

impl PlacedSection<'_> {
    /// The screen's surface where it is no rectangle; `None` where it is one.
    pub fn curved(&self, files: &mut Files) -> Result<Option<Surface>, WallFileError> {
        let s = self.section;
        let forms = [
            ("cylinder", s.cylinder.is_some()),
            ("sphere", s.sphere.is_some()),
            ("mesh", s.mesh.is_some()),
            ("lower_left", s.lower_left.is_some()),
            ("lower_right", s.lower_right.is_some()),
            ("upper_left", s.upper_left.is_some()),
            ("size", s.size.is_some()),
            ("center", s.center.is_some()),
            ("rotation", s.rotation.is_some()),
        ];
        let mut given = forms.iter().filter(|(_, given)| *given).map(|(name, _)| *name);
        let first = given.next();
        let is_curved = matches!(first, Some("cylinder" | "sphere" | "mesh"));
        if let (Some(first), Some(second), true) = (first, given.next(), is_curved) {
            let what = format!("the screen's place is given twice, by {first} and by {second}");
            return Err(self.error(second, what, "keep one of the two"));
        }
        Ok(match (&s.cylinder, &s.sphere, &s.mesh) {
            (Some(section), _, _) => Some(Surface::Cylinder(self.cylinder(section)?)),
            (_, Some(section), _) => Some(Surface::Sphere(self.sphere(section)?)),
            (_, _, Some(path)) => {
                let key = self.key("mesh");
                Some(Surface::Mesh(files.index(
                    self.source,
                    &key,
                    path,
                    CalibrationFileKind::ScreenMesh,
                )?))
            }
            _ => None,
        })
    }

    fn cylinder(&self, section: &CylinderSection) -> Result<Cylinder, WallFileError> {
        let key = |name: &str| self.key(&format!("cylinder.{name}"));
        self.check_round("cylinder", section.radius, &section.center)?;
        self.check_sweep("cylinder.degrees", section.degrees)?;
        check_numbers(self.source, &key("height"), &section.height, COORDINATE_MAX_M, "metres")?;
        let [bottom, top] = section.height;
        if top - bottom < SCREEN_SIDE_MIN_M {
            let what = format!("a cylinder from {bottom} to {top} metres has no height");
            let remedy = "write [bottom, top] in metres, the top above the bottom";
            return Err(self.error("cylinder.height", what, remedy));
        }
        Ok(Cylinder {
            center: DVec3::from_array(section.center),
            rotation: rotation(self.source, &key("rotation"), section.rotation)?,
            radius_m: section.radius,
            azimuth_rad: section.degrees.map(f64::to_radians),
            height_m: section.height,
        })
    }

    fn sphere(&self, section: &SphereSection) -> Result<Sphere, WallFileError> {
        let key = |name: &str| self.key(&format!("sphere.{name}"));
        self.check_round("sphere", section.radius, &section.center)?;
        self.check_sweep("sphere.azimuth", section.azimuth)?;
        check_numbers(self.source, &key("elevation"), &section.elevation, 90.0, "degrees")?;
        let [bottom, top] = section.elevation;
        if top - bottom < SWEEP_DEGREES_MIN {
            let what = format!("a sphere from {bottom}° to {top}° above its equator has no height");
            let remedy = "write [bottom, top] in degrees from -90 to 90, the top above the bottom";
            return Err(self.error("sphere.elevation", what, remedy));
        }
        Ok(Sphere {
            center: DVec3::from_array(section.center),
            rotation: rotation(self.source, &key("rotation"), section.rotation)?,
            radius_m: section.radius,
            azimuth_rad: section.azimuth.map(f64::to_radians),
            elevation_rad: section.elevation.map(f64::to_radians),
        })
    }

    fn check_round(&self, form: &str, radius: f64, center: &[f64; 3]) -> Result<(), WallFileError> {
        let key = self.key(&format!("{form}.center"));
        check_numbers(self.source, &key, center, COORDINATE_MAX_M, "metres")?;
        if (SCREEN_SIDE_MIN_M..=COORDINATE_MAX_M).contains(&radius) {
            return Ok(());
        }
        let what = format!("a radius of {radius:?} metres is not possible");
        let remedy = format!("write a number from {SCREEN_SIDE_MIN_M} to {COORDINATE_MAX_M}");
        Err(self.error(&format!("{form}.radius"), what, &remedy))
    }

    fn check_sweep(&self, name: &str, degrees: [f64; 2]) -> Result<(), WallFileError> {
        check_numbers(self.source, &self.key(name), &degrees, 360.0, "degrees")?;
        let [left, right] = degrees;
        let sweep = (right - left).abs();
        if (SWEEP_DEGREES_MIN..=360.0).contains(&sweep) {
            return Ok(());
        }
        let what = format!("from {left}° to {right}° are {sweep}°");
        let remedy = format!("write [left, right], {SWEEP_DEGREES_MIN} to 360 degrees apart");
        Err(self.error(name, what, &remedy))
    }
}
