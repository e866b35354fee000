"""From what NumPy accepts to the borrowed rows of the C interface, without a copy where it can."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidArgument, InvalidType

AnyArray = NDArray[Any]
Shape = tuple[int, ...]

# The types that the library reads as they are.
FLOAT_TYPES = (np.dtype(np.float32), np.dtype(np.float64))
INTEGER_TYPES = (
    np.dtype(np.int32),
    np.dtype(np.uint32),
    np.dtype(np.int64),
    np.dtype(np.uint64),
)


@dataclass(frozen=True)
class Rows:
    """Rows at a fixed distance; `array` keeps the memory alive."""

    array: AnyArray
    address: int
    stride: int
    dtype: np.dtype[Any]


def floats(name: str, value: ArrayLike) -> AnyArray:
    """The value as an array of float32 or float64; of those two, as it is."""
    array = _array(name, value, "fiu", "numbers")
    if array.dtype in FLOAT_TYPES and array.dtype.isnative:
        return array
    # float16 fits float32; all else (integers, longdouble) gets the wider type.
    small = array.dtype.kind == "f" and array.dtype.itemsize <= 4
    with np.errstate(over="ignore"):
        return array.astype(np.float32 if small else np.float64)


def integers(name: str, value: ArrayLike) -> AnyArray:
    """The value as an array of 32 or 64 bit integers; of those four types, as it is."""
    array = _array(name, value, "iu", "integers")
    if array.dtype in INTEGER_TYPES and array.dtype.isnative:
        return array
    if array.dtype.itemsize < 4:
        return array.astype(np.int32)
    return array.astype(array.dtype.newbyteorder("="))


def _array(name: str, value: ArrayLike, kinds: str, what: str) -> AnyArray:
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:
        raise InvalidArgument(f"{name} is not an array: {error}", argument=name) from None
    if array.size == 0 and array.dtype.kind in "fiu":
        # What an empty list or np.zeros((0, 3)) makes is not what its author chose.
        return array.astype(np.float64 if "f" in kinds else np.int64, copy=False)
    if array.dtype.kind not in kinds:
        raise InvalidType(f"{name} must hold {what}, not {array.dtype}", argument=name)
    return array


def split_rows(name: str, array: AnyArray, components: int) -> Shape:
    """The leading shape of an array of rows of so many components."""
    if array.ndim == 0 or array.shape[-1] != components:
        raise InvalidArgument(
            f"{name} must have shape (..., {components}), got {array.shape}", argument=name
        )
    return array.shape[:-1]


def broadcast(shapes: dict[str, Shape]) -> Shape:
    """The common leading shape of the arguments named."""
    with contextlib.suppress(ValueError):
        return np.broadcast_shapes(*shapes.values())
    name = _first_that_does_not_fit(shapes)
    others = ", ".join(f"{key} {other}" for key, other in shapes.items() if key != name)
    raise InvalidArgument(
        f"{name} has leading shape {shapes[name]}, which does not broadcast with {others}",
        argument=name,
    )


def _first_that_does_not_fit(shapes: dict[str, Shape]) -> str:
    common: Shape = ()
    for name, shape in shapes.items():
        try:
            common = np.broadcast_shapes(common, shape)
        except ValueError:
            return name
    raise AssertionError("these shapes broadcast")


def rows(array: AnyArray, lead: Shape, components: Shape = ()) -> Rows:
    """The array, broadcast to lead + components, as rows.

    It is copied only where no single distance between rows can express it, or its components
    are not contiguous or not aligned.
    """
    shape = lead + components
    wide = array if array.shape == shape else np.broadcast_to(array, shape)
    stride = row_stride(wide, len(lead))
    if stride is None:
        wide = wide.copy()
        stride = row_stride(wide, len(lead))
        assert stride is not None, "a contiguous array has one distance between rows"
    return Rows(wide, wide.__array_interface__["data"][0], stride, wide.dtype)


def row_stride(array: AnyArray, lead: int) -> int | None:
    """The distance of the rows in bytes, 0 for one row for all; None if there is none."""
    size = array.dtype.itemsize
    if array.size == 0:
        return 0
    if not array.flags.aligned:
        return None
    if array.ndim > lead and array.shape[-1] > 1 and array.strides[-1] != size:
        return None
    dimensions = [
        (count, stride)
        for count, stride in zip(array.shape[:lead], array.strides[:lead], strict=True)
        if count > 1
    ]
    if not dimensions:
        return 0
    count, result = dimensions.pop()
    while dimensions:
        outer_count, outer_stride = dimensions.pop()
        if outer_stride != result * count:
            return None
        count *= outer_count
    return result


def output(name: str, out: AnyArray | None, shape: Shape, dtypes: tuple[type, ...]) -> AnyArray:
    """A checked `out` argument, or a new array of the first dtype."""
    if out is None:
        return np.empty(shape, dtypes[0])
    if not isinstance(out, np.ndarray):
        raise InvalidType(f"{name} must be a NumPy array, not {type(out).__name__}", argument=name)
    names = " or ".join(np.dtype(dtype).name for dtype in dtypes)
    if out.dtype not in [np.dtype(dtype) for dtype in dtypes]:
        raise InvalidType(f"{name} must be an array of {names}, not {out.dtype}", argument=name)
    if out.shape != shape:
        raise InvalidArgument(f"{name} must have shape {shape}, got {out.shape}", argument=name)
    if not out.flags.c_contiguous or not out.flags.writeable:
        raise InvalidArgument(f"{name} must be writeable and C-contiguous", argument=name)
    return out
