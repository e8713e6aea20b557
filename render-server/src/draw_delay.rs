//! Draws slower than it could, or loses its GPU, where it is told to: for tests of how a wall
//! bears it.

use std::path::PathBuf;
use std::time::Duration;

use polyptych_renderer::GpuFaultKind;

/// The most that a frame is slowed by: a server that is to end is asked between frames.
const SLOWNESS_MAX: Duration = Duration::from_mins(1);

/// The delay or fault that a file demands for the next frame. The file is read before each frame,
/// so that it can change while the server draws.
#[derive(Debug)]
pub(crate) struct DrawDelay {
    file: Option<PathBuf>,
}

impl DrawDelay {
    /// Creates the delay that this file demands; without a file there is none.
    pub fn new(file: Option<PathBuf>) -> Self {
        Self { file }
    }

    /// Takes the time that a frame is to take longer, or returns the fault that the GPU is to have
    /// instead. Such a file is removed, so that this happens once.
    pub fn wait(&self) -> Option<GpuFaultKind> {
        let file = self.file.as_ref()?;
        // Without the file, or with nonsense in it, there is nothing to wait for.
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let fault = match text.trim() {
            "lose" => Some(GpuFaultKind::Lost),
            "fill" => Some(GpuFaultKind::OutOfMemory),
            "hang" => Some(GpuFaultKind::Hangs),
            milliseconds => {
                let length = length(milliseconds);
                if !length.is_zero() {
                    std::thread::sleep(length);
                }
                None
            }
        };
        // One that can't be removed is read again, and is a fault of the next frame.
        fault.inspect(|_| drop(std::fs::remove_file(file)))
    }
}

fn length(milliseconds: &str) -> Duration {
    milliseconds.parse().map_or(Duration::ZERO, Duration::from_millis).min(SLOWNESS_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_says_how_much_longer_a_frame_takes() {
        for (text, expected) in [
            ("", Duration::ZERO),
            ("200", Duration::from_millis(200)),
            ("soon", Duration::ZERO),
            ("99999999", SLOWNESS_MAX),
        ] {
            assert_eq!(length(text), expected, "{text:?}");
        }
    }

    #[test]
    fn a_file_says_once_what_happens_to_the_gpu() {
        assert_eq!(DrawDelay::new(None).wait(), None);
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("slow");
        let slowness = DrawDelay::new(Some(file.clone()));
        assert_eq!(slowness.wait(), None, "no file");
        for (text, fault) in [
            ("lose\n", GpuFaultKind::Lost),
            ("fill", GpuFaultKind::OutOfMemory),
            ("hang", GpuFaultKind::Hangs),
        ] {
            std::fs::write(&file, text).expect("written");
            assert_eq!(slowness.wait(), Some(fault), "{text:?}");
            assert_eq!(slowness.wait(), None, "it happens once");
        }
    }
}
