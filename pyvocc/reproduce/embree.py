"""Embree on the same rays, where a source checkout and Embree are there.

The program that traces them is `bench/run_embree`; it is not part of the installed package.
"""

from __future__ import annotations

import hashlib
import importlib
import struct
import sys
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..errors import Error
from ..mesh_files import save_ply
from .subjects import Mesh
from .workload import Points

# The hash that the program tells is of bytes.
MAX_SAMPLES = 254


class Unavailable(Exception):
    """Why Embree is not measured."""


class Embree:
    """The programs of the checkout; raises Unavailable where there are none."""

    def __init__(self, samples: int) -> None:
        root = Path(__file__).resolve().parents[2]
        if not (root / "bench" / "run_embree.c").is_file():
            raise Unavailable("this is not a source checkout, which has the program that runs it")
        if samples > MAX_SAMPLES:
            raise Unavailable(f"its program takes at most {MAX_SAMPLES} samples")
        if str(root) not in sys.path:
            sys.path.append(str(root))
        self._programs: Any = importlib.import_module("bench.programs")
        measure: Any = importlib.import_module("bench.measure")
        try:
            # Asked first: without it there is nothing to compile.
            if not (self._programs.has_embree() and self._programs.build()):
                raise Unavailable("Embree 3 is not installed (Debian: libembree-dev 3.13)")
        except self._programs.BenchError as error:
            raise Unavailable(str(error)) from None
        self.modes: tuple[str, ...] = measure.EMBREE
        program: Path = self._programs.BUILD / "run_embree"
        self.digest = hashlib.sha256(program.read_bytes()).hexdigest()[:16]

    def trace(self, mesh: Mesh, points: Points, samples: int) -> Traced:
        """A running program that holds the scene and the points."""
        return Traced(self._programs, mesh, points, samples)


class Traced:
    """Embree's scene of one subject, to be timed again and again."""

    def __init__(self, programs: Any, mesh: Mesh, points: Points, samples: int) -> None:
        self._programs = programs
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        # The program normalises what it reads, as was done here.
        save_ply(folder / "mesh.ply", mesh.source, mesh.triangles)
        _save_points(folder / "points.gbuf", points)
        self._program: Any = programs.Program(
            "embree",
            folder / "mesh.ply",
            *("--size", str(points.size), "--samples", str(samples)),
            *("--gbuf", folder / "points.gbuf"),
        )

    def __enter__(self) -> Self:
        self._program.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._program.__exit__(kind, error, traceback)
        self._folder.cleanup()

    def time(self, mode: str) -> dict[str, Any]:
        """One pass: its seconds of CPU time, rays and the hash of its image."""
        try:
            line = self._program.time(mode)
        except self._programs.BenchError as error:
            raise Error(str(error)) from None
        if "error" in line:
            return {"error": line["error"]}
        return {"seconds": line["cpu_s"], "rays": line["rays"], "hash": line["hash"]}


def _save_points(path: Path, points: Points) -> None:
    """As the programs' G-buffer; -1 marks the background."""
    count = points.size * points.size
    rows = np.zeros((count, 6), "<f4")
    rows[points.pixels, :3], rows[points.pixels, 3:] = points.position, points.normal
    prim = np.full(count, -1, "<i4")
    prim[points.pixels] = points.prim_id
    header = b"VOCCGBF1" + struct.pack("<2I", points.size, points.size)
    path.write_bytes(header + rows.tobytes() + prim.tobytes())


def fnv1a(data: bytes) -> str:
    """The hash of an image as the programs tell it."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return f"{value:016x}"
