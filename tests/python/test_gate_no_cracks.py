"""Gate: no cracks.  Segments through every vertex and the middle of every edge of closed meshes
are blocked, in every mode.

The reference is topology.  Two points in different regions have a surface between them; a ray
without end is outside at last.  So:

- from a point inside, a ray aimed at any target and on to infinity is blocked;
- from a point outside, the segment to just behind a target is blocked where that end is inside.

`tests/c/test_cracks.c` has the exact counterpart (rays that meet the vertex to the last bit).
Here rays pass a vertex within a rounding error, on whichever side: what real rays do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from conftest import SHARED
from numpy.typing import NDArray

import pyvocc
from pyvocc.shapes import GENERATORS, topology

Floats = NDArray[np.float32]
Regions = NDArray[np.int32]

# Those that are open, or only a finer cut of another.
OPEN = {"cube_missing_face", "plane", "cube_and_plane"}
GENERATED = sorted(n for n in GENERATORS if n not in OPEN and not n.startswith("fine_"))
CLOSED_FILES = (
    "armadillo.ply",
    "bunny.ply",
    "dragon.ply",
    "rose.ply",
    "tubes131.ply",
    "cowboy.ply",
    "cowboy_shells.ply",
    "city.ply",
    "spot.ply",
    "blobby_shuffled.off",
)

# How far behind the target the segment from outside may end, in t: for plates, too.
BEHIND = 1 + np.array([2.0**-10, 2.0**-16], np.float32)
# Of the largest meshes every mode but two traces a share of the rays.
RAYS_A_MODE = 40_000


@dataclass(frozen=True)
class Mode:
    order: str = "standard"
    occluders: bool = False
    packets: bool = False
    isa: str = "scalar"


MODES = [
    Mode(*choice)
    for choice in product(
        ("standard", "extended", "bfs", "qdbfs"), (False, True), (True, False), ("auto", "scalar")
    )
    # One ray at a time is the same code for every isa.
    if choice[2] or choice[3] == "scalar"
]


def targets(vertices: Floats, triangles: NDArray[np.int32]) -> Floats:
    """Every vertex in use, and the middle of every edge rounded to float32."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.unique(edges, axis=0)
    middles = vertices[edges].astype(np.float64).mean(axis=1)
    return np.concatenate([vertices[np.unique(triangles)], middles.astype(np.float32)])


def a_point_inside(scene: pyvocc.Scene, lower: Floats, upper: Floats) -> Floats:
    random = np.random.default_rng(3)
    for _ in range(20):
        points = random.uniform(lower, upper, (20_000, 3)).astype(np.float32)
        inside = points[scene.region(points) > 0]
        if len(inside):
            return inside[0]
    raise AssertionError("no point is inside")


def shares(count: int) -> Iterator[tuple[Mode, slice]]:
    """The baseline and the default with all rays, the others with some, all in turns."""
    step = -(-count // RAYS_A_MODE)
    for number, mode in enumerate(MODES):
        everything = mode in (Mode(), Mode("qdbfs", True, True, "auto"))
        yield mode, slice(None) if everything else slice(number % step, None, step)


def regions_at_ends(scene: pyvocc.Scene, org: Floats, dir: Floats, tmax: Floats) -> Regions:
    """The region of org + tmax dir as rounded to float32."""
    ends = org.astype(np.float64) + tmax[:, None].astype(np.float64) * dir.astype(np.float64)
    return scene.region(ends)


def certainly_inside(
    scene: pyvocc.Scene, org: Floats, dir: Floats, tmax: Floats
) -> NDArray[np.bool_]:
    """Whether org + tmax dir, of which float32 knows only the neighbourhood, is inside: the
    corners of a box around it that is wider than the rounding have one region, not 0."""
    if np.all(np.isinf(tmax)):
        return np.full(len(dir), True)
    ends = org.astype(np.float64) + tmax[:, None].astype(np.float64) * dir.astype(np.float64)
    slack = 4 * np.spacing(np.abs(ends).max(axis=1, keepdims=True).astype(np.float32))
    regions = np.stack(
        [
            scene.region((ends + slack * corner).astype(np.float32))
            for corner in product((-1, 1), repeat=3)
        ]
    )
    return np.all(regions == regions[0], axis=0) & (regions[0] > 0)


def check_all_blocked(
    scene: pyvocc.Scene, org: Floats, dir: Floats, tmax: Floats, what: str
) -> None:
    assert len(dir) > 0, what
    for mode, share in shares(len(dir)):
        blocked = scene.occluded(org, dir[share], tmax=tmax[share], **vars(mode))
        if blocked.all():
            continue
        # The exact end may be on the other side of the surface than the rounded one.
        missed = np.flatnonzero(~blocked)
        certain = certainly_inside(scene, org, dir[share][missed], tmax[share][missed])
        assert len(missed) <= 1 + len(blocked) // 10_000, f"{what}, {mode}: {len(missed)} missed"
        first = missed[certain][:1]
        assert not certain.any(), (
            f"{what}, {mode}: {certain.sum()} of {len(blocked)} rays get through, the first is "
            f"{org.tolist()} + t {dir[share][first].tolist()}, tmax {tmax[share][first]}"
        )


def check_mesh(vertices: Floats, triangles: NDArray[np.int32], name: str) -> None:
    with pyvocc.Scene() as scene:
        scene.add_mesh(vertices, triangles, name=name)
        scene.build(strict=True)
        assert not scene.origin.any()
        aims = targets(vertices, triangles)
        used = vertices[np.unique(triangles)]
        lower, upper = used.min(axis=0), used.max(axis=0)

        inside = a_point_inside(scene, lower, upper)
        dir = aims - inside
        dir = dir[np.any(dir != 0, axis=1)]
        tmax = np.full(len(dir), np.inf, np.float32)
        check_all_blocked(scene, inside, dir, tmax, f"{name}, from inside")

        size = float((upper - lower).max())
        outside = (upper + size * np.array([0.75, 0.5, 0.25])).astype(np.float32)
        assert scene.region(outside) == 0
        dir = aims - outside
        tmax = np.full(len(dir), BEHIND[0])
        inside_at = regions_at_ends(scene, outside, dir, tmax) > 0
        tmax[~inside_at] = BEHIND[1]
        inside_at[~inside_at] = (
            regions_at_ends(scene, outside, dir[~inside_at], tmax[~inside_at]) > 0
        )
        check_all_blocked(scene, outside, dir[inside_at], tmax[inside_at], f"{name}, from outside")


@pytest.mark.parametrize("name", GENERATED)
def test_generated(name: str) -> None:
    vertices, triangles = GENERATORS[name]()
    assert topology(vertices, triangles).closed
    check_mesh(vertices, triangles, name)


@pytest.mark.parametrize("name", CLOSED_FILES)
def test_real(name: str) -> None:
    path = SHARED / "meshes" / name
    if not path.is_file():
        pytest.skip("the shared meshes are not here")
    vertices, triangles = pyvocc.load_mesh(path)
    vertices = np.ascontiguousarray(vertices, np.float32)
    check_mesh(vertices, np.ascontiguousarray(triangles, np.int32), name)
