//! Where a channel's pictures go: a window, or nowhere but the target itself.

use std::sync::Arc;

use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::window::Window;

use crate::renderer::{Content, FINE_FORMAT, Gpu, Label, Output, Picture};

/// A window and its surface.
#[derive(Debug)]
pub struct WindowDisplay {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    configuration: Option<wgpu::SurfaceConfiguration>,
    output: Option<Output>,
    /// It shows codes of ten bits.
    is_fine: bool,
}

impl WindowDisplay {
    pub(crate) fn new(window: Arc<Window>, surface: wgpu::Surface<'static>) -> Self {
        Self { window, surface, configuration: None, output: None, is_fine: false }
    }

    pub(crate) fn surface(&self) -> &wgpu::Surface<'static> {
        &self.surface
    }

    /// The window has another size, or must be set up anew.
    pub(crate) fn resize(&mut self, gpu: &Gpu, size: PhysicalSize<u32>) {
        let (width, height) = (size.width.max(1), size.height.max(1));
        let default = self.surface.get_default_config(&gpu.adapter, width, height);
        let Some(mut configuration) = default else {
            tracing::error!("the adapter {} can't draw to this window", gpu.facts().name);
            return;
        };
        // Two frames in flight would show each frame one refresh later than it was swapped.
        configuration.desired_maximum_frame_latency = 1;
        if self.is_fine && self.takes_fine_codes(gpu) {
            configuration.format = FINE_FORMAT;
        }
        self.surface.configure(&gpu.device, &configuration);
        let format = configuration.format;
        if self.configuration.as_ref().map(|c| c.format) != Some(format) {
            self.output = Some(Output::new(gpu, format));
        }
        self.configuration = Some(configuration);
    }

    /// Whether it can show codes of ten bits.
    pub(crate) fn takes_fine_codes(&self, gpu: &Gpu) -> bool {
        self.surface.get_capabilities(&gpu.adapter).formats.contains(&FINE_FORMAT)
    }

    /// Places the window as its channel hangs on the wall, the screen's canvas being scaled down
    /// to the monitor where it is larger. Windows of several servers so make one picture.
    pub(crate) fn arrange(&self, origin: [u32; 2], size: [u32; 2], canvas: [u32; 2]) {
        let monitor = self.window.current_monitor().map(|monitor| monitor.size());
        let scale = monitor.map_or(1.0, |monitor| {
            let fit = |pixels: u32, of: u32| f64::from(pixels) / f64::from(of.max(1));
            fit(monitor.width, canvas[0]).min(fit(monitor.height, canvas[1])).min(1.0)
        });
        let [x, y, width, height] = [origin[0], origin[1], size[0], size[1]]
            .map(|pixels| (f64::from(pixels) * scale).round());
        let size = PhysicalSize::new(width.max(1.0) as u32, height.max(1.0) as u32);
        // A window manager may give another size; the picture is letterboxed then.
        let _ = self.window.request_inner_size(size);
        self.window.set_outer_position(PhysicalPosition::new(x as i32, y as i32));
    }

    /// Its pixels, for a picture that has no other size yet.
    pub(crate) fn size(&self) -> [u32; 2] {
        let size = self.window.inner_size();
        [size.width.max(1), size.height.max(1)]
    }

    /// Copies the picture to the window, or black, with these labels over it, and presents it.
    ///
    /// # Errors
    /// Why the window could not take it.
    pub(crate) fn present(
        &mut self,
        gpu: &Gpu,
        picture: Option<&Picture>,
        labels: &[Label],
    ) -> Result<(), String> {
        use wgpu::CurrentSurfaceTexture as Current;
        let is_fine = picture.is_some_and(|it| it.content() == Content::FineCodes);
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
                return Ok(());
            }
            // Nobody can see it now.
            Current::Timeout | Current::Occluded => return Ok(()),
            Current::Validation => return Err("the window's surface is not valid".to_owned()),
        };
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let size = [texture.texture.width(), texture.texture.height()];
        output.draw(gpu, picture, labels, &view, size);
        self.window.pre_present_notify();
        gpu.queue.present(texture);
        Ok(())
    }
}
