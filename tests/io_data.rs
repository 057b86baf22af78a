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
    let expected: [Documented; 23] = [
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
        ("head_ct_120.vtk", [120, 120, 130], "uint8", [2.26448, 2.26448, 2.27132], [0.0, 255.0]),
        ("bonsai_small.mhd", [256, 256, 91], "uint8", [1.172, 1.172, 2.0], [0.0, 255.0]),
        ("engine_small.mhd", [128, 128, 64], "uint8", [2.0; 3], [0.0, 255.0]),
        ("viscous_fingers_040.vti", [64; 3], "float32", [1.0; 3], [0.0, 113.59]),
        ("epi_short_zlib.mha", [64, 64, 37], "int16", [3.4375, 3.4375, 3.8], [0.0, 6690.0]),
        ("flair_oblique_gzip.nrrd", [124, 160, 140], "uint8", [1.0; 3], [0.0, 255.0]),
        ("bonsai_small.vdb", [91, 197, 256], "float32", [1.0; 3], [0.0, 1.0]),
        ("smoke_sphere_double.vdb", [128, 64, 64], "float32", [1.0; 3], [0.0, 1.0]),
        ("sphere_levelset.vdb", [48, 48, 48], "float32", [0.01; 3], [-0.04, 0.04]),
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

/// No file of the folder is passed over: each volume opens, or is the samples of a header beside it.
#[test]
fn every_volume_opens() {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/volumes"));
    let Ok(files) = std::fs::read_dir(&folder) else {
        println!("skipped: {} is not here", folder.display());
        return;
    };
    let (mut opened, mut samples) = (0, 0);
    for file in files {
        let path = file.unwrap().path();
        if path.extension().is_some_and(|e| e == "raw") {
            let headers = [".mhd", ".nrrd", ".detached.nrrd"];
            assert!(headers.iter().any(|e| path.with_extension(&e[1..]).is_file()), "{} has no header", path.display());
            samples += 1;
            continue;
        }
        let volume = read_volume(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        println!("{}: {:?} {:?}", path.file_name().unwrap().to_string_lossy(), volume.grid().dims(), volume.range());
        assert!(volume.range()[0] < volume.range()[1], "{}: one value only", path.display());
        opened += 1;
    }
    assert!(opened >= 23 && samples <= 3, "{opened} opened, {samples} files of samples");
}

/// Every light probe has finite coefficients and shines.
#[test]
fn every_probe_opens() {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/probes"));
    let Ok(files) = std::fs::read_dir(&folder) else {
        println!("skipped: {} is not here", folder.display());
        return;
    };
    for file in files {
        let path = file.unwrap().path();
        let probe = halflight::io::read_probe(&path).unwrap_or_else(|e| panic!("{e}"));
        let pixels = probe.pixels();
        assert_eq!(pixels.len(), probe.width() * probe.height());
        assert!(pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0) && pixels.iter().flatten().any(|v| *v > 0.0));
        println!("{}: {}x{}", path.file_name().unwrap().to_string_lossy(), probe.width(), probe.height());
    }
}

/// Where the same scan lies in two formats, both readers agree.
#[test]
fn two_formats_of_one_scan_agree() {
    let (Some(full), Some(half)) = (data("engine.nii.gz"), data("engine_small.mhd")) else { return };
    let open = |path: PathBuf| read_volume(&path, &ReadOptions::default()).unwrap();
    let (full, half) = (open(full), open(half));
    // Correlation of each half-size voxel with the eight that it stands for; `mirror` turns x round, as the data's notes say.
    let correlation = |mirror: bool| {
        let ([nx, ny, nz], mut sums) = (half.grid().dims(), [0.0f64; 5]);
        for i in 0..nx * ny * nz {
            let (x, y, z) = (i % nx, i / nx % ny, i / nx / ny);
            let x = if mirror { nx - 1 - x } else { x };
            let eight =
                (0..8).map(|k| f64::from(full.value(2 * x + (k & 1) + 2 * nx * (2 * y + (k >> 1 & 1) + 2 * ny * (2 * z + (k >> 2))))));
            let (a, b) = (f64::from(half.value(i)), eight.sum::<f64>() / 8.0);
            [a, b, a * a, b * b, a * b].iter().zip(&mut sums).for_each(|(v, s)| *s += v);
        }
        let n = (nx * ny * nz) as f64;
        let [a, b, aa, bb, ab] = sums.map(|s| s / n);
        (ab - a * b) / ((aa - a * a) * (bb - b * b)).sqrt()
    };
    let (straight, mirrored) = (correlation(false), correlation(true));
    println!("correlation of engine.nii.gz with engine_small.mhd: {straight:.3}, mirrored along x {mirrored:.3}");
    assert!(mirrored > 0.98 && straight < 0.95, "{straight} {mirrored}");
}
