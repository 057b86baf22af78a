//! Kernels as the build describes them, and the pipelines made of them.

use super::access::Need;
use super::raw::Raw;
use super::{Access, Buffer, Sampled, Storage, failed};
use crate::error::{Error, Result};
use ash::vk;
use std::sync::Arc;

/// A compiled kernel and what its GLSL declares. Made by `build.rs` only.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct KernelInfo {
    /// Stem of its file.
    pub name: &'static str,
    pub(crate) spirv: &'static [u32],
    /// Its bindings in set 0, in order of their numbers.
    pub bindings: &'static [BindingInfo],
    /// Bytes of its push constants.
    pub push_bytes: u32,
    /// Invocations of a work group along x, y, z.
    pub local_size: [u32; 3],
    /// Ids of its specialization constants.
    pub spec_ids: &'static [u32],
}

/// One binding of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BindingInfo {
    /// Its name in the GLSL.
    pub name: &'static str,
    /// Its number in set 0.
    pub number: u32,
    /// What is bound.
    pub kind: BindingKind,
    /// What the kernel does with it.
    pub access: Access,
}

/// Kinds of bindings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// `buffer`
    StorageBuffer,
    /// `image3D`
    StorageImage,
    /// `sampler3D`
    SampledImage,
    /// `uniform` block
    UniformBuffer,
}

impl BindingInfo {
    pub(super) fn need(&self) -> Need {
        match (self.kind, self.access) {
            (BindingKind::SampledImage, _) => Need::Sample,
            (BindingKind::StorageImage, Access::ComputeRead) => Need::ImageLoad,
            (BindingKind::StorageImage, Access::ComputeWrite) => Need::ImageStore,
            (BindingKind::StorageImage, _) => Need::ImageLoadStore,
            (BindingKind::UniformBuffer, _) | (_, Access::ComputeRead) => Need::BufferRead,
            (BindingKind::StorageBuffer, Access::ComputeWrite) => Need::BufferWrite,
            (BindingKind::StorageBuffer, _) => Need::BufferReadWrite,
        }
    }

    pub(super) fn descriptor_type(&self) -> vk::DescriptorType {
        match self.kind {
            BindingKind::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
            BindingKind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
            BindingKind::SampledImage => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            BindingKind::UniformBuffer => vk::DescriptorType::UNIFORM_BUFFER,
        }
    }
}

/// What a kernel is given, by name. Generated for every kernel.
pub trait Bindings {
    /// The kernel.
    const KERNEL: KernelInfo;
    /// Its push constants.
    type Params: bytemuck::Pod;
    /// Its specialization constants.
    type Spec: Specialization;
    /// What is bound, in the order of `KERNEL.bindings`.
    fn bound(&self) -> Vec<Bound<'_>>;
}

/// Values of specialization constants.
pub trait Specialization {
    /// Their bits, in the order of [`KernelInfo::spec_ids`].
    fn words(&self) -> Vec<u32>;
}

impl Specialization for () {
    fn words(&self) -> Vec<u32> {
        Vec::new()
    }
}

/// One bound resource.
#[derive(Clone, Copy)]
pub enum Bound<'a> {
    /// A buffer.
    Buffer(&'a Buffer),
    /// One level of an image, loaded from or stored to.
    Storage(Storage<'a>),
    /// Levels of an image through a sampler.
    Sampled(Sampled<'a>),
}

/// A kernel ready to run.
pub(super) struct Pipeline {
    raw: Arc<Raw>,
    pub pipeline: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub set_layout: vk::DescriptorSetLayout,
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: whoever recorded it holds an `Arc` of this until the work is done; nulls are allowed.
        unsafe {
            self.raw.device.destroy_pipeline(self.pipeline, None);
            self.raw.device.destroy_pipeline_layout(self.layout, None);
            self.raw.device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

impl Pipeline {
    pub(super) fn new(raw: &Arc<Raw>, cache: vk::PipelineCache, kernel: &KernelInfo, spec: &[u32]) -> Result<Self> {
        check_limits(raw, kernel, spec)?;
        // Filled step by step, so that a failure on the way drops what was made.
        let mut made = Self {
            raw: raw.clone(),
            pipeline: vk::Pipeline::null(),
            layout: vk::PipelineLayout::null(),
            set_layout: vk::DescriptorSetLayout::null(),
        };
        let bindings: Vec<_> = kernel
            .bindings
            .iter()
            .map(|b| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(b.number)
                    .descriptor_type(b.descriptor_type())
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let device = &raw.device;
        let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: all pointers of the structure live until the call returns. The same holds for the calls below.
        made.set_layout = unsafe { device.create_descriptor_set_layout(&create, None) }.map_err(failed("vkCreateDescriptorSetLayout"))?;
        let layouts = [made.set_layout];
        let ranges = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(kernel.push_bytes)];
        let create = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts).push_constant_ranges(if kernel.push_bytes > 0 {
            &ranges
        } else {
            &[]
        });
        // SAFETY: see above.
        made.layout = unsafe { device.create_pipeline_layout(&create, None) }.map_err(failed("vkCreatePipelineLayout"))?;

        let create = vk::ShaderModuleCreateInfo::default().code(kernel.spirv);
        // SAFETY: see above; the words are the compiler's own output.
        let module = unsafe { device.create_shader_module(&create, None) }.map_err(failed("vkCreateShaderModule"))?;
        let entries: Vec<_> = kernel
            .spec_ids
            .iter()
            .zip((0..).step_by(4))
            .map(|(&id, offset)| vk::SpecializationMapEntry { constant_id: id, offset, size: 4 })
            .collect();
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(spec));
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&special);
        let create = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(made.layout)];
        // SAFETY: see above.
        let pipelines = unsafe { device.create_compute_pipelines(cache, &create, None) };
        // SAFETY: a module may go once its pipelines are made.
        unsafe { device.destroy_shader_module(module, None) };
        made.pipeline = pipelines
            .map_err(|(_, e)| failed("vkCreateComputePipelines")(e))?
            .first()
            .copied()
            .ok_or(Error::Vulkan { call: "vkCreateComputePipelines", result: String::from("no pipeline") })?;
        raw.name(made.pipeline, kernel.name);
        Ok(made)
    }
}

fn check_limits(raw: &Raw, kernel: &KernelInfo, spec: &[u32]) -> Result<()> {
    let limits = &raw.limits;
    let mut lacks = Vec::new();
    let [x, y, z] = kernel.local_size;
    if x.saturating_mul(y).saturating_mul(z) > limits.max_compute_work_group_invocations
        || (0..3).any(|i| kernel.local_size[i] > limits.max_compute_work_group_size[i])
    {
        lacks.push(format!("room for work groups of {x}×{y}×{z} (kernel '{}')", kernel.name));
    }
    let count = |kind| kernel.bindings.iter().filter(|b| b.kind == kind).count() as u64;
    for (kind, most, limit) in [
        (BindingKind::StorageBuffer, limits.max_per_stage_descriptor_storage_buffers, "maxPerStageDescriptorStorageBuffers"),
        (BindingKind::StorageImage, limits.max_per_stage_descriptor_storage_images, "maxPerStageDescriptorStorageImages"),
        (BindingKind::SampledImage, limits.max_per_stage_descriptor_sampled_images, "maxPerStageDescriptorSampledImages"),
        (BindingKind::UniformBuffer, limits.max_per_stage_descriptor_uniform_buffers, "maxPerStageDescriptorUniformBuffers"),
    ] {
        if count(kind) > u64::from(most) {
            lacks.push(format!("{limit} ≥ {} (kernel '{}')", count(kind), kernel.name));
        }
    }
    if !lacks.is_empty() {
        return Err(Error::DeviceLacks { device: raw.info.name.clone(), lacks: lacks.join(", ") });
    }
    if spec.len() != kernel.spec_ids.len() {
        return Err(Error::Invalid {
            item: "specialization constants",
            what: format!("{} given to kernel '{}'", spec.len(), kernel.name),
            right: format!("it has {}", kernel.spec_ids.len()),
        });
    }
    Ok(())
}
