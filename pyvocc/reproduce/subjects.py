"""The scenes: the slides' six, what stands for them here, and the slides' figures."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .. import shapes
from .._files import FileError
from ..errors import Error
from ..mesh_files import load_mesh
from .workload import Floats, Triangles, normalised


@dataclass(frozen=True)
class Slides:
    """A row of the slides' tables."""

    name: str
    triangles: int  # thousands
    base: float  # Mrays/s, "Another look: shadow ray rate"
    occluders: float
    area: float  # v.o. SA / geom SA, "Cowboy failure case"

    @property
    def gain(self) -> float:
        """How many times as fast with occluders."""
        return self.occluders / self.base


ARMADILLO = Slides("Armadillo", 346, 7.2, 13.1, 45)
BUNNY = Slides("Bunny", 70, 6.4, 10.7, 18)
DRAGON = Slides("Dragon", 871, 6.0, 12.2, 36)
ROSE = Slides("Rose", 326, 11.6, 15.0, 11)
YEAH_RIGHT = Slides("Yeah Right", 119, 6.8, 6.8, 9.6)
COWBOY = Slides("Cowboy", 7, 16.2, 17.9, 9.6)

# Those that the slides call failure cases.
FAILURES = (YEAH_RIGHT, COWBOY)
# Those of which they show up to twice the speed: large inside, finely tessellated.
SOLIDS = (ARMADILLO, BUNNY, DRAGON)


@dataclass(frozen=True)
class Subject:
    """A mesh to be traced.

    Attributes:
        name: of the file, and for `--only`.
        title: shown.
        slides: the row of the slides that it is or stands for.
        note: in what it is not the slides' model; empty if it is.
        generate: makes it, where no file is given.
    """

    name: str
    title: str
    slides: Slides | None
    note: str = ""
    generate: Callable[[], shapes.Mesh] | None = None

    @property
    def solid(self) -> bool:
        return self.slides in SOLIDS

    @property
    def failure(self) -> bool:
        return self.slides in FAILURES


MODELS = (
    Subject(
        "armadillo",
        "Armadillo",
        ARMADILLO,
        "re-subdivided from a decimated model: the finest detail is interpolated",
    ),
    Subject("bunny", "Bunny", BUNNY),
    Subject("dragon", "Dragon", DRAGON),
    Subject("rose", "Rose", ROSE, "a stand-in: procedural, thin closed petals"),
    Subject("tubes131", "Tubes", YEAH_RIGHT, "a stand-in: procedural, thin tubes of genus 131"),
    Subject("cowboy", "Cowboy", COWBOY, "a stand-in: another low-poly figure"),
)
# Realistic and further objects, traced where their files are.
MORE_MODELS = (
    Subject("city", "City", None, "not in the slides: real buildings on a slab"),
    Subject("spot", "Spot", None, "not in the slides: a smooth cow"),
)
SHAPES = (
    Subject(
        "rock",
        "Rock",
        ARMADILLO,
        "a generated stand-in: a bumpy solid like a scan",
        lambda: shapes.bumpy_solid(frequency=128),
    ),
    Subject(
        "ball",
        "Ball",
        BUNNY,
        "a generated stand-in: a smooth solid with a large inside",
        lambda: shapes.geodesic_sphere(60),
    ),
    Subject(
        "petals",
        "Petals",
        ROSE,
        "a generated stand-in: thin closed petals",
        lambda: shapes.flower(detail=56),
    ),
    Subject(
        "tubes",
        "Tubes",
        YEAH_RIGHT,
        "a generated stand-in: thin tubes of high genus",
        lambda: shapes.tube_network(cell=0.075),
    ),
    Subject(
        "figure",
        "Figure",
        COWBOY,
        "a generated stand-in: a low-poly figure",
        lambda: shapes.figure(cell=0.054),
    ),
    Subject(
        "blocks",
        "Blocks",
        None,
        "not in the slides: a generated city, its faces cut fine",
        lambda: shapes.subdivided(shapes.city(), 2),
    ),
)


def subjects(folder: Path | None, only: Sequence[str] = ()) -> tuple[Subject, ...]:
    """Those to be traced.

    Raises:
        Error: `only` names one that there is not.
        FileError: the folder or one of its files is not there.
    """
    known = SHAPES if folder is None else MODELS + MORE_MODELS
    names = [subject.name for subject in known]
    for name in only:
        if name not in names:
            raise Error(f"there is no scene {name!r}; there are {', '.join(names)}")
    if folder is None:
        return tuple(s for s in known if not only or s.name in only)
    if not folder.is_dir():
        raise FileError(folder, "is not a folder" if folder.exists() else "no such folder")
    wanted = [
        subject
        for subject in known
        if (subject.name in only if only else subject in MODELS or _file(folder, subject).exists())
    ]
    for subject in wanted:
        path = _file(folder, subject)
        if not path.is_file():
            hint = "" if only else " (--only takes those that are there)"
            raise FileError(path, f"no such file{hint}")
    return tuple(replace(s, generate=None) for s in wanted)


def _file(folder: Path, subject: Subject) -> Path:
    return folder / f"{subject.name}.ply"


@dataclass(frozen=True, eq=False)
class Mesh:
    """A subject's mesh, without the ground.

    Attributes:
        source: vertices as read or generated.
        vertices: normalised.
        triangles: of both.
    """

    source: Floats
    vertices: Floats
    triangles: Triangles

    @cached_property
    def digest(self) -> str:
        """Of the arrays: names the mesh in what is kept."""
        both = hashlib.sha256(self.vertices.tobytes())
        both.update(self.triangles.tobytes())
        return both.hexdigest()[:16]


def load(subject: Subject, folder: Path | None) -> Mesh:
    """Reads or generates a mesh.

    Raises:
        FileError: the file cannot be read as a mesh.
    """
    if subject.generate is not None:
        source, triangles = subject.generate()
    else:
        assert folder is not None
        read, triangles = load_mesh(_file(folder, subject))
        source = read.astype(np.float32)
    return Mesh(source, normalised(source, triangles), triangles)
