//! Device memory: the budget that is kept, and what is handed out of it.

use super::raw::Raw;
use super::{DeviceInfo, DeviceKind, lock};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};

/// Device memory of buffers and images, in bytes. The runtime's own staging (at most 64 MiB) is not counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Held now.
    pub used: u64,
    /// Most ever held.
    pub peak: u64,
    /// Most that may be held.
    pub budget: u64,
}

impl Raw {
    pub(super) fn memory(&self) -> Memory {
        *lock(&self.memory)
    }

    /// Takes `bytes` from the budget.
    fn reserve(&self, what: &str, bytes: u64) -> Result<()> {
        let mut memory = lock(&self.memory);
        let free = memory.budget.saturating_sub(memory.used);
        if bytes > free {
            return Err(Error::OutOfMemory {
                what: what.to_owned(),
                needs: bytes,
                free,
                budget: memory.budget,
                right: String::from("ask for less, free what is not needed, or raise the memory budget"),
            });
        }
        memory.used += bytes;
        memory.peak = memory.peak.max(memory.used);
        Ok(())
    }

    fn release(&self, bytes: u64) {
        let mut memory = lock(&self.memory);
        memory.used = memory.used.saturating_sub(bytes);
    }

    /// Memory for a buffer or an image, inside the budget if `counted`.
    pub(super) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
        scheme: AllocationScheme,
        counted: bool,
    ) -> Result<Allocation> {
        if requirements.size > self.info.max_allocation {
            return Err(Error::OutOfMemory {
                what: format!("'{name}'"),
                needs: requirements.size,
                free: self.info.max_allocation,
                budget: self.info.max_allocation,
                right: String::from("the device allows no larger single allocation (maxMemoryAllocationSize): make it smaller or split it"),
            });
        }
        if counted {
            self.reserve(&format!("'{name}'"), requirements.size)?;
        }
        let desc = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme: scheme };
        let made = lock(&self.allocator).allocate(&desc);
        made.map_err(|e| {
            if counted {
                self.release(requirements.size);
            }
            let memory = self.memory();
            Error::OutOfMemory {
                what: format!("'{name}' ({e})"),
                needs: requirements.size,
                free: memory.budget.saturating_sub(memory.used),
                budget: memory.budget,
                right: String::from("the device gave none although the budget allows it: lower the budget or ask for less"),
            }
        })
    }

    /// Gives memory back.
    ///
    /// # Safety
    /// No living object is bound to it.
    pub(super) unsafe fn free(&self, allocation: Allocation, counted: bool) {
        if counted {
            self.release(allocation.size());
        }
        if let Err(e) = lock(&self.allocator).free(allocation) {
            log::warn!("device memory was not freed: {e}");
        }
    }
}

pub(super) fn allocator(instance: &ash::Instance, device: &ash::Device, physical: vk::PhysicalDevice) -> Result<Allocator> {
    Allocator::new(&AllocatorCreateDesc {
        instance: instance.clone(),
        device: device.clone(),
        physical_device: physical,
        debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
        buffer_device_address: false,
        // Large objects have memory of their own; the rest is small.
        allocation_sizes: gpu_allocator::AllocationSizes::new(64 << 20, 32 << 20),
    })
    .map_err(|e| Error::Vulkan { call: "the allocator's start", result: e.to_string() })
}

/// 80 % of the device's heap. A CPU device shares the machine's memory and its heap size means little (lavapipe overcommits until
/// the kernel kills): 60 % of what is available.
pub(super) fn default_budget(info: &DeviceInfo) -> u64 {
    let heap = info.heap_bytes / 5 * 4;
    match (info.kind, available_memory()) {
        (DeviceKind::Cpu, Some(bytes)) => bytes / 5 * 3,
        _ => heap,
    }
}

/// Bytes of main memory that are available, where the system says so; a container's limit counts.
fn available_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    let limit = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|t| t.trim().parse().ok()).unwrap_or(u64::MAX);
    Some(kib.saturating_mul(1024).min(limit))
}
