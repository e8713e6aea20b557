//! A channel that is drawn with fewer pixels than its display has.

use polyptych_renderer::{
    Enlargement, Gpu, ImageEncoding, OutputTexture, Renderer, Submission, Target,
};

use super::ChannelOutput;

impl ChannelOutput {
    /// A target of fewer pixels for a channel that is shown as it is drawn: after its frame was
    /// submitted comes [`Self::enlarge`].
    ///
    /// # Errors
    /// No target can be like that.
    pub fn ensure_reduced_target(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        samples_and_linear: (u32, bool),
    ) -> Result<&mut Target, String> {
        self.target_like(gpu, size, samples_and_linear, ImageEncoding::Srgb)
    }

    /// Submits the enlargement of the target to a picture of this size in pixels.
    ///
    /// # Errors
    /// No picture can be like that.
    pub fn enlarge(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        (place, size): (Enlargement, [u32; 2]),
    ) -> Result<Submission, String> {
        let target = self.target.as_ref().ok_or("there is no target")?;
        enlarge(gpu, renderer, target, (place, size), &mut self.corrected)
    }

    /// Submits the enlargement of a correction's source, if it has fewer pixels.
    ///
    /// # Errors
    /// No source can be like that.
    pub fn enlarge_source(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        enlargement: Option<(Enlargement, [u32; 2])>,
    ) -> Result<(), String> {
        let Some(enlargement) = enlargement else {
            self.enlarged = None;
            return Ok(());
        };
        let target = self.target.as_ref().ok_or("there is no target")?;
        // The correction that follows is waited for.
        enlarge(gpu, renderer, target, enlargement, &mut self.enlarged).map(|_| ())
    }
}

/// Submits the enlargement of a target onto a picture, which is made where there is none that fits.
fn enlarge(
    gpu: &Gpu,
    renderer: &mut Renderer,
    target: &Target,
    (place, size): (Enlargement, [u32; 2]),
    onto: &mut Option<OutputTexture>,
) -> Result<Submission, String> {
    let fits = |it: &OutputTexture| it.size() == size && it.content() == target.content();
    let picture = if let Some(known) = onto.take().filter(fits) {
        known
    } else {
        let made = renderer.picture(gpu, size, target.content());
        made.map_err(|error| error.to_string())?
    };
    let submitted = renderer.enlarge(gpu, target, place, &picture);
    *onto = Some(picture);
    submitted.map_err(|error| error.to_string())
}
