//! TIFF files as other programs write them, byte by byte: read as they are stored, or refused with what would be right.

mod io_common;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, read_volume};
use halflight::scene::Volume;
use io_common::logs::warnings;
use io_common::tiff_bytes::{Directory, Value, lzw, page, set, tiff};
use io_common::{DIMS, Folder, bytes, says, values};
use std::path::Path;

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

fn pick(path: &Path, component: &str) -> Result<Volume> {
    read_volume(path, &ReadOptions { component: Some(component.into()), ..Default::default() })
}

fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

/// The formula's volume, a page a slice, of a photometric interpretation.
fn stack(kind: SampleType, photometric: u16) -> Vec<u8> {
    let format = match kind.name().as_bytes()[0] {
        b'u' => 1,
        b'i' => 2,
        _ => 3,
    };
    let pages = |z: u32| page([5, 4], 8 * kind.bytes() as u16, format, photometric, 8 + 20 * z * kind.bytes() as u32);
    tiff(&bytes(kind, false), &(0..3).map(pages).collect::<Vec<_>>())
}

/// Pages of 2x1 bytes, each with its own number, the first with a description.
fn numbered(count: u8, description: &str) -> Vec<u8> {
    let data: Vec<u8> = (0..count).flat_map(|i| [i, i]).collect();
    let mut pages: Vec<Directory> = (0..u32::from(count)).map(|i| page([2, 1], 8, 1, 1, 8 + 2 * i)).collect();
    set(&mut pages[0], 270, Value::Text(description.into()));
    tiff(&data, &pages)
}

/// The numbers of the pages that became slices.
fn slices(volume: &Volume) -> Vec<u8> {
    (0..volume.grid().dims()[2]).map(|z| volume.value(2 * z) as u8).collect()
}

#[test]
fn white_first_is_read_as_stored() {
    use SampleType::*;
    let dir = Folder::new();
    for kind in [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64] {
        assert!(holds(&read(&dir.file("b.tif", &[&stack(kind, 1)])).unwrap(), kind), "{kind:?}");
        let white = read(&dir.file("w.tif", &[&stack(kind, 0)]));
        match kind {
            U8 | U16 | U32 | U64 => assert!(holds(&white.unwrap(), kind), "{kind:?}"),
            _ => says(
                white,
                &["w.tif", kind.name(), "the smallest is white (PhotometricInterpretation 0)", "save it with black as the smallest (1)"],
            ),
        }
    }
    let (_, said) = warnings(|| read(&dir.file("w.tif", &[&stack(U8, 0)])).unwrap());
    assert!(said.len() == 1 && said[0].contains("small values are bright (PhotometricInterpretation 0)"), "{said:?}");
    // Slices of both kinds are no volume.
    let mut pages: Vec<Directory> = (0..3).map(|z| page([5, 4], 8, 1, u16::from(z == 0), 8 + 20 * z)).collect();
    says(read(&dir.file("m.tif", &[&tiff(&bytes(U8, false), &pages)])), &["page 1 is 5x4 uint8, grey from white to black", "same"]);
    // A palette is no matter of compression.
    for p in &mut pages {
        set(p, 262, Value::Short(3));
    }
    says(
        read(&dir.file("p.tif", &[&tiff(&bytes(U8, false), &pages)])),
        &["p.tif", "palettes are not", "as grey, with its values", "Grays"],
    );
    for p in &mut pages {
        set(p, 262, Value::Short(1));
        set(p, 259, Value::Short(50000));
    }
    says(read(&dir.file("z.tif", &[&tiff(&bytes(U8, false), &pages)])), &["z.tif", "PackBits, LZW and Deflate are read"]);
}

#[test]
fn channels_and_times_in_pages_are_chosen() {
    let dir = Folder::new();
    let imagej = |rest: &str| format!("ImageJ=1.54f\n{rest}");
    let one = dir.file("c.tif", &[&numbered(12, &imagej("images=12\nchannels=3\nslices=4\nhyperstack=true\n"))]);
    says(read(&one), &["c.tif: it holds 4 slices of 3 channels (ImageJ); choose one with volume.component, 0 to 2"]);
    assert_eq!(slices(&pick(&one, "1").unwrap()), [1, 4, 7, 10]);
    says(pick(&one, "3"), &["'3' is none of"]);
    let both = dir.file("ct.tif", &[&numbered(12, &imagej("images=12\nchannels=2\nslices=3\nframes=2\n"))]);
    says(read(&both), &["3 slices of 2 channels at 2 times", "c0t0, c1t0, c0t1, c1t1"]);
    assert_eq!(slices(&pick(&both, "c1t1").unwrap()), [7, 9, 11]);
    let times = dir.file("t.tif", &[&numbered(6, &imagej("images=6\nslices=3\nframes=2\n"))]);
    assert_eq!(slices(&pick(&times, "1").unwrap()), [3, 4, 5]);
    // Flat pictures of channels at times: these are the third axis.
    let flat = dir.file("f.tif", &[&numbered(6, &imagej("images=6\nchannels=2\nframes=3\n"))]);
    says(read(&flat), &["3 slices of 2 channels (ImageJ)"]);
    assert_eq!(slices(&pick(&flat, "1").unwrap()), [1, 3, 5]);
    // One axis alone is the third, whatever it is called.
    for rest in ["images=6\nslices=6\n", "images=6\nframes=6\n", "images=6\nchannels=6\n", ""] {
        assert_eq!(slices(&read(&dir.file("s.tif", &[&numbered(6, &imagej(rest))])).unwrap()), [0, 1, 2, 3, 4, 5]);
    }
    let cut = dir.file("d.tif", &[&numbered(5, &imagej("images=6\nchannels=2\nslices=3\n"))]);
    says(read(&cut), &["counts 3 slices of 2 channels (ImageJ), it has 5 pages"]);
    // Channels of a pixel beside times in pages.
    let mut pages: Vec<Directory> = (0..4).map(|i| page([2, 1], 8, 1, 2, 8 + 6 * i)).collect();
    for p in &mut pages {
        set(p, 277, Value::Short(3));
        set(p, 279, Value::Long(vec![6]));
    }
    set(&mut pages[0], 270, Value::Text(imagej("images=4\nslices=2\nframes=2\n")));
    says(pick(&dir.file("r.tif", &[&tiff(&[7; 24], &pages)]), "0"), &["2 slices at 2 times", "3 channels (RGB)", "split it"]);
}

/// Pages of 2x1 16-bit samples with a description and a resolution.
fn described(count: u32, description: &str, resolution: Option<[(u32, u32); 2]>) -> Vec<u8> {
    let data: Vec<u8> = (0..2 * count).flat_map(|i| (32768 + 10 * i as u16).to_le_bytes()).collect();
    let mut pages: Vec<Directory> = (0..count).map(|i| page([2, 1], 16, 1, 1, 8 + 4 * i)).collect();
    set(&mut pages[0], 270, Value::Text(description.into()));
    for (tag, (n, d)) in [282, 283].into_iter().zip(resolution.into_iter().flatten()) {
        set(&mut pages[0], tag, Value::Rational(n, d));
    }
    tiff(&data, &pages)
}

#[test]
fn voxels_lie_as_far_apart_as_the_file_says() {
    let dir = Folder::new();
    let five = Some([(5, 1), (1_000_000, 250_000)]);
    let spacing = |count: u32, description: &str, resolution| {
        describe(&read(&dir.file("s.tif", &[&described(count, description, resolution)])).unwrap()).spacing
    };
    let imagej = |rest: &str| format!("ImageJ=1.54f\nimages=3\nslices=3\n{rest}");
    assert_eq!(spacing(3, &imagej("unit=um\nspacing=3.0\n"), five), [0.2, 0.25, 3.0]);
    assert_eq!(spacing(3, &imagej("unit=um\nspacing=-3.0\n"), five), [0.2, 0.25, 3.0]);
    // ImageJ leaves a depth of 1 out.
    assert_eq!(spacing(3, &imagej("unit=mm\n"), five), [0.2, 0.25, 1.0]);
    // As Micro-Manager writes them: micrometres beside pixels per centimetre.
    let mut pages: Vec<Directory> = (0..3).map(|i| page([2, 1], 8, 1, 1, 8 + 2 * i)).collect();
    set(&mut pages[0], 270, Value::Text(imagej("unit=um\nspacing=3.0\n")));
    set(&mut pages[0], 282, Value::Rational(50_000, 1));
    set(&mut pages[0], 283, Value::Rational(40_000, 1));
    set(&mut pages[0], 296, Value::Short(3));
    assert_eq!(describe(&read(&dir.file("c.tif", &[&tiff(&[0; 6], &pages)])).unwrap()).spacing, [0.2, 0.25, 3.0]);
    // Without a unit, or with several, or without a resolution, as ImageJ takes it: not calibrated.
    for (rest, resolution) in [
        ("spacing=3.0\n", five),
        ("unit=pixel\nspacing=3\n", five),
        ("unit=um\nzunit=s\nspacing=3\n", five),
        ("unit=um\nspacing=3\n", None),
    ] {
        assert_eq!(spacing(3, &imagej(rest), resolution), [1.0; 3], "{rest}");
    }
    let ome = |pixels: &str| {
        format!(
            "<?xml version=\"1.0\"?><OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeX=\"2\" SizeY=\"1\" SizeZ=\"3\" SizeC=\"1\" SizeT=\"1\" {pixels}/></Image></OME>"
        )
    };
    let sizes = |x: &str, y: &str, z: &str| ome(&format!("PhysicalSizeX=\"0.2\" {x} PhysicalSizeY=\"0.25\" {y} PhysicalSizeZ=\"1.5\" {z}"));
    assert_eq!(spacing(3, &sizes("", "", ""), five), [0.2, 0.25, 1.5]);
    let mm = |axis: &str| format!("PhysicalSize{axis}Unit=\"mm\"");
    assert_eq!(spacing(3, &sizes(&mm("X"), &mm("Y"), &mm("Z")), None), [0.2, 0.25, 1.5], "in its own unit");
    assert_eq!(spacing(3, &sizes("", "", "PhysicalSizeZUnit=\"nm\""), None), [0.2, 0.25, 0.0015]);
    // Without a distance of slices there is none; of one slice it does not matter.
    assert_eq!(spacing(3, &ome("PhysicalSizeX=\"0.2\" PhysicalSizeY=\"0.25\""), None), [1.0; 3]);
    assert_eq!(spacing(1, &ome("PhysicalSizeX=\"0.2\" PhysicalSizeY=\"0.25\""), None), [0.2, 0.25, 0.2]);
    // The command line's word counts.
    let path = dir.file("s.tif", &[&described(3, &imagej("unit=um\nspacing=3.0\n"), five)]);
    let own = ReadOptions { spacing: Some([1.0, 2.0, 3.0]), ..Default::default() };
    assert_eq!(describe(&read_volume(&path, &own).unwrap()).spacing, [1.0, 2.0, 3.0]);
}

/// ImageJ keeps signed samples as unsigned ones that are 32768 larger.
#[test]
fn imagejs_values_are_calibrated() {
    let dir = Folder::new();
    let stack = |rest: &str| dir.file("c.tif", &[&described(3, &format!("ImageJ=1.54f\nimages=3\nslices=3\n{rest}"), None)]);
    let signed = read(&stack("cf=0\nc0=-32768.0\nc1=1.0\nvunit=Gray Value\n")).unwrap();
    assert_eq!((signed.range(), signed.rescale(), signed.samples().type_name()), ([0.0, 50.0], (1.0, -32768.0), "uint16"));
    let line = read(&stack("cf=0\nc0=-32768.0\nc1=0.5\n")).unwrap();
    assert_eq!(line.range(), [0.5 * 32768.0 - 32768.0, 0.5 * 32818.0 - 32768.0]);
    assert_eq!(read(&stack("")).unwrap().range(), [32768.0, 32818.0]);
    let (curve, said) = warnings(|| read(&stack("cf=1\nc0=1\nc1=2\nc2=3\n")).unwrap());
    assert!(curve.range() == [32768.0, 32818.0] && said.len() == 1 && said[0].contains("function 1) is not applied"), "{said:?}");
    // A unit alone is no calibration, and floats are what they are.
    let (plain, said) = warnings(|| read(&stack("cf=0\nvunit=HU\n")).unwrap());
    assert!(plain.range() == [32768.0, 32818.0] && said.is_empty(), "{said:?}");
    let mut floats = page([2, 1], 32, 3, 1, 8);
    set(&mut floats, 270, Value::Text("ImageJ=1.54f\ncf=0\nc0=-32768.0\nc1=1.0\n".into()));
    let data = [1.5f32, 2.5].map(f32::to_le_bytes).concat();
    assert_eq!(read(&dir.file("f.tif", &[&tiff(&data, &[floats])])).unwrap().range(), [1.5, 2.5]);
    // Slices in files of their own must agree.
    let folder = dir.path("f");
    std::fs::create_dir(&folder).unwrap();
    let put = |i: usize, rest: &str| {
        std::fs::write(folder.join(format!("s{i}.tif")), described(1, &format!("ImageJ=1.54f\n{rest}"), None)).unwrap()
    };
    (0..3).for_each(|i| put(i, "cf=0\nc0=-32768.0\nc1=1.0\n"));
    assert_eq!(read(&folder).unwrap().range(), [0.0, 10.0]);
    put(1, "");
    says(read(&folder), &["s1.tif: its values are calibrated otherwise", "s0.tif", "save them as one stack"]);
}

#[test]
fn tifffiles_arrays_have_their_axes() {
    let dir = Folder::new();
    let file = |count: u8, description: &str| dir.file("s.tif", &[&numbered(count, description)]);
    let path = file(8, "{\"shape\": [2, 4, 1, 2]}");
    says(read(&path), &["4 slices of 2 channels (tifffile)", "0 to 1"]);
    assert_eq!(slices(&pick(&path, "1").unwrap()), [4, 5, 6, 7]);
    assert_eq!(slices(&pick(&file(8, "{\"shape\": [4, 2, 1, 2], \"axes\": \"ZCYX\"}"), "1").unwrap()), [1, 3, 5, 7]);
    let both = file(12, "{\"shape\": [2, 3, 2, 1, 2]}");
    says(read(&both), &["c0t0, c1t0, c2t0, c0t1"]);
    assert_eq!(slices(&pick(&both, "c2t1").unwrap()), [10, 11]);
    // By their letters: times are the third axis where there is no z, and channels are called so in any order.
    let times = file(8, "{\"shape\": [4, 2, 1, 2], \"axes\": \"TCYX\"}");
    says(read(&times), &["4 slices of 2 channels (tifffile)"]);
    assert_eq!(slices(&pick(&times, "1").unwrap()), [1, 3, 5, 7]);
    let swapped = file(12, "{\"shape\": [2, 3, 2, 1, 2], \"axes\": \"CTZYX\"}");
    assert_eq!(slices(&pick(&swapped, "c1t2").unwrap()), [10, 11]);
    assert_eq!(slices(&pick(&swapped, "c0t1").unwrap()), [2, 3]);
    says(read(&file(8, "{\"shape\": [2, 4, 1, 2], \"axes\": \"TZYX\"}")), &["4 slices at 2 times (tifffile)"]);
    // One axis, axes that are not these pages', and other words: slices.
    for text in [
        "{\"shape\": [8, 1, 2]}",
        "{\"shape\": [1, 8, 1, 2]}",
        "{\"shape\": [2, 3, 1, 2]}",
        "{\"shape\": [2, 4, 2, 1]}",
        "{\"shape\": \"x\"}",
        "{\"shape\":",
    ] {
        assert_eq!(slices(&read(&file(8, text)).unwrap()), [0, 1, 2, 3, 4, 5, 6, 7], "{text}");
    }
}

#[test]
fn ome_tiff_has_its_own_order() {
    let dir = Folder::new();
    let ome = |order: &str, size: [u8; 3], data: &str| {
        let [z, c, t] = size;
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?><!-- µ --><OME xmlns=\"x\"><Image ID=\"Image:0\"><Pixels DimensionOrder=\"{order}\" \
             PhysicalSizeXUnit=\"µm\" SizeX=\"2\" SizeY=\"1\" SizeZ=\"{z}\" SizeC=\"{c}\" SizeT=\"{t}\">{data}</Pixels></Image>"
        )
    };
    let file = |count: u8, text: &str| dir.file("o.tif", &[&numbered(count, &format!("{text}</OME>"))]);
    for (order, second) in [("XYZCT", [4, 5, 6, 7]), ("XYCZT", [1, 3, 5, 7])] {
        let path = file(8, &ome(order, [4, 2, 1], "<TiffData IFD=\"0\" PlaneCount=\"8\"/>"));
        says(read(&path), &["4 slices of 2 channels (OME-TIFF)", "0 to 1"]);
        assert_eq!(slices(&pick(&path, "1").unwrap()), second, "{order}");
    }
    let planes = |first: u8| format!("<TiffData FirstC=\"0\" IFD=\"{first}\"/><TiffData FirstC=\"1\" IFD=\"4\"/>");
    assert_eq!(slices(&pick(&file(8, &ome("XYZCT", [4, 2, 1], &planes(0))), "0").unwrap()), [0, 1, 2, 3]);
    says(pick(&file(8, &ome("XYZCT", [4, 2, 1], &planes(4))), "0"), &["a plane at page 4 that is due at 0", "DimensionOrder"]);
    // Slices alone, also where the others lie in other files.
    assert_eq!(slices(&read(&file(3, &ome("XYZCT", [3, 1, 1], ""))).unwrap()), [0, 1, 2]);
    assert_eq!(slices(&read(&file(1, &ome("XYZCT", [3, 2, 1], ""))).unwrap()), [0]);
    assert_eq!(slices(&read(&file(3, &ome("XYZCT", [3, 2, 1], ""))).unwrap()), [0, 1, 2]);
    let in_files = |names: [&str; 2]| {
        let of = |c: usize, name: &str| format!("<TiffData FirstC=\"{c}\" IFD=\"0\"><UUID FileName=\"{name}\">u</UUID></TiffData>");
        ome("XYZCT", [3, 2, 1], &(of(0, names[0]) + &of(1, names[1])))
    };
    assert_eq!(slices(&read(&file(3, &in_files(["a.tif", "b.tif"]))).unwrap()), [0, 1, 2]);
    assert_eq!(slices(&pick(&file(6, &in_files(["a.tif", "b.tif"])), "1").unwrap()), [3, 4, 5]);
    says(pick(&file(6, &in_files(["o.tif", "o.tif"])), "1"), &["a plane at page 0 that is due at 3"]);
    says(read(&file(4, &ome("XYZCT", [3, 2, 1], ""))), &["counts 3 slices of 2 channels (OME-TIFF), it has 4 pages"]);
    // One axis alone is slices, whatever it is called.
    for size in [[1, 3, 1], [1, 1, 3]] {
        assert_eq!(slices(&read(&file(3, &ome("XYZCT", size, ""))).unwrap()), [0, 1, 2]);
    }
    let image = ome("XYZCT", [3, 1, 1], "");
    says(read(&file(6, &(image.clone() + &image))), &["it holds 2 images (OME-TIFF)", "save it alone"]);
    // What is cut off, or no XML, says nothing.
    assert_eq!(slices(&read(&file(3, "<OME><Pixels SizeC=\"3")).unwrap()), [0, 1, 2]);
}

#[test]
fn slices_that_no_page_speaks_of_are_refused() {
    let dir = Folder::new();
    let mut one = page([2, 1], 16, 1, 1, 8);
    set(&mut one, 270, Value::Text("ImageJ=1.54f\nimages=6\nslices=6\n".into()));
    let data: Vec<u8> = (0..6u16).flat_map(|i| [i, i]).flat_map(u16::to_le_bytes).collect();
    // The samples come last, where their place does not change what is before them.
    let start = tiff(&[], &[one.clone()]).len() as u32;
    set(&mut one, 273, Value::Long(vec![start]));
    let path = dir.file("i.tif", &[&tiff(&[], &[one.clone()]), &data]);
    let way = format!("--volume.dims 2,1,6 --volume.type uint16 --volume.offset {start}");
    says(read(&path), &["counts 6 slices, and it has 1 page", &way]);
    let offset = u64::from(start);
    let raw = halflight::io::RawLayout { dims: [2, 1, 6], kind: SampleType::U16, big_endian: false, spacing: [1.0; 3], offset };
    assert_eq!(slices(&read_volume(&path, &ReadOptions { raw: Some(raw), ..Default::default() }).unwrap()), [0, 1, 2, 3, 4, 5]);
    says(read(&dir.file("b.tif", &[&tiff(&[], &[one.clone()]), &data, b"more"])), &["counts 6 slices", "a page per slice is needed"]);
    // A page that was taken from a stack keeps its description.
    assert_eq!(read(&dir.file("s.tif", &[&tiff(&[], &[one.clone()]), &data[..4]])).unwrap().grid().dims(), [2, 1, 1]);
    set(&mut one, 270, Value::Text("{\"shape\": [6, 1, 2], \"truncated\": true}".into()));
    says(read(&dir.file("t.tif", &[&tiff(&[], &[one.clone()]), &data])), &["tifffile", "it has 1 page", "a page per slice"]);
    set(&mut one, 270, Value::Text(String::new()));
    set(&mut one, 32997, Value::Short(6));
    says(read(&dir.file("v.tif", &[&tiff(&data, &[one])])), &["hold 6 slices each (ImageDepth)", "a page per slice"]);
}

#[test]
fn tiles_in_lzw_say_whose_fault_it_may_be() {
    let dir = Folder::new();
    // Tiles of 16x16; the decoder fails on valid ones that hang over the picture's edge.
    let tiled = |width: u32, height: u32| {
        let (across, down) = (width.div_ceil(16), height.div_ceil(16));
        let at = |x: u32, y: u32| if x < width && y < height { (x + 3 * y) as u8 } else { 0 };
        let tile = |i: u32| lzw(&(0..256).map(|p| at(i % across * 16 + p % 16, i / across * 16 + p / 16)).collect::<Vec<u8>>());
        let tiles: Vec<Vec<u8>> = (0..across * down).map(tile).collect();
        let mut directory = page([width, height], 8, 1, 1, 8);
        directory.retain(|(tag, _)| ![273, 278, 279].contains(tag));
        let lengths: Vec<u32> = tiles.iter().map(|t| t.len() as u32).collect();
        let starts = (0..tiles.len()).map(|i| 8 + lengths[..i].iter().sum::<u32>()).collect();
        let tags = [
            (259, Value::Short(5)),
            (322, Value::Short(16)),
            (323, Value::Short(16)),
            (324, Value::Long(starts)),
            (325, Value::Long(lengths)),
        ];
        tags.into_iter().for_each(|(tag, value)| set(&mut directory, tag, value));
        tiff(&tiles.concat(), &[directory])
    };
    let whole = read(&dir.file("w.tif", &[&tiled(32, 32)])).unwrap();
    assert!((0..1024).all(|i| whole.value(i) == (i % 32 + 3 * (i / 32)) as f32));
    assert_eq!(describe(&whole).dims, [32, 32, 1]);
    // Where this one is read, the decoder is mended, and the sentence can go.
    says(read(&dir.file("e.tif", &[&tiled(47, 33)])), &["e.tif", "some valid tiles in LZW", "in strips, or with Deflate"]);
}
