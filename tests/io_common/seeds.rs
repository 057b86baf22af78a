//! One small whole file of each kind that is read: what mutations and fuzzing begin with.

use super::tiff_bytes::{Directory, Value, lzw, page, set, tiff};
use super::*;

/// Name and content of each; what they need beside them is put into `dir`.
pub fn seeds(dir: &Folder) -> Vec<(&'static str, Vec<u8>)> {
    let data = bytes(SampleType::I16, false);
    let nrrd = |encoding: &str, more: &str| {
        format!("NRRD0004\ntype: short\ndimension: 3\nsizes: 5 4 3\nencoding: {encoding}\nendian: little\n{more}key:=value\n\n")
            .into_bytes()
    };
    let oblique = "space: RAS\nspace directions: (1,0.5,0) (0,2,0) (0,0.1,3)\nspace origin: (1,2,3)\nkinds: domain domain domain\n";
    let text: Vec<u8> = (0..60).flat_map(|i| format!("{} ", i * 37).into_bytes()).collect();
    dir.file("own.raw", &[&data]);
    let nifti = [nifti_header([3, 5, 4, 3, 1, 1, 1, 1], 4, 16, false), data.clone()].concat();
    let preset = br#"[{"ColorSpace":"Diverging","Name":"a","Points":[0,0,0.5,0,0.3,1,0.2,0.6,1,0.2,0.5,1],"RGBPoints":[0,0.2,0.3,0.7,0.5,0.9,0.9,0.9,1,0.7,0,0.1]},{"Name":"b"}]"#;
    let field = b"NRRD0004\ntype: float\ndimension: 4\nsizes: 4 2 2 3\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\nendian: little\n\n";
    let words: Vec<f64> = values(SampleType::I16);
    let array: Array = ("a", SampleType::I16, 1, words.clone());
    let image = |form, block| vti(form, "Spacing=\"1 2 3\"", "0 4 0 3 0 2", std::slice::from_ref(&array), &[], false, false, block);
    let packed =
        |compressor| vti_packed(Vti::AppendedRaw, "", "0 4 0 3 0 2", std::slice::from_ref(&array), &[], false, false, 64, compressor);
    let legacy = |mode: &str, tail: &str| {
        let head = "DATASET STRUCTURED_POINTS\nDIMENSIONS 5 4 3\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 60\nSCALARS s short\nLOOKUP_TABLE default\n";
        format!("# vtk DataFile Version 3.0\ntitle\n{mode}\n{head}{tail}").into_bytes()
    };
    let ascii: String = words.iter().map(|v| format!("{v} ")).collect();
    let mut dicom = Dicom::new(1, 0.0, slice(SampleType::I16, 0));
    (dicom.bits, dicom.signed) = ([16, 12, 11], true);
    let mut rle = dicom.clone();
    (rle.pixels, rle.syntax) = (rle16(&dicom.pixels), RLE.into());
    let mut second = dicom.clone();
    (second.position, second.instance) = (Some([10.0, 20.0, 2.0]), 2);
    std::fs::create_dir(dir.path("series")).unwrap();
    dir.file("series/other.dcm", &[&second.bytes()]);
    std::fs::create_dir(dir.path("stack")).unwrap();
    let page: Vec<u16> = (0..20).map(|i| i * 999).collect();
    dir.file("stack/s2.png", &[&png_grey(5, 4, true, &slice(SampleType::U16, 1))]);
    let mut all = vec![
        ("raw.mha", [meta_header("MET_SHORT", "ElementSpacing = 1 2 3\nHeaderSize = 0\n", "LOCAL"), data.clone()].concat()),
        ("zlib.mha", [meta_header("MET_SHORT", "CompressedData = True\n", "LOCAL"), zlib(&data)].concat()),
        ("text.mha", [meta_header("MET_SHORT", "BinaryData = False\n", "LOCAL"), ascii.clone().into_bytes()].concat()),
        ("beside.mhd", meta_header("MET_SHORT", "Offset = 1 2 3\n", "own.raw")),
        ("ascii.vti", image(Vti::Ascii, 0)),
        ("inline.vti", image(Vti::Inline, 32)),
        ("raw.vti", image(Vti::AppendedRaw, 0)),
        ("zlib.vti", image(Vti::AppendedRaw, 32)),
        ("lz4.vti", packed("LZ4")),
        ("xz.vti", packed("LZMA")),
        ("binary.vtk", [legacy("BINARY", ""), bytes(SampleType::I16, true), b"\nMETADATA\n\n".to_vec()].concat()),
        ("ascii.vtk", legacy("ASCII", &ascii)),
        ("series/a.dcm", dicom.bytes()),
        ("rle.dcm", rle.bytes()),
        ("stack.tif", tiff_pages::<tiff::encoder::colortype::Gray16>(5, 4, &[page.clone(), page], true)),
        ("stack/s1.png", png_grey(5, 4, true, &slice(SampleType::U16, 0))),
        ("raw.nrrd", [nrrd("raw", oblique), data.clone()].concat()),
        ("gzip.nrrd", [nrrd("gzip", "spacings: 1 2 3\n"), gzip(&data)].concat()),
        ("ascii.nrrd", [nrrd("ascii", ""), text].concat()),
        ("detached.nhdr", nrrd("raw", "data file: own.raw\nbyte skip: -1\n")),
        ("a.nii", nifti.clone()),
        ("header.nii.gz", nifti.clone()),
        ("stream.nii.gz", gzip(&nifti)),
        ("field.nrrd", [field.to_vec(), vec![0; 192]].concat()),
        ("preset.json", preset.to_vec()),
        ("a.json", br#"{"min":-100,"max":155,"R":[0,200,255],"G":[0,9,0],"B":[255,0,1],"A":[0,20,51],"I":[0,64,255]}"#.to_vec()),
        ("slicer.xml", SLICER.to_vec()),
        ("exposure.xml", EXPOSURE.to_vec()),
        ("a.tfi", VOREEN.to_vec()),
        ("a.tfg", VOREEN_CURVE.to_vec()),
        ("a.itf", INVIWO.to_vec()),
        ("a.vp", b"1\n1\n0.9\n0.1\n0.2\n10\n4 -10 0 30 0.5\n4 0 1 255 1\n8 -10 1 0 0 30 0 0 1\n".to_vec()),
        ("a.1dt", b"3\n1 0 0 0 \n0 1 0 0.5 \n0 0 1 0.25 \n".to_vec()),
        ("fog.vdb", vdb::file(&[open_vdb("float", vdb::Pack::None)])),
        ("blosc.vdb", vdb::file(&[vdb::Grid { name: "v", ..open_vdb("vec3s", vdb::Pack::None) }, open_vdb("half", vdb::Pack::Blosc(640))])),
        ("level_set.vdb", vdb::file(&[vdb::Grid { class: "level set", as_half: true, ..open_vdb("double", vdb::Pack::Zip) }])),
        ("picture.hdr", radiance()),
        ("picture.exr", exr(dir)),
    ];
    all.extend(described());
    all
}

const SLICER: &[u8] = br#"<?xml version="1.0" encoding="utf-8"?>
<MRML>
  <VolumeProperty name="a" gradientOpacity="4 0 1 255 1" specularPower="10" scalarOpacity="8 -10 0 -5 0 6 0.7 30 0.7" specular="0.2" shade="1" ambient="0.1" colorTransfer="8 -10 0 0 0 30 1 0.5 1" diffuse="0.9" interpolation="1"/>
</MRML>
"#;

const EXPOSURE: &[u8] = br#"<!DOCTYPE Appearance>
<Presets><Preset Name="a"><Nodes>
  <Node><NormalizedIntensity Value="0"/><Opacity Value="0"/><Diffuse R="0" G="0" B="255"/><Specular R="9" G="0" B="0"/></Node>
  <Node><NormalizedIntensity Value="1"/><Opacity Value="0.5"/><Diffuse R="255" G="0" B="0"/></Node>
</Nodes><DensityScale Value="39"/></Preset></Presets>
"#;

const VOREEN: &[u8] = br#"<?xml version="1.0" ?>
<VoreenData version="1"><TransFuncIntensity type="TransFuncIntensity">
  <alphaMode value="1" /><gammaValue value="1" /><domain x="0" y="200" /><threshold x="0.1" y="0.9" />
  <Keys>
    <key type="TransFuncMappingKey"><intensity value="0.25" /><split value="false" /><colorL r="255" g="0" b="0" a="0" /></key>
    <key type="TransFuncMappingKey"><intensity value="0.5" /><split value="true" /><colorL r="0" g="255" b="0" a="51" /><colorR r="0" g="0" b="255" a="102" /></key>
  </Keys>
</TransFuncIntensity></VoreenData>
"#;

const VOREEN_CURVE: &[u8] = br#"<VoreenData version="1"><TransFuncGaussian><domain x="0" y="100"/><Curves>
  <curve><intensity value="0.5"/><width value="0.002"/><baseValue value="0"/><split value="false"/><active value="true"/><colorL r="255" g="0" b="0" a="102"/></curve>
</Curves></TransFuncGaussian></VoreenData>
"#;

const INVIWO: &[u8] = br#"<?xml version="1.0" ?><InviwoTreeData version="1.0"><maskMin content="0" /><maskMax content="0.75" />
<dataPoints><point><pos x="0.25" y="0.9"/><rgba x="1" y="0" z="0" w="0.2"/></point><point><pos x="0.75" y="0"/><rgba x="0" y="0" z="1" w="0.6"/></point></dataPoints>
<interpolationType_ content="0" /></InviwoTreeData>
"#;

/// A grid of two leaves and a tile.
fn open_vdb(value: &'static str, pack: vdb::Pack) -> vdb::Grid {
    let mut tree = vdb::Tree::new(0.0);
    (0..12).for_each(|i| tree.set([i, 2 * i % 7, 3], f64::from(i + 1), i % 5 != 0));
    tree.tiles.push(([0, 8, 0], 8, 7.0, true));
    vdb::Grid { pack, ..vdb::Grid::new("density", value, tree) }
}

/// A Radiance picture of 8x4 pixels without run lengths.
fn radiance() -> Vec<u8> {
    let pixels: Vec<u8> = (0..32u8).flat_map(|i| [i, 2 * i, 3 * i, 120 + i / 8]).collect();
    [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 4 +X 8\n".to_vec(), pixels].concat()
}

/// An EXR picture of 8x4 pixels.
fn exr(dir: &Folder) -> Vec<u8> {
    let pixels = (0..32).map(|i| [i as f32, 0.5, 2.0, 1.0]).collect();
    let path = dir.path("picture.exr");
    let picture = halflight::scene::Picture { width: 8, height: 4, rgba: pixels };
    halflight::io::write_exr(&path, &picture, &[("key".into(), "value".into())]).unwrap();
    std::fs::read(path).unwrap()
}

/// The fuzz target that a seed is for, by its name.
pub fn target(name: &str) -> &'static str {
    let ends = |e: &str| name.ends_with(e);
    match name {
        _ if ends(".mha") || ends(".mhd") => "metaimage",
        _ if ends(".vti") => "vti",
        _ if ends(".vtk") => "vtk_legacy",
        _ if ends(".dcm") => "dicom",
        _ if ends(".tif") => "tiff",
        _ if ends(".png") => "png",
        _ if ends(".vdb") => "vdb",
        _ if ends(".exr") => "exr",
        _ if ends(".hdr") => "hdr",
        _ if ends(".xml") || ends(".tfi") || ends(".tfg") || ends(".itf") => "transfer_xml",
        _ if ends(".json") => "transfer_json",
        _ if ends(".vp") => "transfer_vp",
        _ if ends(".1dt") => "transfer_1dt",
        "field.nrrd" => "nrrd_field",
        _ if ends(".nrrd") || ends(".nhdr") => "nrrd",
        _ => "nifti",
    }
}

/// Files that say more than their samples: pages of an OME-TIFF, white-first tiles in LZW, frames placed by a detector.
fn described() -> Vec<(&'static str, Vec<u8>)> {
    let data: Vec<u8> = (0..12).collect();
    let mut pages: Vec<Directory> = (0..6).map(|i| page([2, 1], 8, 1, 1, 8 + 2 * i)).collect();
    let text = "<OME><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"6\" SizeC=\"1\" SizeT=\"1\"><TiffData IFD=\"0\"/></Pixels></OME>";
    set(&mut pages[0], 270, Value::Text(text.into()));
    let mut tile = page([16, 16], 8, 1, 0, 8);
    let coded = lzw(&(0..=255).collect::<Vec<u8>>());
    tile.retain(|(tag, _)| ![273, 278, 279].contains(tag));
    let place = [(322, 16), (323, 16), (324, 8), (325, coded.len() as u32)];
    place.into_iter().for_each(|(tag, n)| set(&mut tile, tag, Value::Long(vec![n])));
    set(&mut tile, 259, Value::Short(5));
    set(&mut tile, 270, Value::Text("ImageJ=1.54f\nimages=1\nslices=1\n".into()));
    let mut frames = Dicom::new(1, 0.0, bytes(SampleType::U8, false));
    (frames.frames, frames.position, frames.between) = (Some(3), None, Some(-4.0));
    let place = [element(0x0020_0032, "DS", b"5\\6\\7", false), element(0x0020_0037, "DS", b"1\\0\\0\\0\\0\\-1", false)].concat();
    let item = [&[0xfe, 0xff, 0, 0xe0][..], &(place.len() as u32).to_le_bytes(), &place].concat();
    frames.more = [element(0x0028_3000, "SQ", &[], false), element(0x0054_0022, "SQ", &item, false)].concat();
    vec![("ome.tif", tiff(&data, &pages)), ("white.tif", tiff(&coded, &[tile])), ("detector.dcm", frames.bytes())]
}
