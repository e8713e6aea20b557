//! The adapter that this process draws with, for tests of the renderer itself.

use std::sync::OnceLock;

use polyptych_renderer::Gpu;

/// The best adapter of this machine; software will do.
pub fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    // The message names the package that has a driver.
    GPU.get_or_init(|| Gpu::headless().unwrap_or_else(|error| panic!("{error}")))
}
