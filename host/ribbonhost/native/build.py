"""Builds ribbonhost.native._native: the C solver as a cffi module, declared by its own headers.

Run as a program it builds in place, beside the sources; setup.py takes `ffibuilder` from here.
"""

import re
from pathlib import Path

from cffi import FFI

HERE = Path(__file__).resolve().parent
SOURCES = (
    "orientation.c",
    "hermite.c",
    "spline.c",
    "spherical.c",
    "sensitivity.c",
    "smoothing.c",
    "surface.c",
    "comb.c",
    "motion_rotation.c",
    "motion_linear.c",
    "motion_model.c",
    "motion_process.c",
    "motion_sensors.c",
    "motion_filter.c",
    "motion_smooth.c",
    "motion_learn.c",
    "motion_track.c",
)
HEADERS = ("ribbon_native.h", "ribbon_motion.h")


def declarations(header: str) -> str:
    """What cffi needs of a C header: constants, enumerations, structures, functions that are not inline."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    text = re.sub(r"^#define (\w+) [\d.]+$", r"static const double \1;", text, flags=re.MULTILINE)
    text = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    return re.sub(r"static inline [^{]*\{.*?^\}", "", text, flags=re.DOTALL | re.MULTILINE)


def builder() -> FFI:
    ffi = FFI()
    ffi.cdef("".join(declarations((HERE / header).read_text()) for header in HEADERS))
    ffi.set_source(
        "ribbonhost.native._native",
        "".join(f'#include "{header}"\n' for header in HEADERS),
        sources=[_relative(name) for name in SOURCES],
        include_dirs=[str(HERE)],
        depends=[str(header) for header in HERE.glob("*.h")],
        # Both ways of building must write the same file: two would shadow each other.
        py_limited_api=False,
        extra_compile_args=["-std=c11", "-O3", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math"],
    )
    return ffi


def _relative(name: str) -> str:
    """setuptools wants sources relative to the folder of setup.py, where this file builds from too."""
    return str((HERE / name).relative_to(HERE.parents[1]))


ffibuilder = builder()

if __name__ == "__main__":
    import os

    os.chdir(HERE.parents[1])
    ffibuilder.compile(tmpdir=".", verbose=False)
