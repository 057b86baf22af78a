//! One small whole file of each kind that is read: what mutations and fuzzing begin with.

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
    vec![
        ("raw.mha", [meta_header("MET_SHORT", "ElementSpacing = 1 2 3\nHeaderSize = 0\n", "LOCAL"), data.clone()].concat()),
        ("zlib.mha", [meta_header("MET_SHORT", "CompressedData = True\n", "LOCAL"), zlib(&data)].concat()),
        ("text.mha", [meta_header("MET_SHORT", "BinaryData = False\n", "LOCAL"), ascii.clone().into_bytes()].concat()),
        ("beside.mhd", meta_header("MET_SHORT", "Offset = 1 2 3\n", "own.raw")),
        ("ascii.vti", image(Vti::Ascii, 0)),
        ("inline.vti", image(Vti::Inline, 32)),
        ("raw.vti", image(Vti::AppendedRaw, 0)),
        ("zlib.vti", image(Vti::AppendedRaw, 32)),
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
    ]
}
