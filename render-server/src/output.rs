//! A channel of this server: what it is drawn into, what its display shows, and where.

use winit::dpi::PhysicalSize;

use crate::display::WindowDisplay;
use crate::notice::Identity;
use crate::renderer::{Content, Correction, Gpu, Label, Picture, Place, Target, idle};
use crate::showing::{Look, Showing};

/// One channel of this server.
#[derive(Debug)]
pub(crate) struct Output {
    pub name: String,
    surface: Surface,
    target: Option<Target>,
    /// What was made of the target, where the channel is corrected; else `None`.
    corrected: Option<Picture>,
    /// Width and height of the picture for which the window was placed.
    arranged: Option<[u32; 2]>,
    /// What the display took last. A frame is drawn while the one before is shown, and a display
    /// may have to show that again at any time: uncovered, frozen, or with words over it.
    shown: Option<Shown>,
}

/// Where pictures go.
#[derive(Debug)]
enum Surface {
    /// Nowhere: the target is all there is, and nobody sees what would be shown.
    Nowhere,
    Window(Box<WindowDisplay>),
    /// As a window would have it.
    #[cfg(test)]
    Offscreen(Box<(crate::renderer::Output, Picture)>),
}

#[derive(Debug)]
struct Shown {
    picture: Picture,
    /// The words of an idle picture; `None` for a frame.
    idle: Option<Vec<String>>,
}

impl Output {
    pub fn new(name: String, display: Option<WindowDisplay>) -> Self {
        let window = |display| Surface::Window(Box::new(display));
        let surface = display.map_or(Surface::Nowhere, window);
        Self { name, surface, target: None, corrected: None, arranged: None, shown: None }
    }

    /// What was drawn last, as a display gets it.
    pub fn picture(&self) -> Option<&Picture> {
        self.corrected.as_ref().or(self.target.as_ref().map(Target::picture))
    }

    /// A target of this size in pixels, made where there is none that fits, for a channel that is
    /// shown as it is drawn.
    ///
    /// # Errors
    /// No target can be like that.
    pub fn target_of(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        samples_and_linear: (u32, bool),
    ) -> Result<&mut Target, String> {
        self.corrected = None;
        self.target_like(gpu, size, samples_and_linear, Content::Srgb)
    }

    /// A target of light of this size in pixels, for a channel that is corrected.
    ///
    /// # Errors
    /// No target can be like that.
    pub fn source_of(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        samples_and_linear: (u32, bool),
    ) -> Result<&mut Target, String> {
        self.target_like(gpu, size, samples_and_linear, Content::Light)
    }

    /// The source that was drawn, and a picture for what is made of it.
    ///
    /// # Errors
    /// There is no source yet.
    pub fn corrected_of(
        &mut self,
        gpu: &Gpu,
        correction: &Correction,
    ) -> Result<(&Target, &Picture), String> {
        let size = correction.display_size();
        let fits = |it: &Picture| it.size() == size && it.content() == correction.content();
        let known = self.corrected.take().filter(fits);
        let picture = self.corrected.insert(known.unwrap_or_else(|| correction.picture(gpu)));
        let source = self.target.as_ref().ok_or("there is no target")?;
        Ok((source, picture))
    }

    fn target_like(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        (samples, is_linear): (u32, bool),
        content: Content,
    ) -> Result<&mut Target, String> {
        let fits = |target: &Target| {
            target.size() == size
                && target.samples() == samples
                && target.is_linear() == is_linear
                && target.content() == content
        };
        if !self.target.as_ref().is_some_and(fits) {
            let target = Target::of(gpu, size, samples, is_linear, content);
            self.target = Some(target.map_err(|error| error.to_string())?);
        }
        self.target.as_mut().ok_or_else(|| "there is no target".to_owned())
    }

    /// Places the window on its screen's `canvas`, where that was not done yet for pictures of
    /// this size.
    pub fn arrange(&mut self, origin: [u32; 2], size: [u32; 2], canvas: [u32; 2]) {
        if self.arranged.replace(size) != Some(size)
            && let Surface::Window(display) = &self.surface
        {
            display.arrange(origin, size, canvas);
        }
    }

    /// Whether codes of ten bits can be shown; where nobody looks, they can.
    pub fn takes_fine_codes(&self, gpu: &Gpu) -> bool {
        match &self.surface {
            Surface::Window(display) => display.takes_fine_codes(gpu),
            Surface::Nowhere => true,
            #[cfg(test)]
            Surface::Offscreen(_) => true,
        }
    }

    /// The window has another size.
    pub fn resize(&mut self, gpu: &Gpu, size: PhysicalSize<u32>) {
        if let Surface::Window(display) = &mut self.surface {
            display.resize(gpu, size);
        }
    }

    /// The display takes the picture that was drawn; the next one is drawn elsewhere.
    pub fn take_picture(&mut self, gpu: &Gpu) {
        // A second picture costs memory, which those that nobody sees are spared.
        if matches!(self.surface, Surface::Nowhere) {
            return;
        }
        let spare = |shown: &mut Option<Shown>| shown.take().map(|shown| shown.picture);
        let picture = if let Some(corrected) = &mut self.corrected {
            let next = corrected.next(gpu, spare(&mut self.shown));
            std::mem::replace(corrected, next)
        } else if let Some(target) = &mut self.target {
            target.take_picture(gpu, spare(&mut self.shown))
        } else {
            return;
        };
        self.shown = Some(Shown { picture, idle: None });
    }

    /// Shows what is to be shown now.
    ///
    /// # Errors
    /// Why the display could not take it.
    pub fn present(
        &mut self,
        gpu: &Gpu,
        showing: &Showing,
        identity: &Identity,
    ) -> Result<(), String> {
        let Some(display_size) = self.display_size() else { return Ok(()) };
        let has_picture = self.shown.as_ref().is_some_and(|shown| shown.idle.is_none());
        let mut labels = Vec::new();
        let is_black = match showing.look(has_picture) {
            Look::Black => true,
            Look::Idle { notice: None, .. } => return Ok(()),
            Look::Idle { notice: Some(notice), is_frozen } => {
                let lines = identity.idle(&self.name, &notice, is_frozen);
                self.show_idle(gpu, display_size, lines);
                false
            }
            Look::Picture { is_named, lost_since } => {
                let size = self.picture().map_or(display_size, Picture::size);
                if is_named {
                    let lines = identity.label(&self.name, size, showing.notice());
                    labels.push(Label { lines, place: Place::Middle });
                }
                if let Some(since) = lost_since {
                    let lines = vec![format!("manager lost since {since}")];
                    labels.push(Label { lines, place: Place::Corner });
                }
                false
            }
        };
        let picture = self.shown.as_ref().map(|shown| &shown.picture).filter(|_| !is_black);
        match &mut self.surface {
            Surface::Nowhere => Ok(()),
            Surface::Window(display) => display.present(gpu, picture, &labels),
            #[cfg(test)]
            Surface::Offscreen(offscreen) => {
                let (output, surface) = &mut **offscreen;
                output.draw(gpu, picture, &labels, surface.view(), surface.size());
                Ok(())
            }
        }
    }

    fn show_idle(&mut self, gpu: &Gpu, size: [u32; 2], lines: Vec<String>) {
        let is_it =
            |shown: &Shown| shown.picture.size() == size && shown.idle.as_ref() == Some(&lines);
        if !self.shown.as_ref().is_some_and(is_it) {
            let picture = idle::picture(gpu, size, &lines);
            self.shown = Some(Shown { picture, idle: Some(lines) });
        }
    }

    /// In pixels; `None` where nobody sees anything.
    fn display_size(&self) -> Option<[u32; 2]> {
        match &self.surface {
            Surface::Nowhere => None,
            Surface::Window(display) => Some(display.size()),
            #[cfg(test)]
            Surface::Offscreen(offscreen) => Some(offscreen.1.size()),
        }
    }
}

#[cfg(test)]
impl Output {
    /// A display that a test can look at, of this size in pixels.
    pub fn offscreen(gpu: &Gpu, name: &str, size: [u32; 2]) -> Self {
        let target = Target::new(gpu, size, 1, false);
        let surface = target.expect("a target").take_picture(gpu, None);
        let output = crate::renderer::Output::new(gpu, surface.texture().format());
        let surface = Surface::Offscreen(Box::new((output, surface)));
        Self { surface, ..Self::new(name.into(), None) }
    }

    /// What the display shows, RGBA8 as sRGB.
    pub fn seen(&self, gpu: &Gpu) -> Vec<u8> {
        let Surface::Offscreen(offscreen) = &self.surface else { panic!("nobody sees it") };
        crate::renderer::read_picture(gpu, &offscreen.1).expect("read back")
    }
}
