"""Checks of single values: numbers, counts, choices and vectors of three."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np

from .errors import InvalidArgument, InvalidType

Vector = tuple[float, float, float]

INT32_MAX = 2**31 - 1


def number(name: str, value: Any) -> float:
    """A real number as a float; may be infinite or NaN."""
    if isinstance(value, (str, bytes)):
        raise InvalidType(f"{name} must be a number, not {value!r}", argument=name, value=value)
    try:
        return float(value)
    except OverflowError:
        raise InvalidArgument(
            f"{name} is beyond the range of float64: {value!r}", argument=name, value=value
        ) from None
    except (TypeError, ValueError):
        raise InvalidType(
            f"{name} must be a number, not {type(value).__name__}", argument=name, value=value
        ) from None


def integer(name: str, value: Any, lower: int = -INT32_MAX - 1, upper: int = INT32_MAX) -> int:
    """An integer from lower to upper."""
    try:
        result = operator.index(value)
    except TypeError:
        raise InvalidType(
            f"{name} must be an integer, not {type(value).__name__}", argument=name, value=value
        ) from None
    if not lower <= result <= upper:
        raise InvalidArgument(
            f"{name} must be from {lower} to {upper}, got {result}", argument=name, value=result
        )
    return result


def flag(name: str, value: Any) -> int:
    """True or False (or 1 or 0) as 1 or 0; other truthy values are taken for mistakes."""
    if isinstance(value, (bool, np.bool_, int)) and value in (0, 1):
        return int(value)
    raise InvalidType(f"{name} must be True or False, got {value!r}", argument=name, value=value)


def choice(name: str, value: Any, choices: Mapping[str, int]) -> int:
    """The number that a name stands for."""
    if not isinstance(value, str):
        raise InvalidType(
            f"{name} must be a string, not {type(value).__name__}", argument=name, value=value
        )
    if value not in choices:
        raise InvalidArgument(
            f"{name} must be one of {', '.join(choices)}; got {value!r}", argument=name, value=value
        )
    return choices[value]


def vector(name: str, value: Any) -> Vector:
    """Three finite numbers as floats."""
    if isinstance(value, (str, bytes)):
        raise InvalidType(f"{name} must be 3 numbers, not {value!r}", argument=name, value=value)
    try:
        values = [number(name, item) for item in value]
    except TypeError as error:
        if isinstance(error, InvalidType):
            raise
        raise InvalidType(
            f"{name} must be 3 numbers, not {type(value).__name__}", argument=name, value=value
        ) from None
    if len(values) != 3:
        raise InvalidArgument(f"{name} must be 3 numbers, got {len(values)}", argument=name)
    for index, item in enumerate(values):
        if not math.isfinite(item):
            raise InvalidArgument(
                f"{name}[{index}] must be finite, got {item}",
                argument=name,
                index=index,
                value=item,
            )
    return (values[0], values[1], values[2])


def size_2d(name: str, value: Any) -> tuple[int, int]:
    """Width and height, each at least 1, whose product is an int32."""
    try:
        width, height = value
    except (TypeError, ValueError):
        raise InvalidType(
            f"{name} must be (width, height), got {value!r}", argument=name, value=value
        ) from None
    width = integer(f"{name}[0]", width, 1)
    height = integer(f"{name}[1]", height, 1)
    if width * height > INT32_MAX:
        raise InvalidArgument(
            f"{name} must be at most {INT32_MAX} pixels, got {width} x {height}",
            argument=name,
            value=width * height,
        )
    return width, height


def is_true(value: object) -> bool:
    """True itself, as bool or np.bool_; not every truthy value."""
    return isinstance(value, (bool, np.bool_)) and bool(value)
