//! Stacks of TIFF and PNG slices written by a formula read back exactly; bad ones say what is wrong.

mod io_common;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, read_volume};
use halflight::scene::Volume;
use io_common::logs::warnings;
use io_common::{DIMS, Folder, png_grey, says, slice, tiff_pages, values};
use std::path::Path;
use tiff::encoder::colortype::{Gray8, Gray16, Gray32Float, RGB8};

fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

/// Values of a slice.
fn plane(kind: SampleType, z: usize) -> Vec<f64> {
    values(kind)[z * 20..(z + 1) * 20].to_vec()
}

#[test]
fn folders_patterns_and_pages_read_back() {
    let dir = Folder::new();
    let pages: Vec<Vec<f32>> = (0..3).map(|z| plane(SampleType::F32, z).iter().map(|v| *v as f32).collect()).collect();
    let words: Vec<Vec<u16>> = (0..3).map(|z| plane(SampleType::U16, z).iter().map(|v| *v as u16).collect()).collect();
    for zipped in [false, true] {
        let path = dir.file("p.tif", &[&tiff_pages::<Gray32Float>(5, 4, &pages, zipped)]);
        assert!(holds(&read(&path).unwrap(), SampleType::F32));
    }
    for (name, wide) in [("eight", false), ("sixteen", true)] {
        let kind = if wide { SampleType::U16 } else { SampleType::U8 };
        for (ending, folder) in [("png", dir.path(name)), ("tif", dir.path(&format!("{name}-tif")))] {
            std::fs::create_dir(&folder).unwrap();
            // 9, 10, 11: by text, 10 would come first.
            for z in 0..3 {
                let content = match (ending, wide) {
                    ("png", _) => png_grey(5, 4, wide, &slice(kind, z)),
                    (_, true) => tiff_pages::<Gray16>(5, 4, &words[z..=z], true),
                    _ => tiff_pages::<Gray8>(5, 4, &[slice(kind, z)], false),
                };
                std::fs::write(folder.join(format!("s_{}.{ending}", 9 + z)), content).unwrap();
            }
            assert!(holds(&read(&folder).unwrap(), kind), "{name} {ending}");
            assert!(holds(&read(&folder.join(format!("s_#.{ending}"))).unwrap(), kind), "{name} {ending} by pattern");
            // Two digits at least: the first is left out.
            assert_eq!(read(&folder.join(format!("s_##.{ending}"))).unwrap().grid().dims(), [5, 4, 2]);
            let spaced = ReadOptions { spacing: Some([0.5, 0.5, 2.0]), ..Default::default() };
            assert_eq!(describe(&read_volume(&folder, &spaced).unwrap()).spacing, [0.5, 0.5, 2.0]);
        }
    }
    // The comparison can fail.
    assert!(!holds(&read(&dir.path("eight")).unwrap(), SampleType::U16));
}

#[test]
fn channels_are_chosen() {
    let dir = Folder::new();
    let rgb: Vec<Vec<u8>> = (0..3).map(|z| slice(SampleType::U8, z).iter().flat_map(|&v| [0, v, 7]).collect()).collect();
    let path = dir.file("c.tif", &[&tiff_pages::<RGB8>(5, 4, &rgb, true)]);
    says(read(&path), &["c.tif: its pixels have 3 channels (RGB); choose one with volume.component: R, G, B"]);
    let pick = |c: &str| read_volume(&path, &ReadOptions { component: Some(c.into()), ..Default::default() });
    assert!(holds(&pick("G").unwrap(), SampleType::U8) && pick("2").unwrap().range() == [7.0, 7.0]);
}

#[test]
fn names_that_count_more_than_slices_are_told() {
    let dir = Folder::new();
    let said = |folder: &str, names: &[&str]| {
        let folder = dir.path(folder);
        std::fs::create_dir(&folder).unwrap();
        names.iter().for_each(|name| std::fs::write(folder.join(name), png_grey(5, 4, false, &slice(SampleType::U8, 0))).unwrap());
        let (volume, said) = warnings(|| read(&folder).unwrap());
        assert_eq!(volume.grid().dims()[2], names.len());
        said
    };
    let two = said("a", &["n_z00_ch00.png", "n_z00_ch01.png", "n_z01_ch00.png", "n_z01_ch01.png"]);
    assert!(two.len() == 1 && two[0].contains("count in 2 places") && two[0].contains("'n_z##_ch01.png'"), "{two:?}");
    let gap = said("b", &["s1.png", "s2.png", "s4.png", "s5.png", "s7.png"]);
    assert!(gap.len() == 1 && gap[0].contains("no slice has a number between 2 and 4"), "{gap:?}");
    let others = said("c", &["image1.png", "image2.png", "mask1.png"]);
    assert!(others.len() == 1 && others[0].contains("differ in more than a number"), "{others:?}");
    assert!(said("d", &["s08.png", "s09.png", "s10.png"]).is_empty());
    assert!(said("e", &["2024_9.png", "2024_10.png"]).is_empty());
    assert!(said("f", &["s18446744073709551615.png", "s018446744073709551615.png"]).is_empty());
}

#[test]
fn odd_slices_are_named() {
    let dir = Folder::new();
    let folder = dir.path("s");
    std::fs::create_dir(&folder).unwrap();
    let put = |name: &str, content: &[u8]| std::fs::write(folder.join(name), content).unwrap();
    put("a_1.png", &png_grey(5, 4, false, &slice(SampleType::U8, 0)));
    put("a_2.png", &png_grey(4, 5, false, &slice(SampleType::U8, 1)));
    says(read(&folder), &["a_2.png: it is 4x5 uint8, grey", "a_1.png is 5x4 uint8, grey", "same size and type"]);
    put("a_2.png", &png_grey(5, 4, true, &slice(SampleType::U16, 1)));
    says(read(&folder), &["a_2.png: it is 5x4 uint16"]);
    let whole = png_grey(5, 4, false, &slice(SampleType::U8, 1));
    put("a_2.png", &whole[..40]);
    says(read(&folder), &["a_2.png", "PNG"]);
    put("a_2.png", b"text");
    says(read(&folder), &["a_2.png: it begins with 'text'", "a TIFF or PNG file"]);
    put("a_2.png", &whole);
    put("b.tif", &tiff_pages::<Gray8>(5, 4, &[slice(SampleType::U8, 0)], false));
    says(read(&folder), &["1 TIFF and 2 PNG files", "pattern"]);
    put("b.tif", &tiff_pages::<Gray8>(5, 4, &[slice(SampleType::U8, 0), slice(SampleType::U8, 1)], false));
    put("c.tif", &whole);
    std::fs::remove_file(folder.join("a_1.png")).unwrap();
    std::fs::remove_file(folder.join("a_2.png")).unwrap();
    says(read(&folder), &["b.tif: it has 2 pages, and there are 2 files"]);
    says(read(&folder.join("x_###.tif")), &["no file of this pattern", "x_000.tif"]);
    let spacing = ReadOptions { spacing: Some([1.0; 3]), ..Default::default() };
    let nrrd = dir.file("a.nrrd", &[b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n\nx"]);
    says(read_volume(&nrrd, &spacing), &["volume.spacing", "no stack of pictures", "drop it"]);
    let series = ReadOptions { series: Some("1".into()), ..Default::default() };
    says(read_volume(&folder, &series), &["volume.series", "has no DICOM file"]);
    // A page that claims more than its file can hold.
    let mut bomb = tiff_pages::<Gray8>(5, 4, &[slice(SampleType::U8, 0)], true);
    let entry = (0..bomb.len() - 12).find(|&i| bomb[i..i + 4] == [0, 1, 4, 0]).expect("the ImageWidth entry");
    bomb[entry + 8..entry + 12].copy_from_slice(&2_000_000u32.to_le_bytes());
    says(read(&dir.file("bomb.tif", &[&bomb])), &["bomb.tif"]);
}
