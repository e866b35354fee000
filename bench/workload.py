"""The workload in NumPy: the same meshes and rays, bit for bit, as ``workload.c``.

For the tests and for settling single rays; nothing here is timed. The definition itself is
in `pyvocc/reproduce/workload.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pyvocc.reproduce.workload import (
    GROUND_TRIANGLES,
    GROUND_VERTICES,
    LIGHTS,
    directions,
    normalised,
)

__all__ = [
    "GROUND_TRIANGLES",
    "GROUND_VERTICES",
    "LIGHTS",
    "MESHES",
    "NOT_TRACED",
    "GBuffer",
    "Mesh",
    "directions",
    "load_counts",
    "load_gbuffer",
    "load_mesh",
    "normalised",
    "save_mesh",
]

Floats: TypeAlias = NDArray[np.float32]

MESHES = ("bunny", "armadillo", "dragon", "cowboy", "tubes131", "rose", "city")
NOT_TRACED = 255
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


def load_counts(path: Path, width: int, height: int) -> NDArray[np.uint8]:
    """(lights, height, width) visible samples, 255 where not traced."""
    return np.fromfile(path, np.uint8).reshape(len(LIGHTS), height, width)
