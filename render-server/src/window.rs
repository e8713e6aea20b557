//! Windows: events and surfaces on the main thread, which the window system insists on; drawing
//! and presenting on the render thread.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::Sender;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_renderer::Gpu;
use tokio::sync::mpsc;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Window, WindowId};

use crate::fullscreen::Fullscreen;
use crate::mismatch::MonitorAssignment;
use crate::mouse::Mouse;
use crate::render_event::RenderEvent;
use crate::render_thread::RenderTask;
use crate::window_output::WindowOutput;

/// The size of a window until the wall states one, in pixels.
const FIRST_SIZE: PhysicalSize<u32> = PhysicalSize::new(640, 360);

/// Longest time between two looks at the window system's events. Drivers present over the same X
/// connection from threads of their own, and whoever reads from its socket takes the events of all
/// into a queue that wakes nobody: without a look, a closed window of a wall at rest stays unheard.
const EVENTS_PERIOD: Duration = Duration::from_millis(50);

/// A message of another thread to the window system's.
#[derive(Clone, Debug)]
pub(crate) enum Message {
    /// End.
    End,
    /// The wall file names these monitors, by channel.
    MonitorNames(BTreeMap<String, String>),
    /// Monitors may have come, gone, or changed.
    MonitorsChanged,
}

/// Why the window system's thread ended without a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// Another thread has asked for it.
    Asked,
    /// Somebody has closed a window.
    Closed,
}

/// The windows, as the render thread takes them over.
pub(crate) struct Windows {
    pub instance: wgpu::Instance,
    pub displays: Vec<(String, WindowOutput, Option<MonitorAssignment>)>,
}

/// The ways from the windows to the other threads.
pub(crate) struct Links {
    pub jobs: Sender<RenderTask>,
    pub reports: mpsc::Sender<RenderEvent>,
}

/// The windows to open.
pub(crate) struct WindowWish {
    /// A window for each of these channels.
    pub channels: Vec<String>,
    pub fullscreen: Option<Fullscreen>,
    /// Called when the user closes a window; `None`: that ends the server.
    pub on_close: Option<fn(&str)>,
}

/// Starts the other threads once the windows are there.
type Start = Box<dyn FnOnce(Windows) -> Result<Links, String>>;

/// The event loop, and a way to end it from another thread.
///
/// # Errors
/// There is no display to open windows on.
pub(crate) fn event_loop() -> Result<(EventLoop<Message>, EventLoopProxy<Message>), String> {
    let event_loop = EventLoop::<Message>::with_user_event().build().map_err(|error| {
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
/// Why a window could not be opened, the others not started, or a monitor is not there.
pub(crate) fn serve(
    event_loop: EventLoop<Message>,
    wish: WindowWish,
    start: Start,
) -> Result<Ended, String> {
    let instance = Gpu::instance(|| {
        let display = Box::new(event_loop.owned_display_handle());
        wgpu::InstanceDescriptor::new_with_display_handle_from_env(display)
    });
    let mut app = App {
        instance,
        mouse: Mouse::new(wish.fullscreen.is_some()),
        channels: wish.channels,
        fullscreen: wish.fullscreen,
        on_close: wish.on_close,
        start: Some(start),
        links: None,
        windows: Vec::new(),
        ended: Ok(Ended::Asked),
    };
    event_loop.run_app(&mut app).map_err(|error| error.to_string())?;
    app.ended
}

struct App {
    instance: wgpu::Instance,
    channels: Vec<String>,
    fullscreen: Option<Fullscreen>,
    on_close: Option<fn(&str)>,
    mouse: Mouse,
    start: Option<Start>,
    links: Option<Links>,
    windows: Vec<(Arc<Window>, String)>,
    ended: Result<Ended, String>,
}

impl App {
    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), String> {
        let Some(start) = self.start.take() else { return Ok(()) };
        let mut displays = Vec::new();
        for channel in &self.channels {
            let mut attributes = Window::default_attributes()
                .with_title(format!("polyptych {channel}"))
                .with_inner_size(FIRST_SIZE);
            if let Some(fullscreen) = &self.fullscreen {
                attributes = fullscreen.attributes(attributes);
            }
            let window = event_loop.create_window(attributes).map_err(|e| e.to_string())?;
            let window = Arc::new(window);
            self.windows.push((Arc::clone(&window), channel.clone()));
            let surface =
                self.instance.create_surface(Arc::clone(&window)).map_err(|e| e.to_string())?;
            let assignment = match &mut self.fullscreen {
                Some(fullscreen) => fullscreen.adopt(Arc::clone(&window))?,
                None => None,
            };
            displays.push((channel.clone(), WindowOutput::new(window, surface), assignment));
        }
        let instance = self.instance.clone();
        self.links = Some(start(Windows { instance, displays })?);
        Ok(())
    }

    fn end(&mut self, event_loop: &ActiveEventLoop, ended: Result<Ended, String>) {
        self.ended = ended;
        event_loop.exit();
    }

    /// Returns the size that a window is to keep, in pixels.
    fn pixels_of(&self, id: WindowId) -> Option<PhysicalSize<u32>> {
        let full = self.fullscreen.as_ref().and_then(|fullscreen| fullscreen.size_of(id));
        let window = self.windows.iter().find(|(window, _)| window.id() == id);
        full.or_else(|| window.map(|(window, _)| window.inner_size()))
    }

    /// Tells the render thread which monitors its displays are now.
    fn send_assignments(&self, all: Vec<(String, MonitorAssignment)>) {
        for (channel, assignment) in all {
            self.send(RenderTask::MonitorAssigned { channel, assignment });
        }
    }

    fn send(&self, job: RenderTask) {
        if let Some(links) = &self.links {
            // A full queue is a render thread that has more important things to do.
            let _ = links.jobs.try_send(job);
        }
    }

    /// Sends how the mouse or fingers have moved the camera, where that is due.
    fn navigate(&mut self) {
        let Some(links) = &self.links else { return };
        // Without a place in the queue it waits, and goes on to be added up.
        if let Ok(place) = links.reports.try_reserve()
            && let Some(navigation) = self.mouse.take(Instant::now())
        {
            place.send(RenderEvent::Status(ServerMessage::Navigate(navigation)));
        }
    }
}

impl ApplicationHandler<Message> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if let Err(fault) = self.open(event_loop) {
            self.end(event_loop, Err(fault));
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, message: Message) {
        let Some(fullscreen) = &mut self.fullscreen else {
            if matches!(message, Message::End) {
                event_loop.exit();
            }
            return;
        };
        match message {
            Message::End => event_loop.exit(),
            Message::MonitorNames(names) => match fullscreen.handle_names(names) {
                Ok(assignment) => self.send_assignments(assignment),
                Err(fault) => self.end(event_loop, Err(fault)),
            },
            Message::MonitorsChanged => {
                let assignment = fullscreen.handle_change();
                self.send_assignments(assignment);
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        let found = self.windows.iter().find(|(window, _)| window.id() == id);
        let Some((window, channel)) = found else { return };
        self.mouse.handle(channel, window.inner_size(), &event);
        let channel = channel.clone();
        if let (WindowEvent::Resized(_) | WindowEvent::Moved(_), Some(fullscreen)) =
            (&event, &mut self.fullscreen)
        {
            fullscreen.restore(id);
        }
        match event {
            WindowEvent::Resized(size) => self.send(RenderTask::Resized { channel, size }),
            WindowEvent::RedrawRequested => self.send(RenderTask::Redraw { channel }),
            WindowEvent::CloseRequested => match self.on_close {
                Some(tell) => tell(&channel),
                None => self.end(event_loop, Ok(Ended::Closed)),
            },
            WindowEvent::Destroyed => self.end(event_loop, Ok(Ended::Closed)),
            WindowEvent::ScaleFactorChanged { mut inner_size_writer, .. } => {
                // Pixels stay pixels on monitors of any density. It fails only if it is too late.
                if let Some(size) = self.pixels_of(id) {
                    let _ = inner_size_writer.request_inner_size(size);
                }
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.navigate();
        let now = Instant::now();
        let look = now + EVENTS_PERIOD;
        let due = self.mouse.next(now);
        event_loop.set_control_flow(ControlFlow::WaitUntil(due.map_or(look, |due| due.min(look))));
    }
}
