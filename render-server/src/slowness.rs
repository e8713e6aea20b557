//! Draws slower than it could, where it is told to: for tests of how a wall bears it.

use std::path::PathBuf;
use std::time::Duration;

/// The most that a frame is slowed by: a server that is to end is asked between frames.
const SLOWNESS_MAX: Duration = Duration::from_mins(1);

/// How much longer every frame takes, as a file says. The file is read before each frame, so that
/// it can change while the server draws.
#[derive(Debug)]
pub(crate) struct Slowness {
    file: Option<PathBuf>,
}

impl Slowness {
    /// As the file says; not slowed without one.
    pub fn new(file: Option<PathBuf>) -> Self {
        Self { file }
    }

    /// Takes the time that a frame is to take longer.
    pub fn wait(&self) {
        let length = self.length();
        if !length.is_zero() {
            std::thread::sleep(length);
        }
    }

    fn length(&self) -> Duration {
        let Some(file) = &self.file else { return Duration::ZERO };
        // Without the file, or with nonsense in it, there is nothing to wait for.
        let text = std::fs::read_to_string(file).unwrap_or_default();
        text.trim().parse().map_or(Duration::ZERO, Duration::from_millis).min(SLOWNESS_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_says_how_much_longer_a_frame_takes() {
        assert_eq!(Slowness::new(None).length(), Duration::ZERO);
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("slow");
        let slowness = Slowness::new(Some(file.clone()));
        for (text, length) in [
            (None, Duration::ZERO),
            (Some("200\n"), Duration::from_millis(200)),
            (Some("soon"), Duration::ZERO),
            (Some("99999999"), SLOWNESS_MAX),
        ] {
            if let Some(text) = text {
                std::fs::write(&file, text).expect("written");
            }
            assert_eq!(slowness.length(), length, "{text:?}");
        }
    }
}
