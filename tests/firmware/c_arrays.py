"""Arrays of NumPy in and out of the firmware's C structures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from ribbonhil._firmware import ffi

Array = NDArray[np.float64]


def floats(values: ArrayLike) -> Any:
    """A C array of float with these values."""
    return ffi.new("float[]", [float(x) for x in np.ravel(values)])


def vectors(values: ArrayLike) -> Any:
    """A C array of float[3]."""
    return ffi.new("float[][3]", np.asarray(values, float).reshape(-1, 3).tolist())


def array(values: Any) -> Array:
    """The values of a C array, one or two levels deep."""
    return np.array([list(row) if isinstance(row, ffi.CData) else row for row in values], float)


def view(member: Any, dtype: type = np.float32) -> NDArray[Any]:
    """The memory of an array that stands in a C structure, as an array of the same shape."""
    shape = []
    kind = ffi.typeof(member)
    while kind.kind == "array":
        shape.append(kind.length)
        kind = kind.item
    return np.frombuffer(ffi.buffer(member), dtype).reshape(shape)
