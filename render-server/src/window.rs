//! Windows: events and surfaces on the main thread, which the window system insists on; drawing
//! and presenting on the render thread.

use std::sync::Arc;

use crossbeam_channel::Sender;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop, EventLoopProxy};
use winit::window::{Fullscreen, Window, WindowId};

use crate::display::WindowDisplay;
use crate::render_thread::Job;
use crate::renderer::Gpu;

/// What a window has before the wall says more, in pixels.
const FIRST_SIZE: PhysicalSize<u32> = PhysicalSize::new(640, 360);

/// Another thread wants the window system to end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End;

/// The windows, as the render thread takes them over.
pub(crate) struct Windows {
    pub instance: wgpu::Instance,
    pub displays: Vec<(String, WindowDisplay)>,
}

/// Starts the other threads once the windows are there; gives the render thread's queue.
type Start = Box<dyn FnOnce(Windows) -> Result<Sender<Job>, String>>;

/// The event loop, and a way to end it from another thread.
///
/// # Errors
/// There is no display to open windows on.
pub(crate) fn event_loop() -> Result<(EventLoop<End>, EventLoopProxy<End>), String> {
    let event_loop = EventLoop::<End>::with_user_event().build().map_err(|error| {
        let reason = error.to_string();
        // winit puts the place in its own sources before the system's reason.
        let reason = reason.rsplit(": ").next().unwrap_or_default().trim_end_matches('.');
        format!("no window can be opened ({reason}); use --headless where there is no display")
    })?;
    let proxy = event_loop.create_proxy();
    Ok((event_loop, proxy))
}

/// Opens a window for each channel, starts the other threads, and serves events until the end.
///
/// # Errors
/// Why a window could not be opened or the others not started.
pub(crate) fn serve(
    event_loop: EventLoop<End>,
    channels: Vec<String>,
    is_fullscreen: bool,
    start: Start,
) -> Result<(), String> {
    let instance = Gpu::instance(|| {
        let display = Box::new(event_loop.owned_display_handle());
        wgpu::InstanceDescriptor::new_with_display_handle_from_env(display)
    });
    let mut app = App {
        instance,
        channels,
        is_fullscreen,
        start: Some(start),
        jobs: None,
        windows: Vec::new(),
        fault: None,
    };
    event_loop.run_app(&mut app).map_err(|error| error.to_string())?;
    app.fault.map_or(Ok(()), Err)
}

struct App {
    instance: wgpu::Instance,
    channels: Vec<String>,
    is_fullscreen: bool,
    start: Option<Start>,
    jobs: Option<Sender<Job>>,
    windows: Vec<(WindowId, String)>,
    fault: Option<String>,
}

impl App {
    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), String> {
        let Some(start) = self.start.take() else { return Ok(()) };
        let mut displays = Vec::new();
        for channel in &self.channels {
            let attributes = Window::default_attributes()
                .with_title(format!("polyptych {channel}"))
                .with_inner_size(FIRST_SIZE)
                .with_fullscreen(self.is_fullscreen.then_some(Fullscreen::Borderless(None)));
            let window = event_loop.create_window(attributes).map_err(|e| e.to_string())?;
            let window = Arc::new(window);
            self.windows.push((window.id(), channel.clone()));
            let surface =
                self.instance.create_surface(Arc::clone(&window)).map_err(|e| e.to_string())?;
            displays.push((channel.clone(), WindowDisplay::new(window, surface)));
        }
        let instance = self.instance.clone();
        self.jobs = Some(start(Windows { instance, displays })?);
        Ok(())
    }

    fn send(&self, job: Job) {
        if let Some(jobs) = &self.jobs {
            // A full queue is a render thread that has more important things to do.
            let _ = jobs.try_send(job);
        }
    }
}

impl ApplicationHandler<End> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if let Err(fault) = self.open(event_loop) {
            self.fault = Some(fault);
            event_loop.exit();
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, _: End) {
        event_loop.exit();
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        let Some((_, channel)) = self.windows.iter().find(|(window, _)| *window == id) else {
            return;
        };
        let channel = channel.clone();
        match event {
            WindowEvent::Resized(size) => self.send(Job::Resized { channel, size }),
            WindowEvent::RedrawRequested => self.send(Job::Redraw { channel }),
            WindowEvent::CloseRequested => event_loop.exit(),
            _ => {}
        }
    }
}
