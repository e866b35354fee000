"""Where meshes, G-buffers and reference images come from."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .programs import BUILD, ROOT, BenchError
from .workload import MESHES, SCENES, normalised, save_mesh

SHARED = ROOT.parent / "shared"

# Generators of pyvocc/shapes.py with their parameters: about the size of the models.
_GENERATED: dict[str, dict[str, int]] = {
    "bumpy_solid": {},
    "torus_knot": {},
    "tube_network": {},
    "figure": {},
    "flower": {},
    "city": {},
}

# Said wherever their results are shown: these are not the models of the paper.
STAND_INS = {
    "armadillo": "re-subdivided from a decimated model",
    "rose": "procedural stand-in",
    "tubes131": "procedural stand-in for Yeah Right",
    "cowboy": "stand-in",
}


@dataclass(frozen=True)
class Input:
    name: str
    path: Path
    workload: Path | None  # the folder with reference G-buffers and counts

    def gbuffer(self, size: int, scene: str) -> Path:
        """To be loaded, or made and kept by the first program that runs."""
        if self.workload is not None and scene == "workload":
            reference = self.workload / f"{self.name}_{size}.gbuf"
            if reference.exists():
                return reference
        folder = BUILD / "gbuffers"
        folder.mkdir(parents=True, exist_ok=True)
        # Named by content: a changed mesh or scene must not find its old G-buffer.
        content = zlib.crc32(f"{SCENES[scene].copies} {SCENES[scene].camera}".encode())
        content = zlib.crc32(self.path.read_bytes(), content)
        return folder / f"{self.name}_{scene}_{size}_{content:08x}.gbuf"

    def counts(self, size: int, samples: int, scene: str) -> Path | None:
        """The reference image, if there is one."""
        if self.workload is None or scene != "workload":
            return None
        path = self.workload / f"{self.name}_{size}x{samples}.counts"
        return path if path.exists() else None


def inputs(folder: Path | None, only: Sequence[str]) -> list[Input]:
    """The meshes of a folder; without one, the shared models or else generated meshes."""
    if folder is None and (SHARED / "meshes").is_dir():
        folder = SHARED / "meshes"
    if folder is None:
        return [_generated(name) for name in only or _GENERATED]
    workload = folder.parent / "workload"
    names = only or [name for name in MESHES if (folder / f"{name}.ply").exists()]
    if not names:
        names = sorted(path.stem for path in folder.glob("*.ply"))
    if not names:
        raise BenchError(f"{folder}: no PLY files")
    found = []
    for name in names:
        path = folder / f"{name}.ply"
        if not path.exists():
            raise BenchError(f"{path}: no such file")
        found.append(Input(name, path, workload if workload.is_dir() else None))
    return found


def _generated(name: str) -> Input:
    from pyvocc.shapes import GENERATORS

    if name not in GENERATORS:
        raise BenchError(f"no generator {name!r} in pyvocc/shapes.py")
    vertices, triangles = GENERATORS[name](**_GENERATED.get(name, {}))
    folder = BUILD / "meshes"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.ply"
    save_mesh(path, normalised(vertices, triangles), triangles)
    return Input(name, path, None)
