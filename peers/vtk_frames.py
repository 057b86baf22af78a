#!/usr/bin/env python3
"""Times VTK's GPU volume mapper on a volume, headless: the peer of `cargo bench --bench paper -- VOLUME --frames N`.

    pip install vtk nibabel numpy
    peers/vtk_frames.py engine.nii.gz --size 1024 768 --frames 5 [--picture frame.png]

The same samples (8 bits over the data's range), transfer function, camera path, sample distance (one voxel) and number of
frames as the bench's; no light, one Phong light, or shadows (--shade, --shadows). Prints the median of the frames. Run it
in turns with the bench, for shared machines are only good for ratios.
"""
import argparse
import statistics
import time

import nibabel
import numpy as np
import vtk
from vtk.util import numpy_support

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("volume", help="NIfTI-1 file")
parser.add_argument("--size", nargs=2, type=int, default=(1024, 768), metavar=("WIDTH", "HEIGHT"))
parser.add_argument("--frames", type=int, default=5)
parser.add_argument("--shade", action="store_true", help="one Phong light")
parser.add_argument("--shadows", action="store_true", help="volumetric shadows besides")
parser.add_argument("--picture", help="PNG of the last frame")
options = parser.parse_args()

image = nibabel.load(options.volume)
samples = np.asarray(image.dataobj).T.astype(np.float32)
low, high = samples.min(), samples.max()
samples = (255 * (samples - low) / max(high - low, 1e-30)).astype(np.uint8)
spacing = [float(s) for s in image.header.get_zooms()[:3]]

data = vtk.vtkImageData()
data.SetDimensions(*samples.shape[::-1])
data.SetSpacing(*spacing)
data.GetPointData().SetScalars(numpy_support.numpy_to_vtk(samples.ravel(), deep=True))

opacity, colour = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
for value, alpha in ((70, 0.0), (120, 0.15), (200, 0.6)):
    opacity.AddPoint(value, alpha)
    colour.AddRGBPoint(value, 0.8, 0.7, 0.5)
material = vtk.vtkVolumeProperty()
material.SetScalarOpacity(opacity)
material.SetColor(colour)
material.SetScalarOpacityUnitDistance(min(spacing))
material.SetInterpolationTypeToLinear()
material.SetShade(options.shade or options.shadows)

mapper = vtk.vtkGPUVolumeRayCastMapper()
mapper.SetInputData(data)
mapper.AutoAdjustSampleDistancesOff()
mapper.SetSampleDistance(min(spacing))
if options.shadows:
    mapper.SetGlobalIlluminationReach(1.0)
    mapper.SetVolumetricScatteringBlending(2.0)
actor = vtk.vtkVolume()
actor.SetMapper(mapper)
actor.SetProperty(material)

bounds = np.array(data.GetBounds()).reshape(3, 2)
centre, extent = bounds.mean(axis=1), float(np.ptp(bounds, axis=1).max())
scene, window = vtk.vtkRenderer(), vtk.vtkRenderWindow()
scene.AddVolume(actor)
light = vtk.vtkLight()
light.SetLightTypeToSceneLight()
light.SetPosition(*(centre + extent * np.array([2, -2, 2])))
light.SetFocalPoint(*centre)
scene.RemoveAllLights()
scene.AddLight(light)
camera = scene.GetActiveCamera()
camera.SetPosition(*(centre + extent * np.array([1.6, -1.9, 1.1])))
camera.SetFocalPoint(*centre)
camera.SetViewUp(0, 0, 1)
camera.SetViewAngle(30)
window.OffScreenRenderingOn()
window.SetSize(*options.size)
window.AddRenderer(scene)

seconds = []
for frame in range(options.frames + 2):
    if frame >= 2:  # the first two warm up
        camera.Azimuth(360 / options.frames)
    scene.ResetCameraClippingRange()
    start = time.perf_counter()
    window.Render()
    window.WaitForCompletion()
    seconds.append(time.perf_counter() - start)
name = "shadows" if options.shadows else "Phong" if options.shade else "unshaded"
print(f"VTK {vtk.vtkVersion.GetVTKVersion()}, {name}: median {1e3 * statistics.median(seconds[2:]):.0f} ms of {options.frames} frames")

if options.picture:
    grab, writer = vtk.vtkWindowToImageFilter(), vtk.vtkPNGWriter()
    grab.SetInput(window)
    writer.SetInputConnection(grab.GetOutputPort())
    writer.SetFileName(options.picture)
    writer.Write()
