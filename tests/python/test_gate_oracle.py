"""Gate: the oracle.  Meshes and rays that hypothesis makes up, against rational arithmetic.

Everything is decided by `fractions.Fraction` on the float32 values themselves, so that no case
is too close to an edge to tell, and none is left out.  Grids of small integers make rays meet
vertices, edges and planes exactly most of the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import pyvocc

Vector = tuple[Fraction, Fraction, Fraction]
Floats = NDArray[np.float32]


# ---- the definition ------------------------------------------------------------------------


def exact(row: Floats) -> Vector:
    x, y, z = (Fraction(float(value)) for value in row)
    return x, y, z


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@dataclass(frozen=True)
class Ray:
    org: tuple[float, float, float]
    dir: tuple[float, float, float]
    tmin: float
    tmax: float


def meets(ray: Ray, corners: Floats) -> tuple[Fraction, Fraction, Fraction] | None:
    """t, u, v of the hit, or None."""
    o, d = exact(np.float32(ray.org)), exact(np.float32(ray.dir))
    a, b, c = (minus(exact(corner), o) for corner in corners)
    weights = dot(d, cross(b, c)), dot(d, cross(c, a)), dot(d, cross(a, b))
    det = sum(weights)
    if det == 0 or (min(weights) < 0 < max(weights)):
        return None
    t = dot(a, cross(b, c)) / det
    if t <= ray.tmin or t >= ray.tmax:
        return None
    return t, weights[1] / det, weights[2] / det


def to_float32(t: Fraction) -> np.float32:
    """Rounded once, ties to even."""
    if abs(t) >= 2**128 - 2**103:
        return np.float32(np.inf if t > 0 else -np.inf)
    most = float(np.finfo(np.float32).max)
    guess = np.float32(min(max(float(t), -most), most))
    near = [
        guess,
        np.nextafter(guess, np.float32(-np.inf)),
        np.nextafter(guess, np.float32(np.inf)),
    ]
    finite = [x for x in near if np.isfinite(x)]
    return min(finite, key=lambda x: (abs(Fraction(float(x)) - t), int(x.view(np.uint32)) & 1))


# ---- what hypothesis makes up ----------------------------------------------------------------

SMALL = st.integers(-3, 3).map(float)
HALVES = st.integers(-12, 12).map(lambda i: i / 4)
ANY = st.floats(-1e3, 1e3, width=32)
WILD = st.floats(width=32, allow_nan=False, allow_infinity=False)
ENDS = st.sampled_from([0.0, 1.0, 2.0, 0.5, -1.0, float("inf"), float("-inf"), 1e-30, 3.4e38])


def vectors(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(numbers, numbers, numbers)


@st.composite
def meshes(draw: st.DrawFn, numbers: st.SearchStrategy[float]) -> tuple[Floats, NDArray[np.int32]]:
    """A soup, or a tetrahedron or two with some triangles more: closed parts give occluders."""
    vertices = draw(st.lists(vectors(numbers), min_size=4, max_size=9))
    index = st.integers(0, len(vertices) - 1)
    triangles = draw(st.lists(st.tuples(index, index, index), max_size=8))
    for base in draw(st.sampled_from([(), (0,), (0, len(vertices) - 4)])):
        triangles += [
            (base + i, base + j, base + k)
            for i, j, k in ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
        ]
    return np.array(vertices, np.float32), np.array(triangles, np.int32).reshape(-1, 3)


def rays(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[list[Ray]]:
    ray = st.builds(Ray, vectors(numbers), vectors(numbers), ENDS, ENDS)
    return st.lists(ray, min_size=1, max_size=12)


@st.composite
def worlds(draw: st.DrawFn) -> tuple[Floats, NDArray[np.int32], list[Ray]]:
    mesh_numbers = draw(st.sampled_from([SMALL, SMALL, HALVES, ANY, WILD]))
    ray_numbers = draw(st.sampled_from([mesh_numbers, SMALL, WILD]))
    vertices, triangles = draw(meshes(mesh_numbers))
    some = draw(rays(ray_numbers))
    if len(triangles):
        # At vertices: as nearly as float32 can say.
        with np.errstate(over="ignore"):
            for corner in draw(st.lists(st.integers(0, triangles.size - 1), max_size=4)):
                to = vertices[triangles.ravel()[corner]]
                dir = to - np.float32(some[0].org)
                if np.all(np.isfinite(dir)):
                    some.append(Ray(some[0].org, tuple(dir.tolist()), 0.0, draw(ENDS)))
    return vertices, triangles, some


# ---- the comparison --------------------------------------------------------------------------

MODES = [
    dict(zip(("order", "occluders", "packets", "isa"), choice, strict=True))
    for choice in product(
        ("standard", "extended", "bfs", "qdbfs"), (False, True), (False, True), ("auto", "scalar")
    )
]


@settings(max_examples=400, suppress_health_check=[HealthCheck.too_slow])
@given(worlds())
def test_made_up_worlds(world: tuple[Floats, NDArray[np.int32], list[Ray]]) -> None:
    vertices, triangles, some = world
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(vertices, triangles)
    scene.build()
    arrays = [
        np.array([getattr(ray, field) for ray in some], np.float32)
        for field in ("org", "dir", "tmin", "tmax")
    ]
    found = [
        {}
        if not any(ray.dir) or ray.tmin >= ray.tmax
        else {
            number: hit
            for number, corners in enumerate(vertices[triangles])
            if (hit := meets(ray, corners)) is not None
        }
        for ray in some
    ]
    expected = np.array([bool(hits) for hits in found])
    for mode in MODES:
        answers = scene.occluded(*arrays, **mode)
        assert np.array_equal(answers, expected), (mode, answers, expected)

    closest = scene.intersect(*arrays)
    assert np.array_equal(closest.prim_id >= 0, expected)
    for row, hits in enumerate(found):
        if not hits:
            assert closest.t[row] == np.inf and closest.geom_id[row] == -1
            assert closest.u[row] == closest.v[row] == 0
            continue
        # The exact t rounded once; among equals the first triangle.
        t32, first = min((to_float32(t), number) for number, (t, _, _) in hits.items())
        assert (closest.t[row], closest.prim_id[row]) == (t32, first)
        _, u, v = hits[first]
        assert abs(float(closest.u[row]) - u) < 1e-7
        assert abs(float(closest.v[row]) - v) < 1e-7


@settings(max_examples=200)
@given(meshes(HALVES), rays(HALVES))
def test_ties_between_meshes(mesh: tuple[Floats, NDArray[np.int32]], some: list[Ray]) -> None:
    """The same triangles twice, in another order: the first mesh wins, and in it the first."""
    vertices, triangles = mesh
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(vertices, triangles[::-1])
    scene.add_mesh(vertices, triangles)
    scene.build()
    for ray in some:
        hit = scene.intersect(ray.org, ray.dir, ray.tmin, ray.tmax)
        met = [
            (to_float32(found[0]), number)
            for number, corners in enumerate(vertices[triangles[::-1]])
            if any(ray.dir) and ray.tmin < ray.tmax and (found := meets(ray, corners))
        ]
        if met:
            assert (hit.t, hit.prim_id) == min(met) and hit.geom_id == 0
        else:
            assert (hit.t, hit.prim_id) == (np.inf, -1)
