"""Checks of array arguments: what is wrong is said of the argument by its name."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ribbonhost.native._native import ffi, lib

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Bool = NDArray[np.bool_]
Size = int | str | None
"""Of an axis: any if None; "..." as the first stands for any further axes."""

UNIT_TOLERANCE = 1e-3
"""By which |v|^2 of a quaternion or direction may differ from 1."""


def _checked(name: str, value: object, dtype: type, shape: tuple[Size, ...]) -> NDArray[np.generic]:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array of {np.dtype(dtype)}, not {type(value).__name__}")
    if value.dtype != dtype:
        wanted = np.dtype(dtype)
        raise TypeError(f"{name} must hold {wanted}, not {value.dtype}: use {name}.astype({wanted})")
    if value.shape != shape:
        _check_shape(name, value, shape)
    if not value.flags.c_contiguous:
        raise ValueError(f"{name} must be contiguous in memory: use numpy.ascontiguousarray({name})")
    return value


def _check_shape(name: str, value: NDArray[np.generic], shape: tuple[Size, ...]) -> None:
    free = shape[:1] == ("...",)
    sizes = shape[1:] if free else shape
    have = value.shape[-len(sizes) :] if free else value.shape
    if len(have) != len(sizes) or any(want not in (None, is_) for want, is_ in zip(sizes, have, strict=True)):
        text = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} must have shape ({text}), not {value.shape}")


def floats(name: str, value: object, *shape: Size) -> Float64:
    """`value`, a contiguous float64 array of `shape`.

    Raises TypeError or ValueError.
    """
    return _checked(name, value, np.float64, shape)  # type: ignore[return-value]


def flags(name: str, value: object, *shape: Size) -> Bool:
    """`value`, a contiguous bool array of `shape` (as for floats); raises TypeError or ValueError."""
    return _checked(name, value, np.bool_, shape)  # type: ignore[return-value]


def finite(name: str, value: Float64) -> Float64:
    """`value` if it holds neither NaN nor infinity; raises ValueError."""
    if not np.isfinite(value).all():
        raise ValueError(f"{name} holds NaN or infinity")
    return value


def unit(name: str, value: Float64) -> Float64:
    """`value` (..., d) if it is finite and of unit length within UNIT_TOLERANCE; raises ValueError."""
    finite(name, value)
    if (np.abs(np.einsum("...d,...d->...", value, value) - 1) > UNIT_TOLERANCE).any():
        raise ValueError(f"{name} holds a vector that is not of unit length")
    return value


def arc_lengths(name: str, value: object) -> Float64:
    """`value` (n,) if it is at least two finite arc lengths from 0 up that grow strictly.

    Raises TypeError or ValueError.
    """
    array = finite(name, floats(name, value, None))
    if len(array) < 2 or array[0] < 0 or not (np.diff(array) > 0).all():
        raise ValueError(
            f"{name} must be two or more arc lengths from 0 up, each greater than the one before"
        )
    return array


def within(name: str, value: object, last: float) -> Float64:
    """`value` (m,) if all of it lies within [0, last]; raises TypeError or ValueError."""
    array = finite(name, floats(name, value, None))
    if ((array < 0) | (array > last)).any():
        raise ValueError(f"{name} must lie between the anchor, 0 m, and the last node, {last} m")
    return array


def doubles(array: Float64) -> Any:
    """C pointer to the values of a contiguous float64 array, valid as long as the result is kept."""
    return ffi.from_buffer("double[]", array)


def raise_for(code: int, names: dict[int, str]) -> int:
    """`code` of a C function if it is a count, else ValueError; `names`: the argument to blame."""
    if code >= 0:
        return code
    texts = {
        lib.RIBBON_ERROR_COUNT: "has a size outside the solver's limits",
        lib.RIBBON_ERROR_NOT_FINITE: "holds NaN or infinity where it is marked valid",
        lib.RIBBON_ERROR_NOT_UNIT: "holds a quaternion that is not of unit length",
        lib.RIBBON_ERROR_NOT_INCREASING: "must grow strictly",
        lib.RIBBON_ERROR_NO_VALID_NODE: "marks no node of a ribbon as valid",
        lib.RIBBON_ERROR_OUTSIDE: "lies beyond the last node",
        lib.RIBBON_ERROR_METHOD: "names a method that the solver does not have",
    }
    raise ValueError(f"{names.get(code, 'an argument')} {texts.get(code, f'was refused with code {code}')}")
