"""Gate: beams.  Scenes, points and lights that hypothesis makes up; counts as by single rays.

Grids of small integers make points lie on surfaces, lights touch and cut meshes, sheets coincide
and rays meet vertices and edges exactly.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import pyvocc

Floats = NDArray[np.float32]
Mesh = tuple[Floats, NDArray[np.int32]]

grid = st.integers(-4, 4).map(lambda n: n / 4)
corner = st.tuples(grid, grid, grid)
size = st.sampled_from([0.25, 0.5, 1.0, 1e-3])

# A box of two triangles a side, wound outward.
BOX = np.array(list(product((0, 1), repeat=3)), np.float32)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX_TRIANGLES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))], np.int32)


@st.composite
def boxes(draw: Any) -> Mesh:
    low = np.float32(draw(corner))
    extent = np.float32([draw(size) for _ in range(3)])
    triangles = BOX_TRIANGLES
    if draw(st.booleans()):
        triangles = np.delete(triangles, draw(st.integers(0, 11)), axis=0)  # open
    if draw(st.booleans()):
        triangles = np.roll(triangles[:, ::-1], draw(st.integers(0, 2)), axis=1)  # inside out
    return low + BOX * extent, np.ascontiguousarray(triangles)


@st.composite
def soups(draw: Any) -> Mesh:
    vertices = np.float32(draw(st.lists(corner, min_size=3, max_size=9)))
    vertex = st.integers(0, len(vertices) - 1)
    triangles = draw(st.lists(st.tuples(vertex, vertex, vertex), min_size=1, max_size=12))
    return vertices, np.int32(triangles)


@st.composite
def lights(draw: Any) -> pyvocc.Light:
    def vector(values: st.SearchStrategy[float] = grid) -> tuple[float, float, float]:
        return draw(st.tuples(values, values, values))

    at, radius = vector(grid.map(lambda x: 2 * x)), draw(st.sampled_from([0.0, 1e-3, 0.25, 2.0]))
    towards = draw(st.tuples(grid, grid, grid).filter(any))
    two_sided = draw(st.booleans())
    made: dict[str, Any] = {
        "rect": lambda: pyvocc.RectLight(at, vector(), vector(), two_sided=True),
        "rect of one side": lambda: pyvocc.RectLight(
            at, (0.5, 0, 0.25), (0, 0.5, 0), two_sided=two_sided
        ),
        "disk": lambda: pyvocc.DiskLight(at, vector(), vector(), two_sided=True),
        "sphere": lambda: pyvocc.SphereLight(at, radius),
        "point": lambda: pyvocc.PointLight(at, radius=radius),
        "spot": lambda: pyvocc.SpotLight(at, towards, 1.5, radius=radius),
        "sun": lambda: pyvocc.SunLight(towards, draw(st.sampled_from([0.0, 0.01, 1.0]))),
    }
    return made[draw(st.sampled_from(sorted(made)))]()


def points_of(meshes: list[Mesh], seed: int, offset: float) -> tuple[Floats, Floats]:
    """On the triangles of all meshes and off them by `offset`, and anywhere; with normals."""
    random = np.random.default_rng(seed)
    corners = np.concatenate([v[t] for v, t in meshes])
    which = random.integers(0, len(corners), 96)
    # Thirds and halves: also on edges and vertices.
    weights = random.multinomial(2, [1 / 3] * 3, 96) / 2
    normals = np.cross(corners[which, 1] - corners[which, 0], corners[which, 2] - corners[which, 0])
    normals[~normals.any(axis=1)] = (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= random.choice([-1, 1], (96, 1))
    points = np.einsum("ij,ijk->ik", weights, corners[which]) + offset * normals
    points[:16] = random.uniform(-2, 2, (16, 3))
    # Some clusters of neighbours.
    points[64:] = points[64] + random.uniform(-0.05, 0.05, (32, 3))
    return points.astype(np.float32), normals.astype(np.float32)


@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    meshes=st.lists(boxes() | soups(), min_size=1, max_size=4),
    sources=st.lists(lights(), min_size=1, max_size=3),
    samples=st.sampled_from([1, 4, 7, 16, 25, 64]),
    sampler=st.sampled_from(["sobol", "jitter"]),
    horizon=st.sampled_from(["sample", "centre"]),
    offset=st.sampled_from([0.0, 1e-4, 0.01, -1e-4]),
    isa=st.sampled_from(pyvocc.isas()),
    occluders=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_beams_count_as_single_rays_do(
    meshes: list[Mesh],
    sources: list[pyvocc.Light],
    samples: int,
    sampler: str,
    horizon: str,
    offset: float,
    isa: str,
    occluders: bool,
    seed: int,
) -> None:
    scene = pyvocc.Scene(threads=1)
    for vertices, triangles in meshes:
        scene.add_mesh(vertices, triangles)
    scene.build()
    points, normals = points_of(meshes, seed, offset)
    common: dict[str, Any] = {"samples": samples, "sampler": sampler, "horizon": horizon}
    expected = scene.light_visibility(
        points, normals, sources, **common, method="rays", order="standard", occluders=False
    )
    actual = scene.light_visibility(
        points, normals, sources, **common, method="beams", isa=isa, occluders=occluders
    )
    np.testing.assert_array_equal(actual, expected)


@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    meshes=st.lists(boxes() | soups(), min_size=1, max_size=4),
    distance=st.sampled_from([1e-4, 0.25, 1.0, 3.0, 1e6, 1e30, np.inf]),
    samples=st.sampled_from([1, 4, 7, 16, 25, 64, 300]),
    sampler=st.sampled_from(["sobol", "jitter"]),
    offset=st.sampled_from([0.0, 1e-7, 1e-4, 0.01, -1e-4]),
    scale=st.sampled_from([1.0, 1 / 3, 2.0**-20, 2.0**25, 2.0**-40]),
    bend=st.sampled_from([0.0, 1e-7, 0.01, 0.5]),
    isa=st.sampled_from(pyvocc.isas()),
    occluders=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_domes_count_as_single_rays_do(
    meshes: list[Mesh],
    distance: float,
    samples: int,
    sampler: str,
    offset: float,
    scale: float,
    bend: float,
    isa: str,
    occluders: bool,
    seed: int,
) -> None:
    scene = pyvocc.Scene(threads=1)
    for vertices, triangles in meshes:
        scene.add_mesh(vertices * np.float32(scale), triangles)
    scene.build()
    points, normals = points_of(meshes, seed, offset)
    normals += bend * np.random.default_rng(seed).uniform(-1, 1, normals.shape).astype(np.float32)
    at = (points * np.float32(scale), normals, distance * scale, samples)
    slow: dict[str, Any] = {"method": "rays", "order": "standard", "occluders": False}
    fast: dict[str, Any] = {"method": "beams", "isa": isa, "occluders": occluders}
    expected = scene.ambient_occlusion(*at, sampler=sampler, **slow)
    actual = scene.ambient_occlusion(*at, sampler=sampler, **fast)
    np.testing.assert_array_equal(actual, expected)
    bits = [np.zeros((len(points), (samples + 7) // 8), np.uint8) for _ in range(2)]
    for known, way in zip(bits, (slow, fast), strict=True):
        known[::2] = seed % 256
        scene.ambient_occlusion(*at, sampler=sampler, blocked=known, **way)
    np.testing.assert_array_equal(bits[1], bits[0])


@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    meshes=st.lists(boxes() | soups(), min_size=1, max_size=4),
    ends=st.lists(st.tuples(corner, corner), min_size=1, max_size=64),
    scale=st.sampled_from([1.0, 2.0**-20, 2.0**25, 2.0**-40, 1 / 3]),
    tmax=st.sampled_from([1.0, 0.5, np.inf]),
    isa=st.sampled_from(pyvocc.isas()),
    occluders=st.booleans(),
)
def test_rays_through_the_hierarchy_answer_as_through_the_tree(
    meshes: list[Mesh],
    ends: list[tuple[Any, Any]],
    scale: float,
    tmax: float,
    isa: str,
    occluders: bool,
) -> None:
    scene = pyvocc.Scene(threads=1)
    for vertices, triangles in meshes:
        scene.add_mesh(vertices * np.float32(scale), triangles)
    scene.build()
    org = np.float32([a for a, _ in ends]) * np.float32(scale)
    dir = np.float32([b for _, b in ends]) * np.float32(scale)
    expected = scene.occluded(
        org, dir, 0.0, tmax, method="rays", order="standard", occluders=False, packets=False
    )
    actual = scene.occluded(org, dir, 0.0, tmax, method="beams", isa=isa, occluders=occluders)
    np.testing.assert_array_equal(actual, expected)
    np.testing.assert_array_equal(scene.occluded(org, dir, 0.0, tmax), expected)


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    meshes=st.lists(boxes() | soups(), min_size=1, max_size=12),
    seed=st.integers(0, 2**32 - 1),
    spread=st.tuples(*2 * (st.sampled_from([0.0, 2.0**-10, 0.125, 1.0]),)),
    count=st.sampled_from([16, 250, 2000]),
    isa=st.sampled_from(pyvocc.isas()),
)
def test_packets_answer_as_through_the_tree(
    meshes: list[Mesh], seed: int, spread: tuple[float, float], count: int, isa: str
) -> None:
    scene = pyvocc.Scene(threads=1)
    for vertices, triangles in meshes:
        scene.add_mesh(vertices, triangles)
    scene.build()
    random = np.random.default_rng(seed)

    def points(width: float) -> Floats:
        """Sixteen on a small grid around each of some on a large one."""
        around = np.repeat(random.integers(-8, 9, (count // 16 + 1, 3)) / 4, 16, axis=0)[:count]
        return np.float32(around + width * random.integers(-2, 3, (count, 3)))

    org = points(spread[0])
    dir = points(spread[1]) - org
    tmin = random.choice(np.float32([0, 0, 0.25, -1]), count)
    tmax = random.choice(np.float32([1, 1, 0.5, np.inf]), count)
    expected = scene.occluded(
        org, dir, tmin, tmax, method="rays", order="standard", occluders=False, packets=False
    )
    for occluders in (False, True):
        actual = scene.occluded(org, dir, tmin, tmax, isa=isa, occluders=occluders)
        np.testing.assert_array_equal(actual, expected)
