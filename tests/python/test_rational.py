"""The exact oracle of `bench/rational.py`: by hand-made cases, then against the library.

Oracle and library share no code and no method (integers over all triangles; filtered floats
over a tree), so that a mistake in either shows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import shapes
from numpy.typing import NDArray

import pyvocc

sys.path.append(str(Path(__file__).resolve().parents[2]))
from bench.rational import Oracle, to_float32
from pyvocc.shapes import GENERATORS

Rays = NDArray[np.float32]  # (rays, 8): org, dir, tmin, tmax

TRIANGLE = Oracle([[0, 0, 1], [4, 0, 1], [0, 4, 1]], [[0, 1, 2]])
UP = (0.0, 0.0, 1.0)


# ---- by hand ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("org", "hit"),
    [
        ((1, 1, 0), True),
        ((0, 0, 0), True),  # a corner
        ((2, 0, 0), True),  # an edge
        ((2, 2, 0), True),  # the sloping edge
        ((2, np.nextafter(np.float32(2), np.float32(3)), 0), False),
        ((2, -1e-45, 0), False),  # the smallest float32 beside the edge
        ((2, 1e-45, 0), True),
        ((5, 5, 0), False),
    ],
)
def test_a_triangle_holds_its_edges_and_no_more(org: tuple[float, ...], hit: bool) -> None:
    assert TRIANGLE.occluded(org, UP) is hit


@pytest.mark.parametrize("flip", [1, -1])
def test_both_sides_count(flip: int) -> None:
    assert TRIANGLE.occluded((1, 1, 1 - flip), (0, 0, flip))


@pytest.mark.parametrize(
    ("tmin", "tmax", "hit"),
    [
        (0, 1, False),  # ends on the triangle
        (0, np.nextafter(np.float32(1), np.float32(2)), True),
        (1, 2, False),  # begins on it
        (np.nextafter(np.float32(1), np.float32(0)), 2, True),
        (-np.inf, np.inf, True),
        (2, 1, False),
        (np.nan, 1, False),
    ],
)
def test_the_interval_is_open(tmin: float, tmax: float, hit: bool) -> None:
    assert TRIANGLE.occluded((1, 1, 0), UP, tmin, tmax) is hit


def test_behind_the_origin_only_with_a_negative_tmin() -> None:
    assert not TRIANGLE.occluded((1, 1, 2), UP)
    assert TRIANGLE.occluded((1, 1, 2), UP, tmin=-np.inf)


def test_a_triangle_seen_edge_on_is_not_met() -> None:
    assert not TRIANGLE.occluded((-1, 1, 1), (1, 0, 0))


def test_a_triangle_without_area_is_not_met() -> None:
    line = Oracle([[0, 0, 1], [1, 1, 1], [2, 2, 1]], [[0, 1, 2], [0, 0, 1], [1, 1, 1]])
    assert not line.occluded((1, 1, 0), UP)


@pytest.mark.parametrize("dir", [(0, 0, 0), (0, 0, np.inf), (np.nan, 0, 1)])
def test_a_ray_without_a_direction_meets_nothing(dir: tuple[float, ...]) -> None:
    assert not TRIANGLE.occluded((1, 1, 0), dir, -np.inf)


def test_crossings_are_exact_and_sorted() -> None:
    oracle = Oracle(
        [[0, 0, 3], [4, 0, 3], [0, 4, 3], [0, 0, 1], [4, 0, 1], [0, 4, 1]],
        [[0, 1, 2], [3, 4, 5], [5, 4, 3]],
    )
    found = oracle.crossings((1, 1, 0), (0, 0, 7))
    assert [(c.t, c.triangle) for c in found] == [
        (Fraction(1, 7), 1),
        (Fraction(1, 7), 2),
        (Fraction(3, 7), 0),
    ]


def test_float32s_far_apart() -> None:
    """Where double arithmetic would have to round: 2^100 beside 2^-100."""
    big, small = 2.0**100, 2.0**-100
    oracle = Oracle([[-big, -big, 0], [big, -big, 0], [small, big, 0]], [[0, 1, 2]])
    org = (0, 0, -small)
    assert oracle.occluded(org, (0, 0, 1), tmax=2 * small)
    assert not oracle.occluded(org, (0, 0, 1), tmax=small)
    # The edge from (-big, -big) to (small, big) passes right of this by 2^-101.
    left = np.float32(-big / 2)
    assert not oracle.occluded((left, 0, -1), UP)
    assert oracle.occluded((np.nextafter(left, np.float32(0)), 0, -1), UP)


def test_rounding_to_float32_breaks_ties_to_even() -> None:
    assert to_float32(Fraction(1, 3)) == np.float32(1 / 3)
    assert to_float32(1 + Fraction(1, 2**24)) == np.float32(1)
    assert to_float32(1 + Fraction(3, 2**24)) == np.float32(1 + 2**-22)
    # Rounded by way of float64, this tie breaks the wrong way.
    assert to_float32(1 + Fraction(1, 2**24) + Fraction(1, 2**60)) == np.float32(1 + 2**-23)


def test_the_prefilter_drops_no_crossing() -> None:
    """The same answers without it, on rays that pass edges by an ulp or not at all."""

    class Unfiltered(Oracle):
        def _candidates(self, *_: object) -> NDArray[np.int64]:
            return np.arange(len(self._triangles))

    vertices, triangles = shapes.torus(8, 6)
    filtered, all_of_them = Oracle(vertices, triangles), Unfiltered(vertices, triangles)
    for org_x, org_y, org_z, *rest in adversarial(vertices.astype(np.float32), triangles)[::3]:
        org, dir, t = (org_x, org_y, org_z), rest[:3], rest[3:]
        assert filtered.crossings(org, dir, *t) == all_of_them.crossings(org, dir, *t)


# ---- against the library -----------------------------------------------------------------


def adversarial(vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> Rays:
    """Rays where rounding decides: through corners, along edges, in planes, just past ends."""
    random = np.random.default_rng(11)
    v = vertices.astype(np.float32)
    extent = np.ptp(v, axis=0).max()
    picked = triangles[random.permutation(len(triangles))[:40]]
    corner, other, third = (v[picked[:, i]] for i in range(3))
    middle = (corner + other) / np.float32(2)
    inner = (corner + other + third) / np.float32(3)
    outside = (random.normal(size=corner.shape) * 2 * extent).astype(np.float32)
    axis = np.eye(3, dtype=np.float32)[random.integers(0, 3, len(picked))]
    axis *= random.choice(np.float32([-1, 1]), (len(picked), 1))
    tiny, one, ends = np.float32(1e-42), np.float32(1), (np.float32(0), np.float32(np.inf))
    after = np.nextafter(one, np.float32(2))
    groups = [
        (outside, corner - outside, *ends),  # at corners
        (outside, middle - outside, *ends),  # at edges
        (outside, inner - outside, 0, 1),  # ends about where the triangle is
        (outside, inner - outside, 0, after),
        (outside, inner - outside, one, ends[1]),
        (corner - axis * extent * 2, axis, *ends),  # parallel to an axis, through corners
        (middle - axis * extent * 2, axis, *ends),
        (corner, other - corner, *ends),  # along an edge
        (corner + (corner - other), other - corner, *ends),
        (inner, corner - inner, *ends),  # from the surface, within the plane or close to it
        (inner, outside - inner, 0, 1),
        (corner, outside - corner, 0, 1),
        (corner, outside - corner, -ends[1], ends[1]),
        (inner, axis, 0, tiny),
        (inner - axis * tiny, axis * tiny, 0, 2),
        (outside, (inner - outside) * np.float32(1e30), 0, np.float32(1e-30)),
        (inner, np.roll(inner, 1, axis=0) - inner, 0, 1),  # both ends on the surface
    ]
    rays = []
    for org, dir, tmin, tmax in groups:
        group = np.empty((len(picked), 8), np.float32)
        group[:, 0:3], group[:, 3:6], group[:, 6], group[:, 7] = org, dir, tmin, tmax
        rays.append(group)
    return np.concatenate(rays)


def rounded(vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> shapes.Mesh:
    return vertices.astype(np.float32), triangles


MESHES: dict[str, Callable[[], shapes.Mesh]] = {
    "cube": lambda: rounded(*shapes.cube()),
    "torus": lambda: rounded(*shapes.torus(24, 10)),
    **{
        name: GENERATORS[name]
        for name in (
            "cube_missing_face",
            "overlapping_cubes",
            "touching_solids",
            "hollow_room",
            "thin_plates",
        )
    },
}


@pytest.mark.parametrize("name", MESHES)
def test_the_library_agrees_on_adversarial_rays(name: str) -> None:
    vertices, triangles = MESHES[name]()
    rays = adversarial(vertices, triangles)
    org, dir, tmin, tmax = rays[:, 0:3], rays[:, 3:6], rays[:, 6], rays[:, 7]
    oracle = Oracle(vertices, triangles)
    exact = [oracle.crossings(o, d, a, b) for o, d, a, b in zip(org, dir, tmin, tmax, strict=True)]
    expected = np.array([bool(crossings) for crossings in exact])
    assert 0.1 < expected.mean() < 0.95  # else the rays test little

    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(vertices, triangles)
    scene.build()
    modes: list[pyvocc.QueryOptions] = [
        {"order": "standard", "occluders": False},
        {"order": "standard", "occluders": False, "packets": False},
        {"order": "standard", "occluders": False, "isa": "scalar"},
        {"order": "qdbfs"},
        {"order": "auto"},
    ]
    for mode in modes:
        occluded = scene.occluded(org, dir, tmin, tmax, **mode)
        wrong = np.flatnonzero(occluded != expected)
        assert not len(wrong), (mode, [[float(x).hex() for x in ray] for ray in rays[wrong[:3]]])

    hits = scene.intersect(org, dir, tmin, tmax)
    for ray, crossings, t, prim_id in zip(rays, exact, hits.t, hits.prim_id, strict=True):
        if not crossings:
            assert prim_id == -1 and t == np.inf
            continue
        nearest = to_float32(crossings[0].t)
        equal = [c.triangle for c in crossings if to_float32(c.t) == nearest]
        assert (t, prim_id) == (nearest, min(equal)), [float(x).hex() for x in ray]
