"""The soft-shadow workload: a mesh on a ground, five area lights, one camera.

The same rays, bit for bit, as `bench/workload.c`: every operation below rounds once, in the
order written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import PerspectiveCamera
from ..lights import RectLight
from ..scene import Scene
from ..shadow import OFFSET, shading_point, tile_order

Floats: TypeAlias = NDArray[np.float32]
Triangles: TypeAlias = NDArray[np.int32]

# corner, edge u, edge v
LIGHTS = np.array(
    [
        [(-0.5, 3, -0.5), (1, 0, 0), (0, 0, 1)],
        [(1.75, 1.25, 2.25), (0.5, 0, -0.5), (0, 0.5, 0)],
        [(-2.25, 1.75, 1.75), (0.5, 0, 0.5), (0, 0.5, 0)],
        [(-1.75, 2.25, -2.25), (-0.5, 0, 0.5), (0, 0.5, 0)],
        [(2.25, 1.5, -1.75), (-0.5, 0, -0.5), (0, 0.5, 0)],
    ],
    np.float32,
)
RECT_LIGHTS = tuple(RectLight(*light) for light in LIGHTS.astype(float).tolist())

CAMERA = PerspectiveCamera((0.0, 1.75, 2.25), (0.0, 0.375, 0.0), tan_half_fov=0.28)

GROUND_VERTICES = np.array([(-16, 0, -16), (16, 0, -16), (16, 0, 16), (-16, 0, 16)], np.float32)
GROUND_TRIANGLES = np.array([(0, 2, 1), (0, 3, 2)], np.int32)
GROUND_ID = 1  # geom_id; the mesh is 0


def normalised(vertices: NDArray[np.floating], triangles: Triangles) -> Floats:
    """The vertices moved and scaled: largest extent 1, centred in x and z, standing on y = 0."""
    vertices = vertices.astype(np.float32)
    used = vertices[triangles.ravel()].astype(np.float64)
    lower, upper = used.min(axis=0), used.max(axis=0)
    scale = 1.0 / (upper - lower).max()
    centre = np.array([(lower[0] + upper[0]) * 0.5, lower[1], (lower[2] + upper[2]) * 0.5])
    moved: NDArray[np.float64] = (vertices.astype(np.float64) - centre) * scale
    return moved.astype(np.float32)


def build(vertices: Floats, triangles: Triangles, name: str) -> Scene:
    """The built scene of a normalised mesh and the ground, on one thread."""
    scene = Scene(threads=1)
    scene.add_mesh(vertices, triangles, name=name)
    scene.add_mesh(GROUND_VERTICES, GROUND_TRIANGLES, name="ground")
    scene.build()
    return scene


@dataclass(frozen=True, eq=False)
class Points:
    """What the camera sees, tile by tile, without the background.

    Attributes:
        size: pixels along a side of the image.
        pixels: (N,) uint32, y * size + x.
        position, normal: (N, 3) float32; positions are moved off the surface.
        geom_id, prim_id: (N,) int32.
    """

    size: int
    pixels: NDArray[np.uint32]
    position: Floats
    normal: Floats
    geom_id: NDArray[np.int32]
    prim_id: NDArray[np.int32]


def shading_points(scene: Scene, size: int) -> Points:
    """Where the camera's rays meet the scene."""
    pixels = tile_order(size, size)
    org, dir = CAMERA.rays((size, size), pixels)
    hits = scene.intersect(org, dir)
    hit = np.flatnonzero(hits.prim_id >= 0)
    geom_id, prim_id = hits.geom_id[hit], hits.prim_id[hit]
    corners = scene.corners(geom_id, prim_id)
    position, normal = shading_point(corners, org, dir[hit], hits.t[hit], OFFSET)
    return Points(size, pixels[hit], position, normal, geom_id, prim_id)


def directions(
    light: int, pixel: ArrayLike, org: Floats, samples: int, lights: Floats = LIGHTS
) -> Floats:
    """From points to the samples of one light: (..., samples, 3) for pixels of shape (...)."""
    nv = next(n for n in range(int(samples**0.5), 0, -1) if samples % n == 0)
    nu = samples // nv
    s = np.arange(samples, dtype=np.uint32)
    key = np.asarray(pixel, np.uint64)[..., None] * np.uint64(2048) + np.uint64(light * 256) + s
    h = hash32((key & np.uint64(0xFFFFFFFF)).astype(np.uint32))
    step = np.float32(1 / 65536)
    j1 = (h & np.uint32(0xFFFF)).astype(np.float32) * step
    j2 = (h >> np.uint32(16)).astype(np.float32) * step
    one = np.float32(1)
    a = ((s % nu).astype(np.float32) + j1) * (one / np.float32(nu))
    b = ((s // nu).astype(np.float32) + j2) * (one / np.float32(nv))
    corner, u, v = lights[light]
    target = (corner + a[..., None] * u) + b[..., None] * v
    return np.asarray(target - org.astype(np.float32)[..., None, :], np.float32)


def hash32(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    x = x ^ (x >> np.uint32(16))
    x = x * np.uint32(0x7FEB352D)
    x = x ^ (x >> np.uint32(15))
    x = x * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))
