# SPDX-License-Identifier: GPL-3.0-or-later
"""From a mesh's space to the world."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .data import Vector

# What is farther from the world's origin than so many times its own size is moved near to it:
# float32 would take the last 6 of its 24 bits, or more.
_FAR = 64.0

# The new origin is a multiple of so many sizes: it stays where it is while things move about.
_GRID = 16.0


def to_world(vertices: NDArray[np.float32], matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """The vertices (n, 3) in the world, computed in double and rounded once.

    Element by element, not as a matrix product, whose last bit may depend on the row: vertices
    at one place stay at one place, or closed meshes would open.
    """
    result = np.empty(vertices.shape, np.float32)
    columns = np.ascontiguousarray(vertices.T, np.float64)
    product = np.empty(len(vertices), np.float64)
    for axis in range(3):
        total = columns[0] * matrix[axis, 0]
        total += np.multiply(columns[1], matrix[axis, 1], out=product)
        total += np.multiply(columns[2], matrix[axis, 2], out=product)
        total += matrix[axis, 3]
        result[:, axis] = total
    return result


def origin_for(places: Iterable[NDArray[np.float64]]) -> Vector:
    """A point near to all places, each (3,): 0 unless they are far from it.

    It depends on the places alone: frame by frame or all at once, pictures are the same.
    """
    found = np.array(list(places), np.float64).reshape(-1, 3)
    if not len(found):
        return (0.0, 0.0, 0.0)
    lower, upper = found.min(axis=0), found.max(axis=0)
    centre = lower / 2 + upper / 2
    # At least one unit, for what is all in one place.
    size = max(float((upper - lower).max()), 1.0)
    if np.abs(centre).max() <= _FAR * size:
        return (0.0, 0.0, 0.0)
    # A power of two, so that what is moved is not rounded.
    grid = 2.0 ** math.ceil(math.log2(_GRID * size))
    x, y, z = (np.round(centre / grid) * grid).tolist()
    return (x, y, z)


def moved(matrix: NDArray[np.float64], origin: Vector) -> NDArray[np.float64]:
    """The matrix that leads to the world moved by -origin."""
    if not any(origin):
        return matrix
    result = matrix.copy()
    result[:3, 3] -= origin
    return result
