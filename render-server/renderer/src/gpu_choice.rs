//! The choice of one GPU among those of a machine.

use std::fmt;

use super::gpu::GpuError;

/// Facts about an adapter, for reports and for its choice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// For example "llvmpipe (LLVM 15.0.6, 256 bits)".
    pub name: String,
    /// The driver's name.
    pub driver: String,
    /// Its version; pictures are bit-equal only between equal drivers.
    pub driver_info: String,
    /// "vulkan" or "gl".
    pub backend: String,
    /// "DiscreteGpu", "IntegratedGpu", "VirtualGpu", "Cpu" or "Other".
    pub device_type: String,
    /// The address on the PCI bus, such as "0000:65:00.0"; empty where the driver does not tell.
    pub pci_address: String,
    /// Largest width and height of a texture, in pixels.
    pub texture_side_max: u32,
}

impl AdapterInfo {
    pub(crate) fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self {
            name: info.name,
            driver: info.driver,
            driver_info: info.driver_info,
            backend: info.backend.to_string(),
            device_type: format!("{:?}", info.device_type),
            pci_address: info.device_pci_bus_id,
            texture_side_max: adapter.limits().max_texture_dimension_2d,
        }
    }

    /// Returns whether a user means this adapter: by its address, with or without the domain, or
    /// by a part of its name in letters of either case.
    fn is_meant(&self, asked: &str) -> bool {
        let (address, asked) = (self.pci_address.to_lowercase(), asked.to_lowercase());
        let short = address.strip_prefix("0000:").unwrap_or(&address);
        let has_address = !address.is_empty() && (asked == address || asked == short);
        has_address || self.name.to_lowercase().contains(&asked)
    }

    /// The place in the order of choice, from 0. GL comes last also because its depth from −1 to 1
    /// costs reversed depth its precision far away.
    fn rank(&self) -> u32 {
        let kind = match self.device_type.as_str() {
            "DiscreteGpu" => 0,
            "IntegratedGpu" => 1,
            "VirtualGpu" => 2,
            "Cpu" => 4,
            _ => 3,
        };
        if self.backend == "vulkan" { kind } else { 10 + kind }
    }
}

impl fmt::Display for AdapterInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}", self.name, self.backend)?;
        if !self.pci_address.is_empty() {
            write!(f, ", {}", self.pci_address)?;
        }
        write!(f, ")")
    }
}

/// Returns the index of the GPU to open: the best of those that a user means, or of all. Hardware
/// comes before software, and Vulkan before GL.
///
/// # Errors
/// There is none, the user means none of these, or several that are equally good.
pub(crate) fn choose(found: &[AdapterInfo], asked: Option<&str>) -> Result<usize, GpuError> {
    if found.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let Some(asked) = asked else {
        let best = (0..found.len()).min_by_key(|index| found[*index].rank());
        return best.ok_or(GpuError::NoAdapter);
    };
    let is_meant = |index: &usize| found[*index].is_meant(asked);
    let meant: Vec<usize> = (0..found.len()).filter(is_meant).collect();
    let Some(rank) = meant.iter().map(|index| found[*index].rank()).min() else {
        return Err(GpuError::NoneOfName { asked: asked.to_owned(), found: list(found.iter()) });
    };
    let best = || meant.iter().map(|index| &found[*index]).filter(move |it| it.rank() == rank);
    if best().count() > 1 {
        return Err(GpuError::Several { asked: asked.to_owned(), found: list(best()) });
    }
    let first = meant.iter().copied().find(|index| found[*index].rank() == rank);
    first.ok_or(GpuError::NoAdapter)
}

/// Names GPUs for an error of one line.
fn list<'a>(found: impl Iterator<Item = &'a AdapterInfo>) -> String {
    found.map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, backend: &str, device_type: &str, pci_address: &str) -> AdapterInfo {
        AdapterInfo {
            name: name.to_owned(),
            driver: String::new(),
            driver_info: String::new(),
            backend: backend.to_owned(),
            device_type: device_type.to_owned(),
            pci_address: pci_address.to_owned(),
            texture_side_max: 16_384,
        }
    }

    fn workstation() -> [AdapterInfo; 6] {
        [
            adapter("llvmpipe (LLVM 15.0.6, 256 bits)", "vulkan", "Cpu", ""),
            adapter("NVIDIA RTX A6000", "gl", "Other", ""),
            adapter("Intel(R) UHD Graphics 770", "vulkan", "IntegratedGpu", "0000:00:02.0"),
            adapter("NVIDIA RTX A6000", "vulkan", "DiscreteGpu", "0000:17:00.0"),
            adapter("NVIDIA RTX A6000", "vulkan", "DiscreteGpu", "0001:65:00.0"),
            adapter("NVIDIA T400", "vulkan", "DiscreteGpu", "0000:b3:00.0"),
        ]
    }

    #[test]
    fn hardware_with_vulkan_is_the_best_where_nobody_asks() {
        assert_eq!(choose(&workstation(), None).ok(), Some(3));
        assert_eq!(choose(&workstation()[..3], None).ok(), Some(2));
        assert_eq!(choose(&workstation()[..2], None).ok(), Some(0));
        assert!(matches!(choose(&[], Some("any")), Err(GpuError::NoAdapter)));
    }

    #[test]
    fn a_gpu_is_meant_by_a_part_of_its_name_or_its_address() {
        for (asked, index) in [
            ("t400", 5),
            ("UHD", 2),
            ("llvmpipe", 0),
            ("0000:17:00.0", 3),
            ("17:00.0", 3),
            ("0001:65:00.0", 4),
            ("B3:00.0", 5),
        ] {
            assert_eq!(choose(&workstation(), Some(asked)).ok(), Some(index), "{asked}");
        }
        // One card with two drivers is no question.
        assert_eq!(choose(&workstation()[..4], Some("a6000")).ok(), Some(3));
    }

    #[test]
    fn a_name_of_none_or_of_several_is_refused_with_what_there_is() {
        let error = choose(&workstation()[2..], Some("GTX")).expect_err("none").to_string();
        assert!(error.contains("no GPU here is \"GTX\""), "{error}");
        assert!(error.contains("Intel(R) UHD Graphics 770 (vulkan, 0000:00:02.0)"), "{error}");
        // A short address is one of the first domain.
        assert!(choose(&workstation(), Some("65:00.0")).is_err());
        let error = choose(&workstation(), Some("A6000")).expect_err("two").to_string();
        assert!(error.contains("several GPUs") && error.contains("0001:65:00.0"), "{error}");
        assert!(!error.contains("T400"), "{error}");
    }
}
