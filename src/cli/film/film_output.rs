//! The output of a film: numbered PNG files, or ffmpeg.

use std::io::{ErrorKind, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, anyhow, bail};
use image::RgbaImage;
use polyptych_client::Capture;

use crate::{image_files, outputs};

/// Endings of files that ffmpeg writes.
const VIDEO_ENDINGS: [&str; 3] = ["mp4", "mkv", "webm"];

/// The frames of a film that are written.
pub(super) enum FilmOutput {
    /// A PNG for each screen and frame.
    Folder(NumberedFiles),
    /// A video of the screens side by side.
    Video(Video),
}

/// Files of a folder, numbered by frames.
pub(super) struct NumberedFiles {
    folder: PathBuf,
    /// The files of the frame after those that were written.
    next: Vec<PathBuf>,
}

/// A video that ffmpeg encodes.
pub(super) struct Video {
    path: PathBuf,
    fps: f64,
    /// From the first frame on.
    encoder: Option<Encoder>,
}

struct Encoder {
    process: Child,
    size: (u32, u32),
}

impl FilmOutput {
    /// Checks that the film can be written, and makes its folder.
    ///
    /// # Errors
    /// The obstacle, and the fix.
    pub fn new(out: &Path, fps: f64) -> anyhow::Result<Self> {
        let Some(ending) = out.extension() else {
            outputs::make_folder(out)?;
            return Ok(Self::Folder(NumberedFiles { folder: out.to_owned(), next: Vec::new() }));
        };
        if !VIDEO_ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)) {
            bail!(
                "{}: films end in .{}; a name without an ending is a folder for PNG files",
                out.display(),
                VIDEO_ENDINGS.join(", .")
            );
        }
        outputs::check(out)?;
        check_ffmpeg()?;
        Ok(Self::Video(Video { path: out.to_owned(), fps, encoder: None }))
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// The disk or ffmpeg takes nothing, or screens have another size than before.
    pub fn write(&mut self, frame: u32, capture: &Capture) -> anyhow::Result<()> {
        match self {
            Self::Folder(files) => files.write(frame, capture),
            Self::Video(video) => video.write(&image_files::side_by_side(&capture.screens)?),
        }
    }

    /// Ends the film after its last frame.
    ///
    /// # Errors
    /// The failure of ffmpeg.
    pub fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Folder(files) => {
                for path in files.of_earlier() {
                    tracing::warn!(
                        "{} and files after it are of an earlier, longer film; remove them",
                        path.display()
                    );
                }
                Ok(())
            }
            Self::Video(video) => video.finish(),
        }
    }
}

impl NumberedFiles {
    fn write(&mut self, frame: u32, capture: &Capture) -> anyhow::Result<()> {
        self.next.clear();
        for screen in &capture.screens {
            // A name of a peer must not lead out of the folder.
            if screen.name.contains(['/', '\0']) {
                bail!("screen {}: its name cannot stand in a file's name", screen.name);
            }
            let path = |frame: u32| self.folder.join(format!("{}-{frame:06}.png", screen.name));
            image_files::save_png(&path(frame), &image_files::to_image(screen)?)?;
            self.next.push(path(frame + 1));
        }
        Ok(())
    }

    /// The first files of an earlier, longer film: a video made of all files would end with them.
    fn of_earlier(&self) -> impl Iterator<Item = &PathBuf> {
        self.next.iter().filter(|path| path.exists())
    }
}

fn check_ffmpeg() -> anyhow::Result<()> {
    let mut command = Command::new("ffmpeg");
    command.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("ffmpeg -version ended with {status}; install ffmpeg anew"),
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "ffmpeg is not installed; install it (Debian: apt install ffmpeg), or name a folder, \
             which gets a PNG file for each frame"
        ),
        Err(error) => Err(anyhow!(error).context("cannot run ffmpeg")),
    }
}

impl Video {
    fn write(&mut self, picture: &RgbaImage) -> anyhow::Result<()> {
        let size = picture.dimensions();
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            none => none.insert(Encoder::start(&self.path, size, self.fps)?),
        };
        if encoder.size != size {
            bail!("the screens have {size:?} pixels, where they had {:?} before", encoder.size);
        }
        let into = encoder.process.stdin.as_mut().context("ffmpeg has no input")?;
        into.write_all(picture.as_raw()).context("ffmpeg takes no more frames")
    }

    fn finish(self) -> anyhow::Result<()> {
        let Some(Encoder { mut process, .. }) = self.encoder else { return Ok(()) };
        // The end of its input ends the video.
        drop(process.stdin.take());
        let status = process.wait().context("cannot wait for ffmpeg")?;
        if !status.success() {
            bail!("{}: ffmpeg ended with {status}; its own words stand above", self.path.display());
        }
        Ok(())
    }
}

/// What ffmpeg makes of the pictures: encoders take pairs of pixels, and players take videos of
/// 720 lines and more for BT.709 unless they say what they are; without a word it writes BT.601.
const FILTERS: &str = "pad=ceil(iw/2)*2:ceil(ih/2)*2,\
                       scale=out_color_matrix=bt709:out_range=tv,format=yuv420p,\
                       setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv";

impl Encoder {
    fn start(path: &Path, size: (u32, u32), fps: f64) -> anyhow::Result<Self> {
        // A path with a colon would be taken for a protocol.
        let mut target = std::ffi::OsString::from("file:");
        target.push(path);
        let (width, height) = size;
        let process = Command::new("ffmpeg")
            .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo"])
            .args(["-pixel_format", "rgba", "-video_size", &format!("{width}x{height}")])
            .args(["-framerate", &fps.to_string(), "-i", "pipe:0"])
            .args(["-vf", FILTERS, "-pix_fmt", "yuv420p", "-color_range", "tv"])
            .args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"])
            .arg(target)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // Ctrl-C on the terminal ends the film, and the end of its input ends the encoder.
            .process_group(0)
            .spawn()
            .context("cannot run ffmpeg")?;
        Ok(Self { process, size })
    }
}

#[cfg(test)]
mod tests {
    use polyptych_client::{FrameId, Image};

    use super::*;

    #[test]
    fn a_name_with_an_ending_that_is_no_video_is_refused() {
        for name in ["film.avi", "film.png", "a/b.gif"] {
            let error = FilmOutput::new(Path::new(name), 30.0).err().expect("refused");
            let said = error.to_string();
            assert!(said.starts_with(name) && said.contains(".mp4, .mkv, .webm"), "{said}");
        }
    }

    #[test]
    fn a_folder_is_made_and_used_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("a/film");
        for _ in 0..2 {
            assert!(matches!(FilmOutput::new(&out, 30.0), Ok(FilmOutput::Folder(_))));
        }
        assert!(out.is_dir());
    }

    #[test]
    fn files_of_an_earlier_longer_film_are_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let (name, rgba) = ("front".to_owned(), vec![255; 4]);
        let capture = Capture {
            frame: FrameId(1),
            screens: vec![Image { name, width: 1, height: 1, rgba }],
            channels: Vec::new(),
            missing: Vec::new(),
        };
        let mut files = NumberedFiles { folder: folder.path().to_owned(), next: Vec::new() };
        for frame in 0..3 {
            files.write(frame, &capture).expect("written");
        }
        assert_eq!(files.of_earlier().count(), 0);
        files.write(1, &capture).expect("written");
        let next: Vec<_> = files.of_earlier().collect();
        assert_eq!(next, [&folder.path().join("front-000002.png")]);
    }
}
