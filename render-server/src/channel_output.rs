//! A channel of this server: what it is drawn into, what its display shows, and where.

mod enlarged;

use std::time::Instant;

use glam::UVec2;
use polyptych_renderer::{
    Correction, Gpu, ImageEncoding, Label, LabelPosition, OutputTexture, Target, idle,
};
use polyptych_wall::unfold::{WindowLayout, WindowRect};
use polyptych_wall::{ChannelCalibration, ChannelId, Wall};
use winit::dpi::PhysicalSize;

use crate::connection_status::ServerInfo;
use crate::frame_scheduler::{DrawnFrames, FrameKey};
use crate::mismatch::{DisplayMismatch, MonitorAssignment, NOTE_TIME, NoteTime, Sizes, mismatch};
use crate::presentation_state::{DisplayContent, PresentationState};
use crate::window_output::WindowOutput;

/// One channel of this server.
#[derive(Debug)]
pub(crate) struct ChannelOutput {
    pub name: String,
    surface: OutputSurface,
    target: Option<Target>,
    /// The corrected picture of the target; `None` if the channel is not corrected.
    corrected: Option<OutputTexture>,
    /// The source of a correction with all pixels, where it was drawn with fewer; else `None`.
    enlarged: Option<OutputTexture>,
    /// The last placement of the window by the wall; a user may have moved it since.
    arranged: Option<WindowRect>,
    /// The frames whose pictures are here, and no others may be shown.
    pub drawn: DrawnFrames,
    /// The picture that the display took last. A frame is drawn while the one before is shown, and
    /// a display may have to show that again at any time: uncovered, frozen, or with words over it.
    shown: Option<PresentedImage>,
    /// A frame that waits for its swap while the next one is drawn.
    aside: Option<(FrameKey, OutputTexture)>,
    /// A picture that nothing needs any more, where frames are kept aside.
    spare: Option<OutputTexture>,
    /// The monitor in full screen; else `None`.
    assignment: Option<MonitorAssignment>,
    /// The channel on the wall that was prepared last, and the sizes that its picture should have.
    expected: Option<Expected>,
    /// The present mismatch of the display; `None` if its pictures fit.
    mismatch: Option<DisplayMismatch>,
    /// The time until which the display shows the mismatch over its pictures.
    note: NoteTime,
    /// Why its display did not take the last frame; `None` if it did.
    pub present_fault: Option<String>,
    /// The warning that the manager knows.
    pub reported: Option<String>,
    /// The content that the display took last, beside the address that it was named with.
    presented: Option<(DisplayContent, Option<String>)>,
    /// For a test: its display takes no frames.
    #[cfg(test)]
    pub is_broken: bool,
    /// For a test: how often its display took something.
    #[cfg(test)]
    pub presents: u32,
}

/// The properties of a channel's display that a wall states.
#[derive(Debug)]
struct Expected {
    id: ChannelId,
    /// Width and height of the display picture in pixels.
    picture: [u32; 2],
    /// By which an upright picture gets its display's size; nothing else is kept of it.
    form: ChannelCalibration,
}

/// The destination of a channel's pictures.
#[derive(Debug)]
enum OutputSurface {
    /// Nowhere: the target is all there is, and nobody sees what would be shown.
    Nowhere,
    Window(Box<WindowOutput>),
    /// A picture as a window would show it.
    #[cfg(test)]
    Offscreen(Box<(polyptych_renderer::PresentPass, OutputTexture)>),
}

#[derive(Debug)]
struct PresentedImage {
    picture: OutputTexture,
    /// The words of an idle picture; `None` for a frame.
    idle: Option<Vec<String>>,
}

impl ChannelOutput {
    /// An output that shows in a window, which in full screen fills a monitor; or nowhere.
    pub fn new(
        name: String,
        display: Option<WindowOutput>,
        assignment: Option<MonitorAssignment>,
    ) -> Self {
        let window = |display| OutputSurface::Window(Box::new(display));
        Self {
            name,
            surface: display.map_or(OutputSurface::Nowhere, window),
            target: None,
            corrected: None,
            enlarged: None,
            arranged: None,
            drawn: DrawnFrames::default(),
            shown: None,
            aside: None,
            spare: None,
            assignment,
            expected: None,
            mismatch: None,
            note: NoteTime::default(),
            present_fault: None,
            reported: None,
            presented: None,
            #[cfg(test)]
            is_broken: false,
            #[cfg(test)]
            presents: 0,
        }
    }

    /// Returns the picture that was drawn last, as a display gets it.
    pub fn picture(&self) -> Option<&OutputTexture> {
        self.corrected.as_ref().or(self.target.as_ref().map(Target::picture))
    }

    /// A target of this size in pixels, made where there is none that fits, for a channel that is
    /// shown as it is drawn.
    ///
    /// # Errors
    /// No target can be like that.
    pub fn ensure_target(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        samples_and_linear: (u32, bool),
    ) -> Result<&mut Target, String> {
        (self.corrected, self.enlarged) = (None, None);
        self.target_like(gpu, size, samples_and_linear, ImageEncoding::Srgb)
    }

    /// A target of light of this size in pixels, for a channel that is corrected.
    ///
    /// # Errors
    /// No target can be like that.
    pub fn ensure_atlas_target(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        samples_and_linear: (u32, bool),
    ) -> Result<&mut Target, String> {
        self.target_like(gpu, size, samples_and_linear, ImageEncoding::Light)
    }

    /// The target that was made for this frame.
    ///
    /// # Errors
    /// There is none.
    pub fn target(&mut self) -> Result<&mut Target, String> {
        self.target.as_mut().ok_or_else(|| "there is no target".to_owned())
    }

    /// The source that was drawn, and a picture for what is made of it.
    ///
    /// # Errors
    /// There is no source yet.
    pub fn ensure_corrected(
        &mut self,
        gpu: &Gpu,
        correction: &Correction,
    ) -> Result<(&OutputTexture, &OutputTexture), String> {
        let size = correction.display_size();
        let fits = |it: &OutputTexture| it.size() == size && it.content() == correction.content();
        let known = self.corrected.take().filter(fits);
        let picture = self.corrected.insert(known.unwrap_or_else(|| correction.picture(gpu)));
        let drawn = self.target.as_ref().map(Target::picture);
        let source = self.enlarged.as_ref().or(drawn).ok_or("there is no target")?;
        Ok((source, picture))
    }

    fn target_like(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        (samples, is_linear): (u32, bool),
        content: ImageEncoding,
    ) -> Result<&mut Target, String> {
        let fits = |target: &Target| {
            target.size() == size
                && target.samples() == samples
                && target.is_linear() == is_linear
                && target.content() == content
        };
        if !self.target.as_ref().is_some_and(fits) {
            let target = Target::with_encoding(gpu, size, samples, is_linear, content);
            self.target = Some(target.map_err(|error| error.to_string())?);
        }
        self.target()
    }

    /// Places the window of this channel among those of the whole wall, unless it was placed
    /// there already. In full screen it stays on its monitor.
    pub fn place_window(&mut self, wall: &Wall, id: ChannelId) {
        let OutputSurface::Window(display) = &self.surface else { return };
        if self.assignment.is_some() {
            return;
        }
        let layout = WindowLayout::new(wall, display.monitor_size().into());
        let Some(&window) = layout.windows.get(usize::from(id.0)) else { return };
        if self.arranged.replace(window) != Some(window) {
            display.place(window.origin.to_array(), window.size.to_array());
        }
    }

    /// Returns whether the output supports codes of 10 bits; `true` if there is no window.
    pub fn supports_10_bit(&self, gpu: &Gpu) -> bool {
        match &self.surface {
            OutputSurface::Window(display) => display.supports_10_bit(gpu),
            OutputSurface::Nowhere => true,
            #[cfg(test)]
            OutputSurface::Offscreen(_) => true,
        }
    }

    /// Forgets all that was on a lost device, and sets the window up on this one. Of a device that
    /// `hangs` nothing is given back, since it would be waited for.
    ///
    /// # Errors
    /// Why the window can't be drawn to any more.
    pub fn reopen(&mut self, gpu: &Gpu, hangs: bool) -> Result<(), String> {
        self.drawn = DrawnFrames::default();
        let pictures = (self.shown.take(), self.aside.take(), self.spare.take());
        let old = (self.target.take(), self.corrected.take(), self.enlarged.take(), pictures);
        if hangs {
            std::mem::forget(old);
        }
        match &mut self.surface {
            OutputSurface::Nowhere => Ok(()),
            OutputSurface::Window(display) => display.reopen(gpu, hangs),
            #[cfg(test)]
            OutputSurface::Offscreen(offscreen) => {
                let again = Self::offscreen(gpu, &self.name, offscreen.1.size(), None);
                self.surface = again.surface;
                Ok(())
            }
        }
    }

    /// Returns the channel on the wall that was prepared last.
    pub fn expected_id(&self) -> Option<ChannelId> {
        self.expected.as_ref().map(|expected| expected.id)
    }

    /// The window has another size.
    pub fn resize(&mut self, gpu: &Gpu, size: PhysicalSize<u32>) {
        if let OutputSurface::Window(display) = &mut self.surface {
            display.resize(gpu, size);
        }
    }

    /// Learns what the wall that was prepared says of this channel's display.
    pub fn expect(&mut self, wall: &Wall) {
        self.expected = wall.channel_by_name(&self.name).map(|(id, channel)| {
            let ChannelCalibration { turn, packing, .. } = channel.adjustment;
            let form = ChannelCalibration { turn, packing, ..ChannelCalibration::default() };
            Expected { id, picture: channel.display_size().to_array(), form }
        });
    }

    /// The monitor that the window fills has changed, or the window was put on another one.
    pub fn set_assignment(&mut self, assignment: MonitorAssignment) {
        self.assignment = Some(assignment);
    }

    /// Looks whether the picture fits the monitor that the window fills. Returns the channel with
    /// the present warning; `None` where nobody sees it, or it is a window that may have any size.
    pub fn check_fit(&mut self) -> Option<(ChannelId, Option<String>)> {
        let (assignment, Expected { id, picture, form }) =
            (self.assignment.as_ref()?, self.expected.as_ref()?);
        let pixels =
            form.upright_size(UVec2::from(assignment.monitor.size)).map(|it| it.to_array());
        let sizes = Sizes { picture: *picture, pixels, window: self.display_size()? };
        let (id, found) = (*id, mismatch(&self.name, assignment, sizes));
        if found != self.mismatch {
            let channel = self.name.as_str();
            if let Some(mismatch) = &found {
                tracing::warn!("{}", mismatch.warning);
            } else {
                tracing::info!(channel, "the picture fits its monitor");
            }
            self.note = NoteTime::default();
            self.mismatch = found;
        }
        Some((id, self.mismatch.as_ref().map(|mismatch| mismatch.warning.clone())))
    }

    /// Returns when the display must be shown again because a note over it ends.
    pub fn note_end(&self) -> Option<Instant> {
        match self.note {
            NoteTime::Until(end) => Some(end),
            NoteTime::NotYet | NoteTime::Over => None,
        }
    }

    /// Ends a note whose time is over. Returns whether there was one.
    pub fn end_note(&mut self, now: Instant) -> bool {
        let is_over = self.note_end().is_some_and(|end| end <= now);
        if is_over {
            self.note = NoteTime::Over;
        }
        is_over
    }

    /// The note over a picture, if there is one now.
    fn note(&mut self, is_named: bool) -> Option<String> {
        let mismatch = self.mismatch.as_ref()?;
        if self.note == NoteTime::NotYet {
            self.note = NoteTime::Until(Instant::now() + NOTE_TIME);
        }
        (is_named || self.note != NoteTime::Over).then(|| mismatch.note.clone())
    }

    /// The display takes the picture of this frame, which was drawn last or kept aside; the next
    /// one is drawn elsewhere.
    pub fn latch_image(&mut self, gpu: &Gpu, key: FrameKey) {
        // A second picture costs memory, which those that nobody sees are spared.
        if matches!(self.surface, OutputSurface::Nowhere) {
            return;
        }
        let aside = self.aside.take();
        let old = self.shown.take().map(|shown| shown.picture);
        let picture = match aside {
            Some((of, picture)) if of == key => {
                self.spare = old;
                Some(picture)
            }
            other => {
                self.spare = old.or_else(|| other.map(|(_, picture)| picture));
                self.take_picture(gpu)
            }
        };
        self.shown = picture.map(|picture| PresentedImage { picture, idle: None });
    }

    /// Keeps the picture of this frame, if it was drawn, while the next one is drawn.
    pub fn keep_aside(&mut self, gpu: &Gpu, key: FrameKey) {
        let is_kept = self.aside.as_ref().is_some_and(|(of, _)| *of == key);
        if is_kept || !self.drawn.has(key) || matches!(self.surface, OutputSurface::Nowhere) {
            return;
        }
        if let Some((_, old)) = self.aside.take() {
            self.spare = Some(old);
        }
        self.aside = self.take_picture(gpu).map(|picture| (key, picture));
    }

    /// Takes out what was drawn last; the next picture is drawn into the spare one.
    fn take_picture(&mut self, gpu: &Gpu) -> Option<OutputTexture> {
        let spare = self.spare.take();
        if let Some(corrected) = &mut self.corrected {
            let next = corrected.next(gpu, spare);
            Some(std::mem::replace(corrected, next))
        } else {
            self.target.as_mut().map(|target| target.latch_image(gpu, spare))
        }
    }

    /// Returns whether the display should show other content than it took last. Another picture of
    /// a frame is none.
    pub fn has_other_content(&self, showing: &PresentationState) -> bool {
        self.presented.as_ref() != Some(&self.content(showing))
    }

    /// The content that is to be shown now, beside the address that it is named with.
    fn content(&self, showing: &PresentationState) -> (DisplayContent, Option<String>) {
        let has_picture = self.shown.as_ref().is_some_and(|shown| shown.idle.is_none());
        let content = showing.content(has_picture);
        let is_named = matches!(content, DisplayContent::Picture { is_named: true, .. });
        let notice = showing.notice().filter(|_| is_named);
        (content, notice.and_then(|notice| notice.address.clone()))
    }

    /// Shows what is to be shown now.
    ///
    /// # Errors
    /// Why the display could not take it.
    pub fn present(
        &mut self,
        gpu: &Gpu,
        showing: &PresentationState,
        identity: &ServerInfo,
    ) -> Result<(), String> {
        let Some(display_size) = self.display_size() else { return Ok(()) };
        let (mut labels, content) = (Vec::new(), self.content(showing));
        let is_black = match content.0.clone() {
            DisplayContent::Black => true,
            DisplayContent::Idle { notice: None, .. } => return Ok(()),
            DisplayContent::Idle { notice: Some(notice), is_frozen } => {
                let mut lines = identity.idle_lines(&self.name, &notice, is_frozen);
                lines.extend(self.mismatch.as_ref().map(|mismatch| mismatch.note.clone()));
                self.show_idle(gpu, display_size, lines);
                false
            }
            DisplayContent::Picture { is_named, outdated } => {
                let size = self.picture().map_or(display_size, OutputTexture::size);
                if is_named {
                    let lines = identity.identify_lines(&self.name, size, showing.notice());
                    labels.push(Label { lines, place: LabelPosition::Middle });
                }
                let lines: Vec<String> = outdated.into_iter().chain(self.note(is_named)).collect();
                if !lines.is_empty() {
                    labels.push(Label { lines, place: LabelPosition::Corner });
                }
                false
            }
        };
        let picture = self.shown.as_ref().map(|shown| &shown.picture).filter(|_| !is_black);
        let taken = match &mut self.surface {
            OutputSurface::Nowhere => Ok(true),
            OutputSurface::Window(display) => display.present(gpu, picture, &labels),
            #[cfg(test)]
            OutputSurface::Offscreen(_) if self.is_broken => Err("it is to be so".to_owned()),
            #[cfg(test)]
            OutputSurface::Offscreen(offscreen) => {
                let (output, surface) = &mut **offscreen;
                output.draw(gpu, picture, &labels, surface.view(), surface.size());
                self.presents += 1;
                Ok(true)
            }
        };
        // One that could not take it is asked again with the next news.
        self.presented = matches!(taken, Ok(true)).then_some(content);
        taken.map(drop)
    }

    fn show_idle(&mut self, gpu: &Gpu, size: [u32; 2], lines: Vec<String>) {
        let is_it = |shown: &PresentedImage| {
            shown.picture.size() == size && shown.idle.as_ref() == Some(&lines)
        };
        if !self.shown.as_ref().is_some_and(is_it) {
            let picture = idle::picture(gpu, size, &lines);
            self.shown = Some(PresentedImage { picture, idle: Some(lines) });
        }
    }

    /// In pixels; `None` where nobody sees anything.
    fn display_size(&self) -> Option<[u32; 2]> {
        match &self.surface {
            OutputSurface::Nowhere => None,
            OutputSurface::Window(display) => Some(display.size()),
            #[cfg(test)]
            OutputSurface::Offscreen(offscreen) => Some(offscreen.1.size()),
        }
    }
}

#[cfg(test)]
impl ChannelOutput {
    /// A display that a test can look at, of this size in pixels.
    pub fn offscreen(
        gpu: &Gpu,
        name: &str,
        size: [u32; 2],
        assignment: Option<MonitorAssignment>,
    ) -> Self {
        let target = Target::new(gpu, size, 1, false);
        let surface = target.expect("a target").latch_image(gpu, None);
        let output = polyptych_renderer::PresentPass::new(gpu, surface.texture().format());
        let surface = OutputSurface::Offscreen(Box::new((output, surface)));
        Self { surface, ..Self::new(name.into(), None, assignment) }
    }

    /// Returns the pixels that the display shows, RGBA8 as sRGB.
    pub fn read_back(&self, gpu: &Gpu) -> Vec<u8> {
        let OutputSurface::Offscreen(offscreen) = &self.surface else { panic!("nobody sees it") };
        polyptych_renderer::read_picture(gpu, &offscreen.1).expect("read back")
    }
}
