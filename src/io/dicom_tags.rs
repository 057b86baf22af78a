//! The DICOM elements that are read, or gone through. Numbers: DICOM PS3.6.

/// Group and element in one number.
pub(super) type Tag = u32;

pub(super) const SYNTAX: Tag = 0x0002_0010;
pub(super) const IMAGE_TYPE: Tag = 0x0008_0008;
pub(super) const SERIES_DESCRIPTION: Tag = 0x0008_103e;
pub(super) const THICKNESS: Tag = 0x0018_0050;
pub(super) const BETWEEN: Tag = 0x0018_0088;
pub(super) const IMAGER_SPACING: Tag = 0x0018_1164;
pub(super) const SERIES_UID: Tag = 0x0020_000e;
pub(super) const INSTANCE: Tag = 0x0020_0013;
pub(super) const POSITION: Tag = 0x0020_0032;
pub(super) const ORIENTATION: Tag = 0x0020_0037;
pub(super) const SAMPLES: Tag = 0x0028_0002;
pub(super) const PHOTOMETRIC: Tag = 0x0028_0004;
pub(super) const PLANAR: Tag = 0x0028_0006;
pub(super) const FRAMES: Tag = 0x0028_0008;
pub(super) const ROWS: Tag = 0x0028_0010;
pub(super) const COLUMNS: Tag = 0x0028_0011;
pub(super) const SPACING: Tag = 0x0028_0030;
pub(super) const ALLOCATED: Tag = 0x0028_0100;
pub(super) const STORED: Tag = 0x0028_0101;
pub(super) const HIGH_BIT: Tag = 0x0028_0102;
pub(super) const SIGNED: Tag = 0x0028_0103;
/// What stands where there is no image: one value, or with a limit all between the two.
pub(super) const PADDING: Tag = 0x0028_0120;
pub(super) const PADDING_LIMIT: Tag = 0x0028_0121;
pub(super) const INTERCEPT: Tag = 0x0028_1052;
pub(super) const SLOPE: Tag = 0x0028_1053;
/// A table from stored samples to the data's unit.
pub(super) const MODALITY_LUT: Tag = 0x0028_3000;
/// Of segmentations: samples are labels or shares.
pub(super) const SEGMENTATION: Tag = 0x0062_0001;
/// Of dose: places of the frames along the normal, and what a stored unit is worth.
pub(super) const FRAME_OFFSETS: Tag = 0x3004_000c;
pub(super) const DOSE_SCALING: Tag = 0x3004_000e;

/// Elements that are kept, and whether they are binary 16-bit numbers; the others are text.
pub(super) const WANTED: [(Tag, bool); 27] = [
    (IMAGE_TYPE, false),
    (SERIES_DESCRIPTION, false),
    (THICKNESS, false),
    (BETWEEN, false),
    (IMAGER_SPACING, false),
    (SERIES_UID, false),
    (INSTANCE, false),
    (POSITION, false),
    (ORIENTATION, false),
    (SAMPLES, true),
    (PHOTOMETRIC, false),
    (PLANAR, true),
    (FRAMES, false),
    (ROWS, true),
    (COLUMNS, true),
    (SPACING, false),
    (ALLOCATED, true),
    (STORED, true),
    (HIGH_BIT, true),
    (SIGNED, true),
    (PADDING, true),
    (PADDING_LIMIT, true),
    (INTERCEPT, false),
    (SLOPE, false),
    (SEGMENTATION, false),
    (FRAME_OFFSETS, false),
    (DOSE_SCALING, false),
];

pub(super) const SHARED: Tag = 0x5200_9229;
pub(super) const PER_FRAME: Tag = 0x5200_9230;
/// Of nuclear medicine: position and orientation of the first slice are within.
pub(super) const DETECTOR: Tag = 0x0054_0022;
/// Measures, position, orientation and value transformation of a multi-frame image.
pub(super) const FRAME_PARTS: [Tag; 4] = [0x0028_9110, 0x0020_9113, 0x0020_9116, 0x0028_9145];
pub(super) const ITEM: Tag = 0xfffe_e000;
pub(super) const ITEM_END: Tag = 0xfffe_e00d;
pub(super) const SEQUENCE_END: Tag = 0xfffe_e0dd;
pub(super) const PIXELS: Tag = 0x7fe0_0010;
pub(super) const FLOAT_PIXELS: Tag = 0x7fe0_0008;
pub(super) const DOUBLE_PIXELS: Tag = 0x7fe0_0009;
