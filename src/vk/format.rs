//! The texel formats in use.

use ash::vk;

/// A texel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[allow(missing_docs)]
pub enum Format {
    R8Unorm,
    R8Uint,
    R8Sint,
    Rgba8Unorm,
    R16Unorm,
    R16Sfloat,
    R16Uint,
    R16Sint,
    Rg16Unorm,
    Rg16Sfloat,
    Rgba16Unorm,
    Rgba16Sfloat,
    R32Uint,
    R32Sfloat,
    Rg32Uint,
    Rg32Sfloat,
    Rgba32Uint,
    Rgba32Sfloat,
}

const ALL: [Format; 18] = [
    Format::R8Unorm,
    Format::R8Uint,
    Format::R8Sint,
    Format::Rgba8Unorm,
    Format::R16Unorm,
    Format::R16Sfloat,
    Format::R16Uint,
    Format::R16Sint,
    Format::Rg16Unorm,
    Format::Rg16Sfloat,
    Format::Rgba16Unorm,
    Format::Rgba16Sfloat,
    Format::R32Uint,
    Format::R32Sfloat,
    Format::Rg32Uint,
    Format::Rg32Sfloat,
    Format::Rgba32Uint,
    Format::Rgba32Sfloat,
];

impl Format {
    /// The format of a `VkFormat`, if it is one of these.
    pub fn of_vulkan(raw: i32) -> Option<Self> {
        ALL.into_iter().find(|f| f.vulkan() == raw)
    }

    /// The `VkFormat`.
    pub fn vulkan(self) -> i32 {
        self.raw().as_raw()
    }

    /// Bytes of one texel.
    pub fn bytes(self) -> u32 {
        match self {
            Self::R8Unorm | Self::R8Uint | Self::R8Sint => 1,
            Self::R16Unorm | Self::R16Sfloat | Self::R16Uint | Self::R16Sint => 2,
            Self::Rgba8Unorm | Self::Rg16Unorm | Self::Rg16Sfloat | Self::R32Uint | Self::R32Sfloat => 4,
            Self::Rgba16Unorm | Self::Rgba16Sfloat | Self::Rg32Uint | Self::Rg32Sfloat => 8,
            Self::Rgba32Uint | Self::Rgba32Sfloat => 16,
        }
    }

    pub(super) fn raw(self) -> vk::Format {
        match self {
            Self::R8Unorm => vk::Format::R8_UNORM,
            Self::R8Uint => vk::Format::R8_UINT,
            Self::R8Sint => vk::Format::R8_SINT,
            Self::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
            Self::R16Unorm => vk::Format::R16_UNORM,
            Self::R16Sfloat => vk::Format::R16_SFLOAT,
            Self::R16Uint => vk::Format::R16_UINT,
            Self::R16Sint => vk::Format::R16_SINT,
            Self::Rg16Unorm => vk::Format::R16G16_UNORM,
            Self::Rg16Sfloat => vk::Format::R16G16_SFLOAT,
            Self::Rgba16Unorm => vk::Format::R16G16B16A16_UNORM,
            Self::Rgba16Sfloat => vk::Format::R16G16B16A16_SFLOAT,
            Self::R32Uint => vk::Format::R32_UINT,
            Self::R32Sfloat => vk::Format::R32_SFLOAT,
            Self::Rg32Uint => vk::Format::R32G32_UINT,
            Self::Rg32Sfloat => vk::Format::R32G32_SFLOAT,
            Self::Rgba32Uint => vk::Format::R32G32B32A32_UINT,
            Self::Rgba32Sfloat => vk::Format::R32G32B32A32_SFLOAT,
        }
    }
}
