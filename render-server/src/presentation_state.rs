//! The content of displays, and the words over it: without sockets, GPU or clock.

use polyptych_protocol::output_mode::OutputMode;

use crate::connection_status::{ConnectionStatus, ManagerState};

/// The state of this server's displays.
#[derive(Debug, Default)]
pub struct PresentationState {
    mode: OutputMode,
    face: ContentMode,
    notice: Option<ConnectionStatus>,
    /// The words that the picture is old, and since when.
    outdated: Option<String>,
    /// The wall was stopped: pictures from before are not shown any more.
    is_stopped: bool,
}

/// The content that stays visible while displays are frozen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ContentMode {
    #[default]
    Plain,
    Named,
    Black,
}

/// The content of one display.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DisplayContent {
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
        notice: Option<ConnectionStatus>,
        /// It came while the displays were frozen.
        is_frozen: bool,
    },
    /// Nothing at all.
    Black,
}

impl PresentationState {
    /// The connection stands otherwise.
    pub fn set_connection_status(&mut self, notice: ConnectionStatus) {
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
    pub fn frame_presented(&mut self, mode: OutputMode) -> bool {
        self.outdated = None;
        // Frozen displays keep what they show: that the wall was stopped.
        self.is_stopped &= mode == OutputMode::Freeze;
        self.mode = mode;
        self.face = match mode {
            OutputMode::Normal => ContentMode::Plain,
            OutputMode::Identify => ContentMode::Named,
            OutputMode::Blank => ContentMode::Black,
            OutputMode::Freeze => return false,
        };
        true
    }

    /// Returns the content of a display that has, or has not, taken a picture.
    pub fn content(&self, has_picture: bool) -> DisplayContent {
        match self.face {
            // Not even that the manager is lost: who made the wall black wants it dark.
            ContentMode::Black => DisplayContent::Black,
            ContentMode::Plain | ContentMode::Named if !has_picture || self.is_stopped => {
                let is_frozen = self.mode == OutputMode::Freeze;
                DisplayContent::Idle { notice: self.notice.clone(), is_frozen }
            }
            face => {
                let is_named = face == ContentMode::Named;
                DisplayContent::Picture { is_named, outdated: self.outdated.clone() }
            }
        }
    }

    /// Returns the state of the connection; `None` before the first one.
    pub fn notice(&self) -> Option<&ConnectionStatus> {
        self.notice.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notice(since: &str, manager: ManagerState) -> ConnectionStatus {
        let what = "as it stands".to_owned();
        ConnectionStatus { what, since: since.into(), address: None, manager }
    }

    fn picture(is_named: bool, outdated: Option<&str>) -> DisplayContent {
        DisplayContent::Picture { is_named, outdated: outdated.map(str::to_owned) }
    }

    #[test]
    fn each_mode_has_its_look_and_ends_with_the_next_frame() {
        let mut showing = PresentationState::default();
        assert_eq!(showing.content(false), DisplayContent::Idle { notice: None, is_frozen: false });
        assert!(showing.frame_presented(OutputMode::Normal));
        assert_eq!(showing.content(true), picture(false, None));
        assert!(showing.frame_presented(OutputMode::Identify));
        assert_eq!(showing.content(true), picture(true, None));
        assert!(showing.frame_presented(OutputMode::Blank));
        assert_eq!(
            (showing.content(true), showing.content(false)),
            (DisplayContent::Black, DisplayContent::Black)
        );
        assert!(showing.frame_presented(OutputMode::Normal));
        assert_eq!(showing.content(true), picture(false, None));
    }

    #[test]
    fn frozen_displays_keep_what_they_show_whatever_that_is() {
        let mut showing = PresentationState::default();
        for (before, look) in [
            (OutputMode::Normal, picture(false, None)),
            (OutputMode::Identify, picture(true, None)),
            (OutputMode::Blank, DisplayContent::Black),
        ] {
            showing.frame_presented(before);
            assert!(!showing.frame_presented(OutputMode::Freeze), "no picture is taken");
            assert_eq!(showing.content(true), look, "{before:?}");
        }
    }

    #[test]
    fn a_display_that_starts_while_others_are_frozen_says_so() {
        let mut showing = PresentationState::default();
        let ready = notice("10:00:00 UTC", ManagerState::Expected);
        showing.set_connection_status(ready.clone());
        showing.frame_presented(OutputMode::Freeze);
        assert_eq!(
            showing.content(false),
            DisplayContent::Idle { notice: Some(ready), is_frozen: true }
        );
    }

    #[test]
    fn a_lost_manager_is_told_since_the_first_loss_until_a_frame_is_shown() {
        let mut showing = PresentationState::default();
        showing.frame_presented(OutputMode::Normal);
        showing.set_connection_status(notice("10:00:00 UTC", ManagerState::Lost));
        assert_eq!(showing.content(true), picture(false, Some("manager lost since 10:00:00 UTC")));
        showing.set_connection_status(notice("10:00:09 UTC", ManagerState::Expected));
        assert_eq!(
            showing.content(true),
            picture(false, Some("manager lost since 10:00:00 UTC")),
            "no frame yet"
        );
        showing.set_connection_status(notice("10:00:12 UTC", ManagerState::Lost));
        assert_eq!(showing.content(true), picture(false, Some("manager lost since 10:00:00 UTC")));
        showing.frame_presented(OutputMode::Freeze);
        assert_eq!(showing.content(true), picture(false, None), "whatever the frame says");
    }

    #[test]
    fn a_manager_that_was_ended_leaves_the_last_frame_with_that_word() {
        let mut showing = PresentationState::default();
        showing.frame_presented(OutputMode::Normal);
        showing.set_connection_status(notice("10:00:00 UTC", ManagerState::Ended));
        let outdated = "manager stopped since 10:00:00 UTC";
        assert_eq!(showing.content(true), picture(false, Some(outdated)));
        showing.frame_presented(OutputMode::Normal);
        assert_eq!(showing.content(true), picture(false, None));
    }

    #[test]
    fn a_stopped_wall_shows_words_until_the_next_frame() {
        let mut showing = PresentationState::default();
        showing.frame_presented(OutputMode::Identify);
        let stopped = notice("10:00:00 UTC", ManagerState::Stopped);
        showing.set_connection_status(stopped.clone());
        let idle = |notice: &ConnectionStatus, is_frozen| DisplayContent::Idle {
            notice: Some(notice.clone()),
            is_frozen,
        };
        assert_eq!(showing.content(true), idle(&stopped, false));
        let next = notice("10:00:09 UTC", ManagerState::Expected);
        showing.set_connection_status(next.clone());
        assert_eq!(showing.content(true), idle(&next, false), "the old picture stays away");
        showing.frame_presented(OutputMode::Freeze);
        assert_eq!(showing.content(true), idle(&next, true));
        showing.frame_presented(OutputMode::Normal);
        assert_eq!(showing.content(true), picture(false, None));
        showing.frame_presented(OutputMode::Blank);
        showing.set_connection_status(stopped);
        assert_eq!(
            showing.content(true),
            DisplayContent::Black,
            "who made the wall black wants it dark"
        );
    }

    #[test]
    fn a_black_display_stays_black_without_a_manager() {
        let mut showing = PresentationState::default();
        showing.frame_presented(OutputMode::Blank);
        showing.set_connection_status(notice("10:00:00 UTC", ManagerState::Lost));
        assert_eq!(
            (showing.content(true), showing.content(false)),
            (DisplayContent::Black, DisplayContent::Black)
        );
    }
}
