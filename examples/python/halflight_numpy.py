"""A volume in a numpy array to a picture in another, through ctypes: halflight_numpy.py [PICTURE.png]

The library is found by LIBHALFLIGHT (its path) or by its name. Structs are those of halflight.h, as far as they are used:
a shorter struct_size is taken as if the rest were zero.
"""
import ctypes as c
import ctypes.util
import os
import sys

try:
    import numpy as np
except ImportError:
    sys.exit("halflight_numpy.py: numpy is not there; pip install numpy, or Debian: apt-get install python3-numpy")

lib = c.CDLL(os.environ.get("LIBHALFLIGHT") or c.util.find_library("halflight") or "libhalflight.so.0")
HL_FLOAT32, HL_RGBA32F, HL_METHOD_SWEEP = 9, 0, 3
RELEASE = c.CFUNCTYPE(None, c.c_void_p, c.c_void_p)
PROGRESS = c.CFUNCTYPE(c.c_int32, c.c_void_p, c.c_char_p, c.c_float)
HEADER = [("struct_size", c.c_uint32), ("struct_type", c.c_int32), ("next", c.c_void_p)]


class Info(c.Structure):
    def __init__(self, **members):
        super().__init__(struct_size=c.sizeof(self), **members)


class VolumeInfo(Info):
    _fields_ = HEADER + [
        ("data", c.c_void_p), ("dims", c.c_uint32 * 3), ("type", c.c_int32), ("strides", c.c_int64 * 3),
        ("spacing", c.c_double * 3), ("axes", c.c_double * 9), ("origin", c.c_double * 3), ("slope", c.c_float),
        ("intercept", c.c_float), ("replace_nan", c.c_int32), ("nan_as", c.c_float),
    ]


class PrecomputeInfo(Info):
    _fields_ = HEADER + [
        ("volume", c.c_void_p), ("transfer", c.c_void_p), ("surface", c.c_void_p), ("previous", c.c_void_p),
        ("method", c.c_int32), ("ratio", c.c_int32), ("directions", c.c_uint32), ("bands", c.c_int32), ("bits", c.c_int32),
        ("filter", c.c_int32), ("jittered", c.c_int32), ("near_slices", c.c_int32), ("all_cells", c.c_int32),
        ("progressive", c.c_int32), ("growth", c.c_float), ("step", c.c_float), ("tolerance", c.c_double),
        ("quality", c.c_int32), ("measure", c.c_int32), ("measure_seconds", c.c_double), ("progress", PROGRESS),
        ("user", c.c_void_p),
    ]


class RenderInfo(Info):
    _fields_ = HEADER + [
        ("field", c.c_void_p), ("light", c.c_void_p), ("camera", c.c_void_p), ("width", c.c_uint32), ("height", c.c_uint32),
    ]


def call(name, *arguments):
    """Calls a function of the library; what goes wrong is an exception with the library's own sentence."""
    status = getattr(lib, name)(*arguments)
    if status < 0:
        text = c.create_string_buffer(1024)
        lib.hl_last_error(None, text, c.c_uint64(len(text)))
        raise RuntimeError(f"{name}: {text.value.decode()}")
    return status


def render(volume, width, height, directions=96):
    """The volume (z, y, x) under white light, as (height, width, 4): linear, premultiplied."""
    volume = np.asarray(volume, np.float32)  # any strides will do
    engine, made, field, image = (c.c_void_p() for _ in range(4))
    call("hl_engine_create", None, c.byref(engine))
    try:
        info = VolumeInfo(
            data=volume.ctypes.data, dims=volume.shape[::-1], type=HL_FLOAT32, strides=volume.strides[::-1]
        )
        call("hl_volume_create", engine, c.byref(info), c.byref(made))
        progress = PROGRESS(lambda user, stage, fraction: 0)
        info = PrecomputeInfo(volume=made, method=HL_METHOD_SWEEP, directions=directions, progress=progress)
        call("hl_precompute", engine, c.byref(info), c.byref(field))
        info = RenderInfo(field=field, width=width, height=height)
        call("hl_render", engine, c.byref(info), c.byref(image))
        picture = np.empty((height, width, 4), np.float32)
        call("hl_image_read", image, HL_RGBA32F, c.c_double(0), c.c_void_p(picture.ctypes.data), c.c_int64(0),
             c.c_uint64(picture.nbytes))
        if len(sys.argv) > 1:
            call("hl_image_save", image, sys.argv[1].encode(), None)
        return picture
    finally:
        call("hl_engine_destroy", engine)


if __name__ == "__main__":
    z, y, x = np.mgrid[0:48, 0:48, 0:48] / 24 - 1
    torus = np.clip(1 - np.hypot(np.hypot(x, y) - 0.6, z) / 0.25, 0, 1)
    picture = render(torus, 320, 240)
    print(picture.shape, picture.dtype, "coverage", picture[..., 3].mean(), "brightest", picture[..., :3].max())
