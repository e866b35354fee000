"""The workload in NumPy: the same scenes and rays, bit for bit, as ``workload.c``.

For the tests and for settling single rays; nothing here is timed. `docs/benchmark.md` is the
definition.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pyvocc.camera import PerspectiveCamera
from pyvocc.reproduce.workload import (
    CAMERA,
    GROUND_TRIANGLES,
    GROUND_VERTICES,
    LIGHTS,
    directions,
    hash32,
    normalised,
)

__all__ = [
    "GROUND_TRIANGLES",
    "GROUND_VERTICES",
    "LIGHTS",
    "MAX_SAMPLES",
    "MESHES",
    "NOT_TRACED",
    "SCENES",
    "GBuffer",
    "Mesh",
    "Placed",
    "Scene",
    "count_bytes",
    "directions",
    "load_counts",
    "load_gbuffer",
    "load_mesh",
    "load_scene",
    "normalised",
    "random_segments",
    "save_mesh",
    "shuffled",
]

Floats: TypeAlias = NDArray[np.float32]

MESHES = ("bunny", "armadillo", "dragon", "cowboy", "tubes131", "rose", "city")
NOT_TRACED = 0xFFFF
MAX_SAMPLES = 256  # the hash has room for so many
MOST_BYTES = 254  # samples whose counts are kept in bytes
TILE = 32

_TYPES = {
    "float": "<f4",
    "float32": "<f4",
    "uchar": "u1",
    "uint8": "u1",
    "int": "<i4",
    "int32": "<i4",
}


@dataclass(frozen=True)
class Mesh:
    """Normalised: unit extent, standing on y = 0.  Without the ground."""

    vertices: Floats
    triangles: NDArray[np.int32]

    def with_ground(self) -> tuple[Floats, NDArray[np.int32]]:
        count = np.int32(len(self.vertices))
        return (
            np.concatenate([self.vertices, GROUND_VERTICES]),
            np.concatenate([self.triangles, GROUND_TRIANGLES + count]),
        )


def load_mesh(path: Path) -> Mesh:
    """From a binary little-endian PLY of triangles."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = [line.split() for line in data[:end].decode("ascii").splitlines()]
    if ["format", "binary_little_endian", "1.0"] not in lines:
        raise ValueError(f"{path}: not a binary little-endian PLY")
    counts = {line[1]: int(line[2]) for line in lines if line[0] == "element"}
    scalars = [line[1:] for line in lines if line[0] == "property" and line[1] != "list"]
    vertex = np.dtype([(name, _TYPES[kind]) for kind, name in scalars])
    face = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
    rows = np.frombuffer(data, vertex, counts["vertex"], end)
    faces = np.frombuffer(data, face, counts["face"], end + rows.nbytes)
    if (faces["count"] != 3).any():
        raise ValueError(f"{path}: not all faces are triangles")
    vertices = np.stack([rows["x"], rows["y"], rows["z"]], axis=1)
    return Mesh(normalised(vertices, faces["corners"]), np.ascontiguousarray(faces["corners"]))


def save_mesh(path: Path, vertices: Floats, triangles: NDArray[np.int32]) -> None:
    """As a binary little-endian PLY."""
    faces = np.empty(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.ascontiguousarray(vertices, "<f4")
    path.write_bytes(header.encode("ascii") + rows.tobytes() + faces.tobytes())


@dataclass(frozen=True, eq=False)
class Placed:
    """A mesh in its scene; the ground comes in addition."""

    mesh: Mesh
    camera: PerspectiveCamera
    lights: Floats  # (lights, 3, 3): corner, edge u, edge v


@dataclass(frozen=True, eq=False)
class Scene:
    """What is around a mesh: `copies` of it along x and z, a camera, lights.

    With copies, the camera's x and z are in steps from one to the next.
    """

    copies: int
    camera: PerspectiveCamera
    lights: Floats

    def around(self, mesh: Mesh) -> Placed:
        if self.copies == 1:
            return Placed(mesh, self.camera, self.lights)
        used = mesh.vertices[mesh.triangles.ravel()].astype(np.float64)
        step = 1.25 * (used.max(axis=0) - used.min(axis=0))
        step[1] = 1.0
        n, count = self.copies, np.int32(len(mesh.vertices))
        vertices, triangles = [], []
        for copy in range(n * n):
            offset = np.array([copy % n - n // 2, 0, copy // n - n // 2]) * step
            vertices.append(mesh.vertices + offset.astype(np.float32))
            triangles.append(mesh.triangles + np.int32(copy) * count)
        eye = np.array(self.camera.eye)
        eye[[0, 2]] = (eye * step).astype(np.float32)[[0, 2]]
        target = np.array(self.camera.target) * step
        camera = PerspectiveCamera(
            tuple(eye.tolist()),
            tuple(target.tolist()),
            tan_half_fov=self.camera.tan_half_fov,
        )
        placed = Mesh(np.concatenate(vertices), np.concatenate(triangles))
        return Placed(placed, camera, self.lights)


SUNS = np.array(
    [
        [(20.96875, 4.640625, -6.109375), (0.0625, 0, 0.21875), (0, 0.21875, 0)],
        [(6.90625, 5.90625, -21.03125), (0.1875, 0, 0.0625), (0, 0.1875, 0)],
        [(-16.078125, 7.390625, -15.921875), (0.15625, 0, -0.15625), (0, 0.21875, 0)],
        LIGHTS[0],
    ],
    np.float32,
)

SCENES = {
    "workload": Scene(1, CAMERA, LIGHTS),
    "crowd": Scene(
        5, PerspectiveCamera((0.5, 0.375, 2.5), (0.0, 0.125, 0.0), tan_half_fov=0.4), LIGHTS
    ),
    "street": Scene(
        1,
        PerspectiveCamera(
            (-1171 / 4096, 21 / 8192, 38 / 4096),
            (-606 / 4096, 30 / 8192, 865 / 4096),
            tan_half_fov=0.35,
        ),
        SUNS,
    ),
}


def load_scene(path: Path, name: str) -> Placed:
    return SCENES[name].around(load_mesh(path))


@dataclass(frozen=True)
class GBuffer:
    width: int
    height: int
    points: Floats  # (pixels, 3), row by row
    normals: Floats
    prim: NDArray[np.int32]  # -1: background

    def tile_order(self) -> NDArray[np.uint32]:
        """The pixels in 32 x 32 tiles, without the background."""
        y, x = np.divmod(np.arange(self.width * self.height), self.width)
        order = np.lexsort((x, y, x // TILE, y // TILE))
        return order[self.prim[order] >= 0].astype(np.uint32)


def load_gbuffer(path: Path) -> GBuffer:
    data = path.read_bytes()
    if data[:8] != b"VOCCGBF1":
        raise ValueError(f"{path}: not a G-buffer")
    width, height = (int(n) for n in np.frombuffer(data, "<u4", 2, 8))
    rows = np.frombuffer(data, "<f4", width * height * 6, 16).reshape(-1, 6)
    prim = np.frombuffer(data, "<i4", width * height, 16 + rows.nbytes)
    points, normals = np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:])
    return GBuffer(width, height, points, normals, prim)


def load_counts(path: Path, size: int, samples: int) -> NDArray[np.uint16]:
    """(lights, size, size) visible samples, NOT_TRACED where not traced."""
    counts = np.fromfile(path, "u1" if samples <= MOST_BYTES else "<u2").astype(np.uint16)
    if samples <= MOST_BYTES:
        counts[counts == 255] = NOT_TRACED
    return counts.reshape(-1, size, size)


def count_bytes(counts: NDArray[np.uint16], samples: int) -> bytes:
    """As a file has them, and as they are hashed."""
    if samples > MOST_BYTES:
        return counts.astype("<u2").tobytes()
    return np.minimum(counts, 255).astype(np.uint8).tobytes()


def random_segments(mesh: Mesh, count: int) -> tuple[Floats, Floats]:
    """org and dir of segments between random points in the mesh's bounds."""
    used = mesh.vertices[mesh.triangles.ravel()]
    lower, upper = used.min(axis=0), used.max(axis=0)
    key = np.arange(8 * count, dtype=np.uint32).reshape(count, 8)[:, :6]
    unit = (hash32(key) >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)
    org = lower + unit[:, :3] * (upper - lower)
    return org, lower + unit[:, 3:] * (upper - lower) - org


def shuffled(count: int) -> NDArray[np.intp]:
    """The order of shuffled arrays: by a hash of the place, which is a permutation."""
    return np.argsort(hash32(np.arange(count, dtype=np.uint32)))
