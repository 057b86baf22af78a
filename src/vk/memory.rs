//! Device memory: the budget that is kept, and what is handed out of it.

use super::raw::Raw;
use super::{DeviceInfo, DeviceKind, lock};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use std::path::{Path, PathBuf};

/// Device memory that buffers and images ask for, in bytes. Not counted: the runtime's own staging, at most two blocks of 32 MiB,
/// and what is free in the blocks that buffers of up to 16 MiB share, 64 MiB each (32 where the host sees the memory): up to one
/// block, and less than 16 MiB of each further one while nothing has been freed between.
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

/// Bytes of main memory that are available, where the system says so; limits of the groups that the process is in count.
fn available_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    Some(kib.saturating_mul(1024).min(left_to_groups(&groups, Path::new("/sys/fs/cgroup"))))
}

/// What the memory limits of control groups leave (docs.kernel.org, admin-guide, cgroup-v1/memory and cgroup-v2): the least of
/// limit − use over each group and those above it, where cached files, which the kernel drops, are no use. `groups` is a
/// process' list of its groups, `root` where they are mounted; a container sees its own group there, whatever the list says.
fn left_to_groups(groups: &str, root: &Path) -> u64 {
    let number = |path: PathBuf| std::fs::read_to_string(path).ok().and_then(|t| t.trim().parse::<u64>().ok());
    let mut left = u64::MAX;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(kinds), Some(group)) = (parts.next(), parts.next()) else { continue };
        let (mount, limit, used, sums) = match kinds {
            "" => (root.to_owned(), "memory.max", "memory.current", ""),
            _ if kinds.split(',').any(|k| k == "memory") => {
                (root.join("memory"), "memory.limit_in_bytes", "memory.usage_in_bytes", "total_")
            }
            _ => continue,
        };
        for group in Path::new(group.trim_start_matches('/')).ancestors() {
            let folder = mount.join(group);
            let Some(limit) = number(folder.join(limit)) else { continue };
            let stat = std::fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
            let cached = |line: &str| {
                let line = line.strip_prefix(sums)?;
                line.strip_prefix("inactive_file ").or_else(|| line.strip_prefix("active_file "))?.trim().parse::<u64>().ok()
            };
            let dropped = stat.lines().filter_map(cached).fold(0, u64::saturating_add);
            let used = number(folder.join(used)).unwrap_or(0).saturating_sub(dropped);
            left = left.min(limit.saturating_sub(used));
        }
    }
    left
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_tightest_group_decides() {
        let root = tempfile::tempdir().unwrap();
        let write = |folder: &str, files: &[(&str, &str)]| {
            let folder = root.path().join(folder);
            std::fs::create_dir_all(&folder).unwrap();
            for (name, text) in files {
                std::fs::write(folder.join(name), text).unwrap();
            }
        };
        let left = |groups: &str| left_to_groups(groups, root.path());
        assert_eq!(left("0::/\n"), u64::MAX, "no limits are there");
        write("a/b", &[("memory.max", "max\n"), ("memory.current", "5000\n")]);
        assert_eq!(left("0::/a/b\n"), u64::MAX);
        write(
            "a",
            &[
                ("memory.max", "9000\n"),
                ("memory.current", "5000\n"),
                ("memory.stat", "anon 1\ninactive_file 600\nactive_file 400\nslab 7\n"),
            ],
        );
        assert_eq!(left("0::/a/b\n"), 5000, "the group above limits, and cached files do not count");
        write("a/b", &[("memory.max", "7000\n"), ("memory.current", "7500\n")]);
        assert_eq!(left("0::/a/b\n"), 0);
        write("memory/c", &[("memory.limit_in_bytes", "800\n"), ("memory.usage_in_bytes", "300\n")]);
        assert_eq!(left("5:cpu,cpuacct:/a\n4:memory:/c\n"), 500, "the older form");
        // Inside a container the list may name a path that only the host sees.
        write("", &[("memory.max", "6000\n"), ("memory.current", "1000\n")]);
        assert_eq!(left("0::/docker/1234\n"), 5000);
    }
}
