//! What displays show of what was drawn, and which words over it: without sockets, GPU or clock.

use polyptych_protocol::display::DisplayMode;

use crate::notice::{ManagerState, Notice};

/// What the displays of this server show.
#[derive(Debug, Default)]
pub struct Showing {
    mode: DisplayMode,
    face: Face,
    notice: Option<Notice>,
    /// The words that the picture is old, and since when.
    outdated: Option<String>,
    /// The wall was stopped: pictures from before are not shown any more.
    is_stopped: bool,
}

/// What was shown before displays froze goes on being shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Face {
    #[default]
    Plain,
    Named,
    Black,
}

/// What one display shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Look {
    /// The picture that it took last.
    Picture {
        /// With what the display is over it.
        is_named: bool,
        /// The words that the picture is old, and since when.
        outdated: Option<String>,
    },
    /// Words instead of a picture, as there is none.
    Idle {
        /// Why, where the connection has said something.
        notice: Option<Notice>,
        /// It came while the displays were frozen.
        is_frozen: bool,
    },
    /// Nothing at all.
    Black,
}

impl Showing {
    /// The connection stands otherwise.
    pub fn handle_notice(&mut self, notice: Notice) {
        let words = match notice.manager {
            ManagerState::Lost => Some("manager lost since"),
            ManagerState::Ended => Some("manager stopped since"),
            ManagerState::Expected | ManagerState::Stopped => None,
        };
        if let Some(words) = words
            && self.outdated.is_none()
        {
            // Until a frame is shown the picture is as old as the first loss.
            self.outdated = Some(format!("{words} {}", notice.since));
        }
        self.is_stopped |= notice.manager == ManagerState::Stopped;
        self.notice = Some(notice);
    }

    /// A frame is shown that carries this mode. Gives whether displays take its picture.
    pub fn handle_show(&mut self, mode: DisplayMode) -> bool {
        self.outdated = None;
        // Frozen displays keep what they show: that the wall was stopped.
        self.is_stopped &= mode == DisplayMode::Freeze;
        self.mode = mode;
        self.face = match mode {
            DisplayMode::Normal => Face::Plain,
            DisplayMode::Identify => Face::Named,
            DisplayMode::Blank => Face::Black,
            DisplayMode::Freeze => return false,
        };
        true
    }

    /// What a display shows now that has taken a picture, or has not.
    pub fn look(&self, has_picture: bool) -> Look {
        match self.face {
            // Not even that the manager is lost: who made the wall black wants it dark.
            Face::Black => Look::Black,
            Face::Plain | Face::Named if !has_picture || self.is_stopped => {
                let is_frozen = self.mode == DisplayMode::Freeze;
                Look::Idle { notice: self.notice.clone(), is_frozen }
            }
            face => {
                let is_named = face == Face::Named;
                Look::Picture { is_named, outdated: self.outdated.clone() }
            }
        }
    }

    /// How the connection stands.
    pub fn notice(&self) -> Option<&Notice> {
        self.notice.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notice(since: &str, manager: ManagerState) -> Notice {
        let what = "as it stands".to_owned();
        Notice { what, since: since.into(), address: None, manager }
    }

    fn picture(is_named: bool, outdated: Option<&str>) -> Look {
        Look::Picture { is_named, outdated: outdated.map(str::to_owned) }
    }

    #[test]
    fn each_mode_has_its_look_and_ends_with_the_next_frame() {
        let mut showing = Showing::default();
        assert_eq!(showing.look(false), Look::Idle { notice: None, is_frozen: false });
        assert!(showing.handle_show(DisplayMode::Normal));
        assert_eq!(showing.look(true), picture(false, None));
        assert!(showing.handle_show(DisplayMode::Identify));
        assert_eq!(showing.look(true), picture(true, None));
        assert!(showing.handle_show(DisplayMode::Blank));
        assert_eq!((showing.look(true), showing.look(false)), (Look::Black, Look::Black));
        assert!(showing.handle_show(DisplayMode::Normal));
        assert_eq!(showing.look(true), picture(false, None));
    }

    #[test]
    fn frozen_displays_keep_what_they_show_whatever_that_is() {
        let mut showing = Showing::default();
        for (before, look) in [
            (DisplayMode::Normal, picture(false, None)),
            (DisplayMode::Identify, picture(true, None)),
            (DisplayMode::Blank, Look::Black),
        ] {
            showing.handle_show(before);
            assert!(!showing.handle_show(DisplayMode::Freeze), "no picture is taken");
            assert_eq!(showing.look(true), look, "{before:?}");
        }
    }

    #[test]
    fn a_display_that_starts_while_others_are_frozen_says_so() {
        let mut showing = Showing::default();
        let ready = notice("10:00:00 UTC", ManagerState::Expected);
        showing.handle_notice(ready.clone());
        showing.handle_show(DisplayMode::Freeze);
        assert_eq!(showing.look(false), Look::Idle { notice: Some(ready), is_frozen: true });
    }

    #[test]
    fn a_lost_manager_is_told_since_the_first_loss_until_a_frame_is_shown() {
        let mut showing = Showing::default();
        showing.handle_show(DisplayMode::Normal);
        showing.handle_notice(notice("10:00:00 UTC", ManagerState::Lost));
        assert_eq!(showing.look(true), picture(false, Some("manager lost since 10:00:00 UTC")));
        showing.handle_notice(notice("10:00:09 UTC", ManagerState::Expected));
        assert_eq!(
            showing.look(true),
            picture(false, Some("manager lost since 10:00:00 UTC")),
            "no frame yet"
        );
        showing.handle_notice(notice("10:00:12 UTC", ManagerState::Lost));
        assert_eq!(showing.look(true), picture(false, Some("manager lost since 10:00:00 UTC")));
        showing.handle_show(DisplayMode::Freeze);
        assert_eq!(showing.look(true), picture(false, None), "whatever the frame says");
    }

    #[test]
    fn a_manager_that_was_ended_leaves_the_last_frame_with_that_word() {
        let mut showing = Showing::default();
        showing.handle_show(DisplayMode::Normal);
        showing.handle_notice(notice("10:00:00 UTC", ManagerState::Ended));
        let outdated = "manager stopped since 10:00:00 UTC";
        assert_eq!(showing.look(true), picture(false, Some(outdated)));
        showing.handle_show(DisplayMode::Normal);
        assert_eq!(showing.look(true), picture(false, None));
    }

    #[test]
    fn a_stopped_wall_shows_words_until_the_next_frame() {
        let mut showing = Showing::default();
        showing.handle_show(DisplayMode::Identify);
        let stopped = notice("10:00:00 UTC", ManagerState::Stopped);
        showing.handle_notice(stopped.clone());
        let idle =
            |notice: &Notice, is_frozen| Look::Idle { notice: Some(notice.clone()), is_frozen };
        assert_eq!(showing.look(true), idle(&stopped, false));
        let next = notice("10:00:09 UTC", ManagerState::Expected);
        showing.handle_notice(next.clone());
        assert_eq!(showing.look(true), idle(&next, false), "the old picture stays away");
        showing.handle_show(DisplayMode::Freeze);
        assert_eq!(showing.look(true), idle(&next, true));
        showing.handle_show(DisplayMode::Normal);
        assert_eq!(showing.look(true), picture(false, None));
        showing.handle_show(DisplayMode::Blank);
        showing.handle_notice(stopped);
        assert_eq!(showing.look(true), Look::Black, "who made the wall black wants it dark");
    }

    #[test]
    fn a_black_display_stays_black_without_a_manager() {
        let mut showing = Showing::default();
        showing.handle_show(DisplayMode::Blank);
        showing.handle_notice(notice("10:00:00 UTC", ManagerState::Lost));
        assert_eq!((showing.look(true), showing.look(false)), (Look::Black, Look::Black));
    }
}
