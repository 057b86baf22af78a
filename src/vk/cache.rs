//! The pipeline cache: one file per device and driver. A damaged or foreign file is as good as none.

use super::failed;
use super::select::DeviceInfo;
use crate::error::Result;
use ash::vk;
use std::io::Write;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"halfpipe";
/// Magic, length, checksum.
const HEADER: usize = 24;
/// A larger file is not ours.
const MOST: u64 = 256 << 20;

/// The file of this device, where a cache is wanted and has a place.
pub(super) fn path(folder: Option<&Path>, info: &DeviceInfo) -> Option<PathBuf> {
    let folder = match folder {
        Some(folder) if folder.as_os_str().is_empty() => return None,
        Some(folder) => folder.to_owned(),
        None => std::env::var_os("XDG_CACHE_HOME")
            .map(PathBuf::from)
            .filter(|p| p.is_absolute())
            .or_else(|| std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".cache")).filter(|p| p.is_absolute()))?
            .join("halflight"),
    };
    Some(folder.join(format!("pipelines-{}-{:08x}.bin", info.uuid, info.driver_version)))
}

/// Makes the cache, from the file where it is whole. A driver must never see damaged data: not all of them check.
pub(super) fn open(device: &ash::Device, path: Option<&Path>) -> Result<vk::PipelineCache> {
    let data = path.and_then(load).unwrap_or_default();
    let create = vk::PipelineCacheCreateInfo::default().initial_data(&data);
    // SAFETY: the data lives until the call returns; its checksum says that it is what the same driver wrote.
    match unsafe { device.create_pipeline_cache(&create, None) } {
        Ok(cache) => Ok(cache),
        Err(e) if !data.is_empty() => {
            log::debug!("the pipeline cache is refused ({e:?}); starting an empty one");
            // SAFETY: as above, without data.
            unsafe { device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None) }.map_err(failed("vkCreatePipelineCache"))
        }
        Err(e) => Err(failed("vkCreatePipelineCache")(e)),
    }
}

/// Writes the cache back. Failing costs the next start some time and nothing else.
pub(super) fn save(device: &ash::Device, cache: vk::PipelineCache, path: &Path) {
    // SAFETY: the cache is alive.
    let Ok(data) = (unsafe { device.get_pipeline_cache_data(cache) }) else { return };
    if load(path).is_some_and(|old| old == data) {
        return;
    }
    if let Some(folder) = path.parent()
        && let Err(e) = std::fs::create_dir_all(folder)
    {
        log::debug!("{}: cannot create: {e}", folder.display());
        return;
    }
    let written = crate::aside::write_aside(path, |out| {
        let mut put =
            |bytes: &[u8]| out.write_all(bytes).map_err(|source| crate::Error::Io { path: path.to_owned(), action: "write", source });
        put(MAGIC)?;
        put(&(data.len() as u64).to_le_bytes())?;
        put(&checksum(&data).to_le_bytes())?;
        put(&data)
    });
    if let Err(e) = written {
        log::debug!("pipeline cache: {e}");
    }
}

fn load(path: &Path) -> Option<Vec<u8>> {
    if std::fs::metadata(path).ok()?.len() > MOST {
        return None;
    }
    let file = std::fs::read(path).ok()?;
    let (head, data) = file.split_at_checked(HEADER)?;
    let word = |at: usize| head.get(at..at + 8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
    let whole = head.starts_with(MAGIC) && word(8)? == data.len() as u64 && word(16)? == checksum(data);
    if !whole {
        log::debug!("{}: damaged, ignored", path.display());
    }
    whole.then(|| data.to_owned())
}

/// FNV-1a, 64 bits.
fn checksum(data: &[u8]) -> u64 {
    data.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}
