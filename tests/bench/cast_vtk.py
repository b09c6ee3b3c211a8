#!/usr/bin/python3
"""VTK's ray casters on the work of cast_scene.h, as a program of its own: cast_vtk.py VALUES.raw. Says "ready" and the
version, then for each line "fixed|gpu filled|sparse THREADS" draws one frame and answers with its milliseconds."""
import sys
import time

import numpy
import vtk
from vtk.util import numpy_support

EDGE, IMAGE = 256, 512


def transfer(sparse):
    opacity, colour = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    for i in range(EDGE + 1):
        s = i / EDGE
        density = 0.012 * s if not sparse else max(0.0, s - 0.55) * 0.2
        opacity.AddPoint(s, 1 - numpy.exp(-density))
        colour.AddRGBPoint(s, s, 0.4 + 0.4 * s, 1 - s)
    return opacity, colour


def mapper_of(kind, threads, image):
    if kind == "fixed":
        mapper = vtk.vtkFixedPointVolumeRayCastMapper()
        mapper.SetNumberOfThreads(threads)
        mapper.SetLockSampleDistanceToInputSpacing(0)
        mapper.SetInteractiveSampleDistance(0.5)
    else:
        mapper = vtk.vtkGPUVolumeRayCastMapper()
        mapper.SetUseJittering(0)
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(0.5)
    mapper.SetInputData(image)
    mapper.SetBlendModeToComposite()
    return mapper


def window_of(kind, sparse, threads, image):
    look = vtk.vtkVolumeProperty()
    look.ShadeOff()
    look.SetInterpolationTypeToLinear()
    look.SetScalarOpacityUnitDistance(1.0)
    opacity, colour = transfer(sparse)
    look.SetScalarOpacity(opacity)
    look.SetColor(colour)
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper_of(kind, threads, image))
    volume.SetProperty(look)
    renderer = vtk.vtkRenderer()
    renderer.AddVolume(volume)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(IMAGE, IMAGE)
    window.AddRenderer(renderer)
    away = numpy.array([1, 0.6, 0.4])
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*(127.5 + 700 * away / numpy.linalg.norm(away)))
    camera.SetFocalPoint(127.5, 127.5, 127.5)
    camera.SetViewUp(0, 0, 1)
    camera.SetViewAngle(30)
    renderer.ResetCameraClippingRange()
    return window, camera


def frame_ms(window, camera):
    camera.Azimuth(1e-5)  # or it would show the last one again
    begin = time.perf_counter()
    window.Render()
    window.WaitForCompletion()
    return (time.perf_counter() - begin) * 1e3


def main():
    image = vtk.vtkImageData()
    image.SetDimensions(EDGE, EDGE, EDGE)
    values = numpy.fromfile(sys.argv[1], numpy.float32)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(values))
    windows = {}
    print("ready VTK", vtk.vtkVersion().GetVTKVersion(), flush=True)
    for line in sys.stdin:
        kind, scene, threads = line.split()
        if line not in windows:
            windows[line] = window_of(kind, scene == "sparse", int(threads), image)
            frame_ms(*windows[line])  # the first one prepares
        print("%.3f" % frame_ms(*windows[line]), flush=True)


main()
