"""Volumes that other programs write, read by halflight: SimpleITK (NRRD, MetaImage, NIfTI, legacy VTK), VTK (.vti), tifffile
(TIFF stacks), and the files that pydicom tests itself with. Dims, range, mean, spacing, directions and the first voxel's place
are compared with the array that was written; of DICOM the range and mean with pydicom's pixels, where both read a file.

usage: read_files.py HALFLIGHT [FOLDER]     (pip install SimpleITK vtk tifffile imagecodecs pydicom numpy)
exit code 1 where one differs, or a program's file does not open and is not refused in a sentence
"""
import sys, os, json, subprocess, tempfile, collections
import numpy as np

halflight, folder = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp()
counts, wrong = collections.defaultdict(collections.Counter), []

def info(path, *more):
    run = subprocess.run([halflight, 'info', path, '--json', *more], capture_output=True, text=True)
    return (json.loads(run.stdout)['volume'] if run.returncode == 0 else None), run

def check(program, path, array, place=None, more=(), sentence=''):
    """`array` is z, y, x; `place` is spacing, directions as columns, first centre; `sentence` is part of a refusal, None where none may be."""
    said, run = info(path, *more)
    if said is None:
        refused = run.returncode == 3 and run.stderr.count('\n') == 1 and sentence is not None and sentence in run.stderr
        counts[program]['refused' if refused else 'failed'] += 1
        print(f"{program}: {os.path.basename(path)}: {run.stderr.strip()[-160:]}")
        return refused or wrong.append(path)
    a = array.astype(np.float64)
    same = said['dims'] == list(a.shape[::-1]) and np.allclose(said['range'], [a.min(), a.max()], rtol=1e-6)
    same = same and abs(said['mean'] - a.mean()) <= 1e-5 * np.abs(a).max()
    if place:
        spacing, directions, first = place
        same = same and np.allclose(said['spacing'], spacing, rtol=1e-5)
        same = same and np.allclose(np.array(said['directions']).T, directions, atol=1e-5) and np.allclose(said['first_centre'], first, atol=1e-4)
    counts[program]['same' if same else 'differs'] += 1
    if not same:
        print(f"{program}: {path}: {said} where {a.shape[::-1]}, {a.min()} to {a.max()}, mean {a.mean()} were written")
        wrong.append(path)

random = np.random.default_rng(1)
integers = ['uint8', 'int8', 'uint16', 'int16', 'uint32', 'int32']
array = lambda kind, shape: (random.normal(size=shape) * 40 + 60).clip(0, 120).astype(kind)

def itk():
    import SimpleITK as sitk
    turn = np.array([[np.cos(.3), -np.sin(.3), 0], [np.sin(.3), np.cos(.3), 0], [0, 0, 1]])
    for kind in integers + ['float32', 'float64']:
        a = array(kind, (7, 9, 11))
        image = sitk.GetImageFromArray(a)
        image.SetSpacing((.5, 1.25, 2)), image.SetOrigin((3, -4, 5)), image.SetDirection(turn.flatten())
        for extension in ['nrrd', 'nhdr', 'mha', 'mhd', 'nii', 'nii.gz', 'vtk']:
            for packed in [False, True]:
                path = f'{folder}/{kind}_{packed}.{extension}'
                sitk.WriteImage(image, path, packed)
                # NIfTI is RAS, ITK LPS; a legacy VTK file holds no directions.
                flip = np.diag([-1, -1, 1]) if extension.startswith('nii') else np.eye(3)
                place = None if extension == 'vtk' else ([.5, 1.25, 2], flip @ turn, flip @ [3, -4, 5])
                check('SimpleITK', path, a, place)
    vectors = (random.random((4, 5, 6, 3)) * 200).astype('uint8')
    for extension in ['nrrd', 'mha', 'vtk', 'nii']:
        path = f'{folder}/vectors.{extension}'
        sitk.WriteImage(sitk.GetImageFromArray(vectors, isVector=True), path)
        for c in range(3):
            check('SimpleITK', path, vectors[..., c], more=('--volume.component', str(c)))

def vtk_xml():
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk
    a = array('float32', (20, 30, 40))
    image = vtk.vtkImageData()
    image.SetDimensions(40, 30, 20), image.SetSpacing(1, 2, 3)
    values = numpy_to_vtk(a.ravel())
    values.SetName('s'), image.GetPointData().SetScalars(values)
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(image)
    for compressor in [writer.NONE, writer.ZLIB, writer.LZ4, writer.LZMA]:
        for mode in [writer.Ascii, writer.Binary, writer.Appended]:
            for size in [writer.UInt32, writer.UInt64]:
                path = f'{folder}/{compressor}_{mode}_{size}.vti'
                writer.SetCompressorType(compressor), writer.SetDataMode(mode), writer.SetHeaderType(size), writer.SetFileName(path)
                writer.Write()
                check('VTK', path, a, ([1, 2, 3], np.eye(3), [0, 0, 0]))

def vtk_legacy():
    """VTK's own writer, which makes colours of unsigned chars."""
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk
    for kind in ['uint8', 'int16', 'float32']:
        a = array(kind, (20, 30, 40))
        image = vtk.vtkImageData()
        image.SetDimensions(40, 30, 20), image.SetSpacing(1, 2, 3)
        values = numpy_to_vtk(a.ravel())
        values.SetName('s'), image.GetPointData().SetScalars(values)
        for name, text in [('ascii', True), ('binary', False)]:
            path, writer = f'{folder}/{kind}_{name}.vtk', vtk.vtkStructuredPointsWriter()
            writer.SetInputData(image), writer.SetFileName(path)
            writer.SetFileTypeToASCII() if text else writer.SetFileTypeToBinary()
            writer.Write()
            check('VTK, legacy', path, a, ([1, 2, 3], np.eye(3), [0, 0, 0]))

def tiff():
    import tifffile
    forms = [{}, {'compression': 'zlib'}, {'compression': 'lzw'}, {'compression': 'packbits'}, {'compression': 'zstd'}, {'bigtiff': True},
             {'tile': (16, 16)}, {'byteorder': '>'}, {'compression': 'zlib', 'predictor': True}]
    for kind in integers + ['float16', 'float32', 'float64']:
        for i, form in enumerate(forms):
            a, path = array(kind, (5, 33, 47)), f'{folder}/{kind}_{i}.tif'
            tifffile.imwrite(path, a, photometric='minisblack', **form)
            check('tifffile', path, a)
        # The decoder fails on some valid tiles in LZW; then the sentence must say so.
        tifffile.imwrite(path, a, photometric='minisblack', compression='lzw', tile=(16, 16))
        check('tifffile, tiles in LZW', path, a, sentence='some valid tiles in LZW')
        # Values are read as they are stored; of others than unsigned integers the decoder's turn is not exact.
        tifffile.imwrite(path, a, photometric='miniswhite')
        check('tifffile, white first', path, a, sentence=None if kind[0] == 'u' else 'PhotometricInterpretation 0')
    for name, axes, kept in [('imagej', 'ZCYX', 'C'), ('imagej', 'TZYX', 'T'), ('imagej', 'TZCYX', 'TC'), ('ome', 'CZYX', 'C'), ('ome', 'TZYX', 'T'),
                             ('ome', 'TCZYX', 'TC'), ('ome', 'ZCYX', 'C')]:
        shape = [{'Z': 4, 'C': 2, 'T': 3, 'Y': 5, 'X': 7}[axis] for axis in axes]
        a, path = array('uint16', shape), f'{folder}/{axes}.{name}.tif'
        tifffile.imwrite(path, a, photometric='minisblack', metadata={'axes': axes}, imagej=name == 'imagej', ome=name == 'ome')
        # Times slowest, then channels, slices as the volume.
        sets = a.transpose([axes.index(axis) for axis in kept + 'ZYX']).reshape(-1, 4, 5, 7)
        for i, volume in enumerate(sets):
            check('tifffile, hyperstacks', path, volume, more=('--volume.component', str(i)))
    # Arrays of tifffile's own: the last axis before rows and columns is z, or the one that is called so.
    for axes, shape in [(None, (2, 4, 5, 7)), ('CZYX', (2, 4, 5, 7)), ('ZCYX', (4, 2, 5, 7)), ('TCZYX', (3, 2, 4, 5, 7))]:
        a, path = array('uint16', shape), f'{folder}/own{axes}.tif'
        tifffile.imwrite(path, a, photometric='minisblack', metadata={'axes': axes} if axes else {})
        sets = a.swapaxes(0, 1) if axes == 'ZCYX' else a
        for i, volume in enumerate(sets.reshape(-1, 4, 5, 7)):
            check('tifffile, its own arrays', path, volume, more=('--volume.component', str(i)))
    # How far voxels lie apart.
    for name in ['imagej', 'ome']:
        a, path = array('uint16', (6, 5, 7)), f'{folder}/apart.{name}.tif'
        said = {'axes': 'ZYX', 'unit': 'um', 'spacing': 3.0} if name == 'imagej' else {'axes': 'ZYX', 'PhysicalSizeX': 0.2, 'PhysicalSizeY': 0.25, 'PhysicalSizeZ': 3.0}
        tifffile.imwrite(path, a, photometric='minisblack', resolution=(5, 4), metadata=said, imagej=name == 'imagej', ome=name == 'ome')
        check('tifffile, distances', path, a, ([0.2, 0.25, 3], np.eye(3), [0.1, 0.125, 1.5]))
    # One axis alone is slices, as tifffile's own defaults call it channels.
    for name in ['imagej', 'ome']:
        a, path = array('uint16', (6, 5, 7)), f'{folder}/alone.{name}.tif'
        tifffile.imwrite(path, a, photometric='minisblack', imagej=name == 'imagej', ome=name == 'ome')
        check('tifffile, hyperstacks', path, a)
    # One directory for all slices: the sentence says how they are read.
    a, path = array('uint16', (6, 5, 7)), f'{folder}/single.tif'
    tifffile.imwrite(path, a, imagej=True, metadata={'axes': 'ZYX'}, truncate=True)
    way = info(path)[1].stderr.split('headerless they are read: ')[1].split()
    check('tifffile, one directory', path, a, more=way)

def stacking():
    """Nuclear medicine, which says the place of its frames by a signed distance and, of a detector, in a sequence."""
    import pydicom, SimpleITK as sitk
    from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
    for within in [False, True]:
        for between, axes in [(4, [1, 0, 0, 0, 1, 0]), (-4, [1, 0, 0, 0, 1, 0]), (-4, [1, 0, 0, 0, 0, -1])]:
            a, path, meta = array('int16', (4, 3, 5)), f'{folder}/{within}{between}{axes[4]}.dcm', FileMetaDataset()
            # Frames of one value each show their order.
            a[:] = np.arange(4)[:, None, None]
            # ITK takes the place of nuclear medicine from the detector alone.
            meta.MediaStorageSOPClassUID = pydicom.uid.NuclearMedicineImageStorage if within else pydicom.uid.CTImageStorage
            meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
            meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid()
            file, place = FileDataset(path, {}, file_meta=meta, preamble=b'\0' * 128), Dataset()
            file.SOPClassUID, file.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
            file.Modality, file.ImageType, file.SeriesInstanceUID = 'NM' if within else 'CT', ['ORIGINAL', 'PRIMARY', 'RECON TOMO', 'EMISSION'], '1.2.3'
            file.NumberOfFrames, file.Rows, file.Columns = a.shape
            file.SamplesPerPixel, file.PhotometricInterpretation, file.PixelRepresentation = 1, 'MONOCHROME2', 1
            file.BitsAllocated, file.BitsStored, file.HighBit, file.PixelData = 16, 16, 15, a.tobytes()
            file.PixelSpacing, file.SpacingBetweenSlices, file.SliceThickness = [2, 3], between, 4
            target = place if within else file
            target.ImagePositionPatient, target.ImageOrientationPatient = [5, 6, 7], axes
            if within:
                file.DetectorInformationSequence = [place]
            file.save_as(path, enforce_file_format=True)
            image = sitk.ReadImage(path)
            directions = np.array(image.GetDirection()).reshape(3, 3)
            first = np.array(image.GetOrigin())
            # Here slices ascend along their normal: the same places from the other end.
            if np.dot(np.cross(directions[:, 0], directions[:, 1]), directions[:, 2]) < 0:
                first, directions = first + 4 * 3 * directions[:, 2], directions * [1, 1, -1]
            check('pydicom, stacking against ITK', path, a, ([3, 2, 4], directions, first), sentence=None)

def dicom():
    import pydicom, glob
    for path in sorted(glob.glob(os.path.dirname(pydicom.__file__) + '/data/test_files/*.dcm')):
        said, run = info(path)
        if said is None:
            # Of several channels, one is compared.
            more = ('--volume.component', '0') if 'volume.component' in run.stderr else ()
            check('pydicom', path, np.zeros((1, 1, 1)), more=more) if not more else dicom_pixels(path, more)
        else:
            dicom_pixels(path, ())

def dicom_pixels(path, more):
    import pydicom
    file = pydicom.dcmread(path)
    pixels = pydicom.pixels.pixel_array(file, raw=True).astype(np.float64)
    if file.SamplesPerPixel > 1:
        pixels = pixels[..., 0]
    pixels = pixels * float(file.get('RescaleSlope', file.get('DoseGridScaling', 1))) + float(file.get('RescaleIntercept', 0))
    check('pydicom', path, pixels.reshape((-1,) + pixels.shape[-2:]), more=more)

for part in [itk, vtk_xml, tiff, stacking, dicom, vtk_legacy]:
    part()
for program, count in counts.items():
    print(f"{program}: {sum(count.values())} files: " + ', '.join(f'{n} {what}' for what, n in count.items()))
sys.exit(bool(wrong))
