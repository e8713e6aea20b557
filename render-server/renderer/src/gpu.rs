//! The adapter, its device and queue, and what went wrong on them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tracing::{info, warn};

use crate::gpu_choice::{AdapterInfo, choose};

/// Maximum time for which the GPU is waited for; one that takes longer is taken for one that hangs.
pub(crate) const GPU_WAIT_MAX: Duration = Duration::from_secs(30);

/// What timestamps between passes need.
const TIMESTAMPS: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

/// Draws whose arguments the GPU reads can begin with any instance.
const INDIRECT_INSTANCES: wgpu::Features = wgpu::Features::INDIRECT_FIRST_INSTANCE;

/// Why no GPU could be opened.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// Not even a software driver.
    #[error(
        "no Vulkan or GL driver was found; on Debian or Ubuntu: apt install mesa-vulkan-drivers"
    )]
    NoAdapter,
    /// There are drivers, but none that can present to the given window.
    #[error("none of the drivers can draw to this window: {0}")]
    NoneForSurface(String),
    /// There is no such GPU.
    #[error("no GPU here is {asked:?} by a part of its name or its PCI address; there is {found}")]
    NoneOfName {
        /// The name that was asked for.
        asked: String,
        /// All GPUs.
        found: String,
    },
    /// The name does not say which.
    #[error("several GPUs here are {asked:?}: {found}; give the PCI address of one")]
    Several {
        /// The name that was asked for.
        asked: String,
        /// Those that it names.
        found: String,
    },
    /// The driver refused to make a device.
    #[error("{adapter} refused to open: {reason}")]
    Device {
        /// The adapter's name.
        adapter: String,
        /// In the driver's words.
        reason: String,
    },
}

/// One opened adapter. The device reports faults here instead of panicking.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// Also makes surfaces.
    pub instance: wgpu::Instance,
    /// The one that was chosen.
    pub adapter: wgpu::Adapter,
    /// Makes buffers, textures and pipelines.
    pub device: wgpu::Device,
    /// Takes work.
    pub queue: wgpu::Queue,
    fault: Arc<Mutex<Option<GpuFault>>>,
    losses: Arc<AtomicU64>,
}

/// Why a device can not be used any more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuFault {
    /// The remedy.
    pub kind: GpuFaultKind,
    /// In the driver's words.
    pub reason: String,
}

/// The remedy for a fault of a device, beside opening another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpuFaultKind {
    /// Nothing: its driver was reset, or refused a call.
    Lost,
    /// Less must be kept on it.
    OutOfMemory,
    /// It may never give back what it holds: it does not finish its work.
    Hangs,
}

impl Gpu {
    /// Opens the best adapter without a window.
    ///
    /// # Errors
    /// No driver, or the driver refuses.
    pub fn headless() -> Result<Self, GpuError> {
        Self::open(Self::headless_instance(), None, None)
    }

    /// As [`Self::headless`], without what only some adapters have.
    #[cfg(test)]
    pub(crate) fn plain() -> Result<Self, GpuError> {
        let mut gpu = Self::headless()?;
        (gpu.device, gpu.queue) = open_device(&gpu.adapter, wgpu::Features::empty())?;
        gpu.watch();
        Ok(gpu)
    }

    /// An instance that needs no display.
    pub fn headless_instance() -> wgpu::Instance {
        Self::instance(wgpu::InstanceDescriptor::new_without_display_handle)
    }

    /// Returns whether it can tell when it is at a place of its work.
    pub(crate) fn has_timestamps(&self) -> bool {
        self.device.features().contains(TIMESTAMPS)
    }

    /// Returns whether it reads the arguments of draws by itself.
    pub(crate) fn draws_indirectly(&self) -> bool {
        let flags = self.adapter.get_downlevel_capabilities().flags;
        self.device.features().contains(INDIRECT_INSTANCES)
            && flags.contains(wgpu::DownlevelFlags::INDIRECT_EXECUTION)
    }

    /// Returns the GPUs of this machine that can be opened, with their drivers.
    pub fn list() -> Vec<AdapterInfo> {
        adapters(&Self::headless_instance()).iter().map(AdapterInfo::of).collect()
    }

    /// An instance of Vulkan where there is a driver for it, else of GL; `WGPU_BACKEND` and,
    /// through the loader, `VK_DRIVER_FILES` are honoured. `describe` gives the window system.
    ///
    /// GL is not even looked at where Vulkan will do: its libraries complain on machines without
    /// a screen.
    pub fn instance(describe: impl Fn() -> wgpu::InstanceDescriptor) -> wgpu::Instance {
        let chosen = wgpu::Backends::from_env();
        let with = |backends| {
            let mut descriptor = describe().with_env();
            descriptor.backends = backends;
            // What is drawn indirectly was checked here, as what is drawn directly is.
            descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
            wgpu::Instance::new(descriptor)
        };
        let first = with(chosen.unwrap_or(wgpu::Backends::VULKAN));
        let found = pollster::block_on(first.enumerate_adapters(wgpu::Backends::all()));
        if found.is_empty() && chosen.is_none() { with(wgpu::Backends::GL) } else { first }
    }

    /// Opens the best adapter that can present to the surface: hardware Vulkan, else software
    /// Vulkan, else GL. `asked` is a part of the name of the only one that will do, or its PCI
    /// address.
    ///
    /// # Errors
    /// No driver, none for this surface, none or several that are asked for, or the driver refuses.
    pub fn open(
        instance: wgpu::Instance,
        compatible_surface: Option<&wgpu::Surface<'_>>,
        asked: Option<&str>,
    ) -> Result<Self, GpuError> {
        let mut adapters = adapters(&instance);
        let found: Vec<AdapterInfo> = adapters.iter().map(AdapterInfo::of).collect();
        // One that is asked for and cannot present is another mistake than one that is not there.
        let mut chosen = choose(&found, asked)?;
        if let Some(surface) = compatible_surface {
            adapters.retain(|adapter| adapter.is_surface_supported(surface));
            let left: Vec<AdapterInfo> = adapters.iter().map(AdapterInfo::of).collect();
            let names: Vec<String> = found.iter().map(ToString::to_string).collect();
            let none = |_| GpuError::NoneForSurface(names.join(", "));
            chosen = choose(&left, asked).map_err(none)?;
        }
        let adapter = adapters.swap_remove(chosen);
        let gpu = Self::of(instance, adapter, Arc::default())?;
        let facts = gpu.info();
        info!(adapter = facts.name, driver = facts.driver_info, backend = facts.backend, "gpu");
        Ok(gpu)
    }

    fn of(
        instance: wgpu::Instance,
        adapter: wgpu::Adapter,
        losses: Arc<AtomicU64>,
    ) -> Result<Self, GpuError> {
        let (device, queue) = open_device(&adapter, TIMESTAMPS | INDIRECT_INSTANCES)?;
        let gpu = Self { instance, adapter, device, queue, fault: Arc::default(), losses };
        gpu.watch();
        Ok(gpu)
    }

    /// Returns the number of devices of this adapter that had a fault; it goes on rising when the
    /// adapter is opened again. Other threads learn from it that what they had made is gone.
    pub fn losses(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.losses)
    }

    /// Opens the same adapter again, after its device was lost. Nothing that was made on the lost
    /// device can be used on the new one.
    ///
    /// # Errors
    /// The driver refuses; while it resets, it may do so for a moment.
    pub fn reopened(&self) -> Result<Self, GpuError> {
        Self::of(self.instance.clone(), self.adapter.clone(), self.losses())
    }

    /// Gives the device up for a fault, unless it has one already. What is done with it fails from
    /// then on.
    pub fn give_up(&self, kind: GpuFaultKind, reason: &str) {
        keep(&self.fault, &self.losses, kind, reason.to_owned());
        // A device that hangs is not told to do anything more.
        if kind != GpuFaultKind::Hangs {
            self.device.destroy();
        }
    }

    /// Waits until the GPU has done this submission, or all that it was given if `submission` is
    /// `None`. A GPU that takes more than 30 s is given up as one that hangs; one that has a fault
    /// already is not waited for.
    ///
    /// # Errors
    /// The device is lost, hangs, or is out of memory.
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), GpuFault> {
        self.wait_at_most(submission, GPU_WAIT_MAX)
    }

    /// Waits as [`Self::wait`] does, for another time.
    pub(crate) fn wait_at_most(
        &self,
        submission: Option<wgpu::SubmissionIndex>,
        limit: Duration,
    ) -> Result<(), GpuFault> {
        // A device that hangs is waited for once, and not again for each target.
        if let Some(fault) = self.first_fault() {
            return Err(fault);
        }
        let wait = wgpu::PollType::Wait { submission_index: submission, timeout: Some(limit) };
        let waited = self.device.poll(wait);
        if matches!(waited, Err(wgpu::PollError::Timeout)) {
            // One that is only busy ends within this time, and its channel is late.
            let seconds = limit.as_secs_f64();
            let reason = format!("the GPU or its driver hangs: no frame within {seconds} s");
            self.give_up(GpuFaultKind::Hangs, &reason);
        }
        match (self.first_fault(), waited) {
            (Some(fault), _) => Err(fault),
            (None, Err(error)) => {
                Err(GpuFault { kind: GpuFaultKind::Lost, reason: error.to_string() })
            }
            (None, Ok(_)) => Ok(()),
        }
    }

    fn watch(&self) {
        let (fault, losses) = (Arc::clone(&self.fault), self.losses());
        self.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let kind = match error {
                wgpu::Error::OutOfMemory { .. } => GpuFaultKind::OutOfMemory,
                _ => GpuFaultKind::Lost,
            };
            keep(&fault, &losses, kind, error.to_string());
        }));
        let (fault, losses) = (Arc::clone(&self.fault), self.losses());
        self.device.set_device_lost_callback(move |reason, message| {
            // Dropping the device on purpose is no fault.
            if reason != wgpu::DeviceLostReason::Destroyed {
                keep(&fault, &losses, GpuFaultKind::Lost, format!("device lost: {message}"));
            }
        });
    }

    /// Returns facts about the adapter.
    pub fn info(&self) -> AdapterInfo {
        AdapterInfo::of(&self.adapter)
    }

    /// Returns whether it is used by GL: depths in clip space go from −1 to 1, the number of layers
    /// of a texture decides its kind, and depths cannot be copied.
    pub(crate) fn is_gl(&self) -> bool {
        self.adapter.get_info().backend == wgpu::Backend::Gl
    }

    /// Returns how many layers a texture needs of which so many are read as an array.
    pub(crate) fn array_layers(&self, layers: u32) -> u32 {
        array_layers(self.is_gl(), layers)
    }

    /// Returns whether lamps have maps of their shadows; `false` with GL, whose depths do not tell
    /// apart what is far from a lamp, and whose fragments read 16 textures, which others fill.
    pub(crate) fn has_lamp_maps(&self) -> bool {
        !self.is_gl()
    }

    /// Returns whether a texture can be written as sRGB and as plain bytes; `false` with GL.
    pub(crate) fn views_other_formats(&self) -> bool {
        let flags = self.adapter.get_downlevel_capabilities().flags;
        flags.contains(wgpu::DownlevelFlags::VIEW_FORMATS)
    }

    /// The first fault of the device since it was opened, in words.
    pub fn take_error(&self) -> Option<String> {
        self.first_fault().map(|fault| fault.reason)
    }

    /// The first fault of the device since it was opened: lost, out of memory, or a mistake of
    /// ours. The owner opens a new [`Gpu`] then.
    pub fn first_fault(&self) -> Option<GpuFault> {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

fn adapters(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let backends = wgpu::Backends::VULKAN | wgpu::Backends::GL;
    pollster::block_on(instance.enumerate_adapters(backends))
}

/// Opens a device with those of these features that there are.
fn open_device(
    adapter: &wgpu::Adapter,
    features: wgpu::Features,
) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    let offered = adapter.limits();
    // The portable floor, but with room for large canvases and large scenes.
    let limits = wgpu::Limits {
        max_texture_dimension_2d: offered.max_texture_dimension_2d,
        max_buffer_size: offered.max_buffer_size,
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        // Glass with a grain, lamps, surroundings and ambient occlusion together read 17, and 16
        // where lamps have no maps.
        max_sampled_textures_per_shader_stage: offered.max_sampled_textures_per_shader_stage,
        ..wgpu::Limits::downlevel_defaults()
    };
    let request = adapter.request_device(&wgpu::DeviceDescriptor {
        label: Some("gpu/device"),
        required_limits: limits,
        // How long passes take is measured where that can be.
        required_features: adapter.features() & features,
        ..Default::default()
    });
    pollster::block_on(request).map_err(|error| GpuError::Device {
        adapter: adapter.get_info().name,
        reason: error.to_string(),
    })
}

fn keep(fault: &Mutex<Option<GpuFault>>, losses: &AtomicU64, kind: GpuFaultKind, reason: String) {
    let mut first = fault.lock().unwrap_or_else(PoisonError::into_inner);
    // What follows from it is not news: every call on a lost device fails.
    if first.is_none() {
        warn!(fault = reason, "gpu");
        *first = Some(GpuFault { kind, reason });
        losses.fetch_add(1, Ordering::SeqCst);
    }
}

/// By GL one layer is no array, and six are a cube, whatever a view says: what is none is read as
/// black.
fn array_layers(is_gl: bool, layers: u32) -> u32 {
    let is_array = layers > 1 && !layers.is_multiple_of(6);
    if is_gl && !is_array { layers + 1 } else { layers }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_gl_have_a_number_of_layers_that_is_no_other_kind() {
        assert_eq!([1, 2, 3, 6, 7, 12].map(|of| array_layers(true, of)), [2, 2, 3, 7, 7, 13]);
        assert_eq!([1, 6].map(|of| array_layers(false, of)), [1, 6]);
    }
}
