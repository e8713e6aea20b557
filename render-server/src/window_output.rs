//! The output of a channel's pictures to a window.

use std::sync::Arc;

use polyptych_renderer::{FINE_FORMAT, Gpu, ImageEncoding, Label, OutputTexture, PresentPass};
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::monitor::MonitorHandle;
use winit::window::Window;

/// Side of a monitor that the window system does not describe, in pixels: windows are not scaled.
const MONITOR_UNKNOWN_SIDE: u32 = 1 << 20;

/// A window and its surface.
#[derive(Debug)]
pub struct WindowOutput {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    configuration: Option<wgpu::SurfaceConfiguration>,
    output: Option<PresentPass>,
    /// It shows codes of ten bits.
    is_fine: bool,
}

impl WindowOutput {
    pub(crate) fn new(window: Arc<Window>, surface: wgpu::Surface<'static>) -> Self {
        Self { window, surface, configuration: None, output: None, is_fine: false }
    }

    pub(crate) fn surface(&self) -> &wgpu::Surface<'static> {
        &self.surface
    }

    /// Makes a surface for another device; it is configured when the next picture is shown. That
    /// of a device that `hangs` is not given back, since the device would be waited for.
    ///
    /// # Errors
    /// Why the window has no surface any more.
    pub(crate) fn reopen(&mut self, gpu: &Gpu, hangs: bool) -> Result<(), String> {
        let surface = gpu.instance.create_surface(Arc::clone(&self.window));
        let surface = surface.map_err(|error| error.to_string())?;
        let old = (std::mem::replace(&mut self.surface, surface), self.output.take());
        if hangs {
            std::mem::forget(old);
        }
        self.configuration = None;
        Ok(())
    }

    /// The window has another size, or must be set up anew.
    pub(crate) fn resize(&mut self, gpu: &Gpu, size: PhysicalSize<u32>) {
        let (width, height) = (size.width.max(1), size.height.max(1));
        let default = self.surface.get_default_config(&gpu.adapter, width, height);
        let Some(mut configuration) = default else {
            tracing::error!("the adapter {} can't draw to this window", gpu.info().name);
            return;
        };
        let offered = self.surface.get_capabilities(&gpu.adapter).present_modes;
        configuration.present_mode = present_mode(&offered);
        // Two frames in flight would show each frame one refresh later than it was swapped.
        configuration.desired_maximum_frame_latency = 1;
        if self.is_fine && self.supports_10_bit(gpu) {
            configuration.format = FINE_FORMAT;
        }
        self.surface.configure(&gpu.device, &configuration);
        if gpu.first_fault().is_some() {
            // No picture can be asked of it: that would end this process.
            (self.configuration, self.output) = (None, None);
            return;
        }
        let format = configuration.format;
        if self.configuration.as_ref().map(|c| c.format) != Some(format) {
            self.output = Some(PresentPass::new(gpu, format));
        }
        self.configuration = Some(configuration);
    }

    /// Returns whether it can show codes of 10 bits.
    pub(crate) fn supports_10_bit(&self, gpu: &Gpu) -> bool {
        self.surface.get_capabilities(&gpu.adapter).formats.contains(&FINE_FORMAT)
    }

    /// The size in pixels of the monitor for windows: the primary one, else the first, so that
    /// all servers of a machine choose the same.
    pub(crate) fn monitor_size(&self) -> [u32; 2] {
        let size = self.monitor().map(|monitor| monitor.size());
        size.map_or([MONITOR_UNKNOWN_SIDE; 2], |size| [size.width, size.height])
    }

    fn monitor(&self) -> Option<MonitorHandle> {
        self.window.primary_monitor().or_else(|| self.window.available_monitors().next())
    }

    /// Places the window on that monitor, its frame included, in pixels. A window manager may
    /// place it elsewhere.
    pub(crate) fn place(&self, origin: [u32; 2], size: [u32; 2]) {
        let corner = self.monitor().map_or(PhysicalPosition::new(0, 0), |m| m.position());
        let (outer, inner) = (self.window.outer_size(), self.window.inner_size());
        // A frame takes its room from the picture, so that windows do not cover their neighbours'.
        let within = |size: u32, outer: u32, inner: u32| {
            let frame = outer.saturating_sub(inner);
            if frame < size / 2 { size - frame } else { size }
        };
        let width = within(size[0], outer.width, inner.width);
        let height = within(size[1], outer.height, inner.height);
        // A window manager may give another size; the picture is letterboxed then.
        let _ = self.window.request_inner_size(PhysicalSize::new(width.max(1), height.max(1)));
        let at = |corner: i32, origin: u32| corner.saturating_add_unsigned(origin);
        let position = PhysicalPosition::new(at(corner.x, origin[0]), at(corner.y, origin[1]));
        self.window.set_outer_position(position);
    }

    /// Its pixels, for a picture that has no other size yet.
    pub(crate) fn size(&self) -> [u32; 2] {
        let size = self.window.inner_size();
        [size.width.max(1), size.height.max(1)]
    }

    /// Copies the picture to the window, or black, with these labels over it, and presents it.
    /// Returns whether it could: a window that changes its size, or that nobody sees, takes none.
    ///
    /// # Errors
    /// Why the window could not take it.
    pub(crate) fn present(
        &mut self,
        gpu: &Gpu,
        picture: Option<&OutputTexture>,
        labels: &[Label],
    ) -> Result<bool, String> {
        use wgpu::CurrentSurfaceTexture as Current;
        let is_fine = picture.is_some_and(|it| it.content() == ImageEncoding::FineCodes);
        // Black is shown as what was there.
        let is_other = picture.is_some() && self.is_fine != is_fine;
        if self.configuration.is_none() || is_other {
            self.is_fine = is_fine;
            self.resize(gpu, self.window.inner_size());
        }
        let Some(output) = &mut self.output else {
            return Err("the window could not be set up".to_owned());
        };
        let texture = match self.surface.get_current_texture() {
            Current::Success(texture) | Current::Suboptimal(texture) => texture,
            Current::Outdated | Current::Lost => {
                // A resize that we have not been told of yet; the next frame finds it right.
                self.resize(gpu, self.window.inner_size());
                return Ok(false);
            }
            // Nobody can see it now.
            Current::Timeout | Current::Occluded => return Ok(false),
            Current::Validation => return Err("the window's surface is not valid".to_owned()),
        };
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let size = [texture.texture.width(), texture.texture.height()];
        output.draw(gpu, picture, labels, &view, size);
        self.window.pre_present_notify();
        gpu.queue.present(texture);
        Ok(true)
    }
}

/// A mode in which displays take pictures between two refreshes, never within one, which would tear
/// them. Best of those that a surface offers is one in which nobody waits for the refresh before.
fn present_mode(offered: &[wgpu::PresentMode]) -> wgpu::PresentMode {
    let has_mailbox = offered.contains(&wgpu::PresentMode::Mailbox);
    // All surfaces have the other one.
    if has_mailbox { wgpu::PresentMode::Mailbox } else { wgpu::PresentMode::Fifo }
}

#[cfg(test)]
mod tests {
    use wgpu::PresentMode::{self, Fifo, FifoRelaxed, Immediate, Mailbox};

    use super::present_mode;

    #[test]
    fn windows_take_a_mode_that_never_tears_and_if_they_can_one_that_never_waits() {
        let cases: [(&[PresentMode], PresentMode); 6] = [
            (&[Immediate, FifoRelaxed, Fifo, Mailbox], Mailbox),
            (&[Fifo, Mailbox], Mailbox),
            // The first two of them tear.
            (&[Immediate, FifoRelaxed, Fifo], Fifo),
            (&[Immediate, Fifo], Fifo),
            (&[Fifo], Fifo),
            // A window that cannot be drawn to offers none.
            (&[], Fifo),
        ];
        for (offered, taken) in cases {
            assert_eq!(present_mode(offered), taken, "of {offered:?}");
        }
    }
}
