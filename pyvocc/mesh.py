"""Triangle meshes: what a scene takes, and what it traces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import AnyArray, floats, integers
from ._values import Vector
from .errors import InvalidArgument


def checked_vertices(vertices: ArrayLike) -> AnyArray:
    """(V, 3) float32 or float64."""
    return _matrix("vertices", floats("vertices", vertices))


def checked_triangles(triangles: ArrayLike) -> AnyArray:
    """(T, 3) integers of 32 or 64 bit."""
    return _matrix("triangles", integers("triangles", triangles))


def _matrix(name: str, array: AnyArray) -> AnyArray:
    if array.shape == (0,):
        return array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidArgument(f"{name} must have shape (n, 3), got {array.shape}", argument=name)
    return array


class Geometry:
    """The triangles of a built scene as they are traced: float32, relative to its origin."""

    def __init__(self, meshes: Sequence[tuple[AnyArray, AnyArray]], origin: Vector) -> None:
        vertex_counts = [len(vertices) for vertices, _ in meshes]
        triangle_counts = [len(triangles) for _, triangles in meshes]
        first_vertex = np.cumsum([0, *vertex_counts])
        self._first = np.cumsum([0, *triangle_counts])
        self._vertices = np.empty((first_vertex[-1], 3), np.float32)
        self._triangles = np.empty((self._first[-1], 3), np.int32)
        for index, (vertices, triangles) in enumerate(meshes):
            part = slice(first_vertex[index], first_vertex[index + 1])
            # The difference is rounded once, from double, as the library rounds it.
            self._vertices[part] = np.subtract(vertices, origin, dtype=np.float64)
            part = slice(self._first[index], self._first[index + 1])
            np.add(triangles, first_vertex[index], out=self._triangles[part], casting="unsafe")

    def corners(self, geom_id: AnyArray, prim_id: AnyArray) -> NDArray[np.float32]:
        """(..., 3, 3): the corners of triangles that are known to exist."""
        result: NDArray[np.float32] = self._vertices[
            self._triangles[self._first[geom_id] + prim_id]
        ]
        return result

    def largest_extent(self, geom_ids: Iterable[int]) -> float:
        """Of the bounds of all these meshes' triangles together; 0 without any."""
        corners = [
            self._vertices[np.unique(self._triangles[self._first[index] : self._first[index + 1]])]
            for index in geom_ids
        ]
        points = np.concatenate(corners) if corners else np.empty((0, 3), np.float32)
        if len(points) == 0:
            return 0.0
        return float(np.max(points.max(axis=0).astype(np.float64) - points.min(axis=0)))

    @cached_property
    def largest_coordinate(self) -> float:
        """Largest |coordinate| of a triangle's corner; 0 without any."""
        used = np.zeros(len(self._vertices), bool)
        used[self._triangles] = True
        return float(np.abs(self._vertices[used]).max(initial=0.0))
