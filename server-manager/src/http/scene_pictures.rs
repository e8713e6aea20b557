//! Small pictures of scenes, as the wall last showed them while somebody watched.

use std::collections::VecDeque;

use polyptych_protocol::feedback::WallStatus;

use super::picture::Picture;

/// Maximum number of scenes with a picture; the one that was shown longest ago is forgotten.
const SCENES_MAX: usize = 64;

/// Width of a picture in pixels: with its height, 150 KB in memory.
const WIDTH: u32 = 240;

/// The pictures, the last one shown last.
#[derive(Debug, Default)]
pub(super) struct ScenePictures {
    /// The scene that the last status said to be shown, and nothing over it.
    shown: Option<String>,
    /// A picture that was taken since; it is of that scene if the next status says the same.
    taken: Option<Picture>,
    pictures: VecDeque<(String, Picture)>,
}

impl ScenePictures {
    /// Takes what a status says to be shown.
    pub fn follow(&mut self, status: &WallStatus) {
        let presented = &status.presentation;
        let is_bare = presented.pattern.is_none() && presented.views.is_empty();
        let shown = status.scene.clone().filter(|_| is_bare && status.opening.is_empty());
        let taken = self.taken.take().filter(|_| shown == self.shown);
        self.shown = shown;
        let Some((name, picture)) = self.shown.clone().zip(taken) else { return };
        self.pictures.retain(|(of, _)| *of != name);
        if self.pictures.len() >= SCENES_MAX {
            self.pictures.pop_front();
        }
        self.pictures.push_back((name, picture));
    }

    /// Returns whether a picture of the wall is wanted now: once for each status.
    pub fn wants(&self) -> bool {
        self.shown.is_some() && self.taken.is_none()
    }

    /// Takes a picture of the wall.
    pub fn take(&mut self, wall: Picture) {
        self.taken = Some(wall.scaled(WIDTH));
    }

    /// Returns the names of scenes that have a picture, in order.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<_> = self.pictures.iter().map(|(name, _)| name.clone()).collect();
        names.sort_unstable();
        names
    }

    /// Returns the picture of a scene.
    pub fn find(&self, name: &str) -> Option<Picture> {
        let found = self.pictures.iter().find(|(of, _)| of == name);
        found.map(|(_, picture)| picture.clone())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use polyptych_protocol::ids::{Digest, Epoch, FrameId, Revision};
    use polyptych_protocol::pattern::TestPattern;
    use polyptych_protocol::presentation::Presentation;
    use polyptych_protocol::screen_rest::RestStatus;
    use polyptych_wall::head::HeadPose;

    use super::*;

    /// The status of a wall without channels.
    pub(in crate::http) fn status(scene: Option<&str>) -> WallStatus {
        let head = HeadPose::facing_forward(glam::DVec3::ZERO, 0.06);
        WallStatus {
            wall: "w".into(),
            epoch: Epoch(1),
            revision: Revision(1),
            digest: Digest(1),
            frame: FrameId(1),
            scene: scene.map(str::to_owned),
            deadline_ms: 50.0,
            error_in_force_px: 0.0,
            presentation: Presentation::new(head),
            channels: Vec::new(),
            clients: Vec::new(),
            warnings: Vec::new(),
            notes: Vec::new(),
            opening: Vec::new(),
            memory_bytes: 0,
            resolution_scale: 1.0,
            environment: None,
            rest: RestStatus::default(),
            devices: Vec::new(),
            leader: None,
        }
    }

    fn picture(code: u8) -> Picture {
        Picture { width: 2, height: 1, rgba: vec![code; 8] }
    }

    #[test]
    fn a_picture_is_kept_if_its_scene_is_still_shown() {
        let mut pictures = ScenePictures::default();
        assert!(!pictures.wants());
        pictures.follow(&status(Some("town")));
        assert!(pictures.wants());
        pictures.take(picture(1));
        assert!(!pictures.wants() && pictures.names().is_empty());
        pictures.follow(&status(Some("town")));
        assert_eq!(pictures.find("town"), Some(picture(1)));
        // Whose it is cannot be told where another scene came meanwhile.
        pictures.take(picture(2));
        pictures.follow(&status(Some("boat")));
        assert_eq!((pictures.find("town"), pictures.find("boat")), (Some(picture(1)), None));
        pictures.take(picture(3));
        let patterned = WallStatus {
            presentation: Presentation {
                pattern: Some(TestPattern::Grid),
                ..status(None).presentation
            },
            ..status(Some("boat"))
        };
        pictures.follow(&patterned);
        assert!(!pictures.wants() && pictures.find("boat").is_none());
    }

    #[test]
    fn the_scene_that_was_shown_longest_ago_is_forgotten() {
        let mut pictures = ScenePictures::default();
        for scene in 0..=SCENES_MAX {
            let name = format!("{scene:03}");
            pictures.follow(&status(Some(&name)));
            pictures.take(picture(scene as u8));
            pictures.follow(&status(Some(&name)));
        }
        assert_eq!((pictures.names().len(), pictures.find("000")), (SCENES_MAX, None));
        assert_eq!(pictures.names()[0], "001");
    }
}
