"""Meshes that the tests are about: (vertices, triangles), closed and wound outward."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def cube(center: tuple[float, float, float] = (0, 0, 0), half: float = 1.0) -> Mesh:
    """12 triangles."""
    return box([c - half for c in center], [c + half for c in center])


def box(lower: list[float], upper: list[float]) -> Mesh:
    """12 triangles between two corners."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    vertices = np.array(lower) + corners * np.subtract(upper, lower)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return vertices, np.array(triangles, np.int32)


def torus(around: int, across: int, major: float = 1.0, minor: float = 0.4) -> Mesh:
    """2 x around x across triangles about the y axis."""
    u, v = np.meshgrid(
        np.arange(around) * (2 * np.pi / around),
        np.arange(across) * (2 * np.pi / across),
        indexing="ij",
    )
    ring = major + minor * np.cos(v)
    vertices = np.stack([ring * np.cos(u), minor * np.sin(v), ring * np.sin(u)], axis=-1)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    i2, j2 = (i + 1) % around, (j + 1) % across
    a, b, c, d = (p * across + q for p, q in ((i, j), (i, j2), (i2, j2), (i2, j)))
    triangles = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    return vertices.reshape(-1, 3), triangles.astype(np.int32)
