//! The texel formats in use.

use ash::vk;

/// A texel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[allow(missing_docs)]
pub enum Format {
    R8Unorm,
    R8Uint,
    Rgba8Unorm,
    R16Unorm,
    R16Sfloat,
    R16Uint,
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

impl Format {
    /// Bytes of one texel.
    pub fn bytes(self) -> u32 {
        match self {
            Self::R8Unorm | Self::R8Uint => 1,
            Self::R16Unorm | Self::R16Sfloat | Self::R16Uint => 2,
            Self::Rgba8Unorm | Self::Rg16Unorm | Self::Rg16Sfloat | Self::R32Uint | Self::R32Sfloat => 4,
            Self::Rgba16Unorm | Self::Rgba16Sfloat | Self::Rg32Uint | Self::Rg32Sfloat => 8,
            Self::Rgba32Uint | Self::Rgba32Sfloat => 16,
        }
    }

    pub(super) fn raw(self) -> vk::Format {
        match self {
            Self::R8Unorm => vk::Format::R8_UNORM,
            Self::R8Uint => vk::Format::R8_UINT,
            Self::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
            Self::R16Unorm => vk::Format::R16_UNORM,
            Self::R16Sfloat => vk::Format::R16_SFLOAT,
            Self::R16Uint => vk::Format::R16_UINT,
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
